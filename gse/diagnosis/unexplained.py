"""Errors beyond their limits that no cause explains: the noise of single stars, or none of what is known here."""

import math
from collections.abc import Iterator

import numpy as np

from gse.axis import AXES, ON_SKY
from gse.constants import ARCSEC_RAD
from gse.finding import Finding
from gse.station.session_data import SessionData
from gse.statistics.session_statistics import Statistics

_MOST_RATIO = 1.4
"""Of the errors to what single stars leave: within it nothing else makes half of their variance."""
_FITTED = 1.5
"""Stars' worth of residuals that a fit of three angles takes."""


def unexplained(session: SessionData, stats: Statistics) -> Iterator[Finding]:
    """What is over its limit, as one finding; nothing where nothing is."""
    limits = session.station.limits
    over = {
        axis: f"95 % of |{axis.label}| is {stats.onboard.axes[axis.key].p95_abs_arcsec:.0f} arcsec"
        for axis in AXES
        if stats.onboard.axes[axis.key].p95_abs_bounds_arcsec.lower > limits.of(axis)
    }
    if over.keys() & set(ON_SKY) and (noise := _noise_of_stars(session, stats)):
        size = f"{', '.join(over.values())}: {noise}"
        yield Finding(
            "centroid noise", size, ("seeing",), "see to focus and exposure; gse plan tells what noise passes"
        )
    elif over:
        yield Finding(
            "none of these",
            f"{', '.join(over.values())}, and no cause that is known here fits",
            (),
            "look at the errors over time: gse view SESSION; for a maintainer: gse why SESSION --bundle FILE",
        )


def _noise_of_stars(session: SessionData, stats: Statistics) -> str:
    """What single stars leave of the boresight's errors, in words, where that is nearly all; else nothing."""
    used, matches = stats.counted.used, session.frames.matches
    frames, matches = session.frames.columns, matches.compress(used[matches["frame"]])
    count = float(np.median(frames["matched"][used])) if used.any() else 0.0
    if count <= _FITTED or not len(matches):
        return ""
    residuals = np.array([matches["residual_x_arcsec"], matches["residual_y_arcsec"]], dtype=np.float64)
    of_star = math.sqrt(float((residuals**2).mean()) * count / (count - _FITTED))
    left = of_star / math.sqrt(count)
    errors = np.array([frames[name][used] for name in ("cross_x_arcsec", "cross_y_arcsec")], dtype=np.float64)
    if math.sqrt(float(np.nanmean(errors**2))) > _MOST_RATIO * left:
        return ""
    px = of_star * ARCSEC_RAD / session.station.sensor.camera().pixel_rad
    stars = f"single stars scatter by {of_star:.0f} arcsec ({px:.2f} px)"
    return f"{stars}, so that {count:.0f} of them leave {left:.0f} arcsec on each axis"
