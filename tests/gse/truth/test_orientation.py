"""Earth orientation between, before and after the days of a table, worked out by hand."""

import importlib.metadata
import json
import math
from dataclasses import replace
from datetime import date

import pytest

from gse.errors import TruthError
from gse.truth import EarthOrientation
from gse.truth.orientation import GivenTables, LeapSeconds, installed_last_mjd, installed_leap_seconds
from gse.values.instant import NS_PER_DAY, UNIX_EPOCH_MJD, from_text

ARCSEC = math.pi / 180 / 3600
NOW_NS = from_text("2026-03-20T18:30:00Z")
TABLE = EarthOrientation(
    "made",
    (60_000, 60_001, 60_002, 60_003),
    (-0.10, -0.12, -0.20, -0.24),
    (0.10, 0.20, 0.40, 0.10),
    (0.30, 0.50, 0.10, 0.20),
    (1e-5, 3e-5, 2e-5, 1e-3),
    ("measured", "measured", "predicted", "predicted"),
    installed_leap_seconds(),
)
"""2023-02-25 to 28."""


def utc_ns(mjd):
    return round((mjd - UNIX_EPOCH_MJD) * NS_PER_DAY)


@pytest.mark.parametrize(
    ("mjd", "ut1", "x", "y", "error", "kind"),
    [
        (60_000.0, -0.10, 0.10, 0.30, 3e-5, "measured"),
        (60_000.25, -0.105, 0.125, 0.35, 3e-5, "measured"),
        (60_001.5, -0.16, 0.30, 0.30, 3e-5, "predicted"),
        (60_002.75, -0.23, 0.175, 0.175, 1e-3, "predicted"),
        (60_003.0, -0.24, 0.10, 0.20, 1e-3, "predicted"),
        (59_999.0, -0.10, 0.10, 0.30, 3e-5 + 1e-3, "past the end"),
        (60_013.0, -0.24, 0.10, 0.20, 1e-3 + 1e-2, "past the end"),
        (60_103.5, -0.24, 0.10, 0.20, 1e-3 + 0.1005, "past the end"),
        (62_000.0, -0.24, 0.10, 0.20, 0.9 + 0.24, "past the end"),
    ],
)
def test_values_are_linear_between_days_and_held_past_the_ends(mjd, ut1, x, y, error, kind):
    here = TABLE.at(utc_ns(mjd))
    assert here.ut1_minus_utc_s == pytest.approx(ut1, abs=1e-9)
    assert (here.x_pole_rad / ARCSEC, here.y_pole_rad / ARCSEC) == pytest.approx((x, y), abs=1e-9)
    assert here.ut1_error_s == pytest.approx(error, rel=1e-9)
    assert here.kind == kind


@pytest.mark.parametrize(
    ("mjd", "arcsec"), [(60_000.5, 0.0005), (60_002.5, 0.02), (60_013.0, 0.06), (60_148.0, 0.6), (62_000.0, 0.6)]
)
def test_a_held_pole_is_known_worse_each_day_but_no_worse_than_it_wanders(mjd, arcsec):
    assert TABLE.at(utc_ns(mjd)).pole_error_arcsec == pytest.approx(arcsec, rel=1e-9)


def test_only_where_no_leap_second_is_announced_may_one_be_missing():
    until = replace(TABLE, leap_seconds=replace(TABLE.leap_seconds, known_until_mjd=60_002))
    missing_s = [until.at(utc_ns(mjd)).leap_error_s for mjd in (60_001.0, 60_001.9, 60_002.0, 60_003.0)]
    assert missing_s == pytest.approx([0.0, 0.0, 1.0, 1.0])
    far = replace(until, mjd=(50_000, 50_001, 50_002, 50_003))  # UT1 itself is unknown to 0.9 s and more.
    assert far.at(utc_ns(60_002.0)).leap_error_s == 0.0


def test_across_a_leap_second_ut1_is_interpolated_without_the_leap():
    """2016-12-31 to 2017-01-02, with the leap second at the end of the first day."""
    table = replace(TABLE, mjd=(57_753, 57_754, 57_755, 57_756), ut1_minus_utc_s=(-0.407, 0.592, 0.591, 0.590))
    assert table.at(utc_ns(57_753.5)).ut1_minus_utc_s == pytest.approx(-0.4075, abs=1e-9)
    assert table.at(utc_ns(57_754.5)).ut1_minus_utc_s == pytest.approx(0.5915, abs=1e-9)


def test_the_table_around_a_session_reaches_ten_days_to_either_side():
    table = EarthOrientation.from_disk(NOW_NS)
    day = UNIX_EPOCH_MJD + NOW_NS // NS_PER_DAY
    assert (table.mjd[0], table.mjd[-1]) == (day - 10, day + 10)
    assert table.mjd == tuple(range(day - 10, day + 11))


def test_far_past_the_end_the_last_days_of_the_predictions_are_taken():
    table = EarthOrientation.from_disk(from_text("2060-01-01T00:00:00Z"))
    assert len(table.mjd) == 11
    assert set(table.kind) == {"predicted"}


def test_truth_begins_with_1972():
    first = from_text("1972-01-01T00:00:00Z")
    assert EarthOrientation.from_disk(first).at(first).kind == "measured"
    with pytest.raises(TruthError, match="1971-12-31"):
        EarthOrientation.from_disk(first - 1)


def test_past_the_end_a_line_says_which_days_are_known_and_how_well_ut1_is():
    warning = TABLE.warning(utc_ns(60_102.0))
    assert warning is not None
    assert warning.startswith("2023-06-07")
    assert "2023-02-25 to 2023-02-28" in warning
    assert "UT1 is only known to 0.1 s = 1.5 arcsec" in warning
    assert TABLE.warning(utc_ns(60_003.0)) is None
    assert TABLE.warning(utc_ns(60_003.0) + 1000) is not None


def of_days(count):
    columns = {name: [0.0] * count for name in ("ut1_minus_utc_s", "x_pole_arcsec", "y_pole_arcsec", "ut1_error_s")}
    document = {"schema": "gse.earth-orientation/1", "source": "made", "mjd": list(range(60_000, 60_000 + count))}
    return json.dumps(document | columns | {"kind": ["measured"] * count})


@pytest.mark.parametrize(("days", "good"), [(0, False), (1, False), (2, True), (4000, True), (4001, False)])
def test_a_frozen_table_has_two_to_four_thousand_days(days, good):
    if good:
        assert len(EarthOrientation.from_json(of_days(days)).mjd) == days
        return
    with pytest.raises(TruthError, match="impossible length"):
        EarthOrientation.from_json(of_days(days))


LEAPS = {"mjd": [41_317, 57_754], "tai_minus_utc_s": [10, 37], "known_until_mjd": 61_000}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"mjd": [], "tai_minus_utc_s": []}, "impossible length or order"),
        ({"tai_minus_utc_s": [10]}, "impossible length or order"),
        ({"mjd": [41_317]}, "impossible length or order"),
        ({"mjd": [57_754, 41_317]}, "impossible length or order"),
        ({"mjd": [41_317, 41_317]}, "impossible length or order"),
        ({"mjd": list(range(401)), "tai_minus_utc_s": [10] * 401}, "impossible length or order"),
        ({"tai_minus_utc_s": [10, math.nan]}, "not a number"),
        ({"known_until_mjd": math.inf}, "not a number"),
        ({"tai_minus_utc_s": [10, "37"]}, "not a number"),
    ],
)
def test_a_frozen_table_with_leap_seconds_without_sense_is_refused(changes, words):
    document = json.loads(of_days(2))
    assert EarthOrientation.from_json(json.dumps(document | {"leap_seconds": LEAPS})).leap_seconds.at(57_754) == 37
    with pytest.raises(TruthError, match=words):
        EarthOrientation.from_json(json.dumps(document | {"leap_seconds": LEAPS | changes}))


def test_a_frozen_list_may_have_four_hundred_leap_seconds():
    many = {"mjd": list(range(41_317, 41_717)), "tai_minus_utc_s": [10] * 400, "known_until_mjd": 61_000}
    table = EarthOrientation.from_json(json.dumps(json.loads(of_days(2)) | {"leap_seconds": many}))
    assert len(table.leap_seconds.mjd) == 400


DOCUMENT = {
    "schema": "gse.earth-orientation/1",
    "source": "made",
    "mjd": [60_000, 60_001],
    "ut1_minus_utc_s": [-0.1, 0.1],
    "x_pole_arcsec": [0.2, 0.3],
    "y_pole_arcsec": [0.4, 0.5],
    "ut1_error_s": [1e-5, 2e-5],
    "kind": ["measured", "predicted"],
}


@pytest.mark.parametrize("name", ["ut1_minus_utc_s", "x_pole_arcsec", "y_pole_arcsec", "ut1_error_s"])
@pytest.mark.parametrize(("value", "good"), [(999_999.5, True), (-999_999.5, True), (1e6, False), (-1e6, False)])
def test_no_value_of_a_frozen_table_reaches_a_million(name, value, good):
    text = json.dumps(DOCUMENT | {name: [value, 0.0]})
    if good:
        assert getattr(EarthOrientation.from_json(text), name) == (value, 0.0)
        return
    with pytest.raises(TruthError, match=r"no Earth orientation table of schema gse.earth-orientation/1: .* out of o"):
        EarthOrientation.from_json(text)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"schema": "gse.earth-orientation/2"}, "another schema"),
        ({"kind": ["measured"]}, "columns of different or impossible length"),
        ({"x_pole_arcsec": [0.1, 0.2, 0.3]}, "columns of different or impossible length"),
        ({"y_pole_arcsec": ["0.1", 0.2]}, "a value is not a finite number"),
        ({"ut1_error_s": [0.1, math.inf]}, "a value is not a finite number"),
        ({"kind": ["measured", "guessed"]}, "a kind of value that is not known"),
        ({"mjd": [60_000, 60_002]}, "days are missing"),
        ({"mjd": [60_001, 60_000]}, "days are missing"),
        ({"mjd": [60_000, 60_000]}, "days are missing"),
    ],
)
def test_a_frozen_table_that_is_refused_says_what_is_wrong(changes, words):
    with pytest.raises(TruthError) as raised:
        EarthOrientation.from_json(json.dumps(DOCUMENT | changes))
    assert str(raised.value) == f"no Earth orientation table of schema gse.earth-orientation/1: {words}"


def test_a_frozen_table_has_every_column_in_its_place_and_the_installed_leap_seconds_where_it_has_none():
    table = EarthOrientation.from_json(json.dumps(DOCUMENT | {"source": "made\x1b"}))
    expected = {name: tuple(column) for name, column in DOCUMENT.items() if isinstance(column, list)}
    assert {name: getattr(table, name) for name in expected} == expected
    assert table.source == "made\\x1b"
    assert table.leap_seconds == installed_leap_seconds()
    leaps = {"mjd": [41_317, 57_754], "tai_minus_utc_s": [10, 37.5], "known_until_mjd": 61_000.5}
    table = EarthOrientation.from_json(json.dumps(DOCUMENT | {"leap_seconds": leaps}))
    assert table.leap_seconds == LeapSeconds((41_317, 57_754), (10, 37.5), 61_000)
    assert json.loads(table.to_json()) == DOCUMENT | {"leap_seconds": leaps | {"known_until_mjd": 61_000}}


def test_a_table_reaches_back_to_1962_at_most():
    table = EarthOrientation.from_disk(from_text("1972-01-02T12:00:00Z"), days=5000)
    assert (table.mjd[0], table.mjd[-1]) == (37_665, 41_318 + 5000)
    assert (table.ut1_minus_utc_s[0], table.x_pole_arcsec[0], table.y_pole_arcsec[0]) == (0.0326338, -0.0127, 0.213)
    assert (table.ut1_error_s[0], table.kind[0]) == (0.002, "measured")


def test_the_source_of_a_table_names_the_package_and_the_files_that_were_given():
    installed = f"IERS C04 and finals2000A, astropy-iers-data {importlib.metadata.version('astropy-iers-data')}"
    assert EarthOrientation.from_disk(NOW_NS).source == installed
    leaps = LeapSeconds((41_317,), (10.0,), 70_000)
    with_leaps = EarthOrientation.from_disk(NOW_NS, given=GivenTables("my.list", leap_seconds=leaps))
    assert (with_leaps.source, with_leaps.leap_seconds) == (f"{installed}, and my.list", leaps)
    without = EarthOrientation.from_disk(NOW_NS, given=GivenTables("my.all"))
    assert (without.source, without.leap_seconds) == (f"{installed}, and my.all", installed_leap_seconds())


def test_a_gap_between_the_installed_and_the_given_rows_is_refused_with_the_last_day():
    first = installed_last_mjd() + 3
    rows = {day: (day, 0.1, 0.2, 0.3, 0.001, "predicted") for day in range(first, first + 30)}
    day = date.fromordinal(date(1858, 11, 17).toordinal() + first + 29)
    with pytest.raises(TruthError) as raised:
        EarthOrientation.from_disk(utc_ns(first + 5), given=GivenTables("finals2000A.daily", rows))
    assert str(raised.value) == (
        f"the Earth orientation files leave a gap before {day.isoformat()}; give finals2000A.all, not .daily"
    )
    far = EarthOrientation.from_disk(utc_ns(first + 13), given=GivenTables("finals2000A.daily", rows))
    assert far.mjd == tuple(range(first + 3, first + 24))


@pytest.mark.parametrize(
    ("error_s", "leap_error_s"),
    [(0.0, 1.0), (0.05, 1.0), (0.15, 0.95), (0.6, 0.5), (1.05, 0.05), (1.1, 0.0), (3.0, 0.0)],
)
def test_a_leap_second_that_may_be_missing_adds_what_ut1_is_not_unsure_of_already(error_s, leap_error_s):
    """UT1 - UTC is held at -0.2 s: it is known to 0.9 + 0.2 s without any table."""
    table = replace(
        TABLE,
        ut1_minus_utc_s=(-0.2,) * 4,
        ut1_error_s=(error_s,) * 4,
        leap_seconds=replace(TABLE.leap_seconds, known_until_mjd=50_000),
    )
    here = table.at(utc_ns(60_001.5))
    assert here.leap_error_s == pytest.approx(leap_error_s, abs=1e-9)
    assert here.ut1_error_s == pytest.approx(min(error_s, 1.1), abs=1e-9)


def test_a_clock_of_1971_is_told_to_the_second():
    assert TABLE.at(from_text("1972-01-01T00:00:00Z")).kind == "past the end"
    with pytest.raises(TruthError) as raised:
        TABLE.at(from_text("1972-01-01T00:00:00Z") - 1)
    assert str(raised.value) == (
        "no sidereal truth for 1971-12-31T23:59:59Z: the Earth orientation table begins at 1972-01-01; "
        "set the clock that stamps the frames"
    )


ADVICE = (
    "update it with: pip install -U astropy-iers-data, or give newer files with --earth-orientation finals2000A.all"
)
LEAPS_END = "leap seconds are only announced until 2023-02-27: one that is missing is 15 arcsec"


@pytest.mark.parametrize(
    ("mjd", "told"),
    [
        (60_001.999, None),
        (60_002.0, f"{LEAPS_END}; {ADVICE}"),
        (60_003.0, f"{LEAPS_END}; {ADVICE}"),
        (
            60_003.25,  # 0.00025 s by the wander and 0.001 s of the last row
            "2023-02-28T06:00:00Z is outside the Earth orientation table (2023-02-25 to 2023-02-28): "
            f"UT1 is only known to 0.0013 s = 0.019 arcsec; {LEAPS_END}; {ADVICE}",
        ),
        (
            59_998.5,  # 1.5 days before: 0.0015 s and the 0.00003 s of the first two rows
            "2023-02-23T12:00:00Z is outside the Earth orientation table (2023-02-25 to 2023-02-28): "
            f"UT1 is only known to 0.0015 s = 0.023 arcsec; {ADVICE}",
        ),
    ],
)
def test_the_operator_is_told_what_ends_and_what_to_do(mjd, told):
    table = replace(TABLE, leap_seconds=replace(TABLE.leap_seconds, known_until_mjd=60_002))
    assert table.warning(utc_ns(mjd)) == told
