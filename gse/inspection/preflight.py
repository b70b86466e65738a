"""Checks before a session: one for each frequent cause of a lost session."""

import math
import os
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from drivers.chunk import Chunk
from drivers.clock import read_clock
from drivers.errors import DriverError
from drivers.link import SerialLink
from drivers.link_state import SAMPLE_BYTES
from drivers.ports import LineSettings, PortInfo, is_device, is_mock, ports_here
from drivers.uart import BITS_PER_BYTE, USUAL_BAUDS
from gse.catalog.mission import stars_for_field
from gse.catalog.readers import load_catalog
from gse.config.station import Station
from gse.errors import GseError, UsageError
from gse.external.answers import Failure
from gse.external.identifier import Given, RunningIdentifier
from gse.external.plugs import plug_of
from gse.inspection.plausibility import Check, CheckOutcome, plausibility
from gse.process.jit import WITHOUT_A_PLACE, machine_code_folder, why_without_a_place
from gse.station.byte_stream import what_fits
from gse.station.polling import check_asking
from gse.station.setup import ORION_RA_DE_DEG, addressed, example_places, sensor_description
from gse.statistics.clock_health import CLOCK_REMEDY
from gse.truth import EarthOrientation
from gse.truth.orientation import GivenTables
from gse.values import instant
from gse.values.attitude import Attitude
from gse.values.axis import ON_SKY
from gse.values.constants import EARTH_RATE_ARCSEC_PER_S
from gse.values.limits import Limits
from gse.values.matrices import product
from gse.values.panorama import Panorama
from gse.values.site import Site
from gse.view.viewer import rerun_program
from protocols import Frame, FrameDecoder, Protocol, ProtocolError, load_protocol

# Check of an external identifier before a session: it is shown the belt of Orion, as the sensor would see it.

_NAME = "identifier"
_ADVICE = "feed it a file of lines by hand, or read what it says: docs/external-identifiers.md"
_NEAR_DEG = 0.05
"""As of a right answer in the benchmark."""
_CONVENTIONS = "ICRS, degrees, boresight; y counts rows from the top; the first number of an object is y"


def check_external_identifier(station: Station) -> Check:
    """Start the external identifier of the station file, and compare its answers to two panoramas."""
    try:
        plug = plug_of(station.identifier, sensor_description(station, load_protocol(station.protocol)))
        panorama = _panorama(station)
    except (GseError, ValueError) as error:
        return Check(_NAME, CheckOutcome.FAIL, str(error), "correct 'identifier' in the station file")
    identifier = RunningIdentifier(plug, station.identifier.timeout_ms / 1000)
    try:
        *_, given = identifier.answers([panorama, replace(panorama, frame_no=1)])
    finally:
        identifier.close()
    return _judged(f"{plug.identity.name}, version {plug.identity.version}", given)


def _panorama(station: Station) -> Panorama:
    xy_px, brightness = example_places(load_catalog(station.catalog), station.sensor.camera())
    return Panorama(0, xy_px, np.round(brightness), time_us=0, exposure_s=0.1)


def _judged(name: str, given: Given) -> Check:
    answer = given.answer
    if isinstance(answer, Failure):
        return Check(_NAME, CheckOutcome.FAIL, f"{name}: {answer.kind}: {answer.detail}", _ADVICE)
    if answer.attitude is None:
        said = f"{answer.status} {answer.detail}".strip()
        return Check(_NAME, CheckOutcome.WARN, f"{name}: no answer to the belt of Orion: {said}", _ADVICE)
    boresight = Attitude.from_angles(*ORION_RA_DE_DEG, 0.0).boresight_icrs
    cosine = float(np.clip(product(boresight, answer.attitude.boresight_icrs), -1, 1))
    off_deg = math.degrees(math.acos(cosine))
    if off_deg > _NEAR_DEG:
        text = f"{name}: {off_deg:.1f} deg off in the belt of Orion (RA 83, DE 0 deg)"
        return Check(_NAME, CheckOutcome.WARN, text, f"look at its conventions: {_CONVENTIONS}")
    time = "" if given.elapsed_us is None else f" in {given.elapsed_us / 1000:.2g} ms"
    return Check(_NAME, CheckOutcome.OK, f"{name}: finds the belt of Orion{time}")


LISTEN_S = 3.0
"""The slowest sensor known exposes for 2 s."""
TRY_S = 1.5
"""With each other baud rate: a frame at 1 Hz."""
ENOUGH_FRAMES = 3
OVERHEAD = 2.5
"""Records around the bytes, derived results, and the compressed copy beside the plain file at close."""


def checks(
    station: Station,
    out: Path,
    hours: float,
    given_orientation: GivenTables | None = None,
    begins_ns: int | None = None,
) -> Iterator[Check]:
    """All checks of a station, one after the other; each takes at most some seconds.

    ``begins_ns`` is when the session begins; None is now.
    """
    now_ns = read_clock().utc_ns if begins_ns is None else begins_ns
    yield _protocol(station)
    yield _air(station.site)
    yield _port(station)
    yield _clock(station)
    yield _disk(station, out, hours)
    yield _cache()
    yield _earth_orientation(now_ns + round(hours * 3600 * instant.NS_PER_S), given_orientation)
    yield _catalog(station)
    if station.identifier.algorithm == "external":
        yield check_external_identifier(station)
    yield from plausibility(station, now_ns, hours)
    yield _viewer()


def _protocol(station: Station) -> Check:
    try:
        protocol = load_protocol(station.protocol)
    except ProtocolError as error:
        return Check("protocol", CheckOutcome.FAIL, str(error), "correct the description, or name a built-in one")
    try:
        check_asking(station.sensor, station.port, addressed(protocol, station))
    except UsageError as error:
        return Check("protocol", CheckOutcome.FAIL, str(error), "correct the station file: docs/station-file.md")
    return Check("protocol", CheckOutcome.OK, f"{protocol.name}: {', '.join(protocol.types)}")


def _port(station: Station) -> Check:
    url, baudrate = station.port.url, station.port.baudrate
    if is_mock(url):
        return Check("port", CheckOutcome.OK, f"{url} needs no device")
    try:
        protocol = load_protocol(station.protocol)
        sample, frames = _listen(url, baudrate, station.port.line, protocol, LISTEN_S)
        if sample and not frames:
            return _unreadable(station, protocol, sample)
    except DriverError as error:
        return Check("port", CheckOutcome.FAIL, str(error), "list the ports with 'gse ports'")
    except ProtocolError:
        return Check("port", CheckOutcome.WARN, f"{url} opens; without a valid protocol its bytes cannot be checked")
    if frames:
        said = f"{url} at {baudrate} {station.port.line}: valid frames come"
        return Check("port", CheckOutcome.OK, said, _stays(url, ports_here()))
    return Check(
        "port",
        CheckOutcome.WARN,
        f"{url} opens, but no bytes came within {LISTEN_S:g} s",
        "check the sensor's power; ask it with 'gse sensor status', start it with 'gse sensor start'",
    )


def _stays(url: str, ports: list[PortInfo]) -> str:
    """Advice for the name of a USB adapter that another one may get; empty where the name stays."""
    for port in ports:
        if port.device == url and port.url_that_stays:
            return f"write port.url: {port.url_that_stays} in the station file: {url} can be another adapter tomorrow"
    return ""


def _unreadable(station: Station, protocol: Protocol, sample: bytes) -> Check:
    """What would make frames of the bytes: by their look, or by the usual baud rates, tried one after the other."""
    url, baudrate = station.port.url, station.port.baudrate
    text = f"{url} at {baudrate}: {len(sample)} bytes in {LISTEN_S:g} s, but no valid frame"
    if explained := what_fits(sample[:SAMPLE_BYTES], protocol, baudrate):
        return Check("port", CheckOutcome.FAIL, text, explained)
    tried = []
    for baud in sorted(USUAL_BAUDS, key=lambda rate: abs(math.log(rate / baudrate)))[1:] if is_device(url) else []:
        came, frames = _listen(url, baud, station.port.line, protocol, TRY_S)
        if frames:
            return Check("port", CheckOutcome.FAIL, text, f"valid frames come with port.baudrate: {baud}")
        if not came:
            break
        tried.append(str(baud))
    also = f"none comes with {', '.join(tried)} either; " if tried else ""
    return Check("port", CheckOutcome.FAIL, text, f"{also}check baud rate and protocol of the sensor")


def _listen(url: str, baudrate: int, line: LineSettings, protocol: Protocol, seconds: float) -> tuple[bytes, int]:
    """What came within some seconds, and its number of valid frames; ends early after ENOUGH_FRAMES."""
    decoder, received, frames = FrameDecoder(protocol, from_sensor=True), bytearray(), 0
    with SerialLink(url, baudrate, line=line) as link:
        until_ns = link.mono_ns() + round(seconds * instant.NS_PER_S)
        while link.mono_ns() < until_ns and frames < ENOUGH_FRAMES:
            for item in link.receive(0.2):
                if isinstance(item, Chunk):
                    received += item.data
                    frames += sum(isinstance(piece, Frame) for piece in decoder.feed(item.data))
    return bytes(received), frames


def _clock(station: Station) -> Check:
    if is_mock(station.port.url):
        return Check("clock", CheckOutcome.OK, "a simulated or recorded session brings its own time")
    clock = read_clock()
    if not clock.synchronised:
        return Check(
            "clock",
            CheckOutcome.FAIL,
            f"the clock is not synchronised ({clock.source}); "
            f"1 s of error is {EARTH_RATE_ARCSEC_PER_S:.0f} arcsec of RA",
            CLOCK_REMEDY,
        )
    bound_s = abs(clock.offset_s) + clock.error_bound_s
    text = f"{clock.source}, within {bound_s * 1e3:.1f} ms = {bound_s * EARTH_RATE_ARCSEC_PER_S:.2g} arcsec of RA"
    if bound_s * EARTH_RATE_ARCSEC_PER_S > _tightest(station.limits) / 10:
        return Check("clock", CheckOutcome.WARN, text, "more than a tenth of the limits: choose a nearer time server")
    return Check("clock", CheckOutcome.OK, text)


def _tightest(limits: Limits) -> float:
    return min(limits.of(axis) for axis in ON_SKY)


def _disk(station: Station, out: Path, hours: float) -> Check:
    folder = next(path for path in (out.absolute(), *out.absolute().parents) if path.exists())
    if not folder.is_dir() or not os.access(folder, os.W_OK):
        return Check("disk", CheckOutcome.FAIL, f"{folder} cannot be written", "choose another folder with --out")
    needed = round(hours * 3600 * station.port.baudrate / BITS_PER_BYTE * OVERHEAD)
    free = shutil.disk_usage(folder).free
    text = f"{_size(free)} free in {folder}; {hours:g} h need at most {_size(needed)}"
    if free < needed:
        return Check("disk", CheckOutcome.FAIL, text, "make room, or choose another disk with --out")
    return Check("disk", CheckOutcome.OK, text)


def _cache() -> Check:
    """Machine code and star tables, without which each start takes as long as the first."""
    folder = machine_code_folder()
    if folder is None:
        return Check("cache", CheckOutcome.WARN, f"{why_without_a_place()}: each start compiles anew", WITHOUT_A_PLACE)
    return Check("cache", CheckOutcome.OK, f"machine code is kept in {folder}")


def _size(count: int) -> str:
    return f"{count / 1e9:.1f} GB" if count >= 1e9 else f"{count / 1e6:.0f} MB"


def _air(site: Site) -> Check:
    doubt = site.pressure_doubt()
    if doubt:
        advice = "a wrong pressure of 30 hPa is 1.7 arcsec at 45 deg of altitude"
        return Check("air", CheckOutcome.WARN, doubt, advice)
    how = "as entered" if site.pressure_hpa is not None else f"the standard atmosphere's at {site.height_m:g} m"
    uncertainty = f"within {site.pressure_uncertainty_hpa:g} hPa"
    return Check("air", CheckOutcome.OK, f"{site.air_pressure_hpa:.0f} hPa, {how}, {uncertainty}")


def _earth_orientation(end_ns: int, given: GivenTables | None) -> Check:
    try:
        orientation = EarthOrientation.from_disk(end_ns, given=given)
        warning = orientation.warning(end_ns)
    except GseError as error:
        return Check("earth", CheckOutcome.FAIL, str(error), "set the clock, or reinstall astropy-iers-data")
    if warning:
        return Check("earth", CheckOutcome.WARN, *warning.rsplit("; ", 1))
    here = orientation.at(end_ns)
    return Check(
        "earth", CheckOutcome.OK, f"{orientation.source}: UT1 {here.kind}, known to {here.ut1_error_s * 1e3:.2g} ms"
    )


def _catalog(station: Station) -> Check:
    try:
        catalog = load_catalog(station.catalog)
    except GseError as error:
        return Check("catalogue", CheckOutcome.FAIL, str(error), "correct 'catalog' in the station file")
    wanted = station.identifier.catalog_stars
    count = stars_for_field(station.sensor.camera()) if wanted == "auto" else wanted
    text = f"{len(catalog)} stars from {catalog.source}, {count} of them in use"
    if count > len(catalog):
        return Check("catalogue", CheckOutcome.FAIL, text, "this field needs a deeper catalogue: 'catalog: gaia'")
    return Check("catalogue", CheckOutcome.OK, text)


def _viewer() -> Check:
    try:
        return Check("viewer", CheckOutcome.OK, f"rerun is there: {rerun_program()}")
    except GseError as error:
        return Check("viewer", CheckOutcome.WARN, str(error), "only the live view needs it: gse run --view none works")
