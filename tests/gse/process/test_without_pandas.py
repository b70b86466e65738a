"""Commands do without pandas, where it is installed too."""

import subprocess
import sys

_LINES = """
import sys
from gse.process.without_pandas import spare_pandas
spare_pandas()
import pyarrow
assert pyarrow.array([1.0]).to_pylist() == [1.0]
assert "pandas" not in sys.modules
import pandas
assert pandas.Series([1]).sum() == 1
"""


def test_pyarrow_does_not_import_pandas_which_others_still_find():
    subprocess.run([sys.executable, "-c", _LINES], check=True)
