"""Results of a sensor that sends its own answers, one by one: status, times, and what is taken off for air."""

import math
from dataclasses import replace

import numpy as np
import pytest
from skies.known_nights import START_NS, STATION, TRUTH

from gse.station.own_answers import OwnAnswerProcessor, OwnAnswerTruth, field_of
from gse.station.results import OwnAnswer, Status, attitude_errors
from gse.truth import SiderealTruth
from gse.values.attitude import Attitude
from gse.values.attitude_convention import AttitudeConvention, state_angles
from gse.values.mount import Mount
from protocols import AttitudeMessage

AS_BUILT_IN = AttitudeConvention()
CAMERA = STATION.sensor.camera()
LOW = Mount(azimuth_deg=200.0, altitude_deg=35.0, roll_deg=50.0)
"""Here air lifts the boresight by 80 arcsec, and by a tenth of an arcsecond more 100 arcsec lower."""


def message_of(rotation, convention, **changes):
    """What a sensor sends whose answer is this rotation."""
    ra_deg, de_deg, roll_deg = state_angles(rotation[None], convention)[0].tolist()
    made = AttitudeMessage(
        7, frame_no=3, matched=14, state="acquired", latency_s=0.25, ra_deg=ra_deg, de_deg=de_deg, roll_deg=roll_deg
    )
    return replace(made, **changes)


def errorless(mount, *, corrected=False):
    truth = OwnAnswerTruth(TRUTH, mount, corrected, field_of(CAMERA))
    return truth.expected(np.array([START_NS]))[0]


def result_of(message, truth, mount, convention=AS_BUILT_IN):
    processor = OwnAnswerProcessor(convention, CAMERA)
    answer = OwnAnswer(message, START_NS + 5, START_NS, 9)
    (result,) = processor.results(OwnAnswerProcessor.panorama(answer), message, truth, mount)
    return result


def apart_arcsec(one, other):
    return np.abs(attitude_errors(one.icrs_to_sensor[None], other.icrs_to_sensor[None])[0]).max()


@pytest.mark.parametrize("aberration", ["corrected", "not corrected"])
def test_a_sensor_without_error_has_the_true_attitude_and_no_error(aberration):
    """Aberration moves an answer by up to 20 arcsec, which are left in or not as the convention says."""
    convention = AttitudeConvention(aberration=aberration)
    sent = errorless(LOW, corrected=aberration == "corrected")
    found = result_of(message_of(sent, convention), TRUTH, LOW, convention)
    true = TRUTH.attitude_true(START_NS, LOW)
    assert (found.status, found.detail, found.identifier, found.elapsed_us) == (
        Status.IDENTIFIED, "", "sensor", 250_000.0)  # fmt: skip
    assert found.attitude.icrs_to_sensor == pytest.approx(sent, abs=1e-11)
    assert apart_arcsec(found.attitude_geometric, true) < 1e-3
    assert apart_arcsec(found.attitude_true, true) < 1e-6
    assert abs(found.attitude_error.cross_x_arcsec) < 1e-3
    assert apart_arcsec(found.attitude, true) > 50
    for attitude in (found.attitude, found.attitude_geometric):
        assert attitude.covariance_rad2.tolist() == np.zeros((3, 3)).tolist()


def test_an_error_of_the_sensor_is_measured_less_true():
    sent = errorless(LOW)
    off = Attitude(sent, np.zeros((3, 3)))
    off = Attitude.from_angles(off.ra_deg, off.de_deg + 30 / 3600, off.roll_deg)
    found = result_of(message_of(off.icrs_to_sensor, AS_BUILT_IN), TRUTH, LOW)
    assert found.attitude_error.d_de_arcsec == pytest.approx(30.0, abs=0.1)
    assert found.attitude_error.d_ra_cosde_arcsec == pytest.approx(0.0, abs=0.1)


def test_while_the_mount_is_not_known_air_is_taken_off_where_the_answer_itself_looks():
    found = result_of(message_of(errorless(LOW), AS_BUILT_IN), TRUTH, None)
    assert (found.attitude_true, found.attitude_error) == (None, None)
    assert apart_arcsec(found.attitude_geometric, TRUTH.attitude_true(START_NS, LOW)) < 0.3
    assert apart_arcsec(found.attitude, TRUTH.attitude_true(START_NS, LOW)) > 50


@pytest.mark.parametrize("mount", [None, LOW])
def test_without_a_sky_nothing_is_taken_off_and_nothing_compared(mount):
    found = result_of(message_of(errorless(LOW), AS_BUILT_IN), None, mount)
    assert found.status is Status.IDENTIFIED
    assert (found.attitude_geometric, found.attitude_true, found.attitude_error) == (None, None, None)


def test_a_processing_time_that_is_not_stated_is_none():
    sent = errorless(LOW)
    stated = message_of(sent, AS_BUILT_IN)
    assert result_of(stated, None, None).elapsed_us == 250_000.0
    assert result_of(replace(stated, latency_s=math.nan), None, None).elapsed_us is None
    lost = replace(stated, state="lost", latency_s=math.nan)
    assert result_of(lost, None, None).elapsed_us is None


def test_the_mount_that_an_answer_shows_is_where_it_looks():
    message = message_of(errorless(LOW), AS_BUILT_IN)
    known, shown = (result_of(message, TRUTH, mount).attitude_geometric for mount in (LOW, None))
    assert apart_arcsec(known, shown) < 0.2


def test_answers_are_compared_with_the_sky_and_the_mount_of_now():
    processor = OwnAnswerProcessor(AS_BUILT_IN, CAMERA)
    message = message_of(errorless(LOW), AS_BUILT_IN)
    panorama = OwnAnswerProcessor.panorama(OwnAnswer(message, START_NS + 5, START_NS, 9))
    elsewhere = SiderealTruth(replace(TRUTH.site, height_m=4000.0, pressure_hpa=600.0), TRUTH.earth_orientation)
    for truth, mount in ((TRUTH, LOW), (TRUTH, STATION.mount), (elsewhere, STATION.mount), (elsewhere, LOW)):
        (found,) = processor.results(panorama, message, truth, mount)
        alone = result_of(message, truth, mount)
        assert found.attitude_geometric.icrs_to_sensor.tolist() == alone.attitude_geometric.icrs_to_sensor.tolist()


@pytest.mark.parametrize(("utc_ns", "stamped_ns"), [(None, 0), (START_NS, START_NS)])
def test_an_exposure_has_the_instant_of_its_answer_or_none(utc_ns, stamped_ns):
    message = AttitudeMessage(7, frame_no=3, problems=("no state",))
    panorama = OwnAnswerProcessor.panorama(OwnAnswer(message, START_NS + 5, utc_ns, 9))
    assert (panorama.utc_ns, panorama.host_utc_ns, panorama.sequence) == (stamped_ns, START_NS + 5, 9)
    assert (panorama.xy_px.shape, panorama.brightness.shape) == ((0, 2), (0,))
    assert math.isnan(panorama.exposure_s)
    assert panorama.problems == ("no state",)
