"""gse extract: image files of every kind in, a panorama table out; damaged files get one line."""

import contextlib
import json
import os
import struct
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from astropy.io import fits
from click.testing import CliRunner
from devices.command_line import Gse
from numpy.typing import NDArray
from PIL import Image
from skies.night_pictures import camera_of, night_picture, published

from gse.catalog import load_catalog
from gse.cli.extract import command
from gse.errors import TableError
from gse.imaging.image_file import read_picture
from gse.imaging.panorama_table import read_panorama_table
from gse.values.attitude import Attitude


def stars() -> NDArray[np.uint16]:
    """12-bit values: three stars on a level of 80."""
    image = np.full((64, 96), 80, dtype=np.uint16)
    for x, y, peak in ((20, 10, 4000), (70, 30, 2000), (45, 50, 1008)):
        image[y, x] = peak
        image[y, x + 1] = image[y + 1, x] = peak // 2
    return image


def png_8(path: Path) -> Path:
    Image.fromarray((stars() >> 4).astype(np.uint8)).save(path / "a.png")
    return path / "a.png"


def png_16(path: Path) -> Path:
    Image.fromarray(stars() << 4).save(path / "b.png")
    return path / "b.png"


def png_rgb(path: Path) -> Path:
    Image.fromarray((stars() >> 4).astype(np.uint8)).convert("RGB").save(path / "rgb.png")
    return path / "rgb.png"


def tiff_8(path: Path) -> Path:
    Image.fromarray((stars() >> 4).astype(np.uint8)).save(path / "c.tif")
    return path / "c.tif"


def tiff_12(path: Path) -> Path:
    """A TIFF of packed 12-bit samples, which no library at hand writes: header, one directory, the pixels."""
    values = stars().astype(np.uint32)
    pairs = (values[:, 0::2] << 12 | values[:, 1::2]).ravel()
    pixels = b"".join(int(pair).to_bytes(3, "big") for pair in pairs)
    rows, columns = values.shape
    tags = {256: columns, 257: rows, 258: 12, 259: 1, 262: 1, 273: 8, 277: 1, 278: rows, 279: len(pixels)}
    directory = struct.pack("<H", len(tags)) + b"".join(
        struct.pack("<HHII", tag, 4 if value > 65535 or tag in (273, 279) else 3, 1, value)
        for tag, value in tags.items()
    )
    (path / "d.tiff").write_bytes(struct.pack("<2sHI", b"II", 42, 8 + len(pixels)) + pixels + directory + bytes(4))
    return path / "d.tiff"


def tiff_16(path: Path) -> Path:
    Image.fromarray(stars() << 4).save(path / "e.tiff")
    return path / "e.tiff"


def tiff_12_in_16(path: Path) -> Path:
    Image.fromarray(stars()).save(path / "f.tiff")
    return path / "f.tiff"


def fits_16(path: Path) -> Path:
    fits.PrimaryHDU(stars() << 4).writeto(path / "g.fits")
    return path / "g.fits"


def fits_float_in_extension(path: Path) -> Path:
    fits.HDUList([fits.PrimaryHDU(), fits.ImageHDU(stars().astype(np.float32))]).writeto(path / "h.fit")
    return path / "h.fit"


def fits_one_plane(path: Path) -> Path:
    fits.PrimaryHDU((stars() << 4)[None]).writeto(path / "plane.fits")
    return path / "plane.fits"


def fits_three_colours(path: Path) -> Path:
    fits.PrimaryHDU(np.stack([stars().astype(np.int16) + step for step in (-30, 0, 30)])).writeto(path / "rgb.fits")
    return path / "rgb.fits"


MAKERS = [
    png_8,
    png_16,
    png_rgb,
    tiff_8,
    tiff_12,
    tiff_16,
    tiff_12_in_16,
    fits_16,
    fits_float_in_extension,
    fits_one_plane,
    fits_three_colours,
]


@pytest.mark.parametrize("make", MAKERS)
def test_every_kind_of_file_gives_the_same_panorama(make: Callable[[Path], Path], tmp_path: Path) -> None:
    result = CliRunner().invoke(command, [str(make(tmp_path))], catch_exceptions=False)
    assert result.exit_code == 0
    assert result.stdout.splitlines()[:4] == ["y,x,index", "10,20,4000", "30,70,2000", "50,45,1008"]


def test_the_table_can_be_read_again(tmp_path: Path) -> None:
    table = tmp_path / "panorama.csv"
    CliRunner().invoke(command, [str(png_16(tmp_path)), "--out", str(table)], catch_exceptions=False)
    xy_px, index = read_panorama_table(table)
    assert xy_px[:3].tolist() == [[20, 10], [70, 30], [45, 50]]
    assert index[:3].tolist() == [4000, 2000, 1008]


def test_json_has_the_same_numbers(tmp_path: Path) -> None:
    result = CliRunner().invoke(command, [str(png_16(tmp_path)), "--sub-pixel", "--json"], catch_exceptions=False)
    document = json.loads(result.stdout)
    assert document["schema"] == "gse.panorama/1"
    assert document["index"] == pytest.approx([4000 - 80, 2000 - 80, 1008 - 80], rel=0.03)
    assert np.abs(np.array(document["xy_px"]) - [[20.25, 10.25], [70.25, 30.25], [45.25, 50.25]]).max() < 0.06


def test_the_panorama_of_a_dark_image_is_a_map_of_hot_pixels(tmp_path: Path) -> None:
    table, image = tmp_path / "hot.csv", str(png_16(tmp_path))
    table.write_text("# a dark image\ny,x,index\n10,20,4000\n10,21,2000\n11,20,2000\n")
    result = CliRunner().invoke(command, [image, "--hot-pixels", str(table)], catch_exceptions=False)
    assert result.stdout.splitlines()[1] == "30,70,2000"


def test_the_hot_pixels_of_the_station_file_are_left_out(tmp_path: Path) -> None:
    station = tmp_path / "station.yaml"
    station.write_text(
        "version: 1\n"
        "sensor: {rows: 64, columns: 96, focal_length_px: 500, hot_pixels: [[20, 10], [21, 10], [20, 11]]}\n"
        "site: {latitude_deg: 0, longitude_deg: 0}\n"
    )
    arguments = [str(png_16(tmp_path)), "--station", str(station)]
    assert CliRunner().invoke(command, arguments, catch_exceptions=False).stdout.splitlines()[1] == "30,70,2000"


def test_the_bits_that_count_can_be_said(tmp_path: Path) -> None:
    assert read_picture(tiff_12_in_16(tmp_path), 16).index_values().max() == 4000 >> 4
    assert read_picture(png_8(tmp_path), 8).index_values().max() == 4000
    assert read_picture(tiff_16(tmp_path), 12).index_values().max() == 4096


def test_values_over_the_scale_are_cut_and_what_is_no_number_is_dark(tmp_path: Path) -> None:
    values = stars().astype(np.float32)
    values[0, :4] = np.nan, np.inf, -np.inf, -5
    fits.PrimaryHDU(values).writeto(tmp_path / "x.fits")
    assert read_picture(tmp_path / "x.fits", 12).index_values()[0, :5].tolist() == [0, 4095, 0, 0, 80]


@pytest.mark.parametrize("make", MAKERS)
def test_a_truncated_file_gets_one_line(make: Callable[[Path], Path], tmp_path: Path) -> None:
    path = make(tmp_path)
    whole = path.read_bytes()
    for size in (0, 10, len(whole) // 3, len(whole) * 2 // 3):
        path.write_bytes(whole[:size])
        with pytest.raises(TableError, match=path.name) as error:
            read_picture(path)
        assert len(str(error.value).splitlines()) == 1


@pytest.mark.parametrize("make", MAKERS)
def test_a_damaged_file_never_gives_a_traceback(make: Callable[[Path], Path], tmp_path: Path) -> None:
    path = make(tmp_path)
    whole = bytearray(path.read_bytes())
    random = np.random.default_rng(1)
    for _ in range(25):
        damaged = whole.copy()
        for place in random.integers(0, min(len(whole), 3000), 5):
            damaged[place] = random.integers(256)
        path.write_bytes(damaged)
        with contextlib.suppress(TableError):
            assert read_picture(path).index_values().dtype == np.uint16


def test_an_image_larger_than_any_detector_is_refused_before_it_is_read(tmp_path: Path) -> None:
    header = fits.PrimaryHDU(np.zeros((2, 2), dtype=np.int16)).header
    header["NAXIS1"], header["NAXIS2"] = 100_000, 100_000
    (tmp_path / "x.fits").write_bytes(header.tostring().encode() + bytes(2880))
    with pytest.raises(TableError, match="67108864 pixels"):
        read_picture(tmp_path / "x.fits")
    Image.new("1", (20_000, 20_000)).save(tmp_path / "x.png")
    with pytest.raises(TableError, match="67108864 pixels"):
        read_picture(tmp_path / "x.png")


def sky_picture() -> tuple[Image.Image, NDArray[np.float64]]:
    """A picture of 800 x 600 as a camera publishes it, 26 deg wide, and the pixels of its 100 brightest stars."""
    camera = camera_of(800, 600, 26)
    catalog = load_catalog(stars=20_000)
    taken = night_picture(camera, Attitude.from_angles(80, 10, 30), catalog, np.random.default_rng(2))
    return published(taken), taken.xy_px[:100]


@pytest.mark.parametrize("kind", ["jpg", "png", "tiff"])
def test_the_stars_of_a_published_picture_are_found(tmp_path: Path, gse: Gse, kind: str) -> None:
    """Demosaicing and compression leave neighbouring pixels equal."""
    picture, stars_px = sky_picture()
    picture.save(tmp_path / f"sky.{kind}", **({"quality": 85} if kind == "jpg" else {}))
    done = gse("extract", "--sub-pixel", tmp_path / f"sky.{kind}", "--out", tmp_path / "table.csv")
    assert ("a JPEG of quality 85 doubles the error" in done.err) == (kind == "jpg")
    xy_px, _ = read_panorama_table(tmp_path / "table.csv")
    off_px = np.linalg.norm(xy_px[:, None] - stars_px, axis=2).min(axis=1)
    assert len(xy_px) == 30
    assert (off_px < 0.5).sum() >= 28  # two are close pairs
    assert np.median(off_px) < 0.05


def test_a_truncated_jpeg_gets_one_line(tmp_path: Path, gse: Gse) -> None:
    sky_picture()[0].save(tmp_path / "sky.jpg", quality=85)
    whole = (tmp_path / "sky.jpg").read_bytes()
    (tmp_path / "sky.jpg").write_bytes(whole[: len(whole) // 2])
    done = gse("extract", "--sub-pixel", tmp_path / "sky.jpg")
    assert done.code == 2
    assert "sky.jpg is damaged or no image: image file is truncated" in done.err


@pytest.mark.parametrize("shape", [(1, 1), (64, 96)])
@pytest.mark.parametrize("level", [0, 255])
def test_an_even_picture_gives_an_empty_table_and_a_word(
    tmp_path: Path, gse: Gse, level: int, shape: tuple[int, int]
) -> None:
    Image.fromarray(np.full(shape, level, dtype=np.uint8)).save(tmp_path / "even.png")
    done = gse("extract", "--sub-pixel", tmp_path / "even.png")
    assert (done.code, done.out) == (0, "y,x,index\n")
    assert f"no object found: the counts of the picture are {level} to {level}" in done.err


def test_an_even_picture_has_a_word_also_where_the_paper_s_extraction_takes_its_light_for_an_object(
    tmp_path: Path, gse: Gse
) -> None:
    Image.fromarray(np.full((64, 96), 255, dtype=np.uint8)).save(tmp_path / "even.png")
    assert "every pixel has the count 255" in gse("extract", tmp_path / "even.png").err


def test_light_keeps_what_index_values_round_and_fills_what_is_no_number(tmp_path: Path) -> None:
    values = np.full((20, 30), 1001.0, dtype=np.float32)
    values[3, 4], values[5, 6], values[7, 8] = np.nan, np.inf, 50_000
    fits.PrimaryHDU(values).writeto(tmp_path / "x.fits")
    picture = read_picture(tmp_path / "x.fits")
    assert picture.light()[0, 0] == 1001 / 16
    assert (picture.light()[3, 4], picture.light()[5, 6]) == (1001 / 16, 4096)
    assert picture.index_values()[0, 0] == 62


@pytest.mark.parametrize(("equivalent_mm", "focal_px"), [(50, 50 * 125 / np.hypot(36, 24)), (None, None), (0, None)])
def test_the_focal_length_of_exif_is_read(tmp_path: Path, equivalent_mm: int | None, focal_px: float | None) -> None:
    """The equivalent for film is by the diagonal."""
    exif = Image.Exif()
    if equivalent_mm is not None:
        exif.get_ifd(0x8769)[41989] = equivalent_mm
    Image.new("RGB", (100, 75)).save(tmp_path / "a.jpg", exif=exif)
    assert read_picture(tmp_path / "a.jpg").focal_length_px == pytest.approx(focal_px)


def test_without_its_library_the_paper_s_extraction_works_and_the_other_says_what_to_install(tmp_path: Path) -> None:
    """As on a Python for which sep has no wheel: a module of that name that cannot be imported."""
    (tmp_path / "sep.py").write_text("raise ImportError('no wheel')")
    found = {**os.environ, "PYTHONPATH": str(tmp_path)}
    command = [sys.executable, "-m", "gse", "extract", str(png_8(tmp_path))]
    assert subprocess.run(command, capture_output=True, env=found, check=False).returncode == 0
    done = subprocess.run([*command, "--sub-pixel"], capture_output=True, text=True, env=found, check=False)
    assert done.returncode == 2
    assert "centres of light need the package sep, which is not installed: `pip install sep`" in done.stderr


@pytest.mark.parametrize("name", ["a.jpg", "none.png", "cube.fits", "empty.fits", "float.tiff"])
def test_what_is_no_image_of_a_detector_is_told_so(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    if name == "cube.fits":
        fits.PrimaryHDU(np.zeros((2, 3, 4))).writeto(path)
    elif name == "empty.fits":
        fits.PrimaryHDU().writeto(path)
    elif name == "float.tiff":
        Image.new("CMYK", (4, 4)).save(path)
    with pytest.raises(TableError, match=name):
        read_picture(path)


@pytest.mark.parametrize(
    ("pixels", "words"),
    [
        (stars() / 4095, "fractions up to 0.977.*scale it"),
        (stars() / 3810, "fractions up to 1.05.*scale it"),
        (np.full((9, 9), np.nan), "no number in any pixel"),
        (stars() * 1000.0, "counts of 8e[+]04 in its background: scale it to 65535"),
        (stars() * np.int32(1000), "counts of 8e[+]04 in its background: scale it to 65535"),
    ],
)
def test_floats_that_are_no_counts_are_refused(pixels: NDArray[np.float64], words: str, tmp_path: Path) -> None:
    fits.PrimaryHDU(pixels).writeto(tmp_path / "x.fits")
    with pytest.raises(TableError, match=words):
        read_picture(tmp_path / "x.fits")


def test_a_pixel_that_is_infinite_does_not_change_the_scale_of_the_others(tmp_path: Path) -> None:
    pixels = stars().astype(np.float64)
    pixels[0, :2] = np.inf, np.nan
    fits.PrimaryHDU(pixels).writeto(tmp_path / "x.fits")
    assert read_picture(tmp_path / "x.fits").index_values()[0, :3].tolist() == [4095, 0, 80]
    assert read_picture(tmp_path / "x.fits").index_values()[10, 20] == 4000


def test_colours_of_16_bits_and_folders_are_refused(tmp_path: Path) -> None:
    size, pixels = 4, bytes(4 * 4 * 6)
    tags = {256: size, 257: size, 258: 16, 259: 1, 262: 2, 273: 8, 277: 3, 278: size, 279: len(pixels)}
    entries = b"".join(struct.pack("<HHII", tag, 4, 1, value) for tag, value in tags.items())
    head = b"II*\0" + struct.pack("<I", 8 + len(pixels))
    (tmp_path / "rgb.tif").write_bytes(head + pixels + struct.pack("<H", len(tags)) + entries + bytes(4))
    (tmp_path / "folder.png").mkdir()
    for name, words in (
        ("rgb.tif", "expected gray of 8, 12 or 16 bits, or colour of 8"),
        ("folder.png", "is a folder, a pipe or a device"),
    ):
        with pytest.raises(TableError, match=words):
            read_picture(tmp_path / name)


def test_nothing_is_overwritten(tmp_path: Path) -> None:
    out = tmp_path / "out.csv"
    out.write_text("mine")
    result = CliRunner().invoke(command, [str(png_16(tmp_path)), "--out", str(out)])
    assert "exists already" in str(result.exception)
    assert out.read_text() == "mine"
