"""The same bytes give the same report on every processor, in a notebook, in any time zone and in any language.

On one session two of OpenBLAS's kernels did not agree: a term of 0.0005 arcsec lies half way between two printed
figures. tests/gse/campaign/test_cluster.py has it judged by a worker of Dask. A golden one has a sensor's own answers.
"""

import os
import platform
import shutil
import struct
import subprocess
import sys
from pathlib import Path

import pytest

from gse.api import judge
from gse.cli import EXIT_FAIL, main
from gse.sessions.kept_results import results_folder

FILES = ("report.json", "report.html", "frames.csv", "junit.xml")
NOTEBOOK = """
import sys
import numpy as np
np.ones((300, 300)) @ np.ones((300, 300))
import gse
print(gse.judge(sys.argv[1]).verdict)
"""
LEAP_SECONDS = 27
"""From 1972 to 2017, as tzdata's right/UTC counts them."""

of_x86 = platform.machine() in ("x86_64", "AMD64")
LESS = "AVX2 FMA3 AVX512F AVX512_SKX X86_V3 X86_V4"
"""Instructions that a lesser processor lacks, as numpy names them."""
OWN_ANSWERS = Path(__file__).parents[3] / "replays" / "golden" / "own-answers.mcap"


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("half-way") / "night.mcap"
    with pytest.raises(SystemExit):
        main(["simulate", "--scenario", "inclined", "--seed", "13", "--seconds", "2", "--file", str(path)])
    return path


def files_in(out: Path) -> dict[str, bytes]:
    return {name: next(out.glob(f"*/{name}")).read_bytes() for name in FILES}


@pytest.mark.skipif(not of_x86, reason="these kernels are x86-64's")
def test_a_notebook_leaves_the_same_tables_to_the_last_bit_whichever_kernel_its_numpy_took(session, tmp_path):
    """This process has the kernel of its processor, which is no Nehalem."""
    here, there = tmp_path / "here.mcap", tmp_path / "there.mcap"
    for copy in (here, there):
        shutil.copy(session, copy)
    judge(here)
    command = [sys.executable, "-c", NOTEBOOK, there]
    subprocess.run(command, env=os.environ | {"OPENBLAS_CORETYPE": "Nehalem"}, check=True, stdout=subprocess.DEVNULL)
    assert {"frames.parquet", "sessions.parquet", "stars.parquet"} <= tables_of(here).keys()
    assert tables_of(here) == tables_of(there)


def tables_of(session: Path) -> dict[str, bytes]:
    """What the judgement of a session leaves, of every digit."""
    return {path.name: path.read_bytes() for path in results_folder(session).glob("*/*.parquet")}


def said_by_python(code: str, environment: dict[str, str]) -> str:
    return subprocess.check_output([sys.executable, "-c", code], env=os.environ | environment, text=True).strip()


def test_a_command_gives_the_same_report_on_a_lesser_processor_with_leap_seconds_and_a_comma(tmp_path):
    """At once: each alone would change it."""
    odd = {"OPENBLAS_CORETYPE": "Nehalem", "NPY_DISABLE_CPU_FEATURES": LESS} if of_x86 else {}
    if sys.platform == "linux":  # a time zone that counts leap seconds is glibc's
        zone = tmp_path / "right-utc"
        zone.write_bytes(leap_seconds_file())
        odd |= {"TZ": f":{zone}"}
        assert said_by_python("import time; print(time.gmtime(10**9).tm_sec)", odd) == str((40 - LEAP_SECONDS) % 60)
    if Path("/usr/share/i18n/locales/de_DE").exists():  # Debian's locales
        folder = tmp_path / "locales"
        folder.mkdir()
        subprocess.run(["localedef", "-i", "de_DE", "-f", "ISO-8859-1", folder / "de_DE"], capture_output=True)
        odd |= {"LOCPATH": str(folder), "LC_ALL": "de_DE", "PYTHONUTF8": "0"}
        assert said_by_python("import locale; locale.setlocale(locale.LC_ALL, ''); print(f'{1.5:n}')", odd) == "1,5"
    words = ["replay", str(OWN_ANSWERS), "--out"]
    command = [sys.executable, "-m", "gse", *words, tmp_path / "there"]
    assert subprocess.run(command, env=os.environ | odd, capture_output=True).returncode == EXIT_FAIL
    with pytest.raises(SystemExit):
        main([*words, str(tmp_path / "here")])
    assert files_in(tmp_path / "there") == files_in(tmp_path / "here")


def leap_seconds_file() -> bytes:
    """UTC as a time zone file (RFC 8536) whose clock counts leap seconds: its type, its name, the leap seconds."""
    header = b"TZif" + bytes(16) + struct.pack(">6l", 0, 0, LEAP_SECONDS, 0, 1, 4)
    years = (struct.pack(">2l", 78_796_800 + number * 31_536_000, number + 1) for number in range(LEAP_SECONDS))
    return header + struct.pack(">lBB", 0, 0, 0) + b"UTC\0" + b"".join(years)
