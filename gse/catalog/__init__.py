"""Star catalogues: unit vectors, magnitudes and names of stars, brightest first."""

from gse.catalog.stars import StarCatalog, load_catalog

__all__ = ["StarCatalog", "load_catalog"]
