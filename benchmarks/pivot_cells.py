"""Cells of the pivot paper: what they save in step 2, and as knowledge a priori in step 1.

    python benchmarks/pivot_cells.py [DIRECTIONS]

The sky, the field and the noise are those of ``gse evaluate --preset pivot-paper``: 10 and 50 arcsec on each angle, 0.1
mag. Pairs are counted as the paper's own step 2 would meet them: a new pattern for each star, its pairs taken from the
whole table by their length, with and without the cells of the group. Times are CPU of one search, medians.
"""

import argparse
import statistics
import time
from dataclasses import replace

import numpy as np

from gse.catalog import load_catalog
from gse.evaluation.frames import Conditions, FrameMaker
from gse.evaluation.monte_carlo import of_angles
from gse.evaluation.paper_sky import PaperSky
from gse.evaluation.plan import GAIA_LIMIT, PIVOT_PAPER, PRESETS, Plan
from gse.identifier.consistency import Separations
from gse.identifier.pivot import PivotIdentifier
from gse.identifier.result import Unidentified
from gse.identifier.tables import pair_table
from gse.values.constants import ARCSEC_RAD
from gse.values.spiral import spiral_directions

REPEATED = 5
Seen = tuple[Separations, np.ndarray, np.ndarray]
Before = np.ndarray | None


def seen(
    noise_arcsec: float, count: int, optics: object, source: object
) -> list[tuple[Separations, np.ndarray, np.ndarray]]:
    """Angles, brightness and star ids of frames with three stars or more."""
    conditions = Conditions("angles", 0.0, 0.1, whole_pixels=False, merge_px=0.0)
    maker, rng, found = FrameMaker(optics, conditions, source), np.random.default_rng(5), []
    for direction in spiral_directions(count):
        frame = maker.frame(direction, rng)
        v = frame.directions_sensor
        if frame.real_stars < 3:
            continue
        noise = np.triu(rng.normal(0, noise_arcsec * ARCSEC_RAD, (len(v), len(v))), 1)
        angles = np.abs(np.arccos(np.clip(v @ v.T, -1, 1)) + noise + noise.T)
        np.fill_diagonal(angles, 0.0)
        found.append((Separations(np.cos(angles), np.sin(angles)), frame.brightness, frame.star_ids))
    return found


def median_us(identifier: PivotIdentifier, frames: list[Seen], before: list[Before]) -> float:
    """Median over the frames of the least time of a search."""
    times = []
    for (angles, brightness, _), stars in zip(frames, before, strict=True):
        best = 10**12
        for _ in range(REPEATED):
            began_ns = time.thread_time_ns()
            identifier.identify_angles(angles, brightness, before=stars)
            best = min(best, time.thread_time_ns() - began_ns)
        times.append(best / 1000)
    return statistics.median(times)


def outcomes(identifier: PivotIdentifier, frames: list[Seen], before: list[Before]) -> tuple[int, int, int, int]:
    """Frames whose first star is right, is false; stars named by step 2, and how many of them are right."""
    right = false = named = named_right = 0
    for (angles, brightness, ids), stars in zip(frames, before, strict=True):
        answer = identifier.identify_angles(angles, brightness, before=stars)
        if isinstance(answer, Unidentified):
            continue
        same = identifier.catalog.ids[answer[1]] == ids[answer[0]]
        right, false = right + bool(same[0]), false + (not same[0])
        named, named_right = named + len(same[4:]), named_right + int(same[4:].sum())
    return right, false, named, named_right


def pairs_met(identifier: PivotIdentifier, frames: list[Seen], tolerance_rad: float) -> tuple[float, float]:
    """Pairs of the table that have a length within the tolerance of a seen one, in the mean; and those in the cells."""
    table, sky = pair_table(identifier.catalog, FIELD_RAD), identifier._sky
    rows = {int(star): row for row, star in enumerate(identifier.catalog.ids)}
    all_pairs, in_cells = [], []
    for angles, _, ids in frames[:200]:
        known = [rows[int(star)] for star in ids[:4] if int(star) in rows]
        cells = np.unique(sky.cell[known])
        lengths = 1e6 * np.arctan2(angles.sine, angles.cosine)[np.triu_indices(len(ids), 1)]
        for length in lengths[:20]:
            low, high = np.searchsorted(table.distance_urad, length + np.array([-1e6, 1e6]) * tolerance_rad)
            inside = np.isin(sky.cell[table.brighter[low:high]], cells) & np.isin(
                sky.cell[table.dimmer[low:high]], cells
            )
            all_pairs.append(high - low)
            in_cells.append(inside.sum())
    return float(np.mean(all_pairs)), float(np.mean(in_cells))


FIELD_RAD = 2 * PRESETS[PIVOT_PAPER].optics.radius_rad()


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("directions", type=int, nargs="?", default=500)
    count = parser.parse_args().directions
    optics = replace(PRESETS[PIVOT_PAPER].optics, magnitude_limit=GAIA_LIMIT)
    mission = PaperSky.from_plan(Plan(optics, (), count, 1, "gaia", angle_noise=True)).mission
    source = of_angles(load_catalog("gaia"), GAIA_LIMIT)
    print("| arcsec | search | first star right | false | stars named by step 2 (right) | CPU / us | pairs met |")
    print("|---|---|---|---|---|---|---|")
    for noise_arcsec in (10.0, 50.0):
        tolerance_rad = 3 * noise_arcsec * ARCSEC_RAD
        frames = seen(noise_arcsec, count, optics, source)
        nothing = [None] * len(frames)
        cells, whole = (PivotIdentifier(mission, FIELD_RAD, tolerance_rad) for _ in range(2))
        whole._sky = whole._sky._replace(around=np.ones_like(whole._sky.around))
        rows = {int(star): row for row, star in enumerate(mission.ids)}
        before = [np.array([rows[int(star)] for star in ids if int(star) in rows]) for _, _, ids in frames]
        before = [stars if len(stars) else None for stars in before]
        met = pairs_met(cells, frames, tolerance_rad)
        for name, identifier, known, pairs in (
            ("step 2 over the whole sky", whole, nothing, f"{met[0]:.0f}"),
            ("step 2 in the cells of the group", cells, nothing, f"{met[1]:.1f}"),
            ("both steps in the cells of the frame before", cells, before, ""),
        ):
            right, false, named, named_right = outcomes(identifier, frames, known)
            share = f"{100 * right / len(frames):.1f} % | {100 * false / len(frames):.1f} %"
            us = median_us(identifier, frames, known)
            print(f"| {noise_arcsec:g} | {name} | {share} | {named} ({named_right}) | {us:.0f} | {pairs} |")


if __name__ == "__main__":
    main()
