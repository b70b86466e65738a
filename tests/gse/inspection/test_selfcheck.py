"""The self-check agrees with the station as it is, and differs from each that is broken in one place."""

import json
import math
import sys
from dataclasses import replace

import pytest
from devices.command_line import runner

from drivers.chunk import Chunk
from gse.inspection.made_session import KNOWN_ERRORS
from gse.inspection.selfcheck import selfcheck
from gse.inspection.selfcheck_result import CheckedRow, SelfCheckResult, keep_result, last_result
from gse.process.installation import source_sha256
from gse.station.loop import StationLoop
from gse.station.session_tables import FrameTable
from gse.station.setup import versions
from gse.truth import SiderealTruth

FEW = tuple(replace(error, frames=3) for error in KNOWN_ERRORS if not error.focal_share and not error.noise_px)
CONNECTIONS: list[object] = []
WATCHING: list[bool] = []


def hook(event, arguments):
    if WATCHING and event in ("socket.connect", "socket.getaddrinfo"):
        CONNECTIONS.append(arguments)


sys.addaudithook(hook)


class OtherTruth(StationLoop):
    """A station that compares with another truth."""

    def truth(self, right):
        raise NotImplementedError

    def _seek_truth(self, panorama):
        super()._seek_truth(panorama)
        self._frame_processor = replace(self._frame_processor, truth=self.truth(self._frame_processor.truth))


def without(*names):
    class Without(OtherTruth):
        def truth(self, right):
            return SiderealTruth(right.site, right.earth_orientation, frozenset(names))

    return Without


class RefractionTurnedRound(OtherTruth):
    def truth(self, right):
        right.refraction = replace(right.refraction, a_rad=-right.refraction.a_rad, b_rad=-right.refraction.b_rad)
        return right


class LongitudeWestward(OtherTruth):
    def truth(self, right):
        site = replace(right.site, longitude_deg=-right.site.longitude_deg)
        return SiderealTruth(site, right.earth_orientation)


class Altered(FrameTable):
    """Errors with some of their signs turned."""

    def __init__(self, signs):
        super().__init__()
        self.signs = signs

    def extend(self, rows, matches, others):
        rows = rows.copy()
        for axis in self.signs:
            rows[f"{axis}_arcsec"] *= -1
        super().extend(rows, matches, others)


def with_sign_of(*axes):
    class WithSignOf(StationLoop):
        def __init__(self, setup):
            super().__init__(setup)
            self.session.frames = Altered(axes)

    return WithSignOf


class EndOfExposure(StationLoop):
    """A station that takes the time of a frame for the end of its exposure, not its middle."""

    def take(self, items):
        return super().take([self.later(item) for item in items])

    @staticmethod
    def later(item):
        utc_ns = item.utc_ns + 50_000_000
        return item._replace(utc_ns=utc_ns) if isinstance(item, Chunk) else replace(item, utc_ns=utc_ns)


def test_the_station_as_it_is_finds_every_known_error() -> None:
    result = selfcheck("2026-03-20T18:00:00Z", errors=FEW)
    assert [row for row in result.rows if not row.agrees] == []


@pytest.mark.parametrize(
    ("station", "quantities"),
    [
        (without("annual aberration"), {"onboard dRA*", "onboard dDE"}),
        (without("diurnal aberration"), {"onboard dRA*"}),
        (without("precession"), {"onboard dRA*", "onboard dDE", "onboard roll"}),
        (without("nutation"), {"onboard dRA*", "onboard dDE"}),
        (without("UT1"), {"onboard dRA*"}),
        (without("polar motion"), {"onboard dDE"}),
        (without("geodetic latitude"), {"onboard dRA*", "onboard dDE"}),
        (without("refraction"), {"onboard dRA*", "onboard dDE"}),
        (RefractionTurnedRound, {"onboard dRA*", "onboard dDE"}),
        (LongitudeWestward, {"onboard dRA*"}),
        (EndOfExposure, {"onboard dRA*"}),
    ],
)
def test_a_station_that_is_broken_in_one_place_differs_though_nothing_is_injected(station, quantities) -> None:
    result = selfcheck("2026-03-20T18:00:00Z", station=station, errors=FEW[:1])
    assert not result.agrees
    assert quantities <= {row.quantity for row in result.rows if not row.agrees}


@pytest.mark.parametrize(("axis", "name"), [("d_ra_cosde", "dRA*"), ("d_de", "dDE"), ("d_roll", "roll")])
def test_a_station_that_turns_the_sign_of_an_error_differs_in_that_alone(axis, name) -> None:
    result = selfcheck("2026-03-20T18:00:00Z", station=with_sign_of(axis), errors=FEW)
    assert {row.quantity.split()[-1] for row in result.rows if not row.agrees} == {name}


def test_a_station_that_answers_nothing_differs() -> None:
    class Silent(StationLoop):
        def take(self, items):
            return []

    result = selfcheck("2026-03-20T18:00:00Z", station=Silent, errors=FEW[:1])
    assert not result.agrees
    assert result.to_json()["rows"][0]["found"] is None


def test_the_command_prints_injected_and_found_and_keeps_the_result(capsys, monkeypatch, tmp_path) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    assert last_result() is None
    WATCHING.append(True)
    done = runner(capsys)("selfcheck", "--json")
    WATCHING.clear()
    assert CONNECTIONS == []
    assert done.code == 0
    document = json.loads(done.out)
    assert document["schema"] == "gse.selfcheck/1"
    assert {row["error"] for row in document["rows"]} == {error.name for error in KNOWN_ERRORS}
    kept = last_result()
    assert kept is not None
    assert kept.to_json() == document


ROW = CheckedRow("no error", "onboard dRA*", "arcsec", 0.0, 0.01, 0.1)


def result_of(*rows, **changes):
    result = SelfCheckResult("0.1.0", source_sha256(), versions(), rows or (ROW,), "2026-03-20T18:00:00Z")
    return replace(result, **changes)


def test_the_hash_is_of_all_but_the_time_of_the_run() -> None:
    assert result_of().sha256 == result_of(utc="2027-01-01T00:00:00Z").sha256
    assert len({result_of().sha256, result_of(version="0.2.0").sha256, result_of(replace(ROW, found=0.02)).sha256}) == 3


def test_a_result_without_rows_or_with_one_that_found_nothing_does_not_agree() -> None:
    assert result_of().agrees
    assert not result_of(rows=()).agrees
    assert not result_of(ROW, replace(ROW, found=math.nan)).agrees


@pytest.mark.parametrize(
    "damage",
    [
        lambda text: text.replace('"found": 0.01', '"found": 0.02'),
        lambda text: text[: len(text) // 2],
        lambda text: "[" * 100_000,
        lambda text: "[]",
        lambda text: text.replace('"rows"', '"row"'),
        lambda text: "\udce9",
    ],
)
def test_a_kept_result_that_was_changed_counts_as_never_run(monkeypatch, tmp_path, damage) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    path = keep_result(result_of())
    assert last_result() == result_of()
    path.write_bytes(damage(path.read_text()).encode(errors="surrogateescape"))
    assert last_result() is None


def test_the_result_of_another_installation_is_not_taken_for_this_one_s(monkeypatch, tmp_path) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    keep_result(result_of(packages={**versions(), "numpy": "0"}))
    assert last_result() is None
    keep_result(result_of(source_sha256="0" * 64))
    assert last_result() is None
