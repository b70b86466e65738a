"""The columns of the IERS tables to the byte, the ends of the installed ones, and files at the limits of a table."""

from datetime import date
from pathlib import Path

import astropy_iers_data
import pytest

from gse.errors import TruthError
from gse.truth.orientation import (
    LeapSeconds,
    _c04_row,
    installed_last_mjd,
    installed_rows,
    read_given,
)

FINALS = Path(astropy_iers_data.IERS_A_FILE)
C04 = Path(astropy_iers_data.IERS_B_FILE)
ORDINAL_OF_MJD_0 = date(1858, 11, 17).toordinal()
FINALS_LINE = "26 4 5 61135.00 I  0.120733 0.009786  0.136966 0.015902  I 0.8084178 0.0002710  0.0000 0.1916"


def mjd_of(year, month, day):
    return date(year, month, day).toordinal() - ORDINAL_OF_MJD_0


def with_columns(line, columns):
    """A line with texts in columns that are counted from 1, both ends included, as the ReadMe of a table has them."""
    for (first, last), text in columns.items():
        assert len(text) == last - first + 1
        line = line[: first - 1] + text + line[last:]
    return line


def written(tmp_path, *lines):
    path = tmp_path / "table"
    path.write_text("\n".join(lines) + "\n")
    return path


def test_a_line_of_c04_is_read_by_the_bytes_of_its_read_me():
    """Every column is full, and letters stand wherever a column that is not read begins or ends."""
    columns = {
        (17, 26): "1060000.00",
        (27, 38): "-1234.654321",
        (39, 50): "-2345.765432",
        (51, 62): "-345.8765432",
        (147, 158): "-456.9876543",
    }
    row = _c04_row(with_columns("x" * 218, columns))
    assert row == (1_060_000, -345.8765432, -1234.654321, -2345.765432, -456.9876543, "measured")


@pytest.mark.parametrize(("flag", "kind"), [("I", "measured"), ("P", "predicted"), (" ", "predicted")])
def test_a_line_of_finals_is_read_by_the_bytes_of_its_read_me(tmp_path, flag, kind):
    columns = {
        (8, 15): "61000.00",
        (19, 27): "-1.654321",
        (38, 46): "-2.765432",
        (58, 58): flag,
        (59, 68): "-3.8765432",
        (69, 78): "-4.9876543",
    }
    given = read_given([written(tmp_path, FINALS_LINE, with_columns("x" * 185, columns))])
    assert given.rows[61_000] == (61_000, -3.8765432, -1.654321, -2.765432, -4.9876543, kind)


def test_a_row_of_finals_counts_from_its_one_line_on(tmp_path):
    given = read_given([written(tmp_path, FINALS_LINE)])
    assert given.rows == {61_135: (61_135, 0.8084178, 0.120733, 0.136966, 0.0002710, "measured")}
    assert (given.source, given.leap_seconds) == ("table", None)


def test_a_day_without_ut1_is_left_out_whatever_stands_beside_it(tmp_path):
    blank = with_columns(FINALS_LINE, {(8, 15): "61136.00", (59, 68): " " * 10, (69, 78): "10.0002710"})
    assert list(read_given([written(tmp_path, FINALS_LINE, blank)]).rows) == [61_135]
    with pytest.raises(TruthError, match="holds no value of UT1 - UTC; load it down anew"):
        read_given([written(tmp_path, blank)])


@pytest.mark.parametrize("ut1", ["-         ", "         -"])
def test_one_character_in_the_place_of_ut1_is_a_damaged_line_and_shown(tmp_path, ut1):
    line = with_columns(FINALS_LINE, {(59, 68): ut1})
    with pytest.raises(TruthError) as raised:
        read_given([written(tmp_path, FINALS_LINE, line)])
    assert str(raised.value) == (
        f"{tmp_path / 'table'}, line 2: no row of finals2000A: '26 4 5 61135.00 I  0.120733 0.009786  0.'; "
        "load it down anew"
    )


def test_a_table_whose_last_line_is_damaged_is_still_one(tmp_path):
    with pytest.raises(TruthError, match="line 3: no row of finals2000A: 'xxx"):
        read_given([written(tmp_path, FINALS_LINE, FINALS_LINE, "x" * 90)])


@pytest.mark.parametrize("columns", [(19, 27), (38, 46), (59, 68), (69, 78)], ids=["x", "y", "UT1", "its error"])
@pytest.mark.parametrize("sign", ["", "-"])
def test_a_value_just_below_ten_is_taken(tmp_path, columns, sign):
    width = columns[1] - columns[0] + 1
    line = with_columns(FINALS_LINE, {columns: f"{sign}9.9999".rjust(width)})
    (row,) = read_given([written(tmp_path, line)]).rows.values()
    assert float(f"{sign}9.9999") in row


def test_two_files_are_named_and_the_later_row_of_a_day_stands(tmp_path):
    first, second = tmp_path / "first", tmp_path / "second"
    first.write_text(FINALS_LINE + "\n" + with_columns(FINALS_LINE, {(8, 15): "61136.00"}) + "\n")
    second.write_text(with_columns(FINALS_LINE, {(59, 68): " 0.7000000"}) + "\n")
    given = read_given([first, second])
    assert given.source == "first, second"
    assert {day: row[1] for day, row in given.rows.items()} == {61_135: 0.7, 61_136: 0.8084178}
    assert read_given([]) is None


@pytest.mark.parametrize(
    ("size", "words"),
    [
        (20_000_000, "is not a table of Earth orientation: expected finals2000A"),
        (20_000_001, "is larger than 20000000 bytes: this is not a table of Earth orientation"),
    ],
)
def test_a_file_may_have_twenty_million_bytes(tmp_path, size, words):
    path = tmp_path / "large"
    with path.open("wb") as file:
        file.truncate(size)
    with pytest.raises(TruthError, match=words):
        read_given([path])


@pytest.mark.parametrize(
    ("mjd", "expected"), [(0, 10.0), (99, 10.0), (100, 10.0), (101, 10.0), (199, 10.0), (200, 11.0), (350, 12.0)]
)
def test_a_leap_second_counts_from_its_day_on_and_the_first_value_before_all(mjd, expected):
    assert LeapSeconds((100, 200, 300), (10.0, 11.0, 12.0), 400).at(mjd) == expected


def test_the_days_of_the_unix_list_are_counted_from_1900_however_far_they_are(tmp_path):
    """A day that is a second too short or too long shows after 86,400 days, in 2136."""
    days, until = 90_000, 100_000
    last = 86_400 * days
    path = written(tmp_path, f"#@{86_400 * until}", "2272060800 10 # 1 Jan 1972", f"{last} 38")
    leap = read_given([path]).leap_seconds
    first_of_1900 = mjd_of(1900, 1, 1)
    assert leap == LeapSeconds((mjd_of(1972, 1, 1), first_of_1900 + days), (10.0, 38.0), first_of_1900 + until)


@pytest.mark.parametrize(
    ("lines", "good"),
    [
        (["#@ 3991593600", "2272060800 10", "3692217600 37"], True),
        (["# File expires on 28 June 2027", "#@ soon", "2272060800 10", "3692217600 37"], True),
        (["#@ 3991593600", "", "   ", "2272060800 10", "3692217600 37"], True),
        (["#@x3991593600", "2272060800 10", "3692217600 37"], False),
        (["#@ soon", "2272060800 10", "3692217600 37"], False),  # known until an unknown day
        (["2272060800 10", "3692217600 37"], False),
        (["#@ 3991593600"], False),
        (["#@ 3991593600", "2272060800 10", "2272060800 10"], False),
        (["#@ 3991593600", "2272060800 10", "3692217600"], False),
        (["#@ 3991593600", "2272060800 10 1", "3692217600 37"], False),
        (["# File expires on 28 Brumaire 2027", "41317.0 1 1 1972 10"], False),
        (["# File expires on 31 June 2027", "41317.0 1 1 1972 10"], False),
    ],
)
def test_a_list_of_leap_seconds_is_whole_or_none(tmp_path, lines, good):
    path = written(tmp_path, *lines)
    if good:
        assert read_given([path]).leap_seconds.tai_minus_utc_s == (10.0, 37.0)
        return
    with pytest.raises(TruthError, match="is not a table"):
        read_given([path])


def test_the_installed_tables_begin_with_1962_and_go_on_from_the_one_to_the_other():
    first = installed_rows(37_665, 37_667)
    assert [row[0] for row in first] == [37_665, 37_666, 37_667]
    assert first[0] == (37_665, 0.0326338, -0.0127, 0.213, 0.002, "measured")
    last_of_c04 = int(float(C04.read_text().splitlines()[-1].split()[4]))
    both = installed_rows(last_of_c04 - 2, last_of_c04 + 2)
    assert [row[0] for row in both] == list(range(last_of_c04 - 2, last_of_c04 + 3))
    by_day = {int(float(line[7:15])): line for line in FINALS.read_text().splitlines()}
    for row in both[3:]:
        line = by_day[row[0]]
        assert row[1:5] == tuple(float(text) for text in (line[58:68], line[18:27], line[37:46], line[68:78]))


def test_the_last_installed_day_is_the_last_with_a_prediction():
    """A row of a day that is not predicted has its date and spaces."""
    lines = [line for line in FINALS.read_text().splitlines() if line[15:].strip()]
    last = int(float(lines[-1][7:15]))
    assert installed_last_mjd() == last
    assert [row[0] for row in installed_rows(last - 1, last + 3)] == [last - 1, last]
    assert installed_rows(last + 2, last + 3) == []


def test_days_before_the_first_row_are_refused():
    with pytest.raises(TruthError, match="holds no IERS tables with one line per day; reinstall astropy-iers-data"):
        installed_rows(37_664, 37_666)
