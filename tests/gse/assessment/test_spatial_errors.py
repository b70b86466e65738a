"""Injected errors of single stars, of temperature and of starts are found within their intervals."""

import math

import numpy as np
import pytest
from skies.known_nights import STATION

from gse.assessment.first_fix import first_fixes_s
from gse.assessment.spatial_errors import spatial_errors
from gse.assessment.thermal import thermal_error
from gse.constants import ARCSEC_PER_RAD
from gse.station.frame_table import MATCH

CAMERA = STATION.sensor.camera()
PIXEL_ARCSEC = CAMERA.pixel_rad * ARCSEC_PER_RAD


def matches(error_of=lambda x, y: 0.0, *, noise_arcsec=10.0, stars=60, frames=300, seed=1):
    """Stars that cross the detector in straight lines, each in half of the frames; errors along columns only."""
    rng = np.random.default_rng(seed)
    x0, y0 = rng.uniform(0, 800, stars), rng.uniform(0, 1000, stars)
    frame, star = (part.ravel() for part in np.meshgrid(np.arange(frames), np.arange(stars), indexing="ij"))
    seen = (frame // 50 + star) % 2 == 0
    frame, star = frame[seen], star[seen]
    rows = np.zeros(len(frame), dtype=MATCH)
    rows["frame"], rows["star"] = frame, star
    rows["x_px"], rows["y_px"] = x0[star] + 0.713 * frame, y0[star] + 0.0531 * frame
    noise = rng.normal(0, noise_arcsec, (2, len(frame)))
    rows["residual_x_arcsec"] = noise[0] + error_of(rows["x_px"], rows["y_px"])
    rows["residual_y_arcsec"] = noise[1]
    return rows


def found(rows):
    xy_px = np.column_stack([rows["x_px"], rows["y_px"]]).astype(float)
    return spatial_errors(rows, CAMERA.directions(xy_px), (CAMERA.columns, CAMERA.rows))


@pytest.mark.parametrize("seed", range(4))
def test_noise_alone_has_no_spatial_error_within_its_interval(seed):
    for axis in found(matches(seed=seed)):
        assert axis.fov.low_arcsec == 0
        assert axis.pixel.low_arcsec == 0
        assert axis.fov.high_arcsec < 1
        assert axis.pixel.high_arcsec < 1
        assert axis.temporal.low_arcsec < 10.4 < axis.temporal.high_arcsec + 0.5


def test_the_noise_of_the_boresight_is_that_of_a_star_over_the_root_of_their_number():
    for axis in found(matches(noise_arcsec=10.0)):  # 30 stars in each frame
        assert axis.temporal.boresight_arcsec == pytest.approx(10.0 / math.sqrt(30), rel=0.2)


def test_a_pixel_phase_error_of_a_twentieth_of_a_pixel_is_found():
    amplitude = 0.05 * PIXEL_ARCSEC
    x, y = found(matches(lambda x, y: amplitude * np.sin(2 * math.pi * x)))
    assert x.pixel.low_arcsec < amplitude / math.sqrt(2) < x.pixel.high_arcsec
    assert x.pixel.low_arcsec > 1
    assert 0 < x.pixel.boresight_arcsec < x.pixel.rms_arcsec
    assert x.fov.low_arcsec == 0
    assert y.pixel.low_arcsec == 0


def test_an_error_that_is_slow_over_the_field_is_found():
    def bent(x, y):
        return 4 * ((x / 512 - 1) ** 2 - 1 / 3)

    rows = matches(bent)
    x, y = found(rows)
    assert x.fov.low_arcsec < float(np.std(bent(rows["x_px"], rows["y_px"]))) < x.fov.high_arcsec
    assert x.pixel.low_arcsec == 0
    assert y.fov.low_arcsec == 0


def test_few_stars_give_no_spatial_errors():
    assert found(matches(stars=10)) is None


def thermal(per_k, *, seed=1, warming_k=7.0, count=6000):
    rng = np.random.default_rng(seed)
    time_s = np.arange(count) * 0.5
    temperature = 21 + warming_k * (1 - np.exp(-time_s / 600))
    error = per_k * temperature + rng.normal(0, 5, count)
    return thermal_error((time_s * 1e9).astype(np.int64), error, np.round(temperature, 1))


def test_a_boresight_that_follows_the_temperature_is_found_in_arcsec_per_kelvin():
    result = thermal(2.0)
    assert result.low_arcsec_per_k < 2.0 < result.high_arcsec_per_k
    assert result.high_arcsec_per_k - result.low_arcsec_per_k < 1
    assert result.range_k == pytest.approx(6.4, abs=0.3)


def test_noise_does_not_follow_the_temperature_in_nineteen_of_twenty_sessions():
    results = [thermal(0.0, seed=seed) for seed in range(40)]
    assert sum(one.low_arcsec_per_k <= 0 <= one.high_arcsec_per_k for one in results) >= 35


def test_a_steady_or_unknown_temperature_tells_nothing():
    assert thermal(2.0, warming_k=0.2) is None
    unknown = np.full(100, np.nan)
    assert thermal_error(np.arange(100), np.zeros(100), unknown) is None


def test_each_cold_start_has_its_time_to_first_fix():
    utc_ns = np.arange(9) * 10**9
    frame_no = np.array([5, 6, 7, 0, 1, 2, 0, 1, 2], dtype=np.uint32)
    good = np.array([False, True, True, True, True, True, False, False, False])
    fixes = first_fixes_s(utc_ns, frame_no, good)
    assert fixes[:2] == (1.0, 0.0)
    assert math.isnan(fixes[2])
    assert first_fixes_s(utc_ns[:0], frame_no[:0], good[:0]) == ()
