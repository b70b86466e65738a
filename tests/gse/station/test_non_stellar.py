"""Objects that are not stars are named: hot pixels, planets, the Moon."""

import astropy.units as u
import numpy as np
import pytest
from astropy.coordinates import EarthLocation, get_body
from astropy.time import Time
from astropy.utils import iers
from skies.one_by_one import others_of

from gse.identifier import Answers, Identification, Reason, Unidentified
from gse.station.non_stellar import HOT_PIXEL, MAX_REMEMBERED, UNKNOWN, NonStellarObjects, _Sightings
from gse.truth.solar_system import BODIES, bodies_icrs
from gse.values.attitude import Attitude
from gse.values.camera import Camera
from gse.values.instant import NS_PER_S, from_text
from gse.values.panorama import Panorama, Panoramas
from gse.values.site import Site

CAMERA = Camera(1024, 1024, 4170.0, (511.5, 511.5))
SITE = Site(latitude_deg=-6.53, longitude_deg=106.7)
NIGHT_NS = from_text("2026-03-20T15:00:00Z")
NONE = np.zeros(0, dtype=np.int64)
JUPITER_ICRS = (106.1724, 22.9685)
"""RA and DE in degrees at that instant: in Gemini, at 7 h 05 min, as almanacs have it."""


def sky(second: float) -> Attitude:
    return Attitude.from_angles(150.0 + second * 15.041 / 3600, -6.5, 180.0)


def panorama(second: float, *xy_px: tuple[float, float]) -> Panorama:
    places = np.array(xy_px)
    return Panorama(NIGHT_NS + round(second * 1e9), places, np.full(len(places), 100.0))


def kinds(names: NonStellarObjects, second: float, *xy_px: tuple[float, float]) -> list[str]:
    found = name(names, panorama(second, *xy_px), NONE, sky(second), truth_known=False)
    return [kind for _, kind in found]


def name(names, panorama, identified, attitude, *, truth_known):
    directions = CAMERA.directions(panorama.xy_px)
    answers = Answers.from_answers([Identification(identified, identified, 0.0)])
    turned = attitude.icrs_to_sensor[None]
    return names.name(Panoramas.from_panoramas([panorama]), directions, answers, turned, truth_known=truth_known)[0]


def test_what_stays_on_its_pixel_while_the_sky_moves_is_a_hot_pixel() -> None:
    names = NonStellarObjects(CAMERA, SITE)
    assert kinds(names, 0, (200.0, 300.0)) == [UNKNOWN]
    for second in range(1, 12):
        assert kinds(names, second, (200.0, 300.0)) == [UNKNOWN]
    for second in range(12, 25):
        last = kinds(names, second, (200.0, 300.0))
    assert last == [HOT_PIXEL]


def test_what_moves_with_the_sky_is_no_hot_pixel() -> None:
    names = NonStellarObjects(CAMERA, SITE)
    star = CAMERA.directions(np.array([[200.0, 300.0]])) @ sky(0).icrs_to_sensor
    for second in range(60):
        x, y = CAMERA.pixels(star @ sky(second).icrs_to_sensor.T)[0]
        assert kinds(names, second, (x, y)) == [UNKNOWN]


def test_a_sky_that_stands_still_proves_no_hot_pixel() -> None:
    names = NonStellarObjects(CAMERA, SITE)
    for second in range(60):
        still = name(names, panorama(second, (200.0, 300.0)), NONE, sky(0), truth_known=False)
        assert still == ((0, UNKNOWN),)


def test_a_known_hot_pixel_is_named_at_once() -> None:
    assert kinds(NonStellarObjects(CAMERA, SITE, ((200, 300),)), 0, (200.0, 300.0)) == [HOT_PIXEL]


def test_a_planet_stands_where_the_ephemeris_has_it() -> None:
    attitude = Attitude.from_angles(*JUPITER_ICRS, 0.0)
    named = name(
        NonStellarObjects(CAMERA, SITE), panorama(0, (511.5, 511.5), (600.0, 600.0)), NONE, attitude, truth_known=True
    )
    assert named == ((0, "Jupiter"), (1, UNKNOWN))


def test_identified_objects_are_left_out() -> None:
    named = name(
        NonStellarObjects(CAMERA, SITE), panorama(0, (1.0, 1.0), (2.0, 9.0)), np.array([0]), sky(0), truth_known=False
    )
    assert named == ((1, UNKNOWN),)


@pytest.mark.parametrize("x", [200.4, 200.6])
def test_a_sub_pixel_position_at_the_edge_of_a_pixel_is_still_the_same_pixel(x: float) -> None:
    names = NonStellarObjects(CAMERA, SITE)
    for second in range(30):
        last = kinds(names, second, (200.5 if second % 2 else x, 300.0))
    assert last == [HOT_PIXEL]


def test_two_stars_that_follow_each_other_over_a_pixel_are_no_hot_pixel():
    names = NonStellarObjects(CAMERA, SITE)
    stars = CAMERA.directions(np.array([[200.0, 300.0], [206.2, 300.0]])) @ sky(0).icrs_to_sensor
    for tenth in range(600):
        attitude = sky(tenth / 10)
        xy_px = np.rint(CAMERA.pixels(stars @ attitude.icrs_to_sensor.T))
        assert name(names, panorama(tenth / 10, *xy_px), NONE, attitude, truth_known=False) == (
            (0, UNKNOWN),
            (1, UNKNOWN),
        )


def test_more_pixels_than_are_remembered_forget_the_oldest():
    names = NonStellarObjects(CAMERA, SITE)
    generator = np.random.default_rng(1)
    for second in range(40):
        crowd = generator.integers(0, 1024, (400, 2)).astype(float)
        last = kinds(names, second, (200.0, 300.0), *crowd)
    assert last[0] == HOT_PIXEL
    assert set(last[1:]) == {UNKNOWN}


@pytest.mark.parametrize(("frames", "last"), [(4, UNKNOWN), (5, HOT_PIXEL)])
def test_five_frames_on_one_pixel_are_needed_however_far_the_sky_has_moved(frames, last):
    names = NonStellarObjects(CAMERA, SITE)
    assert [kinds(names, 60.0 * place, (200.0, 300.0)) for place in range(frames)][-1] == [last]


@pytest.mark.parametrize(("every", "last"), [(1, HOT_PIXEL), (3, UNKNOWN)])
def test_a_hot_pixel_is_there_in_most_of_the_frames(every, last):
    names = NonStellarObjects(CAMERA, SITE)
    for place in range(61):
        shown = [(200.0, 300.0)] if place % every == 0 else []
        found = kinds(names, 30.0 * place, *shown, (10.0 + 9 * place, 900.0))
    assert found == [last, UNKNOWN]


# Limits of a hot pixel and of a body, from both sides

SKY_PX_PER_S = 15.041 / (CAMERA.pixel_rad * 180 / np.pi * 3600)
"""By which the sky moves in a second, on the equator."""


@pytest.mark.parametrize(("step_s", "last"), [(6.2 / SKY_PX_PER_S / 8, HOT_PIXEL), (5.8 / SKY_PX_PER_S / 8, UNKNOWN)])
def test_the_sky_must_have_moved_by_six_pixels_behind_a_hot_pixel(step_s, last):
    names = NonStellarObjects(CAMERA, SITE)
    assert [kinds(names, step_s * place, (511.0, 511.0)) for place in range(9)][-1] == [last]


@pytest.mark.parametrize(("x", "kind"), [(200.6, HOT_PIXEL), (200.61, UNKNOWN), (199.4, HOT_PIXEL), (199.39, UNKNOWN)])
@pytest.mark.parametrize("along", [0, 1])
def test_an_object_within_six_tenths_of_a_pixel_of_a_hot_one_is_hot(x, kind, along):
    place = (x, 200.0) if along else (200.0, x)
    assert kinds(NonStellarObjects(CAMERA, SITE, ((200, 200),)), 0, place) == [kind]


def test_more_than_one_hot_pixel_is_known_each_by_both_of_its_coordinates():
    names = NonStellarObjects(CAMERA, SITE, ((200, 300), (700, 100)))
    found = kinds(names, 0, (200.0, 300.0), (700.0, 100.0), (200.0, 100.0), (700.0, 300.0))
    assert found == [HOT_PIXEL, HOT_PIXEL, UNKNOWN, UNKNOWN]


def test_frames_within_a_second_are_one_look():
    """A sensor of 20 Hz: five frames on a pixel within a second, and the sky far behind it since, are two looks."""
    names = NonStellarObjects(CAMERA, SITE)
    for second in (0, 0.2, 0.4, 0.6, 0.8, 0.99, 3600):
        last = kinds(names, second, (200.0, 300.0))
    assert last == [UNKNOWN]


@pytest.mark.parametrize(("off_px", "kind"), [(3.9, "Jupiter"), (4.1, UNKNOWN)])
def test_an_object_within_four_pixels_of_a_planet_is_it(off_px, kind):
    attitude = Attitude.from_angles(*JUPITER_ICRS, 0.0)
    (_, _), (_, found) = name(
        NonStellarObjects(CAMERA, SITE),
        panorama(0, (900.0, 900.0), tuple(place_of("Jupiter", attitude) + np.array([off_px, 0.0]))),
        NONE,
        attitude,
        truth_known=True,
    )
    assert found == kind


@pytest.mark.parametrize(("off_deg", "kind"), [(0.9, "Moon"), (1.1, UNKNOWN)])
def test_an_object_within_a_degree_of_the_moon_is_it(off_deg, kind):
    attitude = towards("Moon")
    off_px = np.radians(off_deg) / CAMERA.pixel_rad
    (found,) = name(
        NonStellarObjects(CAMERA, SITE),
        panorama(0, tuple(place_of("Moon", attitude) - np.array([0.0, off_px]))),
        NONE,
        attitude,
        truth_known=True,
    )
    assert found == (0, kind)


def test_a_body_is_looked_for_only_where_the_truth_is_known():
    attitude = towards("Moon")
    places = panorama(0, tuple(place_of("Moon", attitude)))
    assert name(NonStellarObjects(CAMERA, SITE), places, NONE, attitude, truth_known=False) == ((0, UNKNOWN),)


@pytest.mark.parametrize("hours", [0.0, 6.0, 3.0])
def test_the_moon_is_named_hours_later_where_it_is_then(hours):
    """It moves by half a degree in an hour: three degrees in six."""
    names = NonStellarObjects(CAMERA, SITE)
    for second in (0.0, 3600 * hours):
        attitude = towards("Moon", second)
        (found,) = name(names, panorama(second, (511.5, 511.5)), NONE, attitude, truth_known=True)
        assert found == (0, "Moon")


def body_icrs(body, second):
    """As astropy sees it, to 0.02 deg."""
    place = EarthLocation.from_geodetic(SITE.longitude_deg * u.deg, SITE.latitude_deg * u.deg)
    with iers.conf.set_temp("auto_download", False), iers.conf.set_temp("auto_max_age", None):
        time = Time("2026-03-20T15:00:00", scale="utc") + second * u.s
        seen = get_body(body, time, place)
    vector = seen.cartesian.xyz.value
    return vector / np.linalg.norm(vector)


def towards(body, second=0.0):
    x, y, z = body_icrs(body, second)
    return Attitude.from_angles(np.degrees(np.arctan2(y, x)) % 360, np.degrees(np.arcsin(z)), 20.0)


def place_of(body, attitude, second=0.0):
    return CAMERA.pixels(body_icrs(body, second)[None] @ attitude.icrs_to_sensor.T)[0]


def test_counts_are_of_one_kind_for_each_panorama():
    others = others_of([[(0, HOT_PIXEL), (3, UNKNOWN), (4, HOT_PIXEL)], [], [(1, "Moon"), (2, HOT_PIXEL)]])
    assert others.count(HOT_PIXEL).tolist() == [2, 0, 1]
    assert others.count("Moon").tolist() == [0, 0, 1]
    assert others.count(HOT_PIXEL, np.array([True, True, False, True, False])).tolist() == [1, 0, 0]
    assert others[2] == ((1, "Moon"), (2, HOT_PIXEL))


def test_a_thousand_hot_pixels_are_kept():
    crowd = [(2 * (place % 500), 2 * (place // 500)) for place in range(1002)]
    names = NonStellarObjects(CAMERA, SITE)
    for place in range(6):
        found = kinds(names, 600.0 * place, *map(tuple, np.array(crowd, dtype=float)))
    assert found.count(HOT_PIXEL) == 1000


# Many panoramas at once

NO_ANSWER = Unidentified(Reason.NO_MATCH, "made on purpose")


def names_of(names, panoramas, answers, attitudes, *, truth_known=False):
    """The objects without a star of panoramas that come in one call."""
    many = Panoramas.from_panoramas(panoramas)
    turned = np.array([attitude.icrs_to_sensor for attitude in attitudes])
    found = names.name(
        many, CAMERA.directions(many.xy_px), Answers.from_answers(answers), turned, truth_known=truth_known
    )
    return [found[k] for k in range(len(panoramas))]


def identified(*objects):
    rows = np.array(objects, dtype=np.int64)
    return Identification(rows, rows, 0.0)


def test_an_object_keeps_its_row_within_its_own_panorama():
    names = NonStellarObjects(CAMERA, SITE, ((700, 100),))
    places = [
        panorama(0.0, (10.0, 10.0), (700.0, 100.0), (30.0, 30.0)),
        panorama(0.1, (50.0, 50.0), (700.0, 100.0)),
        panorama(0.2, (700.0, 100.0), (60.0, 60.0), (70.0, 70.0)),
    ]
    found = names_of(names, places, [identified(0), NO_ANSWER, identified(2)], [sky(0.0)] * 3)
    assert found == [((1, HOT_PIXEL), (2, UNKNOWN)), (), ((0, HOT_PIXEL), (1, UNKNOWN))]


def test_known_hot_pixels_are_named_in_frames_between_two_looks_too():
    names = NonStellarObjects(CAMERA, SITE, ((700, 100), (20, 20)))
    both = (700.0, 100.0), (20.0, 20.0)
    assert names_of(names, [panorama(0.0, *both)], [identified()], [sky(0.0)]) == [((0, HOT_PIXEL), (1, HOT_PIXEL))]
    between = names_of(names, [panorama(0.5, *both)] * 2, [identified()] * 2, [sky(0.5)] * 2)
    assert between == [((0, HOT_PIXEL), (1, HOT_PIXEL))] * 2


def test_a_pixel_is_hot_from_the_frame_in_which_it_is_found_on_within_a_call_too():
    """One look a minute: the fifth finds it; the frame before has it as unknown, the frame after it as hot."""
    names = NonStellarObjects(CAMERA, SITE)
    seconds = [0.0, 60.0, 120.0, 180.0, 180.5, 240.0, 240.5]
    places = [panorama(second, (200.0, 300.0)) for second in seconds]
    found = names_of(names, places, [identified()] * 7, [sky(second) for second in seconds])
    assert [kind for ((_, kind),) in found] == [UNKNOWN] * 5 + [HOT_PIXEL] * 2


@pytest.mark.parametrize("first_ns", [0, NS_PER_S, NIGHT_NS])
def test_the_first_frame_is_looked_at_and_then_one_a_second_whichever_way_the_clock_steps(first_ns):
    names = NonStellarObjects(CAMERA, SITE)
    after_ns = [0, NS_PER_S - 1, NS_PER_S, 2 * NS_PER_S - 1, 2 * NS_PER_S + 1, NS_PER_S + 2, NS_PER_S + 1]
    assert names._looks([first_ns + one for one in after_ns]) == [0, 2, 4, 6]


def test_bodies_are_those_of_the_middle_of_ten_minutes():
    """The Moon moves 2.5 arcmin in the five minutes between, which is 11 pixels."""
    names = NonStellarObjects(CAMERA, SITE)
    moon, attitude = BODIES.index("Moon"), towards("Moon")
    seen = np.array([attitude.icrs_to_sensor] * 3)
    utc_ns = NIGHT_NS + np.array([-1, 0, 600 * NS_PER_S - 1])
    found = [(k, place) for k, name, place, _ in names._bodies_px(np.arange(3), utc_ns, seen) if name == "Moon"]
    assert [k for k, _ in found] == [0, 1, 2]
    for (_, place), middle_s in zip(found, (-300, 300, 300), strict=True):
        middle = bodies_icrs(SITE, NIGHT_NS + middle_s * NS_PER_S)[moon]
        assert place == pytest.approx(CAMERA.pixels(middle[None] @ attitude.icrs_to_sensor.T)[0], abs=1e-9)


def test_a_body_is_found_in_its_own_panorama_of_those_that_have_an_answer():
    """The first has none, the second looks elsewhere, the third at Jupiter, the last two at the Moon, hours later."""
    away, later = sky(0.0), 3 * 3600.0
    attitudes = [towards("Jupiter"), away, towards("Jupiter"), towards("Moon", later), towards("Moon", later)]
    seconds = [0.0, 0.0, 0.0, later, later]
    places = [panorama(second, (511.5, 511.5), (511.5, 900.0)) for second in seconds]
    answers = [NO_ANSWER, *[identified()] * 4]
    found = names_of(NonStellarObjects(CAMERA, SITE), places, answers, attitudes, truth_known=True)
    nothing = (0, UNKNOWN), (1, UNKNOWN)
    assert found == [(), nothing, ((0, "Jupiter"), (1, UNKNOWN)), *[((0, "Moon"), (1, UNKNOWN))] * 2]


def test_a_planet_on_the_other_side_of_the_equator_is_in_the_field_too():
    attitude = Attitude.from_angles(4.3, 0.1, 20.0)
    places = panorama(0.0, tuple(place_of("Saturn", attitude)))
    assert name(NonStellarObjects(CAMERA, SITE), places, NONE, attitude, truth_known=True) == ((0, "Saturn"),)


def test_counts_have_a_place_for_panoramas_without_objects_at_the_end():
    assert others_of([[(0, HOT_PIXEL)], [], []]).count(HOT_PIXEL).tolist() == [1, 0, 0]


@pytest.mark.parametrize(("off", "kind"), [(0.6, HOT_PIXEL), (0.6001, UNKNOWN)])
def test_six_tenths_of_a_pixel_are_still_the_same_pixel_as_a_known_one(off, kind):
    """Beside pixel 0, where 0.6 is the difference itself."""
    assert kinds(NonStellarObjects(CAMERA, SITE, ((0, 0),)), 0, (off, 0.0), (0.0, off)) == [kind, kind]


# Pixels on which objects were seen, with a sky that moves by one radian a frame or stands still

MOVED = np.array([[2.0, 0.0, 0.0]])
"""How far the sky goes on in a frame of these tests; a pixel is hot where it has moved by more than one."""


def stays(frames, *, place=(200.0, 300.0), sightings=None):
    """Whether an object stays on its pixel, in the last of some frames by their numbers."""
    sightings = sightings or _Sightings(1.0)
    for number in range(1, max(frames) + 1):
        seen = np.array([place] if number in frames else []).reshape(-1, 2)
        last = sightings.stay(seen, (number * MOVED)[: len(seen)])
    return last.tolist()


@pytest.mark.parametrize(
    ("frames", "is_hot"),
    [
        ((1, 2, 3, 4), False),
        ((1, 2, 3, 4, 5), True),
        ((1, 3, 5, 7, 9), True),  # five of nine
        ((1, 2, 5, 6, 10), False),  # five of ten are not most of them: seen anew at the tenth
        ((1, 2, 5, 6, 10, 11, 12, 13), False),
        ((1, 2, 5, 6, 10, 11, 12, 13, 14), True),
        ((1, 4, 5, 6, 7), False),  # two of four: seen anew at the fourth
        ((1, 4, 5, 6, 7, 8), True),
        ((5, 6, 7, 8), False),  # frames before the first sighting do not count
        ((5, 6, 7, 8, 9), True),
    ],
)
def test_an_object_stays_that_was_there_in_five_frames_and_in_most_since_its_first(frames, is_hot):
    assert stays(frames) == [is_hot]


@pytest.mark.parametrize(("moved", "is_hot"), [(1.0, False), (1.0001, True)])
def test_the_sky_must_move_by_more_than_the_limit_between_the_first_sighting_and_the_last(moved, is_hot):
    sightings = _Sightings(1.0)
    for number in range(5):
        last = sightings.stay(np.array([[7.0, 9.0]]), np.array([[0.0, 3.0, moved if number == 4 else 0.0]]))
    assert last.tolist() == [is_hot]


def test_the_sky_is_compared_with_that_of_the_sighting_from_which_on_is_counted():
    """Seen once, and anew from the fourth frame on: the sky moved between, and stands still since."""
    sightings = _Sightings(1.0)
    for number in range(1, 9):
        seen = np.array([[7.0, 9.0]] if number not in (2, 3) else []).reshape(-1, 2)
        icrs = np.array([[1.0 if number == 1 else 9.0, 0.0, 0.0]])
        last = sightings.stay(seen, icrs[: len(seen)])
    assert last.tolist() == [False]


@pytest.mark.parametrize(
    ("first", "then", "is_same"),
    [
        ((200.4, 300.0), (200.6, 300.0), True),
        ((200.6, 300.0), (200.4, 300.0), True),
        ((200.0, 300.4), (200.0, 300.6), True),
        ((200.0, 300.6), (200.0, 300.4), True),
        ((200.4, 300.4), (200.6, 300.6), True),
        ((200.6, 300.6), (200.4, 300.4), True),
        ((200.4, 300.6), (200.6, 300.4), True),
        ((200.6, 300.4), (200.4, 300.6), True),
        ((0.0, 0.25), (0.6, 0.25), True),
        ((0.25, 0.0), (0.25, 0.6), True),
        ((0.0, 0.25), (0.61, 0.25), False),
        ((0.25, 0.0), (0.25, 0.61), False),
        ((199.6, 300.0), (200.4, 300.0), False),  # they round to one pixel, but are 0.8 apart
        ((200.0, 299.6), (200.0, 300.4), False),
        ((200.0, 300.0), (201.0, 300.0), False),
        ((200.0, 300.0), (200.0, 301.0), False),
    ],
)
def test_sub_pixel_positions_within_six_tenths_are_one_pixel_whatever_they_round_to(first, then, is_same):
    sightings = _Sightings(1.0)
    for number in range(5):
        last = sightings.stay(np.array([first if number == 0 else then]), number * MOVED)
    assert last.tolist() == [is_same]


@pytest.mark.parametrize(("more", "all_stay"), [(0, True), (1, False)])
def test_five_thousand_pixels_are_remembered(more, all_stay):
    """One more, and each is forgotten before it comes again."""
    assert MAX_REMEMBERED == 5000
    crowd = np.array([(place % 100, place // 100) for place in range(5000 + more)], dtype=float)
    sightings = _Sightings(1.0)
    for number in range(5):
        last = sightings.stay(crowd, np.repeat(number * MOVED, len(crowd), axis=0))
    assert last.all() == all_stay
    assert last.any() == all_stay


def test_the_pixel_seen_longest_ago_is_forgotten_first():
    """Two of a full memory are seen again before a new one comes: they are kept, the third is forgotten."""
    crowd = np.array([(place // 100, place % 100) for place in range(5000)], dtype=float)
    sightings = _Sightings(1.0)
    for number in range(4):
        sightings.stay(crowd, np.repeat(number * MOVED, len(crowd), axis=0))
    seen = np.array([*crowd[:2], (500.0, 500.0)])
    assert sightings.stay(seen, np.repeat(4 * MOVED, 3, axis=0)).tolist() == [True, True, False]
    again = np.array([*crowd[3:5], crowd[0], crowd[2]])
    assert sightings.stay(again, np.repeat(5 * MOVED, 4, axis=0)).tolist() == [True, True, True, False]


@pytest.mark.parametrize("cell", [0, 1, 2_956_698])
def test_bodies_are_looked_up_in_any_ten_minutes_those_of_1970_too(cell):
    names = NonStellarObjects(CAMERA, SITE)
    expected = bodies_icrs(SITE, (600 * cell + 300) * NS_PER_S)
    assert names._bodies_of(cell).tolist() == expected.tolist()
    assert names._bodies_of(cell) is names._bodies_of(cell)
