"""Watch on the sky of a running session: conditions every few seconds, and an event where they change."""

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from drivers.chunk import LinkEvent
from gse.attitude import Attitude
from gse.camera import Camera
from gse.catalog import StarCatalog
from gse.instant import NS_PER_S
from gse.matrices import product
from gse.mount import Mount
from gse.panorama import MAX_OBJECTS
from gse.site import Site
from gse.station.event_kinds import StationKind
from gse.station.frame_columns import FrameColumns
from gse.station.frame_table import ANSWER_CHECKS, SKY_CONDITIONS, STATUSES
from gse.station.results import AnswerCheck, SkyCondition, Status
from gse.station.sky_condition import (
    ClearSky,
    Lights,
    SkyEvidence,
    clear_sky,
    condition_of,
    evidence_of,
    faded_mag,
    glared,
    words_of,
)
from gse.truth.mounting import horizon_to_sensor
from gse.truth.solar_system import icrs_to_horizon, sun_and_moon_horizon

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
"""Of the field's radius: distortion has no meaning far beyond it."""


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
        # After the last star of a dawn the sky is daylight again, not as it was when that was seen.
        is_day_again = condition is SkyCondition.DAYLIGHT and self._told in _KINDS.values()
        if is_day != bool(self._is_day) or is_day_again:
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
