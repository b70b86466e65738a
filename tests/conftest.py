"""The same tests on any host, in an order that keeps its processors at work.

astropy reads the installed tables whatever the date, and signals are not ignored.
"""

import atexit
import functools
import gc
import os
import shutil
import signal
import sys
import tempfile
from pathlib import Path

import pytest
from astropy.utils import iers
from devices.command_line import Gse, runner
from hypothesis import settings

from gse.process.installation import cache_folder

TESTS = Path(__file__).parent

# What commands keep of sessions goes into a cache directory of this run; machine code and star tables are the user's.
_CACHE = Path(tempfile.mkdtemp(prefix="gse-tests-"), "gse")
_CACHE.mkdir()
cache_folder("machine-code").mkdir(parents=True, exist_ok=True)
for kept in cache_folder().iterdir():
    if kept.name != "results":
        (_CACHE / kept.name).symlink_to(kept)
os.environ["XDG_CACHE_HOME"] = str(_CACHE.parent)
atexit.register(shutil.rmtree, _CACHE.parent, ignore_errors=True)

gc.disable()  # until all tests are collected: what they import lasts

# A container often has Python keep no byte code: then each process that a test starts compiles all of gse, for 1.2 s.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# A busy host takes long, and the first example compiles. The same examples in each run: a test that fails was broken by
# a change. ``--hypothesis-profile default`` draws others.
settings.register_profile("any host", deadline=None, derandomize=True)
settings.load_profile("any host")

# A runner that was started in the background, or by nohup, hands ignored signals down to every process.
for name, handler in (("SIGINT", signal.default_int_handler), ("SIGHUP", signal.SIG_DFL)):
    number = getattr(signal, name, None)  # Windows has no SIGHUP
    if number is not None and signal.getsignal(number) is signal.SIG_IGN:
        signal.signal(number, handler)

WITH_LITTLE_MACHINE_CODE = tuple(
    TESTS / folder for folder in ("drivers", "gse/config", "gse/statistics", "gse/truth", "gse/values", "protocols")
)
"""Folders whose tests compile next to nothing: in a fresh clone they run while the tutorial compiles for all."""

WITH_THE_SEARCH = ("test_counted_frames.py", "test_not_run.py")
"""Files of these folders that identify stars: so early they would compile second copies of the search, 25 s each."""

LONG = ("test_cluster.py", "test_without_posix.py", "test_neighbour.py", "test_browser.py")
"""Files that take long and wait much: begun last, they would leave a processor without work at the end.

And one that compiles a search of which others would else compile a second copy at the same time.
"""


def pytest_configure(config: pytest.Config) -> None:
    """Each worker begins to collect at another file: what one has compiled in a fresh clone, the others then read."""
    worker = getattr(config, "workerinput", None)
    if worker is not None and [Path(of) for of in config.args] == [Path(TESTS.name)]:
        files = sorted(str(path) for path in TESTS.rglob("test_*.py"))
        first = len(files) * int(worker["workerid"].removeprefix("gw")) // worker["workercount"]
        config.args[:] = files[first:] + files[:first]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the tutorial, with what needs little machine code, and with the longest files."""
    items.sort(key=lambda item: (_turn(item.path), str(item.path)))


@functools.cache
def _turn(path: Path) -> int:
    if path.name == "test_tutorial.py":
        return 0
    if path.name not in WITH_THE_SEARCH and any(path.is_relative_to(folder) for folder in WITH_LITTLE_MACHINE_CODE):
        return 1
    return 2 if path.name in LONG else 3


def pytest_collection_finish() -> None:
    """Look for garbage as seldom as the program does (gse.__main__), and not in all that the tests imported."""
    gc.set_threshold(50_000)
    gc.freeze()
    gc.enable()


def pytest_xdist_auto_num_workers() -> int:
    """One worker more than there are processors: many tests wait for a clock, a disk or another process."""
    return (os.cpu_count() or 1) + 1


iers.conf.auto_download = False
# By default astropy refuses predictions 30 days after they were issued, and expired leap seconds, by the host's clock.
iers.conf.auto_max_age = None


@pytest.fixture(scope="session", autouse=True)
def _installed_earth_orientation():
    """The tables that IERS_Auto would use, without its question for today's date."""
    with iers.earth_orientation_table.set(iers.IERS(iers.IERS_Auto.read())):
        yield


@pytest.fixture
def gse(capsys: pytest.CaptureFixture[str]) -> Gse:
    """The command line, in this process."""
    return runner(capsys)
