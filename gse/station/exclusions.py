"""Stretches of a session that its statistics leave out, each with its cause.

The sky, the link, the clock and the mount may be a cause, the answers never: a false star identification counts
whatever the time of its frame.
"""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from drivers.chunk import LinkEvent, LinkKind
from gse.errors import UsageError
from gse.station.events import ClockStep, StationKind
from gse.station.frame_columns import Columns
from gse.station.host_clock import ClockStretch, clock_steps, clock_stretches
from gse.values.constants import EARTH_RATE_RAD_PER_S
from gse.values.instant import LAST_NS, NS_PER_S, from_text
from gse.values.screen import ShownSky

AROUND_STEP_NS = 5 * NS_PER_S
"""On either side of a step of the host clock."""
AROUND_TOUCH_NS = 60 * NS_PER_S
"""On either side of a note that the mount was touched: it is written before or after."""
_GOES_ON_NS = 30 * NS_PER_S
"""The sensor's clock goes on, where its tags do not go back, or on by more than this."""
_LATE_NS = 20_000_000
"""A third of an arcsecond of the sky, and the latency that a USB adapter may have."""

_AT_ONCE = 0.5
"""Frames out of a buffer follow each other within this share of the usual time between frames."""

_EXAMPLE = (
    "expected for example 2026-03-20T18:30:00Z/2026-03-20T18:31:00Z=clouds, or ..Z=mount: kicked where the mount was "
    "touched"
)
_OF_MOUNT = "mount:"
"""With this begins the reason of a stretch whose answers are taken out; any other excuses answers that are absent."""


class Cause(StrEnum):
    """Why a stretch is left out."""

    CLOCK_STEP = "clock step"
    BACKLOG = "backlog"
    LINK = "link"
    NO_SKY = "no sky"
    NO_OBJECTS = "no objects"
    SCENE_CHANGE = "scene change"
    SCREEN_LOST = "screen lost"
    FASTER = "faster than asked"
    OPERATOR = "operator"
    MOUNT = "mount"
    """It was touched: nobody knows where it looked."""
    STEP = "other step"
    """No step of the procedure watched it, or its exposure is not that of the step."""


@dataclass(frozen=True, slots=True)
class Exclusion:
    """From one instant until before another, UTC in nanoseconds; the cause, and the reason in words.

    ``time_error_s`` is how far the times of these frames may be off, which explains as much of their error.
    """

    from_ns: int
    until_ns: int
    reason: str
    cause: Cause
    time_error_s: float = 0.0


def link_losses(events: Iterable[LinkEvent]) -> Iterator[Exclusion]:
    """From each time at which the port was gone until it was opened again."""
    lost: LinkEvent | None = None
    for event in events:
        if event.kind == LinkKind.LOST:
            lost = lost or event
        elif event.kind == LinkKind.REOPENED and lost is not None:
            gone_s = (event.utc_ns - lost.utc_ns) / NS_PER_S
            if gone_s > 0:
                yield Exclusion(lost.utc_ns, event.utc_ns, f"the port was gone for {gone_s:.1f} s", Cause.LINK)
            lost = None


def mount_touched(events: Iterable[LinkEvent]) -> Iterator[Exclusion]:
    """The minute before and after each time at which the operator touched the mount."""
    for event in events:
        if event.kind == StationKind.MOUNT_TOUCHED:
            from_ns, until_ns = max(event.utc_ns - AROUND_TOUCH_NS, 0), min(event.utc_ns + AROUND_TOUCH_NS, LAST_NS)
            yield Exclusion(from_ns, until_ns, event.text, Cause.MOUNT)


def exclusions(events: Iterable[LinkEvent], frames: Columns) -> tuple[Exclusion, ...]:
    """Frames around each step of the clock, as either clock stamps them, and frames that waited in a buffer.

    In a capture without the host's stamps: frames after a leap of the sensor's clock, or after a restart of it.
    ``frames`` are rows of FRAME.
    """
    events = tuple(events)
    steps = clock_steps(events)
    stretches = clock_stretches(frames["host_utc_ns"], steps)
    return (
        *(item for event in steps for item in _around_step(event)),
        *(_wrong_clock(frames, item) for item in stretches if item.is_wrong and item.until > item.first),
        *_waited(frames),
        *leapt_clock(frames),
        *after_restart(events, frames),
    )


_OFF_S, _OFF_SCATTERS, _LOOKS = 1.0, 5.0, 9
"""Times are off after a restart if the stars say so, by more than so many times what so many answers scatter by."""


def after_restart(events: Iterable[LinkEvent], frames: Columns) -> Iterator[Exclusion]:
    """What follows a restart in a capture that has its times by the sensor's clock, where the stars show them off.

    They go on after a restart as if no time had passed; how long it took nothing but the stars tells.
    """
    restarts_ns = [event.utc_ns for event in events if event.kind == StationKind.SENSOR_RESET]
    known = np.flatnonzero(np.isfinite(frames["ra_deg"]))
    if not restarts_ns or not len(known) or (frames["host_utc_ns"] > 0).any():
        return
    utc_ns = frames["utc_ns"][known]
    ahead_rad = np.radians(frames["ra_deg"][known]) - EARTH_RATE_RAD_PER_S * (utc_ns - utc_ns[0]) / NS_PER_S
    ahead_s = (np.remainder(ahead_rad - ahead_rad[0] + math.pi, 2 * math.pi) - math.pi) / EARTH_RATE_RAD_PER_S
    before_s = ahead_s[: max(int(np.searchsorted(utc_ns, restarts_ns[0])), 1)][-_LOOKS:]
    for restart_ns in restarts_ns:
        after_s = ahead_s[np.searchsorted(utc_ns, restart_ns, side="right") :][:_LOOKS]
        if not len(after_s):
            return
        off_s = float(np.median(after_s) - np.median(before_s))
        if abs(off_s) > max(_OFF_S, _OFF_SCATTERS * float(before_s.std())):
            reason = "the sensor started anew, and this capture has its times by it: by the stars they are "
            reason += f"{abs(off_s):.0f} s {'early' if off_s > 0 else 'late'} from then on"
            yield Exclusion(restart_ns, int(utc_ns.max()) + 1, reason, Cause.CLOCK_STEP, abs(off_s))
            return


_LEAST_LEAP_S, _LEAST_STEPS = 5.0, 10
"""A leap of the sensor's clock is so long, and so many times the usual time between frames."""
_STOOD, _TURNED = 0.2, 0.5
"""Least and largest share of the turn of the ground by which a sky stood still, and turned."""


def leapt_clock(frames: Columns) -> Iterator[Exclusion]:
    """What follows a leap of the sensor's clock in a capture that has its times by it (rows of FRAME).

    No exposure is missing, the stars are those of the frame before, and they go on from there: in a pause of the sensor
    the sky turns, and after old pictures it catches up.
    """
    if len(frames) < 3 or (frames["host_utc_ns"] > 0).any():
        return
    steps_s = np.diff(frames["utc_ns"]) / NS_PER_S
    ra, de = np.radians(frames["ra_deg"]), np.radians(frames["de_deg"])
    east = np.abs(np.exp(1j * ra[1:]) - np.exp(1j * ra[:-1]))
    turned = np.hypot(np.cos(de[1:]) * east, np.diff(de))
    expected = np.cos(de[1:]) * np.abs(np.exp(1j * EARTH_RATE_RAD_PER_S * steps_s) - 1)
    known = np.isfinite(turned)
    if not known.any() or np.median(turned[known]) < _TURNED * np.median(expected[known]):
        return
    usual_s = float(np.median(steps_s))
    long = steps_s > max(_LEAST_LEAP_S, _LEAST_STEPS * usual_s)
    leaps = long & (np.diff(frames["frame_no"].astype(np.int64)) == 1) & (turned < _STOOD * expected)
    for row in np.flatnonzero(leaps).tolist():
        if (turned[row + 1 :] - expected[row + 1 :] > _TURNED * expected[row]).any():
            continue
        leap_s = float(steps_s[row]) - usual_s
        reason = f"the sensor's clock leapt by {leap_s:+.1f} s, while the sky did not turn"
        from_ns, until_ns = int(frames["utc_ns"][row + 1]), int(frames["utc_ns"].max()) + 1
        yield Exclusion(from_ns, until_ns, reason, Cause.CLOCK_STEP, leap_s)


def _wrong_clock(frames: Columns, stretch: ClockStretch) -> Exclusion:
    """All frames of a clock that was far from the one that was set last."""
    utc_ns = frames["utc_ns"][stretch.first : stretch.until]
    offset_s = stretch.offset_ns / NS_PER_S
    side = "ahead of" if offset_s > 0 else "behind"
    reason = f"the host's clock was {abs(offset_s):.0f} s {side} what it was set to"
    return Exclusion(int(utc_ns.min()), int(utc_ns.max()) + 1, reason, Cause.CLOCK_STEP, abs(offset_s))


def _waited(frames: Columns) -> Iterator[Exclusion]:
    """Frames that had waited in a buffer: their bytes were read long after they came.

    They came before the port was opened, or something held them back for longer than the station remembers the offset
    of the sensor's clock. While they come out of it nothing shows how late they are; with the last of them that offset,
    the least that was seen of late, falls. A sensor clock that leaps or runs fast makes the same fall. Only frames out
    of a buffer are read faster than they are taken, one right after the other: the host's own stamps show it. A busy
    host empties the buffer in several bursts: what was read before a late one was later still.
    """
    if len(frames) == 0:
        return
    time_ns = frames["time_us"].astype(np.int64) * 1000
    offset_ns = frames["utc_ns"] - time_ns
    begins = np.flatnonzero(~_read_at_once(frames["host_utc_ns"], time_ns))
    sizes = np.diff(begins, append=len(frames))
    least_ns = np.minimum.reduceat(offset_ns, begins)
    after, steps_ns = begins[1:], time_ns[begins[1:]] - time_ns[begins[1:] - 1]
    goes_on = (steps_ns > 0) & (steps_ns <= _GOES_ON_NS)
    least_ns[:-1] = np.where(goes_on, np.minimum(least_ns[:-1], offset_ns[after]), least_ns[:-1])
    waited = sizes > 1
    late_bursts = np.flatnonzero(waited & (offset_ns[begins] - least_ns > _LATE_NS))
    for number in late_bursts[::-1]:
        if number > 0 and goes_on[number - 1]:
            least_ns[number - 1] = min(least_ns[number - 1], least_ns[number])
            waited[number - 1] = True
    burst = np.repeat(np.arange(len(begins)), sizes)
    fall_ns = offset_ns - least_ns[burst]
    late = np.flatnonzero((fall_ns > _LATE_NS) & waited[burst])
    for rows in np.split(late, np.flatnonzero(np.diff(burst[late])) + 1):
        if len(rows):
            late_s = float(fall_ns[rows].max()) / NS_PER_S
            reason = f"read up to {late_s:.2f} s late: these frames waited in a buffer before the port was read"
            waited_ns = frames["utc_ns"][rows]
            yield Exclusion(int(waited_ns.min()), int(waited_ns.max()) + 1, reason, Cause.BACKLOG, late_s)


def _read_at_once(host_utc_ns: NDArray[np.int64], time_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which frames (M,) were read right after the one before: far faster than they come in the mean, or were taken."""
    at_once = np.zeros(len(host_utc_ns), dtype=bool)
    gaps_ns = np.diff(host_utc_ns)
    if len(gaps_ns):
        usual_ns = np.minimum(gaps_ns.clip(0).mean(), np.diff(time_ns))
        at_once[1:] = (gaps_ns >= 0) & (gaps_ns < _AT_ONCE * usual_ns)
    return at_once


def _around_step(event: ClockStep) -> Iterator[Exclusion]:
    """The seconds around a step as the old and as the new clock tell them: one stretch where they meet."""
    step_ns = max(event.step_ns, 0) if event.utc_kept else event.step_ns
    old_ns, new_ns = event.utc_ns - step_ns, event.utc_ns
    apart = abs(step_ns) > 2 * AROUND_STEP_NS
    for first_ns, last_ns in ((old_ns, old_ns), (new_ns, new_ns)) if apart else (sorted((old_ns, new_ns)),):
        from_ns, until_ns = max(first_ns - AROUND_STEP_NS, 0), min(last_ns + AROUND_STEP_NS, LAST_NS)
        if until_ns > from_ns:
            yield Exclusion(from_ns, until_ns, event.text, Cause.CLOCK_STEP, abs(event.step_ns) / NS_PER_S)


def scene_changes(sky: ShownSky, frames: Columns) -> Iterator[Exclusion]:
    """Exposures over a change on the screen: they show two scenes, and no one attitude is their truth."""
    if not sky.shown or not len(frames):
        return
    if sky.shown[0].from_ns > 0:
        yield Exclusion(0, sky.shown[0].from_ns, "nothing was shown yet", Cause.SCENE_CHANGE)
    half_ns = round(float(frames["exposure_s"].max()) / 2 * NS_PER_S)
    for before, after in pairwise(sky.shown):
        around_ns = half_ns + round(after.within_ms * 1e6)
        yield Exclusion(
            max(after.from_ns - around_ns, 0),
            min(after.from_ns + around_ns, LAST_NS),
            f"the scene changed from {before} to {after}",
            Cause.SCENE_CHANGE,
        )


def faster_than(sky: ShownSky, limit_deg_per_s: float | None) -> Iterator[Exclusion]:
    """Stretches in which the scene turned faster than the sensor must bear; none where nothing is asked."""
    if limit_deg_per_s is None:
        return
    for shown, until_ns in zip(sky.shown, [*(item.from_ns for item in sky.shown[1:]), LAST_NS], strict=False):
        if shown.rate_deg_per_s > limit_deg_per_s:
            reason = f"the scene turned at {shown.rate_deg_per_s:.4g} deg/s, limits.slew_deg_per_s is"
            yield Exclusion(shown.from_ns, until_ns, f"{reason} {limit_deg_per_s:g}", Cause.FASTER)


def screen_lost(events: Iterable[LinkEvent]) -> Iterator[Exclusion]:
    """Stretches in which the page did not show the scene; the last one lasts until the end of the session."""
    lost: LinkEvent | None = None
    for event in events:
        if event.kind == StationKind.SCREEN_LOST:
            lost = lost or event
        elif event.kind == StationKind.SCREEN_SHOWS and lost is not None:
            yield Exclusion(lost.utc_ns, max(event.utc_ns, lost.utc_ns + 1), lost.text, Cause.SCREEN_LOST)
            lost = None
    if lost is not None:
        yield Exclusion(lost.utc_ns, LAST_NS, lost.text, Cause.SCREEN_LOST)


def parse_exclusion(text: str) -> Exclusion:
    """The stretch that an operator writes: FROM/TO, FROM/TO=why or FROM/TO=mount: why, with UTC instants.

    UsageError shows an example.
    """
    stretch, _, reason = text.partition("=")
    begin, _, end = stretch.partition("/")
    reason = reason.strip() or "left out by the operator"
    cause = Cause.MOUNT if reason.startswith(_OF_MOUNT) else Cause.OPERATOR
    if cause is Cause.MOUNT:
        reason = reason.removeprefix(_OF_MOUNT).strip() or "the mount was touched"
    try:
        stated = Exclusion(from_text(begin), from_text(end), reason, cause)
    except ValueError:
        raise UsageError(f"{text!r} is not a stretch to leave out; {_EXAMPLE}") from None
    if stated.until_ns <= stated.from_ns:
        raise UsageError(f"{text!r} ends before it begins; {_EXAMPLE}")
    return stated


def excluded(utc_ns: NDArray[np.int64], stretches: Iterable[Exclusion]) -> NDArray[np.bool_]:
    """Which instants (M,) lie in any of the stretches."""
    mask = np.zeros(len(utc_ns), dtype=bool)
    for item in stretches:
        mask |= (utc_ns >= item.from_ns) & (utc_ns < item.until_ns)
    return mask
