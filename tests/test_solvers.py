"""The package of benchmarks/solvers: solvers from PyPI as identifiers under test, found by their entry points."""

import json
import sys
import tomllib
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from skies.made_frames import FIELD_14_DEG, Noise, made_frame, sky_of

from gse.catalog import load_catalog
from gse.external.answers import ExternalAnswer
from gse.external.identifier import RunningIdentifier
from gse.external.panoramas import SensorDescription, WireUnit
from gse.external.plugs import plug_of
from gse.values.camera import Camera
from gse.values.identifier_options import IdentifierOptions
from gse.values.panorama import Panorama
from gse.values.spiral import spiral_directions

SOLVERS = Path(__file__).parents[1] / "benchmarks" / "solvers"
SENSOR = SensorDescription("made", FIELD_14_DEG, 4096)


@pytest.fixture(autouse=True)
def installed(tmp_path, monkeypatch):
    """What pip leaves of the package: its modules on the path, its entry points in a file beside them."""
    project = tomllib.loads((SOLVERS / "pyproject.toml").read_text())["project"]
    info = tmp_path / f"gse_solvers-{project['version']}.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n")
    points = "".join(f"{name} = {place}\n" for name, place in project["entry-points"]["gse.identifiers"].items())
    (info / "entry_points.txt").write_text(f"[gse.identifiers]\n{points}")
    monkeypatch.setattr(sys, "path", [str(tmp_path), str(SOLVERS), *sys.path])


@pytest.mark.parametrize("mirrored", [False, True])
def test_distortion_is_taken_out_as_the_camera_does_it(mirrored):
    camera = Camera(768, 1024, 4000.0, (500.0, 390.0), (0.004, -0.002), mirrored, (0.0011, -0.0007))
    sensor = SensorDescription("made", camera, 4096, WireUnit(1 / 32), WireUnit(1 / 32, 0.5))
    random = np.random.default_rng(1)
    xy_px = np.column_stack([0.5 + random.integers(0, 1024 * 32, 20) / 32, random.integers(0, 768 * 32, 20) / 32])
    brightness = np.arange(20, 0, -1.0)
    panorama = Panorama(0, xy_px, brightness, wire_rows=random.permutation(20))
    counts = sensor.counts([panorama]).values.tolist()
    places, seen = import_module("gse_solvers.pinhole").brightest_first(sensor.document(), counts)
    assert [counts[place][2] for place in places] == brightness.tolist()
    expected = camera.directions(xy_px)
    assert np.allclose(seen[:, :2] / camera.focal_length_px, expected[:, :2] / expected[:, 2:], rtol=0, atol=1e-12)


def _panoramas(camera, limit, count):
    sky = sky_of(load_catalog(stars=40_000), camera, limit)
    rng = np.random.default_rng(5)
    noise = Noise(limit=limit, whole_pixels=False)
    frames = [made_frame(sky, camera, direction, noise, rng) for direction in spiral_directions(count)]
    return frames, [Panorama(n, frame.xy_px, frame.brightness, n) for n, frame in enumerate(frames)]


@pytest.mark.parametrize("name", ["tetra3rs", "cedar-solve"])
def test_a_solver_from_pypi_finds_boresight_and_roll(name):
    pytest.importorskip(name.partition("-")[0] if name == "tetra3rs" else "tetra3")
    mirrored = Camera(1024, 1024, FIELD_14_DEG.focal_length_px, (500.0, 520.0), mirrored=name == "tetra3rs")
    frames, panoramas = _panoramas(mirrored, 6.0, 12)
    plug = plug_of(IdentifierOptions(algorithm="external", entry_point=name), SensorDescription("made", mirrored, 4096))
    identifier = RunningIdentifier(plug, 20.0)
    given = identifier.answers(panoramas)
    identifier.close()
    attitudes = [one.answer.attitude if isinstance(one.answer, ExternalAnswer) else None for one in given]
    found = [(frame, attitude) for frame, attitude in zip(frames, attitudes, strict=True) if attitude]
    assert len(found) >= 9
    for frame, attitude in found:
        error = attitude.icrs_to_sensor @ frame.icrs_to_sensor.T
        across, roll = np.hypot(*error[:2, 2]), np.arctan2(error[1, 0], error[0, 0])
        assert np.degrees(across) < 0.02
        assert abs(np.degrees(roll)) < 0.2


def test_the_stars_that_tetra3rs_names_are_those_of_the_station_s_catalogue():
    pytest.importorskip("tetra3rs")
    frames, panoramas = _panoramas(FIELD_14_DEG, 6.0, 6)
    plug = plug_of(IdentifierOptions(algorithm="external", entry_point="tetra3rs"), SENSOR)
    identifier = RunningIdentifier(plug, 20.0)
    given = identifier.answers(panoramas)
    identifier.close()
    named = right = 0
    for frame, one in zip(frames, given, strict=True):
        if isinstance(one.answer, ExternalAnswer) and one.answer.attitude:
            named += len(one.answer.objects)
            right += int((frame.ids[one.answer.objects] == one.answer.star_ids).sum())
    assert named > 40
    assert right > 0.9 * named
    assert json.dumps(identifier.identity)
