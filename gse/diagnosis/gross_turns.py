"""The turn of a set-up that no single mistake explains: about which axis, by how much, or seen from where."""

import math
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gse.constants import EARTH_RATE_RAD_PER_S
from gse.diagnosis.gross_hypotheses import CORRECT, SAME_DEG, SET_CLOCK, SIDEREAL_DAY_S, Hypothesis
from gse.diagnosis.raw_attitudes import RawAttitudes, mount_under
from gse.diagnosis.turns import EAST, VERTICAL, about, level_axis, pole, size_rad
from gse.finding import Finding
from gse.matrices import length, lstsq, product
from gse.mount import Mount
from gse.site import Site
from gse.truth import EarthOrientation, horizon_to_sensor, mount_of, small_rotations

DATE_S = 4.0
"""A date that is off by days moves the stars by aberration and precession too, by 40 arcsec at most in half a year."""
_AXIS_SHARE = 0.05
_SITE_ROUNDS, _SITE_STEP_DEG, _MOST_LATITUDE_DEG = 6, 0.01, 89.9
_CHECK_MOUNT = "check the angles of the mount, then: gse align SESSION --accept-gross --write FILE"


def turned(raw: RawAttitudes, stated: Hypothesis, turn: NDArray[np.float64], orientation: EarthOrientation) -> Finding:
    """The turn about one axis that explains most, or a mount that looks elsewhere."""
    site, mount = stated.site, stated.mount
    axes: tuple[tuple[NDArray[np.float64], Callable[[float], Finding]], ...] = (
        (pole(site), lambda angle: _about_the_pole(refined_s(raw, stated, angle, orientation), site)),
        (VERTICAL, lambda angle: _of_angle("azimuth", angle, mount)),
        (level_axis(mount), lambda angle: _of_angle("altitude", angle, mount)),
        (horizon_to_sensor(mount)[2], lambda angle: _of_angle("roll", angle, mount)),
        (EAST, lambda angle: _of_latitude(site, angle)),
    )
    error_deg = math.degrees(size_rad(turn))
    fits = [(*about(axis, turn), said) for axis, said in axes]
    good = [(angle, said) for angle, left, said in fits if math.degrees(left) < max(_AXIS_SHARE * error_deg, SAME_DEG)]
    if good:
        found, *others = (said(angle) for angle, said in good)
        return replace(found, equals=(*found.equals, *(f"{one.cause} ({one.size})" for one in others)))
    if elsewhere := _elsewhere(raw, stated, orientation):
        return elsewhere
    fitted = mount_of(product(horizon_to_sensor(mount), turn))
    return Finding(
        "mount",
        f"it looks {angle_text(error_deg)} from where the station file says: the stars fit azimuth "
        f"{fitted.azimuth_deg:.2f}, altitude {fitted.altitude_deg:.2f}, roll {fitted.roll_deg:.2f} deg, stated are "
        f"{mount.azimuth_deg:g}, {mount.altitude_deg:g}, {mount.roll_deg:g} deg; no single mistake explains it",
        ("two mistakes at once of site, clock and mount",),
        _CHECK_MOUNT,
        is_gross=True,
    )


def _elsewhere(raw: RawAttitudes, stated: Hypothesis, orientation: EarthOrientation) -> Finding | None:
    """Another latitude and longitude, where they explain all three angles: by Newton's steps from the stated ones."""
    at = stated

    def off_rad(under: Hypothesis) -> NDArray[np.float64]:
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
            return None
        at = _moved(at, *step_deg.tolist())
    if math.degrees(length(off_rad(at))) > SAME_DEG:
        return None
    size = f"the stars fit site.latitude_deg: {at.site.latitude_deg:.3f} and longitude_deg: {at.site.longitude_deg:.3f}"
    size += f", stated are {stated.site.latitude_deg:g} and {stated.site.longitude_deg:g}"
    return Finding("site", size, ("a mount whose base is not level",), CORRECT, is_gross=True)


def _moved(under: Hypothesis, north_deg: float, east_deg: float) -> Hypothesis:
    site = under.site
    longitude_deg = (site.longitude_deg + east_deg + 180) % 360 - 180
    return replace(under, site=replace(site, latitude_deg=site.latitude_deg + north_deg, longitude_deg=longitude_deg))


def refined_s(raw: RawAttitudes, stated: Hypothesis, angle_rad: float, orientation: EarthOrientation) -> float:
    """How fast the clock is, once refraction is taken off about the right zenith."""
    fast_s = angle_rad / EARTH_RATE_RAD_PER_S
    measured = mount_under(raw, replace(stated, clock_s=fast_s), orientation)[0]
    return (
        fast_s
        + about(pole(stated.site), product(horizon_to_sensor(stated.mount).T, measured))[0] / EARTH_RATE_RAD_PER_S
    )


def _about_the_pole(fast_s: float, site: Site) -> Finding:
    size = f"the host's clock is {_duration(abs(fast_s))} {'fast' if fast_s > 0 else 'slow'}"
    fits_deg = (site.longitude_deg - math.degrees(fast_s * EARTH_RATE_RAD_PER_S) + 180) % 360 - 180
    longitude = f"longitude (the stars fit site.longitude_deg: {fits_deg:.4f})"
    equals = (longitude, "a mount turned about the pole", *wrong_dates(fast_s))
    return Finding("clock offset", size, equals, SET_CLOCK, is_gross=True)


def wrong_dates(fast_s: float) -> Iterator[str]:
    """Whole days, up to a year, by which a date turns the sky as so fast a clock does."""
    for days in (*range(2, 184), 365, 366):
        for off in (days, -days):
            turned_s = 86_400 * off - SIDEREAL_DAY_S * round((86_400 * off - fast_s) / SIDEREAL_DAY_S)
            if abs(turned_s - fast_s) < DATE_S:
                yield f"a date that is {days} days {'ahead' if off > 0 else 'behind'}"


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    return f"{seconds:.2f} s" if seconds < 60 else f"{minutes // 60} h {minutes % 60} min {rest} s"


def _of_angle(name: str, turn_rad: float, mount: Mount) -> Finding:
    off_deg = math.degrees(turn_rad) * (-1 if name == "altitude" else 1)
    fits = getattr(mount, f"{name}_deg") + off_deg
    if name != "altitude":
        fits %= 360
    size = f"its {name} is off by {off_deg:+.3f} deg: the stars fit mount.{name}_deg: {fits:.3f}"
    return Finding("mount", size, (), _CHECK_MOUNT, is_gross=True)


def _of_latitude(site: Site, turn_rad: float) -> Finding:
    fits_deg = site.latitude_deg + math.degrees(turn_rad)
    size = f"the stars fit site.latitude_deg: {fits_deg:.3f}, stated is {site.latitude_deg:g}"
    return Finding("latitude", size, (), CORRECT, is_gross=True)


def angle_text(angle_deg: float) -> str:
    """Degrees, or arcseconds of a small angle."""
    return f"{angle_deg:.2f} deg" if angle_deg >= 0.1 else f"{angle_deg * 3600:.0f} arcsec"
