"""``gse calibrate``: the camera from a session."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gse.cli import damage_code, write_new
from gse.cli.options import fit_options, say
from gse.config.choice import change_to, station_of, with_identifier, with_values
from gse.config.station import parse_station
from gse.errors import TruthError, UsageError
from gse.imaging.camera_fit import Calibration
from gse.imaging.session_fit import PanoramaSample, SessionCalibration, calibrate_session
from gse.process.terminal import working
from gse.truth import EarthOrientation, SiderealTruth
from gse.values.panorama import Panorama
from gse.values.text import percent

if TYPE_CHECKING:
    from gse.sessions.replay import Recording

_NAMES = ("focal_length_px", "principal_point_x_px", "principal_point_y_px", "k1", "k2", "p1", "p2")
_DIGITS = (4, 4, 4, 8, 8, 8, 8)


@click.command("calibrate")
@fit_options(
    write_help="Write the station file with this camera and these hot pixels to a new file.", schema="gse.calibration/1"
)
@click.option("--tangential", is_flag=True, help="Fit tangential distortion (p1, p2) too.")
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
    tangential: bool,
) -> None:
    """Fit focal length, principal point, radial distortion and mirror to the stars of FILE: a session, a panorama
    table (.csv) or an image.

    The fit starts from the camera of the station file; its focal length may be wrong by 25 %. Aberration and refraction
    are corrected with the site and the times of the session; in the camera of a table or an image they remain. Without
    --station the camera of an image is searched for, as by `gse identify`. Use the new station file with
    `gse replay --station` or `gse run --station`.
    """
    from gse.imaging.image_file import KNOWN_SUFFIXES
    from gse.sessions.replay import ReplayOptions, open_recording

    if path.suffix.lower() in {*KNOWN_SUFFIXES, ".csv"}:
        if from_utc or to_utc or start_utc:
            raise UsageError(f"--from, --to and --start are for a session; {path} is one panorama")
        result, station_text = _of_one_panorama(path, station_path, tangential=tangential)
        _tell(result, station_text, write_path, as_json=as_json)
        return
    with working("fitting the camera"):
        options = ReplayOptions(from_utc=from_utc, to_utc=to_utc, start_utc=start_utc)
        recording = open_recording(path, options, change_to(station_path))
        result = _calibrated(recording, tangential=tangential)
    _tell(result, recording.station_text, write_path, as_json=as_json)
    ctx.exit(damage_code(path, damaged=recording.damaged))


def _tell(result: SessionCalibration, station_text: str, write_path: Path | None, *, as_json: bool) -> None:
    if write_path is not None:
        write_new(write_path, with_values(station_text, "sensor", _sensor_values(result)))
    click.echo(json.dumps(calibration_report(result)) if as_json else "\n".join(_lines(result)))


def _of_one_panorama(path: Path, station_path: Path | None, *, tangential: bool) -> tuple[SessionCalibration, str]:
    """The camera of a table or an image, and the text of the station file that it was fitted from."""
    from gse.cli.identify import found_station, seen_in, why_no_camera
    from gse.station.setup import set_up

    seen = seen_in(path)
    found = found_station(seen) if station_path is None and seen.size is not None else None
    station, text = station_of(station_path) if found is None else (parse_station(found), found)
    size = station.sensor.columns, station.sensor.rows
    if seen.size not in (None, size):
        if station_path is None:
            raise UsageError(why_no_camera(seen))
        raise UsageError(f"{path} has {seen.size} columns and rows, the station file {size}; expected the same")
    setup = set_up(*with_identifier(station, text, "robust"), tell=say)
    sample = PanoramaSample()
    sample.add(Panorama(0, seen.xy_px, seen.brightness))
    return calibrate_session(sample, setup.camera, setup.of_true_stars, None, tangential=tangential), text


def _calibrated(recording: "Recording", *, tangential: bool) -> SessionCalibration:
    from gse.station.setup import set_up

    sample = PanoramaSample()
    for panorama in recording.panoramas():
        sample.add(panorama)
    first_ns = sample.panoramas[0].utc_ns if sample.panoramas else None
    station, text = recording.station, recording.station_text
    if station.identifier.algorithm == "external":
        station, text = with_identifier(station, text, "robust")
    setup = set_up(station, text, utc_ns=first_ns, protocol=recording.protocol, tell=say)
    truth = _truth(recording, first_ns)
    return calibrate_session(sample, setup.camera, setup.of_true_stars, truth, tangential=tangential)


def _truth(recording: "Recording", utc_ns: int | None) -> SiderealTruth | None:
    """Truth for aberration and refraction; None where catalogue places are used instead.

    So they are before 1972, and before a star simulator.
    """
    if recording.station.mount.inertial is not None:
        return None
    try:
        orientation = recording.earth_orientation or EarthOrientation.from_disk(utc_ns or 0)
    except TruthError as error:
        click.echo(f"gse: {error}; the fit does not correct for aberration and refraction", err=True)
        return None
    return SiderealTruth(recording.station.site, orientation)


def calibration_report(result: SessionCalibration) -> dict[str, Any]:
    """The JSON of schema gse.calibration/1."""
    fitted = result.calibration
    return {
        "schema": "gse.calibration/1",
        **_values(fitted),
        "mirrored": fitted.camera.mirrored,
        "sigma": dict(zip(_NAMES, _rounded(fitted.sigma), strict=False)),
        "covariance": [[float(f"{value:.6g}") for value in row] for row in fitted.covariance.tolist()],
        "covariance_order": list(_NAMES[: len(fitted.sigma)]),
        "held": list(fitted.held),
        "tried": result.tried,
        "identified_before": result.identified_before,
        "panoramas": result.panoramas,
        "identified_after": result.identified_after,
        "first_scale": round(result.first_scale, 6),
        "before": _residuals(fitted, "before"),
        "after": _residuals(fitted, "after"),
        "residual_map_px": [[_rounded(cell, 3) for cell in row] for row in fitted.map_px.tolist()],
        "hot_pixels": [list(pixel) for pixel in result.hot_pixels],
    }


def _values(fitted: Calibration) -> dict[str, float]:
    camera = fitted.camera
    distortion = camera.radial_distortion, camera.tangential_distortion
    values = (camera.focal_length_px, *camera.principal_point_px, *distortion[0], *distortion[1])
    # + 0.0: no -0.0 in a station file.
    return {name: round(value, digits) + 0.0 for name, value, digits in zip(_NAMES, values, _DIGITS, strict=True)}


def _sensor_values(result: SessionCalibration) -> dict[str, object]:
    values = _values(result.calibration)
    tangential = {"tangential_distortion": [values["p1"], values["p2"]]} if values["p1"] or values["p2"] else {}
    return {
        "focal_length_px": values["focal_length_px"],
        "principal_point_px": [values["principal_point_x_px"], values["principal_point_y_px"]],
        "radial_distortion": [values["k1"], values["k2"]],
        **tangential,
        "mirrored": result.calibration.camera.mirrored,
        "hot_pixels": [list(pixel) for pixel in result.hot_pixels],
    }


def _residuals(fitted: Calibration, when: str) -> dict[str, float | int]:
    residuals = fitted.before if when == "before" else fitted.after
    return {
        "stars": residuals.n,
        "rms_px": round(residuals.rms_px, 4),
        "median_px": round(residuals.median_px, 4),
        "sigma_axis_px": round(residuals.sigma_axis_px, 4),
        "outliers": residuals.outliers,
    }


def _rounded(values: tuple[float, ...] | list[float], digits: int = 8) -> list[float]:
    return [round(value, digits) for value in values]


def _lines(result: SessionCalibration) -> list[str]:
    """The result for a person, with the map of residuals over the detector."""
    fitted = result.calibration
    rows = zip(_NAMES, _values(fitted).values(), fitted.sigma, _DIGITS, strict=False)  # p1, p2 only where fitted
    scale = (
        [f"the focal length was changed by {percent(result.first_scale - 1, 1, sign=True)} first"]
        if result.first_scale != 1
        else []
    )
    hot = ", ".join(f"({x}, {y})" for x, y in result.hot_pixels) or "none"
    return [
        *(f"{name:22}{value:14.{digits}f}  +- {sigma:.{digits}f}" for name, value, sigma, digits in rows),
        f"mirrored              {'yes' if fitted.camera.mirrored else 'no'}",
        *(f"not changed           {name}: the change is within 4 sigma of zero" for name in fitted.held),
        *(
            []
            if "principal point" in fitted.held
            else ["the principal point has changed: fit the mount again with gse align"]
        ),
        *scale,
        f"hot pixels            {hot}",
        f"identified            {result.identified_before} of {result.tried} panoramas tried before, "
        f"{result.identified_after} of {result.panoramas} after",
        *(
            f"residual {when:7}      {numbers['rms_px']:.3f} px rms, {numbers['median_px']:.3f} median, "
            f"{numbers['stars']} stars, {numbers['outliers']} outliers"
            for when in ("before", "after")
            for numbers in [_residuals(fitted, when)]
        ),
        *_map(fitted.map_px.tolist()),
    ]


_FEWEST_OF_CELL = 5


def _map(rows: list[list[list[float]]]) -> list[str]:
    """The mean residuals over the detector, where there are stars enough."""
    if not any(cell[2] >= _FEWEST_OF_CELL for row in rows for cell in row):
        return []
    return [
        "",
        "mean residual over the detector after the fit, x and y in 0.01 px;",
        f"-: fewer than {_FEWEST_OF_CELL} stars",
        *(" ".join(_cell(cell) for cell in row) for row in rows),
    ]


def _cell(cell: list[float]) -> str:
    return f"{100 * cell[0]:+4.0f},{100 * cell[1]:+4.0f}" if cell[2] >= _FEWEST_OF_CELL else f"{'-':^9}"
