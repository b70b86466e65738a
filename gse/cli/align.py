"""``gse align``: the mount's direction from a session."""

import dataclasses
import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from gse.cli import EXIT_FAIL, damage_code, write_new
from gse.cli.options import fit_options, say
from gse.config.choice import change_to, with_values
from gse.errors import UsageError
from gse.process.terminal import working
from gse.station.mount_alignment import CrossValidation, MeasuredMounts, cross_validated
from gse.station.results import attitude_error
from gse.statistics.uncertainty import TO_STANDARD
from gse.truth import Alignment, horizon_to_sensor
from gse.values.attitude import Attitude
from gse.values.mount import Mount
from gse.values.screen import Screen, ShownSky

if TYPE_CHECKING:
    from gse.imaging.screen_fit import ScreenFit
    from gse.sessions.replay import Recording

_NEAR_ZENITH_DEG = 89.9
MIRRORED = (
    "the sensor sees the screen mirrored: switch the mirroring of the monitor off; where a mirror stands in the way, "
    "or the sensor's own picture is mirrored, state sensor.mirrored"
)


@click.command("align")
@fit_options(write_help="Write the station file with this mount to a new file.", schema="gse.alignment/1")
@click.option(
    "--accept-gross",
    is_flag=True,
    help="Write a mount that is far from the stated angles, though a mistake of site or clock would look the same.",
)
@click.pass_context
def command(
    ctx: click.Context,
    *,
    path: Path,
    station_path: Path | None,
    from_utc: str | None,
    to_utc: str | None,
    start_utc: str | None,
    write_path: Path | None,
    as_json: bool,
    accept_gross: bool,
) -> None:
    """Fit azimuth, altitude and roll of the mount to the identified frames of the session FILE.

    The result has the covariance of the fit; --write states it as the mount's uncertainty, `from: align`: a fit vouches
    for no angle, as a wrong clock or site is in it. For a check, the even minutes are compared with the fit to the odd
    ones, and the odd minutes with the fit to the even ones. Do not judge a session with a mount that was fitted to its
    own frames: use --write for the next session, or `align: first 60 s` in the station file.

    A fit takes up a wrong sign of the latitude, a clock at local time or an azimuth from south, and hides it. So the
    angles that the station file states are compared with the fit: where a mistake of degrees explains the difference it
    is named, nothing is written without --accept-gross, and the exit code is 1.

    Before a screen, the screen is fitted instead: how the sensor looks at it, its focal length or distance, distortion,
    gamma and latency, each with its uncertainty; --write states them. The camera of the sensor is taken as it is
    stated. FILE is a session of 'gse run --scene screen-fit'.
    """
    from drivers.playback import is_session
    from gse.cli.progress import replay_with_progress
    from gse.diagnosis.gross_causes import gross_finding
    from gse.sessions.replay import ReplayOptions, open_recording
    from gse.statistics.counted_frames import counted_frames

    options, change = ReplayOptions(from_utc=from_utc, to_utc=to_utc, start_utc=start_utc), change_to(station_path)
    if is_session(path) and (recording := open_recording(path, options, change)).station.screen is not None:
        # The page drew for the session's own screen, whatever --station says of it now.
        drawn_for = open_recording(path, options).station.screen
        _fit_screen(recording, drawn_for or recording.station.screen, write_path, as_json=as_json)
        ctx.exit(damage_code(path, damaged=recording.damaged))
    measured = MeasuredMounts()
    replay = replay_with_progress(path, lambda loop: [measured], options, change)
    validation = cross_validated(measured, replay.session)
    gross = gross_finding(replay.session, counted_frames(replay.session))
    refused = gross is not None and not accept_gross
    if write_path is not None and not refused:
        mount = validation.alignment.mount
        values: dict[str, object] = {
            name: round(getattr(mount, name), 6) for name in ("azimuth_deg", "altitude_deg", "roll_deg")
        }
        values |= _uncertainty(validation.alignment)
        write_new(write_path, with_values(replay.session.station_text, "mount", values, drop=("align", "uncertainty")))
    report = alignment_report(validation, replay.session.station.mount)
    report["gross"] = None if gross is None else dataclasses.asdict(gross)
    click.echo(json.dumps(report) if as_json else "\n".join(_lines(report)))
    lost = damage_code(path, damaged=replay.session.truncated)
    if gross is not None:
        written = "nothing is written: " if refused and write_path is not None else ""
        click.echo(f"{written}the fit hides a gross difference from the stated set-up: {gross}", err=True)
    ctx.exit(lost or (EXIT_FAIL if refused else 0))


def _fit_screen(recording: "Recording", drawn_for: Screen | None, write_path: Path | None, *, as_json: bool) -> None:
    from gse.imaging.screen_fit import fit_screen, seen_stars
    from gse.imaging.session_fit import PanoramaSample, identified
    from gse.station.setup import set_up

    station, sample = recording.station, PanoramaSample()
    assert drawn_for is not None
    with working("fitting the screen"):
        for panorama in recording.panoramas():
            sample.add(panorama)
        if not sample.panoramas or not recording.shown:
            raise UsageError("the session holds nothing that a screen showed; record one: gse run --scene screen-fit")
        setup = set_up(
            station,
            recording.station_text,
            utc_ns=sample.panoramas[0].utc_ns,
            protocol=recording.protocol,
            tell=say,
        )
        named, camera = identified(sample, setup.camera, setup.of_true_stars)
        if camera.mirrored != setup.camera.mirrored:
            raise UsageError(MIRRORED)
        catalog, sky = setup.of_true_stars.catalog, ShownSky(list(recording.shown))
        seen = seen_stars(named, catalog.icrs, catalog.magnitude, sky)
        fit = fit_screen(seen, sky, drawn_for, setup.camera, station.sensor.index_max)
    values = _screen_values(fit.screen)
    if write_path is not None:
        write_new(write_path, with_values(recording.station_text, "screen", values))
    report = {"schema": "gse.screen-fit/1", **values, "stars": fit.stars, "rms_px": round(fit.rms_px, 4),
              "held": list(fit.held)}  # fmt: skip
    click.echo(json.dumps(report) if as_json else "\n".join(_screen_lines(fit, drawn_for)))


def _screen_values(screen: Screen) -> dict[str, Any]:
    """What a fit gives, as the station file states it."""
    away = "focal_length_mm" if screen.focal_length_mm is not None else "distance_mm"
    names = (away, "radial_distortion", "gamma", "latency_ms", "latency_uncertainty_ms", "to_sensor", "uncertainty")
    stated = dataclasses.asdict(screen)
    return {name: list(stated[name]) if isinstance(stated[name], tuple) else stated[name] for name in names}


def _screen_lines(fit: "ScreenFit", stated: Screen) -> list[str]:
    """The fitted screen beside the stated one, for a person."""
    screen, known = fit.screen, fit.screen.uncertainty
    away, was = screen.focal_length_mm or screen.distance_mm, stated.focal_length_mm or stated.distance_mm
    looks, looked = screen.to_sensor, stated.to_sensor
    across_deg, roll_deg = looks.uncertainty.across_arcsec / 3600, looks.uncertainty.roll_arcsec / 3600
    rows = (
        ("to_sensor.x_deg", looks.x_deg, across_deg, looked.x_deg),
        ("to_sensor.y_deg", looks.y_deg, across_deg, looked.y_deg),
        ("to_sensor.roll_deg", looks.roll_deg, roll_deg, looked.roll_deg),
        ("focal_length_mm" if screen.focal_length_mm else "distance_mm", away, known.away_mm, was),
        ("radial_distortion k1", screen.radial_distortion[0], known.radial_distortion[0], stated.radial_distortion[0]),
        ("radial_distortion k2", screen.radial_distortion[1], known.radial_distortion[1], stated.radial_distortion[1]),
        ("gamma", screen.gamma, known.gamma, stated.gamma),
        ("latency_ms", screen.latency_ms, screen.latency_uncertainty_ms, stated.latency_ms),
    )
    held = [f"as stated, since the stars do not show it: {', '.join(fit.held)}"] if fit.held else []
    return [
        f"{'screen':22}{'fitted':>12}   {'+- (95 %)':>10}{'stated':>12}",
        *(f"{name:22}{value:12.5f} +-{width:11.5f}{before:12.5f}" for name, value, width, before in rows),
        f"{fit.stars} stars; {fit.rms_px:.3f} px of the sensor are left, rms",
        *held,
    ]


def _uncertainty(fit: Alignment) -> dict[str, object]:
    """The uncertainty of the fit as the station file states it; nothing where so few frames do not tell it.

    Near the zenith azimuth and roll are known in combination, so that neither alone is as wrong as it seems.
    """
    most = max(fit.sigma_arcsec)
    if not math.isfinite(most):
        return {}
    half_widths = (min(sigma, most) / TO_STANDARD for sigma in fit.sigma_azimuth_altitude_roll_arcsec)
    names = ("azimuth_arcsec", "altitude_arcsec", "roll_arcsec")
    return {"uncertainty": {**{name: round(max(x, 0.01), 2) for name, x in zip(names, half_widths, strict=True)},
                            "from": "align"}}  # fmt: skip


def alignment_report(validation: CrossValidation, stated: Mount) -> dict[str, Any]:
    """The JSON of schema gse.alignment/1; ``stated`` is the mount of the station file."""
    fit = validation.alignment
    true, measured = (Attitude(horizon_to_sensor(mount), np.zeros((3, 3))) for mount in (stated, fit.mount))
    from_stated = attitude_error(measured, true)
    sigma = fit.sigma_azimuth_altitude_roll_arcsec
    return {
        "schema": "gse.alignment/1",
        "azimuth_deg": round(fit.mount.azimuth_deg, 6),
        "altitude_deg": round(fit.mount.altitude_deg, 6),
        "roll_deg": round(fit.mount.roll_deg, 6),
        "sigma_arcsec": dict(zip(("azimuth", "altitude", "roll"), _rounded(sigma), strict=True)),
        "sigma_sensor_arcsec": _axes(fit.sigma_arcsec[1::-1] + fit.sigma_arcsec[2:]),
        "covariance_arcsec2": [_rounded(row, 6) for row in fit.covariance_arcsec2],
        "scatter_arcsec": _axes(fit.scatter_arcsec[1::-1] + fit.scatter_arcsec[2:]),
        "frames": fit.n,
        "rejected": fit.rejected,
        "repeatability_arcsec": _axes(validation.repeatability_arcsec),
        "mean_abs_on_other_half_arcsec": _axes(validation.mean_abs_arcsec),
        "rms_on_other_half_arcsec": _axes(validation.rms_arcsec),
        "from_stated_mount_arcsec": _axes(
            (from_stated.cross_x_arcsec, from_stated.cross_y_arcsec, from_stated.d_roll_arcsec)
        ),
    }


def _axes(values: tuple[float, ...]) -> dict[str, float | None]:
    return dict(zip(("columns", "rows", "roll"), _rounded(values), strict=True))


def _rounded(values: tuple[float, ...], digits: int = 3) -> list[float | None]:
    return [round(value, digits) if math.isfinite(value) else None for value in values]


def _lines(report: dict[str, Any]) -> list[str]:
    """The report for a person."""
    sigma = report["sigma_arcsec"]
    rows = (
        ("scatter of one frame (1 sigma)", "scatter_arcsec"),
        ("fit (1 sigma)", "sigma_sensor_arcsec"),
        ("even against odd minutes", "repeatability_arcsec"),
        ("mean error on the other minutes", "mean_abs_on_other_half_arcsec"),
        ("from the mount in the station file", "from_stated_mount_arcsec"),
    )
    zenith = report["altitude_deg"] > _NEAR_ZENITH_DEG
    note = ["near the zenith azimuth and roll are known only in combination, not each alone"] if zenith else []
    return [
        *(f"{name:9}{report[f'{name}_deg']:12.5f} deg  +- {_text(sigma[name])} arcsec" for name in sigma),
        *note,
        f"{report['frames']} frames, {report['rejected']} rejected",
        "",
        f"{'arcsec along':36}{'columns':>10}{'rows':>10}{'roll':>10}",
        *(f"{title:36}" + "".join(f"{_text(report[key][axis]):>10}" for axis in report[key]) for title, key in rows),
    ]


def _text(value: float | None) -> str:
    return "unknown" if value is None else f"{value:.2f}"
