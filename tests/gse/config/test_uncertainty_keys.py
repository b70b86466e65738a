"""``uncertainty:`` in the station file: units in the keys, wrong ones refused in words."""

import re

import pytest

from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.errors import ConfigError

MOUNT, SITE = "  roll_deg: 0\n", "  height_m: 250\n"


def with_mount(keys):
    return BUILT_IN_TEXT.replace(MOUNT, f"{MOUNT}  uncertainty: {keys}\n")


def test_what_is_stated_is_in_force_and_the_rest_has_its_default():
    station = parse_station(
        with_mount("{azimuth_arcsec: 3}").replace(SITE, SITE + "  uncertainty: {pressure_hpa: 1}\n")
    )
    assert (station.mount.uncertainty.azimuth_arcsec, station.mount.uncertainty.altitude_arcsec) == (3.0, 10.0)
    assert (station.site.pressure_uncertainty_hpa, station.site.temperature_uncertainty_c) == (1.0, 3.0)
    unstated = parse_station(
        BUILT_IN_TEXT.replace("  pressure_hpa: 985\n", "").replace("  temperature_c: 25\n", "")
    ).site
    assert (unstated.pressure_uncertainty_hpa, unstated.temperature_uncertainty_c) == (20.0, 15.0)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        (
            "{azimuth_arcsec: -3}",
            r"mount\.uncertainty\.azimuth_arcsec is -3: expected at least 0",
        ),
        ("{azimuth: 3}", r"unknown key mount\.uncertainty\.azimuth; did you mean azimuth_arcsec.*ends in its unit"),
        ("{azimuth_arcsec: .inf}", r"azimuth_arcsec is inf"),
        ("{azimuth_arcsec: .nan}", r"azimuth_arcsec is nan"),
        ("{azimuth_arcsec: 3 deg}", r"azimuth_arcsec is '3 deg'"),
        ("{from: survey}", r"mount: uncertainty.from is 'survey': expected align, or no such key"),
        ("10", r"mount\.uncertainty is 10"),
    ],
)
def test_an_uncertainty_without_sense_is_refused_with_line_and_key(keys, words):
    with pytest.raises(ConfigError, match=words) as refused:
        parse_station(with_mount(keys))
    assert re.search("line (16|20)", str(refused.value))  # of the key, or of its section


def test_what_a_fit_found_is_told_from_what_was_surveyed():
    assert parse_station(with_mount("{azimuth_arcsec: 3, from: align}")).mount.uncertainty.fitted
    assert not parse_station(with_mount("{azimuth_arcsec: 3}")).mount.uncertainty.fitted
