"""Earth orientation and leap seconds from files, for machines without a network."""

from pathlib import Path

import astropy.units as u
import astropy_iers_data
import erfa
import numpy as np
import pytest
from astropy.utils import iers

from gse.errors import TruthError
from gse.truth import EarthOrientation
from gse.truth.orientation import installed_leap_seconds, installed_rows, read_given
from gse.values.instant import NS_PER_DAY, UNIX_EPOCH_MJD, from_text

SPRING_NS, LATE_NS = from_text("2026-03-20T18:30:00Z"), from_text("2030-03-20T18:30:00Z")
FINALS = Path(astropy_iers_data.IERS_A_FILE)


@pytest.fixture
def later_finals(tmp_path):
    """The last year of the installed table, dated three years later, with UT1 - UTC 0.05 s higher."""
    lines = [line for line in FINALS.read_text().splitlines() if line[58:68].strip()][-900:]
    moved = [
        f"{line[:7]}{float(line[7:15]) + 1096:8.2f}{line[15:58]}{float(line[58:68]) + 0.05:10.7f}{line[68:]}"
        for line in lines
    ]
    path = tmp_path / "finals2000A.all"
    path.write_text("\n".join(moved) + "\n")
    return path


def test_leap_seconds_are_those_of_erfa():
    leap = installed_leap_seconds()
    theirs = [row for row in erfa.leap_seconds.get() if row["year"] >= 1972]
    assert list(leap.tai_minus_utc_s) == [row["tai_utc"] for row in theirs]
    assert leap.at(57_753) == 36  # 2016-12-31
    assert leap.at(57_754) == leap.at(70_000) == 37
    assert leap.known_until_mjd > 61_000


def test_a_newer_table_takes_the_place_of_the_end_of_predictions(later_finals):
    assert EarthOrientation.from_disk(LATE_NS).at(LATE_NS).kind == "past the end"
    table = EarthOrientation.from_disk(LATE_NS, given=read_given([later_finals]))
    assert table.at(LATE_NS).kind != "past the end"
    assert "finals2000A.all" in table.source
    assert EarthOrientation.from_json(table.to_json()) == table


def test_a_newer_list_of_leap_seconds_announces_one(tmp_path, later_finals):
    installed = Path(astropy_iers_data.IERS_LEAP_SECOND_FILE).read_text(encoding="latin-1")
    leap = tmp_path / "Leap_Second.dat"
    newer = installed.replace("28 June 2027", "28 June 2031").rstrip() + "\n    61771.0    1  1 2028       36\n"
    leap.write_text(newer)
    table = EarthOrientation.from_disk(LATE_NS, given=read_given([later_finals, leap]))
    assert (table.at(LATE_NS).tai_minus_utc_s, table.at(LATE_NS).leap_error_s) == (36.0, 0.0)
    assert table.warning(LATE_NS) is None


@pytest.mark.parametrize(
    ("expires", "day"),
    [("1 January 2028", (2028, 1, 1)), ("28 June 2027", (2027, 6, 28)), ("5 Dec 2026", (2026, 12, 5))],
)
def test_a_list_of_leap_seconds_says_until_when_it_is_known(tmp_path, expires, day):
    path = tmp_path / "Leap_Second.dat"
    path.write_text(f"# File expires on {expires}\n 41317.0 1 1 1972 10\n 57754.0 1 1 2017 37\n")
    leap = read_given([path]).leap_seconds
    assert leap.known_until_mjd == erfa.cal2jd(*day)[1]
    assert (leap.mjd, leap.tai_minus_utc_s) == ((41_317, 57_754), (10.0, 37.0))


@pytest.mark.parametrize(
    "line",
    [
        "41000.0 1 1 1972 10",
        "200000.0 1 1 2406 10",
        "57754.0 1 1 2017 0",
        "57754.0 1 1 2017 1000",
        "57754.0 1 1 2017 -9",
    ],
)
def test_a_leap_second_before_1971_or_of_no_size_makes_no_list(tmp_path, line):
    path = tmp_path / "Leap_Second.dat"
    path.write_text(f"# File expires on 28 June 2027\n {line}\n")
    with pytest.raises(TruthError, match="is not a table"):
        read_given([path])
    path.write_text("# File expires on 28 June 2027\n 41001.0 1 1 1972 999\n 199999.0 1 1 2406 1\n")
    assert read_given([path]).leap_seconds.tai_minus_utc_s == (999.0, 1.0)


@pytest.mark.parametrize("columns", [(18, 27), (37, 46), (58, 68), (68, 78)], ids=["x", "y", "UT1", "its error"])
def test_a_value_of_ten_is_no_orientation_of_the_earth(tmp_path, later_finals, columns):
    lines, (begin, end) = later_finals.read_text().splitlines(), columns
    lines[3] = f"{lines[3][:begin]}{10.0:{end - begin}.3f}{lines[3][end:]}"
    path = tmp_path / "finals"
    path.write_text("\n".join(lines))
    with pytest.raises(TruthError, match="line 4: UT1 - UTC or the pole is out of range"):
        read_given([path])


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("", "is not a table of Earth orientation: expected finals2000A"),
        ("mjd;x;y\n1;2;3\n", "not .csv"),
        ("# File expires on 40 June 2027\n 41317.0 1 1 1972 10\n", "is not a table of Earth orientation"),
        ("# File expires on 28 June 2027\n 41499.0 1 7 1972 11\n 41317.0 1 1 1972 10\n", "is not a table"),
    ],
)
def test_another_file_is_refused_in_words(tmp_path, content, words):
    path = tmp_path / "table"
    path.write_text(content)
    with pytest.raises(TruthError, match=words):
        read_given([path])


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(TruthError, match="cannot read the Earth orientation file"):
        read_given([tmp_path / "nowhere"])


def test_a_table_that_ends_before_the_installed_one_takes_nothing_away(tmp_path):
    """Of the last days of the installed table, with UT1 - UTC 0.05 s higher, but for its last hundred."""
    lines = [line for line in FINALS.read_text().splitlines() if line[58:68].strip()][-300:-100]
    path = tmp_path / "finals2000A.all"
    path.write_text("\n".join(f"{line[:58]}{float(line[58:68]) + 0.05:10.7f}{line[68:]}" for line in lines) + "\n")
    given, last = read_given([path]), int(float(lines[-1][7:15]))
    here_ns = (last - UNIX_EPOCH_MJD) * NS_PER_DAY
    before, after = EarthOrientation.from_disk(here_ns), EarthOrientation.from_disk(here_ns, given=given)
    assert after.mjd == before.mjd == tuple(range(last - 10, last + 11))
    higher_s = np.subtract(after.ut1_minus_utc_s, before.ut1_minus_utc_s)
    assert higher_s == pytest.approx([0.05] * 11 + [0.0] * 10, abs=1e-6)


def test_the_row_after_the_last_of_a_newer_table_is_not_asked_for(later_finals):
    given = read_given([later_finals])
    last = max(given.rows)
    table = EarthOrientation.from_disk((last - UNIX_EPOCH_MJD) * NS_PER_DAY, given=given)
    assert (table.mjd[0], table.mjd[-1]) == (last - 10, last)


def test_the_installed_rows_have_every_digit_that_astropy_reads():
    theirs = iers.IERS_B.read(astropy_iers_data.IERS_B_FILE)
    mjd = theirs["MJD"].to_value(u.day)
    for place in (len(mjd) // 2, len(mjd) - 3):
        (row,) = installed_rows(int(mjd[place]), int(mjd[place]))
        expected = [theirs[name][place].value for name in ("UT1_UTC", "PM_x", "PM_y", "e_UT1_UTC")]
        assert row[1:5] == tuple(expected)


@pytest.mark.parametrize("days", [2, 10])
def test_only_the_days_about_an_instant_are_taken_from_a_long_file(later_finals, days):
    given = read_given([later_finals])
    table = EarthOrientation.from_disk(LATE_NS, days, given)
    middle = 40_587 + LATE_NS // (86_400 * 10**9)
    assert list(table.mjd) == list(range(middle - days, middle + days + 1))
    assert list(table.ut1_minus_utc_s) == [given.rows[day][1] for day in table.mjd]
