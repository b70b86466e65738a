"""What a simulated sensor sees of the scene screen-fit, on a screen that differs from the stated one."""

import numpy as np

from gse.config.station import Station
from gse.imaging.screen_fit import ScreenFit, ScreenStars, fit_screen, seen_stars
from gse.imaging.session_fit import PanoramaSample, identified
from gse.simulator.panorama import PanoramaSource
from gse.simulator.scenario import Scenario, load_scenario
from gse.station.setup import set_up
from gse.values.instant import NS_PER_S
from gse.values.panorama import Panorama
from gse.values.screen import ShownSky


def fitted(station: Station, text: str, device: dict[str, object], seed: int, rate_hz: float = 2.0) -> ScreenFit:
    """The fit to one rehearsal; ``device`` changes the screen behind the station's back."""
    seen, sky = seen_by(station, text, device, seed, rate_hz)
    assert station.screen is not None
    return fit_screen(seen, sky, station.screen, station.sensor.camera(), station.sensor.index_max)


def seen_by(
    station: Station, text: str, device: dict[str, object], seed: int, rate_hz: float = 2.0
) -> tuple[ScreenStars, ShownSky]:
    """The stars of one rehearsal, and what the screen showed."""
    scenario = load_scenario("screen-fit").model_copy(update={"device": device})
    sample = PanoramaSample()
    for panorama in panoramas(station, scenario, seed, rate_hz):
        sample.add(panorama)
    setup = set_up(station, text, utc_ns=scenario.start_utc_ns)
    named, _ = identified(sample, setup.camera, setup.of_true_stars)
    sky, catalog = ShownSky(list(scenario.shown(scenario.start_utc_ns))), setup.of_true_stars.catalog
    return seen_stars(named, catalog.icrs, catalog.magnitude, sky), sky


def panoramas(station: Station, scenario: Scenario, seed: int, rate_hz: float) -> list[Panorama]:
    """One exposure after the other, in the middle of its period."""
    random = np.random.default_rng(seed)
    source = PanoramaSource(scenario.device_for(station), scenario, random, drawn_for=station.screen)
    taken = []
    for frame in range(round(scenario.seconds * rate_hz)):
        utc_ns = scenario.start_utc_ns + round((frame + 0.5) / rate_hz * NS_PER_S)
        seen = source.expose(utc_ns, scenario.exposure_s, 20.0)
        taken.append(Panorama(utc_ns, seen.xy_px, seen.index, exposure_s=scenario.exposure_s))
    return taken
