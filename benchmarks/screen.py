"""What a screen as sky is good for: its fit, its stars in a real browser, and its speed.

    python benchmarks/screen.py fit [--draws 40]

``fit`` rehearses the scene screen-fit before screens whose values differ from the stated ones, and tells in how many
draws each parameter of the fit lies within its stated half-width of 95 %. Prints Markdown tables.
"""

import argparse
import sys
from pathlib import Path

import numpy as np

from gse.config.station import parse_station
from gse.values.screen import Screen

sys.path.append(str(Path(__file__).parents[1] / "tests"))

from devices.screen_panoramas import fitted

LAB = """\
version: 1
sensor: {name: lab, rows: 1024, columns: 1024, focal_length_px: 4170}
site: {name: lab, latitude_deg: 48, longitude_deg: 11, height_m: 500}
mount: {inertial: {ra_deg: 83, de_deg: -2}}
screen: {pixel_pitch_mm: 0.1, columns: 1920, rows: 1080, focal_length_mm: 500}
protocol: panorama-v1-subpixel
"""
NAMES = ("x_deg", "y_deg", "roll_deg", "focal_length_mm", "k1", "k2", "gamma", "latency_ms")
SPREAD = np.array([1.0, 1.0, 10.0, 3.0, 0.01, 0.005, 0.2, 20.0])
"""Standard deviations of the real values about the stated ones."""


def fits(draws: int) -> None:
    """A table of the parameters with the share of the draws inside, and the root mean square of the errors."""
    station, off, widths = parse_station(LAB), [], []
    for seed in range(draws):
        real = _real(np.random.default_rng(1000 + seed))
        screen = fitted(station, LAB, {"screen": _keys(real)}, seed).screen
        off.append(_values(screen) - real)
        widths.append(_half_widths(screen))
    off_all, width_all = np.array(off), np.array(widths)
    print("| parameter | inside 95 % | rms error | mean half-width |", "|---|---|---|---|", sep="\n")
    for place, name in enumerate(NAMES):
        inside = int((np.abs(off_all[:, place]) <= width_all[:, place]).sum())
        rms = float(np.sqrt((off_all[:, place] ** 2).mean()))
        print(f"| {name} | {inside} of {draws} | {rms:.3g} | {width_all[:, place].mean():.3g} |")


def _real(random: np.random.Generator) -> np.ndarray:
    """The values of one draw; a latency is never negative."""
    values = np.array([0.0, 0.0, 0.0, 500.0, 0.0, 0.0, 2.2, 30.0]) + SPREAD * random.normal(size=len(NAMES))
    values[-1] = max(values[-1], 1.0)
    return values


def _keys(values: np.ndarray) -> dict[str, object]:
    x, y, roll, focal, k1, k2, gamma, latency = values.tolist()
    looks = {"x_deg": x, "y_deg": y, "roll_deg": roll}
    lens = {"focal_length_mm": focal, "radial_distortion": [k1, k2]}
    return {**lens, "gamma": gamma, "latency_ms": latency, "to_sensor": looks}


def _values(screen: Screen) -> np.ndarray:
    looks = screen.to_sensor
    assert screen.focal_length_mm is not None
    lens = screen.focal_length_mm, *screen.radial_distortion
    return np.array([looks.x_deg, looks.y_deg, looks.roll_deg, *lens, screen.gamma, screen.latency_ms])


def _half_widths(screen: Screen) -> np.ndarray:
    known, looks = screen.uncertainty, screen.to_sensor.uncertainty
    across_deg, roll_deg = looks.across_arcsec / 3600, looks.roll_arcsec / 3600
    lens = known.away_mm, *known.radial_distortion
    return np.array([across_deg, across_deg, roll_deg, *lens, known.gamma, screen.latency_uncertainty_ms])


def main() -> None:
    """The figures that the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("fit",))
    parser.add_argument("--draws", type=int, default=40)
    asked = parser.parse_args()
    if asked.what == "fit":
        fits(asked.draws)


if __name__ == "__main__":
    main()
