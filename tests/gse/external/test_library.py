import math
import os
import select
from pathlib import Path

import devices
import numpy as np
import pytest
from devices.compiler import shared_library
from devices.patience import PATIENCE_S
from skies.made_frames import FIELD_14_DEG, Noise, made_frame, sky_of

from gse.catalog import load_catalog, mission_catalog
from gse.catalog.flight import write_table
from gse.errors import UsageError
from gse.external.answers import ExternalAnswer, Failure, FailureKind
from gse.external.identifier import RunningIdentifier
from gse.external.panoramas import SensorDescription
from gse.external.plugs import plug_of
from gse.identifier import Identification, make_identifier
from gse.identifier.tables import field_diameter_rad, listed_neighbours, pair_table
from gse.values.attitude import solve_attitude
from gse.values.identifier_options import IdentifierOptions
from gse.values.panorama import Panorama
from gse.values.spiral import spiral_directions

SENSOR = SensorDescription("made", FIELD_14_DEG, 4096)
PANORAMAS = 250
"""benchmarks/external.py compares 10,000."""

HEAD = """
#include "gse_identifier.h"
#include <math.h>
#include <stdlib.h>
#include <unistd.h>
int identify(const gse_panorama *p, gse_answer *a, void *config) {
    (void)config;
    a->version = GSE_IDENTIFIER_ABI, a->frame_no = p->frame_no, a->status = GSE_IDENTIFIED;
    a->ra_deg = 10, a->de_deg = -20;
"""


def running(library, timeout_ms=1000 * PATIENCE_S, **options):
    plug = plug_of(IdentifierOptions(algorithm="external", library=str(library), **options), SENSOR)
    return RunningIdentifier(plug, timeout_ms / 1000)


def panorama_of(frame, number):
    return Panorama(1_774_000_000_000_000_000 + number, frame.xy_px, frame.brightness, number, 0.1, number)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("library")


@pytest.fixture(scope="module")
def stars():
    return mission_catalog(load_catalog(stars=10_000), FIELD_14_DEG)


@pytest.fixture(scope="module")
def onboard(folder, stars):
    """The neighbour technique in C, with the table of figure 2-5 as its config."""
    with (folder / "flight.csv").open("w") as out:
        write_table(stars, listed_neighbours(pair_table(stars, field_diameter_rad(FIELD_14_DEG))), out)
    library = shared_library(Path(devices.__path__[0]) / "onboard_neighbour.c", folder)
    identifier = running(library, config=str(folder / "flight.csv"))
    yield identifier
    identifier.close()


@pytest.mark.parametrize("noise", [Noise(), Noise(false_objects=3), Noise(false_objects=8, whole_pixels=False)])
def test_the_neighbour_technique_in_c_gives_the_stars_and_angles_of_ours(onboard, stars, noise):
    sky = sky_of(load_catalog(stars=20_000), FIELD_14_DEG, 6.0)
    rng = np.random.default_rng(3)
    directions = spiral_directions(PANORAMAS)[::3]
    frames = [made_frame(sky, FIELD_14_DEG, direction, noise, rng) for direction in directions]
    ours = make_identifier(IdentifierOptions(), FIELD_14_DEG, stars)
    given = onboard.answers([panorama_of(frame, number) for number, frame in enumerate(frames)])
    identified = 0
    for frame, one in zip(frames, given, strict=True):
        directions_sensor = FIELD_14_DEG.directions(frame.xy_px)
        answer = ours.identify(directions_sensor, frame.brightness)
        assert isinstance(one.answer, ExternalAnswer)
        if not isinstance(answer, Identification):
            assert (one.answer.attitude, one.answer.status) == (None, str(answer.reason))
            continue
        identified += 1
        named = dict(zip(one.answer.objects.tolist(), one.answer.star_ids.tolist(), strict=True))
        assert named == dict(zip(answer.objects.tolist(), stars.ids[answer.stars].tolist(), strict=True))
        attitude = solve_attitude(directions_sensor[answer.objects], stars.icrs[answer.stars], 1e-4)
        assert one.answer.attitude.icrs_to_sensor == pytest.approx(attitude.icrs_to_sensor, abs=1e-11)
    assert identified > 0.95 * len(frames)


def test_the_report_names_library_and_config_by_their_hashes(onboard):
    assert (onboard.identity["name"], onboard.identity["version"]) == ("onboard neighbour", "1.0")
    assert len(onboard.identity["program_sha256"]) == len(onboard.identity["config_sha256"]) == 64


@pytest.mark.parametrize(
    ("body", "kind", "text"),
    [
        ("if (p->frame_no == 2) *(volatile int *)0 = 1; return 0;", FailureKind.CRASH, "SIGSEGV"),
        ("if (p->frame_no == 2) exit(5); return 0;", FailureKind.CRASH, "exit code 5"),
        ("if (p->frame_no == 2) abort(); return 0;", FailureKind.CRASH, "SIGABRT"),
        ("while (p->frame_no == 2) sleep(1); return 0;", FailureKind.TIMEOUT, "no answer within"),
        ("if (p->frame_no == 2) a->ra_deg = NAN; return 0;", FailureKind.NONSENSE, "ra_deg is nan"),
        ("if (p->frame_no == 2) a->de_deg = 400; return 0;", FailureKind.NONSENSE, "de_deg is 400"),
        ("if (p->frame_no == 2) a->frame_no = 3; return 0;", FailureKind.NONSENSE, "to frame 3 came"),
        ("if (p->frame_no == 2) a->version = 9; return 0;", FailureKind.NONSENSE, "answer.version is 9"),
        ("if (p->frame_no == 2) a->status = 0; return 0;", FailureKind.NONSENSE, "answer.status is 0"),
        ("if (p->frame_no == 2) a->matched = 31; return 0;", FailureKind.NONSENSE, "answer.matched 31"),
    ],
)
def test_a_library_that_fails_costs_its_panorama_alone(tmp_path, body, kind, text):
    timeout_ms = 2000 if kind is FailureKind.TIMEOUT else 1000 * PATIENCE_S
    identifier = running(shared_library(HEAD + body + "}", tmp_path), timeout_ms)
    empty = np.zeros((2, 2)), np.array([2.0, 1.0])
    given = identifier.answers([Panorama(10 + n, *empty, n) for n in range(4)])
    identifier.close()
    assert [isinstance(one.answer, Failure) for one in given] == [False, False, True, False]
    assert given[2].answer.kind is kind
    assert text in given[2].answer.detail


def test_what_a_library_returns_other_than_zero_is_no_answer(tmp_path):
    identifier = running(shared_library(HEAD + "return -7; }", tmp_path))
    (given,) = identifier.answers([Panorama(10, np.zeros((2, 2)), np.array([2.0, 1.0]), 1)])
    identifier.close()
    assert (given.answer.attitude, given.answer.detail) == (None, "the function returned -7")


def test_an_answer_without_roll_and_with_its_own_time(tmp_path):
    identifier = running(shared_library(HEAD + "a->elapsed_us = 42; return 0; }", tmp_path))
    (given,) = identifier.answers([Panorama(10, np.zeros((2, 2)), np.array([2.0, 1.0]), 1)])
    identifier.close()
    assert (given.answer.has_roll, given.elapsed_us, given.has_own_time) == (False, 42.0, True)
    assert math.isclose(given.answer.attitude.ra_deg, 10)


def test_the_time_of_a_library_that_states_none_is_that_of_the_host(tmp_path):
    identifier = running(shared_library(HEAD + "usleep(20000); return 0; }", tmp_path))
    given = identifier.answers([Panorama(10 + n, np.zeros((2, 2)), np.array([2.0, 1.0]), n) for n in range(2)])
    identifier.close()
    assert [one.has_own_time for one in given] == [False, False]
    assert given[0].elapsed_us is None, "a library reads its tables in its first call"
    assert given[1].elapsed_us > 20_000


def test_a_library_that_forks_while_it_loads_leaves_no_process(tmp_path):
    held = tmp_path / "held"
    os.mkfifo(held)
    reader = os.open(held, os.O_RDONLY | os.O_NONBLOCK)
    top = f"""
#include <fcntl.h>
__attribute__((constructor)) void f(void) {{ if (open("{held}", O_WRONLY) > 0 && !fork()) for (;;) pause(); }}"""
    identifier = running(shared_library(HEAD + "return 0; }" + top, tmp_path))
    (given,) = identifier.answers([Panorama(10, np.zeros((2, 2)), np.array([2.0, 1.0]), 1)])
    identifier.close()
    assert isinstance(given.answer, ExternalAnswer)
    ended = select.poll()
    ended.register(reader, 0)
    assert [events for _, events in ended.poll(20_000)] == [select.POLLHUP], "a process lives on"
    os.close(reader)


def test_what_a_library_prints_is_kept_and_no_answer(tmp_path):
    identifier = running(shared_library(HEAD + 'if (write(1, "hello", 5) < 0) return 1; return 0; }', tmp_path))
    (given,) = identifier.answers([Panorama(10, np.zeros((2, 2)), np.array([2.0, 1.0]), 1)])
    identifier.close()
    assert isinstance(given.answer, ExternalAnswer)
    assert identifier.take_log() == b"hello"


@pytest.mark.parametrize(
    ("text", "symbol", "error"),
    [
        (HEAD + "return 0; }", "solve", "it has no symbol solve: export int solve("),
        (HEAD + "return 0; }\nconst uint32_t gse_identifier_abi = 2;", "identify", "compiled for version 2 of gse_"),
        (
            HEAD + "return 0; }\n__attribute__((constructor)) void f(void) { _exit(9); }",
            "identify",
            "ended with exit code 9",
        ),
    ],
)
def test_a_library_that_does_not_fit_is_refused_before_a_session(tmp_path, text, symbol, error):
    with pytest.raises(UsageError) as refused:
        running(shared_library(text, tmp_path), symbol=symbol)
    assert error in str(refused.value)
