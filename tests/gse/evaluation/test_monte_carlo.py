import json
import os
import re
import signal
import subprocess
import sys

import numpy as np
import pytest
from devices.patience import PATIENCE_S

from gse.evaluation.plan import CpuTimes, interval
from gse.statistics.sampling import percentiles


def evaluated(gse, *options):
    done = gse("evaluate", "--json", *options)
    assert done.code == 0, done.err
    return json.loads(done.out)


def without_times(document):
    for cell in document["cells"]:
        del cell["cpu_ms"]
    return document


def test_a_seed_gives_the_same_on_any_number_of_workers(gse):
    options = ("--frames", 12, "--noise-arcsec", 10, "--noise-arcsec", 60, "--false-objects", 3, "--seed", 7)
    alone = without_times(evaluated(gse, *options))
    assert without_times(evaluated(gse, *options, "--workers", 2)) == alone


def test_every_frame_is_counted_once(gse):
    document = evaluated(gse, "--preset", "pivot-paper", "--frames", 12, "--seed", 3)
    assert document["schema"] == "gse.evaluation/1"
    keys = ("identifier", "noise_arcsec", "magnitude_noise", "sky_limit")
    assert [tuple(cell[key] for key in keys) for cell in document["cells"]] == [
        (name, *noise, sky)
        for name in ("pivot", "match-group")
        for noise in (*((arcsec, 0.1) for arcsec in (10, 20, 30, 40, 50)), *((10, mag) for mag in (0.2, 0.3, 0.4, 0.5)))
        for sky in (5.7, 7.5)
    ]
    for cell in document["cells"]:
        counted = sum(rate["count"] for rate in cell["rates"].values())
        assert counted == cell["frames_counted"]
        assert counted + sum(cell["excluded"].values()) == cell["frames_done"] == 12
        low, high = cell["rates"]["right"]["interval"]
        assert low <= cell["rates"]["right"]["share"] <= high
    assert document["cells"][0]["rates"]["right"]["share"] > 0.85


def test_stars_beyond_the_catalogue_that_noise_lets_appear_are_stars_that_pivot_does_not_know(gse):
    """With hardly any magnitude noise none appears; with 0.5 mag one frame in five is lost to them."""
    options = ("--preset", "pivot-paper", "--identifier", "pivot", "--frames", 150, "--noise-arcsec", 10)
    cells = evaluated(gse, *options, "--magnitude-noise", 0.0, "--magnitude-noise", 0.5)["cells"]
    right = {(cell["magnitude_noise"], cell["sky_limit"]): cell["rates"]["right"]["share"] for cell in cells}
    for noise, least, most in ((0.0, -0.02, 0.02), (0.5, 0.1, 0.5)):
        assert least <= right[noise, 5.7] - right[noise, 7.5] <= most


def test_the_table_of_the_pivot_paper_has_a_column_and_a_line_of_each_figure_for_each_sky(gse, tmp_path):
    options = ("--preset", "pivot-paper", "--frames", 20, "--identifier", "pivot", "--noise-arcsec", 10)
    noise = ("--magnitude-noise", 0.1, "--magnitude-noise", 0.5)
    done = gse("evaluate", *options, *noise, "--sky-to", 8, "--figures", tmp_path / "figures")
    assert done.code == 0, done.err
    assert max(len(line) for line in done.out.splitlines()) <= 80
    assert re.search(r"^ +sky to 5.7 mag +sky to 8 mag$", done.out, re.MULTILINE)
    assert "eq 1: 821 fields; eq 2: 871 stars to magnitude 4.5" in done.out  # the paper's numbers
    figure = (tmp_path / "figures" / "success-magnitude.svg").read_text(encoding="utf-8")
    assert all(f"<!-- pivot, 10 arcsec, sky to {limit} -->" in figure for limit in ("5.7", "8"))


def test_the_stars_that_step_2_names_are_scored_one_by_one(gse):
    """At 5 arcmin of noise some distances fit stars that are not the right ones."""
    options = ("--preset", "pivot-paper", "--frames", 60, "--identifier", "pivot", "--magnitude-noise", 0.1)
    cells = evaluated(gse, *options, "--noise-arcsec", 10, "--noise-arcsec", 300)["cells"]
    right, poor = (cell["step_2"] for cell in cells if cell["sky_limit"] == 5.7)
    assert right["named"] > 50
    assert right["right"] == right["named"]
    assert poor["right"] < poor["named"]


def test_the_table_shows_what_went_wrong_beside_what_went_right(gse, tmp_path):
    done = gse("evaluate", "--preset", "lapan", "--frames", 8, "--figures", tmp_path / "figures")
    assert done.code == 0, done.err
    lines = [line.split() for line in done.out.splitlines() if line.startswith("neighbour")]
    assert [line[3] for line in lines] == ["0", "3", "8"] * 2
    assert max(len(line) for line in done.out.splitlines()) <= 80
    assert all(word in done.out for word in ("right %", "false %", "none %", "coarse %", "95 % bounds"))
    for name, unit in (("success-distance.svg", "arcsec"), ("success-magnitude.svg", "mag")):
        assert unit in (tmp_path / "figures" / name).read_text(encoding="utf-8")
    again = gse("evaluate", "--frames", 8, "--figures", tmp_path / "figures")
    assert again.code == 2
    assert "exists already" in again.err


def test_random_pixels_are_not_called_right(gse):
    """With noise of degrees nothing of the sky is left in a frame."""
    rates = evaluated(gse, "--frames", 3, "--noise-arcsec", 3600)["cells"][0]["rates"]
    assert rates["right"]["count"] == 0


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--noise-arcsec", "nan"), "nan"),
        (("--missing", "1.5"), "1.5"),
        (("--frames", "0"), "frames"),
        (("--preset", "pivot-paper", "--identifier", "robust"), "pivot and match-group only"),
        (("--preset", "pivot-paper", "--false-objects", "3"), "no pixels"),
        (("--preset", "lapan", "--sky-to", "7.5"), "--preset pivot-paper"),
        (("--preset", "pivot-paper", "--sky-to", "4"), "as faint as its limit"),
        (("--preset", "lapan", "--station", "any.yaml"), "camera"),
        (("--catalog", "no-such-file"), "no-such-file"),
    ],
)
def test_bad_options_are_refused(gse, options, words):
    done = gse("evaluate", *options)
    assert done.code == 2
    assert words in done.err


def test_the_interval_is_that_of_the_beta_distribution():
    from scipy.stats import beta

    assert interval(90, 100) == pytest.approx((beta.ppf(0.025, 90, 11), beta.ppf(0.975, 91, 10)), abs=1e-9)
    assert interval(0, 0) is None


INTERRUPTED_RUN = """
import signal, sys
from gse.cli import main

try:
    main(["evaluate", "--frames", "2"])  # what is compiled and cached once does not count
except SystemExit:
    sys.stdout.flush()
print("ready", flush=True)
signal.signal(signal.SIGVTALRM, lambda *_: signal.raise_signal(signal.SIGINT))
signal.setitimer(signal.ITIMER_VIRTUAL, 1.2)
hard = ["--noise-arcsec", "50", "--magnitude-noise", "0.5", "--false-objects", "8", "--missing", "0.2"]
main(["evaluate", "--json", "--frames", "20000", *hard])
"""


@pytest.mark.skipif(not hasattr(signal, "SIGVTALRM"), reason="this system cannot interrupt after some CPU time")
def test_ctrl_c_keeps_what_is_done():
    """The frames are hard ones, so that it comes in compiled code, which makes another exception of it."""
    done = subprocess.run(
        [sys.executable, "-c", INTERRUPTED_RUN], capture_output=True, text=True, timeout=2 * PATIENCE_S
    )
    assert done.returncode == 130, done.stderr
    document = json.loads(done.stdout.split("ready\n")[1])
    assert document["interrupted"] is True
    assert 0 < document["cells"][0]["frames_done"] < 20_000


INTERRUPTED_WORKERS = """
import os, psutil, signal, threading, time
from gse.cli import main

def interrupt():
    while len(psutil.Process().children()) < 2:
        time.sleep(0.005)
    os.killpg(0, signal.SIGINT)

threading.Thread(target=interrupt).start()
main(["evaluate", "--json", "--frames", "1000000", "--workers", "2"])
"""


@pytest.mark.skipif(not hasattr(os, "killpg"), reason="this system cannot interrupt a group of processes")
def test_workers_that_start_when_ctrl_c_comes_end_without_a_word():
    command, options = [sys.executable, "-c", INTERRUPTED_WORKERS], {"timeout": PATIENCE_S, "start_new_session": True}
    done = subprocess.run(command, capture_output=True, text=True, **options)
    assert done.returncode == 130, done.stderr
    assert json.loads(done.stdout)["interrupted"] is True
    assert done.stderr.splitlines() == ["interrupted: the result is that of the frames done so far"]


def test_percentiles_of_counted_times_are_those_of_the_times():
    times_us = np.exp(np.random.default_rng(3).normal(5.0, 2.0, size=1001))
    times, counted = np.append(times_us, np.nan), CpuTimes()
    for time_us in times:
        counted.add(time_us)
    found, expected = counted.percentiles(), percentiles(times)
    assert (counted.frames, found.n) == (1002, 1001)
    for name in ("p50", "p95", "p99", "max"):
        assert getattr(found, name) == pytest.approx(getattr(expected, name), rel=1e-3)
    assert CpuTimes().percentiles().n == 0
