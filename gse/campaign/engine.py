"""Run of a campaign: sources in, a data set out, what is new alone.

What is judged already is left alone: by size and time of change of the source, without reading it, or with ``rehash``
by its content. Sessions go to the cluster one by one; Dask gives those of a lost worker to another one.
"""

import uuid
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from distributed import Client, as_completed
from distributed.scheduler import KilledWorker

from gse.campaign.cluster import RETRIES, WHY_ENDED, past_lost_workers
from gse.campaign.dataset import OWN_STATION, DataSet
from gse.campaign.judging import LIMIT_S, Job, JudgedSource, judge_source
from gse.campaign.sources import SessionSource
from gse.campaign.storage import StorageError, with_patience
from gse.config.choice import StationText
from gse.errors import CampaignError
from gse.report.provenance import software_sha256


@dataclass(frozen=True, slots=True)
class Campaign:
    """What a run is to do: ``todo`` are sources to look at, ``unchanged`` those that are judged already."""

    job: Job
    dataset: DataSet
    todo: tuple[SessionSource, ...]
    unchanged: tuple[JudgedSource, ...]


def plan_campaign(
    sources: Iterable[SessionSource],
    dataset: DataSet,
    *,
    station: StationText | None = None,
    station_sha256: str = OWN_STATION,
    rehash: bool = False,
    limit_s: float = LIMIT_S,
) -> Campaign:
    """Find out which sources are new to a data set; with ``rehash`` all are read."""
    job = Job(uuid.uuid4().hex, dataset.url, station, station_sha256, limit_s)
    committed = {place.key: place for place in dataset.committed()}
    known = {} if rehash else _known(dataset, station_sha256)
    todo, unchanged = [], []
    for source in sources:
        row = known.get((source.url, source.state))
        place = committed.get(row["key"]) if row else None
        if row is None or place is None:
            todo.append(source)
        else:
            unchanged.append(
                JudgedSource(source, place.key, row["session_sha256"], sensor=place.sensor, night=place.night)
            )
    return Campaign(job, dataset, tuple(todo), tuple(unchanged))


def run_campaign(
    campaign: Campaign, client: Client, each: Callable[[JudgedSource], None] = lambda judged: None
) -> list[JudgedSource]:
    """Judge what is new; the outcome of every source, those that were unchanged first.

    CampaignError where the scheduler goes away, or the data set's storage is gone or full: what was judged until then
    is kept.
    """
    outcomes = list(campaign.unchanged)
    try:
        for judged in _run(campaign, client):
            outcomes.append(judged)
            each(judged)
            if judged.ends_run:
                raise CampaignError(f"{judged.error}; {_done(campaign, outcomes)}")
    except BaseException:
        with suppress(StorageError):
            campaign.dataset.renew_index(_source_rows(campaign, outcomes), _rows(outcomes))
        raise
    url, sources, rows = campaign.dataset.url, _source_rows(campaign, outcomes), _rows(outcomes)
    with_patience(url, lambda fs, root: DataSet(url, fs, root).renew_index(sources, rows))
    return outcomes


def _run(campaign: Campaign, client: Client) -> Iterator[JudgedSource]:
    futures = {
        # A key of this run's own: another campaign on the same scheduler may have the same source.
        client.submit(
            judge_source, source, campaign.job, key=f"judge-{campaign.job.name}-{number}", retries=RETRIES, pure=False
        ): source
        for number, source in enumerate(campaign.todo)
    }
    waiting = as_completed(futures, loop=client.loop)
    for number in range(len(futures)):
        try:
            future = next(waiting)
            source = futures.pop(future)
            yield _outcome(past_lost_workers(future), source)
        except (CancelledError, OSError, StopIteration) as error:
            left = len(campaign.todo) - number
            raise CampaignError(
                f"the scheduler is gone, with {left} of {len(campaign.todo)} sessions not judged; what was judged is "
                "kept: start the same command again"
            ) from error


def _outcome(future: Any, source: SessionSource) -> JudgedSource:
    error = future.exception()
    if error is None:
        judged = future.result()
        future.release()
        assert isinstance(judged, JudgedSource)
        return judged
    if isinstance(error, CancelledError):
        raise error
    if isinstance(error, KilledWorker):
        return JudgedSource(source, error=f"{source.url} ended its workers again and again: {WHY_ENDED}")
    return JudgedSource(source, error=f"{source.url} could not be judged: {type(error).__name__}: {error}")


def _known(dataset: DataSet, station_sha256: str) -> dict[tuple[str, str], dict[str, Any]]:
    software = software_sha256()
    return {
        (row["url"], row["state"]): row
        for row in dataset.sources()
        if row["station_sha256"] == station_sha256 and row["software_sha256"] == software
    }


def _rows(outcomes: Iterable[JudgedSource]) -> dict[str, bytes]:
    """The packed rows of the index, by key."""
    return {one.key: one.row for one in outcomes if one.row}


def _source_rows(campaign: Campaign, outcomes: Iterable[JudgedSource]) -> list[dict[str, Any]]:
    common = {"station_sha256": campaign.job.station_sha256, "software_sha256": software_sha256()}
    return [
        {
            "url": one.source.url,
            "state": one.source.state,
            "session_sha256": one.session_sha256,
            "key": one.key,
            **common,
        }
        for one in outcomes
        if one.key
    ]


def _done(campaign: Campaign, outcomes: list[JudgedSource]) -> str:
    kept = sum(1 for one in outcomes if one.key)
    return (
        f"at least {kept} of {len(campaign.todo) + len(campaign.unchanged)} sessions are in the data set, each whole: "
        "start the same command again"
    )
