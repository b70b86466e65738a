"""Whether the stated uncertainties of align, calibrate and compare hold, against simulated truth.

    python benchmarks/fits.py [--skies 24] [--seconds 300] [--rate-hz 2]

Each sky has a mount and an hour of its own, so that its stars are its own. Chi-square of the fitted mount and of the
fitted camera against the true ones, and compare's figures between pairs of these sessions of the same sensor, by
the functions that the commands call. Prints Markdown tables.
"""

import argparse
import itertools
import tempfile
from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.stats import chi2

from drivers.mock.urls import sim_url
from gse.assessment.session_comparison import session_comparison
from gse.calibration.camera_fit import calibrate
from gse.calibration.session_fit import PanoramaSample, star_fields
from gse.config.edit import with_values
from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.constants import ARCSEC_PER_RAD
from gse.instant import NS_PER_S, from_text, to_text
from gse.sessions.panoramas import open_recording
from gse.sessions.replay import ReplayOptions, replay_session
from gse.simulator.recording import record_simulation
from gse.station.mount_alignment import MeasuredMounts, cross_validated
from gse.station.setup import set_up
from gse.truth import EarthOrientation, SiderealTruth, horizon_to_sensor, small_rotations

FIRST_NS = from_text("2026-01-05T13:00:00Z")
NEIGHBOURS = 5
"""Each session is compared with so many after it."""
WEEK_NS = 7 * 86_400 * NS_PER_S
DISTANT = {"principal_point_px": (561.0, 470.0), "radial_distortion": (0.05, -0.02)}
"""An anchor so far off that nothing is held: all five parameters are fitted."""


def record(path: Path, number: int, seconds: float, rate_hz: float) -> None:
    """One session under a sky of its own."""
    rng = np.random.default_rng(number)
    altitude_deg = float(np.degrees(np.arcsin(rng.uniform(np.sin(np.radians(40)), 1))))
    mount = {
        "azimuth_deg": float(rng.uniform(0, 360)),
        "altitude_deg": altitude_deg,
        "roll_deg": float(rng.uniform(0, 360)),
    }
    text = with_values(BUILT_IN_TEXT, "mount", {name: round(value, 3) for name, value in mount.items()})
    start_ns = FIRST_NS + number % 26 * WEEK_NS + int(rng.integers(0, 5 * 3600)) * NS_PER_S
    frames = str(round(seconds * rate_hz))
    url = sim_url(start=to_text(start_ns), rate_hz=str(rate_hz), seed=str(number), frames=frames)
    station = parse_station(text)
    station = station.model_copy(update={"port": station.port.model_copy(update={"url": url})})
    record_simulation(path, station, text, EarthOrientation.from_disk(start_ns).to_json())


def mount_error(measured, session):
    """Errors (3,) of the fitted mount in arcsec, and their covariance."""
    alignment = cross_validated(measured, session).alignment
    true = horizon_to_sensor(session.station.mount)
    error = small_rotations(horizon_to_sensor(alignment.mount)[None], true)[0] * ARCSEC_PER_RAD
    return error, np.array(alignment.covariance_arcsec2)


def camera_error(path):
    """Errors (5,) of the fitted camera, and their covariance."""
    recording, sample = open_recording(path, ReplayOptions()), PanoramaSample()
    for panorama in recording.panoramas():
        sample.add(panorama)
    setup = set_up(recording.station, recording.station_text, utc_ns=sample.panoramas[0].utc_ns)
    truth = SiderealTruth(recording.station.site, recording.earth_orientation)
    fitted = calibrate(
        setup.camera,
        star_fields(sample, setup.camera, setup.of_true_stars, truth),
        anchor=replace(setup.camera, **DISTANT),
    )
    values = [
        np.array([camera.focal_length_px, *camera.principal_point_px, *camera.radial_distortion])
        for camera in (fitted.camera, setup.camera)
    ]
    return values[0] - values[1], fitted.covariance


def chi_square_rows(name, labels, found):
    """A row for all parameters together, and one for each."""
    errors, covariances = (np.array(part) for part in zip(*found, strict=True))
    joint = np.einsum("ni,nij,nj->", errors, np.linalg.inv(covariances), errors)
    yield f"{name}, together", joint, errors.size
    for place, label in enumerate(labels):
        yield f"{name}, {label}", (errors[:, place] ** 2 / covariances[:, place, place]).sum(), len(errors)


def main() -> None:
    """Make the sessions, fit, compare, print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--skies", type=int, default=24)
    parser.add_argument("--seconds", type=float, default=300.0)
    parser.add_argument("--rate-hz", type=float, default=2.0)
    given = parser.parse_args()
    mounts, cameras, sessions = [], [], []
    with tempfile.TemporaryDirectory() as folder:
        for number in range(given.skies):
            path = Path(folder) / f"{number}.mcap"
            record(path, number, given.seconds, given.rate_hz)
            measured = MeasuredMounts()
            replay = replay_session(path, make_listeners=lambda loop, folder, one=measured: [one])
            mounts.append(mount_error(measured, replay.session))
            cameras.append(camera_error(path))
            sessions.append(replay.session)
    print("| fit | chi-square | of | 95 % band | inside |\n|---|---|---|---|---|")
    rows = [
        *chi_square_rows("align", ("across 1", "across 2", "roll"), mounts),
        *chi_square_rows("calibrate", ("f", "x0", "y0", "k1", "k2"), cameras),
    ]
    for name, value, freedom in rows:
        low, high = chi2.ppf([0.025, 0.975], freedom)
        inside = "yes" if low <= value <= high else "NO"
        print(f"| {name} | {value:.1f} | {freedom} | {low:.0f} to {high:.0f} | {inside} |")
    print("\n| compare | pairs | rms z | beyond 3 sigma | called worse |\n|---|---|---|---|---|")
    compared = defaultdict(list)
    pairs = [(one, two) for one, two in itertools.combinations(range(len(sessions)), 2) if two - one <= NEIGHBOURS]
    for pair in ([sessions[number] for number in numbers] for numbers in pairs):
        for row in session_comparison(*pair, bias_is_regression=True).rows:
            compared[row.name].append((row.sigmas, row.worse))
    for name, values in compared.items():
        sigmas = np.array([sigma for sigma, _ in values])
        rms = np.sqrt((sigmas**2).mean())
        worse = sum(worse for _, worse in values)
        print(f"| {name} | {len(values)} | {rms:.2f} | {(np.abs(sigmas) > 3).mean():.1%} | {worse / len(values):.1%} |")


if __name__ == "__main__":
    main()
