"""From a session to its camera: which panoramas, which trial cameras, how far the sky moved."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gse.catalog import load_catalog
from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.identifier import Identification, make_identifier
from gse.imaging.session_fit import MAX_PANORAMAS, PanoramaSample, _field, _moved_px, calibrate_session
from gse.truth import EarthOrientation, SiderealTruth
from gse.values.panorama import Panorama
from gse.values.site import Site


def filled(count):
    sample = PanoramaSample()
    for number in range(count):
        sample.add(Panorama(number, np.empty((0, 2)), np.empty(0), number))
    return sample


def numbers(panoramas):
    return [panorama.frame_no for panorama in panoramas]


@pytest.mark.parametrize("count", [1, 399, 799, 800, 801, 1601, 12_345])
def test_a_sample_is_even_bounded_and_reaches_over_the_whole_session(count):
    kept = numbers(filled(count).panoramas)
    steps = {b - a for a, b in itertools.pairwise(kept)}
    assert len(steps) <= 1
    assert kept[0] == 0
    assert min(count, MAX_PANORAMAS) <= len(kept) < 2 * MAX_PANORAMAS
    assert count - kept[-1] <= max(steps, default=1)


def test_some_of_a_sample_are_as_many_as_asked_first_and_last_among_them():
    assert numbers(filled(11).spread(3)) == [0, 5, 10]
    assert numbers(filled(3).spread(5)) == [0, 1, 2]
    assert filled(0).spread(5) == []


def named(xy_px, stars):
    xy_px = np.array(xy_px, dtype=float)
    answer = Identification(np.arange(len(stars)), np.array(stars), 0.0)
    return Panorama(0, xy_px, np.linspace(2, 1, len(xy_px)), 0), answer


def test_the_sky_moves_by_the_sum_of_the_shifts_of_its_stars():
    first = named([[10, 10], [50, 20]], [7, 8])
    second = named([[53, 24], [13, 14], [90, 90]], [8, 7, 9])
    third = named([[90, 96], [500, 500]], [9, 4])
    apart = named([[0, 0]], [99])
    assert _moved_px([first, second]) == pytest.approx(5.0)
    assert _moved_px([first, second, third]) == pytest.approx(np.hypot(3, 10))
    assert _moved_px([first, apart, third]) == 0.0
    assert _moved_px([first]) == 0.0


@pytest.fixture(scope="module")
def identifier():
    station = parse_station(BUILT_IN_TEXT)
    return make_identifier(station.identifier, station.sensor.camera(), load_catalog())


@pytest.fixture(scope="module")
def calibrated(identifier):
    """Every second of 24 panoramas is of the sky, the others are random objects."""
    start = parse_station(BUILT_IN_TEXT).sensor.camera()
    rng, sample = np.random.default_rng(4), PanoramaSample()
    first = Rotation.from_euler("xyz", [0.3, 0.5, 0.2])
    for number in range(24):
        rotation = (first * Rotation.from_rotvec([0, 0, number * 60 * 7.29e-5])).as_matrix()
        xy = start.pixels(identifier.catalog.icrs @ rotation.T)
        xy = xy[start.contains(xy)][:26] if number % 2 else rng.uniform(0, 1023, (26, 2))
        sample.add(Panorama(number * 60_000_000_000, xy, np.linspace(4000, 300, len(xy)), number))
    return start, calibrate_session(sample, start, identifier, None)


def test_what_was_identified_is_counted_before_and_after(calibrated):
    _, result = calibrated
    assert (result.tried, result.panoramas, result.identified_after) == (5, 24, 12)
    assert result.calibration.panoramas == 12


def test_a_camera_that_identifies_half_of_the_panoramas_is_where_the_fit_starts(calibrated):
    start, result = calibrated
    assert result.identified_before == 4
    assert result.first_scale == 1.0
    assert result.calibration.camera.focal_length_px == pytest.approx(start.focal_length_px, rel=2e-4)
    assert result.hot_pixels == ()


@pytest.mark.parametrize(
    ("tried_minutes", "identified", "scale"), [((0, 10, 80, 90, 100), 2, 1.003), ((0, 10, 20, 80, 90), 3, 1.0)]
)
def test_a_camera_that_identifies_less_than_half_of_the_panoramas_is_searched_anew(
    identifier, tried_minutes, identified, scale
):
    """Its focal length is 0.3 % too short: until minute 75 panoramas can just be identified, later ones not.

    Five of fifteen are tried: the first, fourth, eighth, eleventh and last.
    """
    minutes = np.arange(2, 77, 5)
    minutes[[0, 3, 7, 10, 14]] = tried_minutes
    start = parse_station(BUILT_IN_TEXT).sensor.camera()
    true = replace(start, focal_length_px=1.003 * start.focal_length_px)
    sample, first = PanoramaSample(), Rotation.from_euler("xyz", [0.3, 0.5, 0.2])
    for minute in minutes.tolist():
        rotation = (first * Rotation.from_rotvec([0, 0, minute * 60 * 7.29e-5])).as_matrix()
        xy = true.pixels(identifier.catalog.icrs @ rotation.T)
        xy = xy[true.contains(xy)][:26]
        sample.add(Panorama(minute * 60_000_000_000, xy, np.linspace(4000, 300, len(xy)), minute))
    result = calibrate_session(sample, start, identifier, None)
    assert (result.identified_before, result.tried, result.identified_after) == (identified, 5, 15)
    assert result.first_scale == pytest.approx(scale, abs=1e-4)
    assert result.calibration.camera.focal_length_px == pytest.approx(true.focal_length_px, rel=2e-4)


def test_stars_are_fitted_where_the_air_shows_them():
    utc_ns = 1_774_000_000_000_000_000
    site = Site(latitude_deg=48.0, longitude_deg=11.0, height_m=0.0, pressure_hpa=1010.0, temperature_c=10.0)
    truth = SiderealTruth(site, EarthOrientation.from_disk(utc_ns))
    station = parse_station(BUILT_IN_TEXT)
    identifier = make_identifier(station.identifier, station.sensor.camera(), load_catalog())
    zenith = truth.icrs_to_horizon(utc_ns)[2]
    without_air = truth.apparent(identifier.catalog.icrs, utc_ns) @ zenith
    low = np.flatnonzero((without_air > np.sin(np.radians(15))) & (without_air < np.sin(np.radians(60))))
    named = Identification(np.arange(len(low)), low, 1e-9)
    seen = _field((Panorama(utc_ns, np.zeros((len(low), 2)), np.ones(len(low)), 0), named), identifier, truth).stars
    altitude = np.degrees(np.arcsin(seen @ zenith))
    bennett_deg = 1 / np.tan(np.radians(altitude + 7.31 / (altitude + 4.4))) / 60  # Bennett 1982, 1010 hPa, 10 degC
    assert len(low) > 50
    assert altitude - np.degrees(np.arcsin(without_air[low])) == pytest.approx(bennett_deg, rel=0.04)
