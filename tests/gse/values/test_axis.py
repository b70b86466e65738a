"""The axes of an attitude error, and what follows from them."""

from dataclasses import fields

import numpy as np
import pytest
from skies.known_nights import session

from gse.station.columns import FRAME
from gse.station.results import AttitudeError
from gse.statistics.metrics import metrics
from gse.statistics.session_statistics import statistics
from gse.values.axis import ALL_AXES, AXES, D_RA_COSDE, D_ROLL, OF_SENSOR
from gse.values.limits import Limits


def test_an_attitude_error_has_the_axes_in_their_order():
    assert tuple(field.name for field in fields(AttitudeError)) == tuple(axis.column for axis in ALL_AXES)


@pytest.mark.parametrize("axis", ALL_AXES, ids=lambda axis: axis.key)
def test_each_axis_has_a_column_of_frames_and_a_statistic(axis):
    made = session(bias=(10.0, 20.0, 30.0))
    found = statistics(made).onboard.axes[axis.key]
    assert FRAME[axis.column] == np.dtype("f8")
    assert found.bias_arcsec == pytest.approx(float(made.frames.columns[axis.column].mean()))


@pytest.mark.parametrize("axis", AXES, ids=lambda axis: axis.key)
def test_each_axis_on_the_sky_has_its_own_limit(axis):
    limits = Limits(**{axis.column: 7.0})
    assert [limits.of(other) == 7.0 for other in AXES] == [other is axis for other in AXES]


def test_only_roll_goes_round():
    assert [axis for axis in ALL_AXES if axis.wraps] == [D_ROLL]
    assert D_RA_COSDE.label == "dRA*"


def test_the_metrics_are_of_the_axes_of_the_sensor():
    found = {metric.axis for metric in metrics(statistics(session())) if metric.axis}
    assert found == {axis.key for axis in OF_SENSOR}
