"""Time of a campaign against nights and workers, memory of a worker, the second run, its report, questions in SQL.

    python benchmarks/campaign.py                  10, 30 and 100 simulated nights of 60 s at 2 Hz, 10,000 rows in SQL
    python benchmarks/campaign.py --seconds 1200 --nights 10 100 1000 --sessions FOLDER

A campaign grows: to 10 nights first, then to 30 with what is new, and so on; seconds are of all nights so far. The
nights are made by the workers, seeds 1, 2, 3 ..., into --sessions, where those that are there already are taken. CPU
seconds are those of the worker processes, of the second run and the rest those of this one; wall-clock times mean
something on an idle machine only. Memory is the peak of a worker process. The rows in SQL are those of the campaign,
copied under other keys and nights, without their report.json.
"""

import argparse
import hashlib
import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import pyarrow as pa
from distributed import Client

from drivers.mock_ports import sim_url
from gse.campaign.cluster import cluster
from gse.campaign.dataset import INDEX, SESSIONS, Committed, DataSet, parquet_of
from gse.campaign.document import campaign_document
from gse.campaign.engine import plan_campaign, run_campaign
from gse.campaign.first_compilation import compile_first
from gse.campaign.page import write_campaign_report
from gse.campaign.query import ask
from gse.campaign.sources import find_sources
from gse.campaign.storage import put_whole
from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.simulator.recording import record_simulation
from gse.truth import EarthOrientation
from gse.values import instant

FIRST_NS = instant.from_text("2026-01-01T14:00:00Z")
RATE_HZ = 2
QUESTIONS = (
    "select sensor, verdict, count(*), avg(onboard_d_de_bias_arcsec) from sessions group by all",
    "select night, onboard_d_de_nea_arcsec from sessions order by 2 desc limit 10",
)


def make_night(path: str, number: int, seconds: float) -> None:
    """One simulated evening, 24 h after the one before."""
    if Path(path).exists():
        return
    start = instant.to_text(FIRST_NS + number * instant.NS_PER_DAY)
    options = {"scenario": "clear-zenith", "start": start, "rate_hz": str(RATE_HZ), "seed": str(number + 1)}
    url = sim_url(**options, frames=str(round(seconds * RATE_HZ)))
    station = parse_station(BUILT_IN_TEXT)
    station = station.model_copy(update={"port": station.port.model_copy(update={"url": url})})
    orientation = EarthOrientation.from_disk(instant.from_text(start)).to_json()
    record_simulation(Path(f"{path}.part"), station, BUILT_IN_TEXT, orientation)
    Path(f"{path}.part").rename(path)


def cpu_s(client: Client) -> float:
    """CPU seconds that the workers have used."""
    return sum(client.run(time.process_time).values())


def peak_mib(client: Client) -> float:
    """The most memory that a worker held."""
    return max(client.run(_peak_kib).values()) / 1024


def _peak_kib() -> int:
    """Of this process alone: the peak that getrusage gives is at first that of the process which started it."""
    status = Path("/proc/self/status").read_text()
    return next(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmHWM:"))


def judged(sources: Path, to: Path, client: Client) -> tuple[float, float]:
    """CPU seconds of the workers in a run, and seconds by the clock."""
    before, began_s = cpu_s(client), time.perf_counter()
    run_campaign(plan_campaign(find_sources([str(sources)]), DataSet.at(str(to), create=True)), client)
    clock_s = time.perf_counter() - began_s
    return cpu_s(client) - before, clock_s


def timed(act: Callable[[], object]) -> str:
    """CPU and wall-clock seconds of this process."""
    began_s, began_cpu_s = time.perf_counter(), time.process_time()
    act()
    return f"{time.process_time() - began_cpu_s:.2f} ({time.perf_counter() - began_s:.2f})"


def asked(dataset: DataSet) -> None:
    """Ask all questions."""
    with open(os.devnull, "w") as nowhere:
        for question in QUESTIONS:
            ask(dataset, question, "json", nowhere)


def copied(dataset: DataSet, to: Path, count: int) -> DataSet:
    """A data set of so many sessions: the index has the rows of another one, and the files are links to one of its."""
    copies, rows = DataSet.at(str(to), create=True), dataset.sessions()
    nights = [instant.to_text(FIRST_NS + number * instant.NS_PER_DAY)[:10] for number in range(count)]
    keys = [hashlib.sha256(night.encode()).hexdigest() for night in nights]
    places = [Committed("copy", night, key) for night, key in zip(nights, keys, strict=True)]
    one_file = next(path for path in (Path(dataset.root) / SESSIONS).rglob("*.parquet"))
    for place in places:
        path = to / place.path(SESSIONS)
        path.parent.mkdir(parents=True)
        os.link(one_file, path)
    rows = rows.take([number % len(rows) for number in range(count)])
    for name, values in (("sensor", ["copy"] * count), ("night", nights), ("key", keys)):
        rows = rows.set_column(rows.column_names.index(name), name, pa.array(values))
    put_whole(copies.fs, copies.root, INDEX, parquet_of([rows]))
    return copies


def grown(root: Path, nights: list[Path], counts: list[int], workers: int) -> DataSet:
    """Print a row for each number of nights; the data set of all."""
    some, dataset = root / f"sources-{workers}", root / f"dataset-{workers}"
    some.mkdir()
    before, total_s, total_clock_s = 0, 0.0, 0.0
    with cluster(None, workers) as client:
        for count in counts:
            for path in nights[before:count]:
                os.link(path, some / path.name)
            new_s, clock_s = judged(some, dataset, client)
            total_s, total_clock_s = total_s + new_s, total_clock_s + clock_s
            again = timed(lambda: judged(some, dataset, client))
            sql = timed(lambda: asked(DataSet.at(str(dataset))))
            report = timed(
                lambda count=count: write_campaign_report(
                    campaign_document(DataSet.at(str(dataset))), root / f"report-{workers}-{count}"
                )
            )
            times = f"{total_clock_s:.1f}", f"{total_s:.1f}", f"{new_s / (count - before):.3f}"
            cells = (workers, count, *times, f"{peak_mib(client):.0f}", again, sql, report)
            print("| " + " | ".join(map(str, cells)) + " |", flush=True)
            before = count
    return DataSet.at(str(dataset))


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--nights", type=int, nargs="+", default=[10, 30, 100])
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--rows", type=int, default=10_000)
    parser.add_argument("--sessions", type=Path, help="Folder of the nights; default: a temporary one.")
    parser.add_argument("--keep", type=Path, help="New folder for data sets and reports; default: a temporary one.")
    arguments = parser.parse_args()
    compile_first(print)
    with tempfile.TemporaryDirectory(prefix="gse-campaign-") as folder:
        root = arguments.keep or Path(folder)
        made = arguments.sessions or root / "nights"
        for path in (root, made):
            path.mkdir(parents=True, exist_ok=True)
        nights = [made / f"night-{number:04d}.mcap" for number in range(max(arguments.nights))]
        with cluster(None, max(arguments.workers)) as client:
            seconds = [arguments.seconds] * len(nights)
            making = client.map(make_night, [str(path) for path in nights], range(len(nights)), seconds)
            client.gather(making)
            print(f"nights of {arguments.seconds:g} s at {RATE_HZ} Hz; made in {cpu_s(client):.0f} CPU s\n")
        print("| workers | nights | s | CPU s | CPU s a new night | MiB | again | SQL | report |")
        print("|---|---|---|---|---|---|---|---|---|", flush=True)
        for workers in arguments.workers:
            dataset = grown(root, nights, sorted(arguments.nights), workers)
        many = copied(dataset, root / "copies", arguments.rows)
        print(f"\n{arguments.rows} sessions, {len(QUESTIONS)} questions in SQL: {timed(lambda: asked(many))}")


if __name__ == "__main__":
    main()
