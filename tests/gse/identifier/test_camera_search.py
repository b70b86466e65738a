"""The camera of panoramas that the stated one cannot identify."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gse.catalog import load_catalog, mission_catalog
from gse.identifier.camera_search import _trials, find_camera, find_unknown_camera
from gse.values.camera import Camera
from gse.values.panorama import Panorama

STATED = Camera(1024, 1024, 4169.9, (511.5, 511.5))


@pytest.fixture(scope="module")
def catalog():
    return mission_catalog(load_catalog(), STATED)


def panorama_of(camera, catalog, seed):
    rotation = Rotation.random(random_state=seed).as_matrix()
    xy = camera.pixels(catalog.icrs @ rotation.T)
    xy = np.rint(xy[camera.contains(xy)][:28])
    return Panorama(0, xy, np.linspace(4000, 300, len(xy)))


@pytest.mark.parametrize(("scale", "mirrored"), [(1.03, False), (0.97, True), (0.78, False), (1.24, False)])
def test_a_focal_length_up_to_a_quarter_off_is_found_with_its_value(catalog, scale, mirrored):
    true = replace(STATED, focal_length_px=scale * STATED.focal_length_px, mirrored=mirrored)
    found = find_camera([panorama_of(true, catalog, seed) for seed in (1, 2)], STATED, catalog)
    assert found.camera.focal_length_px == pytest.approx(true.focal_length_px, rel=5e-4)
    assert found.camera.mirrored is mirrored
    assert found.identified == 2


@pytest.mark.parametrize("false_px", [[], [[700.0, 300.0]]])
def test_the_camera_of_a_picture_is_found_also_where_the_brightest_object_is_no_star(catalog, false_px):
    true = Camera(768, 1024, 2900.0, (511.5, 383.5), mirrored=True)
    xy_px = np.concatenate([np.reshape(false_px, (-1, 2)), panorama_of(true, catalog, 4).xy_px])
    seen = Panorama(0, xy_px, np.linspace(4000, 300, len(xy_px)))
    found = find_unknown_camera(seen, true.columns, true.rows, load_catalog(stars=20_000))
    assert found.focal_length_px == pytest.approx(true.focal_length_px, rel=1e-3)
    assert found.mirrored


def test_the_camera_is_found_where_most_stars_are_saturated(catalog):
    true = replace(STATED, focal_length_px=1.1 * STATED.focal_length_px)
    seen = panorama_of(true, catalog, 5)
    assert len(seen.brightness) >= 23
    saturated = replace(seen, brightness=np.minimum(seen.brightness, seen.brightness[21]))
    found = find_camera([saturated], STATED, catalog)
    assert found.camera.focal_length_px == pytest.approx(true.focal_length_px, rel=5e-4)


def test_random_objects_have_no_camera(catalog):
    rng = np.random.default_rng(5)
    random = [Panorama(0, rng.uniform(0, 1023, (30, 2)), np.linspace(4000, 300, 30)) for _ in range(3)]
    assert find_camera(random, STATED, catalog) is None


def test_the_trials_go_from_the_camera_outwards():
    scales = [round(trial.focal_length_px / STATED.focal_length_px, 6) for trial in _trials(STATED)]
    assert scales[:5] == [1, 1.004, 0.996, 1.008, 0.992]
    assert max(scales) - 1 == pytest.approx(1 - min(scales)) == pytest.approx(0.25, abs=0.003)
