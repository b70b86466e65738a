"""Campaigns on a real scheduler with worker processes, from an SFTP server and an S3 server."""

import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import dask
import fsspec
import fsspec.config
import psutil
import pytest
from devices.cluster import Started, cluster, start
from devices.s3_server import BUCKET

from gse.api import load
from gse.campaign.cluster import cluster as connected
from gse.campaign.cluster import past_lost_workers
from gse.campaign.dataset import DataSet
from gse.campaign.engine import plan_campaign, run_campaign
from gse.campaign.sources import find_sources
from gse.errors import CampaignError
from gse.process.interrupts import interrupt

pytestmark = pytest.mark.cluster


@pytest.fixture(scope="module")
def running(tmp_path_factory):
    with cluster(tmp_path_factory.mktemp("cluster")) as started:
        yield started


@pytest.fixture
def sftp(running):
    """This process knows the SFTP server too."""
    fsspec.config.conf["sftp"] = running.sshd.options()
    yield running.sshd
    del fsspec.config.conf["sftp"]
    fsspec.get_filesystem_class("sftp").clear_instance_cache()


def whole(dataset: Path) -> list[str]:
    """The keys of a data set, after a check that each session is there once, with its frames and stars."""
    found = DataSet.at(str(dataset)).committed()
    keys = [place.key for place in found]
    assert len(set(keys)) == len(keys)
    assert all((dataset / place.path(table)).exists() for place in found for table in ("frames", "stars"))
    return keys


def judge(address, sources, dataset, each=lambda judged: None):
    with connected(address, 1) as client:
        campaign = plan_campaign(find_sources([str(sources)]), DataSet.at(str(dataset), create=True))
        return run_campaign(campaign, client, lambda judged: each(client))


def test_a_campaign_judges_as_replay_does_and_a_second_run_judges_nothing(running, gse, nights, tmp_path):
    shutil.copy(nights / "night-1.mcap", nights / "other-name.mcap")
    dataset = tmp_path / "dataset"
    first = gse("campaign", "judge", nights, "--to", dataset, "--scheduler", running.address, "--json")
    assert first.code == 0, first.err
    done = json.loads(first.out)
    assert (done["sessions"], done["judged"]) == (4, 4)
    assert [[Path(url).name for url in urls] for urls in done["twice"]] == [["night-1.mcap", "other-name.mcap"]]
    assert len(whole(dataset)) == 4
    sql = "select report_json from reports join sessions using (key) where night = '2026-03-02'"
    kept = json.loads(gse("campaign", "query", dataset, sql, "--format", "json").out)["report_json"]
    gse("replay", nights / "night-2.mcap", "--out", tmp_path / "alone")
    assert kept == next((tmp_path / "alone").glob("*/report.json")).read_text()
    again = json.loads(gse("campaign", "judge", nights, "--to", dataset, "--scheduler", running.address, "--json").out)
    assert again == done | {"judged": 0}


def test_a_worker_started_by_hand_gives_the_digits_of_another_processor_too(running, gse, tmp_path):
    """Its numpy took another kernel of OpenBLAS than this process (tests/devices/cluster.py)."""
    folder, dataset = tmp_path / "half-way", tmp_path / "dataset"
    folder.mkdir()
    gse("simulate", "--scenario", "inclined", "--seed", 13, "--seconds", 2, "--file", folder / "night.mcap")
    gse("campaign", "judge", folder, "--to", dataset, "--scheduler", running.address)
    ours, theirs = (load(path).frames.drop_columns("key") for path in (folder / "night.mcap", dataset))
    assert theirs.select(ours.column_names).to_pylist() == ours.to_pylist()
    kept = json.loads(gse("campaign", "query", dataset, "select report_json from reports", "--format", "json").out)
    gse("replay", folder / "night.mcap", "--out", tmp_path / "alone")
    assert kept["report_json"] == next((tmp_path / "alone").glob("*/report.json")).read_text()


def test_a_worker_that_is_killed_and_one_that_hangs_lose_nothing(running, nights, tmp_path):
    attacked = []

    def attack(client) -> None:
        if not attacked:
            attacked.extend(client.run(os.getpid).values())
            os.kill(attacked[0], signal.SIGKILL)
            os.kill(attacked[1], signal.SIGSTOP)

    outcomes = judge(running.address, nights, tmp_path / "dataset", attack)
    assert [one.error for one in outcomes] == [""] * 4
    assert len(whole(tmp_path / "dataset")) == 4


def listeners() -> set:
    """Addresses on which this process and those that it started listen."""
    here = psutil.Process()
    return {
        one.laddr
        for process in (here, *here.children(recursive=True))
        for one in process.net_connections()
        if one.status == psutil.CONN_LISTEN
    }


def test_a_scheduler_and_workers_started_as_the_documentation_says_listen_on_loopback_alone(running):
    page = (Path(__file__).parents[3] / "docs" / "campaigns.md").read_text(encoding="utf-8")
    commands = [line for line in page.splitlines() if line.startswith("    dask ")]
    assert len(commands) == 2
    assert all(" --dashboard-address 127.0.0.1:" in line and "127.0.0.1" in line for line in commands)
    with connected(running.address, 1):  # which waits for a worker
        assert {address.ip for address in listeners()} == {"127.0.0.1"}


def blocked_signals() -> set[signal.Signals]:
    """What a worker of this machine leaves to the process that started it."""
    return signal.pthread_sigmask(signal.SIG_BLOCK, ())


def test_workers_of_its_own_listen_on_loopback_alone_and_one_that_is_killed_loses_nothing(nights, tmp_path):
    before, listening, profiled, hung_up = listeners(), set(), [], []

    def attack(client) -> None:
        if not listening:
            listening.update(listeners() - before)
            profiled.extend(client.run(dask.config.get, "distributed.worker.profile.enabled").values())
            hung_up.append(signal.getsignal(signal.SIGHUP))
            hung_up.extend(client.run(blocked_signals).values())
            os.kill(next(iter(client.run(os.getpid).values())), signal.SIGKILL)

    outcomes = judge(None, nights, tmp_path / "dataset", attack)
    assert {address.ip for address in listening} == {"127.0.0.1"}
    assert set(profiled) == {False}, "samples of a profiler"
    assert hung_up[0] is interrupt, "a terminal that hangs up is Ctrl-C"
    assert all({signal.SIGINT, signal.SIGHUP} <= blocked for blocked in hung_up[1:])
    assert signal.getsignal(signal.SIGHUP) is signal.SIG_DFL
    assert [one.error for one in outcomes] == [""] * 4
    assert len(whole(tmp_path / "dataset")) == 4


def test_a_task_outlives_the_workers_that_others_kill_where_dask_gives_it_up(tmp_path):
    mark = tmp_path / "one worker is lost"
    with dask.config.set({"distributed.scheduler.allowed-failures": 0}), connected(None, 1) as client:
        task = client.submit(lambda: mark.exists() or (mark.touch(), os._exit(1)), pure=False)
        assert past_lost_workers(task).result() is True


def test_a_campaign_that_is_interrupted_says_one_line_and_leaves_whole_sessions(nights, tmp_path):
    command = (sys.executable, "-m", "gse", "campaign", "judge", nights, "--to", tmp_path / "dataset", "--workers", "1")
    started = start(*command, log=tmp_path / "log", before=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL))
    lines = lines_of(tmp_path / "log", started)
    assert next(lines).startswith("judging: 1 of 4")
    os.killpg(started.process.pid, signal.SIGINT)  # as a terminal does: to all that belong to the command
    assert [line.split(";")[0] for line in lines if not line.startswith("judging")] == ["interrupted"]
    assert started.process.wait() == 130
    assert 1 <= len(whole(tmp_path / "dataset")) <= 4


def test_a_campaign_that_is_terminated_while_its_workers_start_says_one_line_too(nights, tmp_path):
    command = (sys.executable, "-m", "gse", "campaign", "judge", nights, "--to", tmp_path / "dataset", "--workers", "1")
    started = start(*command, log=tmp_path / "log")
    command_line = psutil.Process(started.process.pid)
    while not any("spawn_main" in " ".join(child.cmdline()) for child in command_line.children()):
        time.sleep(0.01)
    started.process.terminate()
    assert [line.split(";")[0] for line in lines_of(tmp_path / "log", started)] == ["interrupted"]
    assert started.process.wait() == 130


def test_workers_that_cannot_start_are_told_in_one_line(nights, tmp_path):
    command = (sys.executable, "-m", "gse", "campaign", "judge", nights, "--to", tmp_path / "dataset", "--workers", "2")
    few_files = (24, resource.getrlimit(resource.RLIMIT_NOFILE)[1])
    started = start(
        *command, log=tmp_path / "log", before=lambda: resource.setrlimit(resource.RLIMIT_NOFILE, few_files)
    )
    (line,) = lines_of(tmp_path / "log", started)
    assert line.startswith("gse: Dask cannot start its workers (")
    assert "ulimit -n" in line
    assert started.process.wait() == 2


def lines_of(log: Path, started: Started) -> Iterator[str]:
    """The lines of a log as they come, until its writer has ended."""
    with log.open() as file:
        ended = False
        while not ended:
            ended = started.process.poll() is not None
            while line := file.readline():
                yield line.rstrip()
            with suppress(subprocess.TimeoutExpired):
                started.process.wait(0.05)


def test_storage_that_fails_for_a_while_is_asked_again(running, sftp, nights, tmp_path):
    back = threading.Timer(1.0, sftp.start)

    def attack(client) -> None:
        if back.ident is None:
            sftp.stop()
            back.start()

    source, dataset = sftp.url(nights), tmp_path / "dataset"
    outcomes = judge(running.address, source, sftp.url(dataset), attack)
    back.join()
    assert [one.error for one in outcomes] == [""] * 4
    assert len(whole(dataset)) == 4
    assert not [path for path in (dataset / ".parts").iterdir() if path.stat().st_size == 0]
    assert DataSet.at(str(dataset)).index_path() is not None


def test_two_campaigns_into_one_data_set_give_what_one_gives(running, nights, tmp_path):
    dataset = tmp_path / "dataset"
    DataSet.at(str(dataset), create=True)
    outcomes = []
    both = [threading.Thread(target=lambda: outcomes.extend(judge(running.address, nights, dataset))) for _ in "12"]
    for one in both:
        one.start()
    for one in both:
        one.join()
    assert [one.error for one in outcomes] == [""] * 8
    assert len(whole(dataset)) == 4
    assert DataSet.at(str(dataset)).index_path() is not None


def test_sessions_in_a_bucket_are_judged_into_a_bucket(running, gse, nights, monkeypatch):
    for name, value in running.s3.environment.items():
        monkeypatch.setenv(name, value)
    running.s3.put("in/night-1.mcap", (nights / "night-1.mcap").read_bytes())
    arguments = ("campaign", "judge", f"s3://{BUCKET}/in", "--to", f"s3://{BUCKET}/dataset", "--json")
    done = gse(*arguments, "--scheduler", running.address)
    assert done.code == 0, done.err
    assert json.loads(gse(*arguments, "--scheduler", running.address).out)["judged"] == 0
    answer = gse("campaign", "query", f"s3://{BUCKET}/dataset", "select sensor from sessions", "--format", "json")
    assert json.loads(answer.out) == {"sensor": "LAPAN-like"}


def test_wrong_credentials_and_unknown_hosts_are_named(running, sftp, gse, nights, tmp_path):
    arguments = ("campaign", "judge", sftp.url(nights), "--to", tmp_path / "dataset")
    fsspec.config.conf["sftp"] = sftp.options("other")
    done = gse(*arguments)
    assert done.code == 3
    assert "refused the credentials" in done.err
    fsspec.config.conf["sftp"] = sftp.options("no-such-key")
    assert "no-such-key'; docs/campaigns.md says where keys" in " ".join(gse(*arguments).err.split())
    fsspec.config.conf["sftp"] = sftp.options() | {"known_hosts": os.devnull}
    assert "not found in known_hosts" in gse(*arguments).err


def test_a_scheduler_with_tls_asks_for_certificates(gse, nights, tmp_path):
    done = gse("campaign", "judge", nights, "--to", tmp_path / "dataset", "--scheduler", "tls://127.0.0.1:8786")
    assert (done.code, "state its certificates here" in " ".join(done.err.split())) == (2, True)


def test_an_evaluation_gives_the_same_on_the_cluster_as_here(running, gse):
    arguments = ("evaluate", "--identifier", "neighbour", "--frames", "60", "--seed", "7", "--json")
    documents = [json.loads(gse(*arguments, *more).out) for more in ((), ("--scheduler", running.address))]
    for document in documents:
        document["cells"][0].pop("cpu_ms")
    assert documents[0] == documents[1]


def test_a_scheduler_that_goes_away_leaves_what_was_judged(running, nights, tmp_path):
    def attack(client) -> None:
        running.scheduler.end()

    with pytest.raises(CampaignError, match="the scheduler is gone, with 3 of 4 sessions not judged"):
        judge(running.address, nights, tmp_path / "dataset", attack)
    assert whole(tmp_path / "dataset")
