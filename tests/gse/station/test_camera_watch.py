"""A camera that the station file states wrongly."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from skies.one_by_one import Made

from gse.catalog import load_catalog, mission_catalog
from gse.station.camera_watch import CameraWatch, _in_words, _side
from gse.station.events import StationKind
from gse.station.results import Status
from gse.values.camera import Camera
from gse.values.identifier_options import IdentifierOptions
from gse.values.instant import NS_PER_S
from gse.values.panorama import Panorama

TRUE = Camera(1024, 1024, 4300.0, (511.5, 511.5))
NEIGHBOUR = IdentifierOptions()
STATED = replace(TRUE, focal_length_px=1.03 * 4300.0)


@pytest.fixture(scope="module")
def catalog():
    return mission_catalog(load_catalog(), TRUE)


@pytest.fixture(scope="module")
def stars_px(catalog):
    xy = TRUE.pixels(catalog.icrs @ Rotation.random(random_state=3).as_matrix().T)
    return xy[TRUE.contains(xy)][:28]


def seen(stars_px, at_s, status=Status.NO_MATCH):
    panorama = Panorama(round(at_s * NS_PER_S), stars_px, np.linspace(4000, 300, len(stars_px)))
    return Made(panorama, status, "", "neighbour")


def look(watch, result):
    return "".join(text for _, (_, text) in watch.look([result]))


def test_it_is_named_with_value_and_size_five_seconds_after_the_first_panorama(catalog, stars_px):
    watch = CameraWatch(STATED, catalog, NEIGHBOUR)
    texts = [look(watch, seen(stars_px, at_s)) for at_s in (100, 104.9, 105.1, 200)]
    assert [bool(text) for text in texts] == [False, False, True, False]
    assert "focal_length_px: 4300." in texts[2]
    assert "stated is 4429, 3.0 % too long" in texts[2]


def test_a_short_session_is_looked_at_when_it_ends(catalog, stars_px):
    watch = CameraWatch(STATED, catalog, NEIGHBOUR)
    assert look(watch, seen(stars_px, 0)) == ""
    kind, text = watch.finish()
    assert (kind, "3.0 % too long" in text) == (StationKind.WRONG_CAMERA, True)
    assert watch.finish() is None


def test_an_answer_ends_the_watch(catalog, stars_px):
    watch = CameraWatch(STATED, catalog, NEIGHBOUR)
    look(watch, seen(stars_px, 0, Status.IDENTIFIED))
    look(watch, seen(stars_px, 1))
    assert look(watch, seen(stars_px, 100)) == ""
    assert watch.finish() is None


def test_an_answer_by_luck_does_not_end_it(catalog, stars_px):
    watch = CameraWatch(STATED, catalog, NEIGHBOUR)
    look(watch, seen(stars_px, 0))
    look(watch, seen(stars_px, 1, Status.IDENTIFIED))
    assert "3.0 % too long" in look(watch, seen(stars_px, 7))


def test_a_search_that_finds_nothing_is_repeated_after_ten_times_as_long(catalog, stars_px):
    watch, noise = CameraWatch(STATED, catalog, NEIGHBOUR), np.random.default_rng(1).uniform(0, 1023, (28, 2))
    assert look(watch, seen(noise, 0)) == look(watch, seen(noise, 6)) == ""
    assert look(watch, seen(stars_px, 49)) == ""
    assert "3.0 % too long" in look(watch, seen(stars_px, 51))


def test_six_objects_are_too_few_to_begin_the_watch(catalog, stars_px):
    watch = CameraWatch(STATED, catalog, NEIGHBOUR)
    assert look(watch, seen(stars_px[:6], 0)) == look(watch, seen(stars_px, 6)) == ""
    assert "3.0 % too long" in look(watch, seen(stars_px, 11.1))


@pytest.mark.parametrize(
    ("scale", "text"),
    [
        (1.0, "the image is mirrored: the stars fit sensor.mirrored: true"),
        (1.0015, "the image is mirrored: the stars fit sensor.mirrored: true"),
        (1.02, "the image is mirrored: the stars fit sensor.mirrored: true and sensor.focal_length_px: 43"),
    ],
)
def test_a_mirrored_image_is_no_focal_length_as_well_unless_that_is_wrong_too(catalog, stars_px, scale, text):
    stated = replace(TRUE, focal_length_px=scale * TRUE.focal_length_px)
    watch = CameraWatch(stated, catalog, NEIGHBOUR)
    assert watch.look([seen(stars_px * (-1, 1) + (TRUE.columns - 1, 0), 0)]) == []
    kind, said = watch.finish()
    assert kind is StationKind.MIRRORED
    assert said.startswith(text)
    assert ("focal" in said) == (scale > 1.01)


@pytest.mark.parametrize(("off", "is_said"), [(0.0, False), (0.0015, False), (0.01, True)])
@pytest.mark.parametrize("algorithm", ["neighbour", "external"])
def test_a_camera_that_is_as_stated_has_nothing_to_do_with_an_identifier_that_is_silent(
    catalog, stars_px, off, is_said, algorithm
):
    options = IdentifierOptions(algorithm=algorithm, command=("never",) if algorithm == "external" else None)
    watch = CameraWatch(replace(TRUE, focal_length_px=(1 + off) * TRUE.focal_length_px), catalog, options)
    assert watch.look([seen(stars_px, 0)]) == []
    assert (watch.finish() is not None) is is_said


def test_another_camera_is_not_named_where_the_identifier_does_not_answer_with_it_either(catalog, stars_px):
    watch = CameraWatch(STATED, catalog, IdentifierOptions(min_fit=29))  # more stars than there are objects
    assert watch.look([seen(stars_px, 0)]) == []
    assert watch.finish() is None


# A detector of another size


def of_size(columns, rows, principal_point_px=None, focal_length_px=TRUE.focal_length_px):
    middle = ((columns - 1) / 2, (rows - 1) / 2)
    return replace(
        TRUE,
        columns=columns,
        rows=rows,
        principal_point_px=principal_point_px or middle,
        focal_length_px=focal_length_px,
    )


@pytest.mark.parametrize(
    ("stated", "fits"),
    [
        (of_size(2048, 2048), "sensor.columns: 1024, sensor.rows: 1024, sensor.principal_point_px: [511.5, 511.5]"),
        (of_size(2048, 2048, (511.5, 511.5)), "sensor.columns: 1024, sensor.rows: 1024"),
        (of_size(1536, 1024), "sensor.columns: 1024, sensor.rows: 1024, sensor.principal_point_px: [511.5, 511.5]"),
        (of_size(512, 512), "sensor.columns: 1024, sensor.rows: 1024, sensor.principal_point_px: [511.5, 511.5]"),
        (
            of_size(2048, 2048, focal_length_px=2 * TRUE.focal_length_px),  # binned, and stated as it is not
            "sensor.columns: 1024, sensor.rows: 1024, sensor.principal_point_px: [511.5, 511.5], "
            "sensor.focal_length_px: 4300.0",
        ),
    ],
)
def test_a_detector_of_another_size_is_named_with_what_fits(catalog, stars_px, stated, fits):
    watch = CameraWatch(stated, mission_catalog(load_catalog(), stated), NEIGHBOUR)
    assert watch.look([seen(stars_px, 0)]) == []
    kind, text = watch.finish()
    x, y = stars_px.max(axis=0)
    where = f"objects lie at x up to {x:.0f} and y up to {y:.0f} px, and the station file states {stated.columns}"
    assert kind is StationKind.WRONG_DETECTOR
    assert text.startswith(where)
    assert text.split("the stars fit ")[1].startswith(fits)


def test_what_hides_a_part_of_the_field_makes_no_smaller_detector(catalog):
    wide = mission_catalog(load_catalog(), replace(TRUE, focal_length_px=8600.0))
    xy = TRUE.pixels(wide.icrs @ Rotation.random(random_state=3).as_matrix().T)
    xy = xy[TRUE.contains(xy) & (xy[:, 0] < 400)][:28]
    watch = CameraWatch(TRUE, catalog, NEIGHBOUR)
    watch.look([seen(xy, 0)])
    assert len(xy) > 12
    assert watch.finish() is None


@pytest.mark.parametrize(("beyond", "frames", "is_said"), [(2, 10, False), (3, 10, True), (3, 6, True), (3, 5, False)])
def test_objects_beyond_the_detector_are_told_where_most_panoramas_have_three(stars_px, beyond, frames, is_said):
    inside = stars_px[(stars_px < 767).all(axis=1)]
    wide = np.concatenate([inside, np.column_stack([np.linspace(769, 900, beyond), np.full(beyond, 50.0)])])
    watch = CameraWatch(of_size(768, 768), FEW_STARS, NEIGHBOUR)
    results = [seen(wide if k < frames else inside, 0.1 * k, STATUS_OF[k >= 5]) for k in range(10)]
    told = watch.look(results)
    assert [(k, kind) for k, (kind, _) in told] == [(9, StationKind.WRONG_DETECTOR)] * is_said
    assert all("sensor.columns may be 1024, and sensor.rows 768" in text for _, (_, text) in told)


STATUS_OF = (Status.NO_MATCH, Status.IDENTIFIED)


@pytest.mark.parametrize(
    ("stated", "reach_px", "side"),
    [
        (1024, 1000.0, 1024),
        (1024, 921.0, 1024),
        (1200, 1015.0, 1024),
        (1024, 1024.5, 1024),
        (1024, 1024.6, 1088),
        (2048, 1000.0, 1024),
        (2048, 650.0, 682),
        (1280, 1015.0, 1024),
        (512, 1023.0, 1024),
        (1000, 1023.0, 1024),
        (768, 1000.0, 1024),
    ],
)
def test_a_side_is_a_simple_share_of_the_stated_one_or_a_round_number(stated, reach_px, side):
    assert _side(stated, reach_px) == side


# Of few objects and few stars, which fit no camera

FEW_STARS = load_catalog(stars=200)


def few(objects, at_s, status=Status.NO_MATCH):
    return seen(np.random.default_rng(2).uniform(0, 1023, (objects, 2)), at_s, status)


@pytest.mark.parametrize(("objects", "begins"), [(6, False), (7, True), (8, True)])
def test_seven_objects_begin_the_watch(objects, begins):
    watch = CameraWatch(STATED, FEW_STARS, NEIGHBOUR)
    assert watch.look([few(objects, 3)]) == []
    assert (watch._first is not None) is begins


@pytest.mark.parametrize(
    ("times_s", "after_s"),
    [
        ([0, 4.999999999], 5.0),
        ([0, 5.0], 50.0),
        ([100, 105.0, 149.999999999], 50.0),
        ([100, 105.0, 150.0], 500.0),
    ],
)
def test_it_is_searched_after_five_seconds_then_after_fifty_of_the_first_panorama(times_s, after_s):
    watch = CameraWatch(STATED, FEW_STARS, NEIGHBOUR)
    assert watch.look([few(7, at_s) for at_s in times_s]) == []
    assert watch._after_s == after_s


@pytest.mark.parametrize("status", [Status.TOO_FEW, Status.AMBIGUOUS, Status.SENSOR_FAULT, Status.IDENTIFIER_FAULT])
def test_only_panoramas_without_a_match_are_looked_at(status):
    watch = CameraWatch(STATED, FEW_STARS, NEIGHBOUR)
    watch.look([few(7, 0, status)])
    assert (watch._first, watch.finish()) == (None, None)


def test_of_results_that_come_together_all_are_looked_at_until_enough_are_identified():
    watch = CameraWatch(STATED, FEW_STARS, NEIGHBOUR)
    assert watch.look([few(7, 0), few(7, 1), *[few(7, 2, Status.IDENTIFIED)] * 5, few(7, 60)]) == []
    assert watch._latest.utc_ns == NS_PER_S
    assert watch.finish() is None
    assert watch.look([few(7, 100), few(7, 200)]) == []
    assert watch._after_s == 5.0


@pytest.mark.parametrize(
    ("stated_px", "is_mirrored", "said"),
    [
        (4429.0, False, "the stars fit sensor.focal_length_px: 4300.0; stated is 4429, 3.0 % too long"),
        (4171.0, False, "the stars fit sensor.focal_length_px: 4300.0; stated is 4171, 3.0 % too short"),
        (4295.7, False, "the stars fit sensor.focal_length_px: 4300.0; stated is 4295.7, 0.1 % too short"),
        (4300.0, True, "the image is mirrored: the stars fit sensor.mirrored: true"),
        (
            4429.0,
            True,
            "the image is mirrored: the stars fit sensor.mirrored: true and sensor.focal_length_px: 4300.0; "
            "stated is 4429, 3.0 % too long",
        ),
    ],
)
def test_a_camera_is_told_with_its_value_and_by_how_much_the_stated_one_is_off(stated_px, is_mirrored, said):
    kind, text = _in_words(replace(TRUE, focal_length_px=stated_px), replace(TRUE, mirrored=is_mirrored))
    assert (kind, text) == (StationKind.MIRRORED if is_mirrored else StationKind.WRONG_CAMERA, said)


def test_an_image_that_is_stated_as_mirrored_and_is_not_is_told_so():
    _, text = _in_words(replace(TRUE, mirrored=True), TRUE)
    assert text == "the image is mirrored: the stars fit sensor.mirrored: false"
