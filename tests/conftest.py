"""astropy as an authority reads the tables that are installed, whatever the clock of the host says."""

import pytest
from astropy.utils import iers

iers.conf.auto_download = False
# By default astropy refuses predictions 30 days after they were issued, and expired leap seconds, by the host's clock.
iers.conf.auto_max_age = None


@pytest.fixture(scope="session", autouse=True)
def _installed_earth_orientation():
    """The tables that IERS_Auto would use, without its question for today's date."""
    with iers.earth_orientation_table.set(iers.IERS(iers.IERS_Auto.read())):
        yield
