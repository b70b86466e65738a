"""Whether the stated uncertainties of align, calibrate and compare hold, against simulated truth.

    python benchmarks/fits.py [--skies 24] [--first 0] [--seconds 300] [--rate-hz 2] [--only-compare]

Each sky has a mount and an hour of its own, so that its stars are its own. Chi-square of the fitted mount and of the
fitted camera against the true ones, and compare's figures between all pairs of these sessions of the same sensor, by
the functions that the commands call. The standard error of a root mean square z is that over skies (jackknife), as
the pairs of one sky depend on each other. Prints Markdown tables.
"""

import argparse
import itertools
import tempfile
from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.stats import chi2

from drivers.mock_ports import sim_url
from gse.config.choice import with_values
from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.imaging.camera_fit import calibrate
from gse.imaging.session_fit import PanoramaSample, star_fields
from gse.sessions.replay import ReplayOptions, open_recording, replay_session
from gse.simulator.recording import record_simulation
from gse.station.mount_alignment import MeasuredMounts, cross_validated
from gse.station.setup import set_up
from gse.truth import EarthOrientation, SiderealTruth, horizon_to_sensor, small_rotations
from gse.values.axis import ON_SKY
from gse.values.constants import ARCSEC_PER_RAD
from gse.values.instant import NS_PER_S, from_text, to_text
from gse.verdict.compared_rows import ComparedAxis, ComparedSession, axis_rows

FIRST_NS = from_text("2026-01-05T13:00:00Z")
SIGMAS = 3.0
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


def compared(session):
    """Both axes of a session, for compare."""
    table = ComparedSession.from_session(session).table
    return {axis.label: ComparedAxis.from_subject(table, axis) for axis in ON_SKY}


def compare_rows(skies):
    """Each figure with z (S, S) between all pairs of skies; NaN beside itself."""
    found = defaultdict(lambda: np.full((len(skies), len(skies)), np.nan))
    for one, two in itertools.permutations(range(len(skies)), 2):
        for label in skies[one]:
            pair = skies[one][label], skies[two][label]
            for row in axis_rows(label, *pair, paired=None, allowed=0.0, growth=pair[0].growth(pair[1])):
                found[row.name][one, two] = row.sigmas
    for figure in ("mean", "NEA", "bias"):
        of_axes = [values for name, values in found.items() if name.startswith(figure)]
        yield from ((name, [values]) for name, values in found.items() if name.startswith(figure))
        yield f"{figure}, both", of_axes


def rms_and_error(of_axes):
    """The root mean square of z (A, S, S), and its standard error by leaving out one sky at a time."""
    values = np.array(of_axes)
    skies = values.shape[1]
    every = np.sqrt(np.nanmean(values**2))
    without = [np.delete(np.delete(values, sky, 1), sky, 2) for sky in range(skies)]
    left = np.array([np.sqrt(np.nanmean(part**2)) for part in without])
    return every, np.sqrt((skies - 1) / skies * ((left - left.mean()) ** 2).sum())


def main() -> None:
    """Make the sessions, fit, compare, print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--skies", type=int, default=24)
    parser.add_argument("--first", type=int, default=0, help="number of the first sky")
    parser.add_argument("--seconds", type=float, default=300.0)
    parser.add_argument("--rate-hz", type=float, default=2.0)
    parser.add_argument("--only-compare", action="store_true")
    given = parser.parse_args()
    mounts, cameras, skies = [], [], []
    with tempfile.TemporaryDirectory() as folder:
        for number in range(given.first, given.first + given.skies):
            path = Path(folder) / f"{number}.mcap"
            record(path, number, given.seconds, given.rate_hz)
            measured = MeasuredMounts()
            replay = replay_session(path, make_listeners=lambda loop, one=measured: [one])
            skies.append(compared(replay.session))
            if not given.only_compare:
                mounts.append(mount_error(measured, replay.session))
                cameras.append(camera_error(path))
            path.unlink()
    if not given.only_compare:
        print_fits(mounts, cameras)
    print("| compare | pairs | rms z | beyond 3 sigma |\n|---|---|---|---|")
    for name, values in compare_rows(skies):
        rms, error = rms_and_error(values)
        z, figure = np.abs(np.array(values)), name.replace("|", "")
        beyond = (z > SIGMAS).sum() / np.isfinite(z).sum()
        print(f"| {figure} | {np.isfinite(z).sum() // 2} | {rms:.2f} +- {error:.2f} | {beyond:.1%} |")


def print_fits(mounts, cameras) -> None:
    """Chi-square of the fits."""
    print("| fit | chi-square | of | 95 % band | inside |\n|---|---|---|---|---|")
    rows = [
        *chi_square_rows("align", ("across 1", "across 2", "roll"), mounts),
        *chi_square_rows("calibrate", ("f", "x0", "y0", "k1", "k2"), cameras),
    ]
    for name, value, freedom in rows:
        low, high = chi2.ppf([0.025, 0.975], freedom)
        inside = "yes" if low <= value <= high else "NO"
        print(f"| {name} | {value:.1f} | {freedom} | {low:.0f} to {high:.0f} | {inside} |")
    print()


if __name__ == "__main__":
    main()
