"""The sky's condition from the stars: cloud, cap, Moon and daylight, each by its name or not at all."""

import math

import numpy as np
import pytest

from drivers.link import SerialLink
from drivers.urlhandlers.protocol_sim import register
from gse.catalog import load_catalog
from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.recording.session_format import RecordedTimings
from gse.simulator import device_factory
from gse.station.columns import ANSWER_CHECKS, FRAME, SKY_CONDITIONS, STATUSES
from gse.station.loop import StationLoop
from gse.station.results import AnswerCheck, SkyCondition, Status
from gse.station.session_data import SessionData
from gse.station.setup import Setup, set_up
from gse.station.sky_condition import (
    MOON_GLARE_DEG,
    WINDOW_NS,
    ClearSky,
    Lights,
    SkyEvidence,
    SkyWatch,
    evidence_of,
    separation_deg,
    stars_in_field,
    words_of,
)
from gse.truth.frames import horizon_to_sensor
from gse.truth.solar_system import icrs_to_horizon, sun_and_moon_horizon
from gse.values.attitude import Attitude
from gse.values.camera import Camera
from gse.values.instant import NS_PER_S, from_text
from gse.values.mount import Mount
from gse.values.site import Site

STATION = parse_station(BUILT_IN_TEXT)
CATALOG = load_catalog(stars=4200)
NIGHT_NS = from_text("2026-03-20T15:00:00Z")
SKY_KINDS = ("CLEAR", "CLOUDED", "NO_STARS", "DAYLIGHT", "DARK_NIGHT")
CLOUD = """\
text: An uninterrupted cloud of 1.5 mag for a minute, and then a lens cap.
seconds: 240
rate_hz: 2
air:
  cloud_magnitudes: [[0, 0], [60, 0], [61, 1.5], [120, 1.5], [121, 0], [180, 0], [180.5, 50]]
"""


@pytest.fixture(scope="module")
def setup() -> Setup:
    return set_up(STATION, BUILT_IN_TEXT)


@pytest.fixture(scope="module")
def clouded(setup: Setup, tmp_path_factory: pytest.TempPathFactory) -> SessionData:
    path = tmp_path_factory.mktemp("scenario") / "cloud.yaml"
    path.write_text(CLOUD)
    register(device_factory(STATION))
    with SerialLink(f"sim://?scenario={path}") as link:
        return StationLoop(setup, recorded=RecordedTimings()).run(link)


def since_start_s(session: SessionData) -> np.ndarray:
    utc_ns = session.frames.columns["utc_ns"]
    return (utc_ns - utc_ns[0]) / NS_PER_S


def test_a_cloud_is_named_when_it_comes_and_when_it_goes(clouded: SessionData) -> None:
    begun_ns = int(clouded.frames.columns["utc_ns"][0])
    events = [(event.kind, (event.utc_ns - begun_ns) / NS_PER_S) for event in clouded.events if event.kind in SKY_KINDS]
    assert [kind for kind, _ in events[:3]] == ["CLEAR", "CLOUDED", "CLEAR"]
    assert 60 < events[1][1] < 70
    assert 120 < events[2][1] < 130


def test_the_stars_tell_how_much_light_the_cloud_takes(clouded: SessionData) -> None:
    frames, second = clouded.frames.columns, since_start_s(clouded)
    inside = frames["transparency"][(second > 70) & (second < 115)]
    assert -2.5 * math.log10(float(np.median(inside))) == pytest.approx(1.5, abs=0.25)
    outside = frames["transparency"][second < 55]
    assert float(np.median(outside)) > 0.9


def test_a_frame_has_the_condition_of_its_seconds(clouded: SessionData) -> None:
    frames, second = clouded.frames.columns, since_start_s(clouded)
    conditions = np.array(SKY_CONDITIONS)[frames["sky_condition"]]
    assert set(conditions[second < 55]) == {SkyCondition.CLEAR}
    assert set(conditions[(second > 70) & (second < 115)]) == {SkyCondition.CLOUDED}
    assert SkyCondition.CLEAR not in conditions[second > 190]


DARK = Lights(-40.0, -30.0, 120.0, 90.0)


# Sessions made of rows


def rows(frames: int = 40, *, stars: int, objects: int = 30, zero_point_mag: float = 14.0) -> np.ndarray:
    """Frames with so many named stars, or with no answer where there are none."""
    made = np.zeros(frames, dtype=FRAME)
    made["status"] = STATUSES.index(Status.IDENTIFIED if stars else Status.NO_MATCH)
    made["answer_check"] = ANSWER_CHECKS.index(AnswerCheck.CORRECT if stars else AnswerCheck.UNKNOWN)
    made["objects"], made["matched"], made["stars_seen"] = objects, stars, stars
    made["exposure_s"], made["limiting_mag"] = 0.05, 5.5
    made["zero_point_mag"] = zero_point_mag if stars else math.nan
    return made


def watched(
    *parts: np.ndarray,
    site: Site = STATION.site,
    mount: Mount = STATION.mount,
    begin_ns: int = NIGHT_NS,
    stated_mag: float | None = None,
) -> tuple[list[str], list[SkyCondition]]:
    """Events of parts that follow each other at 2 Hz, and the condition at the end of each part."""
    frames = np.concatenate(parts)
    frames["utc_ns"] = begin_ns + np.arange(len(frames)) * (NS_PER_S // 2)
    for row, rotation in zip(frames, icrs_to_horizon(site, frames["utc_ns"]), strict=True):
        attitude = Attitude(horizon_to_sensor(mount) @ rotation, np.zeros((3, 3)))
        row["ra_deg"], row["de_deg"], row["roll_deg"] = attitude.ra_deg, attitude.de_deg, attitude.roll_deg
    watch = SkyWatch(site, STATION.sensor.camera(), CATALOG, mount, stated_mag=stated_mag)
    events = [event for row in range(len(frames)) for _, found in watch.take(frames[: row + 1], row) for event in found]
    events += watch.finish(frames)
    ends = np.cumsum([len(part) for part in parts]) - 1
    return [str(event.kind) for event in events], [SKY_CONDITIONS[code] for code in frames["sky_condition"][ends]]


def test_an_hour_of_cloud_between_clear_hours_is_one_cloud() -> None:
    clear, cloud = rows(200, stars=14), rows(400, stars=8, zero_point_mag=12.8)
    kinds, conditions = watched(clear, cloud, clear)
    assert kinds == ["CLEAR", "CLOUDED", "CLEAR"]
    assert conditions == [SkyCondition.CLEAR, SkyCondition.CLOUDED, SkyCondition.CLEAR]


def test_a_session_that_begins_in_a_cloud_is_told_so_at_its_end() -> None:
    _, conditions = watched(rows(120, stars=13, zero_point_mag=12.8), rows(120, stars=14))
    assert conditions == [SkyCondition.CLOUDED, SkyCondition.CLEAR]


def test_a_cap_is_no_cloud() -> None:
    kinds, conditions = watched(rows(stars=14), rows(stars=0, objects=0))
    assert kinds == ["CLEAR", "NO_STARS"]
    assert conditions[1] is SkyCondition.NO_STARS


@pytest.mark.parametrize("frames", [34, 36, 38])
def test_a_cap_that_comes_within_the_seconds_of_a_window_is_no_cloud(frames: int) -> None:
    full, capped = rows(frames, stars=14), rows(40, stars=0, objects=0)
    assert watched(full, capped, full)[0] == ["CLEAR", "NO_STARS", "CLEAR"]


def test_a_sensor_without_brightness_shows_cloud_by_missing_stars_only() -> None:
    clear = rows(stars=14, zero_point_mag=math.nan)
    assert watched(clear, rows(stars=13, zero_point_mag=math.nan))[0] == ["CLEAR"]
    assert watched(clear, rows(stars=2, zero_point_mag=math.nan))[0] == ["CLEAR", "CLOUDED"]


def test_frames_that_fail_with_all_their_objects_are_no_cloud() -> None:
    part = rows(stars=14)
    failed = rows(stars=0)
    part[::2] = failed[::2]
    kinds, conditions = watched(rows(stars=14), part)
    assert kinds == ["CLEAR"]
    assert conditions[1] is SkyCondition.CLEAR


def test_a_cloud_that_stays_is_told_by_the_zero_point_of_a_clear_night_alone() -> None:
    """14 at an exposure of 0.05 s is 17.25 at 1 s."""
    hazy = rows(stars=13, zero_point_mag=13.1)
    assert watched(hazy)[0] == ["CLEAR"]
    assert watched(hazy, stated_mag=17.25) == (["CLOUDED"], [SkyCondition.CLOUDED])
    assert watched(rows(stars=13, zero_point_mag=13.4), stated_mag=17.25)[0] == ["CLEAR"]
    assert watched(hazy, rows(stars=14), stated_mag=17.25)[0] == ["CLOUDED", "CLEAR"]


def test_a_cloud_is_told_against_what_is_stated() -> None:
    few = SkyEvidence(DARK, 30.0, 0.4, 16.0, 4.0, 13.0, 0.0, True, False, 0.05)
    told = words_of(SkyCondition.CLOUDED, few, ClearSky(17.25, 0.4, is_stated=True))
    assert told.startswith("stars are 1.2 mag fainter than the stated zero point says")


def test_the_moon_in_the_field_hides_stars_and_is_no_cloud() -> None:
    moonlit_ns = from_text("2026-03-05T16:00:00Z")
    (_, moon), site = sun_and_moon_horizon(STATION.site, np.array([moonlit_ns])), STATION.site
    azimuth_deg = math.degrees(math.atan2(moon[0, 0], moon[0, 1]))
    mount = Mount(azimuth_deg=azimuth_deg, altitude_deg=math.degrees(math.asin(moon[0, 2])), roll_deg=0.0)
    kinds, conditions = watched(rows(stars=14), rows(stars=3), site=site, mount=mount, begin_ns=moonlit_ns)
    assert "CLOUDED" not in kinds
    assert conditions[1] is not SkyCondition.CLOUDED


CORNER_DEG = math.degrees(math.atan(512 * math.sqrt(2) / 4169.9))


@pytest.mark.parametrize(("more_deg", "glares"), [(-0.5, True), (0.5, False)])
def test_the_moon_glares_so_far_from_the_corner_of_the_field(more_deg: float, glares: bool) -> None:
    beside_deg = CORNER_DEG + MOON_GLARE_DEG + more_deg
    moonlit_ns = from_text("2026-03-05T16:00:00Z")
    _, moon = sun_and_moon_horizon(STATION.site, np.array([moonlit_ns]))
    azimuth_deg, altitude_deg = math.degrees(math.atan2(moon[0, 0], moon[0, 1])), math.degrees(math.asin(moon[0, 2]))
    mount = Mount(azimuth_deg=azimuth_deg, altitude_deg=altitude_deg - beside_deg, roll_deg=0.0)
    _, conditions = watched(rows(stars=14), rows(stars=3, zero_point_mag=12.0), mount=mount, begin_ns=moonlit_ns)
    assert (conditions[1] is SkyCondition.UNKNOWN) == glares


def unit_vector(longitude_deg: float, latitude_deg: float) -> np.ndarray:
    longitude, latitude = math.radians(longitude_deg), math.radians(latitude_deg)
    across = math.cos(latitude)
    return np.array([across * math.cos(longitude), across * math.sin(longitude), math.sin(latitude)])


@pytest.mark.parametrize(
    ("one_deg", "other_deg", "apart_deg"),
    [
        ((10.0, 0.0), (50.0, 0.0), 40.0),
        ((50.0, 0.0), (10.0, 0.0), 40.0),
        ((120.0, 30.0), (300.0, 40.0), 110.0),  # over the pole
        ((20.0, -60.0), (20.0, -60.001), 0.001),
        ((0.0, 45.0), (90.0, 0.0), 90.0),
        ((200.0, 25.0), (20.0, -25.0), 180.0),
    ],
)
def test_how_far_apart_two_bodies_stand(
    one_deg: tuple[float, float], other_deg: tuple[float, float], apart_deg: float
) -> None:
    assert separation_deg(unit_vector(*one_deg), unit_vector(*other_deg)) == pytest.approx(apart_deg, abs=1e-9)


@pytest.mark.parametrize(
    ("latitude_deg", "longitude_deg", "text"),
    [
        (90.0, 0.0, "2026-12-21T12:00:00Z"),
        (-17.0, 180.0, "2026-03-20T12:00:00Z"),
        (-44.0, 170.0, "2026-07-01T12:00:00Z"),
    ],
    ids=["north pole in winter", "antimeridian", "southern winter"],
)
@pytest.mark.parametrize("altitude_deg", [90.0, 35.0])
def test_anywhere_on_earth_the_same_stars_make_the_same_sky(
    latitude_deg: float, longitude_deg: float, text: str, altitude_deg: float
) -> None:
    site = Site(latitude_deg=latitude_deg, longitude_deg=longitude_deg)
    mount = Mount(azimuth_deg=0.0, altitude_deg=altitude_deg, roll_deg=0.0)
    kinds, _ = watched(
        rows(stars=28), rows(stars=3, zero_point_mag=12.0), site=site, mount=mount, begin_ns=from_text(text)
    )
    assert kinds == ["CLEAR", "CLOUDED"]


def test_the_sun_is_told_by_its_altitude() -> None:
    noon_ns = from_text("2026-03-20T05:00:00Z")  # at 106.7 deg east
    kinds, conditions = watched(rows(stars=0, objects=0), begin_ns=noon_ns)
    assert kinds == ["DAYLIGHT"]
    assert conditions == [SkyCondition.DAYLIGHT]


def test_a_sky_whose_stars_are_seen_stays_clear_through_twilight() -> None:
    dusk_ns, dawn_ns = from_text("2026-03-20T11:46:00Z"), from_text("2026-03-20T22:06:00Z")
    assert watched(rows(stars=14, frames=2 * 240), begin_ns=dusk_ns)[0] == ["DAYLIGHT", "CLEAR"]
    assert watched(rows(stars=14, frames=2 * 240), begin_ns=dawn_ns)[0] == ["CLEAR"]
    assert watched(rows(60, stars=0, objects=0), rows(420, stars=0, objects=0), begin_ns=dusk_ns)[0] == [
        "DAYLIGHT",
        "DARK_NIGHT",
        "NO_STARS",
    ]


def test_the_first_stars_of_a_dusk_make_no_clear_sky() -> None:
    """Half of those that the catalogue makes expected are, while no dark part shows what is usual; a third keeps it."""
    dusk_ns, few, enough, fewer = from_text("2026-03-20T11:30:00Z"), rows(stars=4), rows(stars=18), rows(stars=12)
    assert watched(few, fewer, begin_ns=dusk_ns)[0] == ["DAYLIGHT"]
    assert watched(enough, fewer, enough, begin_ns=dusk_ns)[0] == ["DAYLIGHT", "CLEAR"]
    assert watched(enough, few, begin_ns=dusk_ns)[0] == ["DAYLIGHT", "CLEAR", "DAYLIGHT"]


def test_behind_the_last_star_of_a_dawn_it_is_daylight_again() -> None:
    """Told once for each time that stars were seen: the sky is not clear because it was so half an hour ago."""
    twilight_ns, none = from_text("2026-03-20T11:30:00Z"), rows(60, stars=0, objects=0)
    kinds, conditions = watched(rows(stars=18), none, rows(stars=18), none, begin_ns=twilight_ns)
    assert kinds == ["DAYLIGHT", "CLEAR", "DAYLIGHT", "CLEAR", "DAYLIGHT"]
    assert conditions[-1] is SkyCondition.DAYLIGHT


# Evidence by hand


@pytest.mark.parametrize(
    ("objects", "usual", "is_empty"),
    [(3, 4.0, False), (2, 4.0, True), (7, 10.0, False), (6, 10.0, True), (30, math.nan, True)],
)
def test_a_frame_without_an_answer_shows_missing_stars_where_it_has_seven_tenths_of_the_objects_or_fewer(
    objects: int, usual: float, is_empty: bool
) -> None:
    part = np.concatenate([rows(3, stars=0, objects=objects), rows(1, stars=10)])
    assert evidence_of(part, 20.0, DARK, usual).empty_share == (0.75 if is_empty else 0.0)
    assert evidence_of(part, 20.0, DARK, usual).seen_share == 0.5
    assert evidence_of(part, 5.0, DARK, usual).seen_share == 1.0


@pytest.mark.parametrize(
    ("zero_point_mag", "words"),
    [
        (13.5, "stars are 0.5 mag fainter than in the clear, 6 of 20 expected stars are seen: cloud, haze or dew"),
        (13.6, "6 of 20 expected stars are seen: cloud, haze or dew"),
    ],
)
def test_how_much_fainter_the_stars_are_is_told_where_a_cloud_would_not_end_by_it(
    zero_point_mag: float, words: str
) -> None:
    few = SkyEvidence(DARK, 20.0, 0.3, zero_point_mag, 5.0, 8.0, 0.0, True, False, 0.05)
    assert words_of(SkyCondition.CLOUDED, few, ClearSky(14.0, 0.9)) == words


def test_an_event_of_the_sky_has_the_time_of_the_last_frame_of_its_seconds() -> None:
    frames = rows(stars=14)
    frames["utc_ns"] = NIGHT_NS + np.arange(len(frames)) * (NS_PER_S // 2)
    watch = SkyWatch(STATION.site, STATION.sensor.camera(), CATALOG, STATION.mount)
    ((_, (event, *_)),) = watch.take(frames[: WINDOW_NS * 2 // NS_PER_S + 1], 0)
    assert (event.kind, event.utc_ns, event.mono_ns) == ("CLEAR", NIGHT_NS + WINDOW_NS - NS_PER_S // 2, 0)


def test_the_sun_has_its_own_event_with_the_time_of_the_last_frame_of_its_seconds() -> None:
    frames = rows(3, stars=0, objects=0)
    frames["utc_ns"] = instants(0, 1, 2, begin_ns=from_text("2026-03-20T05:00:00Z"))
    (event,) = watch_of().finish(frames)
    assert (event.kind, event.utc_ns, event.mono_ns) == ("DAYLIGHT", frames["utc_ns"][2], 0)
    assert event.text.startswith("Sun ")


# One window and its rows, by hand


def instants(*seconds: float, begin_ns: int = NIGHT_NS) -> np.ndarray:
    return begin_ns + np.array([round(second * NS_PER_S) for second in seconds], dtype=np.int64)


def watch_of(mount: Mount | None = STATION.mount, **changes: object) -> SkyWatch:
    return SkyWatch(STATION.site, STATION.sensor.camera(), CATALOG, mount, **changes)


@pytest.mark.parametrize("begin_ns", [NIGHT_NS, 0])
@pytest.mark.parametrize("pieces", [[12], [1] * 12, [5, 7], [11, 1]])
def test_windows_begin_with_the_first_frame_behind_the_one_before_however_frames_come(
    begin_ns: int, pieces: list[int]
) -> None:
    """Of five seconds each, in 1970 as well. The clock steps back, and forward by half a minute."""
    frames = rows(12, stars=14)
    frames["utc_ns"] = instants(0, 1, 4.999999999, 5, 9.9, 15, 19, 14.999999999, 16.9, 60, 64, 65, begin_ns=begin_ns)
    watch, found, first = watch_of(), [], 0
    for piece in pieces:
        found += [row for row, _ in watch.take(frames[: first + piece], first)]
        first += piece
    assert found == [3, 5, 7, 9, 11]


def test_a_session_without_frames_ends_without_events() -> None:
    assert watch_of().finish(rows(0, stars=0)) == []


def test_rows_are_filled_window_by_window_with_the_sky_of_its_middle_frame() -> None:
    """The Sun goes down by 15 arcsec in a second."""
    frames = rows(9, stars=14)
    frames["utc_ns"] = instants(0, 1, 2.5, 3, 4.9, 6, 7, 7.5, 8)
    watch = watch_of()
    watch.take(frames, 0)
    watch.finish(frames)
    sun, moon = sun_and_moon_horizon(STATION.site, frames["utc_ns"])
    for name, vectors in (("sun_altitude_deg", sun), ("moon_altitude_deg", moon)):
        altitude_deg = np.degrees(np.arcsin(vectors[:, 2]))
        assert np.abs(np.diff(altitude_deg)).min() > 1e-4
        assert frames[name] == pytest.approx(altitude_deg[[2] * 5 + [7] * 4], abs=2e-5)


def test_the_direction_is_that_of_the_middle_one_of_the_confirmed_answers_of_a_window() -> None:
    """Rows 0, 3, 4, 6 and 7 are identified and not called false; without the first two the middle one has no roll."""
    frames = rows(8, stars=14)
    frames["utc_ns"] = instants(*np.arange(0, 4, 0.5))
    frames["ra_deg"], frames["de_deg"] = np.arange(10, 90, 10), -np.arange(1, 9)
    frames["roll_deg"] = [5, 5, 5, 5, 65, 5, math.nan, 5]
    frames["answer_check"][[1, 5]] = ANSWER_CHECKS.index(AnswerCheck.FALSE)
    frames["answer_check"][4] = ANSWER_CHECKS.index(AnswerCheck.UNKNOWN)
    frames["status"][2] = STATUSES.index(Status.NO_MATCH)
    for row, roll_deg in ((4, 65.0), (6, 0.0)):
        watch = watch_of()
        watch.finish(frames)
        at = frames["utc_ns"][row : row + 1]
        answer = Attitude.from_angles(10.0 * (row + 1), -1.0 * (row + 1), roll_deg).icrs_to_sensor
        looking, middle_ns = answer @ icrs_to_horizon(STATION.site, at)[0].T, frames["utc_ns"][4:5]
        for body, (vector,) in zip(("sun", "moon"), sun_and_moon_horizon(STATION.site, middle_ns), strict=True):
            apart_deg = math.degrees(math.acos(vector @ looking[2]))
            assert frames[f"{body}_separation_deg"] == pytest.approx([apart_deg] * 8, abs=1e-4)
        to_sensor = looking @ icrs_to_horizon(STATION.site, middle_ns)[0]
        expected = min(stars_in_field(CATALOG, STATION.sensor.camera(), to_sensor), 30)
        assert frames["stars_expected"].tolist() == [expected] * 8
        frames["status"][[0, 3]] = STATUSES.index(Status.NO_MATCH)


@pytest.mark.parametrize(("stars", "expected"), [(4200, 30.0), (60, 0.0)])
def test_stars_are_expected_as_many_as_the_field_has_and_a_panorama_holds(stars: int, expected: float) -> None:
    """A field of 53 deg holds more than 30 of the brightest 4200 stars, and a few of the brightest 60."""
    frames = rows(3, stars=0)
    frames["utc_ns"] = instants(0, 1, 2)
    camera, few = Camera(1000, 1000, 1000.0, (499.5, 499.5)), CATALOG.rows(slice(0, stars))
    SkyWatch(STATION.site, camera, few, STATION.mount).finish(frames)
    to_sensor = horizon_to_sensor(STATION.mount) @ icrs_to_horizon(STATION.site, frames["utc_ns"][1:2])[0]
    x, y, z = to_sensor @ few.icrs.T
    inside = int(((z > 0) & (np.abs(x) <= 0.5 * z) & (np.abs(y) <= 0.5 * z)).sum())
    assert inside > 30 if expected else 0 < inside < 30
    assert frames["stars_expected"].tolist() == [expected or inside] * 3


def test_without_a_confirmed_answer_the_direction_is_that_of_the_station_file_or_unknown() -> None:
    frames = rows(4, stars=0)
    frames["utc_ns"] = instants(0, 1, 2, 3)
    watch = watch_of()
    watch.finish(frames)
    zenith = np.array([0.0, 0.0, 1.0])
    sun = sun_and_moon_horizon(STATION.site, frames["utc_ns"][2:3])[0][0]
    assert frames["sun_separation_deg"] == pytest.approx([math.degrees(math.acos(sun @ zenith))] * 4, abs=1e-4)
    assert 0 < frames["stars_expected"][0] <= 30
    watch_of(None).finish(frames)
    for name in ("sun_separation_deg", "moon_separation_deg", "stars_expected"):
        assert np.isnan(frames[name]).all()
    assert np.isfinite(frames["sun_altitude_deg"]).all()


def test_a_sensor_that_shows_no_objects_expects_no_stars_and_has_an_unknown_sky() -> None:
    frames = rows(12, stars=0, objects=0)
    frames["utc_ns"] = instants(*range(12))
    watch = watch_of()
    assert watch.sees_objects
    watch.sees_objects = False
    events = [event for _, some in watch.take(frames, 0) for event in some] + watch.finish(frames)
    assert events == []
    assert np.isnan(frames["stars_expected"]).all()
    assert set(frames["sky_condition"].tolist()) == {SKY_CONDITIONS.index(SkyCondition.UNKNOWN)}
    assert np.isfinite(frames["sun_separation_deg"]).all()


@pytest.mark.parametrize(
    ("zero_point_mag", "transparency"),
    [(14.0, 1.0), (14.5, 1.0), (13.0, 10**-0.4), (11.5, 0.1), (9.0, 0.01), (-11.0, 1e-8), (math.nan, math.nan)],
)
def test_transparency_is_the_share_of_light_of_a_clear_night_one_at_most(
    zero_point_mag: float, transparency: float
) -> None:
    """Of a night with 17.25 mag at 1 s, which is 14 mag at 0.05 s; 20 mag is the end of the scale."""
    frames = rows(4, stars=14, zero_point_mag=zero_point_mag)
    frames["utc_ns"] = instants(0, 1, 2, 3)
    watch_of(stated_mag=14.0 - 2.5 * math.log10(0.05)).finish(frames)
    assert frames["transparency"] == pytest.approx([transparency] * 4, rel=1e-5, nan_ok=True)


def test_the_clear_sky_is_sought_anew_when_the_session_is_longer_by_a_tenth() -> None:
    watch, due = watch_of(), []
    frames = rows(40, stars=14)
    frames["utc_ns"] = instants(*range(0, 240, 6))
    for row in range(40):
        watch.take(frames[: row + 1], row)
        due.append(watch._reference_due)
    assert due[0] == 1
    assert due[1:5] == [2, 3, 4, 5]
    assert 20 < due[20] <= 22
    assert 36 < due[36] <= 40


def test_stars_in_the_field_are_those_that_a_pinhole_shows() -> None:
    rotation = Attitude.from_angles(83.0, 20.0, 40.0).icrs_to_sensor
    x, y, z = rotation @ CATALOG.icrs.T
    for focal_length_px in (300.0, 2000.0):
        camera = Camera(800, 1200, focal_length_px, (599.5, 399.5))
        wide, high = 600 / focal_length_px, 400 / focal_length_px
        expected = ((z > 0) & (np.abs(x) <= wide * z) & (np.abs(y) <= high * z)).sum()
        assert expected > 30
        assert stars_in_field(CATALOG, camera, rotation) == expected


def test_stars_far_beyond_the_field_are_not_folded_into_it_by_distortion() -> None:
    """With k1 = 1 the detector's corner shows what an undistorted one has at three times the distance."""
    rotation = Attitude.from_angles(83.0, 20.0, 40.0).icrs_to_sensor
    camera = Camera(1000, 1000, 2000.0, (499.5, 499.5), radial_distortion=(1.0, 0.0))
    corner_rad = math.atan2(math.hypot(500, 500), 2000.0)
    near = (rotation @ CATALOG.icrs.T)[2] > math.cos(1.1 * corner_rad)
    seen = camera.contains(camera.pixels(CATALOG.icrs @ rotation.T))
    assert (seen & ~near).sum() > 10
    assert stars_in_field(CATALOG, camera, rotation) == (seen & near).sum()
