"""Mutants made by hand, each against the tests that say what it breaks: python benchmarks/named_mutants.py [WORD]

A row is a fault in words, the text of a module before and after, and the file whose tests must notice; with WORD only
the rows whose words contain it. Prints ``killed`` or ``survived`` for each.
"""

import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from mutation import ROOT, Mutant, Tester, copy_of_tree, in_tree

MOST_CPU_S = 300


@dataclass(frozen=True, slots=True)
class Named:
    """One fault: what it means, where it is, and the test file that must fail."""

    words: str
    module: str
    before: str
    after: str
    tests: str


_FRAMES = "gse/station/frame_processor.py"
_GUARD = "gse/statistics/decision.py"
_DECISION = "gse/statistics/decision.py"
_STATISTICS = "gse/statistics/subject_statistics.py"
_ACCEPTANCE = "gse/identifier/checks.py"
_HOT = "gse/imaging/session_fit.py"
_TO_DECISION = "tests/gse/statistics/test_decision.py"
_TO_VERDICT = "tests/gse/verdict/test_verdict.py"
_TO_FRAMES = "tests/gse/station/test_frame_processor.py"
_TO_ACCEPTANCE = "tests/gse/identifier/test_acceptance.py"
_TO_CLOCK = "tests/gse/statistics/test_clock_health.py"
_TO_STATISTICS = "tests/gse/statistics/test_session_statistics.py"
_TO_HOT = "tests/gse/imaging/test_hot_pixels.py"
_TO_ALIGNMENT = "tests/gse/truth/test_alignment.py"
_OF_VALUE = "(share.value, share.value)"

NAMED = (
    Named("never FALSE", _FRAMES, "_RAD, _CORRECT, _FALSE)", "_RAD, _CORRECT, _CORRECT)", _TO_FRAMES),
    Named("FALSE from 5 deg on", _FRAMES, "(separation_rad < self", "(separation_rad < 100 * self", _TO_FRAMES),
    Named("time never fails", "gse/verdict/requirements.py", "limit=SLOW_SHARE", "limit=1.0", _TO_VERDICT),
    Named(
        "FAIL though truth may be it", _GUARD, "guard(value - lower, truth_standard)", "(value - lower)", _TO_DECISION
    ),
    Named(
        "the fitted mount is never used",
        "gse/station/loop.py",
        "replace(self._frame_processor, mount=alignment.mount)",
        "self._frame_processor",
        "tests/gse/station/test_aligned_session.py",
    ),
    Named(
        "no proper motion",
        "gse/station/setup.py",
        "catalog if epoch_jyear is None else catalog.at_epoch(epoch_jyear)",
        "catalog",
        "tests/gse/station/test_setup.py",
    ),
    Named(
        "a fast scene counts",
        "gse/station/exclusions.py",
        "shown.rate_deg_per_s > limit_deg_per_s",
        "shown.rate_deg_per_s > 100 * limit_deg_per_s",
        "tests/gse/sessions/test_screen_session.py",
    ),
    Named(
        "a step of a rate that fails is passed over",
        "gse/verdict/requirements.py",
        "if step.outcome is not Outcome.PASS:",
        "if step.outcome is Outcome.NOT_TESTED:",
        "tests/gse/sessions/test_screen_session.py",
    ),
    Named(
        "wrong side of a clock step",
        "gse/station/exclusions.py",
        "old_ns, new_ns = event.utc_ns - step_ns, event.utc_ns",
        "old_ns, new_ns = event.utc_ns + step_ns, event.utc_ns",
        "tests/gse/statistics/test_counted_frames.py",
    ),
    Named(
        "best clock bound", "gse/statistics/clock_health.py", "bound_s = max((abs(", "bound_s = min((abs(", _TO_CLOCK
    ),
    Named(
        "3 sigma for 1", "gse/truth/alignment.py", "x, y, z = (math.sqrt(", "x, y, z = (3 * math.sqrt(", _TO_ALIGNMENT
    ),
    Named("mount gate x 10", "gse/truth/alignment.py", "<= _REJECT_SIGMA *", "<= 10 * _REJECT_SIGMA *", _TO_ALIGNMENT),
    Named(
        "another sky from 10 deg on",
        "gse/statistics/counted_frames.py",
        "OTHER_SKY_ARCSEC = 3600.0",
        "OTHER_SKY_ARCSEC = 36000.0",
        "tests/gse/statistics/test_counted_frames.py",
    ),
    Named("limit: keeps <", _GUARD, "truth_standard) <= limit", "truth_standard) < limit", _TO_DECISION),
    Named("limit: exceeds >=", _GUARD, "truth_standard) > limit", "truth_standard) >= limit", _TO_DECISION),
    Named(
        "limit: simple <",
        _DECISION,
        "PASS if figure.value <= asked.limit",
        "PASS if figure.value < asked.limit",
        _TO_DECISION,
    ),
    Named("share: lower >", _DECISION, "lower >= limit if at_least", "lower > limit if at_least", _TO_DECISION),
    Named("share: upper <=", _DECISION, "upper < limit if at_least", "upper <= limit if at_least", _TO_DECISION),
    Named("share: upper <", _DECISION, "else upper <= limit", "else upper < limit", _TO_DECISION),
    Named("share: lower >=", _DECISION, "else lower > limit", "else lower >= limit", _TO_DECISION),
    Named("share: simple by its lower bound", _DECISION, _OF_VALUE, "(share.lower, share.value)", _TO_DECISION),
    Named("share: simple by its upper bound", _DECISION, _OF_VALUE, "(share.value, share.upper)", _TO_DECISION),
    Named("30 frames are too few", _DECISION, "self.frames < MIN_FRAMES", "self.frames <= MIN_FRAMES", _TO_DECISION),
    Named("29 frames suffice", "gse/statistics/sampling.py", "MIN_FRAMES = 30", "MIN_FRAMES = 29", _TO_DECISION),
    Named(
        "|dRA| times cos DE",
        _STATISTICS,
        "d_ra_cosde_arcsec / np.cos(",
        "d_ra_cosde_arcsec * np.cos(",
        _TO_STATISTICS,
    ),
    Named(
        "longest outage the shortest", _STATISTICS, "np.diff(answers).max()", "np.diff(answers).min()", _TO_STATISTICS
    ),
    Named(
        "slow for fast",
        "gse/diagnosis/plain_findings.py",
        "'slow' if ppm > 0",
        "'slow' if ppm < 0",
        "tests/gse/diagnosis/test_diagnosis.py",
    ),
    Named(
        "slow for fast, in ppm",
        "gse/statistics/clock_health.py",
        "late_s = host_s - sensor_s",
        "late_s = sensor_s - host_s",
        _TO_CLOCK,
    ),
    Named("hot in 15 %", _HOT, "MIN_SHARE = 0.3", "MIN_SHARE = 0.15", _TO_HOT),
    Named("hot in 60 %", _HOT, "MIN_SHARE = 0.3", "MIN_SHARE = 0.6", _TO_HOT),
    Named("hot though a star", _HOT, "starlike[pixel] < count / 2", "starlike[pixel] < count", _TO_HOT),
    Named("hot though seldom a star only", _HOT, "starlike[pixel] < count / 2", "starlike[pixel] < count / 4", _TO_HOT),
    Named(
        "chance halved",
        _ACCEPTANCE,
        "max(objects - 1, 0) * 2 * self.pairs",
        "max(objects - 1, 0) * self.pairs",
        _TO_ACCEPTANCE,
    ),
    Named("chance of third stars halved", _ACCEPTANCE, "_GATE = 16.0", "_GATE = 8.0", _TO_ACCEPTANCE),
    Named(
        "chance of robust halved",
        "gse/identifier/robust.py",
        "return CHANCE_OF_EVIDENCE * math.exp(",
        "return 0.5 * CHANCE_OF_EVIDENCE * math.exp(",
        _TO_ACCEPTANCE,
    ),
    Named(
        "residual gate x 100",
        _ACCEPTANCE,
        "if rms_rad <= tolerance_rad",
        "if rms_rad <= 100 * tolerance_rad",
        _TO_ACCEPTANCE,
    ),
    Named("mirrored as no match", _ACCEPTANCE, "Reason.MIRRORED, f", "Reason.NO_MATCH, f", _TO_ACCEPTANCE),
    Named(
        "mirrored as no match, robust",
        "gse/identifier/robust.py",
        "Reason.MIRRORED,",
        "Reason.NO_MATCH,",
        "tests/gse/identifier/test_robust.py",
    ),
    Named(
        "divisor of the deviation",
        "gse/statistics/axis_statistics.py",
        "error_arcsec.std(ddof=1)",
        "error_arcsec.std()",
        "tests/gse/statistics/test_axis_statistics.py",
    ),
)


def mutant_of(named: Named) -> Mutant:
    """The mutated source; AssertionError where the text is not in the module exactly once."""
    text = (ROOT / named.module).read_text()
    assert text.count(named.before) == 1, f"{named.words}: {text.count(named.before)} times in {named.module}"
    line = text[: text.index(named.before)].count("\n") + 1
    return Mutant(named.module, line, 0, named.words, text.replace(named.before, named.after), None)


def main(word: str = "") -> None:
    """Run the rows, one after the other."""
    chosen = [(named, mutant_of(named)) for named in NAMED if word in named.words]
    with tempfile.TemporaryDirectory(prefix="gse-mutation-") as folder:
        tree = copy_of_tree(Path(folder) / "tree")
        tester = Tester(tree)
        for named, mutant in chosen:
            said = in_tree(tester, mutant, [[named.tests]], MOST_CPU_S)
            print(f"{said:9} {named.module}:{mutant.line}  {named.words}", flush=True)
        tester.close()


if __name__ == "__main__":
    main(*sys.argv[1:])
