"""Sun, Moon and planets over a site, by astropy's built-in ephemeris.

Places are good to some arcseconds for the planets and some 20 for the Moon: right for what shall not be taken for a
star. Magnitudes follow Meeus, Astronomical Algorithms, chapter 41 (Saturn without its ring), and for the Moon
Krisciunas & Schaefer 1991, equation 9.
"""

import functools
import math
from dataclasses import dataclass

import numpy as np
from astropy.coordinates import GCRS, CartesianRepresentation, SkyCoord, get_body
from astropy.time import Time
from numpy.typing import NDArray

from gse.constants import AU_M
from gse.simulator.sky import CELL_NS, AstropySite, Track, earth_orientation, horizon_vectors, times_of

MAGNITUDE_TERMS = {
    "mercury": (-0.42, 0.0380, -0.000273, 2e-6),
    "venus": (-4.40, 0.0009, 0.000239, -6.5e-7),
    "mars": (-1.52, 0.016, 0.0, 0.0),
    "jupiter": (-9.40, 0.005, 0.0, 0.0),
    "saturn": (-8.88, 0.0, 0.0, 0.0),
    "uranus": (-7.19, 0.0, 0.0, 0.0),
    "neptune": (-6.87, 0.0, 0.0, 0.0),
}
"""At 1 au from Sun and Earth, and its change with the phase angle in degrees."""

NAMES = ("sun", "moon", *MAGNITUDE_TERMS)
SUN, MOON, FIRST_PLANET = 0, 1, 2
_KEPT_CELLS = 32
"""Each takes 0.05 s to make and 1 kB to keep."""
_MOON_RADIUS_AU = 1_737_400.0 / AU_M


@dataclass(frozen=True, slots=True, eq=False)
class BodyCell:
    """300 s of the bodies of NAMES, with their magnitudes in the middle of it.

    ``moon_phase_rad`` is 0 when full, ``moon_radius_rad`` half its width.
    """

    track: Track
    magnitude: NDArray[np.float64]
    moon_phase_rad: float
    moon_radius_rad: float


def bodies_over(site: AstropySite, utc_ns: int) -> BodyCell:
    """The cell of an instant."""
    return _cell(site, utc_ns // CELL_NS * CELL_NS)


@functools.lru_cache(maxsize=_KEPT_CELLS)
def _cell(site: AstropySite, start_ns: int) -> BodyCell:
    times, location = times_of(start_ns), site.location
    with earth_orientation():
        seen = _together([get_body(name, times, location) for name in NAMES], times)
        seen = seen.transform_to(site.horizon(times[:, None]))
    nodes, to_earth_au = horizon_vectors(seen), seen.distance.au[0]
    from_earth = nodes[0] * to_earth_au[:, None]
    to_sun_au = np.linalg.norm(from_earth - from_earth[SUN], axis=1)
    phase_rad = [
        _angle_of(float(sun_side), float(earth_side), float(to_earth_au[SUN]))
        for sun_side, earth_side in zip(to_sun_au, to_earth_au, strict=True)
    ]
    magnitude = np.array([-26.7, _moon_magnitude(phase_rad[MOON]), *np.zeros(len(MAGNITUDE_TERMS))])
    for number, terms in enumerate(MAGNITUDE_TERMS.values(), start=FIRST_PLANET):
        phase_deg = math.degrees(phase_rad[number])
        by_phase = sum(term * phase_deg**power for power, term in enumerate(terms))
        magnitude[number] = by_phase + 5 * math.log10(to_sun_au[number] * to_earth_au[number])
    return BodyCell(Track(start_ns, nodes), magnitude, phase_rad[MOON], _MOON_RADIUS_AU / float(to_earth_au[MOON]))


def _together(bodies: list[SkyCoord], times: Time) -> SkyCoord:
    """Bodies as seen at M instants, as one (M, N): to turn them one by one takes four times as long."""
    places_au = np.stack([body.cartesian.xyz.to_value("AU") for body in bodies], axis=-1)
    site = {name: getattr(bodies[0], name)[:, None] for name in ("obsgeoloc", "obsgeovel")}
    frame = GCRS(CartesianRepresentation(places_au, unit="AU", copy=False), obstime=times[:, None], **site)
    return SkyCoord(frame)


def _angle_of(side_a: float, side_b: float, opposite: float) -> float:
    """Angle between two sides of a triangle, from the law of cosines."""
    if side_a == 0:
        return 0.0
    cosine = (side_a**2 + side_b**2 - opposite**2) / (2 * side_a * side_b)
    return math.acos(min(max(cosine, -1.0), 1.0))


def _moon_magnitude(phase_rad: float) -> float:
    phase_deg = math.degrees(phase_rad)
    return -12.73 + 0.026 * phase_deg + 4e-9 * phase_deg**4
