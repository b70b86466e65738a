"""Check of an external identifier before a session: it is shown the belt of Orion, as the sensor would see it."""

import math
from dataclasses import replace

import numpy as np

from gse.attitude import Attitude
from gse.catalog.readers import load_catalog
from gse.config.station import Station
from gse.errors import GseError
from gse.external.answers import Failure
from gse.external.identifier import Given, RunningIdentifier
from gse.external.plugs import plug_of
from gse.inspection.check import Check, Outcome
from gse.matrices import product
from gse.panorama import Panorama
from gse.station.setup import ORION_RA_DE_DEG, example_places, sensor_description
from protocols import load_protocol

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
        return Check(_NAME, Outcome.FAIL, str(error), "correct 'identifier' in the station file")
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
        return Check(_NAME, Outcome.FAIL, f"{name}: {answer.kind}: {answer.detail}", _ADVICE)
    if answer.attitude is None:
        said = f"{answer.status} {answer.detail}".strip()
        return Check(_NAME, Outcome.WARN, f"{name}: no answer to the belt of Orion: {said}", _ADVICE)
    boresight = Attitude.from_angles(*ORION_RA_DE_DEG, 0.0).boresight_icrs
    cosine = float(np.clip(product(boresight, answer.attitude.boresight_icrs), -1, 1))
    off_deg = math.degrees(math.acos(cosine))
    if off_deg > _NEAR_DEG:
        text = f"{name}: {off_deg:.1f} deg off in the belt of Orion (RA 83, DE 0 deg)"
        return Check(_NAME, Outcome.WARN, text, f"look at its conventions: {_CONVENTIONS}")
    time = "" if given.elapsed_us is None else f" in {given.elapsed_us / 1000:.2g} ms"
    return Check(_NAME, Outcome.OK, f"{name}: finds the belt of Orion{time}")
