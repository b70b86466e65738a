"""The camera of panoramas that the stated one cannot identify."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gse.catalog import load_catalog, mission_catalog
from gse.identifier.camera_search import _trials, find_camera
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


def test_random_objects_have_no_camera(catalog):
    rng = np.random.default_rng(5)
    random = [Panorama(0, rng.uniform(0, 1023, (30, 2)), np.linspace(4000, 300, 30)) for _ in range(3)]
    assert find_camera(random, STATED, catalog) is None


def test_the_trials_go_from_the_camera_outwards_each_as_it_is_and_mirrored():
    trials = list(_trials(STATED))
    scales = [round(trial.focal_length_px / STATED.focal_length_px, 6) for trial in trials]
    assert scales[:6] == [1, 1, 1.004, 1.004, 0.996, 0.996]
    assert max(scales) - 1 == pytest.approx(1 - min(scales)) == pytest.approx(0.25, abs=0.003)
    assert [trial.mirrored for trial in trials[:4]] == [False, True, False, True]
