"""The simulated star simulator: stars about a stated direction, against astropy's offset frames and the station."""

import astropy.units as u
import numpy as np
import pytest
from astropy.coordinates import SkyCoord

from gse.catalog import load_catalog
from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.simulator.device import device_factory
from gse.simulator.outlook import outlook
from gse.simulator.own_answers import OwnAnswers
from gse.simulator.panorama import PanoramaSource
from gse.simulator.scenario import parse_scenario
from gse.simulator.scene import icrs_to_sensor, scene_of
from gse.values.instant import NS_PER_S, from_text

NOON_NS = from_text("2026-06-21T05:00:00Z")
ARCSEC_DEG = 1 / 3600


def laboratory(shown):
    head, _, rest = BUILT_IN_TEXT.partition("mount:")
    return parse_station(f"{head}mount: {{inertial: {shown}}}\nport:{rest.partition('port:')[2]}")


def quiet(keys=""):
    text = f"text: test\nstart: 2026-06-21T05:00:00Z\noptics: {{position_noise_arcsec: 0, magnitude_noise: 0}}\n{keys}"
    return parse_scenario(text, "t")


@pytest.mark.parametrize(("ra_deg", "de_deg", "roll_deg"), [(83, -2, 25), (359.99, 89.9, 179.9), (0, -90, 0)])
def test_stars_stand_where_astropy_has_them_about_the_shown_direction(ra_deg, de_deg, roll_deg):
    station = laboratory(f"{{ra_deg: {ra_deg}, de_deg: {de_deg}, roll_deg: {roll_deg}}}")
    scene = scene_of(station, quiet(), np.random.default_rng(1))
    (xy_px,), _ = scene.objects(NOON_NS, 5.0)
    catalog = load_catalog(faintest_magnitude=5.0).at_epoch(2026.47)
    x, y, z = catalog.icrs.T
    stars = SkyCoord(np.arctan2(y, x) * u.rad, np.arctan2(z, np.hypot(x, y)) * u.rad, frame="icrs")
    boresight = SkyCoord(ra_deg * u.deg, de_deg * u.deg, frame="icrs")
    about = stars.transform_to(boresight.skyoffset_frame(rotation=roll_deg * u.deg))
    east, north = about.lon.rad, about.lat.rad
    in_front = np.hypot(east, north) < 0.1
    # In the offset frame north is image up: rows fall as it grows, and columns fall towards east.
    focal_px, centre_px = station.sensor.focal_length_px, 511.5
    expected_px = np.column_stack(
        [
            centre_px - focal_px * np.tan(east[in_front]),
            centre_px - focal_px * np.tan(north[in_front]) / np.cos(east[in_front]),
        ]
    )
    order = np.argsort(catalog.magnitude[in_front])[:20]
    for star in order:
        nearest = np.abs(xy_px - expected_px[star]).max(axis=1).min()
        assert nearest < 1e-3, (star, nearest)


def test_a_rate_moves_the_direction_and_the_wrap_of_ra_does_not_matter():
    rates = "ra_rate_arcsec_per_s: 20, de_rate_arcsec_per_s: -5, at: 2026-06-21T05:00:00Z"
    station = laboratory(f"{{ra_deg: 359.999, de_deg: 10, roll_deg: -20, {rates}}}")
    boresight = icrs_to_sensor(station, quiet(), NOON_NS + 10 * NS_PER_S)[2]
    place = SkyCoord((359.999 + 200 * ARCSEC_DEG) * u.deg, (10 - 50 * ARCSEC_DEG) * u.deg, frame="icrs")
    assert np.abs(boresight - place.cartesian.xyz.value).max() < 1e-9


def test_neither_day_nor_horizon_nor_moon_hides_a_star():
    station = laboratory("{ra_deg: 83, de_deg: -2}")
    source = PanoramaSource(station, quiet(), np.random.default_rng(1))
    for hour in range(0, 24, 3):
        seen = source.expose(NOON_NS + hour * 3600 * NS_PER_S, 0.05, 20.0)
        assert len(seen.index) >= 20
        assert not seen.flags


def test_a_cap_hides_them():
    station = laboratory("{ra_deg: 83, de_deg: -2}")
    source = PanoramaSource(station, quiet("air: {capped_s: [[0, 10]]}"), np.random.default_rng(1))
    assert len(source.expose(NOON_NS + NS_PER_S, 0.05, 20.0).index) == 0
    assert len(source.expose(NOON_NS + 20 * NS_PER_S, 0.05, 20.0).index) >= 20


def test_its_own_answers_state_the_shown_direction():
    station = laboratory("{ra_deg: 83, de_deg: -2, roll_deg: 25}")
    scenario = quiet("attitude: {noise_arcsec: 0, roll_noise_arcsec: 0}")
    answer = OwnAnswers(station, scenario, np.random.default_rng(1), NOON_NS).message(NOON_NS, 0, 0)
    assert (answer.ra_deg, answer.de_deg, answer.roll_deg) == pytest.approx((83, -2, 25), abs=1e-9)


def test_the_outlook_names_what_is_shown_instead_of_the_sun():
    text = outlook(laboratory("{ra_deg: 83, de_deg: -2}"), quiet(), "")
    assert "RA 83, DE -2 deg" in text
    assert "stars in the field" in text
    assert "Sun" not in text


def test_sim_takes_a_mount_that_is_fixed_to_the_stars():
    sensor = device_factory(laboratory("{ra_deg: 83, de_deg: -2}"))({"frames": "3"})
    received = b""
    while (chunk := sensor.next_chunk()) is not None:
        received += chunk.data
    assert received.count(bytes.fromhex("1acffc1d")) == 3


SCENE = """
scene:
  seed: 4
  steps: [{{ra_deg: 83, de_deg: -2, for_s: 10}}, {{ra_deg: 83, de_deg: -2, for_s: 10}}]
  {}
"""


def places(keys, second=1):
    scene = scene_of(laboratory("{ra_deg: 83, de_deg: -2}"), quiet(SCENE.format(keys)), np.random.default_rng(1))
    (xy_px,), magnitude = scene.objects(NOON_NS + second * NS_PER_S, 5.0)
    here = scene.camera.contains(xy_px)
    return xy_px[here], magnitude[here]


def test_a_scene_drops_a_share_of_the_stars_and_always_the_same_ones():
    some, _ = places("dropped: 0.5")
    whole, _ = places("")
    assert 0.2 * len(whole) < len(some) < 0.8 * len(whole)
    assert all(np.abs(whole - place).max(axis=1).min() < 1e-9 for place in some)
    assert (places("dropped: 0.5", 11)[0] == some).all()


def test_noise_moves_each_star_by_its_own_error_on_both_axes():
    whole, _ = places("")
    moved, _ = places("noise_arcsec: 20")
    off_px = np.concatenate([moved[np.abs(moved - place).sum(axis=1).argmin()] - place for place in whole])
    assert np.std(off_px) == pytest.approx(20 / 3600 / np.degrees(1 / 4170), rel=0.3)


def test_a_planet_stands_among_the_stars_and_false_objects_on_the_detector():
    whole, _ = places("")
    planet, magnitude = places("objects: [{ra_deg: 83, de_deg: -2, magnitude: -2.5}]")
    assert planet[magnitude == -2.5] == pytest.approx(np.array([[511.5, 511.5]]))
    first, _ = places("false_objects: 3")
    second, _ = places("false_objects: 3", 11)
    assert len(first) == len(second) == len(whole) + 3
    assert np.abs(first[-3:] - second[-3:]).min() > 0.1  # other ones at each step
