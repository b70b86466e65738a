"""The report as one JSON object: report.json, schema gse.report/1.

[S]: Saifudin & Triharjanto, the neighbour technique of the LAPAN star sensor; its section 4 has table 4-1.
"""

import dataclasses
import hashlib
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gse.diagnosis.set_up_mistake import mount_fit
from gse.procedure.as_run import StepRun, spread_of, station_of
from gse.report.conclusion import conclusion
from gse.station.housekeeping import firmware_text, parameter_differences, parameters_of, parameters_sha256
from gse.station.results import Subject
from gse.station.session_data import SessionData
from gse.statistics.decision import COVERAGE_FACTOR, DECISION_TEXT, RISK, Claim, Outcome, Row
from gse.statistics.excuses import excusing
from gse.statistics.incidents import Incident
from gse.statistics.metrics import metrics
from gse.statistics.session_statistics import Statistics
from gse.statistics.sky_summary import SkyStretch, sky_summary
from gse.statistics.stated import errors_by_quality, stated_accuracy
from gse.statistics.subject_statistics import SubjectStatistics
from gse.statistics.truth_budget import TruthUncertaintyBudget
from gse.values import instant
from gse.values.axis import OF_SENSOR, ON_SKY
from gse.values.limits import Decision
from gse.verdict.assessment import Assessment, ProcedureRun, is_left_out
from gse.verdict.requirements import SlewStep
from protocols import COLOURS

# The ``test:`` block of a station file as the report gives it, with what the sensor says of itself.

_MOST_SENT = 5
"""A sensor that sends a new serial number in each frame tells nothing by the sixth."""


def documented_test(session: SessionData, rows: Iterable[Row]) -> dict[str, Any]:
    """The object ``test`` of report.json; null where station file and sensor say nothing.

    ``requirements_of_no_row`` are those of names that no row has.
    """
    given = session.station.test.model_dump(mode="json")
    names = {row.name for row in rows}
    requirements = given.pop("requirements")
    del given["parameters"], given["parameters_sha256"]  # beside those that the sensor read back
    unknown = [{"row": row, **of_row} for row, of_row in requirements.items() if row not in names]
    messages = [message for _, message in session.statuses]
    sensor = {
        "serial": _said([str(message.serial) for message in messages if message.serial], given.pop("sensor_serial")),
        "firmware": _said(
            [firmware_text(message) for message in messages if any(message.firmware)], given.pop("sensor_firmware")
        ),
    }
    return {**given, "sensor": sensor, "requirements_of_no_row": unknown}


def requirement_of(session: SessionData, row: Row) -> dict[str, Any] | None:
    """The requirement that a row verifies."""
    found = session.station.test.requirements.get(row.name)
    return found.model_dump(mode="json") if found else None


def _said(sent: list[str], stated: str | None) -> dict[str, Any]:
    """What the sensor sent and what the station file states; all of it, where the sensor sent several."""
    return {"sent": list(dict.fromkeys(sent))[:_MOST_SENT], "stated": stated}


SCHEMA = "gse.report/1"
DECIMALS = {"deg": 6, "arcsec": 3}
"""Decimals of an angle by its unit; 1e-6 deg is 0.0036 arcsec."""
DIGITS = 6
"""Significant digits of every other number; processors differ in the tenth, which rounding hides almost always."""


def summarise(session: SessionData, assessment: Assessment) -> dict[str, Any]:
    """What is in report.json; floats are rounded, null where they are unknown or infinite."""
    stats = assessment.statistics
    report = {
        "schema": SCHEMA,
        "verdict": assessment.verdict,
        "word": assessment.word,
        "simulated": assessment.simulated,
        "relative": assessment.relative,
        "tested": tested(session, stats),
        "reasons": assessment.reasons,
        "findings": [str(finding) for finding in assessment.findings],
        "diagnosis": assessment.findings,
        "not_tested": assessment.not_tested,
        "decision": _decision(session),
        "test": documented_test(session, assessment.rows),
        "measurements": [_row(session, row) for row in assessment.rows if not is_left_out(row, session.station)],
        "accuracy": {
            name: {**subject.axes, "half_cone_95": subject.half_cone_95} for name, subject in stats.subjects.items()
        },
        "metrics": list(metrics(stats)),
        "identification": _identification(stats),
        "timing": _timing(stats),
        "clock": stats.clock,
        "envelope": _envelope(session, stats),
        "mount_fit": mount_fit(session, stats.counted),
        "equivalence": stats.equivalence,
        "link": {**dataclasses.asdict(session.link), "truncated": session.truncated},
        "truth_budget": _budget(assessment.budget),
        "table_4_1": table_4_1([(session.station.sensor.name, stats)]),
        "sky": _sky(session),
        "sensor_health": assessment.health,
        "exclusions": [
            {**_exclusion(item, count), "answers": answers}
            for (item, count), answers in zip(stats.exclusions, stats.answers_excluded, strict=True)
        ],
        "incidents": [_incident(one) for one in stats.incidents],
        "session": _session(session),
    }
    report |= dict(_where_there_is(session, assessment))
    document: dict[str, Any] = plain(report)
    return document | {"conclusion": conclusion(document)}


def _where_there_is(session: SessionData, assessment: Assessment) -> Iterator[tuple[str, Any]]:
    """Objects of the report that only some sessions have."""
    stats = assessment.statistics
    if assessment.slew:
        yield "slew", [_slew_step(subject, step) for subject, steps in assessment.slew.items() for step in steps]
    if session.housekeeping.summaries:
        yield "housekeeping", list(_items(session))
    if stats.rates:
        yield "rates", list(stats.rates)
    if stated := stated_accuracy(session, stats):
        yield "stated_accuracy", [{**dataclasses.asdict(of_axis), "scatter": of_axis.word} for of_axis in stated]
    if qualities := errors_by_quality(session, stats):
        yield "quality", list(qualities)
    if stats.names is not None:
        yield "star_names", stats.names
    if session.housekeeping.parameters:
        yield "parameters", _parameters(session)
    if (external := external_identifier(session)) is not None:
        yield "external_identifier", external
    if assessment.procedure is not None:
        yield "procedure", procedure_run(session, assessment.procedure)


def _parameters(session: SessionData) -> dict[str, Any]:
    """What the sensor read back of its parameters, and how it is not what was stated."""
    housekeeping, test = session.housekeeping, session.station.test
    return {
        "sha256": parameters_sha256(housekeeping),
        "stated_sha256": test.parameters_sha256,
        "values": parameters_of(housekeeping),
        "differences": list(parameter_differences(housekeeping, test)),
    }


def _slew_step(subject: Subject, step: SlewStep) -> dict[str, Any]:
    """What a subject did while the scene turned at one rate; noise is the standard deviation."""
    axes = step.subject.axes
    return {
        "subject": subject,
        "rate_deg_per_s": step.rate_deg_per_s,
        "frames": step.frames,
        "available": step.subject.available.value,
        "false_answers": step.subject.false_answers.value,
        **{f"p95_{axis.key}_arcsec": axes[axis.key].p95_abs_arcsec for axis in ON_SKY},
        **{f"noise_{axis.key}_arcsec": axes[axis.key].std_arcsec for axis in OF_SENSOR},
        "outcome": step.outcome,
        "reasons": [row.reason for row in step.rows if row.outcome is not Outcome.PASS],
    }


def procedure_run(session: SessionData, run: ProcedureRun) -> dict[str, Any]:
    """The as-run log: each step with its outcome, those that watched the sensor with their rows, and the starts."""
    return {
        "name": run.log.name,
        "operator": run.log.operator,
        "simulated": session.is_simulated,
        "is_over": run.log.is_over,
        "power": run.log.power,
        "deviations": run.log.deviations,
        "steps": [
            {
                "number": step.number,
                "planned": step.planned,
                "outcome": step.outcome,
                "seen": step.seen,
                "by": step.by,
                "from": None if step.from_ns is None else instant.to_text(step.from_ns, 3),
                "until": instant.to_text(step.until_ns, 3),
                "rows": _rows_of_step(session, step, run.watched.get(step.number)),
            }
            for step in run.log.steps
        ],
        "starts": {
            "boot": spread_of([start.boot_s for start in run.starts]),
            "first_fix": spread_of([start.first_fix_s for start in run.starts]),
            "each": [
                {"utc": instant.to_text(start.utc_ns, 3), "boot_s": start.boot_s, "first_fix_s": start.first_fix_s}
                for start in run.starts
            ],
        },
    }


def _rows_of_step(session: SessionData, step: StepRun, assessment: Assessment | None) -> list[dict[str, Any]]:
    """The rows of a stretch that a step watched, with the requirements that it names."""
    watch = step.watch
    if watch is None or assessment is None:
        return []
    under = dataclasses.replace(session, station=station_of(session.station, watch))
    return [_row(under, row) for row in assessment.rows if not math.isnan(row.limit)]


def tested(session: SessionData, stats: Statistics) -> str:
    """What the verdict is on: an identifier on the panoramas of a sensor, or what the sensor answers itself."""
    name, subjects = session.station.sensor.name, stats.subjects
    own = "the sensor's own answers" + ("" if Subject.SENSOR in subjects else ": not tested")
    if Subject.ONBOARD not in subjects:
        return f"the own answers of {name}"
    identifier = f"identifier {session.station.identifier.label} on the panoramas of {name}"
    return f"{identifier}{' and ' if Subject.SENSOR in subjects else '; '}{own}"


def _envelope(session: SessionData, stats: Statistics) -> dict[str, Any]:
    """The conditions that the counted frames of a session met: outside of them the verdict claims nothing."""
    frames, used = session.frames.columns, stats.counted.used
    steps_s = np.diff(frames["utc_ns"]) / instant.NS_PER_S
    step_s = float(np.median(steps_s)) if len(steps_s) else math.nan
    names = "exposure_s", "temperature_c", "limiting_mag", "matched", "sun_altitude_deg"
    ranges = {name: _range(frames[name][used].astype(np.float32)) for name in names}
    return {
        "frames_hz": 1 / step_s if step_s > 0 else None,
        "boresight_arcsec_per_s": stats.onboard.earth_rate.measured_arcsec_per_s,
        "star_fields": stats.onboard.star_fields,
        **{name: None if of["min"] is None else of for name, of in ranges.items()},
    }


def external_identifier(session: SessionData) -> dict[str, Any] | None:
    """The external identifier of a session with what it gave; None without one.

    ``time_of`` says whose clock gave the identification times: the identifier's own, or this host's.
    """
    if session.external is None:
        return None
    counts = session.external_counts
    own = "the identifier's own clock"
    time_of = (
        own if counts.own_times == counts.answers else "this host" if not counts.own_times else f"{own}, and this host"
    )
    return {
        **{key: value for key, value in session.external.items() if key != "schema"},
        "answers": counts.answers,
        "failures": dict(sorted(counts.failures.items())),
        "stars_named": counts.stars_named,
        "stars_unknown": counts.stars_unknown,
        "time_of": time_of,
    }


def _decision(session: SessionData) -> dict[str, Any]:
    rule = session.station.limits.decision
    return {
        "rule": rule,
        "confidence": 1 - RISK,
        "coverage_factor": COVERAGE_FACTOR,
        "text": DECISION_TEXT[rule],
        "risks": _RISKS[rule],
    }


_RISKS = {
    Decision.GUARDED: (
        f"Risks of each row for a sensor at its limit: {100 * RISK:.0f} % of a false PASS, as much of a false FAIL."
    ),
    Decision.SIMPLE: (
        "Risks of each row: that of a false PASS is stated beside it; that of a false FAIL is up to 50 % at the limit."
    ),
}


def _items(session: SessionData) -> Iterator[dict[str, Any]]:
    """What a session showed of each item of its housekeeping, in the order of the description."""
    for item in session.housekeeping.items:
        if (seen := session.housekeeping.summaries.get(item.name)) is not None:
            numbers: dict[str, float | str] = {
                "first": seen.first,
                "lowest": seen.least,
                "highest": seen.largest,
                "last": seen.last,
            }
            if item.words or item.are_bits:
                numbers = {"first": item.value(seen.first), "last": item.value(seen.last)}
            colours = {name: count for name, count in zip(COLOURS, seen.colours, strict=True) if name}
            limits = {"yellow": item.yellow, "red": item.red}
            yield {
                "item": item.name,
                "message": item.message,
                "unit": item.unit,
                "values": seen.count,
                **numbers,
                **limits,
                **{f"values_{name}": count for name, count in colours.items()},
            }


def _row(session: SessionData, row: Row) -> dict[str, Any]:
    values = {field.name: getattr(row, field.name) for field in dataclasses.fields(row)}
    return values | {"coverage_factor": COVERAGE_FACTOR, "requirement": requirement_of(session, row)}


def _identification(stats: Statistics) -> dict[str, Any]:
    subjects = {
        name: {
            "available": subject.available,
            "false_answers": subject.false_answers,
            "star_fields": subject.star_fields,
            "time_ms": subject.time_ms,
        }
        for name, subject in stats.subjects.items()
    }
    return {
        "frames": stats.frames,
        "frames_expected": stats.frames_expected,
        "statuses": stats.statuses,
        "answer_checks": stats.answer_checks,
        "subjects": subjects,
    }


def _timing(stats: Statistics) -> dict[str, Any]:
    subjects = {
        name: {
            "acquisition_s": subject.acquisition_s,
            "outage_s": subject.outage_s,
            "arrival_ms": subject.arrival_ms,
            "earth_rate": subject.earth_rate,
        }
        for name, subject in stats.subjects.items()
    }
    return {"arrival_ms": stats.arrival_ms, "subjects": subjects}


def _budget(budget: TruthUncertaintyBudget) -> dict[str, Any]:
    """``ra_arcsec`` and ``de_arcsec`` are expanded uncertainties (95 %)."""
    return {"ra_arcsec": budget.ra_arcsec, "de_arcsec": budget.de_arcsec, "axes": budget.axes, "terms": budget.terms}


# Table 4-1 of [S]: what the sensors of LAPAN-A2 and LAPAN-ORARI reached, and its layout for the sensor under test.

ARCMIN_PER_DEG = 60.0
LIMIT_DEG = 1 / 60
"""The greatest error that [S] allows: 1 arcmin."""


@dataclass(frozen=True, slots=True)
class PaperRow:
    """One sensor: mean |dRA| (not times cos DE) and mean |dDE| in degrees, and its processing time as text."""

    name: str
    d_ra_deg: float
    d_de_deg: float
    time: str


PAPER = (
    PaperRow("Star Sensor 1 of the paper", 0.006676, 0.009221, "< 200 ms"),
    PaperRow("Star Sensor 2 of the paper", 0.003552, 0.00866, "< 200 ms"),
    PaperRow("Star Sensor 3 of the paper", 0.005, 0.005, "< 200 ms"),
    PaperRow("mean of the paper", 0.005076, 0.007627, ""),
)


def this_sensor(name: str, figures: SubjectStatistics) -> PaperRow:
    """The row of the sensor under test; its time is the 99th percentile, of this host where none is stated."""
    p99_ms = figures.time_ms.p99
    where = "" if figures.time_is_stated else " (this host)"
    time = "not recorded" if math.isnan(p99_ms) else f"{p99_ms:.3g} ms{where}"
    return PaperRow(name, figures.mean_abs_d_ra_deg, figures.mean_abs_d_de_deg, time)


def table_4_1(sessions: Iterable[tuple[str, Statistics]]) -> dict[str, Any]:
    """Table 4-1 of the LAPAN paper below a row for each subject of named sessions; NaN where a value is unknown."""
    own = [
        this_sensor(f"{name}, {subject}", of_one)
        for name, stats in sessions
        for subject, of_one in stats.subjects.items()
    ]
    return {"rows": [table_row(row) for row in (*own, *PAPER)], "limit_deg": LIMIT_DEG}


def table_row(row: PaperRow) -> dict[str, Any]:
    """A row of table 4-1 in degrees and arcmin."""
    return {
        "name": row.name,
        "mean_d_ra_deg": row.d_ra_deg,
        "mean_d_de_deg": row.d_de_deg,
        "mean_d_ra_arcmin": row.d_ra_deg * ARCMIN_PER_DEG,
        "mean_d_de_arcmin": row.d_de_deg * ARCMIN_PER_DEG,
        "time": row.time,
    }


def _sky(session: SessionData) -> dict[str, Any] | None:
    summary = sky_summary(session.frames.columns)
    if summary is None:
        return None
    values = {field.name: getattr(summary, field.name) for field in dataclasses.fields(summary)}
    stated_mag = session.station.sensor.zero_point_mag
    stated = {} if stated_mag is None else {"stated_zero_point_mag": stated_mag}
    return values | {"stretches": [_stretch(item) for item in summary.stretches]} | stated


def _stretch(item: SkyStretch) -> dict[str, Any]:
    values = {field.name: getattr(item, field.name) for field in dataclasses.fields(item)}
    begin, end = instant.to_text(values.pop("from_ns")), instant.to_text(values.pop("until_ns"))
    return {"from": begin, "until": end, **values}


def _exclusion(item: Any, count: int) -> dict[str, Any]:
    return {
        "from": instant.to_text(item.from_ns),
        "until": instant.to_text(item.until_ns),
        "cause": item.cause,
        "reason": item.reason,
        "frames": count,
        "takes_answers_out": bool(excusing(Claim.ACCURACY, [item])),
    }


def _incident(one: Incident) -> dict[str, Any]:
    return {
        "subject": one.subject,
        "from": instant.to_text(one.from_ns),
        "until": instant.to_text(one.until_ns),
        "what": one.what,
        "frames": one.frames,
        "stretches": one.stretches,
        "worst_arcsec": one.worst_arcsec,
    }


def _session(session: SessionData) -> dict[str, Any]:
    station = session.station
    utc_ns = session.frames.columns["utc_ns"]
    mount = session.alignment.mount if session.alignment else station.mount
    return {
        "sensor": station.sensor.name,
        "site": None if station.subject else dataclasses.asdict(station.site),
        "mount": None if station.subject else dataclasses.asdict(mount),
        "protocol": session.protocol_name,
        "identifier": station.identifier.facts(),
        "first_utc": instant.to_text(int(utc_ns.min())) if len(utc_ns) else None,
        "last_utc": instant.to_text(int(utc_ns.max())) if len(utc_ns) else None,
        "duration_s": float(utc_ns.max() - utc_ns.min()) / instant.NS_PER_S if len(utc_ns) else None,
        "alignment": str(session.alignment) if session.alignment else None,
        "events": len(session.events) + session.events_not_kept,
        "temperature_c": _range(session.frames.columns["temperature_c"]),
        "raw_sha256": session.raw_sha256,
        "station_sha256": hashlib.sha256(session.station_text.encode()).hexdigest(),
        "catalog": session.catalog,
        "version": session.versions.get("gse-star-sensor"),
    }


def _range(values: NDArray[np.float32]) -> dict[str, Any]:
    finite = values[np.isfinite(values)].astype(np.float64)
    return {"min": finite.min(), "max": finite.max()} if len(finite) else {"min": None, "max": None}


def plain(value: Any, unit: str = "") -> Any:
    """Only what JSON knows: enums as text, dataclasses as objects, floats rounded, NaN and infinity as null.

    How a float is rounded follows from the ``unit`` at the end of its name, or of the name of what it belongs to.
    """
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, bool | int | str) or value is None:
        return value
    if isinstance(value, float):  # numpy's float64 too
        # + 0.0 makes a zero of a rounded-off negative number
        return _rounded(float(value), unit) + 0.0 if math.isfinite(value) else None
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        value = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    if isinstance(value, dict):
        of_all = _unit(str(value.get("unit", "")).partition(" ")[0]) or unit
        return {str(key): plain(item, _unit(str(key)) or of_all) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item, unit) for item in value]
    raise TypeError(f"{type(value).__name__} has no place in a report")


def _unit(name: str) -> str:
    """The unit of an angle at the end of a name; empty of any other."""
    return next((unit for unit in DECIMALS if name.removesuffix("_per_h").endswith(unit)), "")


def _rounded(value: float, unit: str) -> float:
    return round(value, DECIMALS[unit]) if unit else float(f"{value:.{DIGITS}g}")
