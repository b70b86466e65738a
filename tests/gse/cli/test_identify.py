"""gse identify of pictures, and of tables whose camera is not as stated: focal length and mirror are found."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from devices.command_line import Gse
from numpy.typing import NDArray
from PIL import Image
from skies.night_pictures import camera_of, night_picture, published

from gse.catalog import load_catalog
from gse.cli.identify import SeenObjects, why_no_camera
from gse.values.attitude import Attitude

LOOKED = Attitude.from_angles(80, 10, 30)
ACROSS_DEG = 26


@pytest.fixture(scope="module")
def picture() -> Image.Image:
    """A picture of 800 x 600 as a camera publishes it."""
    camera = camera_of(800, 600, ACROSS_DEG)
    taken = night_picture(camera, LOOKED, load_catalog(stars=20_000), np.random.default_rng(2))
    return published(taken)


@pytest.mark.parametrize("mirrored", [False, True])
def test_a_picture_is_identified_without_a_station(
    tmp_path: Path, gse: Gse, picture: Image.Image, mirrored: bool
) -> None:
    shown = picture.transpose(Image.Transpose.FLIP_LEFT_RIGHT) if mirrored else picture
    shown.save(tmp_path / "sky.jpg", quality=90)
    done = gse("identify", tmp_path / "sky.jpg", "--json")
    found = json.loads(done.out)
    assert (done.code, found["identifier"], found["objects"]) == (0, "robust", 30)
    assert found["ra_deg"] == pytest.approx(LOOKED.ra_deg, abs=0.005)
    assert found["de_deg"] == pytest.approx(LOOKED.de_deg, abs=0.005)
    assert found["matched"] >= 25
    (words,) = re.findall(r"focal length ([\d.]+) px fits: a field of ([\d.]+) x [\d.]+ deg(.*)", done.err)
    assert float(words[0]) == pytest.approx(camera_of(800, 600, ACROSS_DEG).focal_length_px, rel=2e-3)
    assert words[2] == (", mirrored" if mirrored else "")


def test_a_table_that_does_not_fit_its_station_file_gets_the_same_search(
    tmp_path: Path, gse: Gse, picture: Image.Image
) -> None:
    picture.save(tmp_path / "sky.png")
    gse("extract", "--sub-pixel", tmp_path / "sky.png", "--out", tmp_path / "table.csv")
    sensor = "sensor: {rows: 600, columns: 800, focal_length_px: 900}"
    station = f"version: 1\n{sensor}\nsite: {{latitude_deg: 0, longitude_deg: 0}}\n"
    (tmp_path / "station.yaml").write_text(station)
    done = gse("identify", tmp_path / "table.csv", "--station", tmp_path / "station.yaml")
    assert done.code == 0
    assert "gse: focal length 17" in done.err
    assert done.out.startswith("RA 80.00")


def test_a_picture_without_stars_is_not_identified(tmp_path: Path, gse: Gse) -> None:
    Image.new("L", (300, 200), 40).save(tmp_path / "grey.png")
    done = gse("identify", tmp_path / "grey.png")
    assert (done.code, done.out) == (1, "")
    assert "no object stands out of the picture" in done.err


@pytest.mark.parametrize(("command", "code"), [("identify", 1), ("calibrate", 2)])
def test_a_picture_of_few_objects_is_not_searched(tmp_path: Path, gse: Gse, command: str, code: int) -> None:
    pixels = np.random.default_rng(4).normal(20, 2, (200, 300))
    for y, x in ((20, 50), (60, 200), (110, 90), (150, 240), (170, 30)):
        pixels[y - 1 : y + 2, x - 1 : x + 2] += 50 + y
    Image.fromarray(pixels.astype(np.uint8)).save(tmp_path / "dots.png")
    done = gse(command, tmp_path / "dots.png")
    assert (done.code, done.out) == (code, "")
    assert "5 objects are too few to find the focal length: 8 are needed" in done.err


def test_where_no_camera_fits_a_lens_that_distorts_is_named() -> None:
    seen = SeenObjects(np.zeros((8, 2)), np.ones(8), (300, 200))
    assert "about sensor.radial_distortion in a station file" in why_no_camera(seen)


def test_an_annotated_picture_rings_its_stars_in_green(tmp_path: Path, gse: Gse, picture: Image.Image) -> None:
    picture.save(tmp_path / "sky.png")
    done = gse("extract", "--sub-pixel", tmp_path / "sky.png", "--annotate", tmp_path / "named.png", "--json")
    assert done.code == 0
    drawn = np.asarray(Image.open(tmp_path / "named.png")).astype(int)
    assert drawn.shape == (600, 800, 3)
    rings = [_greener(drawn, x, y) for x, y in json.loads(done.out)["xy_px"]]
    assert sum(rings) >= 25
    assert gse("extract", tmp_path / "sky.png", "--annotate", tmp_path / "named.png").code == 2


def _greener(drawn: NDArray[np.int64], x: float, y: float) -> bool:
    """Whether there is green within the size of a ring."""
    near = drawn[max(round(y) - 12, 0) : round(y) + 13, max(round(x) - 12, 0) : round(x) + 13]
    return bool((near[..., 1] - near[..., 0] > 100).any())


def test_an_annotated_picture_without_stars_has_no_names(tmp_path: Path, gse: Gse) -> None:
    Image.new("L", (300, 200), 40).save(tmp_path / "grey.png")
    done = gse("extract", "--sub-pixel", tmp_path / "grey.png", "--annotate", tmp_path / "named.png")
    assert done.code == 0
    assert np.ptp(np.asarray(Image.open(tmp_path / "named.png"))) == 0


def test_the_camera_of_one_picture_or_table_is_calibrated(tmp_path: Path, gse: Gse, picture: Image.Image) -> None:
    picture.save(tmp_path / "sky.png")
    of_picture = gse("calibrate", tmp_path / "sky.png", "--json", "--write", tmp_path / "new.yaml")
    assert of_picture.code == 0
    true_px = camera_of(800, 600, ACROSS_DEG).focal_length_px
    assert json.loads(of_picture.out)["focal_length_px"] == pytest.approx(true_px, rel=1e-3)
    assert "over the detector" not in gse("calibrate", tmp_path / "sky.png").out, "no part of it has five stars"
    gse("extract", "--sub-pixel", tmp_path / "sky.png", "--out", tmp_path / "table.csv")
    of_table = gse("calibrate", tmp_path / "table.csv", "--station", tmp_path / "new.yaml", "--json")
    assert json.loads(of_table.out)["focal_length_px"] == pytest.approx(true_px, rel=1e-3)
    refused = gse("calibrate", tmp_path / "sky.png", "--from", "2026-03-20T18:30:00Z")
    assert (refused.code, "is one panorama" in refused.err) == (2, True)
