"""Housekeeping of STATUS frames beside the panoramas, as a table of instants."""

import numpy as np
import pytest

from gse.station.columns import FRAME
from gse.station.housekeeping import MODES, Mode, fill_housekeeping, firmware_text, in_words, latest_status
from gse.values.instant import NS_PER_S
from protocols import StatusMessage


def status(at_s, supply_v, mode="streaming"):
    return round(at_s * NS_PER_S), StatusMessage(time_us=0, supply_v=supply_v, mode=mode)


def filled(times_s, statuses):
    frames = np.zeros(len(times_s), dtype=FRAME)
    frames["host_utc_ns"] = np.round(np.array(times_s) * NS_PER_S)
    frames["supply_v"] = np.nan
    fill_housekeeping(frames, statuses)
    return frames


def test_a_frame_has_the_housekeeping_of_the_latest_status_before_it():
    frames = filled([9.0, 10.0, 11.0, 20.0, 99.0], [status(20, 4.5, "standby"), status(10, 5.0)])
    assert frames["supply_v"].tolist() == pytest.approx([np.nan, 5.0, 5.0, 4.5, 4.5], nan_ok=True)
    modes = [MODES[place] for place in frames["mode"]]
    assert modes == [Mode.UNKNOWN, Mode.STREAMING, Mode.STREAMING, Mode.STANDBY, Mode.STANDBY]


def test_without_a_status_and_of_an_unheard_of_mode_nothing_is_known():
    assert np.isnan(filled([1.0], [])["supply_v"]).all()
    assert MODES[filled([1.0], [status(0, 5.0, "dancing")])["mode"][0]] is Mode.UNKNOWN


def test_in_words_only_what_was_sent_is_said():
    nothing = StatusMessage(time_us=0, supply_v=np.nan, temperature_c=np.nan, mode="streaming")
    assert in_words(nothing) == "streaming"
    told = StatusMessage(time_us=0, supply_v=4.987, temperature_c=21.26, mode="standby", firmware=(1, 2, 0), serial=7)
    assert in_words(told) == "standby, 4.99 V, 21.3 degC, firmware 1.2.0, serial 7"


def test_a_status_counts_from_its_own_instant_on_and_of_two_at_once_the_later_one():
    statuses = [status(20, 4.5), status(10, 5.0), status(20, 4.25, "standby")]
    frames = filled([9.999999999, 10.0, 19.999999999, 20.0], statuses)
    assert frames["supply_v"].tolist() == pytest.approx([np.nan, 5.0, 5.0, 4.25], nan_ok=True)
    assert frames["mode"].tolist() == [MODES.index(Mode.UNKNOWN), *[MODES.index(Mode.STREAMING)] * 2,
                                       MODES.index(Mode.STANDBY)]  # fmt: skip


def test_the_place_of_the_latest_status_is_none_before_the_first():
    statuses = [status(20, 1.0), status(10, 1.0), status(30, 1.0)]
    times_ns = np.array([5, 10, 15, 20, 29, 30, 31]) * NS_PER_S
    assert latest_status(times_ns, statuses).tolist() == [-1, 1, 1, 0, 0, 2, 2]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"supply_v": 5.0}, "streaming, 5.00 V"),
        ({"temperature_c": -0.04}, "streaming, -0.0 degC"),
        ({"firmware": (1, 2, 0)}, "streaming, firmware 1.2.0"),
        ({"serial": 7}, "streaming, serial 7"),
        ({"mode": ""}, ""),
    ],
)
def test_each_part_of_a_status_is_said_by_itself(changes, words):
    nothing = {"supply_v": np.nan, "temperature_c": np.nan, "mode": "streaming"}
    assert in_words(StatusMessage(time_us=0, **nothing | changes)) == words


def test_a_protocol_without_a_version_has_an_empty_one():
    assert firmware_text(StatusMessage(time_us=0, supply_v=1.0, mode="")) == ""
    assert firmware_text(StatusMessage(time_us=0, supply_v=1.0, mode="", firmware=(3, 0, 11))) == "3.0.11"
