"""What the star places leave open: proper motions, parallaxes, blends.

These are errors of single stars: a mean over the n stars of a fix has 1 / sqrt(n) of them, and they change as other
stars come into the field.
"""

import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from gse.station.session_data import SessionData
from gse.statistics.uncertainty import Term
from gse.values.constants import ARCSEC_PER_RAD, ARCSEC_RAD, EARTH_RATE_ARCSEC_PER_S
from gse.values.instant import to_julian_year
from gse.values.text import percent

MOTION_AT_REST_ARCSEC_PER_YEAR = 0.12
"""Root mean square along each axis of the proper motions of Hipparcos' stars of V 6.0 to 6.6."""
MOTION_LEFT_ARCSEC_PER_YEAR = 0.0035
"""Root mean square along each axis of what Hipparcos' proper motions leave from 1991.25 to Gaia's places of 2016.0."""
PARALLAX_ARCSEC = 0.017
"""Root mean square along each axis of the parallaxes of Hipparcos' stars to V 6.6, the Earth anywhere on its orbit."""
_BLEND_PX = 3.0
"""Two images closer than this pull each other's brightest pixel; within 2 px the catalogue has merged them."""
_COUNTS_PER_MAGNITUDE, _FLUX_PER_MAGNITUDE = 0.45, 0.4
_TYPICAL_ABOVE_LIMIT = 1.0
"""Stars of a fix are by the median this many magnitudes brighter than the faintest that is searched for companions."""
_SKY_SR = 4 * math.pi
OWN_STARS = "own choice of stars"
"""The name of the term that the sensor's own answers have beside the others."""


@dataclass(frozen=True, slots=True)
class FieldOfStars:
    """Stars of a fix and the catalogue that they are from.

    ``at_rest`` is the share of its stars whose proper motion is not known, which stand where they stood at
    ``rest_epoch_jyear``.
    """

    stars: float = 10.0
    width_rad: float = math.radians(14.0)
    pixel_arcsec: float = 49.0
    catalog_stars: int = 4200
    rest_epoch_jyear: float = 2016.0
    at_rest: float = 1.0

    @classmethod
    def from_session(cls, session: SessionData) -> Self:
        """Camera, catalogue and the median number of matched stars of a session."""
        camera = session.station.sensor.camera()
        matched = session.frames.columns["matched"]
        known, facts = matched[matched > 0], session.catalog
        count, rest = facts.get("stars"), facts.get("at_rest")
        epoch = facts.get("rest_epoch_jyear", facts.get("epoch_jyear"))
        return cls(
            float(np.median(known)) if len(known) else cls().stars,
            math.sqrt(camera.solid_angle_sr),
            camera.pixel_rad * ARCSEC_PER_RAD,
            count if isinstance(count, int) and count > 0 else cls().catalog_stars,
            float(epoch) if isinstance(epoch, float | int) else cls().rest_epoch_jyear,
            rest / count if isinstance(rest, int) and isinstance(count, int) and count > 0 else 1.0,
        )

    def of_a_fix(self, star_arcsec: float) -> tuple[float, float, float]:
        """dRA*, dDE and roll of a fix, from a standard uncertainty along each axis of each star."""
        across = star_arcsec / math.sqrt(self.stars)
        return across, across, roll_of_a_fix(across, self.width_rad)


def roll_of_a_fix(across_arcsec: float, width_rad: float) -> float:
    """The turn about the boresight of stars all over a field that shift it by so much across."""
    return across_arcsec / (width_rad / math.sqrt(6))


def star_terms(field: FieldOfStars, utc_ns: int, duration_s: float) -> list[Term]:
    """The terms of the star places; common to all frames while the same stars are in the field."""
    common = duration_s * EARTH_RATE_ARCSEC_PER_S * ARCSEC_RAD < field.width_rad
    years = abs(to_julian_year(utc_ns) - field.rest_epoch_jyear)
    motion = years * math.sqrt(
        field.at_rest * MOTION_AT_REST_ARCSEC_PER_YEAR**2 + (1 - field.at_rest) * MOTION_LEFT_ARCSEC_PER_YEAR**2
    )
    blend = _blend_arcsec(field)
    return [
        Term(
            "proper motion",
            motion,
            "arcsec per star",
            *field.of_a_fix(motion),
            evidence="B: Hipparcos against Gaia; 0.12 arcsec a year for a star whose motion is not known",
            explanation=f"{percent(field.at_rest, 0)} of the catalogue's stars stand where they stood "
            f"{years:.0f} years ago",
            remedy="fewer faint stars (identifier.catalog_stars): the bright ones have their motion",
            corrected=field.at_rest < 1,
            common=common,
        ),
        Term(
            "parallax",
            PARALLAX_ARCSEC,
            "arcsec per star",
            *field.of_a_fix(PARALLAX_ARCSEC),
            evidence="B: parallaxes of the Hipparcos stars to V 6.6",
            explanation="near stars move with the Earth on its orbit; it is not corrected",
            remedy="nothing needs to",
            corrected=False,
            common=common,
        ),
        Term(
            "blends",
            blend,
            "arcsec per star",
            *field.of_a_fix(blend),
            evidence=f"B: star counts; companions within {_BLEND_PX:g} px too faint for the mission catalogue",
            explanation="a faint star beside a bright one pulls its image",
            remedy="a longer focal length; more stars in a fix",
            corrected=False,
            common=common,
        ),
    ]


def own_stars(across_arcsec: float, width_rad: float) -> Term:
    """Of the truth of the sensor's own answers alone: air and aberration part the stars of a wide or low field."""
    return Term(
        OWN_STARS,
        across_arcsec,
        "arcsec",
        across_arcsec,
        across_arcsec,
        roll_of_a_fix(across_arcsec, width_rad),
        evidence="B: how far air and aberration part the stars over the field, over the root of their number in a fix",
        explanation="in the rows of the sensor alone: its answer has the air of its own stars, truth that of the field",
        remedy="point the sensor higher",
    )


def _blend_arcsec(field: FieldOfStars) -> float:
    """Along each axis of one star, by companions that are fainter than the stars that were searched for them.

    Counts grow with the magnitude m as 10^(0.45 m), and a companion at the distance d pulls by its share of the light,
    10^(-0.4 dm) d: the squares, summed over all fainter companions in a disc of radius r, make
    n 10^(-0.8 dm) 0.45 / (0.8 - 0.45) pi r^4 / 4 along each axis, n per steradian.
    """
    searched_per_sr = 2 * field.catalog_stars / _SKY_SR
    radius = _BLEND_PX * field.pixel_arcsec * ARCSEC_RAD
    ratio = 10 ** (-2 * _FLUX_PER_MAGNITUDE * _TYPICAL_ABOVE_LIMIT)
    fainter = _COUNTS_PER_MAGNITUDE / (2 * _FLUX_PER_MAGNITUDE - _COUNTS_PER_MAGNITUDE)
    return math.sqrt(searched_per_sr * ratio * fainter * math.pi * radius**4 / 4) * ARCSEC_PER_RAD
