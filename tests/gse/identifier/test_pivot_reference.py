"""The compiled pivot and match-group searches give the answer of the plain ones, object for object."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from skies.made_frames import Noise, made_frame, sky_of
from skies.reference_neighbour import onboard_table
from skies.reference_pivot import ReferencePivot, magnitude_gate

from gse.catalog import brightest_per_field, load_catalog, mission_catalog
from gse.identifier.consistency import separations
from gse.identifier.match_group import MAGNITUDE_GATE
from gse.identifier.pivot import FOUND, NO_GATE, TIE, Cells, Gates, PivotObjects, PivotSky, search
from gse.identifier.tables import build_pair_table
from gse.values.camera import Camera
from gse.values.spiral import spiral_directions

CAMERA = Camera(1024, 1024, 2400.0, (511.5, 511.5))
FIELD_RAD = 2 * np.arctan(np.hypot(512, 512) / 2400)
OUTCOMES = {"found": FOUND, "tie": TIE}


@pytest.fixture(scope="module")
def source():
    return load_catalog()


@pytest.fixture(scope="module")
def stars(source):
    return brightest_per_field(mission_catalog(source, CAMERA, 700), np.radians(24), directions=2000)


@pytest.fixture(scope="module")
def sky(stars):
    cells = Cells.for_field(FIELD_RAD)
    table = build_pair_table(stars, FIELD_RAD)
    return PivotSky(table, stars.icrs, stars.magnitude, cells.index(stars.icrs), cells.around())


@pytest.fixture(scope="module")
def plain(stars, sky):
    touching = [np.flatnonzero(row).tolist() for row in sky.around]
    table = onboard_table(stars.icrs.tolist(), FIELD_RAD)
    return lambda tolerance: ReferencePivot(stars.icrs.tolist(), table, sky.cell.tolist(), touching, tolerance)


def assert_same(sky, plain, directions, brightness, gates):
    angles = separations(directions)
    objects = PivotObjects(angles.cosine, angles.sine, -2.5 * np.log10(brightness))
    outcome, rows, named = search(objects, sky, gates, np.ones(len(sky.around), np.bool_))
    zero_point = None if np.isnan(gates.zero_point) else gates.zero_point
    gate = magnitude_gate(objects.magnitude.tolist(), sky.magnitude.tolist(), gates.magnitude, zero_point)
    angles_urad = (1e6 * np.arctan2(angles.sine, angles.cosine)).tolist()
    expected, expected_named = plain(gates.tolerance_urad).search(angles_urad, gate)
    assert (outcome == FOUND, outcome == TIE) == (expected == "found", expected == "tie")
    assert dict(zip(rows.tolist(), named.tolist(), strict=True)) == expected_named
    return outcome == FOUND


@pytest.mark.parametrize(
    ("tolerance_px", "magnitude", "zero_point"),
    [
        (1.5, NO_GATE, 0.0),
        (12.0, NO_GATE, 0.0),
        (1.5, MAGNITUDE_GATE, float("nan")),
        (1.5, MAGNITUDE_GATE, 8.5),
    ],
)
def test_same_answers_over_the_sky(source, sky, plain, tolerance_px, magnitude, zero_point):
    seen, rng = sky_of(source, CAMERA, 4.5), np.random.default_rng(3)
    gates, found = Gates(1e6 * tolerance_px / 2400, magnitude, zero_point), 0
    for false_objects, boresight in enumerate(spiral_directions(15)):
        frame = made_frame(seen, CAMERA, boresight, Noise(false_objects=false_objects % 3, limit=4.5), rng)
        if len(frame.brightness) >= 3:
            found += assert_same(sky, plain, CAMERA.directions(frame.xy_px), frame.brightness, gates)
    assert found >= 6


@settings(max_examples=20)
@given(
    pixels=st.lists(st.tuples(st.integers(0, 1023), st.integers(0, 1023)), min_size=3, max_size=12, unique=True),
    tolerance_px=st.sampled_from([1.5, 4.0]),
    gate=st.sampled_from([NO_GATE, MAGNITUDE_GATE]),
)
def test_same_answers_on_any_objects(sky, plain, pixels, tolerance_px, gate):
    brightness = np.linspace(3000, 300, len(pixels))
    gates = Gates(1e6 * tolerance_px / 2400, gate, float("nan"))
    assert_same(sky, plain, CAMERA.directions(np.array(pixels, dtype=float)), brightness, gates)
