"""Gross causes: mistakes of the set-up that turn the sky by degrees, each tried by itself.

The raw attitudes of some frames know nothing of site, clock and mount. Under each hypothesis (a sign, two values
exchanged, a time zone, a quarter turn) they are corrected anew for aberration and refraction and compared with where
the mount would have looked. A hypothesis is named where what it leaves is noise, of the frames and of what is stated:
no free parameter helps it, so that a hit by chance is a matter of one in a thousand. Where none is exact, a turn about
the pole, the vertical, a level axis or the boresight is named with its size, if that is; then what leaves little, as
beside a mount that was set by hand.
"""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import erfa
import numpy as np
from numpy.typing import NDArray

from gse.diagnosis.turns import EAST, VERTICAL, about, level_axis, pole, size_rad, taken_out
from gse.station.columns import ANSWER_CHECKS
from gse.station.events import Finding
from gse.station.frame_columns import Columns
from gse.station.results import AnswerCheck
from gse.station.session_data import SessionData
from gse.statistics.counted_frames import CountedFrames
from gse.statistics.uncertainty import TO_STANDARD
from gse.truth import EarthOrientation, SiderealTruth, horizon_to_sensor, mount_of, small_rotations
from gse.truth.orientation import FIRST_NS
from gse.values.attitude import Attitude, solve_attitude
from gse.values.camera import Camera
from gse.values.constants import ARCSEC_PER_RAD, ARCSEC_RAD, EARTH_RADIUS_M, EARTH_RATE_RAD_PER_S
from gse.values.instant import NS_PER_DAY, NS_PER_S, to_text
from gse.values.matrices import length, lstsq, product
from gse.values.mount import Mount
from gse.values.site import Site
from gse.values.star_influence import boresight_shifts

# Hypotheses of gross mistakes: one sign, order, quarter turn or time zone that is wrong in site, mount or clock.

SIDEREAL_DAY_S = 86_164.0905
_YEAR_WITHIN_S = 30.0
"""Precession of a year turns the sky near the pole by as much about it: whether a date fits is tried all the same."""
_MOST_CLOCK_S = 25.5 * 3600
_NEAR_S, _VERY_NEAR_S = 60.0, 4.0
"""How near to a whole number of hours a clock must be, for those that are usual and for others: of so many others one
is near to anything."""
_HALF_HOURS = (-9.5, -3.5, -2.5, 3.5, 4.5, 5.5, 6.5, 9.5, 10.5)
_QUARTER_HOURS = (5.75, 8.75, 12.75)
_USUAL_HOURS = (*range(-12, 15), *_HALF_HOURS, *_QUARTER_HOURS, -24, 24)
"""Time zones from UTC, those of summer too, and whole days."""
CORRECT = "correct the station file, then judge the same recording again: gse report SESSION --station FILE"
SET_CLOCK = "set the host's clock to UTC (timedatectl set-ntp true), see it with gse preflight, and repeat the session"


@dataclass(frozen=True, slots=True)
class GrossHypothesis:
    """One thing wrong: the site, the mount and the fast clock that would explain what is seen."""

    cause: str
    size: str
    next_step: str
    site: Site
    mount: Mount
    clock_s: float = 0.0


def of_site(site: Site, mount: Mount) -> Iterator[GrossHypothesis]:
    """Signs and order of latitude and longitude; none that no station file can state."""
    latitude, longitude = site.latitude_deg, site.longitude_deg
    north, east = f"site.latitude_deg: {-latitude:g}", f"site.longitude_deg: {-longitude:g}"

    def of(cause: str, remedy: str, **changes: Any) -> GrossHypothesis:
        return GrossHypothesis(cause, f"the stars fit {remedy}", CORRECT, replace(site, **changes), mount)

    if longitude <= 180:
        yield of("longitude sign", east, longitude_deg=-longitude)
    yield of("latitude sign", north, latitude_deg=-latitude)
    if longitude <= 180:
        yield of(
            "latitude and longitude signs", f"{north} and {east}", latitude_deg=-latitude, longitude_deg=-longitude
        )
    if abs(longitude) <= 90:
        swapped = f"site.latitude_deg: {longitude:g} and site.longitude_deg: {latitude:g}"
        yield of("latitude and longitude exchanged", swapped, latitude_deg=longitude, longitude_deg=latitude)


def of_mount(site: Site, mount: Mount) -> Iterator[GrossHypothesis]:
    """Quarter turns, signs and other ways to count azimuth, altitude and roll."""
    azimuth, altitude, roll = mount.azimuth_deg, mount.altitude_deg, mount.roll_deg
    tried = (
        ("azimuth from south", "azimuth", azimuth + 180),
        ("azimuth off by 90 deg", "azimuth", azimuth + 90),
        ("azimuth off by 90 deg", "azimuth", azimuth - 90),
        ("azimuth counted westwards", "azimuth", -azimuth),
        ("wrong hemisphere of the mount", "azimuth", 180 - azimuth),
        ("zenith distance for altitude", "altitude", 90 - altitude),
        ("altitude sign", "altitude", -altitude),
        ("roll off by 90 deg", "roll", roll + 90),
        ("roll off by 180 deg", "roll", roll + 180),
        ("roll off by 90 deg", "roll", roll - 90),
        ("roll sign", "roll", -roll),
    )
    for cause, name, value in tried:
        angle = value if name == "altitude" else value % 360
        if abs(angle) <= (90 if name == "altitude" else 360):
            size = f"the stars fit mount.{name}_deg: {angle:g}"
            changed: dict[str, Any] = {f"{name}_deg": angle}
            yield GrossHypothesis(cause, size, CORRECT, site, replace(mount, **changed))
    if azimuth % 360 <= 90 and altitude >= 0:
        size = f"the stars fit mount.azimuth_deg: {altitude:g} and mount.altitude_deg: {azimuth % 360:g}"
        exchanged = replace(mount, azimuth_deg=altitude, altitude_deg=azimuth % 360)
        yield GrossHypothesis("azimuth and altitude exchanged", size, CORRECT, site, exchanged)


def of_clock(stated: GrossHypothesis, fast_s: float) -> Iterator[GrossHypothesis]:
    """Whole hours, time zones and days, of those that turn the sky by what is seen about the pole."""
    for fast in (fast_s + days * SIDEREAL_DAY_S for days in (-1, 0, 1)):
        hours = _nearest_zone(fast / 3600)
        near_s = _NEAR_S if hours in _USUAL_HOURS else _VERY_NEAR_S
        if hours and abs(fast - 3600 * hours) < near_s and abs(fast) < _MOST_CLOCK_S:
            cause, size = _clock_words(hours)
            yield replace(stated, cause=cause, size=size, next_step=SET_CLOCK, clock_s=3600.0 * hours)
    yield from of_date(stated, fast_s, DATE_S)


def of_date(stated: GrossHypothesis, fast_s: float, within_s: float) -> Iterator[GrossHypothesis]:
    """Dates, up to a year, that turn the sky by what is seen about the pole, within so many seconds."""
    for days in (*range(-366, -1), *range(2, 367)):
        turned_s = 86_400 * days - SIDEREAL_DAY_S * round((86_400 * days - fast_s) / SIDEREAL_DAY_S)
        is_year = abs(days) >= 365
        if abs(turned_s - fast_s) < (max(within_s, _YEAR_WITHIN_S) if is_year else within_s):
            size = f"the host's date is {abs(days)} days {'ahead of' if days > 0 else 'behind'} UTC"
            dated = replace(stated, size=size, next_step=SET_CLOCK, clock_s=86_400.0 * days)
            yield replace(dated, cause="date off by a year") if is_year else replace(dated, cause="date off by days")


def _nearest_zone(hours: float) -> float:
    return min((round(2 * hours) / 2, *_QUARTER_HOURS), key=lambda zone: abs(zone - hours))


def _clock_words(hours: float) -> tuple[str, str]:
    way = "ahead of" if hours > 0 else "behind"
    if abs(hours) == 24:
        return "clock off by a day", f"the host's date is one day {way} UTC"
    size = f"the host's clock is {abs(hours):g} h {way} UTC"
    if -12 <= hours <= 14:
        minutes = round(60 * abs(hours))
        zone = f"UTC{'+' if hours > 0 else '-'}{minutes // 60}" + (f":{minutes % 60}" if minutes % 60 else "")
        return "clock set to local time", f"{size}, as the local time of the zone {zone} is"
    return "clock off by hours", size


# Raw attitudes: what a sensor sees of the catalogue's sky, before site, clock and mount are asked.

_FRAMES = 15


@dataclass(frozen=True, slots=True, eq=False)
class RawAttitudes:
    """Attitudes as a sensor sees them, icrs_to_sensor (M, 3, 3) of catalogue places, at instants (M,) of the host.

    ``field_sensor`` (N, 3) are directions over the field of its camera.
    """

    utc_ns: NDArray[np.int64]
    icrs_to_sensor: NDArray[np.float64]
    field_sensor: NDArray[np.float64]

    def some(self, mask: NDArray[np.bool_]) -> "RawAttitudes":
        """First, middle and last of the masked (M,)."""
        return self.taken(np.flatnonzero(mask)[[0, int(mask.sum()) // 2, -1]])

    def taken(self, rows: NDArray[np.int64]) -> "RawAttitudes":
        """Some of them."""
        return RawAttitudes(self.utc_ns[rows], self.icrs_to_sensor[rows], self.field_sensor)

    @classmethod
    def from_frames(cls, frames: Columns, answered: NDArray[np.int64], camera: Camera) -> "RawAttitudes":
        """From frames (rows of FRAME) of which these rows are answered, evenly spaced over them."""
        rows = answered[np.unique(np.linspace(0, len(answered) - 1, min(len(answered), _FRAMES)).astype(np.int64))]
        angles = np.column_stack([frames[name][rows] for name in ("ra_deg", "de_deg", "roll_deg")]).tolist()
        rotations = np.array([Attitude.from_angles(*of_one).icrs_to_sensor for of_one in angles])
        x, y = 0.7 * np.array([camera.columns, camera.rows]) / (2 * camera.focal_length_px)
        field = np.array([[0, 0, 1.0], [x, y, 1.0], [-x, y, 1.0], [x, -y, 1.0], [-x, -y, 1.0]])
        return cls(frames["utc_ns"][rows], rotations, field / np.linalg.norm(field, axis=1)[:, None])


def mount_under(raw: RawAttitudes, under: GrossHypothesis, orientation: EarthOrientation) -> NDArray[np.float64]:
    """The measured directions of the mount (M, 3, 3), corrected as a hypothesis has it."""
    truth = SiderealTruth(under.site, orientation)
    rotations = []
    for stamp_ns, icrs_to_sensor in zip(raw.utc_ns.tolist(), raw.icrs_to_sensor, strict=True):
        utc_ns = stamp_ns - round(under.clock_s * NS_PER_S)
        to_horizon = truth.icrs_to_horizon(utc_ns)
        straight = truth.unrefracted(raw.field_sensor, product(icrs_to_sensor, to_horizon[2]))
        apparent = truth.apparent(product(raw.field_sensor, icrs_to_sensor), utc_ns)
        rotations.append(product(solve_attitude(straight, apparent, 1e-4).icrs_to_sensor, to_horizon.T))
    return np.array(rotations)


def errors_arcsec(measured: NDArray[np.float64], true: NDArray[np.float64]) -> NDArray[np.float64]:
    """Errors (M, 3) of rotations along columns, along rows, and of roll."""
    return boresight_shifts(small_rotations(measured, true)) * ARCSEC_PER_RAD


def central(rotations: NDArray[np.float64]) -> int:
    """The rotation that is nearest to half of the others: no false answer."""
    distance2 = ((rotations[:, None] - rotations[None]) ** 2).sum(axis=(2, 3))
    return int(np.median(distance2, axis=1).argmin())


# The turn of a set-up that no single mistake explains: about which axis, by how much, or seen from where.

DATE_S = 4.0
"""A date that is off by days moves the stars by aberration and precession too, by 40 arcsec at most in half a year."""
_NEXT_DATE_S = 120.0
"""Far from the equator these 40 arcsec are a minute and more about the pole, of the 237 s from one date to the next."""
_SITE_ROUNDS, _SITE_STEP_DEG, _MOST_LATITUDE_DEG = 6, 0.01, 89.9
_CHECK_MOUNT = "check the angles of the mount, then: gse align SESSION --accept-gross --write FILE"


def _about_one_axis(
    raw: RawAttitudes, stated: GrossHypothesis, orientation: EarthOrientation, noise_arcsec: NDArray[np.float64]
) -> list[GrossHypothesis]:
    """What is wrong by any amount, each alone: the clock, an angle of the mount, the latitude."""
    site, mount = stated.site, stated.mount

    def of_clock(fast_s: float, under: GrossHypothesis) -> GrossHypothesis:
        return replace(under, clock_s=under.clock_s + fast_s / EARTH_RATE_RAD_PER_S)

    def of_angle(name: str) -> _Moved:
        sign = -1 if name == "altitude" else 1

        def moved(angle: float, under: GrossHypothesis) -> GrossHypothesis:
            value = getattr(under.mount, f"{name}_deg") + sign * math.degrees(angle)
            # Noise alone takes a fit of a mount at the zenith beyond it; what is really beyond fits nothing at 90 deg.
            in_range = min(max(value, -90.0), 90.0) if name == "altitude" else value % 360
            changed: dict[str, Any] = {f"{name}_deg": in_range}
            return replace(under, mount=replace(under.mount, **changed))

        return moved

    def of_latitude(angle: float, under: GrossHypothesis) -> GrossHypothesis:
        north_deg = math.degrees(angle)
        return (
            _moved(under, north_deg, 0.0) if abs(under.site.latitude_deg + north_deg) <= _MOST_LATITUDE_DEG else under
        )

    axes: tuple[tuple[str, NDArray[np.float64], _Moved], ...] = (
        ("clock", pole(site), of_clock),
        ("azimuth", VERTICAL, of_angle("azimuth")),
        ("altitude", level_axis(mount), of_angle("altitude")),
        ("roll", horizon_to_sensor(mount)[2], of_angle("roll")),
        ("latitude", EAST, of_latitude),
    )
    found = []
    for name, axis, moved in axes:
        under = stated
        for _ in range(2):  # refraction is taken off about the right zenith only once that is known
            measured, stand = mount_under(raw, under, orientation)[0], horizon_to_sensor(under.mount)
            turn = product(stand.T, measured)
            rough, _ = about(axis, turn)
            covariance = product(stand.T, np.diag(np.square(noise_arcsec)), stand)
            ((rest,), _) = taken_out(product(turn, erfa.rv2m(rough * axis)), [axis], covariance)
            under = moved(rough + rest, under)
        found.append(replace(under, cause=name))
    return found


_Moved = Callable[[float, GrossHypothesis], GrossHypothesis]


def _in_words(one: GrossHypothesis, stated: GrossHypothesis) -> Finding:
    """One of the hypotheses of any amount as a finding."""
    if one.cause == "clock":
        return _about_the_pole(one.clock_s, stated.site)
    if one.cause == "latitude":
        return _of_latitude(stated.site, one.site.latitude_deg)
    return _of_angle(one.cause, stated.mount, one.mount)


def _no_single(raw: RawAttitudes, stated: GrossHypothesis, orientation: EarthOrientation) -> Finding:
    """A mount that looks elsewhere, which no single mistake explains."""
    mount = stated.mount
    turn = product(horizon_to_sensor(mount).T, mount_under(raw, stated, orientation)[0])
    fitted = mount_of(product(horizon_to_sensor(mount), turn))
    return Finding(
        "mount",
        f"it looks {angle_text(math.degrees(size_rad(turn)))} from where the station file says: the stars fit azimuth "
        f"{fitted.azimuth_deg:.2f}, altitude {fitted.altitude_deg:.2f}, roll {fitted.roll_deg:.2f} deg, stated are "
        f"{mount.azimuth_deg:g}, {mount.altitude_deg:g}, {mount.roll_deg:g} deg; no single mistake explains it",
        ("two mistakes at once of site, clock and mount",),
        _CHECK_MOUNT,
        is_gross=True,
    )


def _elsewhere(raw: RawAttitudes, stated: GrossHypothesis, orientation: EarthOrientation) -> GrossHypothesis:
    """Another latitude and longitude, by Newton's steps from the stated ones."""
    at = stated

    def off_rad(under: GrossHypothesis) -> NDArray[np.float64]:
        turns = small_rotations(mount_under(raw, under, orientation), horizon_to_sensor(under.mount))
        return np.asarray(turns.mean(axis=0))

    for _ in range(_SITE_ROUNDS):
        off = off_rad(at)
        slopes = [
            (off_rad(_moved(at, *step)) - off) / _SITE_STEP_DEG
            for step in ((_SITE_STEP_DEG, 0.0), (0.0, _SITE_STEP_DEG))
        ]
        step_deg = lstsq(np.column_stack(slopes), -off)
        if abs(at.site.latitude_deg + float(step_deg[0])) > _MOST_LATITUDE_DEG:
            break
        at = _moved(at, *step_deg.tolist())
    size = f"the stars fit site.latitude_deg: {at.site.latitude_deg:.3f} and longitude_deg: {at.site.longitude_deg:.3f}"
    size += f", stated are {stated.site.latitude_deg:g} and {stated.site.longitude_deg:g}"
    return replace(at, cause="site", size=size, next_step=CORRECT)


def _moved(under: GrossHypothesis, north_deg: float, east_deg: float) -> GrossHypothesis:
    site = under.site
    longitude_deg = (site.longitude_deg + east_deg + 180) % 360 - 180
    return replace(under, site=replace(site, latitude_deg=site.latitude_deg + north_deg, longitude_deg=longitude_deg))


def _about_the_pole(fast_s: float, site: Site) -> Finding:
    size = f"the host's clock is {_duration(abs(fast_s))} {'fast' if fast_s > 0 else 'slow'}"
    fits_deg = (site.longitude_deg - math.degrees(fast_s * EARTH_RATE_RAD_PER_S) + 180) % 360 - 180
    longitude = f"longitude (the stars fit site.longitude_deg: {fits_deg:.4f})"
    equals = (longitude, "a mount turned about the pole", *wrong_dates(fast_s))
    return Finding("clock offset", size, equals, SET_CLOCK, is_gross=True)


def wrong_dates(fast_s: float) -> Iterator[str]:
    """Whole days, up to a year, by which a date turns the sky as so fast a clock does."""
    for days in range(2, 367):
        for off in (days, -days):
            turned_s = 86_400 * off - SIDEREAL_DAY_S * round((86_400 * off - fast_s) / SIDEREAL_DAY_S)
            if abs(turned_s - fast_s) < DATE_S:
                yield f"a date that is {days} days {'ahead' if off > 0 else 'behind'}"


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    return f"{seconds:.2f} s" if seconds < 60 else f"{minutes // 60} h {minutes % 60} min {rest} s"


def _of_angle(name: str, mount: Mount, fitted: Mount) -> Finding:
    fits = getattr(fitted, f"{name}_deg")
    off_deg = (fits - getattr(mount, f"{name}_deg") + 180) % 360 - 180
    size = f"its {name} is off by {off_deg:+.3f} deg: the stars fit mount.{name}_deg: {fits:.3f}"
    return Finding("mount", size, (), _CHECK_MOUNT, is_gross=True)


def _of_latitude(site: Site, fits_deg: float) -> Finding:
    size = f"the stars fit site.latitude_deg: {fits_deg:.3f}, stated is {site.latitude_deg:g}"
    return Finding("latitude", size, (), CORRECT, is_gross=True)


def angle_text(angle_deg: float) -> str:
    """Degrees, or arcseconds of a small angle."""
    return f"{angle_deg:.2f} deg" if angle_deg >= 0.1 else f"{angle_deg * 3600:.0f} arcsec"


GROSS_DEG = 0.3
"""Smaller errors are left to gse.diagnosis.fine_causes, but for an exact hit: a mount set by hand is off by as much."""
_SURE_CHI_SQUARE = 225.0
"""Fifteen standard deviations: less is hit exactly by chance, now and then."""
_MOST_CHI_SQUARE = 11.34
"""Of three angles that are left, by noise alone in one session of a hundred."""
_MOST_WORSE = 6.63
"""By how much chi-square of one angle that is free is less, in one session of a hundred in which it is nothing."""
_NEAR_SHARE, _NEAR_ARCSEC = 0.05, 20.0
"""What explains nearly all is named, too, with what it leaves: a third of the usual limit at most."""
MOVED_SHARE = 0.2
"""Of the turn of the ground: what sees the sky move by less follows it."""
_STARS_ARCSEC, _TIMES_ROLL = 1.0, 10.0
"""What the places of stars leave of the boresight, and how much worse they tell the roll."""
_MAJORITY = 0.6
"""Least share of the frames that must agree; false answers are few."""
_STEADY_DEG = 0.2
"""A mount that is fixed on the ground, though wrongly described, holds still within this."""


@dataclass(frozen=True, slots=True, eq=False)
class GrossCause:
    """A finding; ``is_exact`` where one mistake of the list explains it, and what that leaves is noise."""

    finding: Finding
    is_exact: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class _Tried:
    """A hypothesis with what it leaves: columns, rows, roll, in arcsec, and in its noise."""

    under: GrossHypothesis
    left_arcsec: NDArray[np.float64]
    chi_square: float

    @property
    def is_exact(self) -> bool:
        return self.chi_square < _MOST_CHI_SQUARE

    @property
    def left_deg(self) -> float:
        return length(self.left_arcsec) / 3600

    def is_near(self, error_deg: float) -> bool:
        """Whether what it leaves is little of the error, and little of a limit."""
        across = length(self.left_arcsec[:2]) < _NEAR_ARCSEC
        return across and self.left_deg < min(_NEAR_SHARE * error_deg, _TIMES_ROLL * _NEAR_ARCSEC / 3600)


def gross_cause(raw: RawAttitudes, site: Site, mount: Mount, orientation: EarthOrientation) -> GrossCause | None:
    """The gross cause of a session on a stated site and mount; None where nothing is gross."""
    stated = GrossHypothesis("", "", "", site, mount)
    measured = mount_under(raw, stated, orientation)
    apart_deg = np.degrees(np.linalg.norm(small_rotations(measured, measured[central(measured)]), axis=1))
    steady = apart_deg < _STEADY_DEG
    if (finding := _time_unit(raw, mount, site)) or (finding := _two_pointings(raw, measured, steady)):
        return GrossCause(finding)
    if steady.mean() < _MAJORITY:
        return _follows_the_sky(raw, float(apart_deg.max()))
    noise_arcsec = _noise_arcsec(measured[steady], site, mount)
    raw = raw.some(steady)

    def tried(under: GrossHypothesis) -> _Tried:
        left = errors_arcsec(mount_under(raw, under, orientation), horizon_to_sensor(under.mount)).mean(axis=0)
        return _Tried(under, left, float(np.square(left / noise_arcsec).sum()))

    as_stated = tried(stated)
    if (error_deg := as_stated.left_deg) < GROSS_DEG and as_stated.chi_square < _SURE_CHI_SQUARE:
        return None
    of_one_axis = [tried(one) for one in _about_one_axis(raw, stated, orientation, noise_arcsec)]
    fast_s = of_one_axis[0].under.clock_s
    of_list = [tried(one) for one in (*of_site(site, mount), *of_mount(site, mount), *of_clock(stated, fast_s))]
    best_of_any_amount = min(one.chi_square for one in of_one_axis)

    def exact_among(hypotheses: Iterable[_Tried]) -> list[_Tried]:
        return [one for one in hypotheses if one.is_exact and one.chi_square < best_of_any_amount + _MOST_WORSE]

    dates = (tried(one) for one in of_date(stated, fast_s, _NEXT_DATE_S))
    if exact := exact_among(of_list) or exact_among(dates):
        found = _of_the_list(exact, error_deg)
        turns = [_in_words(one.under, stated) for one in of_one_axis if one.is_exact]
        return GrossCause(_beside_turns(found, turns) if found.cause.startswith("date off") else found, is_exact=True)
    if error_deg < GROSS_DEG:
        return None
    if exact := [one for one in of_one_axis if one.is_exact]:
        found, *others = (_in_words(one.under, stated) for one in exact)
        return GrossCause(replace(found, equals=(*found.equals, *(f"{one.cause} ({one.size})" for one in others))))
    if (elsewhere := tried(_elsewhere(raw, stated, orientation))).is_exact:
        of = elsewhere.under
        return GrossCause(Finding(of.cause, of.size, ("a mount whose base is not level",), of.next_step, is_gross=True))
    nearest = min((*of_list, *of_one_axis), key=lambda one: one.left_deg)
    if nearest.is_near(error_deg):
        if nearest in of_list:
            return GrossCause(_of_the_list([nearest], error_deg))
        found = _in_words(nearest.under, stated)
        return GrossCause(replace(found, size=f"{found.size}; all but {angle_text(nearest.left_deg)}"))
    rough = min(of_list, key=lambda one: one.left_deg)
    if rough.left_deg < min(_NEAR_SHARE * error_deg, GROSS_DEG):
        return GrossCause(_of_the_list([rough], error_deg))
    return GrossCause(_no_single(raw, stated, orientation))


def _of_the_list(equal: list[_Tried], error_deg: float) -> Finding:
    """The first of mistakes that explain as much, with the others."""
    best, *others = equal
    return Finding(
        best.under.cause,
        f"{best.under.size}; that explains {angle_text(error_deg)}, all but {angle_text(best.left_deg)}",
        tuple(f"{one.under.cause} ({one.under.size})" for one in others),
        best.under.next_step,
        is_gross=True,
    )


def _beside_turns(date: Finding, turns: list[Finding]) -> Finding:
    """A date beside what turns the sky as much, where aberration and precession do not tell them apart."""
    equals = [f"{one.cause} ({one.size})" for one in turns]
    equals += [equal for one in turns for equal in one.equals if not equal.startswith("a date ")]
    return replace(date, equals=(*date.equals, *equals))


def _noise_arcsec(measured: NDArray[np.float64], site: Site, mount: Mount) -> NDArray[np.float64]:
    """Standard deviations (3,) of what the right hypothesis leaves: of three frames, stars, and what is stated."""
    off = errors_arcsec(measured, measured[central(measured)])
    scatter = off.std(axis=0) / math.sqrt(min(len(off), 3))
    position_arcsec = site.uncertainty.position_m / (EARTH_RADIUS_M * ARCSEC_RAD)
    known = mount.uncertainty
    stated = math.hypot(known.azimuth_arcsec, known.altitude_arcsec, site.uncertainty.vertical_arcsec, position_arcsec)
    across, roll = (
        math.hypot(TO_STANDARD * stated, _STARS_ARCSEC),
        math.hypot(TO_STANDARD * math.hypot(known.roll_arcsec, known.azimuth_arcsec), _TIMES_ROLL * _STARS_ARCSEC),
    )
    return np.asarray(np.hypot(scatter, [across, across, roll]))


def _two_pointings(raw: RawAttitudes, measured: NDArray[np.float64], steady: NDArray[np.bool_]) -> Finding | None:
    """Two directions that both hold still: sensors that share a line, or a mount that was moved once."""
    rest = np.flatnonzero(~steady)
    fewest = max(_SECOND_SHARE * len(steady), _FEWEST_SECOND)
    if len(rest) < fewest:
        return None
    others = measured[rest]
    middle = others[central(others)]
    apart_deg = np.degrees(np.linalg.norm(small_rotations(others, middle), axis=1))
    is_second = np.zeros(len(steady), dtype=bool)
    is_second[rest[apart_deg < _STEADY_DEG]] = True
    known = steady | is_second
    if is_second.sum() < fewest or known.sum() < _BOTH_SHARE * len(steady):
        return None
    first = measured[central(measured)]
    (turn,) = small_rotations(middle[None], first)
    of_first, of_second = (small_rotations(measured[part], one) for part, one in ((steady, first), (is_second, middle)))
    moved = np.median(np.linalg.norm(np.concatenate([of_first, of_second]), axis=1))
    if moved > _MOVING_SHARE * length(turn):  # a mount that turns steadily is near to two of its directions
        return None
    between = f"{angle_text(math.degrees(length(turn)))} apart"
    changes = np.flatnonzero(np.diff(is_second[known]))
    if len(changes) == 1:
        when = to_text(int(raw.utc_ns[known][changes[0] + 1]), 0)
        return Finding(
            "slip of the mount",
            f"before {when} it was turned to another direction, {between}, and stays there",
            ("another sensor from then on",),
            "judge each part by itself: gse session trim SESSION cuts it",
            is_gross=True,
        )
    return Finding(
        "two pointings",
        f"the answers show the sky from two directions that both hold still, {between}, and alternate between them",
        ("two sensors whose frames are in one recording", "a mount that is switched to and fro"),
        "record one sensor at a time; gse decode SESSION --explain shows whose frames they are",
        is_gross=True,
    )


def _time_unit(raw: RawAttitudes, mount: Mount, site: Site) -> Finding | None:
    """A sky that turns a thousand times as fast, or as slowly, as the times of the frames say."""
    seconds = np.diff(raw.utc_ns) / NS_PER_S
    boresight = horizon_to_sensor(mount)[2]
    across = length(np.cross(pole(site), boresight))
    stated = EARTH_RATE_RAD_PER_S * across * seconds
    seen = np.linalg.norm(np.diff(raw.icrs_to_sensor[:, 2], axis=0), axis=1)
    useful = seconds > 0
    if useful.sum() < _FEWEST_STEPS or across < _LEAST_ACROSS:
        return None
    # A sky that turns goes one way; directions that come and go do not.
    boresights = raw.icrs_to_sensor[:, 2]
    turned, crossed = float(np.linalg.norm(boresights - boresights[0], axis=1).max()), float(seen.sum())
    if turned < _ONE_WAY * min(crossed, 1.0) or float(np.median(seen)) > _MOST_TURN_RAD:
        return None
    power = math.log10(max(float(np.median(seen[useful] / stated[useful])), _TINY)) / 3
    times = round(power)
    if times == 0 or abs(power - times) > _POWER_WITHIN or abs(times) > 3:
        return None
    steps = seen[useful] / (1000.0**times * stated[useful])
    if float(np.median(np.abs(steps - 1))) > _STEPS_WITHIN:
        return None
    return Finding(
        "time tags in another unit",
        f"the sky turns {['1,000,000,000', '1,000,000', '1,000'][3 - abs(times)]} times as "
        f"{'fast' if times > 0 else 'slowly'} as the time tags say: they count {'larger' if times > 0 else 'smaller'} "
        "units than the protocol description has",
        (),
        "correct the unit of time in the protocol description (docs/protocols.md), and read the recording again",
        is_gross=True,
    )


_SECOND_SHARE, _FEWEST_SECOND, _BOTH_SHARE = 0.2, 3, 0.85
"""Least share of the frames that look elsewhere, and of those that look to one of the two: the others are false."""
_MOVING_SHARE = 0.1
"""Of the turn between two directions: what holds still lies about each within this; of a ramp, a quarter as far."""
_FEWEST_STEPS = 5
_POWER_WITHIN, _STEPS_WITHIN = 0.05, 0.4
"""Of a thousand, to a third of it; steps from frame to frame have the noise of the boresight."""
_LEAST_ACROSS, _TINY = 0.1, 1e-12
_ONE_WAY, _MOST_TURN_RAD = 0.5, 0.5
"""Between two of the frames that are looked at, a fifteenth of the session, the sky turns by 0.4 rad in a whole day."""


def _follows_the_sky(raw: RawAttitudes, apart_deg: float) -> GrossCause | None:
    """A mount that is driven, or answers that stand still; any other move is left to gse.diagnosis.fine_causes."""
    at = central(raw.icrs_to_sensor)
    on_sky = np.degrees(np.linalg.norm(small_rotations(raw.icrs_to_sensor, raw.icrs_to_sensor[at]), axis=1))
    if float(np.median(on_sky)) > MOVED_SHARE * apart_deg:
        return None
    return GrossCause(follows_the_sky(apart_deg))


def follows_the_sky(apart_deg: float) -> Finding:
    """That the ground turned by so much while the same stars were seen."""
    return Finding(
        "mount follows the sky",
        f"the sensor sees the same stars all the time, while the ground turned by {angle_text(apart_deg)}",
        ("answers of the sensor that stand still",),
        "stop the drive of the mount: a test needs a mount that is fixed to the ground",
        is_gross=True,
    )


# The gross cause of a session: its answers against the stated site, mount and clock.

_TURNED_BACK_NS = 2 * NS_PER_DAY
"""More than any mistake that is tried turns the clock back by."""


def gross_finding(session: SessionData, counted: CountedFrames) -> Finding | None:
    """The mistake of the set-up, against the stated angles of the mount, whether or not a fit replaced them."""
    cause = gross_cause_of(session, counted)
    return cause.finding if cause else None


def gross_cause_of(session: SessionData, counted: CountedFrames) -> GrossCause | None:
    """The same with whether it is exact."""
    mount, orientation = session.station.mount, session.earth_orientation
    raw = _raw_attitudes(session, counted)
    if raw is None or orientation is None:
        return None
    return gross_cause(raw, session.station.site, mount, orientation)


def _raw_attitudes(session: SessionData, counted: CountedFrames) -> RawAttitudes | None:
    """Of some answers on a stated mount that is fixed to the ground."""
    mount = session.station.mount
    frames = session.frames.columns
    checked_false = frames["answer_check"] == ANSWER_CHECKS.index(AnswerCheck.FALSE)
    has_roll = np.isfinite(frames["roll_deg"])  # an external identifier may answer RA and DE alone
    has_truth = frames["utc_ns"] >= FIRST_NS + _TURNED_BACK_NS
    rows = np.flatnonzero(counted.answered & ~checked_false & ~counted.excluded & has_roll & has_truth)
    if not mount.stated or mount.inertial is not None or not len(rows):
        return None
    return RawAttitudes.from_frames(frames, rows, session.station.sensor.camera())
