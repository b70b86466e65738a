"""Stars that are not where they are expected: out of place, hidden in the field, or on a detector of another size."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gse.errors import TruthError, UsageError
from gse.imaging.camera_fit import Calibration, StarField, calibrate
from gse.station.camera_watch import ROUND_PX, other_size_in_words
from gse.station.columns import STATUSES
from gse.station.events import Finding
from gse.station.frame_columns import Columns
from gse.station.results import Status
from gse.station.session_data import SessionData, middle_instant_ns
from gse.station.session_tables import residuals_of, xy_px_of
from gse.station.setup import catalog_of
from gse.station.sky_condition import FEWEST_UNMATCHED
from gse.statistics.counted_frames import CountedFrames
from gse.truth import SiderealTruth, horizon_to_sensor
from gse.values.attitude import Attitude
from gse.values.constants import ARCSEC_RAD
from gse.values.matrices import product

ENTER_CAMERA = "enter it and judge the same recording again: gse report SESSION --station FILE; gse calibrate fits it"
_LOW_DEG = 10.0
"""At an altitude of 10 deg air lifts stars by 5 arcmin, at 30 deg by 1.7: a field holds both."""
_FEWEST_ANSWERED = 5
"""One picture may show the edge of a cloud, a bright Moon or a town."""
STARS_FALL_OUT = ("distortion", "focal length", "principal point", "pixel pitch")
"""Causes that may move stars by more than they are matched within; beside them all others are guesses then."""
FALLEN_OUT_SHARE = 0.3
"""Least share of the matched stars; satellites, noise or a few hot pixels make fewer."""


def stars_fall_out(frames: Columns, used: NDArray[np.bool_]) -> bool:
    """Whether many stars of the used frames (rows of FRAME) lie too far off to be matched.

    As these change, so do the errors.
    """
    unmatched, matched = (float(np.median(frames[name][used])) for name in ("false_objects", "matched"))
    return unmatched >= max(FEWEST_UNMATCHED, FALLEN_OUT_SHARE * matched)


def most_unmatched(session: SessionData, counted: CountedFrames) -> Iterator[Finding]:
    """What leaves too few good answers where most objects are none of the stars that ought to be there."""
    frames, known = session.frames.columns, counted.answered & ~counted.excluded
    if known.sum() < _FEWEST_ANSWERED or not stars_fall_out(frames, known):
        return
    good = (counted.answered & ~counted.false)[counted.expected].mean()
    if good >= session.station.limits.availability:
        return
    unmatched, matched, expected = (
        float(np.median(frames[name][known])) for name in ("false_objects", "matched", "stars_expected")
    )
    if unmatched > matched and expected >= matched + FEWEST_UNMATCHED:
        yield _out_of_place(
            session,
            f"{unmatched:.0f} objects as bright as stars of the catalogue are none of them, {matched:.0f} are, and "
            f"{expected:.0f} stars are expected",
        )


def _out_of_place(session: SessionData, seen: str) -> Finding:
    """Why stars do not lie where they are looked for: a field that reaches to the horizon, or another camera."""
    station, fitted = session.station, session.alignment
    mount = fitted.mount if fitted else station.mount
    lowest_deg = mount.altitude_deg - math.degrees(station.sensor.camera().diagonal_rad) / 2
    if mount.inertial is None and lowest_deg < _LOW_DEG:
        return Finding(
            "field near the horizon",
            f"{seen}: it reaches down to an altitude of {lowest_deg:.0f} deg, where air lifts stars by more than they "
            "are matched within",
            ("a camera that is not as stated",),
            "point the sensor higher, and repeat the session",
        )
    return Finding(
        "camera",
        f"{seen}: they do not lie where the camera of the station file has them",
        ("a distortion of the lens", "stars out of focus", "false objects of the sensor"),
        "fit the camera: gse calibrate SESSION --write FILE; look at the panoramas: gse view SESSION",
    )


# Something that stands in the field: a wall, a tree, the rim of a dome.
#
# It hides all stars on one side of a line and none on the other; a cloud takes the faint ones everywhere. Of N stars, k
# of which are missing, a line parts them by chance in some 2 N of the ways in which k of N can be missing.

_LOOKS = 12
"""Times of the session at which it is looked for."""
_JOINED = 3
"""Frames of which one must show a star: an extraction may miss it in one of them."""
_WITHIN_PX, _MARGIN_PX = 25.0, 12.0
"""A mount that is set by hand, and air, move stars by so much from their expected places."""
_SEEN_SHARE = 0.8
"""Where more of the expected stars are seen, nothing of interest is hidden."""
_DIRECTIONS = 36
_CHANCE, _LEAST_LOOKS = 0.02, 1 / 4
_BRIGHTER, _CHANCE_OF_BRIGHT = 3, 0.1
"""Where so many of the missing stars are brighter than most that are seen, no cloud dims them: less is needed."""
_ONE_SIDE = 0.7
"""Length of the mean of unit vectors towards the hidden side: 1 where all agree."""
_SIDES = ("right", "lower right", "lower", "lower left", "left", "upper left", "upper", "upper right")


def hidden_field(session: SessionData) -> Iterator[Finding]:
    """What hides the stars of one side of the field, where a quarter of the looks shows it."""
    frames = session.frames.columns
    expected = frames["stars_expected"].astype(np.float64)
    fewer = (expected >= FEWEST_UNMATCHED) & (frames["stars_seen"] < _SEEN_SHARE * expected)
    if session.station.mount.inertial is not None or fewer.sum() <= _LEAST_LOOKS * len(fewer):
        return
    looks = list(_looks(session))
    told = [look for look in looks if look is not None and look[3] < _CHANCE]
    if len(told) < max(_LEAST_LOOKS * _LOOKS, 2):
        return
    towards = np.mean([look[0] for look in told], axis=0)
    if math.hypot(*towards) < _ONE_SIDE:
        return
    side = _SIDES[round(math.degrees(math.atan2(towards[1], towards[0])) / 45) % 8]
    (_, first, of_first, _), (_, last, of_last, _) = told[0], told[-1]
    grows = f", and {last} of {of_last} later" if abs(last / of_last - first / of_first) > _GROWS else ""
    yield Finding(
        "obstruction",
        f"{first} of {of_first} expected stars are missing{grows}, all on the {side} side of the image; the others are "
        "seen",
        ("dew or dirt on a part of the lens", "the edge of a bank of cloud that stays"),
        "free the view of the sensor or point it elsewhere, and repeat the session",
    )


_GROWS = 0.2


def _looks(session: SessionData) -> Iterator[tuple[NDArray[np.float64], int, int, float] | None]:
    """At some times: towards where stars are missing, how many, of how many, and the chance of it."""
    frames, camera, middle_ns = session.frames.columns, session.station.sensor.camera(), middle_instant_ns(session)
    matches, others = session.frames.matches, session.frames.others
    frame = np.concatenate([matches["frame"], others["frame"]]).astype(np.int64)
    xy_px = np.concatenate([xy_px_of(matches), xy_px_of(others)])
    kept = np.unique(frame)
    if middle_ns is None or not len(kept):
        return
    catalog = catalog_of(session.station, middle_ns)
    zenith_sensor = horizon_to_sensor(session.alignment.mount if session.alignment else session.station.mount)[:, 2]
    for row in kept[np.linspace(0, len(kept) - 1, min(_LOOKS, len(kept))).astype(np.int64)].tolist():
        icrs_to_sensor = _attitude(session, row)
        if icrs_to_sensor is None or not frames["stars_expected"][row] >= 0:
            continue
        stars_sensor = product(catalog.icrs, icrs_to_sensor.T)
        stars_sensor = stars_sensor[product(stars_sensor, zenith_sensor) > math.sin(math.radians(_LOW_DEG))]
        places = camera.pixels(stars_sensor[stars_sensor[:, 2] > math.cos(camera.diagonal_rad)])
        inside = (places > _MARGIN_PX).all(axis=1) & camera.contains(places + _MARGIN_PX)
        places = places[inside][: int(frames["stars_expected"][row])]
        objects = xy_px[(frame >= row) & (frame < row + _JOINED)]
        apart = np.linalg.norm(places[:, None] - objects[None], axis=2)
        yield _one_sided(places, ~(apart < _WITHIN_PX).any(axis=1), xy_px[frame == row])


def _attitude(session: SessionData, row: int) -> NDArray[np.float64] | None:
    """From the catalogue to the sensor (3, 3): as answered, else as the mount looks, but for the air."""
    frames, mount = session.frames.columns, session.alignment.mount if session.alignment else session.station.mount
    if frames["status"][row] == STATUSES.index(Status.IDENTIFIED):
        angles = [float(frames[name][row]) for name in ("ra_deg", "de_deg", "roll_deg")]
        return Attitude.from_angles(*angles).icrs_to_sensor if np.isfinite(angles).all() else None
    if session.earth_orientation is None or not mount.stated:
        return None
    truth = SiderealTruth(session.station.site, session.earth_orientation)
    try:
        icrs_to_horizon = truth.icrs_to_horizon(int(frames["utc_ns"][row]))
    except TruthError:  # a clock that leapt by years, in some frames
        return None
    return np.asarray(product(horizon_to_sensor(mount), icrs_to_horizon))


def _one_sided(
    places: NDArray[np.float64], missing: NDArray[np.bool_], objects: NDArray[np.float64]
) -> tuple[NDArray[np.float64], int, int, float] | None:
    """Towards where (2,) stars (N, 2), brightest first, are missing, how many, of how many, and the chance of it.

    None where objects (M, 2) show that nothing is hidden there.
    """
    count, gone = len(missing), int(missing.sum())
    if not 0 < gone < count:
        return None
    best, towards = count, np.zeros(2)  # the mean of all directions that part them as well
    for angle in np.arange(_DIRECTIONS) * 2 * math.pi / _DIRECTIONS:
        unit = np.array([math.cos(angle), math.sin(angle)])
        beyond = missing[np.argsort(-(places * unit).sum(axis=1), kind="stable")]
        wrong = int((np.cumsum(~beyond) + gone - np.cumsum(beyond)).min())
        if wrong <= best:
            best, towards = wrong, unit + (towards if wrong == best else 0.0)
    towards = towards / max(math.hypot(*towards), 1e-9)
    line = np.sort((places * towards).sum(axis=1))[-gone]
    if 2 * ((objects * towards).sum(axis=1) >= line).sum() > gone:  # they are there, and out of place
        return None
    chance = 2 * count * math.comb(count, best) / math.comb(count, gone)
    seen = np.flatnonzero(~missing)
    if missing[: seen[len(seen) // 2]].sum() >= _BRIGHTER:
        chance *= _CHANCE / _CHANCE_OF_BRIGHT
    return towards, gone, count, chance


# Half of the field that shows hardly a star: dew, shade, a wall that stands as far as the middle.
#
# Whole stars are counted, over all looks, of those that are bright enough to be seen in the other half. If seen and
# unseen ones lay at random, Fisher's exact test tells how seldom they would part so between the halves.

_HALF_LOOKS = 60
_HALF_CHANCE, _HALF_WAYS = 0.02, 4 * 3
"""Eight halves, of which neighbours share three quarters, are tried in three stretches of time. However many looks
there are, six stars on either side are the fewest that prove it."""
_DARK_SHARE, _LIGHT_SHARE = 0.25, 0.7
"""Shares of the expected stars that are seen: at most in the one half, at least in the other."""
_BRIGHT_PERCENTILE = 90.0
"""Of the stars that are seen: fainter ones may be missing anywhere."""
_LOSS_PER_AIRMASS_MAG = 0.25
"""A usual night; low stars are fainter."""


@dataclass(frozen=True, slots=True, eq=False)
class _StarLooks:
    """Stars (N,) expected at looks (N,), with their places (N, 2) from the detector's middle, and which are seen."""

    star: NDArray[np.int64]
    look: NDArray[np.int64]
    from_middle_px: NDArray[np.float64]
    seen: NDArray[np.bool_]

    def some(self, rows: NDArray[np.bool_]) -> "_StarLooks":
        return _StarLooks(self.star[rows], self.look[rows], self.from_middle_px[rows], self.seen[rows])


def dark_half(session: SessionData) -> Iterator[Finding]:
    """That hardly a star of one half of the image is seen, and most of those of the other half are."""
    sightings = _sightings(session) if session.station.mount.inertial is None else None
    if sightings is None:
        return
    middle = (sightings.look.min() + sightings.look.max()) / 2
    stretches = {
        "": sightings,
        "in the first half of the session, ": sightings.some(sightings.look < middle),
        "in the second half of the session, ": sightings.some(sightings.look >= middle),
    }
    for when, part in stretches.items():
        if (found := _dark_side(part)) is not None:
            place, (dark, light) = found
            side, other = (_SIDES[(place + turn) % 8] for turn in (0, 4))
            yield Finding(
                "half of the field",
                f"{when}of {dark.stars} expected stars in the {side} half of the image {dark.share:.0%} were seen, of "
                f"{light.stars} in the {other} half {light.share:.0%}".replace("%", " %"),
                ("dew or dirt on a part of the lens", "shade, a wall or a tree", "light that blinds this half"),
                "look at the lens and free the view of the sensor, then repeat the session",
            )
            return


@dataclass(frozen=True, slots=True)
class _Half:
    """How many stars are expected in a half, how many are seen at most looks, and the mean share of looks."""

    stars: int
    often: int
    share: float


def _dark_side(sightings: _StarLooks) -> tuple[int, tuple[_Half, _Half]] | None:
    """The side (a place in _SIDES) whose half is dark, with the dark and the other half; the surest one."""
    best, found = _HALF_CHANCE / _HALF_WAYS, None
    for place in range(len(_SIDES)):
        angle = place * math.pi / 4
        beyond = (sightings.from_middle_px * [math.cos(angle), math.sin(angle)]).sum(axis=1) > 0
        dark, light = _half(sightings.some(beyond)), _half(sightings.some(~beyond))
        if dark is None or light is None or dark.share > _DARK_SHARE or light.share < _LIGHT_SHARE:
            continue
        if (chance := _chance_of(dark, light)) < best:
            best, found = chance, (place, (dark, light))
    return found


def _half(sightings: _StarLooks) -> _Half | None:
    _, star = np.unique(sightings.star, return_inverse=True)
    if not len(star):
        return None
    share = np.bincount(star, sightings.seen) / np.bincount(star)
    return _Half(len(share), int((share >= 0.5).sum()), float(share.mean()))


def _chance_of(dark: _Half, light: _Half) -> float:
    """That no more of the stars of the dark half are among those that are seen, by Fisher's exact test."""
    seen = dark.often + light.often
    ways = sum(math.comb(dark.stars, few) * math.comb(light.stars, seen - few) for few in range(dark.often + 1))
    return ways / math.comb(dark.stars + light.stars, seen)


def _sightings(session: SessionData) -> _StarLooks | None:
    """Stars as bright as nearly all that are seen, at looks over the identified frames; None where there are none."""
    frames, camera, middle_ns = session.frames.columns, session.station.sensor.camera(), middle_instant_ns(session)
    matches, others = session.frames.matches, session.frames.others
    of_look = np.zeros(len(frames), dtype=bool)
    of_look[matches["frame"]] = True
    rows = np.flatnonzero(of_look)
    if middle_ns is None or not len(rows):
        return None
    rows = rows[np.linspace(0, len(rows) - 1, min(_HALF_LOOKS, len(rows))).astype(np.int64)]
    of_look[:] = False
    of_look[rows] = True
    matches, others = (some.compress(of_look[some["frame"]]) for some in (matches, others))
    frame = np.concatenate([matches["frame"], others["frame"]])
    xy_px = np.concatenate([xy_px_of(matches), xy_px_of(others)])
    catalog = catalog_of(session.station, middle_ns)
    zenith_sensor = horizon_to_sensor(session.alignment.mount if session.alignment else session.station.mount)[:, 2]
    parts = []
    for row in rows.tolist():
        icrs_to_sensor = _attitude(session, row)
        if icrs_to_sensor is None or not frames["stars_expected"][row] >= 0:
            continue
        stars_sensor = product(catalog.icrs, icrs_to_sensor.T)
        up = product(stars_sensor, zenith_sensor)
        near = np.flatnonzero(
            (stars_sensor[:, 2] > math.cos(camera.diagonal_rad)) & (up > math.sin(math.radians(_LOW_DEG)))
        )
        places = camera.pixels(stars_sensor[near])
        inside = (places > _MARGIN_PX).all(axis=1) & camera.contains(places + _MARGIN_PX)
        star, places = near[inside], places[inside]
        magnitude = catalog.magnitude[star] + _LOSS_PER_AIRMASS_MAG / up[star]
        seen = (np.linalg.norm(places[:, None] - xy_px[frame == row][None], axis=2) < _WITHIN_PX).any(axis=1)
        parts.append((star, np.full(len(star), row), places, seen, magnitude))
    if not parts:
        return None
    star, look, places, seen, magnitude = (np.concatenate(part) for part in zip(*parts, strict=True))
    if not seen.any():
        return None
    bright = magnitude <= np.percentile(magnitude[seen], _BRIGHT_PERCENTILE)
    middle_px = (np.array([camera.columns, camera.rows]) - 1) / 2
    return _StarLooks(star, look, places - middle_px, seen).some(bright)


# A detector of another size, under which some panoramas are identified all the same.
#
# Its middle is not that of the stated one, and with the middle the principal point moves: stars show where that is, as
# the scale of a pinhole grows with the distance from it. No object lies beyond the side that follows, and the outermost
# lie near it. gse.station.camera_watch finds the size where nothing is identified.

_FITTED_FRAMES = 40
_SIZE_SIGMAS = 3.0
"""A side is twice as uncertain as the principal point."""
_LEAST_OTHER_PX = 32
"""Air that is taken off about a wrong zenith moves the stars as a side that is 16 px longer or shorter does."""
_EMPTY_EDGE = 1.25
"""Largest ratio of a side to what its objects reach."""


def other_size(session: SessionData, counted: CountedFrames) -> Finding | None:
    """That the detector has another size, where the identified stars and the places of all objects show it."""
    camera, frames = session.station.sensor.camera(), session.frames
    objects = [table for table in (frames.matches, frames.others) if len(table)]
    if not objects:
        return None
    reach_px = np.array([max(float(table[axis].max()) for table in objects) for axis in ("x_px", "y_px")])
    sides = np.array([camera.columns, camera.rows])
    is_other = (reach_px < sides - ROUND_PX / 2) | (reach_px > sides)
    if not is_other.any() or (fit := _fitted_camera(session, counted)) is None:
        return None
    fitted = 2 * np.array(fit.camera.principal_point_px) + 1
    usual = np.rint(fitted / ROUND_PX) * ROUND_PX
    found = np.where(np.abs(usual - fitted) < _SIZE_SIGMAS * 2 * np.array(fit.sigma[1:3]), usual, np.rint(fitted))
    is_other &= (np.abs(found - fitted) < np.abs(sides - fitted)) & (np.abs(found - sides) >= _LEAST_OTHER_PX)
    found = np.where(is_other, found, sides)
    fits = (reach_px < found + 0.5) & (found < _EMPTY_EDGE * (reach_px + 1))
    if "principal point" in fit.held or not is_other.any() or not fits[is_other].all():
        return None
    (columns, rows), (x, y) = found.astype(int).tolist(), np.where(is_other, (found - 1) / 2, camera.principal_point_px)
    resized = replace(camera, columns=columns, rows=rows, principal_point_px=(float(x), float(y)))
    size = other_size_in_words(camera, resized, reach_px)
    equals = ("a principal point that is off by as much",)
    return Finding("detector size", size, equals, ENTER_CAMERA, is_gross=True)


def _fitted_camera(session: SessionData, counted: CountedFrames) -> Calibration | None:
    """The camera that the stars of some answers fit; None where they are too few."""
    camera, matches = session.station.sensor.camera(), session.frames.matches
    rows = np.flatnonzero(counted.answered & ~counted.false)
    rows = rows[np.unique(np.linspace(0, len(rows) - 1, _FITTED_FRAMES).astype(np.int64))] if len(rows) else rows
    matches = matches.compress(matches["named"] & np.isin(matches["frame"], rows))
    xy_px, stars = xy_px_of(matches), matches["star"].astype(np.int64)
    seen = camera.directions(xy_px)
    seen[:, :2] -= residuals_of(matches) * ARCSEC_RAD
    parts = np.flatnonzero(np.diff(matches["frame"])) + 1
    columns = zip(*(np.split(column, parts) for column in (xy_px, seen, stars)), strict=True)
    try:
        return calibrate(camera, [StarField(*of_frame) for of_frame in columns])
    except (UsageError, ValueError):  # too few, or all on one line
        return None
