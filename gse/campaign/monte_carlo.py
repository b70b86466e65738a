"""``gse evaluate`` on a Dask cluster: the same chunks, in the same order, whoever does them."""

import functools
import itertools
import uuid
from collections import deque
from collections.abc import Iterator
from concurrent.futures import CancelledError

from distributed.scheduler import KilledWorker

from gse.campaign.cluster import RETRIES, cluster, past_lost_workers
from gse.errors import CampaignError
from gse.evaluation.monte_carlo import Evaluator, tasks
from gse.evaluation.plan import Outcome, Plan

_CHUNKS_AT_ONCE = 40
"""1,000 frames a task: Dask needs a millisecond for each."""
_QUEUED_PER_WORKER = 3

Chunk = tuple[int, range]


def outcomes_on(scheduler: str, plan: Plan) -> Iterator[list[Outcome]]:
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
                "some frames ended their workers again and again, perhaps for want of memory: there is no result"
            ) from error


def work(plan: Plan, chunks: list[Chunk]) -> list[Outcome]:
    """The outcomes of some chunks; what a worker does."""
    evaluator = _evaluator(plan)
    return [outcome for cell, frames in chunks for outcome in evaluator.run(cell, frames)]


def _batched(chunks: Iterator[Chunk]) -> Iterator[list[Chunk]]:
    while batch := list(itertools.islice(chunks, _CHUNKS_AT_ONCE)):
        yield batch


@functools.lru_cache(maxsize=1)
def _evaluator(plan: Plan) -> Evaluator:
    return Evaluator(plan)
