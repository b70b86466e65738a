"""The same tests on any host: astropy reads the installed tables whatever the date, and signals are not ignored."""

import signal

import pytest
from astropy.utils import iers

# A runner that was started in the background, or by nohup, hands ignored signals down to every process.
for number, handler in ((signal.SIGINT, signal.default_int_handler), (signal.SIGHUP, signal.SIG_DFL)):
    if signal.getsignal(number) is signal.SIG_IGN:
        signal.signal(number, handler)

FIRST = ("test_tutorial.py", "test_cluster.py", "test_later_dates.py", "test_without_posix.py", "test_endings.py")
"""Files that take long and wait much: begun last, they would leave a processor without work at the end."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the longest files."""
    items.sort(key=lambda item: FIRST.index(item.path.name) if item.path.name in FIRST else len(FIRST))


iers.conf.auto_download = False
# By default astropy refuses predictions 30 days after they were issued, and expired leap seconds, by the host's clock.
iers.conf.auto_max_age = None


@pytest.fixture(scope="session", autouse=True)
def _installed_earth_orientation():
    """The tables that IERS_Auto would use, without its question for today's date."""
    with iers.earth_orientation_table.set(iers.IERS(iers.IERS_Auto.read())):
        yield
