"""A session whose mount is fitted on its first seconds (``align: first 20 s``)."""

import numpy as np
import pytest
from skies.astropy_night import ALTITUDE_DEG, AZIMUTH_DEG, ROLL_DEG, START_NS, STATION_TEXT, AstropyNight

from gse.catalog import load_catalog
from gse.config.station import parse_station
from gse.identifier import make_identifier
from gse.station.loop import StationLoop
from gse.station.setup import Setup
from gse.values.instant import NS_PER_S
from gse.values.mount import Mount
from protocols import load_protocol

NOISE_PX = 0.1


@pytest.fixture(scope="module")
def session():
    """40 s at 1 Hz; the station file says nothing of the direction of the mount."""
    station = parse_station(STATION_TEXT)
    camera = station.sensor.camera()
    identifier = make_identifier(station.identifier, camera, load_catalog())
    station = station.model_copy(update={"mount": Mount(align="first 20 s")})
    loop = StationLoop(Setup(station, STATION_TEXT, load_protocol(station.protocol), camera, identifier, None))
    night = AstropyNight(identifier.catalog.icrs)
    for panorama in night.panoramas(START_NS + np.arange(40) * NS_PER_S, noise_px=NOISE_PX):
        loop.observe(panorama)
    return loop.session


def test_the_fitted_mount_is_the_true_one(session):
    mount = session.alignment.mount
    assert mount.azimuth_deg == pytest.approx(AZIMUTH_DEG, abs=3 / 3600)
    assert mount.altitude_deg == pytest.approx(ALTITUDE_DEG, abs=2 / 3600)
    assert mount.roll_deg == pytest.approx(ROLL_DEG, abs=30 / 3600)
    assert session.alignment.n + session.alignment.rejected == 20


def test_frames_of_the_first_seconds_are_not_compared_and_later_ones_are_with_the_fitted_mount(session):
    for axis, largest_arcsec in (("d_ra_cosde_arcsec", 10), ("d_de_arcsec", 10), ("d_roll_arcsec", 60)):
        error = session.frames.columns[axis]
        assert np.isnan(error[:20]).all()
        assert np.abs(error[20:]).max() < largest_arcsec


def test_the_alignment_is_an_event_at_the_first_frame_after_it(session):
    (event,) = (event for event in session.events if event.kind == "ALIGNED")
    assert (event.utc_ns, event.mono_ns) == (START_NS + 20 * NS_PER_S, 0)
    assert event.text == str(session.alignment)
