"""Each scenario through sim:// and the station's own loop: the station finds what the scenario says it must."""

from dataclasses import replace
from pathlib import Path

import pytest

from drivers.link import SerialLink
from drivers.urlhandlers.protocol_sim import register
from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.errors import ConfigError
from gse.recording.session_format import RecordedTimings
from gse.simulator import device_factory
from gse.simulator.scenario import load_scenario, parse_scenario, profile_at, scenario_names
from gse.station.loop import StationLoop
from gse.station.session_data import SessionData
from gse.station.setup import Setup, set_up
from gse.verdict.assessment import judge

RATES_HZ = {"twilight": 0.5, "wrong-focal-length": 1}
"""Fewer frames than the scenario says, but enough for a verdict: 299 for the false answers, fewer where all fails."""


def night_of(url: str, setup: Setup) -> SessionData:
    """All that the station's loop makes of a simulated sensor; the clock is known to be right, the host's pace is not
    judged."""
    register(device_factory(setup.station))
    with SerialLink(url) as link:
        session = StationLoop(setup, recorded=RecordedTimings()).run(link)
    session.clock_error_s = 0.0
    return session


@pytest.fixture(scope="module")
def setup() -> Setup:
    return set_up(parse_station(BUILT_IN_TEXT), BUILT_IN_TEXT)


@pytest.mark.parametrize("name", scenario_names())
def test_the_station_finds_what_the_scenario_says(name: str, setup: Setup) -> None:
    scenario = load_scenario(name)
    station = parse_station(scenario.station_text())
    assert station.sensor == setup.station.sensor
    session = night_of(f"sim://?scenario={name}&rate_hz={RATES_HZ.get(name, 6.5)}", replace(setup, station=station))
    assessment = judge(session)
    expected = assessment.statistics.frames_expected
    share = assessment.statistics.onboard.available.value if expected else 0.0
    assert assessment.verdict.value == scenario.find.verdict, assessment.reasons
    for words in scenario.find.reasons:
        assert any(words in reason for reason in assessment.reasons)
    assert scenario.find.identified_at_least <= share <= scenario.find.identified_at_most
    assert set(scenario.find.events) <= {event.kind for event in session.events}
    assert assessment.statistics.onboard.false_answers.count == 0
    assert session.link.bytes_in == session.link.bytes_framed


ODD = """\
text: A mirrored, distorted detector off its axis, tilted and rolled, without noise.
rate_hz: 1
seconds: 40
station:
  protocol: panorama-v1-subpixel
  sensor: {mirrored: true, radial_distortion: [-0.003, 0.001], principal_point_px: [520.3, 498.1]}
  mount: {azimuth_deg: 200, altitude_deg: 35, roll_deg: -77}
optics: {position_noise_arcsec: 0}
"""


def test_without_noise_the_truth_is_where_the_simulated_sensor_looks(tmp_path: Path) -> None:
    (tmp_path / "odd.yaml").write_text(ODD)
    scenario = parse_scenario(ODD, "odd.yaml")
    session = night_of(f"sim://?scenario={tmp_path}/odd.yaml", set_up(parse_station(scenario.station_text()), ODD))
    axes = judge(session).statistics.onboard.axes
    assert axes["d_ra_cosde"].n == 40
    assert abs(axes["d_ra_cosde"].bias_arcsec) < 0.1
    assert abs(axes["d_de"].bias_arcsec) < 0.1
    assert abs(axes["d_roll"].bias_arcsec) < 1.0


@pytest.mark.parametrize("level", ["image", "image-sub-pixel"])
def test_whole_images_are_identified_as_well(level: str, setup: Setup) -> None:
    assessment = judge(night_of(f"sim://?level={level}&rate_hz=1&frames=8", setup))
    assert assessment.statistics.onboard.available.value == 1.0
    assert assessment.statistics.onboard.axes["d_de"].rms_arcsec < 15


def test_the_eight_scenarios_come_with_the_station() -> None:
    assert set(scenario_names()) >= {
        "clear-zenith",
        "inclined",
        "cloudy-night",
        "moonlit",
        "twilight",
        "cold-start",
        "hot-pixels",
        "wrong-focal-length",
    }


def test_the_device_may_be_other_than_the_station_file_says() -> None:
    scenario = load_scenario("wrong-focal-length")
    station = scenario.station_for(parse_station(BUILT_IN_TEXT))
    assert station == parse_station(BUILT_IN_TEXT)
    assert scenario.device_for(station).sensor.focal_length_px == 4211.6
    assert scenario.device_for(station).sensor.columns == 1024


def test_a_scenario_of_ones_own_is_read_from_a_file(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("text: mine\nseconds: 3\ndetector: {false_objects: 3}\n")
    scenario = load_scenario(str(path))
    assert (scenario.seconds, scenario.detector.false_objects, scenario.rate_hz) == (3, 3, 10)


def test_the_scenario_of_the_manual_is_one() -> None:
    manual = Path(__file__).parents[3] / "docs" / "simulator.md"
    text = manual.read_text().partition("```yaml\n")[2].partition("```")[0]
    assert parse_scenario(text, "manual").firmware.resets_s == (45,)
    assert all(f"| `{name}` |" in manual.read_text() for name in scenario_names())


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("text: [", "the text ends in the middle of something"),
        ("- a", "expected a mapping"),
        ("seconds: 3", "text"),
        ("text: a\nsecnods: 3", "secnods"),
        ("text: a\nseconds: -3", "seconds"),
        ("text: a\nstart: tomorrow", "2026-03-20T18:30:00Z"),
        ("text: a\nfind: {verdict: MAYBE}", "find.verdict"),
    ],
)
def test_a_wrong_scenario_is_refused_with_source_key_and_reason(text: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words) as error:
        parse_scenario(text, "mine.yaml")
    assert str(error.value).startswith(("mine.yaml: ", "mine.yaml, line "))


def test_a_change_that_makes_no_station_is_refused() -> None:
    scenario = parse_scenario("text: a\nstation: {site: {latitude_deg: 95}}", "mine.yaml")
    with pytest.raises(ConfigError, match=r"site\.latitude_deg"):
        scenario.station_for(parse_station(BUILT_IN_TEXT))


def test_a_profile_is_linear_between_its_points_and_held_outside() -> None:
    profile = ((0.0, 1.0), (10.0, 3.0), (10.0, 5.0))
    assert [profile_at(profile, at) for at in (-5, 0, 5, 10, 11)] == [1, 1, 2, 3, 5]
