"""Condition of the sky, told from the stars of a few seconds of panoramas.

What is expected comes from site, time, direction and catalogue; what is seen comes from the answers. Stars that are
fainter than in the clear, or that are missing, show a cloud. Brightness is compared only under a dark sky: the index
value of a star holds the light of the sky behind it, so a twilight sky makes stars look brighter.

What the clear sky is, a session shows by its clearest part. A thin cloud that stays from the first frame to the last is
in that, too: only the zero point of a clear night, where the station file states it, tells it from a clear sky.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from drivers.chunk import LinkEvent
from gse.catalog import StarCatalog
from gse.station.columns import ANSWER_CHECKS, SKY_CONDITIONS, STATUSES
from gse.station.events import StationKind
from gse.station.frame_columns import Columns, FrameColumns
from gse.station.results import AnswerCheck, SkyCondition, Status
from gse.truth.frames import horizon_to_sensor
from gse.truth.solar_system import icrs_to_horizon, sun_and_moon_horizon
from gse.values.attitude import Attitude
from gse.values.camera import Camera
from gse.values.instant import NS_PER_S
from gse.values.matrices import product
from gse.values.mount import Mount
from gse.values.panorama import MAX_OBJECTS
from gse.values.site import Site

SUN_LIMIT_DEG = -12.0
"""Nautical twilight: above it the sky is too bright for the stars of a panorama."""

FADED_MAG = 0.75
"""A cloud dims the stars by more than the air, the temperature and the noise of a few frames do."""
CLEARED_MAG = 0.5
MISSING_SHARE, BACK_SHARE = 0.55, 0.7
DOUBTFUL_SHARE = 0.8
"""Share of the expected stars below which a sky is doubtful; a cloud of 1 mag leaves two thirds to three quarters of
them."""
"""Of the share of stars that is seen in the clear: below the first a cloud covers the field, above the second none."""
FEW_SHARE = 1 / 3
"""Share of the expected stars below which no sky is clear, whatever the session has shown so far."""
ENOUGH_SHARE = 0.5
"""And from which a twilight is a clear sky, while no dark part of the session shows what is usual."""
FEWEST_EXPECTED = 10
"""Fewer expected stars do not tell a share."""
FEWEST_OBJECTS = 3
"""Fewer objects than this are no panorama of a clear sky: no identifier can work on them."""
UNMATCHED_SHARE, FEWEST_UNMATCHED = 0.4, 6
"""So many of the missing stars are there as objects without a star: the camera or its focus is not as stated."""
MOON_GLARE_DEG = 10.0
"""Beyond the edge of the field: nearer, the Moon's light hides stars as a cloud does."""
_CLEAR_PERCENTILE = 95.0
_BLIND_OBJECTS = 0.7
"""A frame without an answer and with fewer objects than this share of the usual number shows missing stars."""


@dataclass(frozen=True, slots=True)
class Lights:
    """Where Sun and Moon stand: altitudes, and separations from the boresight (NaN where that is unknown), in deg."""

    sun_altitude_deg: float
    moon_altitude_deg: float
    sun_separation_deg: float = math.nan
    moon_separation_deg: float = math.nan

    @property
    def is_dark(self) -> bool:
        """Whether the Sun is below nautical twilight."""
        return self.sun_altitude_deg <= SUN_LIMIT_DEG

    def __str__(self) -> str:
        sun = (
            f"Sun {abs(self.sun_altitude_deg):.0f} deg {'above' if self.sun_altitude_deg >= 0 else 'below'} the horizon"
        )
        if SUN_LIMIT_DEG < self.sun_altitude_deg < 0:
            sun += " (twilight)"
        if not self.moon_altitude_deg > 0:
            return f"{sun}, Moon down"
        apart = f", {self.moon_separation_deg:.0f} deg from the boresight" if self.moon_separation_deg >= 0 else ""
        return f"{sun}, Moon {self.moon_altitude_deg:.0f} deg up{apart}"


@dataclass(frozen=True, slots=True)
class SkyEvidence:
    """What a few seconds of panoramas show; numbers that they do not show are NaN.

    ``expected`` is the number of the mission catalogue's stars in the field, at most as many as a panorama has room
    for. ``seen_share`` is the share of them that was named, in the frames that show stars, and ``empty_share`` is that
    of the frames that show missing stars instead. ``zero_point_mag`` is for an exposure of 1 s. ``unmatched`` objects
    are as bright as stars of the catalogue, and none of them.
    """

    lights: Lights
    expected: float
    seen_share: float
    zero_point_mag: float
    limiting_mag: float
    objects: float
    empty_share: float
    shows_stars: bool
    overexposed: bool
    exposure_s: float
    unmatched: float = 0.0
    moon_glares: bool = False

    @property
    def misses_stars(self) -> bool:
        """Whether missing stars are not there as objects that match none."""
        missing = (1 - self.seen_share) * self.expected
        return self.unmatched < max(UNMATCHED_SHARE * missing, FEWEST_UNMATCHED)


@dataclass(frozen=True, slots=True)
class ClearSky:
    """The same of the clearest part of a session, as far as it is known; or a zero point that ``is_stated``."""

    zero_point_mag: float = math.nan
    seen_share: float = math.nan
    exposure_s: float = math.nan
    objects: float = math.nan
    is_stated: bool = False


def evidence_of(rows: Columns, expected: float, lights: Lights, usual_objects: float) -> SkyEvidence:
    """The evidence of some rows of FRAME; ``usual_objects`` is the number of objects of the clear sky."""
    answered = rows["status"] == STATUSES.index(Status.IDENTIFIED)
    check = rows["answer_check"]
    false = check == ANSWER_CHECKS.index(AnswerCheck.FALSE)
    shown = (answered & ~false) | (check == ANSWER_CHECKS.index(AnswerCheck.ABSENT))
    empty = ~shown & ~(rows["objects"] >= max(_BLIND_OBJECTS * usual_objects, FEWEST_OBJECTS))
    share = float(rows["stars_seen"][shown].mean()) / expected if shown.any() and expected > 0 else math.nan
    exposure_s = rows["exposure_s"].astype(np.float64)
    per_second = 2.5 * np.log10(np.where(exposure_s > 0, exposure_s, 1.0))
    return SkyEvidence(
        lights,
        expected,
        min(share, 1.0),
        _median((rows["zero_point_mag"] - per_second)[shown]),
        _median(rows["limiting_mag"][shown]),
        _median(rows["objects"].astype(np.float64)),
        float(empty.mean()),
        bool((shown | false).any()),
        bool((rows["status"] == STATUSES.index(Status.SENSOR_FAULT)).mean() > 0.5),
        _median(exposure_s),
        _median(rows["false_objects"][shown].astype(np.float64)) if shown.any() else 0.0,
    )


def clear_sky(evidence: list[SkyEvidence], stated_mag: float | None = None) -> ClearSky:
    """The clear sky among the evidence of a session: its clearest twentieth, without twilight and the Moon's glare.

    With the zero point of a clear night where it is stated.
    """
    fit = [item for item in evidence if item.shows_stars and item.lights.is_dark and not item.moon_glares]
    zero_point_mag = _highest([item.zero_point_mag for item in fit]) if stated_mag is None else stated_mag
    if not fit:
        return ClearSky(zero_point_mag, is_stated=stated_mag is not None)
    return ClearSky(
        zero_point_mag,
        _highest([item.seen_share for item in fit if item.expected >= FEWEST_EXPECTED]),
        _highest([item.exposure_s for item in fit]),
        _highest([item.objects for item in fit]),
        stated_mag is not None,
    )


def faded_mag(found: SkyEvidence, clear: ClearSky) -> float:
    """How much fainter than in the clear the stars are; NaN where a bright sky or missing stars hide it."""
    return clear.zero_point_mag - found.zero_point_mag if found.lights.is_dark and not found.moon_glares else math.nan


def condition_of(found: SkyEvidence, clear: ClearSky, before: SkyCondition) -> SkyCondition:
    """The condition that the evidence shows; ``before`` is that of the seconds before.

    A cloud ends at other values than it begins, so that noise at the edge makes no events.
    """
    if not found.shows_stars:
        return _without_stars(found, before)
    was_clouded = before is SkyCondition.CLOUDED
    if faded_mag(found, clear) >= (CLEARED_MAG if was_clouded else FADED_MAG):
        return SkyCondition.CLOUDED
    if found.lights.is_dark and found.expected >= FEWEST_EXPECTED:
        if found.moon_glares:
            return SkyCondition.UNKNOWN if found.seen_share < FEW_SHARE else SkyCondition.CLEAR
        least = max(FEW_SHARE, _least_share(was_clouded) * clear.seen_share)
        if found.misses_stars and _share_under_cloud(found, clear) < least:
            return SkyCondition.CLOUDED
    return SkyCondition.DAYLIGHT if _hides_stars(found, clear, before) else SkyCondition.CLEAR


def _hides_stars(found: SkyEvidence, clear: ClearSky, before: SkyCondition) -> bool:
    """Whether a bright sky shows far fewer stars than the dark part of the session, or than are expected before it."""
    if found.lights.is_dark or found.expected < FEWEST_EXPECTED:
        return False
    if math.isnan(clear.seen_share):
        return found.seen_share < (ENOUGH_SHARE if before is SkyCondition.DAYLIGHT else FEW_SHARE)
    return found.seen_share < DOUBTFUL_SHARE * clear.seen_share


def _least_share(was_clouded: bool) -> float:
    return BACK_SHARE if was_clouded else MISSING_SHARE


def _share_under_cloud(found: SkyEvidence, clear: ClearSky) -> float:
    """The share of the stars that is seen, empty frames included where a cloud hides some of the stars in the others.

    Empty frames beside full ones are a cap that was put on or taken off.
    """
    full = not found.seen_share < BACK_SHARE * clear.seen_share
    return found.seen_share if full else found.seen_share * (1 - found.empty_share)


def _without_stars(found: SkyEvidence, before: SkyCondition) -> SkyCondition:
    if not found.lights.is_dark:
        return SkyCondition.DAYLIGHT
    if found.moon_glares and (found.overexposed or found.objects >= FEWEST_OBJECTS):
        return SkyCondition.UNKNOWN
    if before is SkyCondition.CLOUDED:
        return SkyCondition.CLOUDED
    if found.overexposed or found.objects < FEWEST_OBJECTS or found.expected >= FEWEST_EXPECTED:
        return SkyCondition.NO_STARS
    return SkyCondition.UNKNOWN


def words_of(condition: SkyCondition, found: SkyEvidence, clear: ClearSky) -> str:
    """The evidence for a condition, for the operator."""
    stars = f"{found.seen_share * found.expected:.0f} of {found.expected:.0f} expected stars are seen"
    stars = stars if found.seen_share >= 0 else "stars are identified"
    if condition is SkyCondition.CLEAR:
        depth = f", to magnitude {found.limiting_mag:.1f}" if math.isfinite(found.limiting_mag) else ""
        return f"{stars}{depth}{_against_stated(found, clear)}{_doubt(found, clear)}; {found.lights}"
    if condition is SkyCondition.CLOUDED:
        faded = faded_mag(found, clear)
        than = "the stated zero point says" if clear.is_stated else "in the clear"
        dimmed = f"stars are {faded:.1f} mag fainter than {than}, " if faded >= CLEARED_MAG else ""
        return f"{dimmed}{stars if found.shows_stars else 'no star is left'}: cloud, haze or dew"
    if condition is SkyCondition.NO_STARS:
        return _no_stars(found, clear)
    return str(found.lights)


def _against_stated(found: SkyEvidence, clear: ClearSky) -> str:
    faded = faded_mag(found, clear)
    if not clear.is_stated or math.isnan(faded):
        return ""
    side = "brighter" if faded < 0 else "fainter"
    doubt = ": it is not this sensor's" if faded <= -FADED_MAG else ""
    return f", {abs(faded):.1f} mag {side} than the stated zero point says{doubt}"


def _doubt(found: SkyEvidence, clear: ClearSky) -> str:
    """What a sky that is called clear may be, where many stars are missing and no zero point tells why."""
    known = clear.is_stated and not math.isnan(faded_mag(found, clear))
    few = found.lights.is_dark and not found.moon_glares and found.misses_stars and found.seen_share < DOUBTFUL_SHARE
    if known or not few:
        return ""
    return (
        " (or thin cloud that was always there, or a sensor that sees less than its catalogue: the zero point of a "
        "clear night, sensor.zero_point_mag, tells which)"
    )


def _no_stars(found: SkyEvidence, clear: ClearSky) -> str:
    expected = f", {found.expected:.0f} stars are expected" if found.expected >= 0 else ""
    if found.overexposed and found.objects < FEWEST_OBJECTS:
        return f"the detector is overexposed in the dark{expected}: a lamp, or too long an exposure"
    if found.exposure_s < 0.5 * clear.exposure_s:
        return f"the exposure fell from {clear.exposure_s:g} to {found.exposure_s:g} s: too short{expected}"
    if found.objects < FEWEST_OBJECTS:
        objects = f"{found.objects:.0f} objects" if found.objects else "no object at all"
        glare = f"; or the Moon's glare: {found.lights}" if found.moon_glares else ""
        return f"{objects}{expected}: lens cap, cover, overcast, or too short an exposure{glare}"
    return (
        f"{found.objects:.0f} objects, and none is identified{expected}: overcast or a cover, or a camera that is not "
        "as stated"
    )


def _median(values: NDArray[np.float64]) -> float:
    known = np.sort(values[np.isfinite(values)])
    # As np.median, which takes ten times as long for so few.
    return float((known[(len(known) - 1) // 2] + known[len(known) // 2]) / 2) if len(known) else math.nan


def _highest(values: list[float]) -> float:
    known = [value for value in values if math.isfinite(value)]
    return float(np.percentile(known, _CLEAR_PERCENTILE)) if known else math.nan


def glared(found: SkyEvidence, field_radius_deg: float) -> SkyEvidence:
    """The evidence, marked where the Moon stands in the field or near its edge."""
    near = found.lights.moon_altitude_deg > 0 and found.lights.moon_separation_deg < field_radius_deg + MOON_GLARE_DEG
    return replace(found, moon_glares=True) if near else found


# Watch on the sky of a running session: conditions every few seconds, and an event where they change.

WINDOW_NS = 5 * NS_PER_S
_REFERENCE_AFTER = 1.1
"""The clear sky is sought anew when the session has become longer by a tenth: a night has thousands of windows."""

_KINDS = {
    SkyCondition.CLEAR: StationKind.CLEAR,
    SkyCondition.CLOUDED: StationKind.CLOUDED,
    SkyCondition.NO_STARS: StationKind.NO_STARS,
}


_FALSE = ANSWER_CHECKS.index(AnswerCheck.FALSE)
_BESIDE = 1.1
"""Reach of the search in radii of the field; distortion has no meaning far beyond."""


class SkyWatch:
    """Fills the sky columns of a session's frames, and gives an event for each change of the sky.

    The frames of WINDOW_NS are taken together, so that the events are the same however the bytes come. An event says
    what was known at its time. ``finish`` looks at the whole session again: only then is its clearest part known.
    A sensor that sends its own answers and no panoramas does not show the sky: ``sees_objects`` is then False.
    ``stated_mag`` is the zero point of a clear night (index value 1, exposure of 1 s).
    """

    def __init__(
        self,
        site: Site,
        camera: Camera,
        catalog: StarCatalog,
        mount: Mount | None,
        *,
        stated_mag: float | None = None,
    ) -> None:
        self._site, self._camera, self._catalog = site, camera, catalog
        self._field_radius_deg = math.degrees(camera.diagonal_rad) / 2
        self._horizon_to_sensor = None if mount is None else horizon_to_sensor(mount)
        self.sees_objects = True
        self._first = 0
        self._begun_ns: int | None = None
        self._windows: list[tuple[int, int, SkyEvidence]] = []
        self._stated_mag = stated_mag
        self._clear = clear_sky([], stated_mag)
        self._reference_due = 1
        self._condition = SkyCondition.UNKNOWN
        self._is_day: bool | None = None
        self._told: StationKind | None = None

    def take(self, frames: FrameColumns, first: int) -> list[tuple[int, list[LinkEvent]]]:
        """Look at the frames (all rows of FRAME so far), new from row ``first`` on: the events, and at which row."""
        utc_ns = frames["utc_ns"]
        if self._begun_ns is None:
            self._begun_ns = int(utc_ns[first])
        bounds = [self._first]
        while len(beyond := np.flatnonzero(_is_outside(utc_ns[first:] - self._begun_ns))):
            first += int(beyond[0])
            bounds.append(first)
            self._begun_ns = int(utc_ns[first])
        return self._close_windows(frames, bounds)

    def finish(self, frames: FrameColumns) -> list[LinkEvent]:
        """Close the last window, and fill the columns that need the clearest part of the session."""
        last = self._close_windows(frames, [self._first, len(frames)]) if len(frames) > self._first else []
        self.fill(frames)
        return [event for _, events in last for event in events]

    def fill(self, frames: FrameColumns) -> None:
        """Fill the columns that need the clearest part of the session, as it is so far."""
        clear = clear_sky([found for _, _, found in self._windows], self._stated_mag)
        condition = SkyCondition.UNKNOWN
        for first, until, found in self._windows:
            condition = self._judged(found, clear, condition)
            rows = frames[first:until]
            rows["sky_condition"] = SKY_CONDITIONS.index(condition)
            rows["transparency"] = 10 ** (-0.4 * min(max(faded_mag(found, clear), 0.0), 20.0))

    def _close_windows(self, frames: FrameColumns, bounds: Sequence[int]) -> list[tuple[int, list[LinkEvent]]]:
        """Close windows, each from a row to the next of ``bounds``: the events, and at which row."""
        windows = [frames[first:until] for first, until in pairwise(bounds)]
        expectations = self._expectations(windows)
        return [
            (until, list(self._close_window(rows, until, *expected)))
            for until, rows, expected in zip(bounds[1:], windows, expectations, strict=True)
        ]

    def _close_window(self, rows: FrameColumns, until: int, lights: Lights, expected: float) -> Iterator[LinkEvent]:
        utc_ns = int(rows["utc_ns"][-1])
        found = glared(evidence_of(rows, expected, lights, self._clear.objects), self._field_radius_deg)
        self._fill(rows, lights, expected if self.sees_objects else math.nan)
        self._windows.append((self._first, until, found))
        if len(self._windows) >= self._reference_due:
            self._reference_due = math.ceil(_REFERENCE_AFTER * len(self._windows))
            self._clear = clear_sky([item for _, _, item in self._windows], self._stated_mag)
        self._first = until
        yield from self._changes(utc_ns, found)

    def _fill(self, rows: FrameColumns, lights: Lights, expected: float) -> None:
        rows["stars_expected"] = expected
        rows["sun_altitude_deg"], rows["moon_altitude_deg"] = lights.sun_altitude_deg, lights.moon_altitude_deg
        rows["sun_separation_deg"], rows["moon_separation_deg"] = lights.sun_separation_deg, lights.moon_separation_deg

    def _changes(self, utc_ns: int, found: SkyEvidence) -> Iterator[LinkEvent]:
        """Events of the Sun, then of the stars."""
        is_day = not found.lights.is_dark
        condition = self._judged(found, self._clear, self._condition)
        # As long as the stars go on to be seen the sky is clear, wherever the Sun is; after the last one it is day.
        stays_clear = condition is self._condition is SkyCondition.CLEAR
        is_day_again = condition is SkyCondition.DAYLIGHT and self._told in _KINDS.values()
        if (is_day != bool(self._is_day) and not stays_clear) or is_day_again:
            self._told = StationKind.DAYLIGHT if is_day else StationKind.DARK_NIGHT
            yield LinkEvent(utc_ns, 0, self._told, str(found.lights))
        self._is_day = is_day
        if condition is not self._condition and condition in _KINDS:
            self._told = _KINDS[condition]
            yield LinkEvent(utc_ns, 0, self._told, words_of(condition, found, self._clear))
        self._condition = condition

    def _judged(self, found: SkyEvidence, clear: ClearSky, before: SkyCondition) -> SkyCondition:
        return condition_of(found, clear, before) if self.sees_objects else SkyCondition.UNKNOWN

    def _expectations(self, windows: Sequence[FrameColumns]) -> Iterator[tuple[Lights, float]]:
        """Where Sun and Moon stand in the middle of each window, and how many catalogue stars are in the field.

        The direction is that of the stars where they are confirmed, rather than that of the station file.
        """
        if not windows:
            return
        middles_ns = np.array([rows["utc_ns"][len(rows) // 2] for rows in windows])
        to_horizon, seen = icrs_to_horizon(self._site, middles_ns), self._seen(windows)
        suns, moons = sun_and_moon_horizon(self._site, middles_ns)
        for k, (sun, moon) in enumerate(zip(suns, moons, strict=True)):
            self._horizon_to_sensor = seen.get(k, self._horizon_to_sensor)
            altitudes = math.degrees(math.asin(sun[2])), math.degrees(math.asin(moon[2]))
            if self._horizon_to_sensor is None:
                yield Lights(*altitudes), math.nan
                continue
            boresight = self._horizon_to_sensor[2]
            separations = (separation_deg(body, boresight) for body in (sun, moon))
            stars = stars_in_field(self._catalog, self._camera, product(self._horizon_to_sensor, to_horizon[k]))
            yield Lights(*altitudes, *separations), float(min(stars, MAX_OBJECTS))

    def _seen(self, windows: Sequence[FrameColumns]) -> dict[int, NDArray[np.float64]]:
        """The rotation from the horizon frame to the sensor by window, of the middle one of its confirmed answers."""
        confirmed = {k: np.flatnonzero(_is_confirmed(rows)) for k, rows in enumerate(windows)}
        middles = {k: rows[len(rows) // 2] for k, rows in confirmed.items() if len(rows)}
        if not middles:
            return {}
        utc_ns = np.array([windows[k]["utc_ns"][row] for k, row in middles.items()])
        seen = {}
        for (k, row), at_row in zip(middles.items(), icrs_to_horizon(self._site, utc_ns), strict=True):
            ra_deg, de_deg, roll_deg = (windows[k][f"{angle}_deg"][row] for angle in ("ra", "de", "roll"))
            attitude = Attitude.from_angles(ra_deg, de_deg, np.nan_to_num(roll_deg))
            seen[k] = product(attitude.icrs_to_sensor, at_row.T)
        return seen


def _is_confirmed(rows: FrameColumns) -> NDArray[np.bool_]:
    """Whether each frame is identified, and the reference identifier does not say otherwise."""
    return np.asarray((rows["status"] == STATUSES.index(Status.IDENTIFIED)) & (rows["answer_check"] != _FALSE))


def _is_outside(since_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether a time since the begin of a window is not in it."""
    return (since_ns < 0) | (since_ns >= WINDOW_NS)


def separation_deg(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """Angle between two unit vectors (3,)."""
    (a, b, c), (x, y, z) = one.tolist(), other.tolist()  # numpy's cross product takes ten times as long
    across = math.hypot(b * z - c * y, c * x - a * z, a * y - b * x)
    return math.degrees(math.atan2(across, a * x + b * y + c * z))


def stars_in_field(catalog: StarCatalog, camera: Camera, icrs_to_sensor: NDArray[np.float64]) -> int:
    """How many stars of a catalogue stand on the detector."""
    stars_sensor = product(catalog.icrs, icrs_to_sensor.T)
    near = stars_sensor[:, 2] > math.cos(_BESIDE * camera.diagonal_rad / 2)
    return int(camera.contains(camera.pixels(stars_sensor[near])).sum())
