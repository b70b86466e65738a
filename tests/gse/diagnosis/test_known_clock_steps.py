"""Steps that the host's clocks showed leave the errors that other causes compete for."""

import numpy as np
import pytest
from skies.star_errors import SETTINGS, START_NS, Truth, made

from gse.diagnosis.diagnosis import without_steps
from gse.diagnosis.session_model import ErrorSeries, error_series
from gse.station.events import ClockStep, StationKind
from gse.truth import horizon_to_sensor
from gse.values.instant import NS_PER_S
from gse.values.mount import Mount
from gse.values.site import Site

SITE, MOUNT = SETTINGS[0]


@pytest.mark.parametrize("step_s", [0.5, -0.5])
@pytest.mark.parametrize("wrong_before", [False, True], ids=["set wrong", "put right"])
def test_a_known_step_leaves_the_errors_of_the_right_clock(step_s, wrong_before):
    """Half a second is seven arcsec; the noise of a frame is two."""
    truth = Truth(SITE, MOUNT, clock_s=-step_s if wrong_before else 0.0, clock_step_s=step_s, at_s=240.0)
    frames, _ = made(truth, SITE, MOUNT, 600.0, np.random.default_rng(1))
    at_ns = START_NS + round((240.1 + truth.clock_s + step_s) * NS_PER_S)
    step = ClockStep(at_ns, 0, StationKind.CLOCK_STEP, "stepped", round(step_s * NS_PER_S))
    series = error_series(frames, np.ones(len(frames), dtype=bool))
    assert np.abs(_jump(series, 240.0)).max() > 3
    left = without_steps(series, frames["utc_ns"], [step], SITE, MOUNT)
    assert np.abs(_jump(left, 240.0)[:2]).max() < 0.5
    assert np.abs(left.errors_arcsec.mean(axis=0)[:2]).max() < 0.5


def _jump(series, at_s):
    late = series.time_s > at_s
    return series.errors_arcsec[late].mean(axis=0) - series.errors_arcsec[~late].mean(axis=0)


@pytest.mark.parametrize("roll_deg", [10.0, 45.0, 80.0, 135.0])
@pytest.mark.parametrize("wrong_first", [True, False])
def test_the_right_clock_is_the_one_under_which_the_boresight_errs_least_on_average(roll_deg, wrong_first):
    """Off by two seconds in half of the frames.

    All have an error of the roll, and of the axis along which the sky moves less, that speak for the wrong clock.
    """
    mount = Mount(azimuth_deg=180.0, altitude_deg=40.0, roll_deg=roll_deg)
    site = Site(latitude_deg=48.0, longitude_deg=11.0)
    axis = horizon_to_sensor(mount) @ np.array([0.0, np.cos(np.radians(48.0)), np.sin(np.radians(48.0))])
    by_second = 15.041067 * np.array([-axis[1], axis[0], axis[2]])
    across, about = np.hypot(*by_second[:2]), by_second[2]
    late = np.arange(40) >= 20
    wrong = ~late if wrong_first else late
    off_s = -2.0 if wrong_first else 2.0
    errors = np.outer(off_s * wrong, by_second) + np.array([0.0, 0.0, -off_s * 1.5 * (across**2 + about**2) / about])
    less = int(np.abs(by_second[:2]).argmin())
    errors[:, less] -= off_s * by_second[less] * (roll_deg in (10.0, 80.0))
    errors[:, :2] += 30.0 * ((-1.0) ** np.arange(40))[:, None]
    stamps_ns = START_NS + np.round((np.arange(40) + 2.0 * late) * NS_PER_S).astype(np.int64)
    step = ClockStep(int(stamps_ns[20]), 0, StationKind.CLOCK_STEP, "stepped", 2 * NS_PER_S)
    rows = np.arange(0, 40, 3)
    series = ErrorSeries(rows, rows.astype(float), errors[rows])
    left = without_steps(series, stamps_ns, [step], site, mount)
    right = errors - np.outer(off_s * wrong, by_second)
    assert left.errors_arcsec == pytest.approx(right[rows], abs=1e-3)
    assert left.rows is rows
