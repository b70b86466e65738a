"""The statements of both papers in docs/formulas.md that take longer to show than a test may, in figures.

    python benchmarks/papers.py [DIRECTIONS] [--catalog FILE]

LAPAN paper: the field of ``gse evaluate --preset lapan``, panoramas of the real sky, angles by arc cosine. Pivot paper:
the preset ``pivot-paper`` under both skies, then its cells, what they save in step 2, and as knowledge a priori in step
1: pairs are counted as the paper's own step 2 would meet them, a new pattern for each star, its pairs taken from the
whole table by their length, with and without the cells of the group. Times are CPU of one search, medians.
"""

import argparse
import statistics
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from gse.catalog import load_catalog
from gse.evaluation.frames import Conditions, FrameMaker, Optics
from gse.evaluation.monte_carlo import of_angles, outcomes
from gse.evaluation.panoramas import read_set, scores
from gse.evaluation.paper_figures import PaperSky
from gse.evaluation.plan import (
    GAIA_LIMIT,
    PIVOT_PAPER,
    PRESETS,
    SKY_LIMIT,
    Cell,
    OutcomeCounter,
    Plan,
    report,
)
from gse.identifier.consistency import Separations
from gse.identifier.pivot import PivotIdentifier
from gse.identifier.result import Unidentified
from gse.identifier.tables import pair_table
from gse.values.constants import ARCSEC_RAD
from gse.values.identifier_options import IdentifierOptions
from gse.values.spiral import spiral_directions

ROOT = Path(__file__).parents[1]

REPEATED = 5
Seen = tuple[Separations, np.ndarray, np.ndarray]
Before = np.ndarray | None
FIELD_RAD = 2 * PRESETS[PIVOT_PAPER].optics.radius_rad()


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


def outcomes_of(identifier: PivotIdentifier, frames: list[Seen], before: list[Before]) -> tuple[int, int, int, int]:
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


def evaluated(
    optics: Optics, cells: Sequence[Cell], count: int, catalog: str, *, angle_noise: bool
) -> list[dict[str, Any]]:
    """The cells of gse.evaluation/1."""
    plan = Plan(optics, tuple(cells), count, 1, catalog, angle_noise)
    counter = OutcomeCounter(plan)
    for chunk in outcomes(plan):
        counter.add(chunk)
    found: list[dict[str, Any]] = report(plan, counter.tallies(), interrupted=False)["cells"]
    return found


def shares(cell: dict[str, Any]) -> str:
    """Right and false in percent, and how many frames they are of."""
    right, false = (100 * cell["rates"][kind]["share"] for kind in ("right", "false"))
    return f"{right:.1f} % right, {false:.1f} % false of {cell['frames_counted']}"


LAPAN_ROWS = (
    ("S20", "more than Fn = 6 (`exceeded`), 3 false objects", IdentifierOptions(fit_rule="exceeded"), 3),
    (
        "S21",
        "`alpha: central`, one alpha star, 3 false objects",
        IdentifierOptions(alpha="central", alpha_retries=0),
        3,
    ),
    ("S23", "one alpha star, 3 false objects", IdentifierOptions(alpha_retries=0), 3),
    ("S27", "Fn 3, `check: none`, 8 false objects", IdentifierOptions(min_fit=3, check="none"), 8),
    ("S27", "Fn 3, `check: wahba`, 8 false objects", IdentifierOptions(min_fit=3), 8),
    *(("S38", f"preset, {count} false objects", IdentifierOptions(), count) for count in (0, 3, 8)),
)


def lapan(count: int) -> None:
    """Rows of the LAPAN paper."""
    conditions = {each.false_objects: each for each in PRESETS["lapan"].conditions}
    cells = [Cell(options, conditions[false_objects]) for _, _, options, false_objects in LAPAN_ROWS]
    rows = evaluated(PRESETS["lapan"].optics, cells, count, "gaia", angle_noise=False)
    print(f"| S11 | arc cosine in single precision, of 10,000 angles to 20 deg | {arc_cosine_errors()} |")
    for (row, what, _, _), cell in zip(LAPAN_ROWS, rows, strict=True):
        print(f"| {row} | {what} | {shares(cell)} |")
    cases = read_set(ROOT / "benchmarks" / "real-sky").cases
    for selection in ("first-fit", "all-fit"):
        kinds = [score.kind for score in scores(IdentifierOptions(selection=selection), cases, "gaia")]
        print(f"| S22 | `{selection}`, real panoramas | {kinds.count('right')} of {len(kinds)} right |")


def arc_cosine_errors() -> str:
    """Median and greatest error of eq 2-2 in single precision."""
    rng = np.random.default_rng(1)
    angles = rng.uniform(0, np.radians(20), 10_000)
    one, other = np.zeros((2, 10_000, 3))
    one[:, 2] = 1
    other[:, 0], other[:, 2] = np.sin(angles), np.cos(angles)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    a, b = ((v @ turn).astype(np.float32) for v in (one, other))
    errors = np.abs(np.arccos(np.clip((a * b).sum(axis=1), -1, 1)) - angles) * 1e6
    return f"{np.median(errors):.1f} and {errors.max():.0f} microradians off, median and most"


def pivot(count: int, catalog: str) -> None:
    """Success of the pivot paper, figures 11 to 14, at the noise of which it gives numbers."""
    preset = PRESETS[PIVOT_PAPER]
    optics = replace(preset.optics, magnitude_limit=GAIA_LIMIT) if catalog == "gaia" else preset.optics
    sky = PaperSky.from_plan(Plan(optics, (), count, 1, catalog, angle_noise=True))
    source = load_catalog(catalog)
    known = of_angles(source, optics.magnitude_limit)
    print(f"| N8 to N11 | stars: source, to the limit, adjacent ones made one, chosen | {len(sky.source)}, ", end="")
    print(f"{int((source.magnitude <= optics.magnitude_limit).sum())}, {len(known)}, {len(sky.mission)} |")
    cells = [
        Cell(IdentifierOptions(algorithm=algorithm), Conditions("angles", *noise, whole_pixels=False), limit)
        for algorithm in ("pivot", "match-group")
        for noise in ((10.0, 0.1), (50.0, 0.1), (10.0, 0.5))
        for limit in (optics.magnitude_limit, SKY_LIMIT)
    ]
    for cell in evaluated(optics, cells, count, catalog, angle_noise=True):
        names = "N23 to N25, N29" if cell["identifier"] == "pivot" else "N26 to N28"
        row = names if cell["sky_limit"] == optics.magnitude_limit else "N30"
        noise = f"{cell['noise_arcsec']:g} arcsec, {cell['magnitude_noise']:g} mag, sky to {cell['sky_limit']:g}"
        few, step_2 = sum(cell["excluded"].values()), cell["step_2"]
        steps = f"step 2: {step_2['right']} of {step_2['named']} stars"
        print(f"| {row} | `{cell['identifier']}`, {noise} | {shares(cell)}; {few} with fewer stars; {steps} |")


def cells_of_step_2(count: int) -> None:
    """What the cells save."""
    optics = replace(PRESETS[PIVOT_PAPER].optics, magnitude_limit=GAIA_LIMIT)
    mission = PaperSky.from_plan(Plan(optics, (), count, 1, "gaia", angle_noise=True)).mission
    source = of_angles(load_catalog("gaia"), GAIA_LIMIT)
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
        for row, name, identifier, known, pairs in (
            ("N31", "step 2 over the whole sky", whole, nothing, f", {met[0]:.0f} pairs met"),
            ("N20, N31", "step 2 in the cells of the group", cells, nothing, f", {met[1]:.1f} pairs met"),
            ("N32", "both steps in the cells of the frame before", cells, before, ""),
        ):
            right, false, named, named_right = outcomes_of(identifier, frames, known)
            share = f"{100 * right / len(frames):.1f} % right, {100 * false / len(frames):.1f} % false"
            us = median_us(identifier, frames, known)
            stars = f"step 2 named {named} stars, {named_right} right"
            print(f"| {row} | {name}, {noise_arcsec:g} arcsec | {share}; {stars}; {us:.0f} us{pairs} |")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("directions", type=int, nargs="?", default=1000)
    parser.add_argument("--catalog", default="gaia", help="of the pivot paper's sky, e.g. its BSC5")
    options = parser.parse_args()
    print("| row | what | here |\n|---|---|---|")
    lapan(options.directions)
    pivot(options.directions, options.catalog)
    cells_of_step_2(options.directions)


if __name__ == "__main__":
    main()
