"""Options that are gone: a script that still has one reads in one line what does it now."""

import re
import shlex

import click
import pytest
from devices.command_line import runner

from gse.cli import cli
from gse.cli.commands import RETIRED, retired

GONE = [key for key in RETIRED if key[1]]
_QUOTED = re.compile(r"'(gse [^']+)'")


def command_of(words):
    """A command of the program by its words, and the words after it."""
    command = cli
    while isinstance(command, click.Group) and words:
        command = command.get_command(click.Context(command), words[0])
        assert command is not None, words
        words = words[1:]
    return command, words


def options_of(command):
    return {option for parameter in command.params for option in (*parameter.opts, *parameter.secondary_opts)}


@pytest.mark.parametrize(("command", "option"), GONE)
def test_a_retired_option_ends_with_2_and_one_line(command, option, capsys):
    done = runner(capsys)(*command.split()[1:], "session.mcap", f"{option}=1")
    assert done.code == 2
    assert done.out == ""
    assert done.err == f"gse: '{command} {option}' is retired: {RETIRED[command, option]}\n"


@pytest.mark.parametrize(("command", "option"), GONE)
def test_a_retired_option_is_no_option_any_more(command, option):
    assert option not in options_of(command_of(command.split()[1:])[0])


@pytest.mark.parametrize("sentence", sorted(set(RETIRED.values())))
def test_a_command_that_does_it_now_exists_with_its_options(sentence):
    for line in _QUOTED.findall(sentence):
        command, words = command_of(shlex.split(line)[1:])
        assert {word for word in words if word.startswith("--")} <= options_of(command)


def test_an_option_that_never_was_gets_the_usual_words(capsys):
    assert retired("gse replay", "--thread") is None
    done = runner(capsys)("replay", "session.mcap", "--thread", "1")
    assert (done.code, "No such option" in done.err) == (2, True)
