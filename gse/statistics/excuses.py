"""What may excuse a sensor, and from what: the one table.

LEFT_OUT are stretches whose frames do not count, found before anything is judged. EXCUSES turn a row that FAILs into
INCONCLUSIVE: the first one that sees its reason adds it in words. Each entry names what it may excuse, by what a FAIL
claims of the sensor (Claim); all else it never touches, and no entry makes a row PASS. The sky excuses an answer that
is absent, never one that was given: only an unknown time, or a mount that was touched, takes answers out of the
accuracy. No stretch excuses FALSEHOOD: a star is identified without knowing the time, so an answer of other stars is
wrong whenever it came.

What only stands in the way of PASS, though no row fails, is in gse.verdict.obstacles. A finding that is none of
these excuses nothing.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from drivers.chunk import LinkKind
from gse.station.columns import ANSWER_CHECKS, SKY_CONDITIONS, STATUSES
from gse.station.events import StationKind
from gse.station.exclusions import (
    Cause,
    Exclusion,
    exclusions,
    faster_than,
    link_losses,
    mount_touched,
    scene_changes,
    screen_lost,
)
from gse.station.frame_columns import Columns, InOrder
from gse.station.own_answers import OwnAnswerTruth, field_of
from gse.station.results import AnswerCheck, SkyCondition, Status, Subject
from gse.station.session_data import SessionData, middle_instant_ns
from gse.station.sky_condition import CLEARED_MAG, FEWEST_EXPECTED, FEWEST_OBJECTS, SUN_LIMIT_DEG
from gse.statistics.decision import Claim, Outcome, Row, Share
from gse.truth import truth_of
from gse.truth.solar_system import sun_altitude_deg
from gse.values.constants import ARCSEC_PER_RAD
from gse.values.instant import NS_PER_S
from gse.values.site import Site
from gse.values.text import count_text

# Stretches in which there was no sky to see: twilight and daylight, cloud, cover.
#
# Twilight is one from the first to the last frame in which the Sun stands above SUN_LIMIT_DEG and fewer stars are seen
# than the dark part of the session makes expected, by more than its noise. A twilight in which all of them are seen
# counts as night. Where a session has no dark part, it is one from the first to the last half minute in which most
# answers are missing, and some minutes more in which some are, and fewer stars are seen than the catalogue makes
# expected. A cloud is a stretch whose sky the stars themselves show to be clouded (gse.station.sky_condition).
#
# Where neither identifier finds a star for ten seconds or longer (or in all of a shorter session), something else must
# show the reason: the Sun, the Moon in the field, empty panoramas, or stars that faded before or after. A sensor that
# fails under a clear and dark sky is not excused. Empty panoramas have a cause of their own: a blind sensor sends them
# too.
#
# Absences at the edge of a stretch belong to it: a cloud that closes, a twilight that deepens.

FADED_MAG = 1.0
"""Stars that are fainter by this much than in the clear part of the session are behind cloud."""

MIN_STRETCH_NS = 10 * NS_PER_S
_BRIDGED_NS, _BRIDGED_FRAMES = 3 * NS_PER_S, 1.5
"""Single answers through a gap in the cloud do not end a stretch, nor does the time between two frames."""

_BESIDE_NS = 60 * NS_PER_S
MISSING_SHARE = 0.5
"""Below this part of the share of expected stars that the clear session shows, a cloud hides the others."""

_CLEAR_PERCENTILE = 90.0
_EDGE_NS = 10 * NS_PER_S
"""Two windows of the sky's condition: so far beyond a stretch its edge may reach."""
_BREAKING_NS = 120 * NS_PER_S
"""And so far in which all absences belong to it where fewer stars than usual are seen: a cloud that breaks up."""
_BLOCK_NS = 30 * NS_PER_S
"""Stars come and go at the edge of a field within seconds: half a minute tells what share of them is seen."""
_FEWEST_BLOCKS = 4
_MOST_SEEN = 0.9
"""Where more of the frames are named, stars that are missing and not faint are no cloud."""
_FEWER, _FEWER_SIGMAS = 0.1, 3.0
"""In twilight fewer stars are seen where this share of the usual ones is missing, and as many standard deviations."""
_MOSTLY = 0.5
"""A twilight without a dark part beside it begins where less than this share of the frames is named."""


def no_sky(frames: Columns, site: Site, *, starlit: bool = False, field_deg: float = 0.0) -> tuple[Exclusion, ...]:
    """The stretches of frames (rows of FRAME, any order) without a sky; each with its reason in words.

    Where it is ``starlit``, clock and site are wrong that say that the Sun is up. What is nearer to the boresight than
    ``field_deg`` is in the field.
    """
    if (np.diff(frames["utc_ns"]) < 0).any():  # a step of the clock
        frames = InOrder(frames, np.argsort(frames["utc_ns"], kind="stable"))
    found: list[_Stretch] = []
    twilights = () if starlit else _twilights(frames)
    clouds = tuple(_clouds(frames))
    fewer = _fewer_stars(frames) if clouds else np.zeros(len(frames), dtype=bool)
    for cloud in clouds:
        _add(found, _with_edges(cloud, frames, fewer), frames)
    for stretch in (*twilights, *_explained(frames, site, starlit, field_deg)):
        _add(found, _with_edges(stretch, frames, np.zeros_like(fewer)), frames)
    return tuple(_exclusion(stretch, frames) for stretch in sorted(found, key=lambda one: one.first))


@dataclass(frozen=True, slots=True)
class _Stretch:
    """Rows of the frames from the first to the last, and why; ``says`` is the reason but for its duration."""

    first: int
    last: int
    cause: Cause
    says: str


def _add(found: list[_Stretch], stretch: _Stretch, frames: Columns) -> None:
    """Add a stretch, or join it with one before it that it meets, whose reason stands."""
    utc_ns, bridged_ns = frames["utc_ns"], _bridged_ns(frames)
    for place, one in enumerate(found):
        apart_ns = max(utc_ns[stretch.first] - utc_ns[one.last], utc_ns[one.first] - utc_ns[stretch.last])
        if apart_ns <= bridged_ns:
            first, last = min(one.first, stretch.first), max(one.last, stretch.last)
            found[place] = replace(one, first=first, last=last)
            return
    found.append(stretch)


def _fewer_stars(frames: Columns) -> NDArray[np.bool_]:
    """In which frames (M,) fewer stars are seen than in the dark part of the session."""
    block, share, is_light = _star_shares(frames)
    return np.asarray((share < _usual_share(share, is_light))[block])


def _with_edges(stretch: _Stretch, frames: Columns, fewer: NDArray[np.bool_]) -> _Stretch:
    """The stretch with the absences that go on at its edges, and those up to where ``fewer`` (M,) stars are seen."""
    utc_ns, bridged_ns = frames["utc_ns"], _bridged_ns(frames)
    first, last = stretch.first, stretch.last
    near = _within(utc_ns, stretch, _BREAKING_NS)
    absent = near.start + np.flatnonzero(frames["status"][near] != STATUSES.index(Status.IDENTIFIED))
    edge = _within(utc_ns, stretch, _EDGE_NS)
    for row in absent[absent > last].tolist():
        if fewer[row] or (row < edge.stop and utc_ns[row] - utc_ns[last] <= bridged_ns):
            last = row
    for row in absent[absent < first][::-1].tolist():
        if fewer[row] or (row >= edge.start and utc_ns[first] - utc_ns[row] <= bridged_ns):
            first = row
    return replace(stretch, first=first, last=last)


def _within(utc_ns: NDArray[np.int64], stretch: _Stretch, apart_ns: int) -> slice:
    """The rows of a stretch and of so long about it."""
    first = np.searchsorted(utc_ns, utc_ns[stretch.first] - apart_ns)
    last = np.searchsorted(utc_ns, utc_ns[stretch.last] + apart_ns, side="right")
    return slice(int(first), int(last))


def _exclusion(stretch: _Stretch, frames: Columns) -> Exclusion:
    utc_ns = frames["utc_ns"]
    duration_s = float(utc_ns[stretch.last] - utc_ns[stretch.first] + _exposure_ns(frames, stretch.last)) / NS_PER_S
    reason = stretch.says.format(duration=f"{duration_s:.0f} s")
    return Exclusion(int(utc_ns[stretch.first]), int(utc_ns[stretch.last]) + 1, reason, stretch.cause)


# Twilight


def _twilights(frames: Columns) -> Iterator[_Stretch]:
    """From the first to the last row of each twilight in which fewer stars are seen than in the dark."""
    if not len(frames) or not (frames["sun_altitude_deg"] > SUN_LIMIT_DEG).any():
        return
    block, share, is_light = _star_shares(frames)
    fewer = is_light & (share < _usual_share(share, is_light))
    blind = fewer
    if not _has_dark(share, is_light):  # what the dark would show is not known: stars are too few where answers fail
        answers = np.bincount(block, frames["status"] == STATUSES.index(Status.IDENTIFIED)) / np.bincount(block)
        blind, fewer = fewer & (answers < _MOSTLY), fewer & (answers < 1 - _FEWER)
    for part in np.split(np.arange(len(share)), np.flatnonzero(np.diff(is_light)) + 1):
        few = part[blind[part]]
        if not len(few):
            continue
        edge = _BREAKING_NS // _BLOCK_NS
        few = part[fewer[part] & (part >= few[0] - edge) & (part <= few[-1] + edge)]
        rows = np.flatnonzero((block >= few[0]) & (block <= few[-1]))
        first, last = int(rows[0]), int(rows[-1])
        seen, expected = (np.nan_to_num(frames[name][first : last + 1]) for name in ("stars_seen", "stars_expected"))
        sun = _sun_words(frames["sun_altitude_deg"][[first, last]])
        stars = f"{seen.mean():.0f} of {expected.max():.0f} expected stars are seen"
        yield _Stretch(first, last, Cause.NO_SKY, f"{sun}: no dark sky for {{duration}}, {stars}")


def _star_shares(frames: Columns) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.bool_]]:
    """The block of each frame (M,); of each block the share of the expected stars that is seen, and if it is light.

    While the direction of the mount is not known, as many stars are expected as after it; none of a sensor that sends
    no panoramas, whose shares are NaN.
    """
    utc_ns, due = frames["utc_ns"], frames["stars_expected"].astype(np.float64)
    known = np.flatnonzero(np.isfinite(due))
    due = np.interp(np.arange(len(due)), known, due[known]) if len(known) else due
    block = np.unique((utc_ns - utc_ns[0]) // _BLOCK_NS, return_inverse=True)[1]
    count = np.bincount(block)
    expected = np.bincount(block, due)
    seen = np.bincount(block, np.minimum(frames["stars_seen"], np.nan_to_num(due)))
    with np.errstate(invalid="ignore", divide="ignore"):
        share = np.where(expected >= FEWEST_OBJECTS * count, seen / expected, np.nan)
    light = np.bincount(block, frames["sun_altitude_deg"] > SUN_LIMIT_DEG)
    return block, share, np.asarray(2 * light > count)


def _usual_share(share: NDArray[np.float64], is_light: NDArray[np.bool_]) -> float:
    """The least share of stars that is no fewer than in the dark; than all, where the session has no dark part."""
    if not _has_dark(share, is_light):
        return 1 - _FEWER
    dark = share[~is_light & np.isfinite(share)]
    usual = float(np.median(dark))
    spread = float(np.median(np.abs(dark - usual))) / 0.6745
    return usual - max(_FEWER * usual, _FEWER_SIGMAS * spread)


def _has_dark(share: NDArray[np.float64], is_light: NDArray[np.bool_]) -> bool:
    return int((~is_light & np.isfinite(share)).sum()) >= _FEWEST_BLOCKS


def _sun_words(altitudes_deg: NDArray[np.float32]) -> str:
    one, other = (f"{abs(deg):.0f} deg {'above' if deg >= 0 else 'below'}" for deg in altitudes_deg.tolist())
    return f"Sun {one} the horizon" if one == other else f"Sun {one} to {other} the horizon"


# Cloud


def _clouds(frames: Columns) -> Iterator[_Stretch]:
    """Stretches whose stars are too faint or too few: cloud, haze or dew."""
    clouded = np.flatnonzero(frames["sky_condition"] == SKY_CONDITIONS.index(SkyCondition.CLOUDED))
    utc_ns = frames["utc_ns"]
    for part in np.split(clouded, np.flatnonzero(np.diff(utc_ns[clouded]) > _bridged_ns(frames)) + 1):
        if not len(part):
            continue
        light = frames["transparency"][part[0] : part[-1] + 1]
        light = light[np.isfinite(light)]
        faded_mag = -2.5 * math.log10(max(float(light.min()), 1e-8)) if len(light) else 0.0
        words = f"stars up to {faded_mag:.1f} mag too faint" if faded_mag >= CLEARED_MAG else "too few stars"
        # Noise and false objects take stars away, too; a sky in which the others are named all the same is there.
        if faded_mag < CLEARED_MAG and _is_seen(frames, slice(part[0], part[-1] + 1)).mean() > _MOST_SEEN:
            continue
        yield _Stretch(int(part[0]), int(part[-1]), Cause.NO_SKY, f"{words}: cloud, haze or dew for {{duration}}")


# Blind


def _explained(frames: Columns, site: Site, starlit: bool, field_deg: float) -> Iterator[_Stretch]:
    for first, last in _blind_stretches(frames):
        found = _reason(frames, first, last, site, starlit) or _by_moon(frames, slice(first, last + 1), field_deg)
        if found is not None:
            yield _Stretch(first, last, *found)


def _blind_stretches(frames: Columns) -> Iterator[tuple[int, int]]:
    """First and last row of each long stretch without an answer of either identifier."""
    blind = np.flatnonzero(~_is_seen(frames, slice(None)))
    utc_ns = frames["utc_ns"]
    for part in np.split(blind, np.flatnonzero(np.diff(utc_ns[blind]) > _bridged_ns(frames)) + 1):
        if not len(part):
            continue
        long = utc_ns[part[-1]] - utc_ns[part[0]] + _exposure_ns(frames, part[-1]) >= MIN_STRETCH_NS
        if long or len(part) == len(frames):
            yield int(part[0]), int(part[-1])


def _is_seen(frames: Columns, rows: slice) -> NDArray[np.bool_]:
    """Which of some frames have an answer of either identifier."""
    answered = frames["status"][rows] == STATUSES.index(Status.IDENTIFIED)
    return np.asarray(answered | (frames["answer_check"][rows] != ANSWER_CHECKS.index(AnswerCheck.UNKNOWN)))


def _bridged_ns(frames: Columns) -> float:
    """The longest time within a stretch that does not end it."""
    utc_ns = frames["utc_ns"]
    step_ns = float(np.median(np.diff(utc_ns))) if len(utc_ns) > 1 else 0.0
    return max(_BRIDGED_NS, _BRIDGED_FRAMES * step_ns)


def _reason(frames: Columns, first: int, last: int, site: Site, starlit: bool) -> tuple[Cause, str] | None:
    """Why there was no sky from one row to another; None where no evidence shows it."""
    part, utc_ns = slice(first, last + 1), frames["utc_ns"]
    middle_ns = int(utc_ns[first + (last + 1 - first) // 2])
    sun_deg = sun_altitude_deg(site, middle_ns)
    if sun_deg > SUN_LIMIT_DEG and not starlit:
        side = "above" if sun_deg >= 0 else "below"
        return Cause.NO_SKY, f"Sun {abs(sun_deg):.0f} deg {side} the horizon: no dark sky for {{duration}}"
    if (frames["status"][part] == STATUSES.index(Status.SENSOR_FAULT)).any():
        return None  # only daylight explains an overexposed detector
    faded_mag = _faded_mag(frames, first, last)
    if faded_mag >= FADED_MAG:
        return Cause.NO_SKY, f"stars {faded_mag:.1f} mag too faint: cloud for {{duration}}"
    if _missing(frames, first, last):
        return Cause.NO_SKY, "less than half of the stars just before or after: cloud for {duration}"
    seen = frames["status"] == STATUSES.index(Status.IDENTIFIED)
    hot = int(np.median(frames["hot_pixels"][seen])) if seen.any() else 0  # told from stars in frames with an answer
    most = max(int(np.percentile(frames["objects"][part], _CLEAR_PERCENTILE)) - hot, 0)
    if most < FEWEST_OBJECTS:
        return Cause.NO_OBJECTS, _few_objects(most, hot, float(np.median(frames["stars_expected"][part])))
    return None


BY_MOON = "the Moon in the field"
"""With this begins the reason of a stretch that the Moon blinded."""


def _by_moon(frames: Columns, part: slice, field_deg: float) -> tuple[Cause, str] | None:
    """That the Moon stood in the field for half of the frames or more, and blinded it."""
    if (frames["status"][part] == STATUSES.index(Status.SENSOR_FAULT)).any():
        return None  # only daylight explains an overexposed detector
    off_deg, up_deg = (float(np.median(frames[name][part])) for name in ("moon_separation_deg", "moon_altitude_deg"))
    if not (up_deg > 0 and off_deg < field_deg):
        return None
    return Cause.NO_SKY, f"{BY_MOON}, {off_deg:.1f} deg from the boresight: no star for {{duration}}"


def _few_objects(most: int, hot: int, expected: float) -> str:
    """Too few objects for an answer, with what may be the reason."""
    objects = "no object at all" if most == 0 else f"at most {most} object{'' if most == 1 else 's'}"
    if hot:
        objects = f"{'no object' if most == 0 else objects} beside {count_text(hot, 'hot pixel')}"
    stars = f", {expected:.0f} star{' is' if expected == 1 else 's are'} expected" if expected >= 0 else ""
    reason = "lens cap, cover or overcast" if most == 0 else "cloud, a cover, or a sensor that sends too few objects"
    if 0 <= expected < FEWEST_OBJECTS:
        reason = "the field has too few stars to be identified"
    return f"{objects} for {{duration}}{stars}: {reason}"


def _exposure_ns(frames: Columns, row: int) -> int:
    """A frame of 60 s shows the sky of a minute."""
    exposure_s = float(frames["exposure_s"][row])
    return round(exposure_s * NS_PER_S) if exposure_s > 0 else 0


def _beside(frames: Columns, first: int, last: int) -> NDArray[np.bool_]:
    """Which frames are in a stretch or near it."""
    utc_ns = frames["utc_ns"]
    return np.asarray((utc_ns >= utc_ns[first] - _BESIDE_NS) & (utc_ns <= utc_ns[last] + _BESIDE_NS))


def _faded_mag(frames: Columns, first: int, last: int) -> float:
    """How much fainter than in the clear the stars were just before or after a stretch; 0 where none were seen.

    Brightness is that of an exposure of 1 s, under a dark sky: the light of twilight is added to that of the stars.
    """
    exposure_s = frames["exposure_s"]
    zero_point = frames["zero_point_mag"] - 2.5 * np.log10(np.where(exposure_s > 0, exposure_s, 1.0))
    known = np.isfinite(zero_point) & ~(frames["sun_altitude_deg"] > SUN_LIMIT_DEG)
    beside = known & _beside(frames, first, last)
    if not beside.any():
        return 0.0
    clear = np.percentile(zero_point[known], _CLEAR_PERCENTILE)
    return float(clear - zero_point[beside].min())


def _missing(frames: Columns, first: int, last: int) -> bool:
    """Whether most of the stars were missing just before or after a stretch, with a dark sky and enough of them."""
    expected = frames["stars_expected"]
    known = (frames["stars_seen"] > 0) & (expected >= FEWEST_EXPECTED) & ~(frames["sun_altitude_deg"] > SUN_LIMIT_DEG)
    beside = known & _beside(frames, first, last)
    if not beside.any():
        return False
    share = frames["stars_seen"] / np.where(known, expected, np.nan)
    least = np.percentile(share[beside], 100 - _CLEAR_PERCENTILE)
    return bool(least < MISSING_SHARE * np.percentile(share[known], _CLEAR_PERCENTILE))


_SHOW_STARS = (StationKind.MIRRORED, StationKind.WRONG_CAMERA)

_FOUND_WITHIN_NS = 5 * NS_PER_S
"""After a stop come first the frames that the port held, then those that follow the loss."""


@dataclass(frozen=True, slots=True)
class LeftOut:
    """A cause for which stretches are left out, how they are found, and what they excuse."""

    cause: Cause
    seen_by: Callable[[SessionData], Iterable[Exclusion]]
    excuses: tuple[Claim, ...]
    says: str


class Mistaken(StrEnum):
    """Of what a mistake of the set-up is."""

    STATION_FILE = "station file"
    CAMERA = "camera"
    PLACE = "place"
    """Site, mount, clock or air: where the stars that were named should stand."""
    FIELD = "field"
    """Something stands in it and hides most of its stars."""


@dataclass(frozen=True, slots=True)
class Mistake:
    """A mistake of the set-up that explains what a session shows (gse.diagnosis.set_up_mistake), by its head word."""

    of: Mistaken
    cause: str


@dataclass(frozen=True, slots=True)
class Evidence:
    """What an excuse is looked for in: the session, the availability of each subject, and mistakes of the set-up.

    ``kept`` are the rows, by subject and name, that do not fail once the turn of a mistake of place is taken out.
    """

    session: SessionData
    available: Mapping[Subject, Share]
    mistakes: tuple[Mistake, ...] = ()
    kept: frozenset[tuple[Subject, str]] = frozenset()


@dataclass(frozen=True, slots=True)
class Excuse:
    """A reason why a FAIL is no fault of a sensor: ``seen`` gives it in words, or nothing where it is not there."""

    name: str
    seen: Callable[[Evidence, Row], str]
    excuses: tuple[Claim, ...]
    says: str
    subjects: tuple[Subject, ...] = tuple(Subject)

    def applied_to(self, row: Row, claim: Claim, evidence: Evidence) -> Row:
        """A row that fails for it: INCONCLUSIVE; any other as it is.

        Absences that are too few to decide have their reason too.
        """
        open_to = (Outcome.FAIL, Outcome.INCONCLUSIVE) if claim is Claim.ABSENCE else (Outcome.FAIL,)
        if row.outcome not in open_to or claim not in self.excuses or row.subject not in self.subjects:
            return row
        reason = self.seen(evidence, row)
        return replace(row, outcome=Outcome.INCONCLUSIVE, reason=f"{row.reason}: {reason}") if reason else row


# How they are seen


def _clock_and_link(session: SessionData) -> Iterable[Exclusion]:
    return exclusions(session.events, session.frames.columns)


def _without_sky(session: SessionData) -> Iterable[Exclusion]:
    """A sensor that sends no panoramas shows no objects either: then only the Sun tells that there was no sky.

    Before a star simulator and in orbit there is no sky to fail, and stars that fit another camera show that the Sun
    was not up.
    """
    if not session.station.is_under_sky:
        return ()
    starlit = any(event.kind in _SHOW_STARS for event in session.events)
    camera = session.station.sensor.camera()
    field_deg = math.degrees(min(camera.columns, camera.rows) / 2 * camera.pixel_rad)
    found = no_sky(session.frames.columns, session.station.site, starlit=starlit, field_deg=field_deg)
    if session.subject is Subject.ONBOARD:
        return found
    return tuple(item for item in found if item.cause is not Cause.NO_OBJECTS)


def _between_scenes(session: SessionData) -> Iterable[Exclusion]:
    shown = session.shown
    return (
        *scene_changes(shown, session.frames.columns),
        *screen_lost(session.events),
        *faster_than(shown, session.station.limits.slew_deg_per_s),
    )


def _stated(session: SessionData) -> Iterable[Exclusion]:
    return session.excluded


def _link(session: SessionData) -> Iterable[Exclusion]:
    return link_losses(session.events)


def _touched(session: SessionData) -> Iterable[Exclusion]:
    return mount_touched(session.events)


def _mistake_of(mistaken: Mistaken) -> Callable[[Evidence, Row], str]:
    def seen(evidence: Evidence, row: Row) -> str:
        found = (f"by the set-up ({mistake.cause})" for mistake in evidence.mistakes if mistake.of is mistaken)
        return next(found, "")

    return seen


def _of_place(evidence: Evidence, row: Row) -> str:
    return _mistake_of(Mistaken.PLACE)(evidence, row) if (row.subject, row.name) in evidence.kept else ""


def _clouded(evidence: Evidence, row: Row) -> str:
    frames = evidence.session.frames.columns
    clouded = int((frames["sky_condition"] == SKY_CONDITIONS.index(SkyCondition.CLOUDED)).sum())
    if 2 * clouded <= len(frames):
        return ""
    return f"the sky was clouded, or the sensor sees too few stars, in {clouded} of {len(frames)} frames"


# A low field: air parts its stars by more than an identifier allows that knows no air. In orbit there is none: an
# identifier that fails for it on the ground has not failed.

_AIR_OF_TOLERANCE = 0.5
"""Root mean square over the field: the distance of two stars is then off by up to three times as much."""


def air_in_field(session: SessionData) -> str:
    """How far air parts the stars of the field, in words, where that is too far for an identifier; else nothing."""
    station, utc_ns = session.station, middle_instant_ns(session)
    mount = session.alignment.mount if session.alignment else station.mount
    truth = truth_of(station.site, mount, session.earth_orientation)
    if truth is None or mount.inertial is not None or utc_ns is None:
        return ""
    camera = station.sensor.camera()
    field = OwnAnswerTruth(truth, mount, aberration_corrected=True, field_sensor=field_of(camera))
    arcsec = field.uneven_arcsec(utc_ns)
    px = arcsec / (camera.pixel_rad * ARCSEC_PER_RAD)
    if px < _AIR_OF_TOLERANCE * station.identifier.tolerance_px:
        return ""
    return f"air parts the stars of this low field by {arcsec:.0f} arcsec ({px:.1f} px, rms)"


def only_reference_answers(session: SessionData) -> bool:
    """Whether only the reference identifier names the stars of most frames, and the one under test does not fail."""
    frames = session.frames.columns
    failed = frames["status"] == STATUSES.index(Status.IDENTIFIER_FAULT)
    absent = (frames["answer_check"] == ANSWER_CHECKS.index(AnswerCheck.ABSENT)) & ~failed
    return bool(2 * absent.sum() > len(frames))


def _air(evidence: Evidence, row: Row) -> str:
    air = air_in_field(evidence.session) if only_reference_answers(evidence.session) else ""
    return f"{air}, which the identifier does not know" if air else ""


def _stopped(evidence: Evidence, row: Row) -> str:
    lost, available = lost_while_not_run(evidence.session), evidence.available[row.subject]
    if lost == 0 or available.count < row.limit * (available.of - lost):
        return ""
    return f"{lost} were lost while this computer did not run the station"


def _translated(evidence: Evidence, row: Row) -> str:
    found = (event.text for event in evidence.session.events if event.kind == StationKind.TRANSLATED)
    return next(found, "")


def lost_while_not_run(session: SessionData) -> int:
    """How many panoramas are missing right after the events NOT_RUN: by time tags, and at most those that are lost."""
    frames = session.frames.columns
    resumed_ns = np.sort([event.utc_ns for event in session.events if event.kind == LinkKind.NOT_RUN])
    if len(resumed_ns) == 0 or len(frames) < 2:
        return 0
    latest = np.searchsorted(resumed_ns, frames["host_utc_ns"][1:], side="right") - 1
    after_ns = frames["host_utc_ns"][1:] - resumed_ns[latest]
    gaps_us = np.diff(frames["time_us"].astype(np.float64))
    usual_us = float(np.median(gaps_us))
    if usual_us <= 0:
        return 0
    missing = np.maximum(np.rint(gaps_us / usual_us) - 1, 0)
    found = missing[(latest >= 0) & (after_ns < _FOUND_WITHIN_NS)].sum()
    return min(int(found), session.panoramas_lost)


# The table

_ACCURACY = (Claim.ACCURACY,)
_ABSENCE = (Claim.ABSENCE,)
_ANY = (Claim.ACCURACY, Claim.ABSENCE)

LEFT_OUT = (
    LeftOut(Cause.CLOCK_STEP, _clock_and_link, _ACCURACY, "the clock was set, so that its time is not known"),
    LeftOut(Cause.BACKLOG, _clock_and_link, _ACCURACY, "it waited in a buffer, so that its time is not known"),
    LeftOut(Cause.LINK, _link, _ABSENCE, "the port of this computer was gone"),
    LeftOut(
        Cause.NO_SKY, _without_sky, _ABSENCE, "daylight, cloud that other frames show too, or the Moon in the field"
    ),
    LeftOut(Cause.NO_OBJECTS, _without_sky, _ABSENCE, "its panoramas are empty: a cap, a cover, an overcast sky"),
    LeftOut(Cause.SCENE_CHANGE, _between_scenes, _ANY, "it was exposed while the screen changed its scene"),
    LeftOut(Cause.SCREEN_LOST, _between_scenes, _ANY, "the page was closed, hidden, or of another size"),
    LeftOut(Cause.FASTER, _between_scenes, _ANY, "the scene turned faster than `limits.slew_deg_per_s` asks"),
    LeftOut(Cause.OPERATOR, _stated, _ABSENCE, "left out by the operator, who says why"),
    LeftOut(Cause.MOUNT, _touched, _ANY, "the mount was touched, as the operator says, so that truth is not known"),
    LeftOut(Cause.STEP, _stated, _ANY, "no step of the procedure watched it"),
)

LOST_STATION = Excuse(
    "station file",
    _mistake_of(Mistaken.STATION_FILE),
    tuple(Claim),
    "the session has lost its station file, so that its own limits are not known",
)
CAMERA = Excuse(
    "camera",
    _mistake_of(Mistaken.CAMERA),
    (Claim.ACCURACY, Claim.ABSENCE, Claim.FALSEHOOD),
    "the reference cannot answer with the stated camera either, or a built-in identifier answers with another one; own "
    "answers need neither",
    subjects=(Subject.ONBOARD,),
)
PLACE = Excuse(
    "set-up",
    _of_place,
    (Claim.ACCURACY, Claim.ABSENCE, Claim.FALSEHOOD),
    "site, mount, clock, air or camera are not vouched for, and the row keeps its limit without the turn they explain",
)
HIDDEN = Excuse(
    "obstruction", _mistake_of(Mistaken.FIELD), (Claim.ABSENCE,), "something hides most of the field's stars"
)
CLOUD = Excuse("cloud", _clouded, (Claim.ABSENCE,), "most frames show a clouded sky")
AIR = Excuse(
    "air in a low field",
    _air,
    (Claim.ABSENCE,),
    "air parts the stars by more than an identifier allows that knows none, as in orbit, and the reference answers",
    subjects=(Subject.ONBOARD,),
)
STOP = Excuse("stop", _stopped, (Claim.ABSENCE,), "the frames were lost while this computer did not run the station")

TRANSPORT = Excuse("transport", _translated, (Claim.ABSENCE,), "bytes were taken out or translated on their way here")

EXCUSES = (LOST_STATION, CAMERA, PLACE, HIDDEN, CLOUD, AIR, STOP, TRANSPORT)


def left_out(session: SessionData) -> tuple[Exclusion, ...]:
    """All stretches of a session that are left out."""
    return tuple(item for seen_by in dict.fromkeys(entry.seen_by for entry in LEFT_OUT) for item in seen_by(session))


def excusing(claim: Claim, stretches: Iterable[Exclusion]) -> list[Exclusion]:
    """Those of the stretches that excuse what a FAIL would claim."""
    causes = {entry.cause for entry in LEFT_OUT if claim in entry.excuses}
    return [item for item in stretches if item.cause in causes]


def excused(row: Row, claim: Claim, evidence: Evidence) -> Row:
    """A row that fails for what may excuse it: INCONCLUSIVE, with the reason; any other as it is."""
    for excuse in EXCUSES:
        row = excuse.applied_to(row, claim, evidence)
    return row
