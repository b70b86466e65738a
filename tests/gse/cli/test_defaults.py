"""What a hand expects that knows other programs: no path, no long name, one screen of help."""

import json
import shutil
from pathlib import Path

import click
import pytest
from devices.command_line import Gse

from gse.cli import cli
from gse.cli.commands import OLD_NAMES, whole_help
from gse.version import __version__

GOLDEN = Path(__file__).parents[3] / "replays" / "golden"
SCREEN = 24
MOST_SHOWN = 180


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working directory with two sessions of one sensor, and an older one of another sensor between them."""
    monkeypatch.chdir(tmp_path)
    for name, recorded in (("01-A", "clear"), ("02-B", "clear"), ("03-A", "inclined")):
        session = tmp_path / "sessions" / f"202603{name[:2]}T000000Z-{name[3:]}"
        session.mkdir(parents=True)
        shutil.copy(GOLDEN / f"{recorded}.mcap", session / "session.mcap")
    return tmp_path


NEWEST = "sessions/20260303T000000Z-A"


def test_commands_without_a_path_take_the_newest_session_and_say_so(gse: Gse, folder: Path) -> None:
    for command in ("why", "plan"):
        done = gse(command)
        assert f"gse: the newest session: {NEWEST}\n" in done.err
        assert done.out == gse(command, NEWEST).out
    assert gse("report", "--no-plots").code == 0
    assert (folder / NEWEST / "report" / "report.json").is_file()
    assert gse("view", "--out", folder / "newest.rrd").code == 0
    assert (folder / "newest.rrd").stat().st_size > 0


def test_what_a_command_recorded_is_not_the_newest_session(gse: Gse, folder: Path) -> None:
    gse("sensor", "status")
    assert list((folder / "sessions").glob("2*-command"))
    assert f"gse: the newest session: {NEWEST}\n" in gse("why").err


def test_compare_takes_the_newest_session_and_the_one_of_its_sensor_before_it(gse: Gse, folder: Path) -> None:
    done = gse("compare")
    assert f"the newest two sessions of a sensor: sessions/20260301T000000Z-A and {NEWEST}" in done.err
    assert done.out == gse("compare", "sessions/20260301T000000Z-A", NEWEST).out
    alone = gse("compare", "--identifier", "pivot")
    assert f"the newest session: {NEWEST}" in alone.err
    shutil.rmtree(folder / "sessions" / "20260301T000000Z-A")
    assert "only session of its sensor" in gse("compare").err


def test_no_session_at_all_is_told_with_what_records_one(
    gse: Gse, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for command in ("why", "plan", "report", "view", "compare"):
        done = gse(command)
        assert (done.code, done.err.count("\n")) == (2, 1)
        assert "there is no session below ./sessions; give the path of one, or record one with: gse run" in done.err
    assert "there is no session below sessions" in gse("sessions").err


def test_the_sessions_are_listed_with_their_verdicts(gse: Gse, folder: Path) -> None:
    gse("report", NEWEST, "--no-plots")
    first, _, last = gse("sessions").out.splitlines()
    assert last.split() == ["2026-03-20T15:00:00", "30", "s", "PASS", "(SIMULATED)", NEWEST]
    assert "no report: gse report sessions/20260301T000000Z-A" in first
    listed = json.loads(gse("sessions", "--json").out)["sessions"]
    assert [one["verdict"] for one in listed] == [None, None, "PASS"]
    assert listed[-1]["sensor"] == "LAPAN-like"


OURS = '{"schema": "gse.report/1", '


@pytest.mark.parametrize(
    "content",
    [
        *("", "{", "[]", OURS + '"word": 3, "session": "x"}'),
        *(OURS + f'"session": {{"duration_s": {value}}}}}' for value in (10**400, "NaN", "Infinity", -1)),
    ],
    ids=str.__len__,
)
def test_a_report_that_is_none_of_ours_hides_no_session(gse: Gse, folder: Path, content: str) -> None:
    (folder / NEWEST / "report.json").write_text(content)
    assert NEWEST in gse("sessions").out
    assert json.loads(gse("sessions", "--json").out)["sessions"][-1]["duration_s"] is None


def test_the_station_file_stands_alone_or_behind_its_option(gse: Gse, tmp_path: Path) -> None:
    station = tmp_path / "roof.yaml"
    assert gse("config", "init", station, "--yes", "--name", "ROOF-1").code == 0
    for words in ((station,), ("-s", station), ("--station", station)):
        done = gse("run", *words, "--port", "sim://?frames=3", "--no-plots", "--out", tmp_path / "out")
        assert "ROOF-1 (onboard)" in done.out
    assert "two station files" in gse("run", station, "-s", station).err


def test_help_and_version_are_commands_too(gse: Gse) -> None:
    assert gse("help").out == gse("--help").out
    assert gse("help", "session", "trim").out == gse("session", "trim", "--help").out
    assert gse("version").out.split() == ["gse,", "version", __version__]


def test_show_is_what_the_list_of_commands_promises(gse: Gse) -> None:
    clear = GOLDEN / "clear.mcap"
    assert gse("session", "show", clear).out == gse("session", "info", clear).out != ""


def commands(name: str = "gse", command: click.Command = cli) -> list[tuple[str, click.Command]]:
    found = [(name, command)]
    if isinstance(command, click.Group):
        context = click.Context(command)
        for below in command.list_commands(context):
            one = command.get_command(context, below)
            assert one is not None
            found += commands(f"{name} {below}", one)
    return found


def shown(text: str) -> set[str]:
    """The options that a help shows."""
    return {word for line in text.splitlines() if line.startswith("  -") for word in line.split() if word[:2] == "--"}


def test_the_help_of_run_is_one_screen_and_names_the_rest(gse: Gse) -> None:
    (run,) = (command for name, command in commands() if name == "gse run")
    context = click.Context(run, info_name="gse run", terminal_width=80)
    lines = run.get_help(context).splitlines()
    assert len(lines) <= SCREEN
    whole = whole_help(context)
    assert "--help-all" in shown("\n".join(lines)) < shown(whole)
    assert "--earth-orientation" in shown(whole)
    assert run.get_help(context).splitlines() == lines
    assert gse("run", "--help-all").out.count("--earth-orientation") == 1


def test_all_helps_together_show_a_number_of_options_that_can_be_read() -> None:
    helps = [
        command.get_help(click.Context(command, info_name=name, terminal_width=80)) for name, command in commands()
    ]
    assert sum(len(shown(text) - {"--help"}) for text in helps) <= MOST_SHOWN


@pytest.mark.parametrize(("command", "old"), OLD_NAMES)
def test_an_old_name_still_sets_what_the_new_one_does(command: str, old: str) -> None:
    target, value = OLD_NAMES[command, old]
    (taken,) = (one for name, one in commands() if name == f"gse {command}")
    (option,) = (param for param in taken.params if param.name == target)
    given = value or {"begins_ns": "2026-03-20T15:00:00Z"}.get(target, "given")
    words = ["x"] if command.startswith(("campaign", "config", "view")) else []
    by_old = taken.make_context(command, [*words, old] if value else [*words, old, given], resilient_parsing=False)
    by_new = taken.make_context(command, [*words, option.opts[0], given])
    assert by_old.params[target] == by_new.params[target] is not None
    assert old not in shown(taken.get_help(by_old))
