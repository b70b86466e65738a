"""Steps of the host's clock that its own clocks showed, taken out of the errors: they are known, and need no search."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gse.constants import EARTH_RATE_ARCSEC_PER_S
from gse.diagnosis.error_series import ErrorSeries
from gse.diagnosis.turns import pole
from gse.instant import NS_PER_S
from gse.matrices import length, product
from gse.mount import Mount
from gse.site import Site
from gse.star_influence import boresight_shifts
from gse.station.clock_steps import clock_stretches
from gse.station.event_kinds import ClockStep
from gse.truth import horizon_to_sensor


def without_steps(
    series: ErrorSeries, host_utc_ns: NDArray[np.int64], steps: Sequence[ClockStep], site: Site, mount: Mount
) -> ErrorSeries:
    """The errors as one of the clocks gives them: that under which they are least, as any of them may be the right one.

    ``host_utc_ns`` (M,) are the host's stamps of all frames, in the order of arrival.
    """
    fast_s = np.zeros(len(host_utc_ns))
    for stretch in clock_stretches(host_utc_ns, steps):
        fast_s[stretch.first : stretch.until] = stretch.offset_ns / NS_PER_S
    fast_s = fast_s[series.rows]
    turned = boresight_shifts(product(horizon_to_sensor(mount), pole(site))[None])[0] * EARTH_RATE_ARCSEC_PER_S
    tried = [series.errors_arcsec - np.outer(fast_s - right_s, turned) for right_s in np.unique(fast_s).tolist()]
    least = min(tried, key=lambda errors: length(errors[:, :2].mean(axis=0)))
    return replace(series, errors_arcsec=least)
