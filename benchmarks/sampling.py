"""Coverage of the sampling bounds, risks of the decision, power; longer sessions; what is said of them, and the plan.

    python benchmarks/sampling.py [--sessions 2000] [--frames 60 600 3600 21600 288000] [--workers 2] [--no-plan]

Each cell is a process (white, exponential correlation, sinusoid of random phase with white noise) and a length; its
sessions are errors at one frame a second, not bytes, with a bias of 0, 0.5 and 2 standard deviations. Correlation times
go up to a tenth of the session, which is what U is stated for; some longer ones are there for their intervals. A
correlation of 300 s at 1 Hz and one of 30 s at 10 Hz are the same to all but the noise equivalent angle. The rate of
the boresight has the interval of the drift. Sessions have ten seconds at least: shorter ones have no bounds.
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
from scipy.signal import lfilter
from scipy.stats import foldnorm

from gse.statistics.availability import available_share
from gse.statistics.axis_statistics import axis_statistics
from gse.statistics.decision import Outcome as Word
from gse.statistics.decision import (
    Share,
    exceeds,
    further_share,
    keeps,
    lengths_to_pass,
    share_outcome,
    share_times,
)
from gse.statistics.sampling import MIN_FRAMES, error_bounds
from gse.values.instant import NS_PER_S
from gse.values.limits import Decision
from gse.verdict.planning import Expected, accuracy_frames, simulated_errors

TRUE_VALUES = 1_000_000
LONG = 1_000_000
"""Frames of which the true noise equivalent angle is taken."""
WHITE_SHARE = 0.2
BIASES = (0.0, 0.5, 2.0)


@dataclass(frozen=True)
class Cell:
    """A process of standard deviation 1: ``time`` is the time constant, or the period where ``wave``, in frames."""

    n: int
    time: float
    wave: bool = False

    @property
    def name(self) -> str:
        """The process, in words."""
        return f"sinusoid {self.time:g}" if self.wave else f"tau {self.time:g}" if self.time else "white"

    @property
    def n_eff(self) -> float:
        """Independent values in the mean; NaN for a sinusoid, whose mean has no noise but the white."""
        if self.wave:
            return math.nan
        kept = math.exp(-1 / self.time) if self.time else 0.0
        lags = np.arange(1, self.n)
        return self.n / (1 + 2 * float(((1 - lags / self.n) * kept**lags).sum()))


@dataclass(frozen=True)
class Outcome:
    """Shares of a cell's sessions with one bias: coverage (bias, mean, 95 %, drift, NEA), decisions (mean, 95 %)."""

    cell: Cell
    bias: float
    coverage: tuple[float, ...]
    passes_at_limit: tuple[float, ...]
    fails_at_limit: tuple[float, ...]
    passes_at_half: float
    n_eff: float


def cells() -> list[Cell]:
    """Correlation times up to a tenth of the session, and some beyond; periods from 5 min to the session's length."""
    times = {
        60: (0, 3, 6, 30, 300),
        600: (0, 3, 10, 60, 300, 3000),
        3600: (0, 3, 30, 300),
        21_600: (0, 30, 300, 2160),
        288_000: (0, 30, 300, 28_800),
    }
    periods = {600: (300, 600), 3600: (300, 1000, 2500, 3600)}
    return [
        *(Cell(n, float(time)) for n, of_length in times.items() for time in of_length),
        *(Cell(n, float(period), wave=True) for n, of_length in periods.items() for period in of_length),
    ]


def errors(cell: Cell, generator: np.random.Generator, sessions: int) -> NDArray[np.float64]:
    """Sessions (sessions, n) of a cell, without bias."""
    white = generator.standard_normal((sessions, cell.n))
    if cell.wave:
        turns = np.arange(cell.n) / cell.time + generator.random((sessions, 1))
        return np.asarray(math.sqrt(2 - 2 * WHITE_SHARE) * np.sin(2 * math.pi * turns) + math.sqrt(WHITE_SHARE) * white)
    if not cell.time:
        return white
    kept = math.exp(-1 / cell.time)
    white[:, 1:] *= math.sqrt(1 - kept**2)
    return np.asarray(lfilter([1.0], [1.0, -kept], white, axis=1))


def truth(cell: Cell, bias: float) -> tuple[float, float]:
    """Mean and 95th percentile of the absolute errors of all sessions; of a long one nothing else is exact enough."""
    if not cell.wave:
        return float(foldnorm.mean(bias)), float(foldnorm.ppf(0.95, bias))
    one = errors(Cell(1, cell.time, cell.wave), np.random.default_rng(0), TRUE_VALUES)[:, 0]
    absolute = np.abs(one + bias)
    return float(absolute.mean()), float(np.percentile(absolute, 95))


def true_noise(cell: Cell) -> float:
    """The noise equivalent angle of a long session of the cell's process; it is not known better than a night's."""
    one = errors(Cell(LONG, cell.time, cell.wave), np.random.default_rng(1), 1)[0]
    return axis_statistics(np.arange(LONG) * NS_PER_S, one).nea_arcsec


def measure(task: tuple[Cell, int]) -> list[Outcome]:
    """All sessions of a cell, with each bias."""
    cell, sessions = task
    true, noise = [truth(cell, bias) for bias in BIASES], true_noise(cell)
    generator, utc_ns = np.random.default_rng(2), np.arange(cell.n) * NS_PER_S
    chunk = max(min(sessions, 2_000_000 // cell.n), 1)
    rows: list[list[tuple[float, ...]]] = [[] for _ in BIASES]
    for first in range(0, sessions, chunk):
        for one in errors(cell, generator, min(chunk, sessions - first)):
            of_one = axis_statistics(utc_ns, one)
            held = (
                of_one.drift_low_arcsec_per_h <= 0 <= of_one.drift_high_arcsec_per_h,
                of_one.nea_low_arcsec <= noise <= of_one.nea_high_arcsec,
            )
            for place, bias in enumerate(BIASES):
                rows[place].append((*_session(one + bias, bias, true[place]), *held))
    return [outcome(cell, bias, np.array(of_bias)) for bias, of_bias in zip(BIASES, rows, strict=True)]


def outcome(cell: Cell, bias: float, rows: NDArray[np.float64]) -> Outcome:
    """The shares of what each session gave (rows, in the order of _session, drift and NEA last)."""
    shares = [float(share) for share in rows.mean(axis=0)]
    coverage = (*shares[:3], *shares[9:])
    return Outcome(
        cell, bias, coverage, tuple(shares[3:5]), tuple(shares[5:7]), shares[7], float(np.median(rows[:, 8]))
    )


def _session(one: NDArray[Any], bias: float, true: tuple[float, float]) -> tuple[float, ...]:
    bounds, absolute = error_bounds(one), np.abs(one)
    values = float(absolute.mean()), float(np.percentile(absolute, 95))
    both = bounds.mean_abs, bounds.p95_abs
    return (
        bounds.bias.low <= bias <= bounds.bias.high,
        *(part.low <= value <= part.high for part, value in zip(both, true, strict=True)),
        *(keeps(value, part.upper, limit) for value, part, limit in zip(values, both, true, strict=True)),
        *(exceeds(value, part.lower, limit) for value, part, limit in zip(values, both, true, strict=True)),
        all(keeps(value, part.upper, 2 * limit) for value, part, limit in zip(values, both, true, strict=True)),
        bounds.n_eff,
    )


LONGER = [
    (600, 60.0, 0.5),
    (3600, 60.0, 0.5),
    (3600, 300.0, 0.5),
    (21_600, 300.0, 0.5),
    (600, 10.0, 0.7),
    (600, 60.0, 0.8),
    (3600, 30.0, 0.8),
]
"""Frames, correlation time, and the share of its limit that a sensor takes."""
LONGEST = 20


def longer(task: tuple[tuple[int, float, float], int]) -> tuple[float, ...]:
    """What becomes of sessions that go on, in shares.

    Those that pass; of these, twice as long, those that still do; of two halves that both pass, wholes that do; of the
    undecided ones those to whom at most LONGEST lengths are told, and of these what is decided after them; of all those
    to whom another session of at most LONGEST lengths is planned, those that pass in it.
    """
    (n, time, share), sessions = task
    kept, whole, told, decided, planned, passed = [], [], [], [], [], 0
    limits = [figure / share for figure in truth(Cell(n, time), 0.0)]
    generator, of_plan = np.random.default_rng(4), np.random.default_rng(5)
    for _ in range(sessions):
        one = errors(Cell(LONGEST * n, time), generator, 1)[0]
        first, second, both = (_judged(part, limits) for part in (one[:n], one[n : 2 * n], one[: 2 * n]))
        passed += first[0] == "PASS"
        kept.extend([both[0] == "PASS"] * (first[0] == "PASS"))
        whole.extend([both[0] == "PASS"] * (first[0] == second[0] == "PASS"))
        if first[0] == "":
            told.append(first[1] < LONGEST)
            if told[-1]:
                decided.append(_judged(one[: math.ceil(n * first[1])], limits)[0] != "")
        if first[2] < LONGEST:
            another = errors(Cell(max(math.ceil(n * first[2]), MIN_FRAMES), time), of_plan, 1)[0]
            planned.append(_judged(another, limits)[0] == "PASS")
    means = (float(np.mean(some)) if some else math.nan for some in (kept, whole, told, decided, planned))
    return (passed / sessions, *means)


def _judged(one: NDArray[np.float64], limits: list[float]) -> tuple[str, float, float]:
    """PASS, FAIL or nothing, the length after which both rows are decided, and that of another session for a PASS."""
    bounds, absolute = error_bounds(one), np.abs(one)
    rows = zip(
        (float(absolute.mean()), float(np.percentile(absolute, 95))), (bounds.mean_abs, bounds.p95_abs), strict=True
    )
    further, another, words = 0.0, 0.0, []
    for (value, part), limit in zip(rows, limits, strict=True):
        sampling = part.upper - value if value <= limit else value - part.lower
        further = max(further, further_share(limit - value, sampling, 0.0, bounds.n_eff))
        another = max(another, lengths_to_pass(limit - value, sampling, 0.0, bounds.n_eff))
        words.append("PASS" if keeps(value, part.upper, limit) else "FAIL" if exceeds(value, part.lower, limit) else "")
    word = "FAIL" if "FAIL" in words else "PASS" if set(words) == {"PASS"} else ""
    return word, 1 + further, another


SHARES = [(n, length) for length in (1, 10, 30, 100) for n in (600, 3600, 21_600)]
"""Frames, and those of an outage."""
LEAST, AVAILABLE, MOST, NEAR = 0.01, 0.95, 0.09, 0.012
"""True shares of absences, evenly between these two; what is asked; those within NEAR of it are told apart."""


def shares(task: tuple[tuple[int, int], int]) -> tuple[int, ...]:
    """What becomes of undecided availabilities that go on, in sessions.

    Undecided; those to whom less than LONGEST lengths are told; of these, decided after them; both near the limit.
    """
    (n, length), sessions = task
    generator, undecided, told = np.random.default_rng((7, n, length)), 0, []
    for _ in range(sessions):
        absent = generator.uniform(LEAST, MOST)
        good = with_outages(LONGEST * n, absent, length, generator)
        share = available_share(good[:n])[0]
        if _word(share) is not Word.INCONCLUSIVE:
            continue
        undecided += 1
        times = 1 + share_times(share, AVAILABLE, at_least=True)
        if times < LONGEST:
            later = _word(available_share(good[: math.ceil(n * times)])[0])
            told.append((later is not Word.INCONCLUSIVE, abs(absent - 1 + AVAILABLE) < NEAR))
    near = [decided for decided, is_near in told if is_near]
    return undecided, len(told), sum(decided for decided, _ in told), len(near), sum(near)


def _word(share: Share) -> Word:
    return share_outcome(share, AVAILABLE, at_least=True, decision=Decision.GUARDED)


def with_outages(n: int, absent: float, length: int, generator: np.random.Generator) -> NDArray[np.bool_]:
    """Frames (n,) with good answers but for a share in outages of one length, at random times."""
    number = int(1.3 * n * absent / length) + 50
    gaps = generator.geometric(absent / (absent + length * (1 - absent)), number) - 1
    first = np.cumsum(gaps) + length * np.arange(number) - generator.integers(0, max(int(length / absent), 1))
    frames = (first[:, None] + np.arange(length)).ravel()
    good = np.ones(n, dtype=np.bool_)
    good[frames[(frames >= 0) & (frames < n)]] = False
    return good


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
    parser.add_argument("--sessions", type=int, default=2000)
    parser.add_argument(
        "--frames", type=int, nargs="*", default=[60, 600, 3600, 21_600, 288_000], help="lengths of sessions"
    )
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--no-plan", action="store_true")
    given = parser.parse_args()
    with ProcessPoolExecutor(given.workers) as pool:
        print(f"{given.sessions} sessions a cell; true n_eff, then its median and shares in %.\n")
        print("| process | frames | bias | n_eff true | found | bias | mean | 95 % | drift, rate | NEA |", end="")
        print(" PASS at limit | FAIL at limit | PASS at half |\n" + "|---" * 13 + "|")
        chosen = [(cell, given.sessions) for cell in cells() if cell.n in given.frames]
        for of_cell in pool.map(measure, chosen):
            print("\n".join(map(row, of_cell)), flush=True)
        print(
            "\n| frames | tau s | of the limit | PASS | PASS twice as long | PASS of two PASS | told | then decided"
            " | PASS as planned |"
        )
        print("|---" * 9 + "|")
        going_on = [(one, min(given.sessions, 400)) for one in LONGER]
        for ((n, time, share), _), became in zip(going_on, pool.map(longer, going_on), strict=True):
            print(
                f"| {n} | {time:g} | {share:g} | " + " | ".join(f"{100 * one:.1f}" for one in became) + " |", flush=True
            )
        print("\n| frames | in outages of | undecided | told | then decided | told near | then decided |")
        print("|---" * 7 + "|")
        absent = [(one, min(given.sessions, 600)) for one in SHARES if one[0] in given.frames]
        for (cell, _), counts in zip(absent, pool.map(shares, absent), strict=True):
            print("| " + " | ".join(map(str, cell + counts)) + " |", flush=True)
        asked = [] if given.no_plan else [(plan, min(given.sessions, 1000)) for plan in plans()]
        print("\n| bias | noise | tau s | frames/s | limit | truth | planned | needed | PASS in % after the plan's |")
        print("|---" * 9 + "|")
        for (plan, _), (planned, simulated, share) in zip(asked, pool.map(needed, asked), strict=True):
            expected, limit, standard = plan
            print(
                f"| {expected.bias_arcsec:g} | {expected.noise_arcsec:g} | {expected.tau_s:g} | "
                f"{expected.frames_per_s:g} | {limit:g} | {standard:g} | {planned} | {simulated} | {100 * share:.1f} |",
                flush=True,
            )


def row(one: Outcome) -> str:
    """A line of the first table."""
    cell = one.cell
    true = "" if cell.wave else f"{cell.n_eff:.3g}"
    coverage = " | ".join(f"{100 * share:.1f}" for share in one.coverage)
    passes, fails = (
        " / ".join(f"{100 * share:.1f}" for share in both) for both in (one.passes_at_limit, one.fails_at_limit)
    )
    head = f"| {cell.name} | {cell.n} | {one.bias:g} | {true} | {one.n_eff:.3g}"
    return f"{head} | {coverage} | {passes} | {fails} | {100 * one.passes_at_half:.1f} |"


if __name__ == "__main__":
    main()
