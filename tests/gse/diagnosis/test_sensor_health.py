"""Health of the sensor: what the stars and the telemetry of a session tell of it, and no more."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from skies.known_nights import START_NS, session

from drivers.link import SerialLink
from drivers.urlhandlers.protocol_sim import register
from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.diagnosis.sensor_health import (
    CentroidNoise,
    SensorHealth,
    Trend,
    _hot_pixel_trend,
    _supply,
    _thermometer,
    _trend,
    health_findings,
    sensor_health,
)
from gse.recording.session_format import RecordedTimings
from gse.simulator import device_factory
from gse.station.columns import SKY_CONDITIONS
from gse.station.housekeeping import MODES, in_words
from gse.station.loop import StationLoop
from gse.station.results import SkyCondition
from gse.station.session_data import SessionData
from gse.station.setup import set_up
from gse.values.instant import NS_PER_S
from protocols import StatusMessage

LOOK = "; next: look at the frames with gse decode, and at the protocol file"
AGEING = """\
text: Twenty minutes of a sensor with hot pixels and false objects whose lens dews over and whose supply drops.
seconds: 1200
rate_hz: 0.5
detector: {hot_pixels: 6, hot_pixel_index: [300, 900], false_objects: 1.5}
air: {dew_magnitudes: [[0, 0], [1200, 0.3]]}
firmware: {supply_v: [[0, 5.0], [900, 5.0], [901, 4.2]]}
"""


@pytest.fixture(scope="module")
def ageing(tmp_path_factory: pytest.TempPathFactory) -> SessionData:
    path: Path = tmp_path_factory.mktemp("scenario") / "ageing.yaml"
    path.write_text(AGEING)
    station = parse_station(BUILT_IN_TEXT)
    register(device_factory(station))
    with SerialLink(f"sim://?scenario={path}") as link:
        return StationLoop(set_up(station, BUILT_IN_TEXT), recorded=RecordedTimings()).run(link)


def findings(made: SessionData) -> list[str]:
    return [str(finding) for finding in health_findings(made, sensor_health(made))]


def test_a_lens_that_dews_over_is_a_drift_of_the_brightness_scale(ageing: SessionData) -> None:
    drift = sensor_health(ageing).brightness_mag_per_h
    assert drift is not None
    # 0.3 mag in 20 minutes; an index value holds the sky and an offset of 20 too, which do not change with the dew.
    assert drift.slope == pytest.approx(-0.9, abs=0.2)
    assert drift.high < 0
    assert any(line.startswith("brightness scale: the same stars become fainter") for line in findings(ageing))


def test_hot_pixels_and_false_objects_are_counted_per_frame(ageing: SessionData) -> None:
    health = sensor_health(ageing)
    assert health.hot_pixels == pytest.approx(6, abs=1)
    assert 0.4 < health.false_objects < 1.7  # those that are as bright as the stars of the catalogue


def test_a_star_of_whole_pixels_has_their_noise(ageing: SessionData) -> None:
    noise = sensor_health(ageing).centroid_noise
    assert noise is not None
    # Whole pixels leave 1 / sqrt(12) px; the simulated sensor adds 10 of its 49.5 arcsec.
    assert noise.median_px == pytest.approx(math.hypot(1 / math.sqrt(12), 10 / 49.5), abs=0.06)
    assert noise.noisy_stars == 0


def test_the_simulated_sensor_sends_its_housekeeping_every_ten_seconds(ageing: SessionData) -> None:
    kept = sensor_health(ageing).housekeeping
    assert kept is not None
    assert kept.frames == 119
    assert kept.supply_v == (4.2, 5.0)
    assert (kept.modes, kept.firmware, kept.serial) == (("streaming",), ("1.2.0",), (14014,))


def test_the_frames_have_the_housekeeping_of_their_time(ageing: SessionData) -> None:
    frames = ageing.frames.columns
    assert np.isnan(frames["supply_v"][0])
    assert frames["supply_v"][-1] == pytest.approx(4.2)
    assert MODES[frames["mode"][-1]].value == "streaming"


def test_a_supply_that_drops_is_a_finding(ageing: SessionData) -> None:
    assert any(line.startswith("supply voltage: it fell to 4.20 V from 5.00 V") for line in findings(ageing))


def test_a_supply_that_falls_all_the_time_is_told_from_its_start() -> None:
    made = with_statuses()
    made.statuses = [
        (at, replace(message, supply_v=5.0 - number / 150)) for number, (at, message) in enumerate(made.statuses)
    ]
    (line,) = findings(made)
    assert line.startswith("supply voltage: it fell to 4.21 V from 4.99 V")


# Telemetry by hand


def with_statuses(**changes: object) -> SessionData:
    """Twenty minutes with a STATUS every 10 s, changed in all of them."""
    made = session(1200)
    made.frames.columns["utc_ns"] = START_NS + np.arange(1200) * NS_PER_S
    made.frames.columns["temperature_c"] = 20 + 0.01 * (np.arange(1200) % 7)
    values = {"supply_v": 5.0, "mode": "streaming", "firmware": (1, 2, 0), "serial": 7, **changes}
    made.statuses = [
        (
            START_NS + number * 10 * NS_PER_S,
            StatusMessage(time_us=number * 10_000_000, **({"temperature_c": 20 + number / 100} | values)),  # type: ignore[arg-type]
        )
        for number in range(120)
    ]
    return made


@pytest.mark.parametrize(("mag_per_h", "word"), [(0.6, "brighter"), (-0.6, "fainter"), (2.5, "brighter")])
def test_stars_that_change_their_brightness_are_told_with_the_direction(mag_per_h: float, word: str) -> None:
    made = with_statuses()
    slope = Trend(mag_per_h, mag_per_h - 0.01, mag_per_h + 0.01)
    health = replace(sensor_health(made), brightness_mag_per_h=slope)
    (finding,) = health_findings(made, health)
    assert f"the same stars become {word} by {abs(mag_per_h):.2f} mag/h" in finding.size


def test_hot_pixels_per_kelvin_are_those_that_were_put_in() -> None:
    made = with_statuses()
    frames, noise = made.frames.columns, np.random.default_rng(2)
    frames["temperature_c"], frames["stars_seen"] = 20 + 10 * np.arange(1200) / 1200, 10
    frames["hot_pixels"] = np.round(1.5 * (frames["temperature_c"] - 20) + noise.normal(3, 0.5, 1200)).clip(0)
    found = sensor_health(made).hot_pixels_per_k
    assert found is not None
    assert found.slope == pytest.approx(1.5, rel=0.05)
    assert found.low < 1.5 < found.high


def test_sound_telemetry_is_no_finding() -> None:
    assert findings(with_statuses()) == []


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"supply_v": 0.0}, "the supply voltage is 0 V"),
        ({"temperature_c": 20.0}, "the temperature is 20.00 degC in all 120 STATUS frames"),
        ({"temperature_c": 0.0}, "the temperature is 0.00 degC in all 120 STATUS frames"),
        ({"problems": ("supply is nan: no number of ordinary size",)}, "120 of 120 STATUS frames are invalid"),
    ],
    ids=["no supply", "frozen", "zero", "invalid"],
)
def test_zero_frozen_or_invalid_telemetry_is_a_finding(changes: dict[str, object], words: str) -> None:
    (line,) = findings(with_statuses(**changes))
    assert words in line


@pytest.mark.parametrize(("with_status", "count"), [(False, 0), (True, 1)])
def test_a_temperature_of_panoramas_that_stands_still_is_a_finding_where_status_moves(with_status, count) -> None:
    made = with_statuses()
    made.frames.columns["temperature_c"] = 20.0
    if not with_status:
        made.statuses = []
    lines = findings(made)
    assert (
        lines
        == [
            "telemetry: the temperature is 20.00 degC in all 1200 panoramas; this session cannot tell it apart"
            f" from: a coarse thermometer{LOOK}"
        ][:count]
    )


def test_a_temperature_that_is_sometimes_no_number_is_a_finding() -> None:
    made = with_statuses()
    made.frames.columns["temperature_c"][100:150] = math.nan
    assert findings(made) == [f"telemetry: the temperature is not a number in 50 of 1200 panoramas{LOOK}"]


def test_a_protocol_without_telemetry_is_no_finding() -> None:
    made = with_statuses(supply_v=math.nan, temperature_c=math.nan)
    made.frames.columns["temperature_c"] = math.nan
    assert findings(made) == []


def test_a_status_that_stands_still_is_a_finding() -> None:
    made = with_statuses()
    made.statuses = [(utc_ns, made.statuses[0][1]) for utc_ns, _ in made.statuses]
    assert any("the STATUS time stands still in 119 of 120" in line for line in findings(made))


def test_two_copies_of_one_status_are_no_clock_that_stands_still() -> None:
    made = with_statuses()
    made.statuses = [status for status in made.statuses for _ in (1, 2)]
    assert findings(made) == []


@pytest.mark.parametrize(("temperature_c", "count"), [(0.0, 1), (1.0, 0), (20.0, 0)])
def test_zero_is_no_temperature_long_before_another_one_stands_still(temperature_c: float, count: int) -> None:
    made = with_statuses(temperature_c=temperature_c)
    made.statuses = made.statuses[:40]
    lines = findings(made)
    assert len(lines) == count
    assert all("0.00 degC in all 40 STATUS frames" in line for line in lines)


# Stars by hand


@pytest.fixture(scope="module")
def steady() -> SessionData:
    """Ten stars of which each keeps its place on a pixel, and where it is off."""
    return session(40, matches=tuple((100.0 * star, 50.0, 20.0 * star, -30.0) for star in range(1, 11)))


def noise_of(steady: SessionData, noise_px: list[float], index: list[float]) -> CentroidNoise:
    """What is found where each star scatters by so much on both axes, and has so great an index value."""
    matches = steady.frames.matches
    places = {"residual_x_arcsec": 20.0 * (matches["star"] + 1), "residual_y_arcsec": -30.0}
    pixel_arcsec = math.degrees(steady.station.sensor.camera().pixel_rad) * 3600
    generator = np.random.default_rng(4)
    for name, place in places.items():
        scatter = generator.normal(size=(40, 10))
        scatter /= np.sqrt((np.diff(scatter, axis=0) ** 2).mean(axis=0) / 2)  # exactly one, from frame to frame
        matches[name] = place + (scatter * noise_px).ravel() * pixel_arcsec
    matches["brightness"] = np.tile(index, 40)
    found = sensor_health(steady).centroid_noise
    assert found is not None
    return found


def test_the_noise_of_centroids_follows_their_light(steady: SessionData) -> None:
    index = np.geomspace(50, 5000, 10)
    found = noise_of(steady, np.sqrt(0.1**2 + 2.0**2 / index), index)
    assert (found.stars, found.noisy_stars) == (10, 0)
    assert (found.floor_px, found.photon_px) == (pytest.approx(0.1, rel=1e-3), pytest.approx(2.0, rel=1e-3))
    assert found.median_px == pytest.approx(np.median(np.sqrt(0.01 + 4 / index)), rel=1e-4)


def test_stars_that_scatter_three_times_as_much_as_their_light_explains_are_counted(steady: SessionData) -> None:
    """They do not enter what light explains: the others keep their floor. The sensor sends no brightness."""
    found = noise_of(steady, [0.1] * 8 + [0.32, 5.0], [500.0] * 10)
    assert found.noisy_stars == 2
    assert found.floor_px == pytest.approx(0.1, rel=1e-3)
    assert noise_of(steady, [0.1] * 8 + [0.28, 5.0], [500.0] * 10).noisy_stars == 1


def test_a_bright_star_may_scatter_less_than_a_faint_one_only(steady: SessionData) -> None:
    """Of index value 10 000 they scatter by 0.02 px: three times as much is 0.06, whatever those of 100 do."""
    for noise_px, count in ((0.0605, 1), (0.0595, 0)):
        index = [10_000.0] * 7 + [100.0] * 3
        assert noise_of(steady, [0.02] * 6 + [noise_px] + [0.05] * 3, index).noisy_stars == count


def test_brighter_stars_that_scatter_more_have_a_floor_and_no_light(steady: SessionData) -> None:
    found = noise_of(steady, [0.1, 0.11, 0.12, 0.13, 0.14] * 2, [100.0, 200.0, 300.0, 400.0, 500.0] * 2)
    assert found.photon_px == 0.0
    assert found.floor_px == pytest.approx(math.sqrt(np.mean(np.array([0.1, 0.11, 0.12, 0.13, 0.14]) ** 2)), rel=1e-3)


def test_stars_whose_noise_falls_faster_than_light_explains_have_no_floor(steady: SessionData) -> None:
    index = np.array([100.0, 200.0, 400.0, 800.0, 1600.0] * 2)
    noise = 10 / index
    found = noise_of(steady, noise, index)
    assert found.floor_px == 0.0
    near = noise <= 3 * np.median(noise)
    assert found.photon_px == pytest.approx(math.sqrt(np.mean(noise[near] ** 2) / np.mean(1 / index[near])), rel=1e-3)


def test_stars_without_light_count_as_those_of_index_value_one(steady: SessionData) -> None:
    noise = np.sqrt(0.1**2 + 0.2**2 / np.array([1.0, 1.0, 4.0, 16.0, 64.0] * 2))
    found = noise_of(steady, noise, [0.0, 0.5, 4.0, 16.0, 64.0] * 2)
    assert (found.floor_px, found.photon_px) == (pytest.approx(0.1, rel=1e-3), pytest.approx(0.2, rel=1e-3))


@pytest.mark.parametrize(("stars", "is_told"), [(4, False), (5, True)])
def test_the_noise_of_centroids_takes_five_stars(stars: int, is_told: bool) -> None:
    made = session(40, matches=tuple((100.0 * star, 50.0, 2.0 * star, -3.0) for star in range(1, stars + 1)))
    assert (sensor_health(made).centroid_noise is not None) is is_told


@pytest.mark.parametrize(("frames", "is_told"), [(29, False), (30, True)])
def test_a_star_tells_its_noise_in_thirty_frames(frames: int, is_told: bool) -> None:
    made = session(frames, matches=tuple((100.0 * star, 50.0, 2.0 * star, -3.0) for star in range(1, 6)))
    assert (sensor_health(made).centroid_noise is not None) is is_told


@pytest.mark.parametrize(("noisy", "count"), [(5, 0), (6, 1)])
def test_more_than_half_of_the_stars_must_scatter_too_much(noisy: int, count: int) -> None:
    made = with_statuses()
    health = replace(sensor_health(made), centroid_noise=CentroidNoise(10, 0.3, 0.1, 0.0, noisy))
    told = [finding for finding in health_findings(made, health) if finding.cause == "centroid noise"]
    assert [finding.size for finding in told] == [f"{noisy} of 10 stars scatter more than their light explains"] * count


# Where a figure begins to count


@pytest.mark.parametrize(
    ("slope", "count"),
    [((0.101, 0.05, 0.15), 1), ((0.1, 0.05, 0.15), 0), ((-0.101, -0.15, -0.05), 1), ((0.2, -0.01, 0.41), 0)],
)
def test_a_drift_of_brightness_is_a_finding_beyond_a_tenth_of_a_magnitude_where_it_is_certain(
    slope: tuple[float, float, float], count: int
) -> None:
    made = with_statuses()
    health = replace(sensor_health(made), brightness_mag_per_h=Trend(*slope))
    assert [finding.cause for finding in health_findings(made, health)] == ["brightness scale"] * count


@pytest.mark.parametrize(
    ("low", "high", "is_certain"), [(0.1, 0.2, True), (-0.2, -0.1, True), (-0.1, 0.1, False), (0.0, 0.0, False)]
)
def test_a_trend_is_certain_where_its_interval_excludes_zero(low: float, high: float, is_certain: bool) -> None:
    assert Trend(0.0, low, high).is_certain is is_certain


@pytest.mark.parametrize(("least_v", "count"), [(4.5, 0), (4.49, 1)])
def test_a_supply_falls_where_it_loses_more_than_a_tenth(least_v: float, count: int) -> None:
    made = with_statuses()
    at_ns, message = made.statuses[50]
    made.statuses[50] = at_ns, replace(message, supply_v=least_v)
    assert [line.split(":")[0] for line in findings(made)] == ["supply voltage"] * count
    told = sensor_health(made).housekeeping
    assert told is not None
    assert told.supply_v == (least_v, 5.0)


def test_a_supply_that_is_sometimes_no_number_is_counted() -> None:
    made = with_statuses()
    for place in range(7):
        made.statuses[place] = made.statuses[place][0], replace(made.statuses[place][1], supply_v=math.nan)
    assert findings(made) == [f"telemetry: the supply voltage is not a number in 7 of 120 STATUS frames{LOOK}"]


@pytest.mark.parametrize(("range_k", "is_told"), [(1.9, False), (2.1, True)])
def test_hot_pixels_per_kelvin_take_two_kelvins(range_k: float, is_told: bool) -> None:
    made = with_statuses()
    frames = made.frames.columns
    frames["stars_seen"], frames["temperature_c"] = 10, 20 + np.linspace(0, range_k, 1200)
    frames["hot_pixels"] = np.arange(1200) // 300
    assert (sensor_health(made).hot_pixels_per_k is not None) is is_told


@pytest.mark.parametrize(
    ("count", "every_s", "is_told"),
    [(100, 7.0, True), (99, 7.0, False), (101, 6.0, True), (101, 5.9, False)],
    ids=["a hundred", "fewer than a hundred", "ten minutes", "less than ten minutes"],
)
def test_a_thermometer_stands_still_after_a_hundred_numbers_and_ten_minutes(
    count: int, every_s: float, is_told: bool
) -> None:
    made = with_statuses(temperature_c=20.0)
    first = made.statuses[0][1]
    made.statuses = [
        (START_NS + round(place * every_s * NS_PER_S), replace(first, time_us=round(place * every_s * 1e6)))
        for place in range(count)
    ]
    assert len(findings(made)) == is_told


@pytest.mark.parametrize(("count", "is_told"), [(29, False), (30, True)])
def test_a_temperature_of_zero_is_told_after_thirty_numbers(count: int, is_told: bool) -> None:
    made = with_statuses(temperature_c=0.0)
    made.statuses = made.statuses[:count]
    assert len(findings(made)) == is_told


def test_two_serial_numbers_are_two_sensors() -> None:
    made = with_statuses()
    made.statuses[60] = made.statuses[60][0], replace(made.statuses[60][1], serial=8)
    assert findings(made) == [f"telemetry: the serial number changes: 7, 8{LOOK}"]


def test_bad_commands_are_the_most_that_were_counted() -> None:
    made = with_statuses(commands_bad=2)
    made.statuses[3] = made.statuses[3][0], replace(made.statuses[3][1], commands_bad=5)
    told = sensor_health(made).housekeeping
    assert told is not None
    assert (told.commands_bad, told.frames) == (5, 120)


@pytest.mark.parametrize(("step_s", "is_told"), [(600 / 39 - 0.01, False), (600 / 39 + 0.01, True)])
def test_the_light_of_stars_tells_a_drift_after_ten_minutes(step_s: float, is_told: bool) -> None:
    """Ten stars of which each becomes fainter by 0.3 mag/h; half of them with an exposure of twice the time."""
    made = session(40, step_s=step_s, matches=tuple((100.0 * star, 50.0, 0.0, 0.0) for star in range(1, 11)))
    frames, matches = made.frames.columns, made.frames.matches
    frames["sky_condition"], frames["transparency"] = SKY_CONDITIONS.index(SkyCondition.CLEAR), 1.0
    frames["exposure_s"] = np.where(np.arange(40) % 2, 0.1, 0.05)
    hours = step_s / 3600 * matches["frame"]
    light = 10 ** (-0.4 * 0.3 * hours) * (1 + matches["star"]) * frames["exposure_s"][matches["frame"]]
    matches["brightness"] = 1000 * light
    drift = sensor_health(made).brightness_mag_per_h
    assert (drift is not None) is is_told
    if drift is not None:
        assert drift.slope == pytest.approx(-0.3, abs=0.01)


def test_housekeeping_is_told_in_a_line_without_what_the_protocol_lacks() -> None:
    message = StatusMessage(temperature_c=21.04, mode="streaming", serial=7)
    assert in_words(message) == "streaming, 21.0 degC, serial 7"


@pytest.mark.parametrize("count", [5, 6, 59, 60, 61, 500])
def test_a_trend_is_that_of_the_means_of_sixty_parts_or_of_every_value(count):
    at = np.arange(float(count))
    found = _trend(at, 3.0 * at - 7.0)
    assert (found.slope, found.low, found.high) == pytest.approx((3.0, 3.0, 3.0))
    assert _trend(at[:4], at[:4]) is None
    assert _trend(np.zeros(count), at) is None


# By hand


def test_counts_are_means_over_the_frames_with_stars_alone() -> None:
    made = session(4)
    frames = made.frames.columns
    frames["stars_seen"] = [0, 1, 2, 0]
    for name, values in (("objects", [9, 10, 20, 9]), ("hot_pixels", [9, 2, 3, 9]), ("false_objects", [9, 0, 1, 9])):
        frames[name] = values
    health = sensor_health(made)
    assert (health.objects, health.hot_pixels, health.false_objects) == (15.0, 2.5, 0.5)
    frames["stars_seen"] = 0
    assert math.isnan(sensor_health(made).objects)


def test_two_kelvins_are_enough_and_nothing_is_told_of_an_unknown_temperature() -> None:
    made = session(300)
    frames = made.frames.columns
    frames["stars_seen"], frames["hot_pixels"] = 1, np.arange(300) // 30
    frames["temperature_c"] = 20 + 2 * np.arange(300) / 299
    assert sensor_health(made).hot_pixels_per_k is not None
    frames["temperature_c"] = math.nan
    assert sensor_health(made).hot_pixels_per_k is None


def test_a_trend_is_of_sixty_means_in_which_a_change_from_one_value_to_the_next_is_lost() -> None:
    """Of 120 values, two to a mean: fewer or more means would take one of a pair without the other."""
    at = np.arange(120.0)
    found = _trend(at, 3 * at + 40 * (-1.0) ** at)
    assert found is not None
    assert (found.slope, found.low, found.high) == pytest.approx((3.0, 3.0, 3.0), abs=1e-9)


def fading(stars: int = 6, *, mag_per_h: float = -0.3) -> SessionData:
    """Forty frames of a clear quarter of an hour in which each star changes exactly so."""
    made = session(40, step_s=900 / 39, matches=tuple((100.0 * star, 50.0, 0.0, 0.0) for star in range(1, stars + 1)))
    frames, matches = made.frames.columns, made.frames.matches
    frames["sky_condition"], frames["transparency"] = SKY_CONDITIONS.index(SkyCondition.CLEAR), 1.0
    frames["exposure_s"] = 1.0
    hours = (frames["utc_ns"] - frames["utc_ns"][0]) / (3600 * NS_PER_S)
    matches["brightness"] = 100 * (1 + matches["star"]) * 10 ** (0.4 * mag_per_h * hours[matches["frame"]])
    return made


def drift_of(made: SessionData) -> tuple[float, float, float]:
    found = sensor_health(made).brightness_mag_per_h
    assert found is not None
    return found.slope, found.low, found.high


def test_the_drift_of_brightness_is_in_magnitudes_an_hour() -> None:
    assert drift_of(fading()) == pytest.approx((-0.3, -0.3, -0.3), abs=1e-5)
    assert drift_of(fading(mag_per_h=2.0)) == pytest.approx((2.0, 2.0, 2.0), abs=1e-5)


@pytest.mark.parametrize(("stars", "is_told"), [(4, False), (5, True)])
def test_the_drift_of_brightness_takes_five_stars(stars: int, is_told: bool) -> None:
    assert (sensor_health(fading(stars)).brightness_mag_per_h is not None) is is_told


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("sky_condition", SKY_CONDITIONS.index(SkyCondition.NO_STARS)),
        ("transparency", math.nan),
        ("sun_altitude_deg", -14.9),
    ],
    ids=["without stars", "of unknown transparency", "in twilight"],
)
def test_other_frames_than_clear_ones_tell_no_drift_of_brightness(name: str, value: float) -> None:
    made = fading()
    rows = np.arange(40) % 3 == 0
    made.frames.columns[name][rows] = value
    made.frames.matches["brightness"][rows[made.frames.matches["frame"]]] = 7.0
    assert drift_of(made) == pytest.approx((-0.3, -0.3, -0.3), abs=1e-5)
    made.frames.columns[name] = value
    assert sensor_health(made).brightness_mag_per_h is None


def test_stars_near_a_cloud_tell_no_drift_of_brightness() -> None:
    """Half an hour with a cloud at its end: ten minutes before it are thin cloud."""
    made = fading()
    frames = made.frames.columns
    frames["utc_ns"] = START_NS + np.linspace(0, 1800 * NS_PER_S, 40).astype(np.int64)
    frames["sky_condition"][-1] = SKY_CONDITIONS.index(SkyCondition.CLOUDED)
    near = frames["utc_ns"] > frames["utc_ns"][-1] - 600 * NS_PER_S
    made.frames.matches["brightness"][near[made.frames.matches["frame"]]] = 7.0
    assert drift_of(made) == pytest.approx((-0.15, -0.15, -0.15), abs=1e-5)


def test_a_star_without_brightness_tells_no_drift() -> None:
    made = fading()
    made.frames.matches["brightness"][::7] = 0.0
    assert drift_of(made) == pytest.approx((-0.3, -0.3, -0.3), abs=1e-5)


def test_an_exposure_that_is_not_sent_counts_as_one_second() -> None:
    made = fading()
    made.frames.columns["exposure_s"][::2] = 0.0
    assert drift_of(made) == pytest.approx((-0.3, -0.3, -0.3), abs=1e-5)


def test_ten_minutes_exactly_tell_a_drift_of_brightness() -> None:
    made = fading()
    made.frames.columns["utc_ns"] = START_NS + np.linspace(0, 600 * NS_PER_S, 40).astype(np.int64)
    assert sensor_health(made).brightness_mag_per_h is not None


def test_of_a_supply_the_median_of_the_first_five_is_its_start() -> None:
    """It falls by 0.02 V from one STATUS to the next."""
    made = with_statuses()
    made.statuses = [(at, replace(one, supply_v=5.0 - place / 50)) for place, (at, one) in enumerate(made.statuses)]
    assert findings(made)[0].startswith("supply voltage: it fell to 2.62 V from 4.96 V")


def test_a_supply_that_starts_low_fell_from_its_median() -> None:
    made = with_statuses()
    volts = [4.0] * 5 + [5.0] * 114 + [4.4]
    made.statuses = [(at, replace(one, supply_v=volt)) for volt, (at, one) in zip(volts, made.statuses, strict=True)]
    assert findings(made) == [
        "supply voltage: it fell to 4.00 V from 5.00 V; next: check cable and power supply"
    ]  # fmt: skip


def test_a_thermometer_that_stands_still_in_both_is_a_coarse_one() -> None:
    """Too few STATUS frames to say that it is frozen there."""
    made = with_statuses(temperature_c=20.0)
    made.frames.columns["temperature_c"] = 20.0
    made.statuses = made.statuses[:40]
    assert findings(made) == []


def test_zeros_of_status_frames_are_no_coarse_thermometer() -> None:
    (line,) = findings(with_statuses(temperature_c=0.0))
    assert line == f"telemetry: the temperature is 0.00 degC in all 120 STATUS frames{LOOK}"


def test_the_first_problem_of_the_first_invalid_status_is_told() -> None:
    made = with_statuses()
    for place, problems in ((3, ("first", "second")), (9, ("third",))):
        made.statuses[place] = made.statuses[place][0], replace(made.statuses[place][1], problems=problems)
    assert findings(made) == [f"telemetry: 2 of 120 STATUS frames are invalid: first{LOOK}"]


def test_of_many_serial_numbers_five_are_told() -> None:
    made = with_statuses()
    made.statuses = [(at, replace(one, serial=place % 7)) for place, (at, one) in enumerate(made.statuses)]
    assert findings(made) == [f"telemetry: the serial number changes: 1, 2, 3, 4, 5{LOOK}"]


def test_a_status_whose_time_stands_still_once_is_counted_once() -> None:
    made = with_statuses()
    made.statuses[10] = made.statuses[10][0], replace(made.statuses[10][1], time_us=made.statuses[9][1].time_us)
    assert findings(made) == [f"telemetry: the STATUS time stands still in 1 of 120 STATUS frames{LOOK}"]


def test_housekeeping_is_what_status_frames_said_each_once_in_their_order() -> None:
    made = session(1)
    told = [
        {"supply_v": 4.9, "temperature_c": math.nan, "mode": "streaming", "firmware": (1, 2, 0), "serial": 9},
        {"supply_v": 5.1, "temperature_c": -3.0, "mode": "standby", "firmware": (), "serial": 0},
        {"supply_v": 5.0, "temperature_c": 4.0, "mode": "", "firmware": (1, 3, 1), "serial": 9},
    ]
    made.statuses = [(START_NS + place, StatusMessage(**one)) for place, one in enumerate(told)]
    found = sensor_health(made).housekeeping
    assert found is not None
    assert (found.frames, found.supply_v, found.temperature_c) == (3, (4.9, 5.1), (-3.0, 4.0))
    assert (found.modes, found.firmware) == (("streaming", "standby"), ("1.2.0", "1.3.1"))
    assert (found.serial, found.commands_bad) == ((9,), 0)
    made.statuses = made.statuses[:1]
    kept = sensor_health(made).housekeeping
    assert kept is not None
    assert math.isnan(kept.temperature_c[0])
    assert math.isnan(kept.temperature_c[1])
    made.statuses = []
    assert sensor_health(made).housekeeping is None


# Each rule by itself


def thermometer(values: list[float], *, every_s: float = 10.0, may_stand_still: bool = False) -> list[str]:
    utc_ns = START_NS + np.round(np.arange(len(values)) * every_s * NS_PER_S).astype(np.int64)
    told = list(_thermometer("frames", utc_ns, np.array(values), may_stand_still=may_stand_still))
    assert all(one.equals in ((), ("a coarse thermometer",)) for one in told)
    return [one.size + (", or coarse" if one.equals else "") for one in told]


@pytest.mark.parametrize(
    ("values", "options", "told"),
    [
        ([], {}, []),
        ([math.nan] * 200, {}, []),
        ([20.0, 21.0] * 100, {}, []),
        ([20.0] * 100, {}, ["the temperature is 20.00 degC in all 100 frames, or coarse"]),
        ([20.0] * 99, {}, []),
        ([20.0] * 99, {"every_s": 100.0}, []),
        ([20.0] * 101, {"every_s": 6.0}, ["the temperature is 20.00 degC in all 101 frames, or coarse"]),
        ([20.0] * 101, {"every_s": 5.999}, []),
        ([20.0] * 100, {"may_stand_still": True}, []),
        ([20.0] * 99 + [20.5], {}, []),
        ([0.0] * 30, {}, ["the temperature is 0.00 degC in all 30 frames"]),
        ([0.0] * 30, {"may_stand_still": True}, ["the temperature is 0.00 degC in all 30 frames"]),
        ([0.0] * 29, {}, []),
        ([0.5] * 30, {}, []),
        ([1.0] * 30, {}, []),
        ([-1.0] * 30, {}, []),
        ([1.0] * 100, {}, ["the temperature is 1.00 degC in all 100 frames, or coarse"]),
        ([-1.0] * 100, {}, ["the temperature is -1.00 degC in all 100 frames, or coarse"]),
        ([0.0] * 100, {}, ["the temperature is 0.00 degC in all 100 frames"]),
        ([20.0, math.nan, 21.0, math.nan, 20.0], {}, ["the temperature is not a number in 2 of 5 frames"]),
        (
            [math.nan] + [20.0] * 100,
            {},
            [
                "the temperature is not a number in 1 of 101 frames",
                "the temperature is 20.00 degC in all 100 frames, or coarse",
            ],
        ),
        ([math.nan] + [20.0] * 99, {}, ["the temperature is not a number in 1 of 100 frames"]),
        # 600 s with the one that is no number, 594 without
        ([math.nan] + [20.0] * 100, {"every_s": 6.0}, ["the temperature is not a number in 1 of 101 frames"]),
    ],
)
def test_a_thermometer_is_told_that_gives_no_number_nought_or_always_the_same(
    values: list[float], options: dict[str, float], told: list[str]
) -> None:
    assert thermometer(values, **options) == told


@pytest.mark.parametrize(
    ("volts", "told"),
    [
        ([], []),
        ([math.nan] * 9, []),
        ([5.0] * 9, []),
        ([math.nan, 5.0, 5.0, math.nan], ["the supply voltage is not a number in 2 of 4 STATUS frames"]),
        ([0.0] * 5 + [5.0] * 4, ["the supply voltage is 0 V in most of 9 STATUS frames"]),
        ([5.0] * 4 + [0.0] * 5, ["the supply voltage is 0 V in most of 9 STATUS frames"]),
        ([5.0] * 8 + [4.5], []),
        ([5.0] * 8 + [4.49], ["it fell to 4.49 V from 5.00 V"]),
        ([4.4] * 5 + [5.0] * 6, ["it fell to 4.40 V from 5.00 V"]),
        ([6.0] * 3 + [5.0] * 9, ["it fell to 5.00 V from 6.00 V"]),  # the median of the first five
        ([6.0] * 2 + [5.0] * 9, []),
        ([1.0] * 9, []),
        ([0.4] * 8 + [0.3], ["it fell to 0.30 V from 0.40 V"]),
    ],
)
def test_a_supply_is_told_that_is_nought_gives_no_number_or_falls_by_a_tenth(
    volts: list[float], told: list[str]
) -> None:
    assert [one.size for one in _supply(np.array(volts))] == told


@pytest.mark.parametrize(("range_k", "is_told"), [(1.99, False), (2.0, True)])
def test_hot_pixels_have_a_trend_over_two_kelvins_whatever_the_order_of_the_frames(
    range_k: float, is_told: bool
) -> None:
    """Three of them for each."""
    order = np.random.default_rng(1).permutation(64)
    temperature_c = 8.0 + range_k * np.arange(64) / 63
    hot_pixels = 3 * (temperature_c - 8.0)
    with_gap = np.append(temperature_c[order], math.nan).astype(np.float64)
    found = _hot_pixel_trend(with_gap, np.append(hot_pixels[order], 250.0))
    assert (found is not None) is is_told
    if found is not None:
        assert (found.slope, found.low, found.high) == pytest.approx((3.0, 3.0, 3.0))


def health(**known: object) -> SensorHealth:
    nothing = {"objects": 0.0, "hot_pixels": 0.0, "hot_pixels_per_k": None, "false_objects": 0.0}
    nothing |= {"brightness_mag_per_h": None, "centroid_noise": None, "housekeeping": None}
    return SensorHealth(**(nothing | known))  # type: ignore[arg-type]


@pytest.mark.parametrize(("stars", "noisy", "is_told"), [(10, 5, False), (10, 6, True), (11, 5, False), (11, 6, True)])
def test_centroids_are_noisy_where_more_than_half_of_the_stars_are(stars: int, noisy: int, is_told: bool) -> None:
    found = list(health_findings(session(1), health(centroid_noise=CentroidNoise(stars, 0.3, 0.1, 0.0, noisy))))
    assert [one.cause for one in found] == ["centroid noise"] * is_told


@pytest.mark.parametrize(
    ("slope", "low", "high", "words"),
    [
        (0.11, 0.01, 0.2, "brighter by 0.11"),
        (-0.11, -0.2, -0.01, "fainter by 0.11"),
        (1.6, 1.0, 2.0, "brighter by 1.60"),
        (0.1, 0.01, 0.2, None),
        (-0.1, -0.2, -0.01, None),
        (0.5, -0.01, 1.0, None),
        (-0.5, -1.0, 0.01, None),
        (0.5, 0.0, 1.0, None),
    ],
)
def test_a_scale_of_brightness_drifts_by_more_than_a_tenth_that_is_certain(
    slope: float, low: float, high: float, words: str | None
) -> None:
    found = list(health_findings(session(1), health(brightness_mag_per_h=Trend(slope, low, high))))
    assert [one.size for one in found] == ([f"the same stars become {words} mag/h under a clear sky"] if words else [])
