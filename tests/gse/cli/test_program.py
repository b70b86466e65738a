"""The program from its very start."""

import subprocess
import sys

INTERRUPTED_AT_AN_IMPORT = """
import runpy, signal, sys

class Finder:
    @staticmethod
    def find_spec(name, path=None, target=None):
        if name == "pydantic":
            signal.raise_signal(signal.SIGINT)

sys.meta_path.insert(0, Finder)
runpy.run_module("gse", run_name="__main__")
"""


def test_ctrl_c_while_the_packages_are_imported_ends_without_a_traceback() -> None:
    done = subprocess.run([sys.executable, "-c", INTERRUPTED_AT_AN_IMPORT], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "")


def test_the_program_starts_as_a_module() -> None:
    done = subprocess.run([sys.executable, "-m", "gse", "--version"], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
