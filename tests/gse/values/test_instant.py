"""Instants are whole nanoseconds, and read as RFC 3339."""

import pytest
from astropy.time import Time
from hypothesis import given
from hypothesis import strategies as st

from gse.values import instant


@given(st.integers(0, 4_000_000_000_000_000_000))
def test_an_instant_comes_back_from_its_text(utc_ns: int) -> None:
    assert instant.from_text(instant.to_text(utc_ns, 9)) == utc_ns


def test_the_text_is_that_of_astropy() -> None:
    utc_ns = 1_774_018_800_123_456_789
    assert instant.to_text(utc_ns, 3) == Time(utc_ns / 1e9, format="unix").utc.isot[:19] + ".123Z"


def test_the_julian_date_is_that_of_astropy() -> None:
    ours = instant.to_julian_date(1_774_018_800_000_000_000)
    astropys = Time("2026-03-20T15:00:00", scale="utc")
    assert abs((ours[0] - astropys.jd1) + (ours[1] - astropys.jd2)) < 1e-12


@pytest.mark.parametrize("text", ["", "today", "2026-03-20", "2026-03-20T18:30:00", "2026-02-30T00:00:00Z", "1e9Z"])
def test_what_is_no_instant_is_refused_with_an_example(text: str) -> None:
    with pytest.raises(ValueError, match="expected for example"):
        instant.from_text(text)


@pytest.mark.parametrize("text", ["0001-01-01T00:00:00Z", "1969-12-31T23:59:59Z", "2300-01-01T00:00:00Z"])
def test_an_instant_that_no_frame_can_carry_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="expected an instant from 1970 to 2255"):
        instant.from_text(text)
