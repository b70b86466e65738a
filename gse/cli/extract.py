"""``gse extract``: a panorama table from an image, by the method of the sensor."""

import json
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from drivers.host_files import only_a_file
from gse.cli import folded, write_new
from gse.errors import TableError

if TYPE_CHECKING:
    from gse.imaging.extraction import Objects
    from gse.imaging.image_file import Picture

MAX_MAP_BYTES = 1_000_000
"""Some 100,000 hot pixels: a detector with more is dead."""

_LONGEST_NAME = 16
"""Characters of a name that is drawn beside its star; a number of Gaia has 28, which hide each other."""


@click.command("extract")
@click.argument("image", type=click.Path(path_type=Path))
@click.option(
    "--sub-pixel", is_flag=True, help="Use centres of light over the local background instead of brightest pixels."
)
@click.option(
    "--hot-pixels",
    "hot_pixels_path",
    type=click.Path(path_type=Path),
    help="Leave out the hot pixels of this table (y, x), for example the output of this command for a dark image.",
)
@click.option(
    "--station", "station_path", type=click.Path(path_type=Path), help="Leave out the hot pixels of this station file."
)
@click.option(
    "--bits", type=click.IntRange(1, 16), help="Significant bits of the stored values; default: as in the file."
)
@click.option(
    "--out",
    "out_path",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Write to this new file instead of stdout.",
)
@click.option(
    "--annotate",
    "annotated_path",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Draw the objects into a new PNG of the picture, with the names of the stars where it can be identified.",
)
@click.option("--json", "as_json", is_flag=True, help="One JSON object, schema gse.panorama/1.")
def command(
    *,
    image: Path,
    sub_pixel: bool,
    hot_pixels_path: Path | None,
    station_path: Path | None,
    bits: int | None,
    out_path: Path | None,
    annotated_path: Path | None,
    as_json: bool,
) -> None:
    """Extract the panorama of IMAGE: PNG, TIFF (8, 12 or 16 bit), JPEG or FITS, rows in the order of the file.

    As in the LAPAN paper: the brightest pixel of each row, one pixel for each star, and of these the 30 with the
    highest index values (0 to 4096). With --sub-pixel: objects over the local background as Source Extractor finds
    them, the 30 with the most light, at their windowed centres; the index value is then the light over the background.
    Take --sub-pixel for pictures of a camera. --annotate names the stars with the camera of --station, or with one that
    is found as by `gse identify`.
    """
    from gse.imaging.extraction import extract, extract_sub_pixel, without_hot_pixels
    from gse.imaging.image_file import read_picture

    hot_xy_px = _read_map(hot_pixels_path) if hot_pixels_path else []
    if station_path:
        from gse.config.choice import station_of  # which takes half a second more than all others

        hot_xy_px += station_of(station_path)[0].sensor.hot_pixels
    picture = read_picture(image, bits)
    values: Any = picture.light() if sub_pixel else picture.index_values()
    if hot_xy_px:
        values = without_hot_pixels(values, hot_xy_px)
    objects = extract_sub_pixel(values, step=picture.step) if sub_pixel else extract(values)
    for word in _words(picture, len(objects[1])):
        click.echo(folded(f"gse: {word}", err=True), err=True)
    text = _as_json(objects, image) if as_json else _as_table(objects, decimals=3 if sub_pixel else 0)
    if out_path is None:
        click.echo(text, nl=False)
    else:
        write_new(out_path, text)
    if annotated_path is not None:
        write_new(annotated_path, _annotated(picture, objects, station_path))


def _annotated(picture: "Picture", objects: "Objects", station_path: Path | None) -> bytes:
    """The picture as PNG with a ring about each object, green about a star and with its name, if it has one."""
    import numpy as np
    from PIL import Image, ImageDraw

    from gse.cli.identify import SeenObjects, identified

    xy_px, index = objects
    light = picture.light()
    rows, columns = light.shape
    seen = SeenObjects(xy_px.astype(np.float64), index.astype(np.float64), (columns, rows), picture.focal_length_px)
    result, _ = identified(seen, station_path) if len(index) else (None, "")
    names = {match.object: match.star for match in result.matches} if result else {}
    dark, bright = np.percentile(light, [50, 99.9])
    grey = np.clip((light - dark) / max(float(bright - dark), 1e-6), 0, 1) ** 0.5 * 255
    drawn = Image.fromarray(grey.astype(np.uint8)).convert("RGB")
    pen, radius = ImageDraw.Draw(drawn), max(columns, rows) / 120 + 3
    for row, (x, y) in enumerate(xy_px.tolist()):
        colour = "#40e060" if row in names else "#ff9030"
        pen.ellipse((x - radius, y - radius, x + radius, y + radius), outline=colour, width=max(round(radius / 8), 1))
        name = names.get(row, "")
        shown = name if len(name) <= _LONGEST_NAME else ""
        pen.text((x + 1.2 * radius, y), shown, fill=colour, font_size=max(radius, 10), anchor="lm")
    written = BytesIO()
    drawn.save(written, "PNG")
    return written.getvalue()


def _words(picture: "Picture", count: int) -> list[str]:
    """What a person should know of a picture and its objects."""
    import numpy as np

    words = []
    if picture.is_jpeg:
        words.append(
            "a JPEG of quality 85 doubles the error of a centre, one of 60 has it four times; TIFF or FITS keep all"
        )
    darkest, brightest = np.nanmin(picture.counts), np.nanmax(picture.counts)
    if not count:
        words.append(f"no object found: the counts of the picture are {darkest:g} to {brightest:g}")
    elif darkest == brightest:
        words.append(f"every pixel has the count {darkest:g}: what was found is no object")
    return words


def _as_table(objects: "Objects", decimals: int) -> str:
    xy_px, index = objects
    rows = [f"{y:.{decimals}f},{x:.{decimals}f},{value:.0f}" for (x, y), value in zip(xy_px, index, strict=True)]
    return "\n".join(["y,x,index", *rows]) + "\n"


def _as_json(objects: "Objects", image: Path) -> str:
    xy_px, index = objects
    document = {
        "schema": "gse.panorama/1",
        "image": str(image),
        "xy_px": [[round(float(x), 3), round(float(y), 3)] for x, y in xy_px],
        "index": [round(float(value)) for value in index],
    }
    return json.dumps(document) + "\n"


def _read_map(path: Path) -> list[tuple[int, int]]:
    """Hot pixels (x, y) of a table of y, x; further columns are ignored."""
    try:
        if path.stat().st_size > MAX_MAP_BYTES:
            raise TableError(f"{path} is larger than {MAX_MAP_BYTES} bytes; expected a table of hot pixels")
        with open(path, encoding="utf-8-sig", opener=only_a_file) as file:
            lines = file.read(MAX_MAP_BYTES).splitlines()
    except OSError as error:
        raise TableError(f"cannot read {path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise TableError(f"{path} is not text; expected a table of y, x") from error
    hot_xy_px = []
    for number, line in enumerate(lines, start=1):
        fields = line.partition("#")[0].replace(",", " ").split()
        if not fields or fields[0].lower() == "y":
            continue
        try:
            hot_xy_px.append((round(float(fields[1])), round(float(fields[0]))))
        except (ValueError, IndexError, OverflowError):
            raise TableError(
                f"{path}, line {number}: {line.strip()[:60]!r} is not y, x; expected for example 512, 300"
            ) from None
    return hot_xy_px
