"""The station file is checked at the door, and every refusal helps."""

import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gse.config.station import BUILT_IN_TEXT, Station, parse_station, read_station
from gse.errors import ConfigError
from gse.procedure.file import parse_procedure
from gse.simulator.scenario import parse_scenario
from protocols.errors import DescriptionError
from protocols.protocol import parse_protocol

SMALLEST = """\
version: 1
sensor: {rows: 1024, columns: 1280, focal_length_px: 4000}
site: {latitude_deg: 52.2, longitude_deg: 4.4}
"""


def refusal(text: str) -> str:
    with pytest.raises(ConfigError) as refused:
        parse_station(text, "roof.yaml")
    return str(refused.value)


def test_everything_but_sensor_and_site_has_defaults() -> None:
    station = parse_station(SMALLEST)
    assert station.mount.altitude_deg == 90
    assert station.port.url == "sim://"
    assert station.limits.d_de_arcsec == 60


def test_the_built_in_station_sees_fourteen_degrees() -> None:
    camera = parse_station(BUILT_IN_TEXT).sensor.camera()
    corners = camera.directions([[-0.5, 511.5], [1023.5, 511.5]])  # type: ignore[arg-type]
    assert abs(corners[0] @ corners[1] - 0.9702957) < 1e-6  # cos 14 deg


def test_the_principal_point_is_the_middle_of_pixels_counted_from_zero() -> None:
    assert parse_station(SMALLEST).sensor.camera().principal_point_px == (639.5, 511.5)


def test_an_unknown_key_is_named_with_its_line_and_the_nearest_known_key() -> None:
    text = SMALLEST.replace("site: {", "site: {hieght_m: 3, ")
    assert refusal(text) == "roof.yaml, line 3: unknown key site.hieght_m; did you mean height_m?"


def test_a_key_of_a_stranger_is_named_in_part() -> None:
    assert len(refusal("? " + "x" * 90_000 + "\n: 1\n")) < 1000


def test_a_latitude_of_95_is_refused_with_its_line() -> None:
    message = refusal(SMALLEST.replace("52.2", "95"))
    assert message.startswith("roof.yaml, line 3: site.latitude_deg is 95")
    assert "90" in message


@pytest.mark.parametrize("text", ["", "- 1", "just words", "a: [", "version: 1", "{" * 2000, "&a [*a]", "1: 2"])
def test_what_is_no_station_file_is_refused_in_words(text: str) -> None:
    assert refusal(text).startswith("roof.yaml")


def test_a_distortion_that_folds_the_picture_is_refused_with_the_place() -> None:
    message = refusal(SMALLEST.replace("4000}", "4000, radial_distortion: [-0.25, 0.0]}"))
    assert message.startswith("roof.yaml, line 2: sensor: the distortion folds the picture at pixel (")
    assert "radii are in units of half the columns" in message


KINDS = ("timestamp", "bool", "int", "float", "binary", "omap", "pairs", "set", "map", "seq", "str", "merge", "x")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("value", ["x", "''", "é", "[1]", "{a: b}", "2020-99-99", "0x", "1:x"])
def test_a_value_that_is_not_of_the_kind_that_its_tag_says_is_refused_with_its_line(kind: str, value: str) -> None:
    message = refusal(SMALLEST.replace("52.2", f"!!{kind} {value}"))
    assert message.startswith("roof.yaml, line 3: ")


@given(st.recursive(st.none() | st.booleans() | st.floats() | st.text(max_size=5), lambda inner: st.lists(inner)))
def test_any_value_in_place_of_a_section_is_refused_or_taken_but_never_a_crash(value: object) -> None:
    document = {"version": 1, "sensor": value, "site": value}
    with pytest.raises(ConfigError):
        parse_station(str(document), "roof.yaml")


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"no\.yaml.*gse config init"):
        read_station(tmp_path / "no.yaml")


def test_a_file_of_a_gigabyte_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "big.yaml"
    with path.open("wb") as file:
        file.truncate(1 << 30)
    with pytest.raises(ConfigError, match="larger"):
        read_station(path)


def test_a_not_a_number_is_refused() -> None:
    assert "latitude_deg" in refusal(SMALLEST.replace("52.2", ".nan"))


def test_align_gives_its_seconds() -> None:
    station = parse_station(SMALLEST + "mount: {align: first 60 s}\n")
    assert station.mount.align_s == 60
    assert isinstance(station, Station)


def test_a_station_file_of_a_newer_version_asks_for_a_newer_gse() -> None:
    told = refusal(SMALLEST.replace("version: 1", "version: 2"))
    assert told == "roof.yaml, line 1: version is 2; this gse reads version 1: install a newer gse"


@pytest.mark.parametrize("limit", ["d_de_arcsec: .inf", "d_roll_arcsec: 648001", "identification_ms: .inf"])
def test_a_limit_that_nothing_exceeds_is_refused(limit):
    with pytest.raises(ConfigError, match=r"expected (at most|a finite number)"):
        parse_station(f"{BUILT_IN_TEXT}\nlimits: {{{limit}}}\n")


@pytest.mark.parametrize(
    ("text", "degrees"),
    [
        ("11d 18m 30s", 11 + 18.5 / 60),
        ("-6d31m48s", -6.53),
        ("-0d 30m", -0.5),
        ("47 30 00 N", 47.5),
        ("47 30 00 S", -47.5),
        ("12° 30' 36\"", 12.51),
        ("12d 18.5m", 12 + 18.5 / 60),
        ("010", 10.0),
    ],
)
def test_an_angle_in_degrees_minutes_and_seconds_is_read(text: str, degrees: float) -> None:
    quoted = text if text.isdecimal() else "'" + text.replace("'", "''") + "'"
    station = parse_station(BUILT_IN_TEXT.replace("latitude_deg: -6.53", f"latitude_deg: {quoted}"))
    assert station.site.latitude_deg == pytest.approx(degrees, abs=1e-12)


@pytest.mark.parametrize(
    ("key", "text", "advice"),
    [
        (
            "latitude_deg: -6.53",
            "latitude_deg: 2:21",
            "site.latitude_deg is '2:21': expected degrees",
        ),
        ("azimuth_deg: 0", "azimuth_deg: 1:30:00", "mount.azimuth_deg is '1:30:00': expected degrees"),
        ("latitude_deg: -6.53", "latitude_deg: 2 21 E", "site.latitude_deg is '2 21 E'"),
        ("latitude_deg: -6.53", "latitude_deg: 2d 75m", "site.latitude_deg is '2d 75m'"),
        ("height_m: 250", "height_m: 250,5", "site.height_m is '250,5': write the decimal point as 250.5"),
        ("pressure_hpa: 985", "pressure_hpa: 16:25", "site.pressure_hpa is '16:25'"),
    ],
)
def test_an_angle_that_could_mean_two_things_is_refused_with_what_to_write(key: str, text: str, advice: str) -> None:
    assert key in BUILT_IN_TEXT
    with pytest.raises(ConfigError, match=re.escape(advice)):
        parse_station(BUILT_IN_TEXT.replace(key, text))


@pytest.mark.parametrize(
    ("key", "text", "advice"),
    [
        ("focal_length_px: 4169.905", "focal_length_px: 12mm", "'12mm': expected a number without a unit"),
        ("latitude_deg: -6.53", "latitude_deg: 6.53 S", "without a unit, .*; north and east are positive"),
        ("latitude_deg: -6.53", "latitude_deg: 5230", "latitude_deg is 5230: expected at most 90$"),
        ("rows: 1024", "rows: 1024.5", "expected a whole number$"),
        ("altitude_deg: 90", "altitude_deg: .nan", "expected a finite number$"),
        ("rows: 1024", "rows: 1024\n  mirrored: maybe", "expected true or false$"),
        ("port:", "limits: {d_de_arcsec: -60}\nport:", "expected more than 0$"),
        ("url: sim://", "baudrate: 12345678", "expected at most 8,000,000$"),
        ("name: LAPAN-like", 'name: "LAPAN-like', "is a bracket or a quote not closed"),
        ("rows: 1024", "\trows: 1024", "line 5: .*indent with blanks, not with tabs"),
    ],
)
def test_a_value_that_cannot_be_is_answered_with_what_can(key: str, text: str, advice: str) -> None:
    assert key in BUILT_IN_TEXT
    with pytest.raises(ConfigError, match=advice):
        parse_station(BUILT_IN_TEXT.replace(key, text))


@pytest.mark.parametrize("text", ["version: 1\nsensor: {name: x, rows: 10", 'version: 1\nsensor: {name: "x', "text: ["])
@pytest.mark.parametrize(
    ("read", "error"),
    [
        (parse_station, ConfigError),
        (parse_scenario, ConfigError),
        (parse_procedure, ConfigError),
        (parse_protocol, DescriptionError),
    ],
)
def test_a_file_that_was_cut_off_is_called_so_with_its_last_line(read, error: type[Exception], text: str) -> None:
    with pytest.raises(error, match=rf"line {text.count(chr(10)) + 1}: the text ends in the middle of something"):
        read(text, "cut.yaml")


def test_a_section_written_as_a_value_is_answered_with_its_keys() -> None:
    text = BUILT_IN_TEXT.partition("site:")[0] + "site: rooftop\n"
    with pytest.raises(ConfigError, match="'rooftop': expected keys below it: name, latitude_deg, longitude_deg"):
        parse_station(text)


def test_a_decimal_comma_between_braces_is_named() -> None:
    text = BUILT_IN_TEXT.partition("site:")[0] + "site: {latitude_deg: 48,85, longitude_deg: 2}\n"
    with pytest.raises(ConfigError, match=r"a decimal comma\? Write 48\.85"):
        parse_station(text)
