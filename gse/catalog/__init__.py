"""Star catalogues: unit vectors, magnitudes and names of stars, brightest first.

May import no room above itself.
"""

from gse.catalog.mission import brightest_per_field, merge_doubles, mission_catalog, stars_for_field, stars_searched
from gse.catalog.readers import load_catalog
from gse.catalog.stars import Neighbours, StarCatalog

__all__ = [
    "Neighbours",
    "StarCatalog",
    "brightest_per_field",
    "load_catalog",
    "merge_doubles",
    "mission_catalog",
    "stars_for_field",
    "stars_searched",
]
