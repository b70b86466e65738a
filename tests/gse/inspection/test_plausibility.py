"""What a station file cannot say, and the night to come, before the night."""

import pytest
from click.testing import CliRunner

from gse.cli.config import command as config
from gse.config.station import BUILT_IN_TEXT, Station, parse_station
from gse.inspection.plausibility import Check, CheckOutcome, plausibility
from gse.values.instant import from_text

ROOF = BUILT_IN_TEXT.replace("url: sim://", "url: /dev/ttyUSB0")


def changed(*changes: tuple[str, str]) -> Station:
    text = ROOF
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    return parse_station(text)


def found(station: Station, at: str = "2026-05-20T09:00:00Z", hours: float | None = None) -> dict[str, Check]:
    return {check.name: check for check in plausibility(station, from_text(at), hours)}


def only(name: str, station: Station, at: str = "2026-05-20T09:00:00Z", hours: float | None = None) -> Check:
    """One check, without those that come after it."""
    return next(check for check in plausibility(station, from_text(at), hours) if check.name == name)


def test_a_sound_station_has_its_field_its_night_and_its_stars_told() -> None:
    southwards = changed(("azimuth_deg: 0", "azimuth_deg: 180"), ("altitude_deg: 90", "altitude_deg: 60"))
    checks = found(southwards)
    assert {check.outcome for check in checks.values()} == {CheckOutcome.OK}
    assert checks["field"].text == "14 x 14 deg, 49.47 arcsec per pixel"
    # In steps of 5 minutes; tests/gse/truth/test_solar_system.py compares the Sun with astropy.
    assert checks["night"].text.startswith("sunset 2026-05-20T10:45Z; dark from 2026-05-20T11:35Z")
    assert "expected in the field, fewest at 2026-05-2" in checks["stars"].text
    assert "for a PASS with 90 % probability" in checks["length"].text


def test_a_focal_length_in_millimetres_is_refused() -> None:
    check = only("field", changed(("focal_length_px: 4169.905", "focal_length_px: 50")))
    assert check.outcome is CheckOutcome.FAIL
    assert check.text.startswith("168.8 x 168.8 deg")
    assert "focal length in mm / size of a pixel" in check.advice


@pytest.mark.parametrize(
    ("altitude_deg", "outcome"),
    [(-30, CheckOutcome.FAIL), (0, CheckOutcome.FAIL), (5, CheckOutcome.WARN), (45, CheckOutcome.OK)],
)
def test_a_boresight_below_the_horizon_is_refused_and_a_low_one_doubted(
    altitude_deg: int, outcome: CheckOutcome
) -> None:
    assert only("mount", changed(("altitude_deg: 90", f"altitude_deg: {altitude_deg}"))).outcome is outcome


@pytest.mark.parametrize(
    ("baudrate", "outcome", "words"),
    [
        (115200, CheckOutcome.OK, ""),
        (112500, CheckOutcome.FAIL, "did you mean 115200?"),
        (700_000, CheckOutcome.WARN, "did you mean 750000?"),
        (11520, CheckOutcome.WARN, "did you mean 115200?"),
        (96000, CheckOutcome.WARN, "did you mean 9600?"),
    ],
)
def test_a_baud_rate_that_no_uart_has_is_refused(baudrate: int, outcome: CheckOutcome, words: str) -> None:
    check = only("baud rate", changed(("url: /dev/ttyUSB0", f"url: /dev/ttyUSB0\n  baudrate: {baudrate}")))
    assert check.outcome is outcome
    assert words in check.advice


def test_a_mount_that_looks_at_the_sun_within_the_session_is_refused() -> None:
    overhead = changed()  # at 6.5 deg south the Sun passes near the zenith in March
    assert only("Sun", overhead, "2026-03-05T01:00:00Z", hours=8).outcome is CheckOutcome.FAIL
    assert only("Sun", overhead, "2026-03-05T09:00:00Z", hours=8).outcome is CheckOutcome.WARN
    assert only("Sun", overhead, "2026-06-20T01:00:00Z", hours=8).outcome is CheckOutcome.OK


def test_a_moon_in_the_field_is_doubted_with_its_time() -> None:
    # Full Moon on 2026-03-03; at this site it culminates 15 deg from the zenith near 17:00 UTC.
    checks = [only("Moon", changed(), f"2026-0{month}-03T09:00:00Z") for month in range(1, 7)]
    assert any(check.outcome is CheckOutcome.WARN for check in checks)
    assert all("% lit" in check.text for check in checks)


def test_a_narrow_field_with_too_few_stars_is_doubted_with_the_hour() -> None:
    narrow = changed(("focal_length_px: 4169.905", "focal_length_px: 15000"), ("altitude_deg: 90", "altitude_deg: 50"))
    text = ROOF.replace("port:", "identifier: {catalog_stars: 4000}\nport:").replace("4169.905", "15000")
    assert only("stars", narrow).outcome in (CheckOutcome.OK, CheckOutcome.WARN)
    check = only("stars", parse_station(text))
    assert check.outcome is CheckOutcome.WARN
    assert "fewer than 7" in check.text


def test_a_field_that_has_too_few_stars_all_night_has_no_length_of_a_session() -> None:
    bright = ROOF.replace("port:", "identifier: {catalog_stars: 300}\nport:")
    checks = found(parse_station(bright.replace("4169.905", "15000")))
    assert "fewer than 7 all night" in checks["stars"].text
    assert "length" not in checks
    assert "length" in found(parse_station(bright.replace("4169.905", "1500")))


@pytest.mark.parametrize(
    ("latitude_deg", "at", "words"),
    [
        (78.2, "2026-06-20T12:00:00Z", "the Sun does not set; no dark sky"),
        (78.2, "2026-12-20T12:00:00Z", "the Sun does not rise; dark from"),
        (-90.0, "2026-07-01T00:00:00Z", "the Sun does not rise; dark from 2026-07-01T00:00Z"),
    ],
)
def test_the_poles_have_their_own_nights(latitude_deg: float, at: str, words: str) -> None:
    assert words in only("night", changed(("latitude_deg: -6.53", f"latitude_deg: {latitude_deg}")), at).text


def test_a_simulated_session_has_no_night_to_come() -> None:
    checks = found(parse_station(BUILT_IN_TEXT), "2026-03-05T01:00:00Z", hours=8)
    assert {check.outcome for check in checks.values()} == {CheckOutcome.OK}


def test_config_check_refuses_what_cannot_be_and_says_what_is_doubtful(tmp_path) -> None:
    path = tmp_path / "roof.yaml"
    path.write_text(ROOF)
    done = CliRunner().invoke(config, ["check", str(path), "--start-utc", "2026-03-05T01:00:00Z"])
    assert done.exit_code == 0
    assert "doubtful: Sun: it comes into the field" in done.stderr
    assert "field: 14 x 14 deg" in done.stdout
    path.write_text(ROOF.replace("altitude_deg: 90", "altitude_deg: -30"))
    done = CliRunner().invoke(config, ["check", str(path)])
    assert "the boresight is below the horizon" in str(done.exception)
    assert "is good" not in done.output
