"""Scenario of a simulation: sky, optics and firmware, from a YAML file."""

from collections.abc import Iterator, Sequence
from datetime import datetime
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from drivers.host_files import only_a_file
from gse.config.station import BUILT_IN_TEXT, Station
from gse.errors import ConfigError, UsageError
from gse.values.instant import NS_PER_S, from_text
from gse.values.screen import Shown
from protocols.yaml_text import load_document, yaml_problem

MAX_FILE_BYTES = 100_000
"""A scenario is a page of text."""

DEFAULT = "clear-zenith"

FIRST_START_NS, LAST_START_NS = from_text("1972-01-01T00:00:00Z"), from_text("2200-01-01T00:00:00Z")
"""UTC has leap seconds since 1972; the ephemeris ends in 2200."""

_Profile = tuple[tuple[float, float], ...]
"""(seconds since the start, value), linear between, held outside."""


MOST_RATE_DEG_PER_S = 10.0
"""What star sensors bear, and more."""
_Rate = Annotated[float, Field(ge=-MOST_RATE_DEG_PER_S, le=MOST_RATE_DEG_PER_S)]
RATE_FOR_S = 60.0
"""A rate of a table is shown for so long: 300 frames show a share of false answers of 1 %, at 5 Hz."""
MOST_STEPS = 10_000
"""Attitudes of a scene."""


class _ScenarioSection(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class OpticsSection(_ScenarioSection):
    """How stars become objects."""

    faintest_magnitude: Annotated[float, Field(ge=-2, le=10)] = 6.2
    """Limit of detection at ``exposure_s`` in a dark sky, Gaia G at the zenith; panorama level only."""
    saturation_magnitude: Annotated[float, Field(ge=-5, le=10)] = 1.5
    """Brightness whose peak reaches the highest index value at ``exposure_s``."""
    magnitude_noise: Annotated[float, Field(ge=0, le=3)] = 0.1
    """Panorama level only."""
    position_noise_arcsec: Annotated[float, Field(ge=0, le=1000)] = 10.0
    """Per axis, before positions are put on whole pixels; panorama level only."""
    psf_sigma_px: Annotated[float, Field(ge=0.3, le=5)] = 0.9
    """Width of the Gaussian that a star makes, in focus."""
    defocus: tuple[tuple[float, Annotated[float, Field(ge=1, le=20)]], ...] = ((0.0, 1.0),)
    """By how many times wider stars are: (seconds since the start, factor), linear between."""
    electrons_per_index: Annotated[float, Field(gt=0, le=1000)] = 10.0
    read_noise_electrons: Annotated[float, Field(ge=0, le=1000)] = 15.0
    dark_electrons_per_s: Annotated[float, Field(ge=0, le=1e6)] = 50.0
    """Mean of a pixel at 20 degC; doubles every 7 degC."""


class DetectorSection(_ScenarioSection):
    """Objects that are not stars, and stars that are missed."""

    hot_pixels: Annotated[int, Field(ge=0, le=1000)] = 0
    hot_pixel_index: tuple[float, float] = (100.0, 2000.0)
    """The range of their index values."""
    false_objects: Annotated[float, Field(ge=0, le=30)] = 0.0
    """Mean number per frame, anywhere on the detector."""
    missing: Annotated[float, Field(ge=0, le=1)] = 0.0
    """Chance that a star is missed in a frame; panorama level only."""
    dead_pixels: Annotated[int, Field(ge=0, le=100_000)] = 0
    """Image level only."""


class Air(_ScenarioSection):
    """Clouds, satellites and the light of the sky."""

    cloud_magnitudes: _Profile = ((0.0, 0.0),)
    """Extinction in the middle of a cloud."""
    cloud_cover: Annotated[float, Field(ge=0, le=1)] = 1.0
    """Share of the sky that clouds cover while there are any."""
    cloud_drift_px_per_s: tuple[float, float] = (20.0, 7.0)
    dew_magnitudes: _Profile = ((0.0, 0.0),)
    """Extinction by dew on the lens: the same all over the field."""
    capped_s: tuple[tuple[float, float], ...] = ()
    """Stretches in which a lens cap or a cover is on: seconds after the start, from and until."""
    sunlight: bool = True
    """Without it the sky is dark by day: stars stand where they are at that time."""
    satellites_per_minute: Annotated[float, Field(ge=0, le=60)] = 0.0
    dark_magnitude: Annotated[float, Field(ge=15, le=23)] = 21.3
    """Surface brightness of the moonless night, per square arcsecond."""


class Motion(_ScenarioSection):
    """How a mount moves that should stand still: along columns and rows, and about the boresight."""

    slips: tuple[tuple[float, float, float, float], ...] = ()
    """Seconds after the start, then arcsec along columns, along rows and about the boresight, for good."""
    drift_arcsec_per_h: tuple[float, float, float] = (0.0, 0.0, 0.0)
    sinusoid_arcsec: tuple[float, float] = (0.0, 0.0)
    """Amplitude along columns and rows: what a heater does that switches on and off."""
    sinusoid_period_s: Annotated[float, Field(gt=0)] = 600.0
    vibration_arcsec: tuple[float, float] = (0.0, 0.0)
    """Amplitude along columns and rows."""
    vibration_hz: Annotated[float, Field(gt=0, le=10_000)] = 3.3


class Host(_ScenarioSection):
    """The clock of the host that stamps the bytes; an emulator's host has its own."""

    clock_s: Annotated[float, Field(ge=-1e6, le=1e6)] = 0.0
    """By how much the host's clock is fast, in seconds."""
    clock_drift_ppm: Annotated[float, Field(ge=-10_000, le=10_000)] = 0.0
    clock_steps: tuple[tuple[float, float], ...] = ()
    """Seconds after the start, and by how many seconds the clock is set forward."""

    def fast_s(self, since_start_s: float) -> float:
        """How fast the clock is at a time."""
        stepped = sum(step_s for at_s, step_s in self.clock_steps if since_start_s >= at_s)
        return self.clock_s + stepped + 1e-6 * self.clock_drift_ppm * since_start_s


class AnswersSection(_ScenarioSection):
    """How a polled sensor answers, and the adapter between; shares of the requests."""

    never: Annotated[float, Field(ge=0, le=1)] = 0.0
    twice: Annotated[float, Field(ge=0, le=1)] = 0.0
    late: Annotated[float, Field(ge=0, le=1)] = 0.0
    late_ms: Annotated[float, Field(ge=0, le=60_000)] = 150.0
    foreign: Annotated[float, Field(ge=0, le=1)] = 0.0
    """Answers of another unit on the line come before ours; of a protocol with addresses."""
    echoes: bool = False
    """A half-duplex adapter gives back what it is sent."""


class CommandFault(_ScenarioSection):
    """How the answer to a command is spoiled: refused, late, wrong (of another command, another value) or none."""

    fault: Literal["nak", "late", "wrong", "silent"]
    late_s: Annotated[float, Field(gt=0, le=600)] = 2.0
    times: Annotated[int, Field(ge=1, le=10**6)] | None = None
    """How often; always where it is null."""


_ItemProfile = Annotated[tuple[tuple[float, float | str], ...], Field(min_length=1, max_length=1000)]
"""(seconds since power-on, value): numbers linear between, words until the next one."""
_Every = Annotated[float, Field(ge=0.001, le=36_000)]


class Firmware(_ScenarioSection):
    """Traits of the sensor's computer."""

    clock_drift_ppm: Annotated[float, Field(ge=-1000, le=1000)] = 3.0
    powered_before_start_s: Annotated[float, Field(ge=0)] = 2.0
    resets_s: tuple[float, ...] = ()
    """Seconds after the start at which the sensor restarts by itself."""
    boot_s: Annotated[float, Field(ge=0, le=60)] = 2.0
    """From power-on to the first exposure."""
    temperature_c: tuple[float, float] = (21.0, 28.0)
    """Detector at power-on, and when it is warm."""
    warm_up_s: Annotated[float, Field(gt=0, le=36_000)] = 600.0
    """Time in which the difference falls to a third (1/e)."""
    host_jitter_ms: tuple[float, float] = (0.1, 2.0)
    """How late the host reads a byte."""
    status_every_s: Annotated[float, Field(ge=0.1, le=36_000)] | None = 10.0
    """Time between STATUS frames, in protocols that have them; none where it is null."""
    supply_v: _Profile = ((0.0, 5.0),)
    """Supply voltage, against seconds since power-on."""
    delay_ms: Annotated[float, Field(ge=0, le=60_000)] = 0.0
    """From the end of an exposure to the first byte of its frame: reading out and thinking."""
    answers: AnswersSection = AnswersSection()
    items: dict[str, _ItemProfile] = {}
    """Items of the protocol by name; one that is not here has a value within its limits."""
    items_every_s: _Every | dict[str, _Every] = 1.0
    """Time between messages that have items only, of all or by name; one that a command asks for comes as its answer
    only, unless it has its name here."""
    swapped_names: Annotated[float, Field(ge=0, le=1)] = 0.0
    """Share of the lists of stars (STARS) in which the two brightest have each other's name."""
    commands: dict[str, CommandFault] = {}
    """Commands of the protocol whose answers are spoiled."""


class AttitudeSection(_ScenarioSection):
    """The sensor's own answers (ATTITUDE frames); their convention is ``sensor.attitude`` of the device."""

    sends: bool = False
    """A protocol without PANORAMA sends them in any case."""
    processing_ms: Annotated[float, Field(ge=0, le=60_000)] = 60.0
    """From the end of an exposure to its answer, as the sensor states it."""
    noise_arcsec: Annotated[float, Field(ge=0, le=100_000)] = 3.0
    """Per axis across the boresight."""
    roll_noise_arcsec: Annotated[float, Field(ge=0, le=100_000)] = 30.0
    bias_arcsec: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Along columns, along rows, about the boresight."""
    delay_frames: Annotated[int, Field(ge=0, le=1000)] = 0
    """Answers are those of so many exposures before the one that they name."""
    frozen_s: tuple[tuple[float, float], ...] = ()
    """Stretches, from and until, in which the same answer is sent again and again."""
    zeros_s: tuple[tuple[float, float], ...] = ()
    """Stretches in which RA, DE and roll are 0."""
    lost: Annotated[float, Field(ge=0, le=1)] = 0.0
    """Share of the exposures without an answer."""
    false_answers: Annotated[float, Field(ge=0, le=1)] = 0.0
    """Share of the answers that name other stars: 1 to 40 deg off."""


class SceneStep(_ScenarioSection):
    """What a screen shows for a while: ICRS angles at its beginning, and how the sensor would turn from there."""

    ra_deg: Annotated[float, Field(ge=-360, le=360)]
    de_deg: Annotated[float, Field(ge=-90, le=90)]
    roll_deg: Annotated[float, Field(ge=-360, le=360)] = 0.0
    turn_deg_per_s: tuple[_Rate, _Rate, _Rate] = (0.0, 0.0, 0.0)
    """About the sensor's axes: right, down and out of the boresight."""
    for_s: Annotated[float, Field(gt=0, le=86_400)] = 20.0


class ShownObject(_ScenarioSection):
    """Something that is no star of the catalogue, at a fixed place among the stars: a planet, the Moon, a ghost."""

    ra_deg: Annotated[float, Field(ge=-360, le=360)]
    de_deg: Annotated[float, Field(ge=-90, le=90)]
    magnitude: Annotated[float, Field(ge=-13, le=10)]
    diameter_deg: Annotated[float, Field(ge=0, le=5)] = 0.0


class SceneSection(_ScenarioSection):
    """What a screen shows: attitudes one after the other, and what is not right with their stars."""

    steps: Annotated[tuple[SceneStep, ...], Field(max_length=MOST_STEPS)] = ()
    """Without any, the direction of ``mount.inertial`` stands for as long as the session lasts."""
    objects: Annotated[tuple[ShownObject, ...], Field(max_length=100)] = ()
    false_objects: Annotated[int, Field(ge=0, le=100)] = 0
    """At places of the screen that the seed decides, other ones at each step."""
    dropped: Annotated[float, Field(ge=0, le=1)] = 0.0
    """Share of the stars that are not drawn."""
    noise_arcsec: Annotated[float, Field(ge=0, le=1000)] = 0.0
    """Per axis, of the places of the stars: the same star is off by the same at each step."""
    seed: Annotated[int, Field(ge=0, le=10**9)] = 1

    @property
    def seconds(self) -> float:
        """How long all steps take."""
        return sum(step.for_s for step in self.steps)


class ExpectedFinding(_ScenarioSection):
    """What the station must find: the verdict, and words that its reasons must hold."""

    verdict: Annotated[str, Field(pattern="^(PASS|FAIL|INCONCLUSIVE)$")] = "PASS"
    reasons: tuple[str, ...] = ()
    identified_at_least: Annotated[float, Field(ge=0, le=1)] = 0.0
    identified_at_most: Annotated[float, Field(ge=0, le=1)] = 1.0
    """Shares of the panoramas."""
    events: tuple[str, ...] = ()
    """Kinds of events that must occur."""


class Scenario(_ScenarioSection):
    """A whole scenario.

    ``station`` changes the station file and the device alike; ``device`` changes the device only, behind the
    station's back.
    """

    text: Annotated[str, Field(min_length=1)]
    start: str = "2026-03-20T15:00:00Z"
    seconds: Annotated[float, Field(gt=0)] = 60.0
    rate_hz: Annotated[float, Field(gt=0, le=1000)] = 10.0
    exposure_s: Annotated[float, Field(ge=0.001, le=2)] = 0.05
    station: dict[str, Any] = {}
    device: dict[str, Any] = {}
    optics: OpticsSection = OpticsSection()
    detector: DetectorSection = DetectorSection()
    air: Air = Air()
    motion: Motion = Motion()
    host: Host = Host()
    firmware: Firmware = Firmware()
    attitude: AttitudeSection = AttitudeSection()
    scene: SceneSection = SceneSection()
    find: ExpectedFinding = ExpectedFinding()

    @field_validator("start", mode="before")
    @classmethod
    def _instant_as_text(cls, value: Any) -> Any:
        """YAML reads an instant without quotes as a date."""
        return value.isoformat().replace("+00:00", "Z") if isinstance(value, datetime) else value

    @field_validator("start")
    @classmethod
    def _an_instant(cls, value: str) -> str:
        return check_start(value)

    @model_validator(mode="after")
    def _as_long_as_its_scene(self) -> Self:
        if self.scene.steps and "seconds" not in self.model_fields_set:
            return self.model_copy(update={"seconds": self.scene.seconds})
        return self

    @property
    def start_utc_ns(self) -> int:
        """Start in UTC nanoseconds."""
        return from_text(self.start)

    def shown(self, start_ns: int, within_ms: float = 0.0) -> Iterator[Shown]:
        """What a screen shows if the scene begins at an instant."""
        for step in self.scene.steps:
            yield Shown(start_ns, step.ra_deg, step.de_deg, step.roll_deg, step.turn_deg_per_s, within_ms)
            start_ns += round(step.for_s * NS_PER_S)

    def at_rates(self, rates_deg_per_s: Sequence[float], station: Station) -> Self:
        """The scenario with a scene that turns at one rate after the other, each for as long.

        Each begins at the direction of the station file and turns about the sensor's y: the stars run along its rows.
        UsageError without a direction, or where a rate is too high.
        """
        still = station.mount.inertial
        if still is None:
            raise UsageError("--rates turn the stars before a screen, and the station file has no mount.inertial")
        if not rates_deg_per_s or not all(0 <= rate <= MOST_RATE_DEG_PER_S for rate in rates_deg_per_s):
            raise UsageError(f"expected rates from 0 to {MOST_RATE_DEG_PER_S:g} deg/s, for example 0,0.1,0.5deg/s")
        at = SceneStep(ra_deg=still.ra_deg, de_deg=still.de_deg, roll_deg=still.roll_deg)
        steps = tuple(
            at.model_copy(update={"turn_deg_per_s": (0.0, rate, 0.0), "for_s": RATE_FOR_S}) for rate in rates_deg_per_s
        )
        scene = self.scene.model_copy(update={"steps": steps})
        return self.model_copy(update={"scene": scene, "seconds": scene.seconds})

    def station_for(self, station: Station) -> Station:
        """The station file that fits this scenario."""
        return _changed(station, self.station)

    def device_for(self, station: Station) -> Station:
        """The real device where the station file says ``station``."""
        return _changed(_changed(station, self.station), self.device)

    def station_text(self, text: str = BUILT_IN_TEXT) -> str:
        """A station file with this scenario's changes, as YAML."""
        return yaml.safe_dump(_merged(load_document(text)[1], self.station), sort_keys=False) if self.station else text


def scenario_names() -> list[str]:
    """The scenarios that come with the station."""
    return sorted(entry.name.removesuffix(".yaml") for entry in _folder().iterdir() if entry.name.endswith(".yaml"))


def load_scenario(name_or_path: str) -> Scenario:
    """A scenario by its name, or from a YAML file; ConfigError otherwise, with what was expected."""
    packaged = _folder() / f"{name_or_path}.yaml"
    if name_or_path in scenario_names():
        return parse_scenario(packaged.read_text(encoding="utf-8"), f"scenario {name_or_path}")
    path = Path(name_or_path)
    try:
        with open(path, encoding="utf-8", opener=only_a_file) as file:
            text = file.read(MAX_FILE_BYTES + 1)
    except (OSError, UnicodeDecodeError):
        names = ", ".join(scenario_names())
        raise ConfigError(f"no scenario {name_or_path!r}: expected one of {names}, or a readable YAML file") from None
    if len(text) > MAX_FILE_BYTES:
        raise ConfigError(f"{path} is larger than {MAX_FILE_BYTES} bytes: this is not a scenario")
    return parse_scenario(text, str(path))


def parse_scenario(text: str, source: str) -> Scenario:
    """The scenario of a YAML text; ConfigError names source, key and reason."""
    try:
        document = load_document(text)[1]
    except yaml.YAMLError as error:
        raise ConfigError(yaml_problem(error, source)) from error
    if not isinstance(document, dict):
        raise ConfigError(f"{source}: expected a mapping with the keys {', '.join(Scenario.model_fields)}")
    try:
        return Scenario.model_validate(document)
    except ValidationError as error:
        raise ConfigError(f"{source}: {_first_of(error)}") from error


def check_start(text: str) -> str:
    """The start of a scenario as it is given; ValueError where it is none, or without leap seconds and an ephemeris."""
    if not FIRST_START_NS <= from_text(text) < LAST_START_NS:
        raise ValueError(f"{text} is too far away: expected an instant from 1972 to 2199")
    return text


def profile_at(profile: _Profile, seconds: float) -> float:
    """Value of a profile at a time since the start."""
    before = profile[0]
    for point in profile:
        if seconds <= point[0]:
            step_s = point[0] - before[0]
            share = (seconds - before[0]) / step_s if step_s > 0 else 1.0
            return before[1] + (point[1] - before[1]) * max(share, 0.0)
        before = point
    return before[1]


def _changed(station: Station, changes: dict[str, Any]) -> Station:
    if not changes:
        return station
    try:
        return Station.model_validate(_merged(station.model_dump(), changes))
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise ConfigError(
            f"the scenario's change of the station does not work: {key}: {first['msg'].lower()}"
        ) from error


def _first_of(error: ValidationError) -> str:
    first = error.errors()[0]
    key = ".".join(str(part) for part in first["loc"])
    reason = first.get("ctx", {}).get("error") or f"{first['msg'].lower()}, got {first['input']!r:.60}"
    return f"{key}: {reason}"


def _merged(document: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    merged = dict(document)
    for key, value in changes.items():
        old = merged.get(key)
        merged[key] = _merged(old, value) if isinstance(old, dict) and isinstance(value, dict) else value
    return merged


def _folder() -> Any:
    return files("gse.simulator") / "scenarios"
