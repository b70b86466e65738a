"""The Dask cluster of a campaign: worker processes of this machine, or a scheduler by its address.

The own cluster listens on 127.0.0.1 alone, with certificates made for the run, so that no other user of this machine
can talk to it, and without a dashboard or other page. Each worker is a process with one thread. Lost workers, retries
and the order of work are Dask's; its settings (``distributed.scheduler.worker-ttl``, ``distributed.comm.tls``) hold.
"""

import functools
import itertools
import logging
import signal
import threading
import uuid
from collections import deque
from collections.abc import Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from multiprocessing import resource_tracker

import dask
from distributed import Client, Future, LocalCluster
from distributed.scheduler import KilledWorker

from gse.errors import CampaignError, UsageError
from gse.evaluation.monte_carlo import Evaluator, tasks
from gse.evaluation.plan import FrameOutcome, Plan
from gse.process.interrupts import interrupt
from gse.report.provenance import software_sha256

LOOPBACK = "127.0.0.1"
RETRIES = 2
"""A session whose worker ended is judged so many times more."""
MORE_WORKERS = 8
"""A task that has ended this many workers more is taken to be the cause."""
WHY_ENDED = "for want of memory, or because the computer was too busy for them"
_NO_PAGES: dict[str, object] = {"distributed.scheduler.http.routes": [], "distributed.worker.http.routes": []}
_NO_PROFILE = {"distributed.worker.profile.enabled": False}
"""Dask samples the stack of each worker all the time and keeps what it saw: 0.2 MB a session, which nobody reads."""
_PATIENT: dict[str, object] = {"distributed.scheduler.worker-ttl": None}
"""A worker of this computer that says nothing for minutes is only slow: one that ended closes its connection."""
_ADDRESSES = ("tcp://", "tls://", "ucx://", "ws://", "wss://")


@contextmanager
def cluster(scheduler: str | None, workers: int) -> Iterator[Client]:
    """A client of the cluster; UsageError where there is none, or its workers run another version."""
    _quiet()
    with _ended_in_order():
        if scheduler is not None:
            with _connected(scheduler) as client:
                _check_software(client, scheduler)
                yield client
            return
        with _own(workers) as client:
            yield client


def past_lost_workers(future: Future) -> Future:
    """The future of a task when it has ended, whoever else ended the workers that it was given to.

    Dask gives up a task on its fourth lost worker, also one that only waited there.
    """
    for _ in range(MORE_WORKERS):
        if not isinstance(future.exception(), KilledWorker):
            break
        future.retry()
    return future


@contextmanager
def _ended_in_order() -> Iterator[None]:
    """SIGTERM and the hang-up of the terminal end a run as Ctrl-C does: the workers are ended first."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    names = (name for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name))
    numbers = [signal.Signals[name] for name in names if signal.getsignal(signal.Signals[name]) is signal.SIG_DFL]
    for number in numbers:
        signal.signal(number, interrupt)
    try:
        yield
    finally:
        for number in numbers:
            signal.signal(number, signal.SIG_DFL)


@contextmanager
def _uninterrupted() -> Iterator[None]:
    """A block in which Dask begins or ends: a signal that comes takes effect after it.

    Its new threads, and the processes that these start, get no Ctrl-C and no hang-up of the terminal, which are for
    this process: it ends the others. A termination is only put off, since Dask ends workers by one.
    """
    came: list[int] = []
    in_main_thread = threading.current_thread() is threading.main_thread()
    on_termination = signal.signal(signal.SIGTERM, lambda number, _: came.append(number)) if in_main_thread else None
    try:
        with _interrupts_blocked():
            yield
    finally:
        if in_main_thread:
            signal.signal(signal.SIGTERM, on_termination)
    for number in came:
        signal.raise_signal(number)


@contextmanager
def _interrupts_blocked() -> Iterator[None]:
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGHUP,))
    try:
        # Its start unblocks SIGINT for the thread that needs it first.
        resource_tracker.ensure_running()
        signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT,))
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _own(workers: int) -> Iterator[Client]:
    """Workers of this machine share its memory: Dask's default limit is each one's share."""
    with dask.config.set(_NO_PAGES | _NO_PROFILE | _PATIENT):
        with _uninterrupted():
            local = _started(workers)
            client = Client(local, set_as_default=False)
        try:
            yield client
        finally:
            # A worker that does not end in time, on a busy host, ends with this process; its work is done.
            with _uninterrupted(), suppress(TimeoutError):
                client.close()
                local.close()


def _started(workers: int) -> LocalCluster:
    try:
        return LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            host=LOOPBACK,
            # Without a dashboard Dask opens port 8787 all the same, and complains where somebody has it.
            scheduler_kwargs={"dashboard": False, "dashboard_address": f"{LOOPBACK}:0"},
            worker_dashboard_address=None,
            security=True,
            silence_logs=logging.CRITICAL,
        )
    except (RuntimeError, OSError) as error:
        raise UsageError(
            f"Dask cannot start its workers ({str(error).rstrip('.')}); each needs 400 MiB of memory and some 50 open "
            "files (ulimit -n, ulimit -v): choose fewer --workers, or give them more"
        ) from error


@contextmanager
def _connected(scheduler: str) -> Iterator[Client]:
    if not scheduler.startswith(_ADDRESSES):
        raise UsageError(f"--scheduler {scheduler} is not an address; expected for example tcp://127.0.0.1:8786")
    try:
        client = Client(scheduler, set_as_default=False)
    except (OSError, ValueError, RuntimeError, TypeError) as error:  # TypeError: TLS without certificates
        raise UsageError(
            f"no Dask scheduler answers at {scheduler} ({error}); start one with 'dask scheduler', and state its "
            "certificates here if it uses TLS (docs/campaigns.md)"
        ) from error
    with client:
        yield client


def _check_software(client: Client, scheduler: str) -> None:
    """Workers that judge by other code would write results under keys that are not theirs."""
    own = software_sha256()
    try:
        client.wait_for_workers(1, timeout=dask.config.get("distributed.comm.timeouts.connect", "30s"))
        found = client.run(software_sha256, on_error="return")
    except TimeoutError as error:
        raise CampaignError(
            f"the scheduler at {scheduler} has no workers; start some with 'dask worker {scheduler} --nthreads 1'"
        ) from error
    answers = {worker: answer for worker, answer in found.items() if not isinstance(answer, OSError)}  # lost ones
    if fault := next((answer for answer in answers.values() if isinstance(answer, Exception)), None):
        raise UsageError(f"the workers of {scheduler} cannot run this program ({fault}); install the same gse there")
    others = sorted(worker for worker, software in answers.items() if software != own)
    if others:
        raise UsageError(
            f"{', '.join(others[:3])} of {scheduler} run another gse, or other packages; install the same everywhere"
        )


def _quiet() -> None:
    """Dask's own log goes to the log of its scheduler and workers; here it would tear the progress bar.

    asyncio tells each connection of Dask's that finds no free file, thousands of times a second.
    """
    for name in ("distributed", "distributed.client", "distributed.core", "distributed.comm", "asyncio"):
        logging.getLogger(name).setLevel(logging.CRITICAL)


# ``gse evaluate`` on a Dask cluster: the same chunks, in the same order, whoever does them.

_CHUNKS_AT_ONCE = 40
"""1,000 frames a task: Dask needs a millisecond for each."""
_QUEUED_PER_WORKER = 3

Chunk = tuple[int, range]


def outcomes_on(scheduler: str, plan: Plan) -> Iterator[list[FrameOutcome]]:
    """The outcomes of a plan, as gse.evaluation.monte_carlo.outcomes gives them.

    CampaignError where the scheduler goes away, or frames end their workers.
    """
    run = uuid.uuid4().hex
    with cluster(scheduler, 1) as client:
        most = _QUEUED_PER_WORKER * max(len(client.scheduler_info(n_workers=-1)["workers"]), 1)
        waiting = (
            client.submit(work, plan, chunks, key=f"evaluate-{run}-{number}", retries=RETRIES, pure=False)
            for number, chunks in enumerate(_batched(tasks(plan)))
        )
        queued = deque(itertools.islice(waiting, most))
        try:
            while queued:
                yield past_lost_workers(queued.popleft()).result()
                queued.extend(itertools.islice(waiting, 1))
        except (CancelledError, OSError) as error:
            raise CampaignError("the scheduler is gone: the evaluation has no result; start it again") from error
        except KilledWorker as error:
            raise CampaignError(
                f"some frames ended their workers again and again: {WHY_ENDED}; there is no result"
            ) from error


def work(plan: Plan, chunks: list[Chunk]) -> list[FrameOutcome]:
    """The outcomes of some chunks; what a worker does."""
    evaluator = _evaluator(plan)
    return [outcome for cell, frames in chunks for outcome in evaluator.run(cell, frames)]


def _batched(chunks: Iterator[Chunk]) -> Iterator[list[Chunk]]:
    while batch := list(itertools.islice(chunks, _CHUNKS_AT_ONCE)):
        yield batch


@functools.lru_cache(maxsize=1)
def _evaluator(plan: Plan) -> Evaluator:
    return Evaluator(plan)
