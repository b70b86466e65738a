"""The air of a site: by hand from ISO 2533, and how well each entry is known."""

import pytest

from gse.values.site import Site, SiteUncertainty


def site(**entries):
    return Site(latitude_deg=-6.9, longitude_deg=107.6, **entries)


@pytest.mark.parametrize(
    ("height_m", "pressure_hpa", "temperature_c"),
    [(0.0, 1013.25, 15.0), (1000.0, 898.75, 8.5), (2000.0, 794.95, 2.0), (5000.0, 540.20, -17.5)],
)
def test_air_that_is_not_entered_is_that_of_the_standard_atmosphere(height_m, pressure_hpa, temperature_c):
    """The table of ISO 2533, by geopotential height."""
    made = site(height_m=height_m)
    assert made.air_pressure_hpa == pytest.approx(pressure_hpa, abs=0.05)
    assert made.air_temperature_c == pytest.approx(temperature_c, abs=0.01)


def test_air_that_is_entered_is_taken_as_it_is():
    made = site(height_m=2000.0, pressure_hpa=0.0, temperature_c=0.0)
    assert (made.air_pressure_hpa, made.air_temperature_c) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("entries", "hpa", "kelvin"),
    [
        ({}, 20.0, 15.0),
        ({"pressure_hpa": 925.0}, 3.0, 15.0),
        ({"temperature_c": 20.0}, 20.0, 3.0),
        ({"uncertainty": SiteUncertainty(pressure_hpa=0.0, temperature_c=0.0)}, 0.0, 0.0),
        ({"pressure_hpa": 925.0, "uncertainty": SiteUncertainty(pressure_hpa=1.0, temperature_c=1.5)}, 1.0, 1.5),
    ],
)
def test_what_is_entered_is_known_better_than_what_follows_from_the_height(entries, hpa, kelvin):
    made = site(height_m=770.0, **entries)
    assert (made.pressure_uncertainty_hpa, made.temperature_uncertainty_c) == (hpa, kelvin)


@pytest.mark.parametrize(
    ("pressure_hpa", "is_doubtful"),
    [(898.75, False), (928.5, False), (929.5, True), (869.0, False), (868.0, True), (1013.0, True), (0.0, False)],
)
def test_a_pressure_that_the_weather_cannot_make_at_a_height_is_doubted(pressure_hpa, is_doubtful):
    """At 1000 m, 30 hPa about 898.75; none at all is a site without air."""
    assert bool(site(height_m=1000.0, pressure_hpa=pressure_hpa).pressure_doubt()) is is_doubtful
