"""The proof: a night built from astropy alone, every effect switched on, goes through the station."""

import dataclasses
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from skies.astropy_night import FOCAL_LENGTH_PX, START_NS, STATION_TEXT, AstropyNight

from drivers.chunk import Chunk
from drivers.clock import ClockReading
from gse.catalog import load_catalog
from gse.config.station import parse_station
from gse.identifier import make_identifier
from gse.station.loop import StationLoop
from gse.station.results import Verdict
from gse.station.setup import Setup
from gse.statistics.session_statistics import statistics
from gse.truth import SiderealTruth
from gse.values.attitude import solve_attitude
from gse.values.instant import NS_PER_S
from gse.verdict.assessment import judge
from protocols import PanoramaMessage, load_protocol

ARCSEC = math.pi / 180 / 3600
NOISE_PX = 0.1
POINTINGS = START_NS + np.arange(30) * 960 * NS_PER_S
"""Eight hours of night, in which the sky turns by 120 deg over the camera."""


@pytest.fixture(scope="module")
def setup():
    """Without a judge: what is right or wrong is known here."""
    station = parse_station(STATION_TEXT)
    camera = station.sensor.camera()
    identifier = make_identifier(station.identifier, camera, load_catalog())
    return Setup(station, STATION_TEXT, load_protocol(station.protocol), camera, identifier, None)


@pytest.fixture(scope="module")
def astropy_night(setup):
    return AstropyNight(setup.identifier.catalog.icrs)


@pytest.fixture(scope="module")
def noisy_night(astropy_night):
    """Two panoramas of each pointing."""
    return list(burst(astropy_night, count=2, noise_px=NOISE_PX))


@pytest.fixture(scope="module")
def exact_panoramas(astropy_night):
    """Two panoramas of some pointings, without noise."""
    return list(burst(astropy_night, count=2, pointings=POINTINGS[5::9]))


@pytest.fixture(scope="module")
def with_whole_truth(setup, exact_panoramas):
    """The results of these."""
    return watched(setup, exact_panoramas).frames.columns.rows()


def watched(setup: Setup, panoramas, *, omit=frozenset(), mount=None):
    """The night that the station makes of panoramas; ``omit`` leaves corrections out of its truth."""
    station = setup.station
    if mount is not None:
        station = station.model_copy(update={"mount": replace(station.mount, **mount)})
    loop = StationLoop(dataclasses.replace(setup, station=station))
    loop.session.clock = [ClockReading(START_NS, 0, "kernel PLL", True, 0.0, 1e-4)]
    for panorama in panoramas:
        if omit and loop.session.earth_orientation is not None:
            truth = SiderealTruth(station.site, loop.session.earth_orientation, omit)
            loop._frame_processor = dataclasses.replace(loop._frame_processor, truth=truth)
        loop.observe(panorama)
    return loop.session


def burst(astropy_night, *, count, step_s=0.2, pointings=POINTINGS, **options):
    for number, begin_ns in enumerate(pointings.tolist()):
        instants = begin_ns + np.arange(count) * round(step_s * NS_PER_S)
        yield from astropy_night.panoramas(instants, seed=number, **options)


def test_mean_errors_vanish_and_the_noise_is_that_which_was_put_in(setup, astropy_night):
    figures = statistics(watched(setup, burst(astropy_night, count=60, noise_px=NOISE_PX)))
    axes = figures.onboard.axes
    assert figures.onboard.available.value == 1.0
    assert abs(axes["d_ra_cosde"].bias_arcsec) < 0.1
    assert abs(axes["d_de"].bias_arcsec) < 0.1
    assert abs(axes["d_roll"].bias_arcsec) < 1.0
    expected = expected_noise_arcsec(setup, astropy_night)
    for axis, noise in zip(("cross_x", "cross_y"), expected, strict=True):
        assert axes[axis].nea_arcsec == pytest.approx(noise, rel=0.03)
        assert axes[axis].nea_successive_arcsec == pytest.approx(noise, rel=0.04)


def expected_noise_arcsec(setup, astropy_night):
    """Scatter of the boresight along x and y that the injected noise makes: the Cramer-Rao bound of each pointing."""
    camera, variances = setup.camera, []
    for panorama in burst(astropy_night, count=1):
        directions = camera.directions(panorama.xy_px)
        covariance = solve_attitude(directions, directions, NOISE_PX / FOCAL_LENGTH_PX).covariance_rad2
        variances.append([covariance[1, 1], covariance[0, 0]])
    return np.sqrt(np.mean(variances, axis=0)) / ARCSEC


@pytest.mark.parametrize(
    ("name", "least_arcsec", "most_arcsec"),
    [
        ("precession", 300, 1400),
        ("nutation", 1, 20),
        ("UT1", 0.01, 13.5),
        ("polar motion", 0.05, 0.6),
        ("geodetic latitude", 140, 157),
        ("annual aberration", 0.6, 20.6),
        ("diurnal aberration", 0.15, 0.33),
        ("light deflection", 5e-4, 0.1),
        ("refraction", 29, 34),
    ],
)
def test_each_effect_left_out_of_the_truth_shows_its_own_size(
    setup, exact_panoramas, with_whole_truth, name, least_arcsec, most_arcsec
):
    without = watched(setup, exact_panoramas, omit={name}).frames.columns.rows()
    assert np.abs(with_whole_truth["d_ra_cosde_arcsec"]).max() < 0.02
    assert np.abs(with_whole_truth["d_de_arcsec"]).max() < 0.02
    left = without[1::2]  # the first of each loop still had its whole truth
    sizes = np.hypot(left["d_ra_cosde_arcsec"], left["d_de_arcsec"])
    assert least_arcsec < sizes.max() < most_arcsec


def test_a_perfect_night_passes_and_looks_like_nothing(setup, astropy_night):
    assessment = judge(watched(setup, burst(astropy_night, count=12, noise_px=NOISE_PX)))
    assert assessment.verdict is Verdict.PASS, assessment.reasons
    assert assessment.findings == ()


def looks_like(setup, panoramas, **options):
    return "\n".join(map(str, judge(watched(setup, panoramas, **options)).findings))


def test_a_mount_error_is_named(setup, noisy_night):
    text = looks_like(setup, noisy_night, mount={"altitude_deg": 60.02})
    assert text.startswith("mount: it is off by -72.")


def test_a_clock_that_is_slow_is_named_with_its_offset(setup, noisy_night):
    panoramas = (dataclasses.replace(panorama, utc_ns=panorama.utc_ns - 3 * NS_PER_S) for panorama in noisy_night)
    text = looks_like(setup, panoramas)
    found = re.search(r"clock offset: the host's clock is (\d+\.\d+) s slow", text)
    assert found is not None
    assert float(found[1]) == pytest.approx(3.0, abs=0.05)


def test_a_drifting_clock_is_named_with_its_rate(setup, noisy_night):
    """Stamps of the host run away from the sensor's time tags as fast."""
    fast = {panorama.utc_ns: START_NS + round((panorama.utc_ns - START_NS) * (1 + 50e-6)) for panorama in noisy_night}
    as_stamped = (
        dataclasses.replace(panorama, utc_ns=fast[panorama.utc_ns], host_utc_ns=fast[panorama.utc_ns])
        for panorama in noisy_night
    )
    text = looks_like(setup, as_stamped)
    found = re.search(r"clock drift: the host's clock runs (\d+) ppm fast", text)
    assert found is not None
    assert int(found[1]) == pytest.approx(50, abs=4)


def test_a_wrong_focal_length_is_named(setup, astropy_night):
    panoramas = burst(astropy_night, count=2, noise_px=NOISE_PX, focal_length_px=FOCAL_LENGTH_PX * 1.0005)
    found = re.search(r"focal length: it is ([\d.]+) % too short", looks_like(setup, panoramas))
    assert float(found[1]) == pytest.approx(0.05, rel=0.03)


def test_distortion_is_named(setup, astropy_night):
    text = looks_like(setup, burst(astropy_night, count=2, noise_px=NOISE_PX, k1=0.002))
    assert "distortion: stars at the edge lie" in text


def test_a_mirrored_image_is_named(setup, astropy_night):
    text = looks_like(setup, burst(astropy_night, count=1, pointings=POINTINGS[:5], mirrored=True))
    assert "mirrored image: the image is mirrored" in text


def test_a_clock_step_is_named_and_its_frames_are_left_out(setup, astropy_night):
    loop = StationLoop(setup)
    mono_ns = 10**12
    instants = POINTINGS[0] + np.arange(400) * NS_PER_S // 10
    for number, panorama in enumerate(astropy_night.panoramas(instants)):
        message = PanoramaMessage(
            time_us=1_000_000 + number * 100_000,
            frame_no=number,
            exposure_s=0.1,
            flags=frozenset(),
            temperature_c=20.0,
            xy_px=np.rint(panorama.xy_px),
            index=np.rint(panorama.brightness),
        )
        step_ns = 2 * NS_PER_S if number >= 200 else 0
        data = setup.protocol.encode(message, sequence=number)
        arrived_ns = panorama.utc_ns + 60_000_000
        loop.take([Chunk(arrived_ns + step_ns, mono_ns + arrived_ns - int(instants[0]), data)])
    loop.finish()
    assessment = judge(loop.session)
    assert any("clock step" in found and "+2.000 s" in found for found in map(str, assessment.findings))
    ((item, count),) = assessment.statistics.exclusions
    assert "stepped" in item.reason
    assert 90 <= count <= 130
