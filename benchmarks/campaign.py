"""Time of a campaign against nights and workers, memory of a worker, the second run, and questions in SQL.

    python benchmarks/campaign.py                  10, 30 and 100 simulated nights of 60 s at 2 Hz
    python benchmarks/campaign.py --seconds 1200 --nights 10 100 1000

The nights are made by the workers, seeds 1, 2, 3 ... CPU seconds are those of the worker processes; wall-clock times
mean something on an idle machine only. Memory is the peak of a worker process.
"""

import argparse
import os
import resource
import tempfile
import time
from pathlib import Path

from distributed import Client

from drivers.mock.urls import sim_url
from gse import instant
from gse.campaign.cluster import cluster
from gse.campaign.dataset import DataSet
from gse.campaign.engine import plan_campaign, run_campaign
from gse.campaign.query import ask
from gse.campaign.sources import find_sources
from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.simulator.recording import record_simulation
from gse.truth import EarthOrientation

FIRST_NS = instant.from_text("2026-01-01T14:00:00Z")
RATE_HZ = 2
SQL = "select sensor, verdict, count(*), avg(onboard_d_de_bias_arcsec) from sessions group by all"


def make_night(path: str, number: int, seconds: float) -> None:
    """One simulated evening, 24 h after the one before."""
    start = instant.to_text(FIRST_NS + number * instant.NS_PER_DAY)
    options = {"scenario": "clear-zenith", "start": start, "rate_hz": str(RATE_HZ), "seed": str(number + 1)}
    url = sim_url(**options, frames=str(round(seconds * RATE_HZ)))
    station = parse_station(BUILT_IN_TEXT)
    station = station.model_copy(update={"port": station.port.model_copy(update={"url": url})})
    orientation = EarthOrientation.from_disk(instant.from_text(start)).to_json()
    record_simulation(Path(path), station, BUILT_IN_TEXT, orientation)


def cpu_s(client: Client) -> float:
    """CPU seconds that the workers have used."""
    return sum(client.run(time.process_time).values())


def peak_mib(client: Client) -> float:
    """The most memory that a worker held."""
    return max(client.run(_peak_kib).values()) / 1024


def _peak_kib() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def judged(sources: Path, to: Path, client: Client) -> tuple[float, float]:
    """Wall-clock and CPU seconds of a run."""
    before, started = cpu_s(client), time.perf_counter()
    run_campaign(plan_campaign(find_sources([str(sources)]), DataSet.at(str(to), create=True)), client)
    return time.perf_counter() - started, cpu_s(client) - before


def timed(act) -> float:
    """Wall-clock seconds."""
    started = time.perf_counter()
    act()
    return time.perf_counter() - started


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--nights", type=int, nargs="+", default=[10, 30, 100])
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2])
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="gse-campaign-") as folder:
        root = Path(folder)
        nights = [root / "nights" / f"{number:05d}.mcap" for number in range(max(arguments.nights))]
        nights[0].parent.mkdir()
        with cluster(None, max(arguments.workers)) as client:
            seconds = [arguments.seconds] * len(nights)
            client.gather(client.map(make_night, [str(path) for path in nights], range(len(nights)), seconds))
        print(f"nights of {arguments.seconds:g} s at {RATE_HZ} Hz")
        head = ("workers", "nights", "wall s", "CPU s", "CPU s a night", "busy", "MiB", "again s", "SQL s")
        print(("{:>14}" * len(head)).format(*head))
        for workers in arguments.workers:
            with cluster(None, workers) as client:
                warm = root / f"warm-{workers}"
                warm.mkdir()
                for number in range(workers):
                    os.link(nights[number], warm / nights[number].name)
                judged(warm, root / f"warm-dataset-{workers}", client)
                for count in arguments.nights:
                    some = root / f"{workers}-{count}"
                    some.mkdir()
                    for path in nights[:count]:
                        os.link(path, some / path.name)
                    dataset = root / f"dataset-{workers}-{count}"
                    wall_s, busy_s = judged(some, dataset, client)
                    again_s = timed(lambda some=some, to=dataset: judged(some, to, client))
                    with open(os.devnull, "w") as nowhere:
                        sql_s = timed(lambda to=dataset: ask(DataSet.at(str(to)), SQL, "json", nowhere))
                    row = (wall_s, busy_s, busy_s / count, busy_s / wall_s / workers, peak_mib(client), again_s, sql_s)
                    print(f"{workers:14}{count:14}" + "".join(f"{value:14.2f}" for value in row), flush=True)


if __name__ == "__main__":
    main()
