"""report.html: one page, readable offline, printable."""

import functools
import itertools
import json
import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum
from importlib import resources
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
from jinja2.bccache import Bucket
from markupsafe import Markup, escape

from drivers.host_files import only_a_file
from drivers.outside_text import plain_lines
from gse.config.station import DocumentedTest, Station
from gse.errors import UsageError
from gse.process.jit import compiled_folder
from gse.report.metric_table import metric_table
from gse.report.provenance import Provenance, canonical, fingerprint, fingerprint_in, provenance_in
from gse.report.summary import LIMIT_DEG, summarise
from gse.report.terminal import further_lines, is_simple, quantity, risk_text
from gse.station.results import Subject
from gse.station.session_data import SessionData
from gse.statistics.metrics import is_drift_given
from gse.statistics.sky_summary import zero_point_mag
from gse.values import instant
from gse.values.axis import AXES, CROSS_X, CROSS_Y
from gse.verdict.assessment import Assessment

_AXIS_NAMES = {
    **{axis.key: axis.label for axis in AXES},
    **{axis.key: f"cross-boresight {axis.label}" for axis in (CROSS_X, CROSS_Y)},
    "half_cone_95": "off the boresight",
}
_AXIS_COLUMNS = (
    ("bias_arcsec", "bias"),
    ("bias_error_arcsec", "± (95 % interval)"),
    ("std_arcsec", "std (1 σ)"),
    ("three_sigma_arcsec", "3 σ"),
    ("rms_arcsec", "RMS"),
    ("mean_abs_arcsec", "mean |x|"),
    ("p95_abs_arcsec", "|x| of 95 of 100 frames"),
    ("max_abs_arcsec", "max |x|"),
    ("low_frequency_arcsec", "low freq."),
    ("nea_arcsec", "NEA"),
)
_MAX_EVENTS = 200
NO_PLOTS = '<meta name="gse-plots" content="none">'
"""Mark in the head of a page without plots."""
PAPER = '<h2 id="paper">'
"""Where a page has Table 4-1 of the LAPAN paper."""
_ARCSEC_PER_DEG = 3600.0


def report_html(
    session: SessionData,
    assessment: Assessment,
    report: dict[str, Any],
    made_by: Provenance | None = None,
    *,
    plots: bool = True,
    paper: bool = False,
) -> str:
    """The page of a session; all but its last section, which says what it is ``made_by``, follows from the session.

    ``paper``: with Table 4-1 of the LAPAN paper, which a station that asks what the paper asks shows anyway.
    """
    times_recorded = bool((np.nan_to_num(session.frames.columns["elapsed_us"]) > 0).any())
    sends_panoramas = session.subject is not Subject.SENSOR
    drawn = _drawn(session, assessment, times_recorded=times_recorded) if plots else None
    return _template().render(
        report=report,
        further=further_lines(report),
        simple=is_simple(report),
        has_test=session.station.test != DocumentedTest(),
        lacking=_lacking(report["test"]),
        false_arcsec=session.station.limits.false_beyond_arcsec,
        envelope=_envelope(report["envelope"]),
        **_terms(report["truth_budget"]),
        fingerprint=canonical(fingerprint(report)),
        style=page_style(),
        caption=numbered("Table", "caption"),
        without_plots=NO_PLOTS if drawn is None else "",
        plot=_plot(drawn),
        starts_plot=_starts_plot(report.get("procedure")),
        times_recorded=times_recorded,
        sends_panoramas=sends_panoramas,
        zero_point_mag=zero_point_mag(session.frames.columns),
        compared=[subject for subject, axes in report["accuracy"].items() if axes["d_de"]["n"]],
        axis_names=_AXIS_NAMES,
        axis_columns=_AXIS_COLUMNS,
        metric_tables={subject: _metrics(report, subject) for subject in report["accuracy"]},
        paper=paper or _asks_as_the_paper(session.station),
        events=[(instant.to_text(event.utc_ns, 0), event.kind, event.text) for event in session.events[:_MAX_EVENTS]],
        events_more=max(len(session.events) - _MAX_EVENTS, 0) + session.events_not_kept,
        station_text=plain_lines(session.station_text),
        provenance_json=json.dumps(made_by, separators=(",", ":")),
        provenance=[(key.replace("_", " "), _in_words(key, value)) for key, value in (made_by or {}).items()],
    )


_PLOT_PX, _PLOT_HEIGHT_PX = 640, 120


def _starts_plot(run: dict[str, Any] | None) -> Markup:
    """Each start as a point: its first fix in seconds, in their order; nothing of fewer than two."""
    each = run["starts"]["each"] if run else []
    known = [(n, start["first_fix_s"]) for n, start in enumerate(each) if start["first_fix_s"] is not None]
    if len(known) < 2:
        return Markup("")
    longest = max(value for _, value in known)
    step, scale = (_PLOT_PX - 60) / max(len(each) - 1, 1), (_PLOT_HEIGHT_PX - 30) / longest
    points = "".join(
        f'<circle cx="{50 + n * step:.1f}" cy="{_PLOT_HEIGHT_PX - 15 - value * scale:.1f}" r="3"/>'
        for n, value in known
    )
    base = _PLOT_HEIGHT_PX - 15
    return Markup(
        f'<figure><svg viewBox="0 0 {_PLOT_PX} {_PLOT_HEIGHT_PX}" role="img" aria-label="first fix of each start">'
        f'<path d="M45 5V{base}H{_PLOT_PX}" fill="none" stroke="currentColor"/>'
        f'<text x="40" y="20" text-anchor="end" font-size="12" fill="currentColor">{longest:.1f} s</text>'
        f'<text x="40" y="{base}" text-anchor="end" font-size="12" fill="currentColor">0</text>{points}</svg>'
        f"<figcaption>First fix of each of the {len(each)} starts</figcaption></figure>"
    )


_SIGNED = ("id", "procedure", "operator", "approver")
"""What a signature needs to stand for something."""
_SMALL = 0.01
"""Share of the combined uncertainty below which a term is only named."""


def _lacking(test: dict[str, Any]) -> list[str]:
    """The keys of the station file without which there is nothing to sign."""
    keys = [f"test.{key}" for key in _SIGNED if test[key] in (None, "")]
    serial = test["sensor"]["serial"]
    return keys if serial["sent"] or serial["stated"] else [*keys, "test.sensor_serial"]


def _envelope(met: dict[str, Any]) -> list[tuple[str, str]]:
    """The conditions that a session met, in words; those that it does not know are left out."""
    shown = (
        ("frames", "frames_hz", "Hz"),
        ("boresight on the sky", "boresight_arcsec_per_s", "arcsec/s"),
        ("exposure", "exposure_s", "s"),
        ("detector temperature", "temperature_c", "°C"),
        ("faintest star of a frame", "limiting_mag", "mag"),
        ("stars of an answer", "matched", ""),
        ("star fields", "star_fields", ""),
        ("altitude of the Sun", "sun_altitude_deg", "°"),
    )
    return [(name, _extent(met[key], unit)) for name, key, unit in shown if met[key] is not None]


def _extent(value: Any, unit: str) -> str:
    if not isinstance(value, dict):
        return f"{value:.4g} {unit}".rstrip()
    low, high = f"{value['min']:.4g}", f"{value['max']:.4g}"
    return f"{low if low == high else f'{low} to {high}'}{'' if unit == '°' else ' '}{unit}".rstrip()


def _terms(budget: dict[str, Any]) -> dict[str, Any]:
    """Those of a budget that count, and the names of the others with what they are together."""
    sizes = [[term[f"{axis}_arcsec"] for axis in ("ra", "de", "roll")] for term in budget["terms"]]
    combined = [axis["standard_arcsec"] for axis in budget["axes"].values()]
    # beside a term that is not known, the greatest of the others tells what is small
    known = [max((of[axis] for of in sizes if of[axis] is not None), default=0.0) for axis in range(3)]
    totals = [known[axis] if total is None else total for axis, total in enumerate(combined)]
    small = [
        all(size is not None and size <= _SMALL * total for size, total in zip(of, totals, strict=True)) for of in sizes
    ]
    together = [
        math.hypot(*(of[axis] for of, is_small in zip(sizes, small, strict=True) if is_small)) for axis in range(3)
    ]
    return {
        "budget_terms": [term for term, is_small in zip(budget["terms"], small, strict=True) if not is_small],
        "small_terms": {
            "names": [term["name"] for term, is_small in zip(budget["terms"], small, strict=True) if is_small],
            "together_arcsec": together,
        },
    }


_LEAST_RANGE_K = 5.0
"""Temperatures that differ by less tell nothing of what the temperature does."""
_OF_TEMPERATURE = "thermo-elastic error"


def _metrics(report: dict[str, Any], subject: str) -> dict[str, Any]:
    """The lines of the metrics that are known, and the names of the others."""
    warm = report["session"]["temperature_c"]
    has_range = warm["min"] is not None and warm["max"] - warm["min"] >= _LEAST_RANGE_K
    lines = metric_table(report["metrics"], subject)
    known = [line for line in lines if set(line[3]) != {"–"} and (has_range or line[0] != _OF_TEMPERATURE)]
    return {"known": known, "absent": [line[0] for line in lines if line not in known]}


def _asks_as_the_paper(station: Station) -> bool:
    """Whether a station tests the technique of the LAPAN paper against its limit."""
    limit_arcsec = LIMIT_DEG * _ARCSEC_PER_DEG
    limits = (station.limits.d_ra_cosde_arcsec, station.limits.d_de_arcsec)
    return station.identifier.algorithm == "neighbour" and all(math.isclose(one, limit_arcsec) for one in limits)


def _drawn(session: SessionData, assessment: Assessment, *, times_recorded: bool) -> dict[str, str]:
    from gse.report.session_plots import session_plots  # a page without plots does not wait for matplotlib

    return session_plots(session, assessment, times_recorded=times_recorded)


class _TemplateOnDisk(jinja2.FileSystemBytecodeCache):
    """The template as Python's code: to make it takes ten times as long as to read it."""

    def dump_bytecode(self, bucket: Bucket) -> None:
        """Keep the code; a disk that is full is not an error."""
        with suppress(OSError):
            super().dump_bytecode(bucket)


@functools.cache
def _template() -> jinja2.Template:
    folder = compiled_folder()
    pages = page_environment()
    pages.bytecode_cache = None if folder is None else _TemplateOnDisk(str(folder))
    pages.filters.update(
        figure=_figure, quantity=quantity_text, angle=_angle, given=_given, risk=risk_text, drift=_drift
    )
    return pages.get_template("report.html.jinja")


def page_environment() -> jinja2.Environment:
    """What all pages are made in; ``get_template`` finds those of this room."""
    pages = jinja2.Environment(
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
        loader=jinja2.FunctionLoader(_resource),
    )
    pages.filters["number"] = _number
    return pages


def numbered(word: str, element: str) -> Callable[[str], Markup]:
    """A function that gives a text its number, one more with each call."""
    numbers = itertools.count(1)
    return lambda text: Markup(f"<{element}>{word} {next(numbers)}. {escape(text)}</{element}>")


def _plot(svgs: dict[str, str] | None) -> Callable[[str, str], Markup]:
    """A function that gives the plot of a name with its numbered caption; nothing where none is drawn."""
    if svgs is None:
        return lambda name, text: Markup("")
    caption = numbered("Figure", "figcaption")
    return lambda name, text: Markup(f"<figure>{svgs[name]}{caption(text)}</figure>")


def _in_words(key: str, value: Any) -> str:
    if value is None:
        return "never run" if key == "self_check" else "unknown"
    if isinstance(value, dict):
        return ", ".join(f"{name.replace('_', ' ')} {item}" for name, item in value.items())
    return str(value)


def page_style() -> str:
    """The style sheet of all pages."""
    return _resource("report.css")


def _resource(name: str) -> str:
    return resources.files("gse.report").joinpath(name).read_text(encoding="utf-8")


def _number(value: float | None, decimals: int = 2) -> str:
    """A number with a fixed count of decimals and no minus before zero, a dash where it is unknown."""
    return "–" if value is None else f"{value:z.{decimals}f}"


def quantity_text(value: float | None, unit: str) -> str:
    """A value with its unit, a dash where it is unknown."""
    return "–" if value is None else quantity(value, unit)


def _drift(axis: dict[str, Any], duration_s: float) -> str:
    """The drift of an axis per hour with its interval, a dash where it is not given."""
    value, low, high = (axis[f"drift_{name}arcsec_per_h"] for name in ("", "low_", "high_"))
    if low is None or high is None or not is_drift_given(low, high, duration_s):
        return "–"
    return f"{_angle(value)} [{_angle(low)}, {_angle(high)}]"


def _angle(arcsec: float | None, decimals: int = 2) -> str:
    """An angle in arcsec without its unit, with it in degrees from one degree on."""
    if arcsec is None or abs(arcsec) < _ARCSEC_PER_DEG:
        return _number(arcsec, decimals)
    return f"{arcsec / _ARCSEC_PER_DEG:.3f}°"


def _figure(value: float | None) -> str:
    """A value of an item that may be a count: four decimals at most, and no zeros at their end."""
    text = _number(value, 4)
    return text.rstrip("0").rstrip(".") if "." in text else text


def _given(value: Any) -> str:
    """What somebody stated, or that nobody did."""
    return "missing" if value in (None, "", []) else str(value)


# Whether a report.html belongs to a session, and was changed since.
#
# The report is made again from the session, with the provenance that the page states, and compared byte for byte.
# Nothing vouches for the provenance itself: it is of the host that made the report.

MAX_PAGE_BYTES = 50_000_000
"""A report takes 2 MB; anything bigger is another file."""


class Answer(Enum):
    """What a verification found."""

    UNCHANGED = "belongs to this session and is unchanged"
    CHANGED = "belongs to this session but was changed"
    ANOTHER_SESSION = "is of another session"
    ANOTHER_VERSION = "belongs to this session but is of another version of gse"
    NO_REPORT = "is not a report of gse"


@dataclass(frozen=True, slots=True)
class Verification:
    """An answer, and in a line what it follows from."""

    answer: Answer
    detail: str


def read_page(path: Path) -> str:
    """The text of a page as it is, line ends too; UsageError where it cannot be read."""
    try:
        with open(path, "rb", opener=only_a_file) as file:
            content = file.read(MAX_PAGE_BYTES + 1)
    except OSError as error:
        raise UsageError(f"cannot read {path}: {error.strerror}") from error
    if len(content) > MAX_PAGE_BYTES:
        raise UsageError(f"{path} is larger than {MAX_PAGE_BYTES} bytes: this is not a report")
    return content.decode("utf-8", "surrogateescape")


def verify(page: str, session: SessionData, assessment: Assessment) -> Verification:
    """Compare a page with the report of a session that was judged with the same options."""
    stated = fingerprint_in(page)
    if stated is None:
        return Verification(Answer.NO_REPORT, "its head holds no fingerprint, or a changed one")
    report = summarise(session, assessment)
    found = fingerprint(report)
    if stated["raw_sha256"] != found["raw_sha256"]:
        return Verification(Answer.ANOTHER_SESSION, _differ("received bytes", stated, found, "raw_sha256"))
    if stated["version"] != found["version"]:
        line = f"made by gse {stated['version']}, this is {found['version']}: verify it with that version"
        return Verification(Answer.ANOTHER_VERSION, line)
    shown = {"plots": NO_PLOTS not in page, "paper": PAPER in page}
    again = report_html(session, assessment, report, provenance_in(page), **shown)
    return compare_pages(page, again, stated, found)


def compare_pages(page: str, again: str, stated: dict[str, Any], found: dict[str, Any]) -> Verification:
    """Compare a page with the one that was made again; ``stated`` and ``found`` are their fingerprints."""
    if page == again:
        line = f"SHA-256 of report.json {found['report_sha256']}; its section Provenance cannot be verified"
        return Verification(Answer.UNCHANGED, line)
    return Verification(Answer.CHANGED, _what_changed(page, again, stated, found))


def _what_changed(page: str, again: str, stated: dict[str, Any], found: dict[str, Any]) -> str:
    if stated["station_sha256"] != found["station_sha256"]:
        return _differ("station file", stated, found, "station_sha256") + "; --station gives another one"
    if stated["report_sha256"] != found["report_sha256"]:
        return (
            _differ("report.json", stated, found, "report_sha256")
            + "; options of the report (--station, --clock-error, --leave-out, --earth-orientation) are needed here too"
        )
    lines, expected = page.split("\n"), again.split("\n")
    pairs = zip([*lines, ""], [*expected, ""], strict=False)
    number, (line, other) = next((place, pair) for place, pair in enumerate(pairs, 1) if pair[0] != pair[1])
    column = next((place for place, (a, b) in enumerate(zip(line, other, strict=False)) if a != b), 0)
    shown = slice(max(column - 20, 0), column + 40)
    return f"line {number}: expected {other[shown]!r}, found {line[shown]!r}"


def _differ(what: str, stated: dict[str, Any], found: dict[str, Any], key: str) -> str:
    return f"SHA-256 of the {what}: {str(stated[key])[:16]}... in the report, {str(found[key])[:16]}... in the session"
