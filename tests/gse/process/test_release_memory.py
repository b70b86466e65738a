"""Memory that the program gives back."""

import subprocess
import sys

import pytest

_HOLES = """
import resource
from pathlib import Path
import numpy as np
from gse.process.release_memory import give_back

def resident():
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() / 2**20

give_back()
del_first = np.ones(31 << 17)
del del_first
arrays = [np.ones(200_000) for _ in range(60)]
most = resident()
arrays = arrays[::10] + arrays[-1:]
print(most - resident())
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="resident memory is read from Linux's files")
def test_a_large_array_is_given_back_once_it_is_freed_though_others_lie_behind_it():
    freed_mib = float(subprocess.run([sys.executable, "-c", _HOLES], check=True, capture_output=True, text=True).stdout)
    assert freed_mib > 70  # 53 arrays of 1.5 MiB


_LOADED_LATER = r"""
import re
from gse.process.release_memory import give_back

def resident_kib():
    maps = open("/proc/self/smaps").read()
    return int(re.search(r" r-xp .*openblas.*\n(?:.*\n)*?Rss: +(\d+) kB", maps)[1])

give_back()
import numpy
before = resident_kib()
give_back()
print(before, resident_kib())
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="resident memory is read from Linux's files")
def test_a_library_that_is_loaded_after_the_first_time_is_given_back_too():
    done = subprocess.run([sys.executable, "-c", _LOADED_LATER], check=True, capture_output=True, text=True)
    before_kib, after_kib = map(int, done.stdout.split())
    assert before_kib > 100
    assert after_kib < 0.75 * before_kib  # the system brings back some pages around each that is used


_WITH_PANDAS = """
import sys
from gse.process.release_memory import spare_pandas
spare_pandas()
import pyarrow
assert pyarrow.array([1.0]).to_pylist() == [1.0]
assert "pandas" not in sys.modules
import pandas
assert pandas.Series([1]).sum() == 1
"""


def test_pyarrow_does_not_import_pandas_which_others_still_find():
    subprocess.run([sys.executable, "-c", _WITH_PANDAS], check=True)
