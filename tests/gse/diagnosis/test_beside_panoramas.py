"""The sensor's answers beside those here: each limit from both sides, by hand."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from skies.known_nights import session

from gse.diagnosis.sensor_findings import (
    _MOST_EARLY_S,
    Explained,
    _angle,
    _are_whole,
    _bias_or_delay,
    _is_whole_frames,
    _noisy,
    _of_pixels_arcsec,
    _Off,
    _offset,
    _one_sided,
    _roll_of_delay_arcsec,
    _turned,
    _typical,
    beside_panoramas,
)
from gse.station.own_answers import SensorAnswers
from gse.statistics.onboard_equivalence import OnboardEquivalence
from gse.statistics.sampling import percentiles

COUNT = 60
NONE = percentiles(np.zeros(0))
CENTROIDS = ((100.25, 50.5, 0.0, 0.0),)
WHOLE_20_ARCSEC = 49.4651 / math.sqrt(12) / math.sqrt(20)
"""What whole pixels of 49.5 arcsec leave of a boresight by twenty stars."""


def night(matches=()):
    made = session(COUNT, noise=0.0, matches=matches)
    made.frames.columns["matched"] = 20
    return made


@pytest.fixture(scope="module")
def still():
    """Sixty answers without any error of their own, of twenty stars each."""
    return night()


def answers(made, *, ra=0.0, de=0.0, roll=0.0, cross_x=0.0, count=COUNT):
    """Those of the sensor, off by so much from those here."""
    frames = made.frames.columns
    own = {name: np.full(COUNT, np.nan) for name in SensorAnswers.__slots__}
    off = {"d_ra_cosde_arcsec": ra, "d_de_arcsec": de, "d_roll_arcsec": roll, "cross_x_arcsec": cross_x}
    for name in ("ra_deg", "de_deg", "cross_y_arcsec", *off):
        own[name][:count] = (frames[name] + off.get(name, 0.0))[:count]
    return SensorAnswers(**own)


def at(de_deg, frame_s=2.0):
    """Columns of frames at a declination."""
    return {"de_true_deg": np.full(9, de_deg), "utc_ns": np.arange(9)[::-1] * round(frame_s * 1e9)}


def named(ra, de, *, de_deg=60.0, de_error=0.0, least=0.0, by_stars=0.0):
    return _bias_or_delay(at(de_deg), np.arange(9), _Off(ra, 0.0, de, de_error), least, by_stars)


@pytest.mark.parametrize(("ra", "side", "by_pole"), [(-75.205, "before", "-150.4"), (75.205, "after", "+150.4")])
def test_a_delay_is_told_in_seconds_of_the_turning_sky_with_its_side_and_what_a_turn_about_the_pole_would_be(
    ra, side, by_pole
):
    """At a declination of 60 deg the sky moves by 7.52 arcsec a second."""
    found = named(ra, 0.04)
    assert found.cause == "sensor delay"
    assert f"its answers lie {ra:+.1f} arcsec east and +0.0 arcsec north of those" in found.size
    assert found.size.endswith(f"as those of 10.00 s {side} the exposure that they are marked with")
    assert found.equals == (
        "a bias of its own in RA",
        f"a body frame that is turned about the pole by {by_pole} arcsec",
    )


@pytest.mark.parametrize(
    ("ra", "de", "known", "cause"),
    [
        # A tenth of the shift in RA
        (100.0, 9.99, {}, "delay"),
        (-100.0, -10.0, {}, "delay"),
        (100.0, 10.01, {}, "bias"),
        (100.0, -10.01, {}, "bias"),
        # Five standard errors
        (100.0, 15.0, {"de_error": 3.0}, "delay"),
        (100.0, 15.01, {"de_error": 3.0}, "bias"),
        # What pixels leave, where it is the time of two frames of 2 s, not of 2.25
        (-4 * 7.520533, 12.0, {"least": 12.0}, "delay"),
        (-4 * 7.520533, -12.0, {"least": 12.0}, "delay"),
        (-4 * 7.520533, 12.01, {"least": 12.0}, "bias"),
        (-4.5 * 7.520533, 12.0, {"least": 12.0}, "bias"),
        # So near to the pole that RA tells nothing: the cosine is 0.0506 and 0.0488
        (-100.0, 0.0, {"de_deg": 87.1}, "delay"),
        (-100.0, 0.0, {"de_deg": 87.2}, "bias"),
        # Half a minute ahead, which no sensor knows
        (0.99 * _MOST_EARLY_S * 7.520533, 0.0, {}, "delay"),
        (1.01 * _MOST_EARLY_S * 7.520533, 0.0, {}, "bias"),
    ],
)
def test_a_shift_along_ra_is_a_delay_first(ra, de, known, cause):
    assert named(ra, de, **known).cause == f"sensor {cause}"


@pytest.mark.parametrize(
    ("ra", "de", "known", "words"),
    [
        (-45.1232, 20.0, {"by_stars": 20.0}, "answers of 6.00 s before their exposure, by other stars"),
        (45.1232, -20.0, {"by_stars": 20.0}, "answers of 6.00 s after their exposure, by other stars"),
        (45.1232, 20.0, {"by_stars": 19.9}, None),
        (20.0, 20.0, {"by_stars": 30.0}, "answers of 2.66 s after their exposure, by other stars"),
        (-19.9, 20.0, {"by_stars": 30.0}, None),
        (-100.0, 20.0, {"by_stars": 30.0, "de_deg": 87.1}, "answers of 131.41 s before their exposure, by other stars"),
        (100.0, 20.0, {"by_stars": 30.0, "de_deg": 87.2}, None),
    ],
)
def test_a_bias_may_be_a_delay_where_other_stars_make_what_lies_across(ra, de, known, words):
    found = named(ra, de, **known)
    assert found.cause == "sensor bias"
    assert found.equals == ("a body frame that is turned by as much", *([words] if words else []))


@pytest.mark.parametrize(
    ("late_s", "is_whole"),
    [(0.9, False), (1.7, False), (1.81, True), (-1.9, True), (2.19, True), (2.21, False), (4.39, True), (4.41, False)],
)
def test_a_delay_of_whole_frames_is_within_a_tenth_of_their_time(late_s, is_whole):
    assert _is_whole_frames(at(0.0)["utc_ns"], late_s) is is_whole


@pytest.mark.parametrize(
    ("off", "least", "is_beyond"),
    [
        ((3.0, 0.0, 4.0, 0.0), 4.9, True),
        ((3.0, 0.0, 4.0, 0.0), 5.0, False),
        ((-3.0, 0.0, -4.0, 0.0), 4.9, True),
        ((3.0, 0.59, 4.0, 0.79), 0.0, True),
        ((3.0, 0.6, 4.0, 0.81), 0.0, False),
    ],
)
def test_an_offset_is_beyond_what_is_explained_and_five_standard_errors(off, least, is_beyond):
    assert _Off(*off).is_beyond(least) is is_beyond


def test_the_typical_value_is_the_median_of_twenty_blocks_of_time_and_its_error_is_theirs():
    """Blocks of 0, 1, ... 19, each with one value far off: their standard deviation is the root of 35."""
    values = np.repeat(np.arange(20.0), 3)
    values[::3] = 1e6
    rows = np.random.default_rng(1).permutation(60)
    frames = {"utc_ns": np.arange(60) * 10**9}
    found = _typical(frames, rows, values[rows])
    assert found == pytest.approx((9.5, math.sqrt(35) / math.sqrt(20)))
    off = _Off.typical(frames, rows, np.column_stack([values, -2 * values])[rows])
    assert (off.ra, off.ra_error, off.de, off.de_error) == pytest.approx((*found, -19.0, 2 * found[1]))


@pytest.mark.parametrize(
    ("arcsec", "words"),
    [
        (3599.6, "+3599.6 arcsec"),
        (-3599.6, "-3599.6 arcsec"),
        (3600.0, "+1.000 deg"),
        (-5400.0, "-1.500 deg"),
        (0.0, "+0.0 arcsec"),
    ],
)
def test_an_angle_from_a_degree_on_is_in_degrees(arcsec, words):
    assert _angle(arcsec) == words


@pytest.mark.parametrize(
    ("matches", "matched", "arcsec"),
    [
        ((), 20, WHOLE_20_ARCSEC),
        (((100.0, 50.0, 0.0, 0.0),), 20, WHOLE_20_ARCSEC),
        (((100.5, 50.0, 0.0, 0.0),), 20, 0.05 * 49.4651 / math.sqrt(20)),
        (((100.0, 50.5, 0.0, 0.0),), 5, 0.05 * 49.4651 / math.sqrt(5)),
        ((), 0, 49.4651 / math.sqrt(12)),
    ],
)
def test_pixels_leave_of_a_boresight_their_error_of_a_star_over_the_root_of_the_number(matches, matched, arcsec):
    made = night(matches)
    made.frames.columns["matched"] = matched
    assert _of_pixels_arcsec(made, np.arange(COUNT)) == pytest.approx(arcsec, rel=1e-5)
    assert _are_whole(made) is all(x == round(x) and y == round(y) for x, y, *_ in matches)


def aberration_arcsec(de_deg, ra_deg, sun_deg, *, obliquity_deg=23.436):
    """East and north: 20.4955 arcsec along the Earth's way, at right angles to the Sun, and 0.0167 of it about that.

    ``sun_deg`` is the longitude of the Sun; its perigee is at 283.4 deg.
    """
    sun, perihelion, obliquity = np.radians([sun_deg, 103.4, obliquity_deg])
    ecliptic = np.array([np.sin(sun) - 0.0167 * np.sin(perihelion), -np.cos(sun) + 0.0167 * np.cos(perihelion)])
    way = 20.4955 * np.array([ecliptic[0], ecliptic[1] * np.cos(obliquity), ecliptic[1] * np.sin(obliquity)])
    ra, de = np.radians([ra_deg, de_deg])
    east = np.array([-np.sin(ra), np.cos(ra), 0.0])
    north = np.array([-np.sin(de) * np.cos(ra), -np.sin(de) * np.sin(ra), np.cos(de)])
    return east @ way, north @ way


def test_by_its_stars_an_answer_lies_off_by_the_aberration_that_the_answers_here_lack(still):
    """Four hours after the equinox of March, at the zenith: the Sun's longitude is 0.15 deg, in J2000 0.37 less.

    Stars stand towards the Earth's way, east and south here; answers from them and catalogue places lie behind. The
    Earth's turn adds 0.32 arcsec east. Sun and perigee are good to a tenth of an arcsec.
    """
    frames = still.frames.columns
    at = float(np.median(frames["de_true_deg"])), float(np.median(frames["ra_true_deg"]))
    east, north = aberration_arcsec(*at, 0.15 - 0.37)
    (found,) = _offset(still, answers(still, de=40.0), Explained(60.0, 50.0, 0.0, 0.0))
    told = re.search(r"lie ([+-][\d.]+) arcsec east and ([+-][\d.]+) arcsec north", found.size)
    assert [float(one) for one in told.groups()] == pytest.approx([-east - 0.32, 40.0 - north], abs=0.2)


@pytest.mark.parametrize(
    ("off", "explained", "words"),
    [
        # Four times 3.19 arcsec of pixels, and what is explained
        (12.7, Explained(0.0, math.inf, 0.0, 0.0), None),
        (12.9, Explained(0.0, math.inf, 0.0, 0.0), "+12.9 arcsec north"),
        (30.0, Explained(30.1, math.inf, 0.0, 0.0), None),
        (30.0, Explained(29.9, math.inf, 0.0, 0.0), "+30.0 arcsec north"),
        # By its stars it lies 17.6 arcsec west and 7.4 farther north, by aberration: 50.6 in all
        (40.0, Explained(60.0, 50.0, 0.0, 0.0), "+47."),
        (40.0, Explained(60.0, 51.0, 0.0, 0.0), None),
        # By the whole field it lies within what pixels leave
        (12.5, Explained(60.0, 0.0, 0.0, 0.0), None),
        (13.0, Explained(60.0, 0.0, 0.0, 0.0), "+20."),
    ],
)
def test_a_shift_is_told_beyond_what_pixels_and_other_stars_make_by_each_idea_of_the_answer(
    still, off, explained, words
):
    texts = [str(one) for one in _offset(still, answers(still, de=off), explained)]
    assert len(texts) == (words is not None)
    assert all(words in text for text in texts)


@pytest.mark.parametrize(("off", "is_told"), [(0.9, False), (1.1, True)])
def test_the_same_centroids_part_the_answers_by_an_arcsecond_at_most(off, is_told):
    made = night(CENTROIDS)
    assert bool(list(_offset(made, answers(made, de=off), Explained(60.0, 0.0, 0.0, 0.0)))) is is_told


@pytest.mark.parametrize(("count", "is_told"), [(39, False), (40, True)])
def test_forty_answers_are_compared_at_least(still, count, is_told):
    own = answers(still, de=100.0, roll=2000.0, count=count)
    own.cross_x_arcsec[:count] += 100 * (-1.0) ** np.arange(count)
    explained = Explained(0.0, math.inf, 0.0, 0.0)
    causes = [one.cause for one in beside_panoramas(still, own, None, explained)]
    assert causes == ["sensor bias", "sensor roll", "sensor noise"] * is_told


@pytest.mark.parametrize(
    ("roll", "explained", "words"),
    [
        # Ten times four times 3.19 arcsec
        (127.0, 0.0, None),
        (-129.0, 0.0, "-129.0 arcsec"),
        (290.0, 300.0, None),
        (310.0, 300.0, "+310.0 arcsec"),
        (360 * 3600 - 200.0, 0.0, "-200.0 arcsec"),
        (647_000.0, 0.0, "+179.722 deg"),
    ],
)
def test_a_roll_is_told_beyond_ten_times_what_pixels_make_across(still, roll, explained, words):
    found = list(_turned(still, answers(still, roll=roll), explained))
    assert [one.size for one in found] == (
        [f"its roll lies {words} off the one that follows from its own panoramas"] if words else []
    )


def test_a_roll_that_scatters_is_told_beyond_five_standard_errors(still):
    """Medians of 20 blocks that lie 800 arcsec to either side have an error of 183: five times are 918."""
    to_and_fro = 800 * (-1.0) ** (np.arange(COUNT) // 3)
    error = 800 * math.sqrt(20 / 19) / math.sqrt(20)
    for roll, is_told in ((5 * error - 5, False), (5 * error + 5, True)):
        assert bool(list(_turned(still, answers(still, roll=roll + to_and_fro), 0.0))) is is_told


def test_the_sky_turns_about_the_boresight_by_the_tangent_of_the_declination():
    made = night()
    frames = made.frames.columns
    frames["d_ra_cosde_arcsec"] = 700.0
    tangent = math.tan(math.radians(float(np.median(frames["de_true_deg"]))))
    own = answers(made, ra=-100.0)
    own.d_ra_cosde_arcsec[:5] = np.nan
    assert _roll_of_delay_arcsec(made, own) == pytest.approx(1.2 * 100 * abs(tangent), rel=1e-3)


STEP = 2 / math.sqrt(2) / 0.6745
"""Values of 1 to and fro scatter from one to the next as normal ones of this standard deviation do."""


@pytest.mark.parametrize(
    ("sensor", "here", "explained", "is_told"),
    [
        (29.9, 10.0, 0.0, False),  # three times what it is here
        (30.1, 10.0, 0.0, True),
        (5.9, 0.0, 0.0, False),  # a tenth of the limit of 60 arcsec
        (6.1, 0.0, 0.0, True),
        (19.9, 0.0, 20.0, False),
        (20.1, 0.0, 20.0, True),
    ],
)
def test_noise_is_told_beyond_three_times_that_here_a_tenth_of_its_limit_and_what_stars_explain(
    sensor, here, explained, is_told
):
    made = night()
    frames, to_and_fro = made.frames.columns, (-1.0) ** np.arange(COUNT) / STEP
    own = answers(made)
    own.cross_x_arcsec[:], own.cross_y_arcsec[:] = 0.6 * sensor * to_and_fro, 0.8 * sensor * to_and_fro
    frames["cross_x_arcsec"], frames["cross_y_arcsec"] = 0.6 * here * to_and_fro, 0.8 * here * to_and_fro
    found = list(_noisy(made, own, explained))
    assert len(found) == is_told
    assert all(f"scatter by {sensor:.1f} arcsec" in one.size and f"by {here:.1f}" in one.size for one in found)


def test_the_lesser_of_both_limits_counts_for_noise():
    made = night()
    limits = replace(made.station.limits, d_de_arcsec=20.0)
    made.station = made.station.model_copy(update={"limits": limits})
    own = answers(made)
    own.cross_x_arcsec[:] += 2.5 * (-1.0) ** np.arange(COUNT) / STEP
    assert len(list(_noisy(made, own, 0.0))) == 1
    own.cross_x_arcsec[:] = made.frames.columns["cross_x_arcsec"] + 1.5 * (-1.0) ** np.arange(COUNT) / STEP
    assert list(_noisy(made, own, 0.0)) == []


@pytest.mark.parametrize(("wild", "off_arcsec", "is_told"), [(20, 200, True), (21, 200, False), (21, 170, True)])
def test_answers_farther_than_three_arcminutes_from_their_median_are_false_and_tell_no_noise(
    still, wild, off_arcsec, is_told
):
    """All of them lie two degrees off, as those of another body frame do; forty must be left."""
    own = answers(still)
    own.cross_x_arcsec[:] += 50 * (-1.0) ** np.arange(COUNT)
    own.de_deg[:] += 2.0
    own.de_deg[:wild] += off_arcsec / 3600
    assert bool(list(_noisy(still, own, 0.0))) is is_told


def test_an_answer_without_an_error_of_its_own_tells_no_noise(still):
    own = answers(still)
    own.cross_x_arcsec[:] += 50 * (-1.0) ** np.arange(COUNT)
    own.cross_x_arcsec[:21] = np.nan
    assert list(_noisy(still, own, 0.0)) == []


@pytest.mark.parametrize(("only_station", "is_told"), [(20, False), (21, True)])
def test_one_panorama_in_a_hundred_may_be_answered_here_alone(still, only_station, is_told):
    alike = OnboardEquivalence(2000, 1000, 900, only_station, 900, NONE, NONE, NONE)
    found = list(_one_sided(alike))
    words = f"of 2000 panoramas, {only_station} were answered only here and 900 only by the sensor"
    assert [one.size for one in found] == [words] * is_told
    assert list(_one_sided(None)) == []
    told = beside_panoramas(still, answers(still), alike, Explained(0.0, math.inf, 0.0, 0.0))
    assert [one.cause for one in told] == ["sensor answers otherwise"] * is_told


def test_a_delay_turns_the_roll_and_a_bias_does_not():
    """At 60 deg of declination 1000 arcsec west are a turn of 1.2 times 1732; a bias of DE explains none."""
    made = night()
    made.frames.columns["de_true_deg"] = 60.0
    explained = Explained(0.0, math.inf, 0.0, 0.0)
    for ra, de, roll, causes in (
        (-1000.0, 0.0, -2070.0, ["sensor delay"]),
        (-1000.0, 0.0, -2090.0, ["sensor delay", "sensor roll"]),
        (1000.0, 900.0, 2000.0, ["sensor bias", "sensor roll"]),
    ):
        assert [
            one.cause for one in beside_panoramas(made, answers(made, ra=ra, de=de, roll=roll), None, explained)
        ] == causes


def test_what_is_explained_of_roll_and_scatter_is_let_pass(still):
    own = answers(still, roll=500.0)
    own.cross_x_arcsec[:] += 50 * (-1.0) ** np.arange(COUNT)
    nothing = Explained(0.0, math.inf, 0.0, 0.0)
    for explained, causes in (
        (nothing, ["sensor roll", "sensor noise"]),
        (replace(nothing, roll_arcsec=501.0), ["sensor noise"]),
        (replace(nothing, scatter_arcsec=110.0), ["sensor roll"]),
    ):
        assert [one.cause for one in beside_panoramas(still, own, None, explained)] == causes


def test_a_shift_that_is_not_told_explains_no_roll():
    """12 arcsec at 85 deg of declination, within what pixels leave: a delay of as much would turn by 165."""
    made = night()
    made.frames.columns["de_true_deg"] = 85.0
    nothing = Explained(0.0, math.inf, 0.0, 0.0)
    for explained, roll in ((nothing, 140.0), (replace(nothing, roll_arcsec=300.0), 300.5)):
        found = beside_panoramas(made, answers(made, ra=12.0, roll=roll), None, explained)
        assert [one.cause for one in found] == ["sensor roll"]


def test_answers_are_compared_with_those_here_whatever_both_are_off_by():
    made = night()
    frames = made.frames.columns
    frames["d_ra_cosde_arcsec"], frames["d_de_arcsec"], frames["d_roll_arcsec"] = 500.0, -700.0, 9000.0
    explained = Explained(0.0, math.inf, 0.0, 0.0)
    found = list(beside_panoramas(made, answers(made, ra=30.0, de=-40.0, roll=200.0), None, explained))
    assert "lie +30.0 arcsec east and -40.0 arcsec north" in found[0].size
    assert found[1].size.startswith("its roll lies +200.0 arcsec off")
    assert list(beside_panoramas(made, answers(made), None, explained)) == []
