"""The station file: one YAML document, validated at the door."""

import difflib
import math
import re
from dataclasses import fields, is_dataclass
from datetime import date, datetime
from itertools import pairwise
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

import yaml
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    PrivateAttr,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_validator,
    with_config,
)

from drivers.host_files import a_file_or_a_shells_pipe
from drivers.outside_text import is_plain, plain_lines
from drivers.ports import LineSettings, Rs485, is_mock
from gse.errors import ConfigError
from gse.values.attitude_convention import AttitudeConvention
from gse.values.camera import LEAST_SCALE, Camera
from gse.values.identifier_options import IdentifierOptions
from gse.values.limits import Limits
from gse.values.mount import InertialDirection, InertialUncertainty, Mount, MountUncertainty
from gse.values.screen import Screen, ScreenToSensor, ScreenUncertainty
from gse.values.site import Site, SiteUncertainty
from protocols.description import TimeDescription
from protocols.yaml_text import load_document, yaml_problem

# The ``test:`` block of a station file: what a report states beside its figures.
#
# Every key may be left out; a report prints what it misses.


def _plain(text: str) -> str:
    if not is_plain(text):
        raise ValueError(f"{text!r:.60} holds a control character")
    return text


Text = Annotated[str, Field(max_length=500), AfterValidator(_plain)]
_MOST = 100
"""Instruments, requirements or deviations: a report is read by people."""


class _PaperSection(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, coerce_numbers_to_str=True)


class Instrument(_PaperSection):
    """An instrument that took part, and the day of its last calibration."""

    name: Text
    serial: Text | None = None
    calibrated: date | None = None


class VerifiedRequirement(_PaperSection):
    """The requirement that a row verifies, and the verification method."""

    id: Text
    method: Text | None = None


class DocumentedTest(_PaperSection):
    """Who tested what, by which procedure; None where the station file does not say."""

    id: Text | None = None
    report: Text | None = None
    procedure: Text | None = None
    operator: Text | None = None
    witness: Text | None = None
    reviewer: Text | None = None
    approver: Text | None = None
    sensor_serial: Text | None = None
    sensor_firmware: Text | None = None
    parameters_sha256: Annotated[str, Field(pattern=r"^[0-9A-Fa-f]{64}$")] | None = None
    parameters: Annotated[dict[Text, float | Text], Field(max_length=1000)] = {}
    """Parameters that the sensor must read back, by name."""
    instruments: Annotated[tuple[Instrument, ...], Field(max_length=_MOST)] = ()
    requirements: Annotated[dict[Text, VerifiedRequirement], Field(max_length=_MOST)] = {}
    """By the name of the row of the verdict."""
    deviations: Annotated[tuple[Text, ...], Field(max_length=_MOST)] | None = None
    """An empty list states that there are none."""

    @field_validator("requirements", mode="before")
    @classmethod
    def _an_id_alone(cls, value: Any) -> Any:
        if not isinstance(value, dict):
            return value
        return {row: given if isinstance(given, dict) else {"id": given} for row, given in value.items()}


MAX_FILE_BYTES = 100_000
"""A station file is a page of text; anything bigger is another file."""

_SOURCE_KEYS = (
    "version",
    "subject",
    "sensor",
    "site",
    "mount",
    "port",
    "protocol",
    "identifier",
    "catalog",
    "limits",
    "screen",
    "test",
    "alarms",
    "power",
)


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


for _values in (
    AttitudeConvention,
    Site,
    SiteUncertainty,
    InertialDirection,
    InertialUncertainty,
    Mount,
    MountUncertainty,
    IdentifierOptions,
    Limits,
    Screen,
    ScreenToSensor,
    ScreenUncertainty,
    Rs485,
):
    with_config(ConfigDict(extra="forbid"))(_values)  # an unknown key is an error in these sections too


_AS_RECORDED = {"as": "recorded"}
"""Context of the validation of a recorded file that the rules of today refuse."""
_Distortion = Annotated[float, Field(ge=-1, le=1)]


_APART = 1.02
"""Ratio of two exposures that are told apart: a sensor's may be 1 % off what was commanded."""


class StartOptions(_Section):
    """START at the beginning of a session, STOP at its end."""

    period_ms: Annotated[float, Field(gt=0, le=3_600_000)] = 100.0


class PollOptions(_Section):
    """REQUEST each period, or as soon as the answer to the one before is there or overdue."""

    period_ms: Annotated[float, Field(gt=0, le=3_600_000)] | Literal["asap"] = 200.0
    timeout_ms: Annotated[float, Field(gt=0, le=3_600_000)] = 500.0


class Sensor(_Section):
    """Detector and optics; lengths in pixels, 0-based at pixel centres."""

    name: Annotated[str, Field(min_length=1, max_length=60, pattern=r"^[A-Za-z0-9][A-Za-z0-9 ._-]*$")] = "sensor"
    rows: Annotated[int, Field(ge=16, le=16384)]
    columns: Annotated[int, Field(ge=16, le=16384)]
    focal_length_px: Annotated[float, Field(gt=10, le=1e6)]
    principal_point_px: tuple[float, float] | None = None
    radial_distortion: tuple[_Distortion, _Distortion] = (0.0, 0.0)
    tangential_distortion: tuple[_Distortion, _Distortion] = (0.0, 0.0)
    mirrored: bool = False
    index_max: Annotated[int, Field(ge=1, le=65535)] = 4096
    zero_point_mag: Annotated[float, Field(ge=-10, le=40)] | None = None
    """Magnitude of a star with index value 1 in an exposure of 1 s under a clear sky; None: not known."""
    hot_pixels: tuple[tuple[int, int], ...] = ()
    """Known hot pixels (x, y)."""
    attitude: AttitudeConvention = AttitudeConvention()
    """The convention of the sensor's own answers (ATTITUDE frames)."""
    start: StartOptions | None = None
    poll: PollOptions | None = None
    """Without one of the two nothing is ever sent."""
    exposures_s: tuple[Annotated[float, Field(gt=0, le=3600)], ...] | None = None
    frames_each: Annotated[int, Field(ge=1, le=1_000_000)] = 300
    """A session commands each of these exposures, and judges so many frames of each by themselves."""
    time: TimeDescription | None = None
    """What its time tags tell; None: as the protocol description says."""

    @field_validator("exposures_s", mode="before")
    @classmethod
    def _some_exposures(cls, value: Any) -> Any:
        count = len(value) if isinstance(value, list | tuple) else 0
        if value is not None and not 0 < count <= _MOST:
            came = f"{count} of them" if count else "none" if value == [] else repr(value)[:60]
            raise ValueError(f"expected a list of 1 to {_MOST} exposures, such as [0.05, 0.1, 0.2], came {came}")
        return value

    @field_validator("exposures_s")
    @classmethod
    def _apart(cls, value: tuple[float, ...] | None) -> tuple[float, ...] | None:
        if any(more < _APART * less for less, more in pairwise(sorted(value or ()))):
            raise ValueError("two exposures differ by less than 2 %, so nothing shows which is in force; leave one out")
        return value

    @model_validator(mode="after")
    def _start_or_poll(self) -> "Sensor":
        if self.start is not None and self.poll is not None:
            raise ValueError("start and poll: expected one of the two; a sensor that is polled needs no START")
        return self

    @model_validator(mode="after")
    def _one_to_one(self, info: ValidationInfo) -> "Sensor":
        if info.context != _AS_RECORDED and (place := self.camera().fold()):
            x, y, scale = place
            raise ValueError(
                f"the distortion folds the picture at pixel ({round(x)}, {round(y)}): the scale there is {scale:.2f} "
                f"of that at the principal point, expected on the whole detector at least {LEAST_SCALE}; "
                "check the signs, and that radii are in units of half the columns"
            )
        return self

    def camera(self) -> Camera:
        """The camera model of this sensor."""
        centre = self.principal_point_px or ((self.columns - 1) / 2, (self.rows - 1) / 2)
        lens = self.radial_distortion, self.mirrored, self.tangential_distortion
        return Camera(self.rows, self.columns, self.focal_length_px, centre, *lens)


def _stop_bits(bits: float) -> float:
    if bits not in (1, 1.5, 2):
        raise ValueError(f"{bits:g} stop bits: expected 1, 1.5 or 2")
    return bits


class Port(_Section):
    """Any pyserial URL."""

    url: Annotated[Text, Field(min_length=1)] = "sim://"
    baudrate: Annotated[int, Field(ge=50, le=8_000_000)] = 115200
    parity: Literal["none", "even", "odd", "mark", "space"] = "none"
    data_bits: Annotated[int, Field(ge=5, le=8)] = 8
    stop_bits: Annotated[float, AfterValidator(_stop_bits)] = 1
    rtscts: bool = False
    xonxoff: bool = False
    rs485: Rs485 | None = None
    address: Annotated[int, Field(ge=0, lt=2**63)] | None = None
    host_address: Annotated[int, Field(ge=0, lt=2**63)] | None = None
    """Addresses on a shared line, instead of those of the protocol description."""
    pass_to: Annotated[Text, Field(min_length=1)] | None = None
    """The port of a flight computer whose line this is: all bytes pass both ways and are recorded."""
    tx_url: Annotated[Text, Field(min_length=1)] | None = None
    """The port of a tap on the wire from flight computer to sensor; ``url`` is that on the other wire."""

    @model_validator(mode="after")
    def _one_second_port(self) -> "Port":
        second = self.pass_to or self.tx_url
        if self.pass_to is not None and self.tx_url is not None:
            raise ValueError("pass_to and tx_url: expected one of the two; a tap passes nothing on")
        if second is not None and (is_mock(second) or second == self.url):
            key = "pass_to" if self.pass_to else "tx_url"
            raise ValueError(f"{key} is {second}: expected another port of this computer, e.g. /dev/ttyUSB1")
        return self

    @property
    def line(self) -> LineSettings:
        """The settings of the line beside its rate."""
        return LineSettings(self.parity, self.data_bits, self.stop_bits, self.rtscts, self.xonxoff, self.rs485)


AlarmKind = Literal["link", "no answer", "cloud", "disk", "clock"]
ALARM_KINDS: tuple[AlarmKind, ...] = get_args(AlarmKind)


class Alarms(_Section):
    """What a running session tells somebody who is not there, and how; none without ``command`` and ``post``."""

    on: tuple[AlarmKind, ...] = ALARM_KINDS
    after_s: Annotated[float, Field(ge=1, le=86_400)] = 60.0
    command: Annotated[tuple[Text, ...], Field(max_length=_MOST)] = ()
    """A program with its arguments; the message is the last one."""
    post: Text | None = None
    """A URL that takes JSON by POST, or one that apprise knows."""

    @model_validator(mode="before")
    @classmethod
    def _as_written(cls, value: Any) -> Any:
        """YAML 1.1 reads the key ``on`` as true; ``after`` takes 60s or 5m."""
        if not isinstance(value, dict):
            return value
        value = {"on" if key is True else key: item for key, item in value.items()}
        if "after" in value:
            found = _AFTER.fullmatch(str(value.pop("after")))
            if found is None:
                raise ValueError("alarms.after: expected a time such as 60s or 5m")
            value["after_s"] = float(found[1]) * (60 if found[2] == "m" else 1)
        return value


_AFTER = re.compile(r"(\d+(?:\.\d+)?) ?(s|m)?")


class Power(_Section):
    """The switch of the sensor's supply: programs with their arguments, never a shell."""

    on: Annotated[tuple[Text, ...], Field(min_length=1, max_length=_MOST)]
    off: Annotated[tuple[Text, ...], Field(min_length=1, max_length=_MOST)]
    read: Annotated[tuple[Text, ...], Field(max_length=_MOST)] = ()
    """Prints amperes, or volts and amperes."""
    settle_s: Annotated[float, Field(ge=0, le=600)] = 1.0
    """After it is switched on; the current is read as often as it can be in this time."""
    period_s: Annotated[float, Field(ge=0.1, le=3600)] = 1.0
    timeout_s: Annotated[float, Field(ge=0.1, le=600)] = 10.0

    @model_validator(mode="before")
    @classmethod
    def _as_written(cls, value: Any) -> Any:
        """YAML 1.1 reads the keys ``on`` and ``off`` as true and false."""
        if not isinstance(value, dict):
            return value
        return {"on" if key is True else "off" if key is False else key: item for key, item in value.items()}

    @field_validator("on", "off", "read", mode="before")
    @classmethod
    def _no_shell(cls, value: Any) -> Any:
        if isinstance(value, str):
            raise ValueError(f"expected a list of a program and its arguments, such as [relay, 1]: {value!r:.60}")
        return value


class Station(_Section):
    """A whole station file."""

    version: Literal[1]
    subject: Literal["sensor"] | None = None
    """``sensor``: only its own answers are judged, and by no truth, as in orbit; the site is of no meaning."""
    sensor: Sensor
    site: Site
    mount: Mount = Mount()
    port: Port = Port()
    protocol: Text = "panorama-v1"
    identifier: IdentifierOptions = IdentifierOptions()
    catalog: Text = "gaia"
    """``gaia`` (embedded), or the path of a Hipparcos (hip_main.dat, plain or .gz) or BSC5 (binary) file."""
    limits: Limits = Limits()
    screen: Screen | None = None
    """A monitor that shows the stars; ``mount.inertial`` is what it shows unless a scene says otherwise."""
    test: DocumentedTest = DocumentedTest()
    alarms: Alarms = Alarms()
    power: Power | None = None
    _refusal: str = PrivateAttr(default="")

    @property
    def is_under_sky(self) -> bool:
        """Whether it stands at a site under the sky: neither in orbit nor before a star simulator."""
        return self.subject is None and self.mount.inertial is None

    @property
    def refusal(self) -> str:
        """Why the rules of today refuse this recorded file; empty where they do not."""
        return self._refusal

    @field_validator("protocol")
    @classmethod
    def _not_empty(cls, value: str) -> str:
        if not value.strip():
            raise ValueError("expected a protocol name or the path of a YAML description")
        return value

    @model_validator(mode="before")
    @classmethod
    def _without_site(cls, value: Any) -> Any:
        """In orbit there is none; the one that stands in for it is at no place that means anything."""
        if isinstance(value, dict) and value.get("subject") == "sensor" and "site" not in value:
            return {**value, "site": {"name": "no site", "latitude_deg": 0.0, "longitude_deg": 0.0}}
        return value

    @model_validator(mode="after")
    def _no_truth_in_orbit(self) -> "Station":
        if self.subject is not None and (self.mount.inertial is not None or self.mount.align is not None):
            key = "align" if self.mount.inertial is None else "inertial"
            raise ValueError(f"subject: sensor is judged by no truth; leave mount.{key} out, or subject")
        return self

    @field_validator("mount", mode="before")
    @classmethod
    def _angles_beside_align(cls, value: Any) -> Any:
        angles = ("azimuth_deg", "altitude_deg", "roll_deg")
        if isinstance(value, dict) and "align" in value:
            return {"stated": any(angle in value for angle in angles), **value}
        return value

    @field_validator("mount", mode="before")
    @classmethod
    def _where_an_uncertainty_is_from(cls, value: Any) -> Any:
        """``from: align`` in words of Python, where ``from`` is no name."""
        known = value.get("uncertainty") if isinstance(value, dict) else None
        if not isinstance(known, dict) or "from" not in known:
            return value
        if known["from"] != "align":
            raise ValueError(f"uncertainty.from is {known['from']!r:.60}: expected align, or no such key")
        return {**value, "uncertainty": {**{key: known[key] for key in known if key != "from"}, "fitted": True}}

    @field_validator("mount", mode="before")
    @classmethod
    def _instant_as_text(cls, value: Any) -> Any:
        """YAML reads an instant without quotes as a date."""
        shown = value.get("inertial") if isinstance(value, dict) else None
        if not isinstance(shown, dict) or not isinstance(shown.get("at"), datetime):
            return value
        return {**value, "inertial": {**shown, "at": shown["at"].isoformat().replace("+00:00", "Z")}}

    @model_validator(mode="after")
    def _one_master(self) -> "Station":
        keys = ("start", "poll", "exposures_s")
        key = next((key for key in keys if getattr(self.sensor, key)), "")
        if key and (self.port.pass_to or self.port.tx_url):
            raise ValueError(
                f"sensor.{key} beside port.pass_to or port.tx_url: the flight computer commands the sensor there"
            )
        return self

    @model_validator(mode="after")
    def _screen_shows_a_direction(self) -> "Station":
        if self.screen is not None and self.mount.inertial is None:
            raise ValueError(
                "a screen shows stars in a direction of its own; expected mount: {inertial: {ra_deg: .., de_deg: ..}}"
            )
        if self.screen is not None and self.mount.inertial is not None and any(self.mount.inertial.rates_arcsec_per_s):
            raise ValueError("a screen turns by its scene; expected mount.inertial without rates")
        return self

    @model_validator(mode="after")
    def _principal_point_near_detector(self) -> "Station":
        x, y = self.sensor.camera().principal_point_px
        if not (-self.sensor.columns < x < 2 * self.sensor.columns and -self.sensor.rows < y < 2 * self.sensor.rows):
            raise ValueError(f"sensor.principal_point_px ({x:g}, {y:g}) lies far outside the detector")
        return self


BUILT_IN_TEXT = f"""\
# The built-in station: a LAPAN-like sensor on a rooftop, looking at the zenith.
version: 1
sensor:
  name: LAPAN-like
  rows: 1024
  columns: 1024
  focal_length_px: {512 / math.tan(math.radians(7)):.3f}   # 14 x 14 deg
site:
  name: rooftop
  latitude_deg: -6.53
  longitude_deg: 106.70
  height_m: 250
  pressure_hpa: 985
  temperature_c: 25
  relative_humidity: 0.8
mount:
  azimuth_deg: 0
  altitude_deg: 90
  roll_deg: 0
port:
  url: sim://
"""


def read_station(path: Path) -> tuple[Station, str]:
    """The station of a file, and the file's text; ConfigError names file, line and key."""
    try:
        with open(path, encoding="utf-8", opener=a_file_or_a_shells_pipe) as file:
            text = file.read(MAX_FILE_BYTES + 1)
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise ConfigError(
            f"cannot read the station file {path}: {reason}; 'gse config init' writes one to start from"
        ) from error
    return parse_station(text, str(path)), text


def parse_station(text: str, source: str = "built-in station") -> Station:
    """The station of a YAML text; ConfigError names source, line and key."""
    return _parse(text, source)


def parse_recorded(text: str, source: str = "the session's station.yaml") -> Station:
    """The station of a recorded text; what the rules of today refuse is read by those of its time.

    Earlier versions read 2:21 to base 60 (141) and 010 to base 8, took the last of two sections with one name, and took
    a distortion that folds the picture. ConfigError where the text was no station file then, either.
    """
    try:
        return _parse(text, source)
    except ConfigError as refused:
        try:
            station = _parse(text, source, recorded=True)
        except ConfigError:
            raise refused from None
        station._refusal = str(refused)
        return station


def _parse(text: str, source: str, *, recorded: bool = False) -> Station:
    if len(text) > MAX_FILE_BYTES:
        raise ConfigError(f"{source} is larger than {MAX_FILE_BYTES} characters: this is not a station file")
    try:
        node, document = load_document(text, base_60=recorded)
    except yaml.YAMLError as error:
        raise ConfigError(yaml_problem(error, source)) from error
    if not isinstance(document, dict):
        raise ConfigError(f"{source}: expected a mapping with the keys {', '.join(_SOURCE_KEYS)}")
    if not recorded:
        _refuse_repeated_keys(node, source)
    _read_angles(document, node, source, ())
    try:
        return Station.model_validate(document, context=_AS_RECORDED if recorded else None)
    except ValidationError as error:
        lines = [_explain(item, node, source) for item in error.errors()]
        raise ConfigError(plain_lines("\n".join(lines[:5]))) from error


# Angles in degrees, minutes and seconds.

_SEXAGESIMAL = re.compile(
    r"""([-+]?) \s* (\d{1,3}) \s*[d°\s]\s*            # degrees
        (?: (\d{1,2}(?:\.\d*)?) \s*(?:[m'′]|\s|$)\s*   # minutes
        (?: (\d{1,2}(?:\.\d*)?) \s*(?:[s"″]|''|\s|$)\s* )? )?  # seconds
        ([NSEW]?)""",
    re.VERBOSE,
)
_SIDES = {"latitude_deg": "NS", "longitude_deg": "EW"}


def _read_angles(document: Any, node: yaml.Node | None, source: str, path: tuple[str, ...]) -> None:
    """Make degrees of what is written as 11d 18m 30s or 47 30 00 N; ConfigError for other texts with colons."""
    for key, value in document.items() if isinstance(document, dict) else ():
        here = (*path, str(key))
        if isinstance(value, dict):
            _read_angles(value, node, source, here)
        elif isinstance(value, str) and here[-1].endswith("_deg"):
            if (degrees := _degrees(value, _SIDES.get(here[-1], ""))) is not None:
                document[key] = degrees
            elif ":" in value:
                where = f"{source}, line {_line_of(node, list(here))}: {'.'.join(here)}"
                raise ConfigError(
                    f"{where} is {value!r:.60}: expected degrees, such as 2.35, or degrees and minutes, such as 2d 21m"
                )


def _degrees(text: str, sides: str) -> float | None:
    """The degrees of an angle in degrees, minutes and seconds; None where it is none."""
    found = _SEXAGESIMAL.fullmatch(text.strip())
    if found is None or (found[5] and (found[5] not in sides or found[1])):
        return None
    minutes, seconds = float(found[3] or 0), float(found[4] or 0)
    if minutes >= 60 or seconds >= 60 or (found[4] and "." in found[3]):
        return None
    degrees = int(found[2]) + (minutes + seconds / 60) / 60
    return -degrees if found[1] == "-" or found[5] in ("S", "W") else degrees


_KINDS = ("int", "constrained-float", "literal['auto']", "literal['asap']", "date", "datetime")
"""What pydantic calls the choices of a key that takes several kinds of values, in the place of an error."""


def _explain(item: Any, node: yaml.Node | None, source: str) -> str:
    path = [part for part in item["loc"] if isinstance(part, str) and part not in _KINDS]
    key = f"{'.'.join(path) or 'station':.200}"
    where = f"{source}, line {_line_of(node, path)}: "
    if item["type"] in ("extra_forbidden", "unexpected_keyword_argument"):
        known = _known_keys(path[:-1])
        near = difflib.get_close_matches(path[-1], known, n=1, cutoff=0.5)
        hint = f"did you mean {near[0]}?" if near else f"known here: {', '.join(known)}"
        if "uncertainty" in path[:-1]:
            hint += " (each key ends in its unit)"
        return f"{where}unknown key {key}; {hint}"
    if item["type"] == "invalid_key":
        return f"{where}{key} has the key {item['input']!r:.60}: a decimal comma? Write 48.85, not 48,85"
    if item["type"] == "missing":
        return f"{where}{key} is missing"
    if item["type"] == "value_error":
        return f"{where}{key}: {item['ctx']['error']}"
    if key == "version":
        return f"{where}version is {item['input']!r:.60}; this gse reads version 1: install a newer gse"
    if isinstance(item["input"], str) and re.fullmatch(r"[-+]?[0-9]+,[0-9]+", item["input"].strip()):
        return f"{where}{key} is {item['input']!r}: write the decimal point as {item['input'].replace(',', '.')}"
    if item["type"] == "string_pattern_mismatch":
        return f"{where}{key} is {item['input']!r:.60}: expected a text like {item['ctx']['pattern']}"
    return f"{where}{key} is {item['input']!r:.60}: {_expected(item, path)}"


_BOUNDS = {
    "greater_than": ("gt", "more than"),
    "greater_than_equal": ("ge", "at least"),
    "less_than": ("lt", "less than"),
    "less_than_equal": ("le", "at most"),
}


def _expected(item: Any, path: list[str]) -> str:
    """What a key takes, in words: pydantic's own sentences are for programmers."""
    kind, value = item["type"], item["input"]
    if isinstance(value, float) and not math.isfinite(value):
        return "expected a finite number"
    if kind in _BOUNDS:
        bound, words = _BOUNDS[kind]
        return f"expected {words} {item['ctx'][bound]:,.10g}"
    if kind.startswith(("float_", "int_")):
        number = "number" if kind.startswith("float_") else "whole number"
        unit = " without a unit, which the key's name has" if isinstance(value, str) else ""
        return f"expected a {number}{unit}" + ("; north and east are positive" if path[-1] in _SIDES else "")
    if kind.startswith("bool_"):
        return "expected true or false"
    if kind.startswith("string_"):
        return "expected a text; put it in quotes"
    if kind in ("model_type", "dataclass_type", "dict_type") and (known := _known_keys(path)):
        return f"expected keys below it: {', '.join(known)}"
    return str(item["msg"][:1].lower() + item["msg"][1:])


def _line_of(node: yaml.Node | None, path: list[str]) -> int:
    line = 1
    for part in path:
        if not isinstance(node, yaml.MappingNode):
            break
        for key, value in node.value:
            if key.value == part:
                line, node = key.start_mark.line + 1, value
                break
        else:
            break
    return line


def _known_keys(path: list[str]) -> list[str]:
    """The keys of a section, or of a section in it."""
    known: Any = Station
    for part in path:
        if get_origin(known) is dict:
            known = get_args(known)[1]
            continue
        hints = known.model_fields if isinstance(known, type) and issubclass(known, BaseModel) else None
        known = hints[part].annotation if hints else get_type_hints(known).get(part)
        if get_origin(known) is tuple or isinstance(known, UnionType):
            known = get_args(known)[0]
    if isinstance(known, type) and issubclass(known, BaseModel):
        return list(known.model_fields)
    return [field.name for field in fields(known)] if is_dataclass(known) else []


def _refuse_repeated_keys(node: yaml.Node | None, source: str) -> None:
    """YAML takes the last of two sections with one name: the first would be left out without a word."""
    if isinstance(node, yaml.SequenceNode):
        for below in node.value:
            _refuse_repeated_keys(below, source)
    elif isinstance(node, yaml.MappingNode):
        seen = set()
        for key, below in node.value:
            if key.value in seen:
                line = key.start_mark.line + 1
                raise ConfigError(f"{source}, line {line}: {key.value} is given twice; keep one of the two")
            seen.add(key.value)
            _refuse_repeated_keys(below, source)
