"""The mount fitted on a session."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from skies.one_by_one import Made, Stars, add_frame

from gse.config.choice import with_values
from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.errors import ConfigError, UsageError
from gse.station.columns import empty_rows
from gse.station.mount_alignment import MIN_FRAMES, FirstSeconds, MeasuredMounts, cross_validated, persistent_arcsec2
from gse.station.results import AnswerCheck, Status
from gse.station.session_data import SessionData
from gse.station.session_tables import MATCH
from gse.truth import EarthOrientation, SiderealTruth, fit_mount, horizon_to_sensor, small_rotations
from gse.values.attitude import Attitude
from gse.values.instant import NS_PER_S, from_text
from gse.values.mount import Mount
from gse.values.panorama import Panorama

ARCSEC = np.pi / 180 / 3600
START_NS = from_text("2026-03-20T18:30:00Z")
TRUTH = SiderealTruth(parse_station(BUILT_IN_TEXT).site, EarthOrientation.from_disk(START_NS))
SESSION = SessionData(parse_station(BUILT_IN_TEXT), BUILT_IN_TEXT, "panorama-v1")
MOUNTS = [
    Mount(),
    Mount(azimuth_deg=123.0, altitude_deg=41.0, roll_deg=200.0),
    Mount(azimuth_deg=359.99, altitude_deg=89.999, roll_deg=0.01),
    Mount(azimuth_deg=180.0, altitude_deg=6.53, roll_deg=90.0),  # the celestial pole
]


def scattered(mount, count=600, *, sigma_arcsec=(3.0, 3.0, 30.0), seed=1, step_s=1.0):
    rng = np.random.default_rng(seed)
    turns = Rotation.from_rotvec(rng.normal(0, np.array(sigma_arcsec) * ARCSEC, (count, 3))).as_matrix()
    utc_ns = START_NS + (np.arange(count) * step_s * NS_PER_S).astype(np.int64)
    return utc_ns, turns @ horizon_to_sensor(mount)


def frames(mount, count, **options):
    utc_ns, rotations = scattered(mount, count, **options)
    for number, (ns, rotation) in enumerate(zip(utc_ns.tolist(), rotations, strict=True)):
        attitude = Attitude(rotation @ TRUTH.icrs_to_horizon(ns), np.zeros((3, 3)))
        panorama = Panorama(ns, np.empty((0, 2)), np.empty(0), number)
        yield Made(panorama, Status.IDENTIFIED, "", "neighbour", attitude_geometric=attitude)


@pytest.mark.parametrize("mount", MOUNTS)
def test_the_mount_is_found_within_its_covariance_everywhere_on_the_sky(mount):
    fitted = fit_mount(*scattered(mount))
    apart = small_rotations(horizon_to_sensor(fitted.mount)[None], horizon_to_sensor(mount))[0] / ARCSEC
    assert (np.abs(apart) < 4 * np.array(fitted.sigma_arcsec)).all()
    assert fitted.scatter_arcsec == pytest.approx((3.0, 3.0, 30.0), rel=0.12)
    assert fitted.sigma_arcsec == pytest.approx(np.array([3.0, 3.0, 30.0]) / np.sqrt(600), rel=0.5)


def test_the_first_seconds_fit_the_mount_for_the_frames_after_them():
    first = FirstSeconds(20.0, SESSION)
    fitted = None
    for number, result in enumerate(frames(MOUNTS[1], 40)):
        fitted = fitted or first.alignment(result.panorama.utc_ns)
        if fitted is not None:
            assert number == 20
            break
        first.add(result, TRUTH)
    assert fitted is not None
    assert fitted.n + fitted.rejected == 20
    assert fitted.mount.altitude_deg == pytest.approx(41.0, abs=2 / 3600)


def test_false_and_unanswered_frames_enter_no_fit():
    measured = MeasuredMounts()
    (result,) = frames(MOUNTS[0], 1)
    measured.add(Made(result.panorama, Status.NO_MATCH, "", "neighbour"), TRUTH)
    false = Made(
        result.panorama,
        Status.IDENTIFIED,
        "",
        "neighbour",
        attitude_geometric=result.attitude_geometric,
        answer_check=AnswerCheck.FALSE,
    )
    measured.add(false, TRUTH)
    assert len(measured) == 0


def test_a_fit_is_judged_on_the_other_half_of_the_minutes():
    measured = MeasuredMounts()
    for result in frames(MOUNTS[1], 600):
        measured.add(result, TRUTH)
    judged = cross_validated(measured, SESSION)
    assert judged.alignment.n > 590
    assert judged.rms_arcsec == pytest.approx((3.0, 3.0, 30.0), rel=0.15)
    assert max(judged.repeatability_arcsec[:2]) < 1


def test_one_frame_cannot_be_judged_on_others():
    measured = MeasuredMounts()
    for result in frames(MOUNTS[1], 1):
        measured.add(result, TRUTH)
    with pytest.raises(UsageError, match="1 frame identified"):
        cross_validated(measured, SESSION)


def test_a_fitted_mount_goes_into_the_station_file_and_leaves_the_rest_alone():
    text = with_values(BUILT_IN_TEXT, "mount", {"azimuth_deg": 12.5, "altitude_deg": 88.25}, drop=("align",))
    assert parse_station(text).mount == Mount(azimuth_deg=12.5, altitude_deg=88.25)
    kept = set(text.splitlines())
    assert [line for line in BUILT_IN_TEXT.splitlines() if line not in kept] == [
        "  azimuth_deg: 0",
        "  altitude_deg: 90",
    ]


def test_a_section_that_was_not_there_is_added_and_one_to_be_dropped_goes():
    sensor, site = "{rows: 64, columns: 64, focal_length_px: 100}", "{latitude_deg: 1, longitude_deg: 2}"
    short = f"version: 1\nsensor: {sensor}\nsite: {site}\n"
    added = with_values(short, "mount", {"align": "first 60 s"})
    assert parse_station(added).mount.align_s == 60
    assert parse_station(with_values(added, "mount", {"altitude_deg": 45.0}, drop=("align",))).mount.align is None


def test_values_that_make_no_station_file_are_refused():
    with pytest.raises(ConfigError, match="altitude_deg"):
        with_values(BUILT_IN_TEXT, "mount", {"altitude_deg": 95.0})


def test_what_stars_keep_for_a_session_is_in_the_covariance_though_frames_do_not_show_it():
    rng = np.random.default_rng(7)
    sessions = [starry_session(rng, catalogue_arcsec) for catalogue_arcsec in (0.0, 10.0)]
    still, wrong = (np.sqrt(np.diag(persistent_arcsec2(one))) for one in sessions)
    assert wrong[:2] == pytest.approx(10 / np.sqrt(25), rel=0.4)
    noise_arcsec = 5 / np.sqrt(25 * 300)  # of the mean: what frames show of themselves is not what lasts
    assert still[:2].max() < noise_arcsec / 2


def starry_session(rng, catalogue_arcsec):
    """Frames of 25 stars whose places in the catalogue are wrong, with 5 arcsec of noise."""
    session = SessionData(parse_station(BUILT_IN_TEXT), BUILT_IN_TEXT, "panorama-v1")
    xy_px, wrong = rng.uniform(0, 1023, (25, 2)), rng.normal(0, catalogue_arcsec, (25, 2))
    rows = np.arange(25)
    for number in range(300):
        errors = wrong + rng.normal(0, 5, (25, 2))
        matches = Stars(rows, rows, errors - errors.mean(axis=0), str)
        panorama = Panorama(START_NS + number * NS_PER_S, xy_px, np.ones(25), number)
        add_frame(session.frames, Made(panorama, Status.IDENTIFIED, "", "neighbour", matches=matches))
    return session


# Halves of a recording to the nanosecond, and by a turn of a known size


def turned(*arcsec):
    """The first mount after a small turn about the sensor's x, y and z."""
    return Rotation.from_rotvec(np.array(arcsec) * ARCSEC).as_matrix() @ horizon_to_sensor(MOUNTS[1])


def measured_at(after_ns, rotations):
    measured = MeasuredMounts()
    for ns, rotation in zip(after_ns, rotations, strict=True):
        attitude = Attitude(rotation @ TRUTH.icrs_to_horizon(START_NS + ns), np.zeros((3, 3)))
        panorama = Panorama(START_NS + ns, np.empty((0, 2)), np.empty(0))
        measured.add(Made(panorama, Status.IDENTIFIED, "", "neighbour", attitude_geometric=attitude), TRUTH)
    return measured


def validated(after_ns, is_moved, *, by_arcsec=(0.0, 20.0, 0.0)):
    """The validation of frames at these instants, of which some are turned by a known angle."""
    rotations = [turned(*by_arcsec) if moved else turned(0, 0, 0) for moved in is_moved]
    return cross_validated(measured_at(after_ns, rotations), SESSION)


def test_what_is_measured_is_kept_with_its_instant_and_in_its_order():
    measured = measured_at([0, 5], [turned(0, 0, 0), turned(0, 20, 0)])
    assert (len(measured), measured.utc_ns.tolist()) == (2, [START_NS, START_NS + 5])
    expected = np.array([turned(0, 0, 0), turned(0, 20, 0)])
    assert measured.horizon_to_sensor == pytest.approx(expected, abs=1e-13)


@pytest.mark.parametrize(
    ("after_ns", "is_odd"),
    [
        (range(13), [0, 0, 0, 1, 1, 1, 0, 0, 0, 1, 1, 1, 0]),  # a sixth of 12 ns, and one more, are 3
        (range(1, 14), [0, 0, 0, 1, 1, 1, 0, 0, 0, 1, 1, 1, 0]),  # they count from the first frame
        (range(12), [0, 0, 1, 1, 0, 0, 1, 1, 0, 0, 1, 1]),  # a sixth of 11 ns is 1, and one more are 2
        ([0, 60 * NS_PER_S - 1, 60 * NS_PER_S, 120 * NS_PER_S - 1, 120 * NS_PER_S, 700 * NS_PER_S], [0, 0, 1, 1, 0, 1]),
    ],
)
def test_parts_of_a_recording_judge_each_other_by_turns(after_ns, is_odd):
    """Where all frames of the odd parts are turned, and no others, each half fits its own exactly."""
    found = validated(after_ns, is_odd)
    for values in (found.repeatability_arcsec, found.mean_abs_arcsec, found.rms_arcsec):
        assert values == pytest.approx((20.0, 0.0, 0.0), abs=1e-4)


def test_two_frames_in_one_part_judge_each_other():
    """Both have the same instant: no part is odd, so every second frame stands for one."""
    found = validated([0, 0], [0, 1])
    assert found.repeatability_arcsec == pytest.approx((20.0, 0.0, 0.0), abs=1e-4)
    assert found.alignment.n == 2
    many = validated([0] * 6, [0, 1, 0, 1, 0, 1])
    assert many.rms_arcsec == pytest.approx((20.0, 0.0, 0.0), abs=1e-4)


@pytest.mark.parametrize(
    ("by_arcsec", "shown"),
    [((0.0, 20.0, 0.0), (20, 0, 0)), ((30.0, 0.0, 0.0), (0, 30, 0)), ((0.0, 0.0, -40.0), (0, 0, 40))],
)
def test_a_turn_about_rows_moves_the_boresight_along_columns_and_one_about_columns_along_rows(by_arcsec, shown):
    found = validated(range(12), [0, 0, 1, 1] * 3, by_arcsec=by_arcsec)
    for values in (found.repeatability_arcsec, found.mean_abs_arcsec, found.rms_arcsec):
        assert values == pytest.approx(shown, abs=1e-4)


def test_the_mean_of_an_error_is_less_than_its_root_mean_square():
    """Each half is fitted by its median mount; in one of them every third frame is off by 30 arcsec."""
    off = [turned(0, 30, 0) if k % 12 == 2 else turned(0, 0, 0) for k in range(48)]
    found = cross_validated(measured_at(range(48), off), SESSION)
    assert 0 < found.mean_abs_arcsec[0] < found.rms_arcsec[0]


@pytest.mark.parametrize(("frames_before", "after_s", "is_fitted"), [
    (MIN_FRAMES, 20.0, True), (MIN_FRAMES, 20.0 - 1e-9, False), (MIN_FRAMES - 1, 3600.0, False),
])  # fmt: skip
def test_the_mount_is_fitted_once_the_seconds_are_over_and_enough_frames_are_there(frames_before, after_s, is_fitted):
    first = FirstSeconds(20.0, SESSION)
    assert first.alignment(START_NS) is None
    for result in frames(MOUNTS[1], frames_before):
        first.add(result, TRUTH)
    assert (first.alignment(START_NS + round(after_s * NS_PER_S)) is not None) is is_fitted


class Listened:
    """What the loop gives a listener: the station, and its Earth orientation or none."""

    def __init__(self, earth_orientation):
        self.station, self.earth_orientation, self.shown = SESSION.station, earth_orientation, SESSION.shown


def test_frames_are_taken_from_the_loop_once_the_sky_is_known():
    measured = MeasuredMounts()
    results = list(frames(MOUNTS[1], 3, sigma_arcsec=(0.0, 0.0, 0.0)))
    measured.on_results(results, Listened(None))
    assert len(measured) == 0
    measured.on_results(results, Listened(TRUTH.earth_orientation))
    assert len(measured) == 3
    expected = horizon_to_sensor(MOUNTS[1])
    assert measured.horizon_to_sensor[2] == pytest.approx(expected, abs=1e-12)
    measured.on_results(results[:1], Listened(None))  # the sky that was known is kept
    assert len(measured) == 4
    assert measured.on_event("anything") is None


def test_stars_of_false_answers_and_stars_that_were_left_out_say_nothing_of_the_catalogue():
    """Two stars of ten frames, each of whose residuals lasts; a third of the rows must count alone."""
    rng = np.random.default_rng(7)
    session = starry_session(rng, 10.0)
    whole = persistent_arcsec2(session)
    matches = session.frames.matches
    matches["named"][matches["frame"] >= 150] = False
    half = persistent_arcsec2(session)
    matches["named"] = True
    false = list(AnswerCheck).index(AnswerCheck.FALSE)
    session.frames.columns["answer_check"][150:] = false
    assert persistent_arcsec2(session).tolist() == half.tolist()
    assert np.diag(half)[:2] == pytest.approx(np.diag(whole)[:2], rel=0.3)
    session.frames.columns["answer_check"] = false
    assert persistent_arcsec2(session).tolist() == np.zeros((3, 3)).tolist()


# The sky of the first seconds


def by_twilight(share, *, begin="2026-03-20T11:30:00Z", minutes=3):
    """When the mount is fitted, in seconds after the begin: ``share(second)`` of 20 expected stars are seen.

    At 106.7 deg east the Sun is 11 deg below the horizon at half past eleven.
    """
    begin_ns = from_text(begin)
    made = SessionData(parse_station(BUILT_IN_TEXT), BUILT_IN_TEXT, "panorama-v1")
    first, rotation = FirstSeconds(20.0, made), horizon_to_sensor(MOUNTS[1])
    for second in range(60 * minutes):
        utc_ns = begin_ns + second * NS_PER_S
        if (fitted := first.alignment(utc_ns)) is not None:
            return second, fitted, first
        rows = empty_rows(1)
        rows["stars_expected"], rows["stars_seen"] = 20, round(20 * share(second))
        made.frames.extend(rows, np.zeros(0, MATCH))
        attitude = Attitude(rotation @ TRUTH.icrs_to_horizon(utc_ns), np.zeros((3, 3)))
        panorama = Panorama(utc_ns, np.empty((0, 2)), np.empty(0), second)
        first.add(Made(panorama, Status.IDENTIFIED, "", "neighbour", attitude_geometric=attitude), TRUTH)
    return None


def test_in_twilight_the_first_seconds_begin_once_most_stars_are_seen():
    second, fitted, first = by_twilight(lambda second: 0.3 if second < 60 else 0.95)
    assert second == pytest.approx(60 + 80 + 20, abs=30)  # a hundred frames tell the share
    assert fitted.from_ns > from_text("2026-03-20T11:31:00Z")
    assert first.waited_s == pytest.approx(second - 20, abs=5)


def test_a_twilight_that_shows_its_stars_and_a_dark_sky_that_shows_few_are_good_enough():
    assert by_twilight(lambda second: 0.95)[0] == 20
    assert by_twilight(lambda second: 0.3, begin="2026-03-20T18:30:00Z")[0] == 20
    assert by_twilight(lambda second: 0.3) is None


def test_after_an_hour_the_seconds_begin_in_any_twilight():
    assert by_twilight(lambda second: 0.3, begin="2026-03-20T05:00:00Z", minutes=70)[0] == pytest.approx(3620, abs=10)


@pytest.mark.parametrize(("scatter_arcsec", "taken_s"), [(1.0, 20), (22.0, 40), (2000.0, 200)])
def test_more_seconds_are_taken_where_the_fit_is_worse_than_a_tenth_of_a_limit(scatter_arcsec, taken_s):
    """Six arcsec: 20 frames of a scatter of 22 along each axis leave 7, forty 5."""
    first = FirstSeconds(20.0, SESSION)
    for result in frames(MOUNTS[1], 300, sigma_arcsec=(scatter_arcsec, scatter_arcsec, 0.0)):
        if (fitted := first.alignment(result.panorama.utc_ns)) is not None:
            break
        first.add(result, TRUTH)
    assert (fitted.until_ns - fitted.from_ns) / NS_PER_S + 1 == taken_s
