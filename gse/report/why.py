"""One page on a session, and the bundle for a maintainer: what happened, when, why, and what to do next."""

import json
import re
import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import yaml

from drivers.chunk import LinkEvent
from drivers.host_files import new_file
from gse.config.choice import with_values
from gse.config.station import parse_recorded
from gse.report.conclusion import conclusion_lines, folded, next_steps
from gse.report.terminal import further_lines
from gse.station.events import StationKind
from gse.station.results import Subject
from gse.station.session_data import SessionData
from gse.values import instant
from gse.values.instant import NS_PER_S, to_text
from protocols.yaml_text import load_document

WIDTH = 80
_MOST_EVENTS = 12
_MOST_REASONS = 8
_QUIET = {"OPENED", "SYNCING", "STREAMING", "CLOSED"}
"""The ordinary course of a session."""


def why_page(report: dict[str, Any], events: Sequence[LinkEvent], session: str) -> str:
    """The page, from a report (as ``summarise`` gives it) and the events; ``session`` stands in the commands."""
    return "\n".join(
        [
            *_head(report, session),
            "",
            "What happened",
            *_events(events),
            "",
            "Also",
            *_why(report, session),
            "",
            "What next",
            *_next(report, session),
        ]
    )


def _head(report: dict[str, Any], session: str) -> Iterator[str]:
    """The conclusion, whole, and what came."""
    for line in conclusion_lines(report["conclusion"] | {"next": ""}, session):
        yield from _item(line, "")
    found = report["identification"]
    identified = found["statuses"].get("IDENTIFIED", 0)
    what = "answers of its own, no panoramas" if list(found["subjects"]) == [Subject.SENSOR] else "panoramas"
    counted = sum(found["statuses"].values())
    left_out, lost = found["frames"] - counted, found["frames_expected"] - counted
    share = f"{left_out} left out, {identified} of the other {counted}" if left_out else f"{identified}"
    shared = f"{share} identified" if counted or not left_out else "all left out"
    yield f"{found['frames']} {what}, {shared}, {lost} lost"


def _events(events: Sequence[LinkEvent]) -> Iterator[str]:
    """The first of each kind, with how many more there were and when the last was."""
    firsts: dict[str, LinkEvent] = {}
    lasts: dict[str, LinkEvent] = {}
    counts: dict[str, int] = {}
    for event in events:
        firsts.setdefault(event.kind, event)
        lasts[event.kind] = event
        counts[event.kind] = counts.get(event.kind, 0) + 1
    told = [event for event in firsts.values() if event.kind not in _QUIET][:_MOST_EVENTS]
    for event in told:
        last = _clock(lasts[event.kind])
        more = f" ({counts[event.kind] - 1} more, the last at {last})" if counts[event.kind] > 1 else ""
        yield from _item(f"{_clock(event)} {event.kind}: {event.text}{more}")
    if not told:
        yield "  nothing out of the ordinary on the link, the clock and the sky"


def _clock(event: LinkEvent) -> str:
    return instant.to_text(event.utc_ns, 0)[11:]


def _why(report: dict[str, Any], session: str) -> Iterator[str]:
    """The other reasons and findings, and what was left out; nothing is said twice."""
    left_out = [f"left out from {item['from'][11:19]}Z on: {item['reason']}" for item in report["exclusions"]]
    lines = [*_shortened(further_lines(report)), *_shortened(left_out)]
    for line in lines or ["nothing more"]:
        yield from _item(line.replace("SESSION", session))


def _shortened(lines: list[str]) -> list[str]:
    more = len(lines) - _MOST_REASONS
    return [*lines[:_MOST_REASONS], f"and {more} more: see the report"] if more > 0 else lines


def _next(report: dict[str, Any], session: str) -> Iterator[str]:
    if report["verdict"] == "PASS":
        yield from _item(f"nothing more; the report is made by: gse report {session}")
    for step in next_steps(report):
        yield from _item(step.replace("SESSION", session))
    if report["verdict"] != "PASS":
        yield from _item(
            f"what each message means: docs/troubleshooting.md; for a maintainer: gse why {session} --bundle FILE"
        )


def _item(text: str, indent: str = "  ") -> list[str]:
    return folded(text, WIDTH, head=indent, below=indent + "  ")


# A bundle for a maintainer: what is needed to find a fault, without the place of the mount unless it is asked for.
#
# Star directions with their times tell where a mount stands, so that recorded bytes and answers stay out with the
# place.

BLUR_DEG = 1.0
"""Some hundred kilometres: the sky is nearly the same, the address is not to be found."""

_COORDINATE = re.compile(r"(latitude_deg|longitude_deg)(: | is )-?\d+(\.\d+)?")
_STATED = re.compile(r"(stated is )-?\d+(\.\d+)?")
_OF_THE_SUN = {StationKind.DAYLIGHT, StationKind.DARK_NIGHT}
_HOUR_NS = 3600 * NS_PER_S
_EPOCH = (1980, 1, 1, 0, 0, 0)


def write_bundle(
    path: Path, session: SessionData, report: dict[str, Any], name: str, *, recording: Path | None = None
) -> None:
    """Write a new zip file. With ``recording`` everything goes in as it is; without it the place is blurred.

    ``name`` of the session stands in the commands of the page. FileExistsError where there is a file.
    """
    plain = recording is not None
    events = session.events if plain else [blurred_event(event) for event in session.events]
    page = why_page(report, events, name)
    text = session.station_text if plain else blurred_station(session.station_text)
    parts = {
        "why.txt": page if plain else blurred_text(page),
        "report.json": json.dumps(report if plain else blurred_report(report), indent=1),
        "station.yaml": text,
        "events.txt": "\n".join(f"{to_text(event.utc_ns, 3)} {event.kind}: {event.text}" for event in events),
        "versions.json": json.dumps(session.versions, indent=1),
        "README.txt": _READ_ME[plain],
    }
    with new_file(path) as file, zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as bundle:
        for name, content in parts.items():
            bundle.writestr(zipfile.ZipInfo(name, _EPOCH), content, zipfile.ZIP_DEFLATED)
        if recording is not None:
            bundle.write(recording, "session.mcap")


_READ_ME = {
    True: "A session of a star sensor, with the place of its mount.\n",
    False: "A session of a star sensor. The place of its mount is blurred to a degree, and the recording is left out, "
    "since stars and times tell the place. gse why SESSION --bundle FILE --with-site adds both.\n",
}


def blurred_station(text: str) -> str:
    """A station file with the coordinates rounded to BLUR_DEG, and without names of place and people."""
    station = parse_recorded(text)
    rounded = {name: _round(getattr(station.site, name)) for name in ("latitude_deg", "longitude_deg")}
    kept = with_values(text, "site", {**rounded, "name": "blurred"}, drop=("uncertainty",), recorded=True)
    document = load_document(kept, base_60=bool(station.refusal))[1]
    document.pop("test", None)
    return str(yaml.safe_dump(document, sort_keys=False))


def blurred_report(report: dict[str, Any]) -> dict[str, Any]:
    """The same of a report: its site, coordinates in its lines, and how high Sun and Moon stand."""
    copy: dict[str, Any] = json.loads(blurred_text(json.dumps(report)))
    if site := copy["session"]["site"]:
        places = {name: _round(site[name]) for name in ("latitude_deg", "longitude_deg")}
        copy["session"]["site"] = {**site, "name": "blurred", **places}
    sky = copy["sky"]
    for name in [name for name in sky or {} if name.endswith("_deg") and sky[name] is not None]:
        sky[name] = [None if angle is None else _round(angle) for angle in sky[name]]
    for stretch in sky["stretches"] if sky else []:
        stretch |= {name: f"{stretch[name][:13]}:00:00Z" for name in ("from", "until")}
    copy.pop("test", None)
    return copy


def blurred_event(event: LinkEvent) -> LinkEvent:
    """The hour of a dawn or dusk: its instant is a line on the Earth."""
    return replace(event, utc_ns=event.utc_ns // _HOUR_NS * _HOUR_NS) if event.kind in _OF_THE_SUN else event


def blurred_text(text: str) -> str:
    """Coordinates in lines of text become whole degrees."""
    text = _COORDINATE.sub(lambda found: f"{found[1]}{found[2]}{_rounded_in(found[0])}", text)
    return _STATED.sub(lambda found: f"{found[1]}{_rounded_in(found[0])}", text)


def _rounded_in(words: str) -> str:
    number = re.search(r"-?\d+(\.\d+)?$", words)
    return f"{_round(float(number[0])):g}" if number else ""


def _round(degrees: float) -> float:
    return round(degrees / BLUR_DEG) * BLUR_DEG
