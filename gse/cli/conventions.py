"""``gse conventions``: the convention of a sensor's own answers, found from a minute of sky."""

import dataclasses
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gse.cli import EXIT_FAIL, damage_code
from gse.cli.options import say, start_utc_option
from gse.config.choice import change_to
from gse.errors import UsageError
from gse.process.terminal import working
from gse.values.attitude_convention import AttitudeConvention
from gse.values.instant import NS_PER_S

if TYPE_CHECKING:
    from gse.station.session_data import SessionData
    from gse.statistics.sensor_convention import ConventionSearch


@click.command("conventions")
@click.argument("path", metavar="SESSION", type=click.Path(path_type=Path))
@click.option(
    "--seconds",
    type=click.FloatRange(min=5, max=600),
    default=60.0,
    show_default=True,
    help="Length of the stretch, from the first answer on.",
)
@click.option("--station", "station_path", type=click.Path(path_type=Path), help="Station file instead of its own.")
@start_utc_option
@click.option("--json", "as_json", is_flag=True, help="One JSON object, schema gse.conventions/1.")
@click.pass_context
def command(
    ctx: click.Context,
    *,
    path: Path,
    seconds: float,
    station_path: Path | None,
    start_utc: str | None,
    as_json: bool,
) -> None:
    """Name the convention of the sensor's own answers (ATTITUDE frames) in a SESSION.

    All discrete conventions are tried: the order and direction of a quaternion, its axes, RA and DE of date, of B1950,
    of J2000 or ICRS, hours or degrees, the sense of the roll, aberration corrected or not. The exit code is 0 if the
    station file states one that fits, 1 if it does not or if none fits.
    """
    from gse.statistics.sensor_convention import evidence_of, fit_rotation, is_wrong, session_convention

    with working("comparing the sensor's answers"):
        session = _session(path, station_path, start_utc, seconds)
        search = session_convention(session, seconds)
        evidence = evidence_of(session, seconds) if search is not None and not search.fits else None
        turned = fit_rotation(evidence) if evidence is not None else None
    if search is None and session.station.subject is not None:
        raise UsageError(
            f"{path} has no truth (subject: sensor), by which alone a convention is found; a session before a known "
            "sky shows it: give its station file with site and mount by --station"
        )
    if search is None:
        raise UsageError(
            f"{path} has {len(session.sensor_attitudes)} answers of the sensor in {seconds:g} s that can be compared; "
            "expected at least 10 ATTITUDE frames beside identified panoramas, or a stated mount"
        )
    stated = session.station.sensor.attitude
    document = {**_document(search, stated), "rotation": None if turned is None else dataclasses.asdict(turned)}
    click.echo(json.dumps(document) if as_json else "\n".join([*_lines(search, stated), *_of_rotation(turned)]))
    lost = damage_code(path, damaged=session.truncated)
    ctx.exit(lost or (EXIT_FAIL if not search.fits or is_wrong(search, stated) else 0))


def _session(path: Path, station_path: Path | None, start_utc: str | None, seconds: float) -> "SessionData":
    """The session up to the end of the stretch."""
    from gse.sessions.replay import ReplayOptions, replay_session
    from gse.station.frame_results import FrameResults

    begun: list[int] = []

    def stop() -> bool:
        return len(begun) > 1 and begun[1] - begun[0] > (seconds + 1) * NS_PER_S

    def each(results: list[FrameResults]) -> None:
        if results:
            begun[:] = [
                begun[0] if begun else int(results[0].panoramas.utc_ns[0]),
                int(results[-1].panoramas.utc_ns[-1]),
            ]

    options, station = ReplayOptions(start_utc=start_utc), change_to(station_path, None)
    return replay_session(path, options=options, station=station, stop=stop, each=each, tell=say).session


def _document(search: "ConventionSearch", stated: AttitudeConvention) -> dict[str, Any]:
    from gse.statistics.sensor_convention import is_wrong, with_aberration

    named = with_aberration(search)
    return {
        "schema": "gse.conventions/1",
        "answers": search.answers,
        "duration_s": round(search.duration_s, 1),
        "kind": "quaternion" if search.quaternions else "angles",
        "named": None if named is None else dataclasses.asdict(named),
        "aberration": search.aberration,
        "aberration_arcsec": round(search.aberration_arcsec, 2),
        "fits": [
            {"size_arcsec": round(fit.size_arcsec, 2), **dataclasses.asdict(fit.convention)} for fit in search.fits
        ],
        "nearest_arcsec": round(search.nearest.size_arcsec, 2),
        "not_told_apart": list(_not_told_apart(search)),
        "stated": dataclasses.asdict(stated),
        "stated_fits": bool(search.fits) and not is_wrong(search, stated),
    }


def _lines(search: "ConventionSearch", stated: AttitudeConvention) -> list[str]:
    """The result for a person."""
    from gse.statistics.sensor_convention import in_words, is_wrong, to_state, with_aberration

    kind = "quaternions" if search.quaternions else "angles"
    head = f"{search.answers} answers over {search.duration_s:.0f} s, {kind}"
    if not search.fits:
        nearest = f"{in_words(search.nearest.convention, search)}, which is off by {_angle(search.nearest.size_arcsec)}"
        return [head, "NONE of the conventions fits", f"nearest: {nearest}"]
    lines = [head]
    if len(search.fits) > 1:
        lines.append(f"{len(search.fits)} conventions fit, and cannot be told apart by this stretch of sky:")
    lines += [f"fits: {in_words(fit.convention, search)} (leaves {_angle(fit.size_arcsec)})" for fit in search.fits]
    lines.append(f"aberration: {search.aberration}")
    lines += [f"cannot be told apart: {text}" for text in _not_told_apart(search)]
    named = with_aberration(search)
    if is_wrong(search, stated):
        lines.append("the station file states ANOTHER convention")
    elif search.aberration not in ("not told", stated.aberration):
        lines.append(f"the station file states this convention, but aberration {stated.aberration}")
    else:
        lines.append("the station file states this convention")
    if named is not None and named != dataclasses.replace(stated, rotation=None):
        lines.append(f"station file: {to_state(search)}")
    return lines


def _of_rotation(turned: AttitudeConvention | None) -> list[str]:
    """The rotation that makes the answers fit, and what to state."""
    from gse.statistics.sensor_convention import rotation_as_yaml

    if turned is None or turned.rotation is None:
        return []
    known = f"+-{turned.rotation.uncertainty_arcsec:g} arcsec about each axis (95 %)"
    return [
        f"fits with one rotation, known to {known}: the answers are of another body's frame, in ICRS or J2000",
        "a session judged with a fitted rotation is relative; the maker's alignment sheet says more",
        f"station file: {rotation_as_yaml(turned)}",
    ]


def _not_told_apart(search: "ConventionSearch") -> list[str]:
    if not search.fits:
        return []
    found = ["ICRS and J2000, which lie 0.02 arcsec apart"] if search.fits[0].convention.frame == "ICRS" else []
    apart = f"a body frame turned by {search.aberration_arcsec:.1f} arcsec"
    if search.aberration == "not told":
        return [*found, f"aberration corrected, aberration not corrected, and {apart}"]
    other = "not corrected" if search.aberration == "corrected" else "corrected"
    return [*found, f"aberration {search.aberration}, and aberration {other} with {apart}"]


def _angle(arcsec: float) -> str:
    return f"{arcsec:.1f} arcsec" if arcsec < 3600 else f"{arcsec / 3600:.2f} deg"
