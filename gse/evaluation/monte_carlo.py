"""Monte-Carlo over spiral directions: how often an identifier is right, and how long it takes.

Right: the boresight within 0.05 deg of the truth. Coarse: most stars right, the boresight 0.05 to 0.5 deg off. False:
any other answer. None: no answer. Rates are those of the frames with at least 4 real stars; what was answered in the
others is counted beside them.

With noise on angles (pivot paper, section 4) there are no directions: right is the first star named right, any other
answer is false, and the frames with at least 3 real stars count. The stars that step 2 names are counted one by one.
"""

import math
import multiprocessing
import signal
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from itertools import takewhile
from types import FrameType

import numpy as np
from numpy.typing import NDArray

from gse.catalog import StarCatalog, brightest_per_field, load_catalog, merge_doubles
from gse.errors import GseError
from gse.evaluation.frames import Conditions, FrameMaker, Optics, SimulatedFrame
from gse.evaluation.plan import Cell, FrameOutcome, Plan
from gse.external.answers import Failure
from gse.external.identifier import ExternalIdentifier, evaluated, in_time
from gse.external.panoramas import SensorDescription
from gse.external.plugs import plug_of
from gse.identifier import Identification, Identifier, Unidentified, make_identifier
from gse.identifier.pivot import PIVOT_MEMBERS
from gse.process.interrupts import interrupt
from gse.values.attitude import solve_attitude
from gse.values.constants import ARCSEC_RAD
from gse.values.limits import Limits
from gse.values.matrices import product
from gse.values.panorama import Panorama
from gse.values.spiral import spiral_directions

RIGHT_DEG, COARSE_DEG = Limits().false_beyond_arcsec / 3600, 0.5

FAINTER = 0.9
"""The catalogue of ``robust`` reaches so far beyond the sensor's limit."""

_INDEX_MAX = 4096
_CHUNK_FRAMES = 25
_QUEUED_PER_WORKER = 4
"""Chunks handed over ahead, so that no worker waits."""
_LOOK_EVERY_S = 0.2

_WARM_UP_FRAMES = 3
_DOUBLES_RAD = 60 * ARCSEC_RAD
_LEAST_TOLERANCE_ARCSEC = 1.0
_INDEX_ZERO_POINT = 2.5 * math.log10(4096) - 7.5
"""Magnitude of index 1 above the limit, as the simulated frames have it."""


class Evaluator:
    """Makes the frames of a plan and has them identified; tables are built when a cell first needs them."""

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self._source = load_catalog(plan.catalog)
        self._ready: dict[int, tuple[FrameMaker, Identifier | ExternalIdentifier]] = {}

    def run(self, cell: int, frames: range, stop: Callable[[], bool] = lambda: False) -> list[FrameOutcome]:
        """The outcomes of some frames of a cell, up to the first before which ``stop`` is true."""
        if cell not in self._ready:
            self._ready[cell] = self._prepared(self._plan.cells[cell])
            self._outcomes(cell, range(min(_WARM_UP_FRAMES, self._plan.frames)), stop)
        return self._outcomes(cell, frames, stop)

    def _outcomes(self, cell: int, frames: range, stop: Callable[[], bool]) -> list[FrameOutcome]:
        directions = spiral_directions(self._plan.frames, frames)  # of all frames they would be 240 MB for 10^7
        wanted = takewhile(lambda _: not stop(), zip(frames, directions, strict=True))
        return [self._outcome(cell, *each) for each in wanted]

    def _prepared(self, cell: Cell) -> tuple[FrameMaker, Identifier | ExternalIdentifier]:
        plan, conditions = self._plan, cell.conditions
        if plan.angle_noise:
            known, sky = (of_angles(self._source, limit) for limit in (plan.optics.magnitude_limit, cell.sky_limit))
            mission = brightest_per_field(known, 2 * plan.optics.radius_rad())
            exact = Conditions(conditions.name, 0.0, conditions.magnitude, whole_pixels=False, merge_px=0.0)
            return FrameMaker(plan.optics, exact, sky), _for_angles(cell, plan.optics, mission)
        return FrameMaker(plan.optics, conditions, self._source), _for_field(cell, plan.optics, self._source)

    def _outcome(self, cell: int, frame: int, direction: NDArray[np.float64]) -> FrameOutcome:
        maker, identifier = self._ready[cell]
        rng = np.random.default_rng(np.random.SeedSequence(self._plan.seed, spawn_key=(frame,)))
        seen = maker.frame(direction, rng)
        if isinstance(identifier, ExternalIdentifier):
            timeout_s = self._plan.cells[cell].identifier.timeout_ms / 1000
            kind, elapsed_us, failure = _asked(identifier, seen, frame, timeout_s)
            return FrameOutcome(cell, frame, kind, seen.real_stars, elapsed_us, failure)
        sigma_rad = self._plan.cells[cell].conditions.position_arcsec * ARCSEC_RAD
        identify = _by_angles(identifier, seen, sigma_rad, rng) if self._plan.angle_noise else _whole(identifier, seen)
        started_ns = time.thread_time_ns()
        answer = identify()
        cpu_us = (time.thread_time_ns() - started_ns) / 1000
        step_2 = (0, 0)
        if isinstance(answer, Unidentified):
            kind = "none"
        elif isinstance(answer, Identification):
            kind = graded(answer, identifier.catalog, seen)
        else:
            is_right = identifier.catalog.ids[answer[1]] == seen.star_ids[answer[0]]
            later = is_right[min(PIVOT_MEMBERS, len(seen.brightness) - int(answer[0][0])) :]
            kind, step_2 = "right" if is_right[0] else "false", (len(later), int(later.sum()))
        return FrameOutcome(cell, frame, kind, seen.real_stars, cpu_us, step_2=step_2)


def of_angles(source: StarCatalog, magnitude_limit: float) -> StarCatalog:
    """The stars to a limit, adjacent ones made one: what the pivot paper chooses its mission catalogue from."""
    return merge_doubles(source.rows(np.flatnonzero(source.magnitude <= magnitude_limit)), _DOUBLES_RAD)


def graded(answer: Identification, catalog: StarCatalog, frame: SimulatedFrame) -> str:
    """Right, coarse or false."""
    found = solve_attitude(frame.directions_sensor[answer.objects], catalog.icrs[answer.stars], 10 * ARCSEC_RAD)
    distance = math.dist(found.boresight_icrs, frame.attitude.boresight_icrs)
    error_deg = math.degrees(2 * math.asin(min(1.0, distance / 2)))
    if error_deg <= RIGHT_DEG:
        return "right"
    mostly = float((catalog.ids[answer.stars] == frame.star_ids[answer.objects]).mean()) > 0.5
    return "coarse" if mostly and error_deg <= COARSE_DEG else "false"


def _asked(
    identifier: ExternalIdentifier, frame: SimulatedFrame, number: int, timeout_s: float
) -> tuple[str, float, Failure | None]:
    """Kind of an external identifier's answer, by its boresight alone, its time in microseconds, and its failure."""
    (answer,) = identifier.source.answers([Panorama(0, frame.xy_px, frame.brightness, number)])
    given = in_time(answer, timeout_s)
    elapsed_us = math.nan if given.elapsed_us is None else given.elapsed_us
    if isinstance(given.answer, Failure):
        return "none", elapsed_us, given.answer
    attitude = given.answer.attitude
    if attitude is None:
        return "none", elapsed_us, None
    distance = math.dist(attitude.boresight_icrs, frame.attitude.boresight_icrs)
    error_deg = math.degrees(2 * math.asin(min(1.0, distance / 2)))
    kind = "right" if error_deg <= RIGHT_DEG else "coarse" if error_deg <= COARSE_DEG else "false"
    return kind, elapsed_us, None


_Named = tuple[NDArray[np.int64], NDArray[np.int64]]
_Identify = Callable[[], Identification | Unidentified | _Named]


def _whole(identifier: Identifier, frame: SimulatedFrame) -> _Identify:
    return lambda: identifier.identify(frame.directions_sensor, frame.brightness)


def _by_angles(identifier: Identifier, frame: SimulatedFrame, sigma_rad: float, rng: np.random.Generator) -> _Identify:
    from gse.identifier.consistency import Separations
    from gse.identifier.pivot import PivotIdentifier

    assert isinstance(identifier, PivotIdentifier)
    pivot = identifier
    v = frame.directions_sensor
    noise = np.triu(rng.normal(0, sigma_rad, (len(v), len(v))), 1)
    angles = np.abs(np.arccos(np.clip(product(v, v.T), -1, 1)) + noise + noise.T)
    np.fill_diagonal(angles, 0.0)
    return lambda: pivot.identify_angles(Separations(np.cos(angles), np.sin(angles)), frame.brightness)


def _for_angles(cell: Cell, optics: Optics, mission: StarCatalog) -> Identifier:
    """``pivot`` or ``match-group`` with a tolerance of three sigma and the frames' own zero point."""
    from gse.identifier.match_group import MatchGroupIdentifier
    from gse.identifier.pivot import PivotIdentifier

    tolerance_rad = max(3 * cell.conditions.position_arcsec, _LEAST_TOLERANCE_ARCSEC) * ARCSEC_RAD
    field_rad = 2 * optics.radius_rad()
    if cell.identifier.algorithm == "pivot":
        return PivotIdentifier(mission, field_rad, tolerance_rad)
    zero_point = optics.magnitude_limit + _INDEX_ZERO_POINT
    return MatchGroupIdentifier(mission, field_rad, tolerance_rad, zero_point=zero_point)


def _for_field(cell: Cell, optics: Optics, source: StarCatalog) -> Identifier | ExternalIdentifier:
    if cell.identifier.algorithm == "external":
        plug = plug_of(cell.identifier, SensorDescription(optics.name, optics.camera, _INDEX_MAX))
        return ExternalIdentifier(source, evaluated(plug, cell.identifier.timeout_ms / 1000))
    if cell.identifier.algorithm != "robust":
        return make_identifier(cell.identifier, optics.camera, source)
    from gse.identifier.robust import RobustIdentifier

    stars = int((source.magnitude < optics.magnitude_limit + FAINTER).sum())
    return RobustIdentifier(optics.camera, source, stars=stars, field_of_view_deg=optics.field_of_view_deg)


def outcomes(plan: Plan, workers: int = 1) -> Iterator[list[FrameOutcome]]:
    """The outcomes chunk by chunk, the same in the same order for any number of worker processes.

    Chunks are strided over the spiral and go through the cells in turn, so that the first of them, where the rest is
    given up, show the whole sky in every cell.
    """
    if workers == 1:
        bench = Evaluator(plan)
        with _interrupt_noted() as interrupted:
            for cell, frames in tasks(plan):
                yield bench.run(cell, frames, interrupted.is_set)
                if interrupted.is_set():
                    raise KeyboardInterrupt
        return
    load_catalog(plan.catalog)  # so that its errors are raised here, not in a worker that cannot start
    context = multiprocessing.get_context("spawn")
    executor = ProcessPoolExecutor(workers, context, initializer=_start_worker, initargs=(plan,))
    queued: deque[Future[list[FrameOutcome]]] = deque()
    try:
        with _interrupt_noted() as interrupted:
            for task in tasks(plan):
                with _interrupts_held():
                    queued.append(executor.submit(_work, *task))
                if len(queued) == _QUEUED_PER_WORKER * workers:
                    yield _result(queued.popleft(), interrupted)
            while queued:
                yield _result(queued.popleft(), interrupted)
    except BrokenProcessPool as error:
        raise GseError("a worker process ended by itself, perhaps for want of memory; try fewer --workers") from error
    except (KeyboardInterrupt, GeneratorExit):
        executor.shutdown(wait=False, cancel_futures=True)
        for child in multiprocessing.active_children():
            child.terminate()
        raise
    executor.shutdown()


def tasks(plan: Plan) -> Iterator[tuple[int, range]]:
    """The chunks of a plan, each a cell and some of its frames, in the order of the outcomes."""
    chunks = math.ceil(plan.frames / _CHUNK_FRAMES)
    return ((cell, range(c, plan.frames, chunks)) for c in range(chunks) for cell in range(len(plan.cells)))


def _result(future: Future[list[FrameOutcome]], interrupted: threading.Event) -> list[FrameOutcome]:
    """The result of a worker; KeyboardInterrupt soon after a Ctrl-C, wherever it came."""
    while not interrupted.is_set():
        if wait([future], _LOOK_EVERY_S).done:
            return future.result()
    raise KeyboardInterrupt


@contextmanager
def _interrupt_noted() -> Iterator[threading.Event]:
    """The first Ctrl-C sets the event.

    As an exception it may end the process in compiled code (SIGSEGV), and is lost where Python ignores exceptions.
    """
    noted = threading.Event()

    def note(number: int, frame: FrameType | None) -> None:
        if noted.is_set():
            interrupt(number, frame)
        noted.set()

    before = None
    with suppress(ValueError):  # not in the main thread: nobody interrupts it
        before = signal.signal(signal.SIGINT, note)
    try:
        yield noted
    finally:
        if before is not None:
            signal.signal(signal.SIGINT, before)


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Ctrl-C is held back, and processes started meanwhile ignore it: they would print tracebacks as they start."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


_worker_bench: list[Evaluator] = []


def _start_worker(plan: Plan) -> None:
    with suppress(ValueError):
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    _worker_bench[:] = [Evaluator(plan)]


def _work(cell: int, frames: range) -> list[FrameOutcome]:
    return _worker_bench[0].run(cell, frames)
