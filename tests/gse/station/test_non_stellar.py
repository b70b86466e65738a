"""Objects that are not stars are named: hot pixels, planets, the Moon."""

from dataclasses import replace

import astropy.units as u
import numpy as np
import pytest
from astropy.coordinates import EarthLocation, get_body
from astropy.time import Time
from astropy.utils import iers
from skies.one_by_one import others_of

from gse.identifier import Answers, Identification, Reason, Unidentified
from gse.station.non_stellar import (
    HOT_FRAMES,
    HOT_MOTION_PX,
    HOT_PIXEL,
    MAX_HOT,
    MAX_REMEMBERED,
    MOON_WITHIN_RAD,
    PLANET_WITHIN_PX,
    SAME_PIXEL_PX,
    UNKNOWN,
    NonStellarObjects,
)
from gse.truth.solar_system import BODIES, bodies_icrs
from gse.values.attitude import Attitude
from gse.values.camera import Camera
from gse.values.instant import NS_PER_DAY, NS_PER_S, from_text
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


@pytest.mark.parametrize(("every", "last"), [(1, HOT_PIXEL), (3, UNKNOWN)])
def test_a_hot_pixel_is_there_in_most_of_the_frames(every, last):
    names = NonStellarObjects(CAMERA, SITE)
    for place in range(61):
        shown = [(200.0, 300.0)] if place % every == 0 else []
        found = kinds(names, 30.0 * place, *shown, (10.0 + 9 * place, 900.0))
    assert found == [last, UNKNOWN]


# Limits of a hot pixel and of a body

SKY_PX_PER_S = 15.041 / (CAMERA.pixel_rad * 180 / np.pi * 3600)
"""By which the sky moves in a second, on the equator."""


@pytest.mark.parametrize(
    ("step_s", "last"),
    [(1.03 * HOT_MOTION_PX / SKY_PX_PER_S / 8, HOT_PIXEL), (0.97 * HOT_MOTION_PX / SKY_PX_PER_S / 8, UNKNOWN)],
)
def test_the_sky_must_have_moved_by_some_pixels_behind_a_hot_pixel(step_s, last):
    names = NonStellarObjects(CAMERA, SITE)
    assert [kinds(names, step_s * place, (511.0, 511.0)) for place in range(9)][-1] == [last]


def test_more_than_one_hot_pixel_is_known_each_by_both_of_its_coordinates():
    names = NonStellarObjects(CAMERA, SITE, ((200, 300), (700, 100)))
    found = kinds(names, 0, (200.0, 300.0), (700.0, 100.0), (200.0, 100.0), (700.0, 300.0))
    assert found == [HOT_PIXEL, HOT_PIXEL, UNKNOWN, UNKNOWN]


@pytest.mark.parametrize(
    ("off_px", "kind"),
    [(PLANET_WITHIN_PX - 0.1, "Jupiter"), (PLANET_WITHIN_PX + 0.1, UNKNOWN), (2.5, "Jupiter"), (6.0, UNKNOWN)],
)
def test_an_object_within_some_pixels_of_a_planet_is_it(off_px, kind):
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
    return looking_at(body_icrs(body, second))


def looking_at(direction):
    x, y, z = direction
    return Attitude.from_angles(np.degrees(np.arctan2(y, x)) % 360, np.degrees(np.arcsin(z)), 20.0)


def place_of(body, attitude, second=0.0):
    return CAMERA.pixels(body_icrs(body, second)[None] @ attitude.icrs_to_sensor.T)[0]


def test_counts_are_of_one_kind_for_each_panorama_also_for_those_at_the_end_without_objects():
    others = others_of([[(0, HOT_PIXEL), (3, UNKNOWN), (4, HOT_PIXEL)], [], [(1, "Moon"), (2, HOT_PIXEL)], []])
    assert others.count(HOT_PIXEL).tolist() == [2, 0, 1, 0]
    assert others.count("Moon").tolist() == [0, 0, 1, 0]
    assert others.count(HOT_PIXEL, np.array([True, True, False, True, False])).tolist() == [1, 0, 0, 0]
    assert others[2] == ((1, "Moon"), (2, HOT_PIXEL))


def test_so_many_hot_pixels_are_kept():
    crowd = [(2 * (place % 500), 2 * (place // 500)) for place in range(MAX_HOT + 2)]
    names = NonStellarObjects(CAMERA, SITE)
    for place in range(HOT_FRAMES + 1):
        found = kinds(names, 600.0 * place, *map(tuple, np.array(crowd, dtype=float)))
    assert found.count(HOT_PIXEL) == MAX_HOT


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
    """One look a minute: the last finds it; the frame before has it as unknown, the frame after it as hot."""
    names = NonStellarObjects(CAMERA, SITE)
    looks_s = [60.0 * look for look in range(HOT_FRAMES)]
    seconds = [*looks_s[:-1], looks_s[-2] + 0.5, looks_s[-1], looks_s[-1] + 0.5]
    places = [panorama(second, (200.0, 300.0)) for second in seconds]
    found = names_of(names, places, [identified()] * len(seconds), [sky(second) for second in seconds])
    assert [kind for ((_, kind),) in found] == [UNKNOWN] * HOT_FRAMES + [HOT_PIXEL] * 2


@pytest.mark.parametrize("first_ns", [0, NS_PER_S, NIGHT_NS])
def test_the_first_frame_is_looked_at_and_then_one_a_second_whichever_way_the_clock_steps(first_ns):
    """Every second one of the first seven, and then each: the sky has moved far whenever it is looked at."""
    after_ns = [0, NS_PER_S - 1, NS_PER_S, 2 * NS_PER_S - 1, 2 * NS_PER_S + 1, NS_PER_S + 2, NS_PER_S + 1]
    after_ns += [(2 + look) * NS_PER_S + 1 for look in range(HOT_FRAMES - 4)]
    places = [replace(panorama(0, (200.0, 300.0)), utc_ns=first_ns + one) for one in after_ns]
    skies = [sky(3600.0 * number) for number in range(len(places))]
    found = names_of(NonStellarObjects(CAMERA, SITE), places, [identified()] * len(places), skies)
    assert [kind for ((_, kind),) in found] == [UNKNOWN] * (len(places) - 1) + [HOT_PIXEL]


@pytest.mark.parametrize(
    ("utc_ns", "middle_ns"),
    [
        (NIGHT_NS - 1, NIGHT_NS - 300 * NS_PER_S),
        (NIGHT_NS, NIGHT_NS + 300 * NS_PER_S),
        (NIGHT_NS + 600 * NS_PER_S - 1, NIGHT_NS + 300 * NS_PER_S),
        (0, 300 * NS_PER_S),
        (NS_PER_DAY, NS_PER_DAY + 300 * NS_PER_S),
    ],
)
def test_bodies_stand_where_they_do_in_the_middle_of_ten_minutes(utc_ns, middle_ns):
    """The Moon moves 2.5 arcmin in the five minutes between, which is 11 pixels: these are a pixel within reach."""
    moon = bodies_icrs(SITE, middle_ns)[BODIES.index("Moon")]
    attitude = looking_at(moon)
    reach_px = MOON_WITHIN_RAD / CAMERA.pixel_rad - 1
    seen = CAMERA.pixels(moon[None] @ attitude.icrs_to_sensor.T) + reach_px * np.array(
        [[1, 0], [-1, 0], [0, 1], [0, -1]]
    )
    places = replace(panorama(0, *seen), utc_ns=utc_ns)
    found = name(NonStellarObjects(CAMERA, SITE), places, NONE, attitude, truth_known=True)
    assert [kind for _, kind in found] == ["Moon"] * 4


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


@pytest.mark.parametrize("kind", [HOT_PIXEL, UNKNOWN])
@pytest.mark.parametrize("side", [1, -1])
def test_an_object_within_some_tenths_of_a_pixel_of_a_known_one_is_hot(side, kind):
    """Beside pixel 0, where the place is the difference itself."""
    off = side * (SAME_PIXEL_PX if kind is HOT_PIXEL else SAME_PIXEL_PX + 0.0001)
    assert kinds(NonStellarObjects(CAMERA, SITE, ((0, 0),)), 0, (off, 0.0), (0.0, off)) == [kind, kind]


def test_a_whole_pixel_beside_a_hot_one_is_not_it():
    assert kinds(NonStellarObjects(CAMERA, SITE, ((200, 200),)), 0, (200.4, 200.4), (201.0, 200.0)) == [
        HOT_PIXEL,
        UNKNOWN,
    ]


# Pixels on which objects were seen, in frames a minute apart, in which the sky moves by 18 pixels


def stays(frames):
    """Whether an object has become a hot pixel, in the last of some frames by their numbers."""
    names = NonStellarObjects(CAMERA, SITE)
    for number in range(1, max(frames) + 1):
        seen = [(200.0, 300.0)] if number in frames else []
        found = kinds(names, 60.0 * number, (10.0 + 9 * number, 900.0), *seen)
    return found[-1] == HOT_PIXEL


FIRST = tuple(range(1, HOT_FRAMES))
"""One fewer than are needed."""
TWICE = 2 * HOT_FRAMES
"""The last of twice as many frames as are needed."""


@pytest.mark.parametrize(
    ("frames", "is_hot"),
    [
        (FIRST, False),
        ((*FIRST, HOT_FRAMES), True),
        ((*FIRST, TWICE - 1), True),  # in most of them
        ((*FIRST, TWICE), False),  # as many as without it: seen anew at the last
        ((*FIRST, TWICE, *range(TWICE + 1, TWICE + HOT_FRAMES - 1)), False),
        ((*FIRST, TWICE, *range(TWICE + 1, TWICE + HOT_FRAMES)), True),
        ((1, *range(4, HOT_FRAMES + 3)), False),  # two of four: seen anew at the fourth
        ((1, *range(4, HOT_FRAMES + 4)), True),
        (tuple(range(5, HOT_FRAMES + 4)), False),  # frames before the first sighting do not count
        (tuple(range(5, HOT_FRAMES + 5)), True),
    ],
)
def test_an_object_stays_that_was_there_often_enough_and_in_most_frames_since_its_first(frames, is_hot):
    assert stays(frames) is is_hot


def test_five_frames_on_a_pixel_make_a_hot_one():
    assert [stays(range(1, count + 1)) for count in (4, 5)] == [False, True]


def test_the_sky_is_compared_with_that_of_the_sighting_from_which_on_is_counted():
    """Seen once, and anew from the fourth frame on: the sky moved between, and stands still since."""
    names = NonStellarObjects(CAMERA, SITE)
    for number in range(HOT_FRAMES + 4):
        places = panorama(60.0 * number, (900.0, 9.0 * number), *([] if number in (1, 2) else [(7.0, 9.0)]))
        last = name(names, places, NONE, sky(3600.0 if number else 0.0), truth_known=False)
    assert last == ((0, UNKNOWN), (1, UNKNOWN))


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
        ((0.0, 0.25), (SAME_PIXEL_PX, 0.25), True),
        ((0.25, 0.0), (0.25, SAME_PIXEL_PX), True),
        ((0.0, 0.25), (SAME_PIXEL_PX + 0.01, 0.25), False),
        ((0.25, 0.0), (0.25, SAME_PIXEL_PX + 0.01), False),
        ((199.6, 300.0), (200.4, 300.0), False),  # they round to one pixel, but are 0.8 apart
        ((200.0, 299.6), (200.0, 300.4), False),
        ((200.0, 300.0), (201.0, 300.0), False),
        ((200.0, 300.0), (200.0, 301.0), False),
    ],
)
def test_sub_pixel_positions_close_together_are_one_pixel_whatever_they_round_to(first, then, is_same):
    names = NonStellarObjects(CAMERA, SITE)
    for number in range(HOT_FRAMES):
        last = kinds(names, 60.0 * number, then if number else first)
    assert last == [HOT_PIXEL if is_same else UNKNOWN]


def crowd_of(count):
    return [(2.0 * (place % 100), 2.0 * (place // 100)) for place in range(count)]


@pytest.mark.parametrize(("more", "hot"), [(0, MAX_HOT), (1, 0)])
def test_only_so_many_pixels_are_remembered(more, hot):
    """One more, and each is forgotten before it comes again."""
    names = NonStellarObjects(CAMERA, SITE)
    for number in range(HOT_FRAMES):
        last = kinds(names, 60.0 * number, *crowd_of(MAX_REMEMBERED + more))
    assert last.count(HOT_PIXEL) == hot


def test_the_pixel_seen_longest_ago_is_forgotten_first():
    """Two of a full memory are seen again before a new one comes: they are kept, the third is forgotten."""
    names, crowd = NonStellarObjects(CAMERA, SITE), crowd_of(MAX_REMEMBERED)
    for number in range(HOT_FRAMES - 1):
        kinds(names, 60.0 * number, *crowd)
    found = kinds(names, 60.0 * HOT_FRAMES, *crowd[:2], (500.0, 500.0))
    assert found == [HOT_PIXEL, HOT_PIXEL, UNKNOWN]
    found = kinds(names, 60.0 * HOT_FRAMES + 60.0, *crowd[3:5], crowd[0], crowd[2])
    assert found == [HOT_PIXEL, HOT_PIXEL, HOT_PIXEL, UNKNOWN]
