"""``gse identify``: stars, RA, DE and roll of one panorama table or image."""

import json
import math
from dataclasses import dataclass, replace
from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray

from gse.catalog import load_catalog
from gse.cli.options import identifier_option, say, station_option
from gse.config.choice import station_of, with_identifier
from gse.config.station import Station, parse_station
from gse.errors import UsageError
from gse.imaging.panorama_table import read_panorama_table
from gse.station.frame_results import FrameResult, frame_json
from gse.station.results import Status
from gse.values import instant
from gse.values.panorama import Panorama


@click.command("identify")
@click.argument("path", metavar="TABLE|IMAGE", type=click.Path(path_type=Path))
@station_option
@identifier_option
@click.option(
    "--utc",
    "utc_text",
    help="UTC of the exposure, e.g. 2026-03-20T18:30:00Z; with it the result is compared with the mount.",
)
@click.option("--json", "as_json", is_flag=True, help="One JSON object, schema gse.frame/1.")
@click.pass_context
def command(
    ctx: click.Context,
    path: Path,
    station_path: Path | None,
    identifier: str | None,
    utc_text: str | None,
    as_json: bool,
) -> None:
    """Identify the stars of a table, lines of y, x, index value as in the LAPAN paper, or of an image.

    An image is extracted as by `gse extract --sub-pixel`. Without --station its focal length and mirror are found, from
    EXIF first, then from 5 to 70 deg of field, and its stars by the identifier robust. So are those of a table that
    does not fit its station file. The exit code is 1 if the panorama is not identified.
    """
    seen = seen_in(path)
    try:
        utc_ns = instant.from_text(utc_text) if utc_text else 0
    except ValueError as error:
        raise UsageError(f"--utc: {error}") from error
    result, label = identified(seen, station_path, identifier, utc_ns)
    if result is None and not len(seen.brightness):
        say("no object stands out of the picture: there is nothing to identify")
        ctx.exit(1)
    if result is None:
        say(why_no_camera(seen))
        ctx.exit(1)
    if as_json:
        document = frame_json(result)
        if utc_text is None:
            document["utc"] = None
        click.echo(json.dumps(document))
    else:
        _print(result, label)
    ctx.exit(0 if result.status is Status.IDENTIFIED else 1)


@dataclass(frozen=True, slots=True, eq=False)
class SeenObjects:
    """Pixels (N, 2) and index values (N,) of objects; of an image also columns and rows, and EXIF's focal length."""

    xy_px: NDArray[np.float64]
    brightness: NDArray[np.float64]
    size: tuple[int, int] | None = None
    focal_length_px: float | None = None


def seen_in(path: Path) -> SeenObjects:
    """The objects of a table or of an image."""
    from gse.imaging.extraction import extract_sub_pixel
    from gse.imaging.image_file import KNOWN_SUFFIXES, read_picture

    if path.suffix.lower() not in KNOWN_SUFFIXES:
        return SeenObjects(*read_panorama_table(path))
    picture = read_picture(path)
    rows, columns = picture.counts.shape
    return SeenObjects(*extract_sub_pixel(picture.light(), step=picture.step), (columns, rows), picture.focal_length_px)


def identified(
    seen: SeenObjects, station_path: Path | None, identifier: str | None = None, utc_ns: int = 0
) -> tuple[FrameResult | None, str]:
    """The result with a station file, or with a camera that is searched for, None without any; what identified it."""
    station, text = station_of(station_path)
    panorama = Panorama(utc_ns, seen.xy_px, seen.brightness)
    result, label = None, "robust"
    if station_path is not None or seen.size is None:
        result, label = _observed(panorama, *with_identifier(station, text, identifier))
    if result is None or result.status is Status.NO_MATCH:
        sensor = station.sensor
        found = found_station(seen if seen.size is not None else replace(seen, size=(sensor.columns, sensor.rows)))
        if found is not None:
            return _observed(panorama, *with_identifier(parse_station(found), found, identifier or "robust"))
    return result, label


def _observed(panorama: Panorama, station: Station, text: str) -> tuple[FrameResult, str]:
    """The result of a panorama, and what identified it."""
    from gse.station.loop import StationLoop
    from gse.station.setup import set_up

    setup = set_up(station, text, tell=say)
    return StationLoop(setup).observe(panorama), setup.station.identifier.label


def found_station(seen: SeenObjects) -> str | None:
    """A station file with a camera that fits the objects of a picture, found by search and told; None where none fits.

    Its site is none.
    """
    from gse.identifier.camera_search import find_unknown_camera

    assert seen.size is not None
    columns, rows = seen.size
    if len(seen.brightness) < _FEWEST_FOR_A_SEARCH:
        return None
    say("searching for the focal length: from 5 to 70 deg of field")
    catalog, panorama = load_catalog(stars=_STARS), Panorama(0, seen.xy_px, seen.brightness)
    camera = find_unknown_camera(panorama, columns, rows, catalog, first_px=seen.focal_length_px)
    if camera is None:
        return None
    across, down = (2 * math.degrees(math.atan(size / 2 / camera.focal_length_px)) for size in seen.size)
    mirrored = ", mirrored" if camera.mirrored else ""
    say(f"focal length {camera.focal_length_px:.1f} px fits: a field of {across:.1f} x {down:.1f} deg{mirrored}")
    return _STATION.format(
        rows=rows, columns=columns, focal_length_px=camera.focal_length_px, mirrored=str(camera.mirrored).lower()
    )


def why_no_camera(seen: SeenObjects) -> str:
    """Why ``found_station`` found nothing, and what to do."""
    count = len(seen.brightness)
    if count < _FEWEST_FOR_A_SEARCH:
        return (
            f"{count} objects are too few to find the focal length: {_FEWEST_FOR_A_SEARCH} are needed, "
            "or a station file (--station) with the camera"
        )
    return (
        "no focal length fits, from 5 to 70 deg of field: the objects may be no stars, or the lens distorts strongly. "
        "Then state sensor.focal_length_px and about sensor.radial_distortion in a station file (--station), "
        "which `gse calibrate` makes exact"
    )


_FEWEST_FOR_A_SEARCH = 8
_STARS = 200_000
"""Three times what the narrowest field takes, for doubles are merged."""
_STATION = """\
version: 1
sensor: {{rows: {rows}, columns: {columns}, focal_length_px: {focal_length_px:.3f}, mirrored: {mirrored}}}
site: {{latitude_deg: 0, longitude_deg: 0}}
"""


def _print(result: FrameResult, identifier: str) -> None:
    attitude = result.attitude
    if attitude is None:
        click.echo(f"{result.status}: {result.detail}" if result.detail != result.status else result.status)
        return
    count = len(result.panorama.brightness)
    click.echo(f"RA {attitude.ra_deg:.5f}  DE {attitude.de_deg:+.5f}  roll {attitude.roll_deg:.4f} deg (ICRS)")
    probability = result.false_match_probability
    stated = "not stated" if math.isnan(probability) else f"{probability:.1g}"
    summary = f"{len(result.matches)} of {count} objects identified by {identifier}"
    click.echo(f"{summary}, false-match probability {stated}")
    if result.attitude_error:
        error = result.attitude_error
        click.echo(f"dRA* {error.d_ra_cosde_arcsec:+.1f}  dDE {error.d_de_arcsec:+.1f} arcsec from the mount")
    names = {match.object: match for match in result.matches}
    others = dict(result.others)
    for row, ((x, y), brightness) in enumerate(zip(result.panorama.xy_px, result.panorama.brightness, strict=True)):
        match = names.get(row)
        what = f"{match.star:28} {match.residual_arcsec:5.1f} arcsec" if match else others.get(row, "-")
        click.echo(f"  y {y:8.2f}  x {x:8.2f}  index {brightness:5.0f}  {what}")
