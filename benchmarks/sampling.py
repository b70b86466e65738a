"""Coverage of the sampling bounds, risks of the decision, power, plan against simulation.

    python benchmarks/sampling.py [--quick] [--sessions 10000]

Each cell is a process (white, exponential correlation, sinusoid of random phase with white noise), a length and a bias;
its sessions are errors, not bytes. Two processes work at once.
"""

import argparse
import math
import os
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from numpy.typing import NDArray

from gse.assessment.axis_statistics import drift
from gse.assessment.guard_band import exceeds, keeps
from gse.assessment.planning import Expected, accuracy_frames, simulated_errors
from gse.assessment.sampling import error_bounds

TRUE_VALUES = 1_000_000
WHITE_SHARE = 0.2


@dataclass(frozen=True)
class Cell:
    """A process of standard deviation 1: ``time_s`` is the time constant, or the period where ``wave``."""

    n: int
    step_s: float
    time_s: float
    bias: float
    wave: bool = False

    @property
    def duration_s(self) -> float:
        """Length of a session."""
        return self.n * self.step_s

    @property
    def name(self) -> str:
        """The process, in words."""
        return f"sinusoid {self.time_s:g} s" if self.wave else f"tau {self.time_s:g} s" if self.time_s else "white"

    @property
    def n_eff(self) -> float:
        """Independent values in the mean; NaN for a sinusoid, whose mean has no noise but the white."""
        if self.wave:
            return math.nan
        kept = math.exp(-self.step_s / self.time_s) if self.time_s else 0.0
        lags = np.arange(1, self.n)
        return self.n / (1 + 2 * float(((1 - lags / self.n) * kept**lags).sum()))


@dataclass(frozen=True)
class Outcome:
    """Shares of the sessions of a cell."""

    cell: Cell
    coverage: tuple[float, float, float, float]
    passes_at_limit: tuple[float, float]
    fails_at_limit: tuple[float, float]
    passes_at_half: float
    given: float
    n_eff: float


def cells() -> list[Cell]:
    """White noise, three correlation times, two frame rates, periods up to the session's length."""
    correlated = [
        Cell(n, step_s, time_s, bias)
        for bias in (0.0, 2.0)
        for n, step_s in ((60, 0.1), (60, 1.0), (600, 0.1), (600, 1.0), (3600, 1.0), (36_000, 0.1), (36_000, 1.0))
        for time_s in (0.0, 3.0, 30.0, 300.0)
    ]
    waves = [
        Cell(n, 1.0, period_s, bias, wave=True)
        for bias in (0.0, 2.0)
        for n, period_s in ((600, 300.0), (600, 600.0), (3600, 300.0), (3600, 1000.0), (3600, 2500.0), (3600, 3600.0))
    ]
    return correlated + waves


def errors(cell: Cell, generator: np.random.Generator, sessions: int) -> NDArray[np.float64]:
    """Sessions (sessions, n) of a cell."""
    if not cell.wave:
        kept = math.exp(-cell.step_s / cell.time_s) if cell.time_s else 0.0
        return simulated_errors(Expected(cell.bias, 1.0, (1 + kept) / (1 - kept), 1.0), cell.n, sessions, generator)
    turns = np.arange(cell.n) * cell.step_s / cell.time_s + generator.random((sessions, 1))
    noise = math.sqrt(WHITE_SHARE) * generator.standard_normal((sessions, cell.n))
    return np.asarray(cell.bias + math.sqrt(2 - 2 * WHITE_SHARE) * np.sin(2 * math.pi * turns) + noise)


def truth(cell: Cell) -> tuple[float, float]:
    """Mean and 95th percentile of the absolute errors of all sessions."""
    one = Cell(1, cell.step_s, cell.time_s, cell.bias, cell.wave)
    absolute = np.abs(errors(one, np.random.default_rng(0), TRUE_VALUES)[:, 0])
    return float(absolute.mean()), float(np.percentile(absolute, 95))


def measure(task: tuple[Cell, int]) -> Outcome:
    """All sessions of a cell."""
    cell, sessions = task
    true, generator = truth(cell), np.random.default_rng(2)
    time_s = np.arange(cell.n) * cell.step_s
    chunk = max(min(sessions, 2_000_000 // cell.n), 1)
    rows = []
    for _ in range(math.ceil(sessions / chunk)):
        rows += [_session(one, time_s, cell.bias, true) for one in errors(cell, generator, chunk)]
    given = [row for row in rows if row is not None]
    shares = np.mean([row[:9] for row in given], axis=0) if given else np.full(9, math.nan)
    number = float(np.median([row[9] for row in given])) if given else math.nan
    coverage = (shares[0], shares[1], shares[2], shares[3])
    return Outcome(
        cell, coverage, (shares[4], shares[5]), (shares[6], shares[7]), shares[8], len(given) / len(rows), number
    )


def _session(
    one: NDArray[Any], time_s: NDArray[Any], bias: float, true: tuple[float, float]
) -> tuple[float, ...] | None:
    bounds, absolute = error_bounds(one), np.abs(one)
    slope, slopes = drift(time_s, one)
    values = float(absolute.mean()), float(np.percentile(absolute, 95))
    both = bounds.mean_abs, bounds.p95_abs
    if math.isnan(bounds.bias.low):
        return None
    return (
        bounds.bias.low <= bias <= bounds.bias.high,
        *(part.low <= value <= part.high for part, value in zip(both, true, strict=True)),
        slopes.low <= 0 <= slopes.high,
        *(keeps(value, part.upper, limit) for value, part, limit in zip(values, both, true, strict=True)),
        *(exceeds(value, part.lower, limit) for value, part, limit in zip(values, both, true, strict=True)),
        all(keeps(value, part.upper, 2 * limit) for value, part, limit in zip(values, both, true, strict=True)),
        bounds.n_eff,
    )


def plans() -> list[tuple[Expected, float, float]]:
    """What is expected, a limit, the standard uncertainty of truth."""
    return [
        (Expected(0.0, 20.0, 0.0, 1.0), 60.0, 3.0),
        (Expected(0.0, 20.0, 0.0, 10.0), 45.0, 1.0),
        (Expected(20.0, 10.0, 60.0, 1.0), 60.0, 3.0),
        (Expected(0.0, 25.0, 10.0, 10.0), 60.0, 2.0),
        (Expected(10.0, 20.0, 60.0, 1.0), 60.0, 3.0),
    ]


def needed(task: tuple[tuple[Expected, float, float], int]) -> tuple[int, int | None, float]:
    """Frames by the plan, by simulation of whole sessions, and the share that passes after the plan's."""
    (expected, limit, standard), sessions = task
    planned = accuracy_frames(expected, limit, truth_arcsec=standard)
    assert planned is not None
    shares = {factor: _passing(expected, limit, standard, round(planned * factor), sessions) for factor in FACTORS}
    enough = [factor for factor in FACTORS if shares[factor] >= 0.9]
    return planned, round(planned * enough[0]) if enough else None, shares[1.0]


FACTORS = (0.7, 0.8, 0.9, 1.0, 1.1, 1.2, 1.3)


def _passing(expected: Expected, limit: float, standard: float, n: int, sessions: int) -> float:
    passed = 0
    for one in simulated_errors(expected, n, sessions, np.random.default_rng(3)):
        bounds, absolute = error_bounds(one), np.abs(one)
        passed += keeps(float(absolute.mean()), bounds.mean_abs.upper, limit, standard) and keeps(
            float(np.percentile(absolute, 95)), bounds.p95_abs.upper, limit, standard
        )
    return passed / sessions


def main() -> None:
    """Measure all and print the tables in Markdown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="100 sessions a cell, and no cells of 36,000 frames")
    parser.add_argument("--sessions", type=int, default=10_000)
    arguments = parser.parse_args()
    sessions = 100 if arguments.quick else arguments.sessions
    chosen = [cell for cell in cells() if not (arguments.quick and cell.n > 3600)]
    with ProcessPoolExecutor(2) as pool:
        print(f"{sessions} sessions a cell; true n_eff, then medians and shares in %.\n")
        print("| process | frames | step s | bias | n_eff true | found | given | bias | mean | 95 % | drift |", end="")
        print(" PASS at limit mean | 95 % | FAIL at limit mean | 95 % | PASS at half |")
        print("|" + "---|" * 16)
        for outcome in pool.map(measure, [(cell, sessions) for cell in chosen]):
            print(row(outcome), flush=True)
        print("\n| bias | noise | tau s | frames/s | limit | truth | planned | needed | PASS in % after the plan's |")
        print("|" + "---|" * 9)
        asked = [(plan, min(sessions, 1000)) for plan in plans()]
        for (plan, _), (planned, simulated, share) in zip(asked, pool.map(needed, asked), strict=True):
            expected, limit, standard = plan
            print(
                f"| {expected.bias_arcsec:g} | {expected.noise_arcsec:g} | {expected.tau_s:g} | "
                f"{expected.frames_per_s:g} | {limit:g} | {standard:g} | {planned} | {simulated} | {100 * share:.1f} |",
                flush=True,
            )


def row(outcome: Outcome) -> str:
    """A line of the first table."""
    cell = outcome.cell
    true = "" if cell.wave else f"{cell.n_eff:.3g}"
    shares = (outcome.given, *outcome.coverage, *outcome.passes_at_limit, *outcome.fails_at_limit)
    numbers = " | ".join(f"{100 * share:.1f}" for share in (*shares, outcome.passes_at_half))
    head = f"| {cell.name} | {cell.n} | {cell.step_s:g} | {cell.bias:g} | {true} | {outcome.n_eff:.3g}"
    return f"{head} | {numbers} |"


if __name__ == "__main__":
    main()
