"""Steps that the host's clocks showed leave the errors that other causes compete for."""

import numpy as np
import pytest
from skies.star_errors import SETTINGS, START_NS, Truth, made

from gse.diagnosis.error_series import error_series
from gse.diagnosis.known_clock_steps import without_steps
from gse.instant import NS_PER_S
from gse.station.event_kinds import ClockStep, StationKind

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
