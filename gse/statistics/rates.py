"""The rates that a sensor states about its axes (items rate_x, rate_y, rate_z), against the Earth's own.

A sensor that stands on the Earth turns with it: by 15.041 arcsec/s about the pole, whose components in the sensor's
frame are those of the mount. Before a star simulator there is no such truth.
"""

import math
from dataclasses import dataclass

import numpy as np

from gse.station.session_data import SessionData
from gse.statistics.sampling import Bounds, error_bounds, root_mean_square_bounds
from gse.truth import horizon_to_sensor
from gse.values.attitude_convention import to_answers
from gse.values.constants import EARTH_RATE_ARCSEC_PER_S
from gse.values.matrices import product
from protocols.vocabulary import quantity

NAMES = ("rate_x", "rate_y", "rate_z")


@dataclass(frozen=True, slots=True)
class RateError:
    """What a sensor states about one axis: ``bias`` is the mean less the truth, ``noise`` the standard deviation.

    Of ``values``, ``n_eff`` are independent; bounds are NaN where these are too few.
    """

    axis: str
    values: int
    true_arcsec_per_s: float
    bias_arcsec_per_s: float
    noise_arcsec_per_s: float
    n_eff: float
    bias_bounds_arcsec_per_s: Bounds
    noise_bounds_arcsec_per_s: Bounds


def rate_errors(session: SessionData) -> tuple[RateError, ...]:
    """The errors of the rates that came, none of a sensor that sends none, or whose mount is not known."""
    mount = session.alignment.mount if session.alignment else session.station.mount
    items = {item.name: number for number, item in enumerate(session.housekeeping.items)}
    if not session.station.is_under_sky or (mount.align is not None and session.alignment is None):
        return ()
    latitude = math.radians(session.station.site.latitude_deg)
    turn_enu = EARTH_RATE_ARCSEC_PER_S * np.array([0.0, math.cos(latitude), math.sin(latitude)])
    true = product(to_answers(horizon_to_sensor(mount)[None], session.station.sensor.attitude)[0], turn_enu)
    rows, found = session.housekeeping.rows, []
    for at, name in enumerate(NAMES):
        if name not in items:
            continue
        unit = session.housekeeping.items[items[name]].unit
        try:
            arcsec = quantity(f"1 {unit}", "arcsec/s")
        except ValueError:  # a rate without a unit of angles
            continue
        stated = np.asarray(rows["value"])[np.asarray(rows["item"]) == items[name]] * arcsec
        stated = stated[np.isfinite(stated)]
        if len(stated) > 1:
            bias, noise = float(stated.mean() - true[at]), float(stated.std(ddof=1))
            of_bias, of_noise = error_bounds(stated - true[at]), root_mean_square_bounds(stated - stated.mean())
            of_axis = name[-1], len(stated), float(true[at]), bias, noise
            found.append(RateError(*of_axis, of_bias.n_eff, of_bias.bias, of_noise))
    return tuple(found)
