"""What Earth orientation, site and air leave open in the truth.

docs/uncertainty.md has the reason of each number.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial

from gse.budget.truth_sensitivity import LARGEST_STEP_ARCSEC, ChangedTruth, Vector, absolute, scaled, together
from gse.budget.uncertainty import TO_STANDARD, Distribution, Term
from gse.constants import ARCSEC_RAD
from gse.mount import Mount
from gse.site import Site
from gse.truth import EarthOrientation

_MODEL_ARCSEC = 0.0005
"""What a rigorous correction leaves: the celestial pole offsets (0.0005) and the cells of 300 s (0.0006)."""
AIR_MODEL = 0.005
"""Half-width, as a share of the refraction: stars from 0.5 to 0.7 um differ by 0.5 of 57 arcsec at 45 deg."""
_EARTH_M = 6_371_000.0
_LEAST_COS_LATITUDE = 0.01
"""Within 64 km of a pole azimuth is counted from a meridian that is chosen, not found."""


_NEWER = "pip install -U astropy-iers-data, or --earth-orientation with {} of the IERS"


def model_terms(at: ChangedTruth) -> list[Term]:
    """Corrections that are rigorous, with their size in this direction."""
    frame = [(name, at.without(name)) for name in ("precession", "nutation")]
    stars = [(name, at.star_without(name)) for name in ("annual aberration", "diurnal aberration")]
    stars.append(("light deflection", at.star_without("light deflection")))
    return [
        Term(
            name,
            _MODEL_ARCSEC,
            "arcsec",
            _MODEL_ARCSEC,
            _MODEL_ARCSEC,
            _MODEL_ARCSEC,
            evidence="B: IAU 2006/2000A by ERFA; compared with astropy and skyfield",
            explanation="corrected rigorously: what is left is the model's own error",
            remedy="nothing needs to",
            size_arcsec=size,
        )
        for name, size in (*frame, *stars)
    ]


def earth_terms(orientation: EarthOrientation, utc_ns: int, at: ChangedTruth) -> list[Term]:
    """UT1, the pole, and leap seconds where they are not announced."""
    here = orientation.at(utc_ns)
    past = here.kind == "past the end"
    ut1_s = here.ut1_error_s / math.sqrt(3) if past else here.ut1_error_s
    pole = here.pole_error_arcsec / math.sqrt(3) if past else here.pole_error_arcsec
    x, y = orientation.x_pole_arcsec, orientation.y_pole_arcsec
    moved = [
        at.changed(orientation=replace(orientation, x_pole_arcsec=tuple(value + pole for value in x))),
        at.changed(orientation=replace(orientation, y_pole_arcsec=tuple(value + pole for value in y))),
    ]
    kind = Distribution.RECTANGULAR if past else Distribution.NORMAL
    terms = [
        Term(
            "UT1",
            ut1_s,
            "s",
            *at.about_the_pole(ut1_s),
            evidence=f"B: {orientation.source}: {here.kind}",
            explanation="how far the Earth has turned; past the end of the predictions it goes wrong by 1 ms a day",
            remedy=_NEWER.format("newer files"),
            distribution=kind,
            size_arcsec=at.without("UT1"),
        ),
        Term(
            "polar motion",
            pole,
            "arcsec",
            *together(moved),
            evidence=f"B: {orientation.source}: {here.kind}",
            explanation="where the Earth's axis goes through its crust; held past the end of the predictions",
            remedy=_NEWER.format("newer files"),
            distribution=kind,
            size_arcsec=at.without("polar motion"),
        ),
    ]
    if here.leap_error_s:
        leap_s = here.leap_error_s / math.sqrt(3)
        terms.append(
            Term(
                "leap seconds",
                leap_s,
                "s",
                *at.about_the_pole(leap_s),
                evidence="B: the session is later than the list of leap seconds announces",
                explanation="UTC may have been given a leap second that is not in the list",
                remedy=_NEWER.format("a newer Leap_Second.dat"),
                distribution=Distribution.RECTANGULAR,
            )
        )
    return terms


def site_terms(site: Site, at: ChangedTruth) -> list[Term]:
    """Coordinates, height and vertical."""
    position_m, height_m = site.uncertainty.position_m * TO_STANDARD, site.uncertainty.height_m * TO_STANDARD
    step_m = LARGEST_STEP_ARCSEC * ARCSEC_RAD * _EARTH_M
    cos_latitude = max(math.cos(math.radians(site.latitude_deg)), _LEAST_COS_LATITUDE)

    def moved(north: float, east: float) -> Callable[[float], Vector]:
        def change(by_m: float) -> Vector:
            angle_deg = math.degrees(by_m / _EARTH_M)
            latitude = site.latitude_deg + north * angle_deg
            longitude = site.longitude_deg + east * angle_deg / cos_latitude
            return at.changed(site=replace(site, latitude_deg=latitude, longitude_deg=longitude))

        return change

    position = [scaled(moved(1, 0), position_m, step_m), scaled(moved(0, 1), position_m, step_m)]
    raised = scaled(lambda by_m: at.changed(site=replace(site, height_m=site.height_m + by_m)), height_m, 100.0)
    vertical = site.uncertainty.vertical_arcsec * TO_STANDARD
    tilts = [scaled(partial(at.tilted, about_deg), vertical, LARGEST_STEP_ARCSEC) for about_deg in (0.0, 90.0)]
    return [
        Term(
            "site position",
            position_m,
            "m",
            *together(position),
            evidence="B: as stated in the station file, or 10 m (95 %), a GPS receiver's",
            explanation="31 m of the ground are 1 arcsec of the sky",
            remedy="survey the site, and state site.uncertainty.position_m",
            size_arcsec=at.without("geodetic latitude"),
        ),
        Term(
            "site height",
            height_m,
            "m",
            *raised,
            evidence="B: as stated in the station file, or 20 m (95 %)",
            explanation="only by the pressure that follows from it, where none is entered",
            remedy="enter the pressure at the mount",
        ),
        Term(
            "deflection of the vertical",
            vertical,
            "arcsec",
            *together(tilts),
            evidence="B: EGM2008: below 10 arcsec but in high mountains, taken as 95 %",
            explanation="a level stands on the plumb line, not on the ellipsoid",
            remedy="fit the mount (mount: {align: first 60 s}), or correct by a geoid model and state vertical_arcsec",
            corrected=False,
        ),
    ]


def air_terms(site: Site, mount: Mount, at: ChangedTruth) -> list[Term]:
    """Refraction: what its air and its formula leave; nothing where there is no air."""
    pressure, temperature = site.pressure_uncertainty_hpa * TO_STANDARD, site.temperature_uncertainty_c * TO_STANDARD
    humidity = site.uncertainty.relative_humidity * TO_STANDARD
    entered_p = "as entered" if site.pressure_hpa is not None else "not entered: the standard atmosphere's"
    entered_t = "as entered" if site.temperature_c is not None else "not entered: the standard atmosphere's"
    air = {
        "pressure": (pressure, "hPa", replace(site, pressure_hpa=site.air_pressure_hpa + pressure), entered_p),
        "temperature": (temperature, "K", replace(site, temperature_c=site.air_temperature_c + temperature), entered_t),
        "humidity": (humidity, "", replace(site, relative_humidity=_other_humidity(site, humidity)), "as entered"),
    }
    if site.air_pressure_hpa == 0:
        return []
    terms = [
        Term(
            f"refraction: {name}",
            standard,
            unit,
            *absolute(at.changed(site=changed)),
            evidence=f"B: {how}, with site.uncertainty or its default",
            explanation=f"the air bends light by {at.refraction_arcsec:.1f} arcsec at this altitude",
            remedy=f"measure the {name} at the mount and state its uncertainty",
        )
        for name, (standard, unit, changed, how) in air.items()
    ]
    left = AIR_MODEL / math.sqrt(3) * at.refraction_arcsec
    lowered = at.changed(mount=replace(mount, altitude_deg=mount.altitude_deg - left / 3600))
    shift = absolute(lowered) if left else (0.0, 0.0, 0.0)
    terms.append(
        Term(
            "refraction: model",
            AIR_MODEL / math.sqrt(3),
            "of it",
            *shift,
            evidence="B: ERFA's A tan z + B tan^3 z at 0.6 um; stars of 0.5 to 0.7 um",
            explanation="refraction depends on the colour of the stars",
            remedy="look closer to the zenith",
            distribution=Distribution.RECTANGULAR,
            size_arcsec=at.refraction_arcsec,
        )
    )
    return terms


def _other_humidity(site: Site, by: float) -> float:
    return site.relative_humidity + (by if site.relative_humidity + by <= 1 else -by)
