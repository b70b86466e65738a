"""Housekeeping of STATUS frames beside the panoramas, as a table of instants."""

import numpy as np
import pytest

from gse.instant import NS_PER_S
from gse.station.frame_table import FRAME
from gse.station.housekeeping import MODES, Mode, fill_housekeeping, in_words
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
