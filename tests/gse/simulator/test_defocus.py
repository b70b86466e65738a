"""A lens that goes out of focus, at the level of panoramas."""

import numpy as np
import pytest

from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.errors import ConfigError
from gse.simulator.panorama import PanoramaSource
from gse.simulator.scenario import parse_scenario
from gse.values.instant import NS_PER_S

TEXT = "text: mine\noptics: {magnitude_noise: 0, defocus: [[0, 1], [10, 2]]}\n"


def test_stars_twice_as_wide_have_a_quarter_of_their_peaks_and_the_faint_ones_go():
    scenario = parse_scenario(TEXT, "mine")
    source = PanoramaSource(parse_station(BUILT_IN_TEXT), scenario, np.random.default_rng(1))
    sharp, wide = (source.expose(scenario.start_utc_ns + at_s * NS_PER_S, 0.05, 20.0) for at_s in (0, 10))
    background = 21.0
    assert wide.index[0] - background == pytest.approx((sharp.index[0] - background) / 4, rel=0.05)
    assert len(wide.index) < len(sharp.index) / 2


def test_a_star_narrower_than_in_focus_is_refused():
    with pytest.raises(ConfigError, match="defocus"):
        parse_scenario(TEXT.replace("[0, 1]", "[0, 0.5]"), "mine")
