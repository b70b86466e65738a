"""The result of a panorama as JSON, schema gse.frame/1."""

import math
from typing import Any

from gse.station.frame_results import FrameResult
from gse.values import instant

SCHEMA = "gse.frame/1"


def frame_json(result: FrameResult) -> dict[str, Any]:
    """One panorama's result; numbers are rounded well below their meaning, absent ones are null.

    RA, DE and roll are the sensor's answer: from catalogue places in ICRS, not corrected for aberration and
    refraction; the d_... are measured minus true after these corrections.
    """
    panorama, attitude, error, matches = result.panorama, result.attitude, result.attitude_error, result.matches
    elapsed_us = result.elapsed_us
    return {
        "schema": SCHEMA,
        "utc": instant.to_text(panorama.utc_ns),
        "frame_no": panorama.frame_no,
        "status": result.status.value,
        "detail": result.detail,
        "identifier": result.identifier,
        "ra_deg": round(attitude.ra_deg, 7) if attitude else None,
        "de_deg": round(attitude.de_deg, 7) if attitude else None,
        "roll_deg": round(attitude.roll_deg, 6) if attitude and result.has_roll else None,
        "frame": "ICRS",
        "matched": len(matches),
        "objects": len(panorama.brightness),
        "chance": _number(result.false_match_probability, 3),
        "elapsed_us": None if elapsed_us is None else round(elapsed_us, 1),
        "d_ra_cosde_arcsec": round(error.d_ra_cosde_arcsec, 3) if error else None,
        "d_de_arcsec": round(error.d_de_arcsec, 3) if error else None,
        "d_roll_arcsec": round(error.d_roll_arcsec, 3) if error and result.has_roll else None,
        "answer_check": result.answer_check.value,
        "matches": [
            {"object": match.object, "star": match.star, "residual_arcsec": round(match.residual_arcsec, 2)}
            for match in matches
        ],
        "others": [{"object": row, "kind": kind} for row, kind in result.others],
    }


def _number(value: float, digits: int) -> float | None:
    return float(f"{value:.{digits}g}") if math.isfinite(value) else None
