"""The fit of a screen: what a rehearsed sensor saw of it, against the screen that it really had."""

import math
from dataclasses import replace

import numpy as np
import pytest
from devices.screen_panoramas import fitted, panoramas, seen_by

from gse.config.station import parse_station
from gse.errors import UsageError
from gse.imaging.screen_fit import fit_screen
from gse.simulator.scenario import load_scenario
from gse.values.mount import InertialUncertainty
from gse.values.screen import ScreenToSensor

TEXT = """\
version: 1
sensor: {name: lab, rows: 1024, columns: 1024, focal_length_px: 4170}
site: {name: lab, latitude_deg: 48, longitude_deg: 11, height_m: 500}
mount: {inertial: {ra_deg: 83, de_deg: -2}}
screen: {pixel_pitch_mm: 0.1, columns: 1920, rows: 1080, focal_length_mm: 500}
protocol: panorama-v1-subpixel
"""
STATION = parse_station(TEXT)
REAL = {
    "focal_length_mm": 503.0,
    "radial_distortion": [-0.01, 0.004],
    "gamma": 2.5,
    "latency_ms": 35.0,
    "to_sensor": {"x_deg": 1.4, "y_deg": -0.2, "roll_deg": 17.0},
}


@pytest.fixture(scope="module")
def seen():
    return seen_by(STATION, TEXT, {"screen": REAL}, seed=1)


def numbers(screen):
    looks = screen.to_sensor
    angles = looks.x_deg, looks.y_deg, looks.roll_deg
    return np.array([*angles, screen.focal_length_mm, *screen.radial_distortion, screen.gamma, screen.latency_ms])


def half_widths(screen):
    known, looks = screen.uncertainty, screen.to_sensor.uncertainty
    across = looks.across_arcsec / 3600
    others = known.away_mm, *known.radial_distortion, known.gamma, screen.latency_uncertainty_ms
    return np.array([across, across, looks.roll_arcsec / 3600, *others])


def test_each_parameter_is_found_within_its_half_width_though_another_is_stated():
    found = fitted(STATION, TEXT, {"screen": REAL}, seed=1).screen
    true = numbers(replace(STATION.screen, **{**REAL, "to_sensor": ScreenToSensor(**REAL["to_sensor"])}))
    off = np.abs(numbers(found) - true) / half_widths(found)
    assert (off < 1.5).all(), off
    assert (np.abs(numbers(STATION.screen) - true) > 5 * half_widths(found)).all()
    assert found.to_sensor.fitted


def test_a_screen_that_is_what_is_stated_stays_so():
    found = fitted(STATION, TEXT, {}, seed=2).screen
    off = (numbers(found) - numbers(STATION.screen)) / half_widths(found)
    assert (np.abs(off) < 1.5).all(), off


def test_what_the_stars_do_not_show_is_held_and_named(seen):
    stars, sky = seen
    still = sky.only(lambda item: item.rate_deg_per_s == 0)
    wide = replace(STATION.screen, columns=3840, rows=2160)
    fit = fit_screen(stars, still, wide, STATION.sensor.camera(), STATION.sensor.index_max)
    assert fit.held == ("radial_distortion", "latency_ms")
    assert (fit.screen.latency_ms, fit.screen.radial_distortion) == (0, (0, 0))
    assert 502 < fit.screen.focal_length_mm < 506  # the real distortion is in it


def test_a_few_stars_fit_no_screen(seen):
    stars, sky = seen
    few = replace(stars, **{name: getattr(stars, name)[:5] for name in stars.__dataclass_fields__})
    with pytest.raises(UsageError, match="the fit of a screen needs 30"):
        fit_screen(few, sky, STATION.screen, STATION.sensor.camera(), STATION.sensor.index_max)


@pytest.mark.parametrize("angles", [(0, 0, 0), (12, -7, 170), (-30, 40, -90)])
def test_the_angles_of_a_rotation_are_those_that_made_it(angles):
    x, y, roll = angles
    rotation = ScreenToSensor(x_deg=x, y_deg=y, roll_deg=roll).rotation()
    found = ScreenToSensor.from_rotation(rotation, InertialUncertainty())
    assert (found.x_deg, found.y_deg, found.roll_deg) == pytest.approx(angles, abs=1e-6)


def test_a_panel_of_another_gamma_makes_faint_stars_fainter():
    """Of light L it makes L^(real / stated): a magnitude becomes 2.5 / 2.2 of one."""
    scenario = load_scenario("screen-fit")
    quiet = scenario.optics.model_copy(update={"position_noise_arcsec": 0.0, "magnitude_noise": 0.0})
    scenario = scenario.model_copy(update={"optics": quiet})
    other = scenario.model_copy(update={"device": {"screen": {"gamma": 2.5}}})
    (one, *_), (two, *_) = (panoramas(STATION, some, 1, 0.1) for some in (scenario, other))
    same = {tuple(place): index for place, index in zip(one.xy_px.round(3).tolist(), one.brightness, strict=True)}
    pairs = [
        (same[tuple(place)] - 20, index - 20)
        for place, index in zip(two.xy_px.round(3).tolist(), two.brightness, strict=True)
        if tuple(place) in same and 100 < index < 3000
    ]
    assert len(pairs) > 5
    saturating = 10 ** (0.4 * (STATION.screen.brightest_magnitude - scenario.optics.saturation_magnitude))
    for before, after in pairs:
        light = before / STATION.sensor.index_max * saturating
        assert after == pytest.approx(STATION.sensor.index_max * light ** (2.5 / 2.2), rel=0.05)
        assert math.isfinite(after)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({}, ""),
        ({"focal_length_mm": 1000.0}, "the screen covers 46 % of the sensor's field, so that stars are missing"),
        (
            {"to_sensor": ScreenToSensor(x_deg=40.0)},
            "the screen covers 0 % of the sensor's field, so that the sensor sees no",
        ),
    ],
)
def test_a_screen_that_does_not_cover_the_field_is_told_with_its_share(keys, words):
    screen = replace(STATION.screen, rows=1440, **keys)  # at 1 m: 0.192 x 0.144 of the field's tangents, 0.246 each
    assert screen.gap_beside(STATION.sensor.camera()).startswith(words)
    assert (screen.covers(STATION.sensor.camera()) == 1) is (words == "")
