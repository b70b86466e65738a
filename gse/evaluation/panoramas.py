"""A benchmark on panoramas whose truth is known: those of a folder, and seeded ones of a simulated sky.

A folder holds truth.json and tables of panoramas (y, x, index value), beside it or in ``tables/``. truth.json has an
entry for each name: camera (rows, columns, focal_length_px, perhaps principal_point_px, radial_distortion_k1, mirrored,
index_max) and the direction of the boresight (ra_deg, de_deg, ICRS). A table belongs to the longest name that its own
name begins with: ``vega.csv`` and ``vega-subpixel.csv`` are two panoramas of ``vega``.

Right is a boresight within 0.05 deg, coarse one within 0.5 deg, false any other; the times are CPU of this host for a
built-in identifier, and an external one's own where it states them.
"""

import functools
import itertools
import json
import math
import operator
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.host_files import only_a_file
from gse.catalog import StarCatalog, load_catalog
from gse.errors import TableError, UsageError
from gse.evaluation.frames import FrameMaker
from gse.evaluation.monte_carlo import COARSE_DEG, RIGHT_DEG
from gse.evaluation.plan import KINDS, Cell, Plan, failure_lines, interval
from gse.external.answers import Failure
from gse.external.identifier import evaluated, in_time
from gse.external.panoramas import SensorDescription
from gse.external.plugs import plug_of
from gse.identifier import Identification, make_identifier
from gse.imaging.panorama_table import read_panorama_table
from gse.statistics.sampling import percentiles
from gse.values.attitude import solve_attitude
from gse.values.camera import Camera
from gse.values.constants import ARCSEC_PER_RAD, ARCSEC_RAD
from gse.values.identifier_options import IdentifierOptions
from gse.values.panorama import Panorama
from gse.values.spiral import spiral_directions

SCHEMA = "gse.benchmark/1"
MOST_PANORAMAS = 100_000
MOST_TRUTH_BYTES = 10_000_000
_INDEX_MAX = 4096
_NAN = float("nan")


@dataclass(frozen=True, slots=True, eq=False)
class BenchmarkFrame:
    """A panorama, the camera that saw it, and where it looked: a unit vector (3,) in ICRS."""

    name: str
    sensor: SensorDescription
    panorama: Panorama
    boresight_icrs: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class PanoramaSet:
    """Panoramas of one source."""

    name: str
    cases: tuple[BenchmarkFrame, ...]


@dataclass(frozen=True, slots=True)
class Score:
    """What became of one panorama: a kind of KINDS, the error of the boresight (NaN for none) and the time.

    ``failure`` is how an external identifier failed, None where it did not.
    """

    kind: str
    error_arcsec: float
    elapsed_us: float
    failure: Failure | None = None


def read_set(folder: Path) -> PanoramaSet:
    """The panoramas of a folder, and of the folders in it, that have a truth.json; UsageError or TableError."""
    if not folder.is_dir():
        raise UsageError(f"{folder} is not a folder; expected one with truth.json and tables of panoramas")
    cases = [case for path in sorted(folder.rglob("truth.json")) for case in _cases(path)]
    if not cases:
        raise UsageError(f"{folder} has no panorama with a truth: expected truth.json and tables that its names begin")
    if len(cases) > MOST_PANORAMAS:
        raise UsageError(f"{folder} has {len(cases)} panoramas; at most {MOST_PANORAMAS} are taken")
    return PanoramaSet(folder.resolve().name, tuple(cases))


def seeded_set(plan: Plan, cell: Cell, catalog: StarCatalog) -> PanoramaSet:
    """The panoramas of a cell of a plan that have at least 4 real stars."""
    maker, sensor = (
        FrameMaker(plan.optics, cell.conditions, catalog),
        SensorDescription("benchmark", plan.optics.camera, _INDEX_MAX),
    )
    cases = []
    for number, direction in enumerate(spiral_directions(plan.frames)):
        rng = np.random.default_rng(np.random.SeedSequence(plan.seed, spawn_key=(number,)))
        frame = maker.frame(direction, rng)
        if frame.real_stars >= plan.fewest_stars:
            panorama = Panorama(0, frame.xy_px, frame.brightness, number)
            cases.append(BenchmarkFrame(f"{number}", sensor, panorama, frame.attitude.boresight_icrs))
    conditions = cell.conditions
    name = f"seeded, {conditions.position_arcsec:g} arcsec, {conditions.false_objects} false"
    return PanoramaSet(name, tuple(cases))


def scores(options: IdentifierOptions, cases: Sequence[BenchmarkFrame], catalog: str) -> list[Score]:
    """The scores of an identifier, in the order of the cases."""
    found: dict[int, Score] = {}
    by_sensor: dict[SensorDescription, list[int]] = {}
    for place, case in enumerate(cases):
        by_sensor.setdefault(case.sensor, []).append(place)
    for sensor, places in by_sensor.items():
        of_sensor = [cases[place] for place in places]
        scored = _external if options.algorithm == "external" else _built_in
        found.update(zip(places, scored(options, sensor, of_sensor, catalog), strict=True))
    return [found[place] for place in range(len(cases))]


def row(identifier: str, panoramas: PanoramaSet, found: Sequence[Score]) -> dict[str, Any]:
    """A row of the table: shares with 95 % intervals, boresight errors of the right and coarse, times."""
    total = len(found)
    shares = {}
    for kind in KINDS:
        count = sum(score.kind == kind for score in found)
        bounds = interval(count, total)
        share = round(count / total, 6) if total else None
        shares[kind] = {"count": count, "share": share, "interval": bounds and [round(bound, 6) for bound in bounds]}
    near = np.array([score.error_arcsec for score in found if score.kind in ("right", "coarse")])
    errors, times = percentiles(near), percentiles(np.array([score.elapsed_us for score in found]) / 1000)
    failures = [score.failure for score in found if score.failure]
    return {
        "set": panoramas.name,
        "identifier": identifier,
        "panoramas": total,
        "rates": shares,
        "boresight_arcsec": {"median": _number(errors.p50), "p95": _number(errors.p95), "max": _number(errors.max)},
        "time_ms": {"median": _number(times.p50), "p95": _number(times.p95), "max": _number(times.max)},
        "failures": dict(sorted(Counter(failure.kind.value for failure in failures).items())),
        "first_failure": failures[0].detail if failures else None,
    }


def benchmark(
    identifiers: Sequence[IdentifierOptions], sets: Sequence[PanoramaSet], catalog: str
) -> Iterator[dict[str, Any]]:
    """The rows of every identifier on every set; UsageError, before any, where an external one cannot be started."""
    for options in identifiers:
        if options.algorithm == "external":
            plug_of(options, sets[0].cases[0].sensor)
    for panoramas in sets:
        for options in identifiers:
            yield row(options.label, panoramas, scores(options, panoramas.cases, catalog))


def table(rows: Sequence[dict[str, Any]]) -> list[str]:
    """The rows for a person, within 80 columns, below the name of their set."""
    head = f"{'identifier':11}{'n':>7}" + "".join(f"{kind + ' %':>9}" for kind in KINDS)
    lines: list[str] = []
    for name, of_set in itertools.groupby(rows, key=operator.itemgetter("set")):
        lines += [name, f"{head}{'error':>7}{'max':>6}{'median':>7}{'p95':>6}", *map(_line, of_set), ""]
    words = "error, max: boresight, median and largest, arcsec; median, p95: time, ms"
    return [*lines, words, *failure_lines(rows)]


def _line(one: dict[str, Any]) -> str:
    error, times = one["boresight_arcsec"], one["time_ms"]
    shares = "".join(f"{100 * (one['rates'][kind]['share'] or 0):9.2f}" for kind in KINDS)
    errors = f"{_text(error['median'], 1):>7}{_text(error['max'], 1):>6}"
    spent = f"{_text(times['median'], 3):>7}{_text(times['p95'], 2):>6}"
    return f"{one['identifier']:11.11}{one['panoramas']:7d}{shares}{errors}{spent}"


def _cases(path: Path) -> Iterator[BenchmarkFrame]:
    truths = _truths(path)
    tables = sorted({*path.parent.glob("*.csv"), *(path.parent / "tables").glob("*.csv")}, key=lambda one: one.stem)
    for number, one in enumerate(tables):
        names = [name for name in truths if one.stem == name or one.stem.startswith(f"{name}-")]
        if names:
            name = max(names, key=len)
            sensor, boresight = truths[name]
            yield BenchmarkFrame(one.stem, sensor, Panorama(0, *read_panorama_table(one), number), boresight)


def _truths(path: Path) -> dict[str, tuple[SensorDescription, NDArray[np.float64]]]:
    try:
        if path.stat().st_size > MOST_TRUTH_BYTES:
            raise TableError(f"{path} is larger than {MOST_TRUTH_BYTES} bytes: this is not a truth of panoramas")
        with open(path, encoding="utf-8", opener=only_a_file) as file:
            document = json.loads(file.read(MOST_TRUTH_BYTES))
    except OSError as error:
        raise TableError(f"cannot read {path}: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise TableError(f"{path} is not JSON: {error}") from error
    if not isinstance(document, dict):
        raise TableError(f"{path}: expected an object with an entry for each panorama")
    return {str(name): _truth(path, str(name), entry) for name, entry in document.items()}


def _truth(path: Path, name: str, entry: Any) -> tuple[SensorDescription, NDArray[np.float64]]:
    try:
        rows, columns = int(entry["rows"]), int(entry["columns"])
        x, y = entry.get("principal_point_px", ((columns - 1) / 2, (rows - 1) / 2))
        distortion = (float(entry.get("radial_distortion_k1", 0.0)), 0.0)
        camera = Camera(
            rows,
            columns,
            float(entry["focal_length_px"]),
            (float(x), float(y)),
            distortion,
            bool(entry.get("mirrored")),
        )
        ra, de = math.radians(float(entry["ra_deg"])), math.radians(float(entry["de_deg"]))
        values = (rows, columns, camera.focal_length_px, ra, de, *camera.principal_point_px)
        if not (all(map(math.isfinite, values)) and min(values[:3]) > 0):
            raise ValueError("a number is not finite, or a size not positive")
        if camera.fold():
            raise ValueError(f"a radial_distortion_k1 of {distortion[0]:g} folds the picture over")
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise TableError(
            f"{path}, {name}: {type(error).__name__}: {error}; expected rows, columns, focal_length_px, ra_deg, de_deg"
        ) from error
    boresight = np.array([math.cos(de) * math.cos(ra), math.cos(de) * math.sin(ra), math.sin(de)])
    return SensorDescription("benchmark", camera, int(entry.get("index_max", _INDEX_MAX))), boresight


@functools.lru_cache(maxsize=2)
def _catalog(source: str) -> StarCatalog:
    return load_catalog(source)


def _built_in(
    options: IdentifierOptions, sensor: SensorDescription, cases: Sequence[BenchmarkFrame], catalog: str
) -> Iterator[Score]:
    identifier = make_identifier(options, sensor.camera, _catalog(catalog))
    for place, case in enumerate((cases[0], *cases)):  # the first is done twice: once to load code and tables
        directions_sensor = sensor.camera.directions(case.panorama.xy_px)
        began_ns = time.thread_time_ns()
        answer = identifier.identify(directions_sensor, case.panorama.brightness)
        boresight = None
        if isinstance(answer, Identification):
            stars = identifier.catalog.icrs[answer.stars]
            boresight = solve_attitude(directions_sensor[answer.objects], stars, 10 * ARCSEC_RAD).boresight_icrs
        elapsed_us = (time.thread_time_ns() - began_ns) / 1000
        if place:
            yield _score(boresight, case, elapsed_us)


def _external(
    options: IdentifierOptions, sensor: SensorDescription, cases: Sequence[BenchmarkFrame], catalog: str
) -> Iterator[Score]:
    timeout_s = options.timeout_ms / 1000
    running = evaluated(plug_of(options, sensor), timeout_s)
    try:
        given = [in_time(one, timeout_s) for one in running.answers([case.panorama for case in cases])]
    finally:
        running.close()
    for case, one in zip(cases, given, strict=True):
        elapsed_us = _NAN if one.elapsed_us is None else one.elapsed_us
        if isinstance(one.answer, Failure):
            yield Score("none", _NAN, elapsed_us, one.answer)
            continue
        attitude = one.answer.attitude
        yield _score(None if attitude is None else attitude.boresight_icrs, case, elapsed_us)


def _score(boresight_icrs: NDArray[np.float64] | None, case: BenchmarkFrame, elapsed_us: float) -> Score:
    if boresight_icrs is None:
        return Score("none", _NAN, elapsed_us)
    error_rad = 2 * math.asin(min(1.0, math.dist(boresight_icrs, case.boresight_icrs) / 2))
    error_deg = math.degrees(error_rad)
    kind = "right" if error_deg <= RIGHT_DEG else "coarse" if error_deg <= COARSE_DEG else "false"
    return Score(kind, error_rad * ARCSEC_PER_RAD, elapsed_us)


def _number(value: float) -> float | None:
    return round(value, 4) if math.isfinite(value) else None


def _text(value: float | None, decimals: int) -> str:
    return "-" if value is None else f"{value:.{decimals}f}"
