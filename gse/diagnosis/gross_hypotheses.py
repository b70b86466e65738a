"""Hypotheses of gross mistakes: one sign, order, quarter turn or time zone that is wrong in site, mount or clock."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

from gse.mount import Mount
from gse.site import Site

SAME_DEG = 0.02
"""Hypotheses whose remaining errors differ by less than an arcminute are equals."""
SIDEREAL_DAY_S = 86_164.0905
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
class Hypothesis:
    """One thing wrong: the site, the mount and the fast clock that would explain what is seen."""

    cause: str
    size: str
    next_step: str
    site: Site
    mount: Mount
    clock_s: float = 0.0


def of_site(site: Site, mount: Mount) -> Iterator[Hypothesis]:
    """Signs and order of latitude and longitude; none that no station file can state."""
    latitude, longitude = site.latitude_deg, site.longitude_deg
    north, east = f"site.latitude_deg: {-latitude:g}", f"site.longitude_deg: {-longitude:g}"

    def of(cause: str, remedy: str, **changes: Any) -> Hypothesis:
        return Hypothesis(cause, f"the stars fit {remedy}", CORRECT, replace(site, **changes), mount)

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


def of_mount(site: Site, mount: Mount) -> Iterator[Hypothesis]:
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
            yield Hypothesis(cause, size, CORRECT, site, replace(mount, **changed))
    if azimuth % 360 <= 90 and altitude >= 0:
        size = f"the stars fit mount.azimuth_deg: {altitude:g} and mount.altitude_deg: {azimuth % 360:g}"
        exchanged = replace(mount, azimuth_deg=altitude, altitude_deg=azimuth % 360)
        yield Hypothesis("azimuth and altitude exchanged", size, CORRECT, site, exchanged)


def of_clock(stated: Hypothesis, fast_s: float) -> Iterator[Hypothesis]:
    """Whole hours, time zones and days, of those that turn the sky by what is seen about the pole."""
    for fast in (fast_s + days * SIDEREAL_DAY_S for days in (-1, 0, 1)):
        hours = _nearest_zone(fast / 3600)
        near_s = _NEAR_S if hours in _USUAL_HOURS else _VERY_NEAR_S
        if hours and abs(fast - 3600 * hours) < near_s and abs(fast) < _MOST_CLOCK_S:
            cause, size = _clock_words(hours)
            yield replace(stated, cause=cause, size=size, next_step=SET_CLOCK, clock_s=3600.0 * hours)


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
