"""Sidereal truth: how far from astropy and skyfield over 100,000 cases, and how long it takes.

    python benchmarks/truth.py

Needs the test dependencies: the cases and the comparison are those of tests/gse/truth/test_against_astropy.py and
test_against_skyfield.py.
"""

import os
import sys
import time
from pathlib import Path

import numpy as np
from astropy.utils import iers

from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.truth import EarthOrientation, SiderealTruth
from gse.values.instant import NS_PER_S, from_text

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "gse" / "truth"))

BATCHES, BATCH = 10, 10_000
EPOCHS = 100_000
FRAMES = 2000
ARCSEC = np.pi / 180 / 3600
STATION = parse_station(BUILT_IN_TEXT)


def main() -> None:
    """Compare, time, and print the table."""
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}; times are processor time")
    start_ns = from_text("2026-03-20T15:00:00Z")
    truth = SiderealTruth(STATION.site, EarthOrientation.from_disk(start_ns))
    epochs_ns = start_ns + np.arange(EPOCHS) * (NS_PER_S // 4)
    truth.icrs_to_horizon_at(epochs_ns[:2])
    began_s = time.process_time()
    truth.icrs_to_horizon_at(epochs_ns)
    epoch_us = (time.process_time() - began_s) / EPOCHS * 1e6
    print(f"rotations at {EPOCHS} epochs of a night  {epoch_us:8.2f} us per epoch  (<= 5)")
    stars = np.random.default_rng(1).normal(size=(30, 3))
    stars /= np.linalg.norm(stars, axis=1)[:, None]
    times_us = sorted(_live_frame_us(truth, stars, start_ns + k * NS_PER_S // 10) for k in range(FRAMES))
    print(f"one live frame of 30 stars, median          {times_us[FRAMES // 2]:8.1f} us  (<= 300)")
    print(f"one live frame of 30 stars, 99 %            {times_us[FRAMES * 99 // 100]:8.1f} us")
    for air in (False, True):
        where = "in air" if air else "in vacuum"
        print(f"worst of {BATCHES * BATCH} against astropy, {where:9}  {_worst_arcsec(air):8.5f} arcsec  (<= 0.01)")
    print(f"worst of {BATCHES * BATCH} against skyfield, horizon  {_worst_of_skyfield_arcsec():8.5f} arcsec  (<= 0.01)")


def _live_frame_us(truth: SiderealTruth, stars_icrs: np.ndarray, utc_ns: int) -> float:
    """All that one frame asks of truth: mount, apparent places, refraction."""
    began_s = time.process_time()
    truth.attitude_true(utc_ns, STATION.mount)
    zenith = truth.icrs_to_horizon(utc_ns)[2]
    truth.apparent(stars_icrs, utc_ns)
    truth.unrefracted(stars_icrs, zenith)
    return (time.process_time() - began_s) * 1e6


def _worst_arcsec(air: bool) -> float:
    from test_against_astropy import random_cases, truths_of, worst_rad

    worst = 0.0
    with iers.conf.set_temp("auto_download", False):
        for seed in range(BATCHES):
            cases = random_cases(np.random.default_rng(seed), BATCH)
            worst = max(worst, worst_rad(cases, truths_of(cases), air=air))
    return float(worst / ARCSEC)


def _worst_of_skyfield_arcsec() -> float:
    import test_against_skyfield as skyfield

    return float(skyfield.worst_rad(skyfield.random_cases(np.random.default_rng(0), BATCHES * BATCH)) / ARCSEC)


if __name__ == "__main__":
    main()
