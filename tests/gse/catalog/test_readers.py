import gzip
import math
import struct

import numpy as np
import pytest

from gse.catalog import load_catalog
from gse.errors import CatalogError

MAS = math.radians(1 / 3_600_000)


def hip_line(number=32349, v="-1.44", ra="101.28854105", de="-16.71314306", mu_ra="-546.01", mu_de="-1223.08"):
    """A line in the layout of hip_main.dat: 78 fields, of which the reader looks at eight."""
    field = [" "] * 78
    field[:6] = ["H", f"{number:>12}", " ", "06 45 09.25", "-16 42 47.3", f"{v:>5}"]
    field[8:10] = [f"{ra:>12}", f"{de:>12}"]
    field[12:14] = [f"{mu_ra:>8}", f"{mu_de:>8}"]
    return "|".join(field)


def bsc5(records, *, epoch_sign=-1, length=32):
    header = struct.pack("<7i", 0, 1, epoch_sign * len(records), 1, 1, 1, length)
    return header + b"".join(struct.pack("<fdd2shff", *record) for record in records)


SIRIUS = (2491, 1.76779309, -0.29175118, b"A1", -146, -2.6810196e-06, -5.84200507e-06)
NO_STAR = (92, 0.0, 0.0, b"  ", 0, 0.0, 0.0)
REGULUS = (3982, 2.65452216, 0.20886710, b"B7", 135, -1.2e-06, 2e-8)


@pytest.fixture
def written(tmp_path):
    def write(content):
        path = tmp_path / "catalogue"
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return str(path)

    return write


def test_hipparcos_is_read_plain_and_compressed(written):
    text = "\n".join([hip_line(1, "6.5", "10.0", "20.0"), hip_line()]) + "\n"
    plain, packed = load_catalog(written(text)), load_catalog(written(gzip.compress(text.encode())))
    for catalog in (plain, packed):
        assert catalog.ids.tolist() == [32349, 1]
        assert catalog.magnitude.tolist() == [-1.44, 6.5]
        assert (catalog.source, catalog.epoch_jyear) == ("Hipparcos", 1991.25)
        assert [catalog.name(0), catalog.name(1)] == ["Sirius", "HIP 1"]
    ra, de = math.radians(10), math.radians(20)
    np.testing.assert_allclose(
        plain.icrs[1], [math.cos(de) * math.cos(ra), math.cos(de) * math.sin(ra), math.sin(de)], atol=1e-12
    )


def test_proper_motion_moves_stars_to_the_epoch(written):
    catalog = load_catalog(written(hip_line()))
    later = catalog.at_epoch(2026.25)
    moved_mas = np.linalg.norm(later.icrs - catalog.icrs) / MAS
    assert moved_mas == pytest.approx(35 * math.hypot(546.01, 1223.08), rel=1e-6)
    assert later.epoch_jyear == 2026.25
    assert later.icrs[0, 2] < catalog.icrs[0, 2]


def test_a_hipparcos_star_without_solution_stands_at_its_rounded_place(written):
    catalog = load_catalog(written(hip_line(ra="", de="", mu_ra="", mu_de="")))
    assert math.degrees(math.asin(catalog.icrs[0, 2])) == pytest.approx(-(16 + 42 / 60 + 47.3 / 3600), abs=1e-9)
    assert not catalog.motion_rad_yr.any()


def test_a_hipparcos_star_without_magnitude_is_left_out(written):
    assert load_catalog(written("\n".join([hip_line(), hip_line(5, v="")]))).ids.tolist() == [32349]


def test_bsc5_is_read_and_entries_that_are_no_stars_left_out(written):
    catalog = load_catalog(written(bsc5([NO_STAR, REGULUS, SIRIUS])))
    assert catalog.ids.tolist() == [2491, 3982]
    assert catalog.magnitude.tolist() == [-1.46, 1.35]
    assert (catalog.designation, catalog.epoch_jyear) == ("HR", 2000.0)
    assert [catalog.name(0), catalog.name(1)] == ["Sirius", "Regulus"]
    assert np.linalg.norm(catalog.motion_rad_yr[0]) == pytest.approx(math.hypot(2.6810196e-06, 5.84200507e-06))


def test_gaia_is_the_default_and_only_its_bright_stars_move():
    catalog = load_catalog()
    later = catalog.at_epoch(2050.0)
    assert (later.icrs[:100] != catalog.icrs[:100]).any(axis=1).all()
    np.testing.assert_allclose(later.icrs[-1000:], catalog.icrs[-1000:], atol=1e-15)
    assert (catalog.epoch_jyear, len(catalog)) == (2016.0, 482_176)
    assert (np.diff(catalog.magnitude) >= 0).all()


def test_a_few_stars_are_the_brightest_of_all():
    every = load_catalog()
    for few in (load_catalog(stars=1000), load_catalog(faintest_magnitude=4.0)):
        assert 100 < len(few) < 2000
        assert (few.ids == every.ids[: len(few)]).all()
        assert (few.icrs == every.icrs[: len(few)]).all()
    assert every.magnitude[len(few) - 1] <= 4.0 < every.magnitude[len(few)]


def test_a_few_stars_are_the_brightest_of_a_file_too(written):
    path = written(bsc5([REGULUS, SIRIUS]))
    assert load_catalog(path, stars=1).name(0) == "Sirius"
    assert load_catalog(path, faintest_magnitude=0.0).name(0) == "Sirius"


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (b"", "not a .*star catalogue"),
        (b"\x89PNG\r\n\x1a\n" + bytes(100), "not a .*star catalogue"),
        (b"y,x,index\n1,2,3\n", "not a .*star catalogue"),
        ("H|        1|  rubbish", "line 1"),
        (hip_line() + "\n" + hip_line(de="bad"), "line 2"),
        (hip_line(de="99.0"), "line 1"),
        (hip_line(v=""), "no star with position"),
        (hip_line(mu_ra="nan"), "line 1"),
        (gzip.compress(hip_line().encode(), mtime=0)[:-20], "damaged gzip"),
        (b"\x1f\x8b" + bytes(50), "damaged gzip"),
        (bsc5([SIRIUS, REGULUS])[:-5], "expected|has"),
        (bsc5([SIRIUS, (7, math.nan, 0.1, b"A0", 100, 0.0, 0.0)]), "record 2"),
        (bsc5([(7, 1.0, 2.0, b"A0", 100, 0.0, 0.0)]), "record 1"),
        (bsc5([SIRIUS], epoch_sign=1), "J2000"),
        (bsc5([SIRIUS], length=31), "not a .*star catalogue"),
    ],
)
def test_a_foreign_or_damaged_file_is_refused_with_a_reason(written, content, complaint):
    with pytest.raises(CatalogError, match=complaint) as caught:
        load_catalog(written(content))
    assert len(str(caught.value).splitlines()) <= 2


def test_a_missing_file_or_a_folder_is_refused(tmp_path):
    for path in (tmp_path / "absent", tmp_path):
        with pytest.raises(CatalogError, match="cannot read"):
            load_catalog(str(path))
