"""Images of the simulated sky: light where astropy puts it, as much as the magnitudes say, with a detector's faults."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from gse.config.station import BUILT_IN_TEXT, Station, parse_station
from gse.imaging.extraction import extract_sub_pixel
from gse.simulator.image import ImageSource
from gse.simulator.panorama import PanoramaSource
from gse.simulator.photometry import Photometry
from gse.simulator.scenario import Scenario
from gse.simulator.scene import SimulatedScene, horizon_to_sensor, sky_magnitude
from gse.simulator.sky import MOON, NAMES, SUN, AstropySite, bodies_over
from gse.values.instant import NS_PER_S, from_text

STATION = parse_station(BUILT_IN_TEXT)
SITE = AstropySite(STATION.site)
START = "2026-03-20T15:00:00Z"


def scenario(**changes: Any) -> Scenario:
    return Scenario.model_validate({"text": "a test", "start": START, **changes})


def source(setting: Scenario, station: Station = STATION, seed: int = 1) -> ImageSource:
    return ImageSource(setting.device_for(station), setting, np.random.default_rng(seed))


def stars_of(setting: Scenario, faintest: float, station: Station = STATION) -> tuple[NDArray[Any], NDArray[Any]]:
    """Pixels and magnitudes of the stars inside the detector."""
    scene = SimulatedScene(setting.device_for(station), setting, np.random.default_rng(1))
    (xy_px,), magnitude = scene.objects(setting.start_utc_ns, 9.0)
    inside = (xy_px > 5).all(axis=1) & (xy_px < 1018).all(axis=1) & (magnitude < faintest)
    return xy_px[inside], magnitude[inside]


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"device": {"sensor": {"mirrored": True, "radial_distortion": [-0.002, 0.0005]}}},
        {"device": {"mount": {"azimuth_deg": 120, "altitude_deg": 50, "roll_deg": 40}}},
    ],
)
def test_stars_shine_where_the_scene_has_them(changes: dict[str, Any]) -> None:
    setting = scenario(**changes)
    image = source(setting).image(setting.start_utc_ns, 0.05)
    xy_px, _ = stars_of(setting, 5.5)
    seen_px, _ = extract_sub_pixel(image)
    alone = [i for i in range(len(xy_px)) if (np.linalg.norm(xy_px - xy_px[i], axis=1) < 12).sum() == 1]
    off_px = [np.linalg.norm(seen_px - xy_px[i], axis=1).min() for i in alone]
    assert len(alone) > 8
    assert np.median(off_px) < 0.12


def test_the_light_of_a_star_is_as_its_magnitude_says() -> None:
    setting = scenario(optics={"saturation_magnitude": -2.0})
    source_ = source(setting)
    image = source_.image(setting.start_utc_ns, 0.05).astype(float)
    xy_px, magnitude = stars_of(setting, 4.5)
    electrons = Photometry.from_scenario(STATION.sensor, setting).star_electrons(magnitude, 0.05)
    for (x, y), expected in zip(
        np.rint(xy_px).astype(int), electrons / setting.optics.electrons_per_index, strict=True
    ):
        patch = image[y - 5 : y + 6, x - 5 : x + 6]
        assert (patch - np.median(image)).sum() == pytest.approx(expected, rel=0.1, abs=150)


def test_the_saturating_magnitude_just_saturates() -> None:
    setting = scenario(optics={"saturation_magnitude": 3.2})
    image = source(setting).image(setting.start_utc_ns, 0.05)
    xy_px, magnitude = stars_of(setting, 9.0)
    brightest = np.argmin(magnitude)
    x, y = np.rint(xy_px[brightest]).astype(int)
    peak = image[y - 2 : y + 3, x - 2 : x + 3].max()
    assert peak == 4096 if magnitude[brightest] < 2.9 else peak > 1500
    assert image.max() <= 4096


def test_a_long_exposure_smears_stars_along_the_way_of_the_sky() -> None:
    station = STATION.model_copy(update={"sensor": STATION.sensor.model_copy(update={"focal_length_px": 40_000.0})})
    setting = scenario(exposure_s=2.0, optics={"saturation_magnitude": 8.0})
    image = source(setting, station).image(setting.start_utc_ns, 2.0).astype(float)
    y, x = np.unravel_index(image.argmax(), image.shape)
    patch = np.clip(image[max(y - 12, 0) : y + 13, max(x - 12, 0) : x + 13] - np.median(image) - 50, 0, None)
    rows, columns = np.indices(patch.shape)
    percentiles = np.cov(np.vstack([columns.ravel(), rows.ravel()]), aweights=patch.ravel())
    long, short = np.sqrt(np.linalg.eigvalsh(percentiles))[::-1]
    smear_px = 2.0 * np.radians(15.04 / 3600) * 40_000
    assert long == pytest.approx(np.hypot(0.95, smear_px / np.sqrt(12)), rel=0.2)
    assert short < 1.2


def test_noise_is_read_noise_and_shot_noise() -> None:
    setting = scenario(optics={"read_noise_electrons": 30.0, "dark_electrons_per_s": 2000.0})
    image = source(setting).image(setting.start_utc_ns, 0.5, 27.0).astype(float)
    quiet = image[image < np.median(image) + 5 * image.std()]
    sky = Photometry.from_scenario(STATION.sensor, setting).sky_electrons(21.2, 0.5)
    dark = 2000 * 0.5 * 2 * np.exp(0.3**2 / 2)
    spread_of_dark = dark * 0.3
    expected = np.sqrt(30**2 + sky + dark + spread_of_dark**2) / 10
    assert np.median(quiet) == pytest.approx(20 + (sky + dark) / 10, rel=0.1)
    assert 1.4826 * np.median(np.abs(quiet - np.median(quiet))) == pytest.approx(expected, rel=0.15)


def test_hot_pixels_glow_more_when_warm_and_dead_ones_never() -> None:
    setting = scenario(detector={"hot_pixels": 40, "dead_pixels": 200, "hot_pixel_index": [500, 900]})
    source_ = source(setting)
    cold, warm = (source_.image(setting.start_utc_ns, 0.05, celsius) for celsius in (20.0, 27.0))
    hot = warm.astype(int) - cold > 250
    assert hot.sum() == pytest.approx(40, abs=2)
    assert np.median((warm[hot] - 20.0) / (cold[hot] - 20.0)) == pytest.approx(2, rel=0.05)


def test_the_same_seed_gives_the_same_image() -> None:
    setting = scenario()
    images = [source(setting, seed=seed).image(setting.start_utc_ns, 0.05) for seed in (3, 3, 4)]
    assert (images[0] == images[1]).all()
    assert (images[0] != images[2]).any()


def test_image_and_panorama_levels_see_the_same_stars() -> None:
    setting = scenario()
    random = np.random.default_rng(1)
    by_image = source(setting).expose(setting.start_utc_ns, 0.05, 20.0)
    by_list = PanoramaSource(STATION, setting, random).expose(setting.start_utc_ns, 0.05, 20.0)
    apart_px = np.linalg.norm(by_image.xy_px[:15, None] - by_list.xy_px[None], axis=2).min(axis=1)
    assert (apart_px < 1.6).sum() >= 14
    assert by_image.index[0] == pytest.approx(by_list.index[0], rel=0.4)


def test_a_cloud_takes_stars_away_in_its_part_of_the_field() -> None:
    setting = scenario(air={"cloud_magnitudes": [[0, 6.0]], "cloud_cover": 0.5})
    random = np.random.default_rng(1)
    some = PanoramaSource(STATION, setting, random).expose(setting.start_utc_ns, 0.05, 20.0)
    clear = PanoramaSource(STATION, scenario(), random).expose(setting.start_utc_ns, 0.05, 20.0)
    assert 0 < len(some.index) < 0.8 * len(clear.index)


def test_a_satellite_is_a_trail_in_a_long_exposure() -> None:
    setting = scenario(seconds=6, exposure_s=1.0, air={"satellites_per_minute": 60.0})
    utc_ns = setting.start_utc_ns + 3 * NS_PER_S
    with_satellites, without = (
        source(setting.model_copy(update={"air": air})).image(utc_ns, 1.0).astype(int)
        for air in (setting.air, setting.air.model_copy(update={"satellites_per_minute": 0.0}))
    )
    assert (with_satellites - without > 30).sum() > 50


def test_twilight_makes_the_sensor_report_overexposed_and_then_fewer_stars() -> None:
    counts = []
    for start in ("2026-03-20T11:05:00Z", "2026-03-20T11:32:00Z", "2026-03-20T12:30:00Z"):
        setting = scenario(start=start)
        seen = PanoramaSource(STATION, setting, np.random.default_rng(1)).expose(setting.start_utc_ns, 0.05, 20.0)
        counts.append(len(seen.index))
        assert seen.flags == (frozenset({"overexposed"}) if len(counts) == 1 else frozenset())
    assert counts[0] == 0 < counts[1] < counts[2]


def test_the_sky_is_brighter_near_the_moon_and_towards_the_sun() -> None:
    full_moon_ns, twilight_ns = from_text("2026-04-02T15:00:00Z"), from_text("2026-03-20T11:30:00Z")
    bodies = bodies_over(SITE, full_moon_ns)
    moon = bodies.track.directions(full_moon_ns)[MOON]
    near, far = sky_magnitude(np.array([moon, [0.3, 0.0, 0.95]]), bodies, full_moon_ns)
    assert moon[2] > 0.7
    assert near < far - 0.7
    assert 16.5 < far < 20  # some 18 at full Moon, 22 without
    evening = bodies_over(SITE, twilight_ns)
    west, zenith, east = sky_magnitude(np.array([[-0.7, 0, 0.7], [0, 0, 1.0], [0.7, 0, 0.7]]), evening, twilight_ns)
    assert west < zenith < east


def test_where_the_sun_is_up_it_is_down_on_the_other_side_of_the_earth() -> None:
    utc_ns, site = from_text(START), STATION.site
    longitude_deg = (site.longitude_deg + 360) % 360 - 180
    there = AstropySite(replace(site, latitude_deg=-site.latitude_deg, longitude_deg=longitude_deg))
    up_here, up_there = (bodies_over(of, utc_ns).track.directions(utc_ns)[SUN, 2] for of in (SITE, there))
    assert up_here == pytest.approx(-up_there, abs=0.01)
    assert abs(up_here) > 0.5


def test_the_full_moon_in_the_field_is_one_object_that_hides_its_rows() -> None:
    utc_ns = from_text("2026-04-02T15:00:00Z")
    east, north, up = bodies_over(SITE, utc_ns).track.directions(utc_ns)[MOON]
    mount = {"azimuth_deg": np.degrees(np.arctan2(east, north)), "altitude_deg": np.degrees(np.arcsin(up))}
    setting = scenario(start="2026-04-02T15:00:00Z", device={"mount": mount})
    seen = PanoramaSource(setting.device_for(STATION), setting, np.random.default_rng(1)).expose(utc_ns, 0.05, 20.0)
    assert seen.index[0] == 4096
    assert seen.xy_px[0] == pytest.approx([511.5, 511.5], abs=1)
    assert (np.abs(seen.xy_px[1:, 1] - 511.5) > 15).all()
    image = source(setting).image(utc_ns, 0.05)
    assert (image[505:518, 505:518] == 4096).all()
    assert 600 < (image == 4096).sum() < 2000  # half a degree: 18 px in radius


def test_the_lit_limb_of_a_half_moon_looks_to_the_sun() -> None:
    utc_ns = from_text("2026-03-25T12:00:00Z")  # the Moon is at its first quarter at 19:18 UTC
    bodies = bodies_over(SITE, utc_ns)
    sun, moon = bodies.track.directions(utc_ns)[[SUN, MOON]]
    mount = {"azimuth_deg": np.degrees(np.arctan2(moon[0], moon[1])), "altitude_deg": np.degrees(np.arcsin(moon[2]))}
    setting = scenario(start="2026-03-25T12:00:00Z", device={"mount": mount})
    camera, pointed = STATION.sensor.camera(), horizon_to_sensor(setting.device_for(STATION).mount)
    on_the_way = moon + 0.005 * (sun - moon)
    (xy_px, nearer_px) = camera.pixels(np.array([moon, on_the_way]) @ pointed.T)
    rows, columns = np.nonzero(source(setting).image(utc_ns, 0.001) > 1000)
    disc = np.hypot(columns - xy_px[0], rows - xy_px[1]) < 22
    sunwards = (np.column_stack([columns, rows])[disc] - xy_px) @ (nearer_px - xy_px)
    assert 0.4 < disc.sum() / (np.pi * (bodies.moon_radius_rad / camera.pixel_rad) ** 2) < 0.6
    assert (sunwards > 0).mean() > 0.9


def test_jupiter_is_an_object_where_it_is() -> None:
    utc_ns = from_text(START)
    bodies = bodies_over(SITE, utc_ns)
    jupiter = NAMES.index("jupiter")
    east, north, up = bodies.track.directions(utc_ns)[jupiter]
    mount = {"azimuth_deg": np.degrees(np.arctan2(east, north)), "altitude_deg": np.degrees(np.arcsin(up))}
    setting = scenario(device={"mount": mount})
    seen = PanoramaSource(setting.device_for(STATION), setting, np.random.default_rng(1)).expose(utc_ns, 0.05, 20.0)
    assert seen.xy_px[0] == pytest.approx([511.5, 511.5], abs=1.5)
    assert bodies.magnitude[jupiter] == pytest.approx(-2.2, abs=0.2)  # Astronomical Almanac 2026, March
