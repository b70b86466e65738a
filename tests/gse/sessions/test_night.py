"""Nights without a hand: from dusk until dawn, every night, at any latitude and in any time zone."""

import os
import re
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from astropy.coordinates import AltAz, EarthLocation, get_sun
from astropy.time import Time
from astropy.utils import iers
from devices.command_line import Gse
from devices.patience import PATIENCE_S

from gse.cli import EXIT_INTERRUPTED
from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.errors import UsageError
from gse.sessions.night import _alone, begin_ns, end_ns, next_dusk_ns
from gse.station.sky_condition import SUN_LIMIT_DEG
from gse.values.instant import NS_PER_S, from_text, to_text

SITE = replace(parse_station(BUILT_IN_TEXT).site, latitude_deg=48.0, longitude_deg=11.0, height_m=500.0)
NOON = from_text("2026-03-29T11:00:00Z")
"""Of the day on which summer time began in Bavaria."""
MIDNIGHT = from_text("2026-03-29T23:30:00Z")
MINUTE = 60 * NS_PER_S


def sun_deg(utc_ns: int) -> float:
    with iers.conf.set_temp("auto_download", False), iers.conf.set_temp("auto_max_age", None):
        when = Time(utc_ns / NS_PER_S, format="unix")
        place = EarthLocation.from_geodetic(SITE.longitude_deg, SITE.latitude_deg, SITE.height_m)
        return float(get_sun(when).transform_to(AltAz(obstime=when, location=place)).alt.deg)


def test_a_night_is_from_dusk_until_dawn_as_astropy_has_them() -> None:
    begin = begin_ns("dusk", SITE, NOON)
    end = end_ns("dawn", SITE, begin)
    assert sun_deg(begin) == pytest.approx(SUN_LIMIT_DEG, abs=0.05)
    assert sun_deg(end) == pytest.approx(SUN_LIMIT_DEG, abs=0.05)
    assert NOON < begin < end < NOON + 86_400 * NS_PER_S


def test_margins_are_kept_and_a_session_in_mid_night_begins_at_once() -> None:
    dusk, dawn = next_dusk_ns(SITE, NOON), end_ns("dawn", SITE, MIDNIGHT)
    assert begin_ns("dusk+20m", SITE, NOON) == dusk + 20 * MINUTE
    assert end_ns("dawn-10m", SITE, MIDNIGHT) == dawn - 10 * MINUTE
    assert begin_ns("dusk+20m", SITE, MIDNIGHT) == MIDNIGHT


def test_the_minutes_before_dawn_that_a_margin_leaves_out_belong_to_the_next_night() -> None:
    dawn = end_ns("dawn", SITE, MIDNIGHT)
    begin = begin_ns("dusk", SITE, dawn - 5 * MINUTE, "dawn-10m")
    assert begin == pytest.approx(next_dusk_ns(SITE, dawn + MINUTE), abs=MINUTE)
    assert end_ns("dawn-10m", SITE, begin) > begin


def test_a_polar_summer_waits_for_the_first_night_and_a_polar_night_is_cut_after_a_day() -> None:
    arctic = replace(SITE, latitude_deg=69.6)
    begin = begin_ns("dusk", arctic, from_text("2026-06-01T12:00:00Z"))
    assert to_text(begin, 0)[:7] == "2026-08"
    pole = replace(SITE, latitude_deg=89.0)
    winter = from_text("2026-12-20T12:00:00Z")
    assert end_ns("dawn", pole, winter) == winter + 86_400 * NS_PER_S


@pytest.mark.parametrize(
    ("option", "text", "words"),
    [
        ("from", "dawn", "expected dusk"),
        ("from", "sunset", "expected dusk, dawn-10m, or an instant"),
        ("until", "dusk", "expected dawn"),
        ("until", "2026-03-29T10:00:00Z", "it is over"),
    ],
)
def test_another_time_is_answered_with_what_was_expected(option: str, text: str, words: str) -> None:
    with pytest.raises(UsageError, match=words):
        begin_ns(text, SITE, NOON) if option == "from" else end_ns(text, SITE, NOON)


def test_one_night_of_a_series_has_the_words_of_the_series_with_its_times() -> None:
    times = ["--from", "dusk", "--until", "dawn"]
    assert _alone(["run", "roof.yaml", "--every", "night", "-v"]) == ["run", "roof.yaml", "-v", *times]
    given = _alone(["run", "--every=night", "--until=dawn-10m", "--from", "dusk+5m"])
    assert given == ["run", "--from", "dusk+5m", "--until", "dawn-10m"]


def test_a_session_ends_when_it_was_told(gse: Gse, tmp_path: Path) -> None:
    done = gse("run", "--port", "sim://", "--from", "2026-01-01T00:00:00Z", "--until", "2000-01-01T00:00:00Z")
    assert (done.code, "it is over" in done.err) == (2, True)
    done = gse("run", "--until", "dawn", "--duration", "5s", "--out", tmp_path)
    assert "--until and --duration both say" in done.err


def test_every_night_is_a_session_of_its_own_with_a_line_in_the_morning_until_it_is_ended(tmp_path: Path) -> None:
    times = ("--from", "2026-01-01T00:00:00Z", "--until", "2100-01-01T00:00:00Z")
    command = [sys.executable, "-m", "gse", "run", "--every", "night", "--port", "sim://?frames=40", *times]
    command += ["--no-plots", "--out", str(tmp_path)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True) as series:
        assert series.stderr is not None
        morning = re.compile(r"INCONCLUSIVE \(SIMULATED\): .*: (.*)/report\.html\n")
        line = next(found for text in series.stderr if (found := morning.fullmatch(text)))
        os.kill(series.pid, signal.SIGTERM)
        series.stderr.read()
        series.wait(PATIENCE_S)
    assert Path(line[1]).parent == tmp_path
    assert (Path(line[1]) / "report.json").is_file()


def test_a_session_that_is_ended_while_it_waits_receives_nothing(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "gse", "run", "--port", "sim://", "--from", "2099-01-01T00:00:00Z"]
    with subprocess.Popen([*command, "--out", str(tmp_path / "out")], stderr=subprocess.PIPE, text=True) as waiting:
        assert waiting.stderr is not None
        assert next(text for text in waiting.stderr if text.startswith("waiting until 2099-01-01"))
        os.kill(waiting.pid, signal.SIGINT)
        waiting.stderr.read()
        assert waiting.wait(PATIENCE_S) == EXIT_INTERRUPTED
    assert not (tmp_path / "out").exists()
