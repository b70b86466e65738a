"""gse identify of pictures, and of tables whose camera is not as stated: focal length and mirror are found."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from devices.command_line import Gse
from PIL import Image
from skies.night_pictures import camera_of, night_picture, published

from gse.catalog import load_catalog
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
