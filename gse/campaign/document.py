"""The report of a campaign as one JSON object, schema gse.campaign-report/1; the page is made from it."""

import math
import re
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import numpy as np

from gse.campaign.conditions import conditions
from gse.campaign.dataset import OWN_STATION, UNKNOWN, DataSet
from gse.campaign.decision import CampaignRow, campaign_rows, reasons_of, verdict_of
from gse.campaign.hot_pixels import COLUMN, hot_pixels
from gse.campaign.nights import Session, by_night, nightly, sessions_of, with_answers
from gse.campaign.sensor_atlas import SensorAtlas, sensor_atlas
from gse.campaign.star_places import SIGMAS
from gse.campaign.trends import thermal, trends
from gse.report.provenance import software_sha256
from gse.report.summary import LIMIT_DEG, PAPER, PaperRow, table_row
from gse.station.results import Subject, Verdict
from gse.statistics.decision import DECISION_TEXT, Outcome
from gse.values.limits import Decision
from gse.values.text import count_text
from gse.verdict.requirements import HOST_TIME, STATED_TIME

SCHEMA = "gse.campaign-report/1"
MOST_STARS = 20
DIGITS = 8
_TIMES = (STATED_TIME.name, HOST_TIME.name)
_WORST_FIRST = (Verdict.FAIL, Verdict.INCONCLUSIVE, Verdict.PASS)


def campaign_document(
    dataset: DataSet, *, station_sha256: str = OWN_STATION, each: Callable[[], None] = lambda: None
) -> dict[str, Any]:
    """The report of a data set; the same data set gives the same one."""
    sessions = sessions_of(dataset, station_sha256, software_sha256())
    names = sorted({str(one.row["sensor"]) for one in sessions} - {UNKNOWN})
    sensors = [_sensor(dataset, name, [one for one in sessions if one.row["sensor"] == name], each) for name in names]
    verdicts = _deciding(sensors)
    left_out = [one for one in sessions if one.left_out]
    report = {
        "schema": SCHEMA,
        "verdict": next((word for word in _WORST_FIRST if word in verdicts), Verdict.INCONCLUSIVE),
        "decision": DECISION_TEXT[Decision.GUARDED],
        "software_sha256": sessions[0].row["software_sha256"],
        "station_sha256": station_sha256,
        "sessions": len(sessions),
        "requirements": _requirements(sensors),
        "sensors": sensors,
        "left_out": [
            {"sensor": one.row["sensor"], "night": one.night, "source": one.row["source"], "why": one.left_out}
            for one in left_out
        ],
        "table_4_1": {
            "rows": [row for sensor in sensors for row in sensor["table_4_1"]]
            + [{**table_row(row), "own": False} for row in PAPER],
            "limit_deg": LIMIT_DEG,
        },
    }
    plain: dict[str, Any] = _plain(report)
    return plain


def _deciding(sensors: list[dict[str, Any]]) -> list[Verdict]:
    """The verdicts that make that of the campaign: each FAIL, and those of sensors with nights to compare.

    A session of another sensor, or one of which no night counts, is listed and turns nothing.
    """
    several = [sensor for sensor in sensors if sensor["nights"] > 1] or sensors
    failed = [sensor["verdict"] for sensor in sensors if sensor["verdict"] == Verdict.FAIL]
    return [*failed, *(sensor["verdict"] for sensor in several)]


def _requirements(sensors: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """A row for each requirement with a cell for each sensor, null where that has no such row."""
    names = dict.fromkeys((row["subject"], row["name"]) for sensor in sensors for row in sensor["rows"])
    return [
        {"subject": subject, "name": name, "cells": [_cell(one, subject, name) for one in sensors]}
        for subject, name in names
    ]


def _cell(sensor: dict[str, Any], subject: str, name: str) -> dict[str, Any] | None:
    for row in sensor["rows"]:
        if (row["subject"], row["name"]) == (subject, name):
            keys = ("name", "value", "uncertainty", "limit", "unit", "outcome", "nights")
            return {key: row[key] for key in keys} | {"of_nights": sensor["nights"] + sensor["nights_not_used"]}
    return None


def _unused(sessions: list[Session]) -> dict[str, int]:
    """How many sessions are left out, by what they have in common: their reasons without numbers and details."""
    heads = (re.sub(r"\d+", "N", one.left_out.partition(":")[0]) for one in sessions if one.left_out)
    return dict(Counter(heads).most_common())


def _sensor(dataset: DataSet, name: str, sessions: list[Session], each: Callable[[], None]) -> dict[str, Any]:
    nights = by_night(sessions)
    counted = [one for of_night in nights.values() for one in of_night]
    rows = campaign_rows(nights)
    subjects = list(dict.fromkeys(row.subject for row in rows))
    subject = Subject(subjects[0]) if subjects else Subject.ONBOARD
    atlas = sensor_atlas(dataset, counted, each)
    answering = by_night(sessions, too_short=True)
    return {
        "name": name,
        "serials": sorted({str(one.row["sensor_serial"]) for one in sessions if one.row["sensor_serial"]}),
        "sites": sorted({str(one.row["site_name"]) for one in counted if one.row["site_name"]}),
        "verdict": verdict_of(rows),
        "relative": any(one.row["relative"] for one in counted),
        "simulated": any(one.row["simulated"] for one in counted),
        "reasons": reasons_of(rows),
        "not_tested": [row.reason for row in rows if row.outcome is Outcome.NOT_TESTED],
        "nights": len(nights),
        "first_night": min(nights, default=None),
        "last_night": max(nights, default=None),
        "nights_not_used": len({one.night for one in sessions} - set(nights)),
        "unused": _unused(sessions),
        "sessions": len(counted),
        "damaged": [one.row["source"] for one in counted if one.row["truncated"]],
        "hours": sum(float(one.row["duration_s"] or 0) for one in counted) / 3600,
        "frames": sum(int(one.row["frames"] or 0) for one in counted),
        "rows": [asdict(row) for row in rows],
        "trends_subject": subject.value,
        "nights_with_answers": len(answering),
        "trends": [
            {**asdict(one), "significant": one.significant}
            for one in trends(answering, subject, atlas.scale if atlas else {})
        ],
        "thermal": [asdict(one) for one in thermal(nights, subject)],
        "conditions": [
            {**asdict(one), "holding": one.holding and {**asdict(one.holding), "text": one.holding.text()}}
            for one in conditions(dataset, with_answers(sessions), subject, rows)
        ],
        "hot_pixels": [asdict(one) for one in hot_pixels(_pixels(nights))],
        "atlas": _atlas(atlas) if atlas else None,
        "sky": _sky(sessions),
        "table_4_1": [_table_row(name, nights, of_one, rows) for of_one in subjects],
    }


def _pixels(nights: dict[str, list[Session]]) -> list[tuple[str, Any]]:
    return [
        (night, [pixel for one in sessions for pixel in one.row[COLUMN.name] or ()])
        for night, sessions in nights.items()
    ]


def _atlas(atlas: SensorAtlas) -> dict[str, Any]:
    named = [star for star in atlas.stars if star.sigmas >= SIGMAS]
    return {
        "sessions": atlas.sessions,
        "residuals": atlas.residuals,
        "stars_looked_at": len(atlas.stars),
        "phase": [{**asdict(one), "found": one.sigmas >= SIGMAS} for one in atlas.phase],
        "curves_px": atlas.curves_px.tolist(),
        "curve_errors_px": atlas.curve_errors_px.tolist(),
        "field_arcsec": atlas.field_arcsec.tolist(),
        "field_sigmas": atlas.field_sigmas.tolist(),
        "stars": [{"name": atlas.names.get(star.star, str(star.star)), **asdict(star)} for star in named[:MOST_STARS]],
        "stars_found": len(named),
        "strongest_other": next((star.sigmas for star in atlas.stars if star.sigmas < SIGMAS), None),
    }


def _sky(sessions: list[Session]) -> list[dict[str, Any]]:
    """Conditions of each session, whether it counts or not."""
    return [
        {
            "night": one.night,
            "zero_point_mag": one.row["zero_point_median_mag"],
            "temperature_c": one.row["temperature_median_c"],
            "frames": one.row["frames"],
            "excluded": _causes(one),
            "verdict": one.row["verdict"],
            "counts": not one.left_out,
        }
        for one in sessions
        if not one.row["error"]
    ]


def _causes(session: Session) -> dict[str, int]:
    """Frames that were left out, by cause."""
    causes: dict[str, int] = {}
    for item in session.row["exclusions"] or ():
        causes[item["cause"]] = causes.get(item["cause"], 0) + int(item["frames"])
    return causes


def _table_row(name: str, nights: dict[str, list[Session]], subject: str, rows: list[CampaignRow]) -> dict[str, Any]:
    means = [list(nightly(nights, f"{subject}_mean_abs_{axis}_deg").values()) for axis in ("d_ra", "d_de")]
    d_ra, d_de = (float(np.mean(values)) if values else math.nan for values in means)
    time_ms = next((row.value for row in rows if row.subject == subject and row.name in _TIMES), math.nan)
    time = f"{time_ms:.3g} ms" if math.isfinite(time_ms) else "not recorded"
    own = PaperRow(f"{name}, {subject}, {count_text(len(nights), 'night')}", d_ra, d_de, time)
    return {**table_row(own), "own": True}


def _plain(value: Any) -> Any:
    """Only what JSON knows; numbers with DIGITS digits, null where they are unknown or infinite."""
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, bool) or value is None:
        return value
    if isinstance(value, str):
        return str(value)
    if isinstance(value, int | np.integer):
        return int(value)
    number = float(value)
    return float(f"{number:.{DIGITS}g}") if math.isfinite(number) else None
