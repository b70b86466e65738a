"""The robust identifier: right on the whole sky, never fooled, clear about bad input."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from gse.catalog import StarCatalog, load_catalog
from gse.evaluation.frames import Conditions, FrameMaker, Optics, SimulatedFrame
from gse.identifier import Identification, ObjectColumns, Reason, Unidentified
from gse.identifier.robust import KnownSensor, RobustIdentifier
from gse.values.attitude import Attitude, solve_attitude
from gse.values.camera import Camera
from gse.values.spiral import spiral_directions

ARCSEC = math.radians(1 / 3600)
WIDE = Optics("14 deg", Camera(1024, 1024, 512 / math.tan(math.radians(7)), (511.5, 511.5)), 6.0)
ROUND = Optics("8 deg round", Camera(1024, 1024, 512 / math.tan(math.radians(4)), (511.5, 511.5)), 6.0, 8.0)
NOMINAL = Conditions()
FALSE_3 = Conditions(false_objects=3)
MIRROR = np.array([-1.0, 1.0, 1.0])


@pytest.fixture(scope="module")
def catalog() -> StarCatalog:
    return load_catalog()


def bright(catalog: StarCatalog) -> int:
    return int((catalog.magnitude < 6.9).sum())


@pytest.fixture(scope="module")
def wide(catalog: StarCatalog) -> RobustIdentifier:
    return RobustIdentifier(WIDE.camera, catalog, stars=bright(catalog))


@pytest.fixture(scope="module")
def narrow(catalog: StarCatalog) -> RobustIdentifier:
    return RobustIdentifier(ROUND.camera, catalog, stars=bright(catalog), field_of_view_deg=8.0)


def frames(optics: Optics, conditions: Conditions, catalog: StarCatalog, count: int) -> list[SimulatedFrame]:
    maker = FrameMaker(optics, conditions, catalog)
    return [maker.frame(at, np.random.default_rng([3, k])) for k, at in enumerate(spiral_directions(count))]


def error_deg(identifier: RobustIdentifier, answer: Identification, frame: SimulatedFrame) -> float:
    found = attitude_of(identifier, answer, frame.directions_sensor)
    return math.degrees(math.dist(found.boresight_icrs, frame.attitude.boresight_icrs))


def attitude_of(identifier: RobustIdentifier, answer: Identification, directions: NDArray[np.float64]) -> Attitude:
    return solve_attitude(directions[answer.objects], identifier.catalog.icrs[answer.stars], 15 * ARCSEC)


def random_panorama(
    optics: Optics, rng: np.random.Generator, count: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    xy = np.empty((0, 2))
    while len(xy) < count:
        more = np.floor(rng.uniform(0, 1024, (count, 2)))
        xy = np.concatenate([xy, more[optics.sees(more)]])[:count]
    return optics.camera.directions(xy), np.sort(4096 * 10 ** (-0.4 * rng.uniform(0, 4, count)))[::-1]


@pytest.mark.parametrize("conditions", [NOMINAL, FALSE_3, Conditions("worst", 50.0, 0.5, 8, 0.2)])
def test_a_wide_field_is_right_everywhere(wide: RobustIdentifier, catalog: StarCatalog, conditions: Conditions) -> None:
    for frame in frames(WIDE, conditions, catalog, 150):
        answer = wide.identify(frame.directions_sensor, frame.brightness)
        assert isinstance(answer, Identification)
        assert error_deg(wide, answer, frame) < 0.05


def test_a_narrow_field_of_few_stars_is_right_or_refused(narrow: RobustIdentifier, catalog: StarCatalog) -> None:
    hard = Conditions("hard", 30.0, 0.3, 3, 0.2)
    seen = [frame for frame in frames(ROUND, hard, catalog, 150) if frame.real_stars >= 4]
    answers = [narrow.identify(frame.directions_sensor, frame.brightness) for frame in seen]
    right = 0
    for frame, answer in zip(seen, answers, strict=True):
        if isinstance(answer, Identification):
            assert error_deg(narrow, answer, frame) < 0.5
            right += error_deg(narrow, answer, frame) < 0.05
    assert right / len(seen) > 0.85


def test_hot_pixels_brighter_than_the_stars_do_not_hide_the_sky(wide: RobustIdentifier, catalog: StarCatalog) -> None:
    """12 hot pixels, among the brightest of 30 objects, and two more false ones: none of them helps to find the sky."""
    rng = np.random.default_rng(8)
    hot = WIDE.camera.directions(np.floor(rng.uniform(0, 1024, (12, 2))))
    hot_index = rng.uniform(1000, 4000, 12)
    for frame in frames(WIDE, Conditions(false_objects=2, missing_share=0.05), catalog, 40):
        brightness = np.concatenate([frame.brightness, hot_index])
        brightest = np.argsort(-brightness, kind="stable")[:30]
        directions = np.concatenate([frame.directions_sensor, hot])[brightest]
        answer = wide.identify(directions, brightness[brightest])
        assert isinstance(answer, Identification)
        found = attitude_of(wide, answer, directions)
        assert math.degrees(math.dist(found.boresight_icrs, frame.attitude.boresight_icrs)) < 0.05


def test_the_stars_are_named_and_false_objects_are_not(wide: RobustIdentifier, catalog: StarCatalog) -> None:
    named = right = 0
    for frame in frames(WIDE, FALSE_3, catalog, 60):
        answer = wide.identify(frame.directions_sensor, frame.brightness)
        assert isinstance(answer, Identification)
        named += len(answer.stars)
        right += int((wide.catalog.ids[answer.stars] == frame.star_ids[answer.objects]).sum())
    assert right / named > 0.99
    assert named > 60 * 20


@pytest.mark.parametrize("at", [(0.0, 90.0), (0.0, -90.0), (0.0, 0.0), (359.99, 12.0), (0.01, -45.0)])
def test_poles_and_right_ascension_0_are_no_special_case(
    wide: RobustIdentifier, catalog: StarCatalog, at: tuple[float, float]
) -> None:
    maker = FrameMaker(WIDE, FALSE_3, catalog)
    frame = maker.frame(Attitude.from_angles(*at, 0.0).boresight_icrs, np.random.default_rng(9))
    answer = wide.identify(frame.directions_sensor, frame.brightness)
    assert isinstance(answer, Identification)
    assert error_deg(wide, answer, frame) < 0.05


def test_a_mirrored_image_is_named_so(wide: RobustIdentifier, catalog: StarCatalog) -> None:
    for frame in frames(WIDE, NOMINAL, catalog, 10):
        answer = wide.identify(frame.directions_sensor * MIRROR, frame.brightness)
        assert isinstance(answer, Unidentified)
        assert answer.reason is Reason.MIRRORED
        assert "mirrored" in answer.detail


def test_an_image_is_called_mirrored_where_chance_would_do_so_in_one_of_a_hundred_thousand(
    wide: RobustIdentifier, catalog: StarCatalog
) -> None:
    """Few objects of flipped skies, on either side of that limit."""
    called = {True: 0, False: 0}
    for frame in frames(WIDE, NOMINAL, catalog, 16):
        for count in (3, 4, 5):
            upright, brightness = frame.directions_sensor[:count], frame.brightness[:count]
            if not isinstance(wide.identify(upright, brightness), Identification):
                continue
            least = wide.best_false_match_probability(upright, brightness)
            answer = wide.identify(upright * MIRROR, brightness)
            if isinstance(answer, Unidentified) and answer.reason is Reason.MIRRORED:
                assert least <= 1e-5
                called[True] += 1
            elif least > 1e-5:
                called[False] += 1
    assert min(called.values()) > 2


def test_a_focal_length_half_a_percent_off_is_borne(wide: RobustIdentifier, catalog: StarCatalog) -> None:
    for frame in frames(WIDE, Conditions(false_objects=3, focal_length_error=0.005), catalog, 60):
        answer = wide.identify(frame.directions_sensor, frame.brightness)
        assert isinstance(answer, Identification)
        assert error_deg(wide, answer, frame) < 0.05
        assert len(answer.stars) > 0.8 * frame.real_stars


def test_random_objects_are_never_stars(wide: RobustIdentifier, narrow: RobustIdentifier) -> None:
    rng = np.random.default_rng(1)
    for identifier, optics, counts in ((wide, WIDE, (4, 8, 30)), (narrow, ROUND, (3, 4, 6, 10))):
        for count in counts * 8:
            assert isinstance(identifier.identify(*random_panorama(optics, rng, count)), Unidentified)


def test_chance_bounds_how_often_random_objects_would_be_answered(
    narrow: RobustIdentifier, catalog: StarCatalog
) -> None:
    """Three objects are the most dangerous: a share of p or less reaches a chance of p, for p from 0.3 to 0.01."""
    for identifier in (narrow, told(catalog, 10.0, 0.1), told(catalog, 50.0, 0.1)):
        rng = np.random.default_rng(2)
        chances = [identifier.best_false_match_probability(*random_panorama(ROUND, rng, 3)) for _ in range(200)]
        for false_match_probability in (0.3, 0.1, 0.03, 0.01):
            assert (np.array(chances) <= false_match_probability).mean() <= false_match_probability


def test_brightness_alone_does_not_make_or_break_an_answer(wide: RobustIdentifier, catalog: StarCatalog) -> None:
    rng = np.random.default_rng(5)
    for frame in frames(WIDE, NOMINAL, catalog, 20):
        shuffled = np.sort(rng.permutation(frame.brightness))[::-1]
        order = rng.permutation(len(shuffled))
        answer = wide.identify(frame.directions_sensor[order], shuffled)
        assert isinstance(answer, Identification)


def told(catalog: StarCatalog, arcsec: float, magnitude: float) -> RobustIdentifier:
    """The identifier of the narrow field, its sensor's noise and zero point known."""
    sigma_px = arcsec * ARCSEC * ROUND.camera.focal_length_px
    zero_point = ROUND.magnitude_limit - 7.5 + 2.5 * math.log10(4096)
    known = KnownSensor(sigma_px, zero_point, magnitude_sigma=math.hypot(magnitude, 0.05))
    stars = int((catalog.magnitude < ROUND.magnitude_limit + 0.6 + 3 * magnitude).sum())
    return RobustIdentifier(ROUND.camera, catalog, stars=stars, field_of_view_deg=8.0, known=known)


@pytest.mark.parametrize(("magnitude", "least"), [(0.1, 0.9), (0.5, 0.85)])
def test_what_is_known_of_the_sensor_lets_three_stars_be_named(
    catalog: StarCatalog, magnitude: float, least: float
) -> None:
    conditions = Conditions("sub-pixel", 10.0, magnitude, whole_pixels=False)
    identifier = told(catalog, 10.0, magnitude)
    few = [frame for frame in frames(ROUND, conditions, catalog, 1000) if frame.real_stars == 3]
    answers = [identifier.identify(frame.directions_sensor, frame.brightness) for frame in few]
    named = [(f, a) for f, a in zip(few, answers, strict=True) if isinstance(a, Identification)]
    assert len(few) > 20
    assert len(named) / len(few) > least
    assert all(error_deg(identifier, answer, frame) < 0.1 for frame, answer in named)


@pytest.mark.parametrize("direction", [8, 81, 137, 238, 320])
def test_a_handful_of_stars_is_found_among_eight_false_objects(
    narrow: RobustIdentifier, catalog: StarCatalog, direction: int
) -> None:
    """To find them takes the passes for few objects; these panoramas have 13 to 15."""
    maker = FrameMaker(ROUND, Conditions("worst", 50.0, 0.5, 8, 0.2), catalog)
    frame = maker.frame(spiral_directions(600)[direction], np.random.default_rng([3, direction]))
    answer = narrow.identify(frame.directions_sensor, frame.brightness)
    assert 5 <= frame.real_stars <= 7
    assert isinstance(answer, Identification)
    assert error_deg(narrow, answer, frame) < 0.1


def test_stars_at_the_edges_of_a_barrel_distortion_lie_in_the_field(catalog: StarCatalog) -> None:
    camera = replace(WIDE.camera, radial_distortion=(-0.08, 0.0))
    identifier = RobustIdentifier(camera, catalog, stars=bright(catalog))
    for frame in frames(Optics("barrel", camera, 6.0), NOMINAL, catalog, 20):
        answer = identifier.identify(frame.directions_sensor, frame.brightness)
        assert isinstance(answer, Identification)
        assert error_deg(identifier, answer, frame) < 0.05


def test_many_panoramas_in_one_call_give_the_answers_one_by_one(wide: RobustIdentifier, catalog: StarCatalog) -> None:
    """Sky, mirrored sky, random objects, none, too few, too many, one beside the detector, and a NaN, all mixed."""
    seen = frames(WIDE, FALSE_3, catalog, 20)
    panoramas = [(frame.directions_sensor, frame.brightness) for frame in seen]
    panoramas += [(frame.directions_sensor * MIRROR, frame.brightness) for frame in seen[:3]]
    panoramas += [random_panorama(WIDE, np.random.default_rng(6), count) for count in (3, 5, 30, 31)]
    panoramas += [
        (frame.directions_sensor[:count], frame.brightness[:count]) for frame in seen[:2] for count in (0, 2, 4, 9)
    ]
    count = len(seen[0].brightness)
    for row in (0, count - 1):
        beside = seen[0].directions_sensor.copy()
        beside[row] = np.sqrt(0.5), 0.0, np.sqrt(0.5)
        panoramas.append((beside, seen[0].brightness))
    panoramas.append((np.where(seen[0].directions_sensor > 0.1, np.nan, seen[0].directions_sensor), seen[0].brightness))
    panoramas = [panoramas[k] for k in np.random.default_rng(7).permutation(len(panoramas))]
    many = wide.identify_many(ObjectColumns.from_panoramas(panoramas))
    ones = [wide.identify(directions, brightness) for directions, brightness in panoramas]
    assert len(many) == len(ones)
    reasons = {one.reason for one in ones if isinstance(one, Unidentified)}
    assert reasons >= {Reason.TOO_FEW, Reason.NO_MATCH, Reason.MIRRORED, Reason.SENSOR_FAULT}
    details = {one.detail for one in ones if isinstance(one, Unidentified)}
    assert details >= {f"object {row} lies outside the detector" for row in (0, count - 1)}
    for one, answer in zip(ones, many, strict=True):
        if isinstance(one, Unidentified):
            assert answer == one
            continue
        assert isinstance(answer, Identification)
        assert (answer.objects.tolist(), answer.stars.tolist()) == (one.objects.tolist(), one.stars.tolist())
        assert answer.false_match_probability == one.false_match_probability


def test_no_panoramas_have_no_answers(wide: RobustIdentifier) -> None:
    assert len(wide.identify_many(ObjectColumns.from_panoramas([]))) == 0
    empty = (np.empty((0, 3)), np.empty(0))
    assert [type(answer) for answer in wide.identify_many(ObjectColumns.from_panoramas([empty, empty]))] == [
        Unidentified,
        Unidentified,
    ]


def test_bad_input_is_refused_and_never_a_star(wide: RobustIdentifier, catalog: StarCatalog) -> None:
    frame = frames(WIDE, NOMINAL, catalog, 3)[1]
    directions, brightness = frame.directions_sensor, frame.brightness
    broken = directions.copy()
    broken[4] = np.nan
    endless = brightness.copy()
    endless[0] = np.inf
    behind = directions.copy()
    behind[2] = (0.0, 0.6, -0.8)
    beside = directions.copy()
    beside[2] = (0.0, 0.6, 0.8)
    one_pixel = np.repeat(directions[:1], 30, axis=0)
    for objects, values, reason in (
        (broken, brightness, Reason.SENSOR_FAULT),
        (directions, endless, Reason.SENSOR_FAULT),
        (behind, brightness, Reason.SENSOR_FAULT),
        (beside, brightness, Reason.SENSOR_FAULT),
        (directions, np.zeros_like(brightness), Reason.SENSOR_FAULT),
        (np.repeat(directions[:1], 31, axis=0), np.arange(31.0, 0, -1), Reason.SENSOR_FAULT),
        (one_pixel, np.arange(30.0, 0, -1), Reason.NO_MATCH),
        (directions[:0], brightness[:0], Reason.TOO_FEW),
        (directions[:2], brightness[:2], Reason.TOO_FEW),
    ):
        answer = wide.identify(objects, values)
        assert isinstance(answer, Unidentified)
        assert answer.reason is reason
    with pytest.raises(ValueError, match="expected"):
        wide.identify(directions[:, :2], brightness)


def test_an_object_sent_ten_times_is_one_star(wide: RobustIdentifier, catalog: StarCatalog) -> None:
    for frame in frames(WIDE, NOMINAL, catalog, 5):
        rows = np.concatenate([np.zeros(10, dtype=np.int64), np.arange(1, 15)])
        answer = wide.identify(frame.directions_sensor[rows], frame.brightness[rows])
        assert isinstance(answer, Identification)
        assert len(set(answer.stars.tolist())) == len(answer.stars)
        found = attitude_of(wide, answer, frame.directions_sensor[rows])
        assert math.degrees(math.dist(found.boresight_icrs, frame.attitude.boresight_icrs)) < 0.05


def test_a_copy_of_the_sky_that_fits_as_well_makes_the_answer_ambiguous() -> None:
    """Two skies a quarter turn apart with the same stars: no panorama can tell them from each other."""
    rng = np.random.default_rng(11)
    half = rng.normal(size=(1500, 3))
    half /= np.linalg.norm(half, axis=1)[:, None]
    half = half[half[:, 2] > 0.6]
    turn = np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, -1]])
    icrs = np.concatenate([half, half @ turn])
    magnitude = np.tile(rng.uniform(2, 6, len(half)), 2)
    order = np.argsort(magnitude, kind="stable")
    sky = StarCatalog("twins", 2016.0, np.arange(1, len(icrs) + 1), icrs[order], magnitude[order])
    identifier = RobustIdentifier(WIDE.camera, sky)
    frame = FrameMaker(WIDE, Conditions(position_arcsec=5.0), sky).frame(
        np.array([0.0, 0.0, 1.0]), np.random.default_rng(1)
    )
    for count in (5, len(frame.brightness)):
        answer = identifier.identify(frame.directions_sensor[:count], frame.brightness[:count])
        assert isinstance(answer, Unidentified)
        assert answer.reason is Reason.AMBIGUOUS


def best_by_trying_all_pairs(
    sky: StarCatalog, directions: NDArray[np.float64], gate_rad: float
) -> tuple[int, Attitude]:
    """Every pair of stars for the two objects farthest apart; most objects on a star within the gate wins."""
    apart = np.arccos(np.clip(directions @ directions.T, -1, 1))
    i, j = np.unravel_index(np.argmax(apart), apart.shape)
    best = (0, Attitude(np.eye(3), np.eye(3)))
    for s in range(len(sky)):
        distance = np.arccos(np.clip(sky.icrs @ sky.icrs[s], -1, 1))
        for t in np.flatnonzero(np.abs(distance - apart[i, j]) < 2 * gate_rad):
            attitude = solve_attitude(directions[[i, j]], sky.icrs[[s, t]], gate_rad)
            nearest = (directions @ attitude.icrs_to_sensor @ sky.icrs.T).max(axis=1)
            best = max(best, (int((nearest > math.cos(gate_rad)).sum()), attitude), key=lambda one: one[0])
    return best


def test_the_answer_is_that_of_trying_every_pair_of_stars() -> None:
    rng = np.random.default_rng(21)
    icrs = rng.normal(size=(400, 3))
    icrs /= np.linalg.norm(icrs, axis=1)[:, None]
    sky = StarCatalog("small", 2016.0, np.arange(1, 401), icrs, np.sort(rng.uniform(1, 6, 400)))
    wide = Optics("40 deg", Camera(1024, 1024, 512 / math.tan(math.radians(20)), (511.5, 511.5)), 6.5)
    identifier = RobustIdentifier(wide.camera, sky)
    gate_rad = 2.5 / wide.camera.focal_length_px
    for frame in frames(wide, Conditions(magnitude=0.1), sky, 12):
        fitting, attitude = best_by_trying_all_pairs(sky, frame.directions_sensor, gate_rad)
        answer = identifier.identify(frame.directions_sensor, frame.brightness)
        assert isinstance(answer, Identification)
        found = attitude_of(identifier, answer, frame.directions_sensor)
        assert np.abs(found.icrs_to_sensor - attitude.icrs_to_sensor).max() < 2 * gate_rad
        assert len(answer.stars) >= fitting - 1
