"""What the frames of a cell can tell at best: the Bayesian answer of one who knows all but the attitude.

    python benchmarks/information_limit.py [--frames 2000] [--cell A:worst] [--every 1]

Its search is exhaustive: every pair among the brightest objects, as many as hold two stars for certain, against every
catalogue pair of that distance within five sigma of place and four of brightness. Each attitude is refined, and its
likelihood is that of the frame as it was made: the sum over all ways in which objects are stars, integrated over the
attitude by Laplace's approximation. The posterior of an answer is its share of all attitudes found. Of two kinds:

* *all known*: noise, zero point, share of missing stars, density of false objects, how many objects are stars, and
  that the sky is there at all;
* *sensor known*: the same, but any number of objects may be stars, none as likely as an attitude at all. With a
  posterior above 0.999 it errs as rarely as ``robust``.

``robust`` answers the same frames, with what a station file says of a camera, and where it knows noise and zero point.
"""

import argparse
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from identifiers import CONDITIONS, FEWEST_REAL_STARS, OPTICS, frames_of, judged, robust_for, solver_of
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.special import ndtr

from gse.catalog import StarCatalog, load_catalog, merge_doubles
from gse.evaluation.frames import Conditions, Optics, SimulatedFrame
from gse.identifier.hypotheses import _attempt_with, axis, pair_rotation, stars_near
from gse.identifier.robust import KnownSensor, _field
from gse.identifier.robust_tables import SkyTables, sky_tables
from gse.identifier.verify import Attempt, Noise, Objects, grow, objects_of, place
from gse.process.jit import compiled
from gse.values.camera import Camera
from gse.values.constants import ARCSEC_RAD

FALSE_MAGNITUDES = 4.0
SIGMAS_OF_PLACE, SIGMAS_OF_BRIGHTNESS = 5.0, 4.0
_FAINTEST_SIGMAS = 3.0
"""A star fainter than the limit by more is seen with a probability of 1 in 1,000."""
MODES = 200
SAME_COS = math.cos(math.radians(0.3))
LEVELS = (0.0, 0.9, 0.99, 0.999)


@dataclass(frozen=True, slots=True)
class Sky:
    """The catalogue as the frames are made of it, its pairs by distance, and what is known of the sensor."""

    tables: SkyTables
    distance: NDArray[np.float64]
    pairs: NDArray[np.int32]
    log_dark: NDArray[np.float64]
    """Logarithm of the probability that a star of the field is not seen."""
    known: NDArray[np.float64]
    """Noise of a place and of a magnitude, share of stars that are seen, density of false objects."""


def sky_of(optics: Optics, conditions: Conditions, source: StarCatalog) -> Sky:
    """All stars that errors of brightness can bring into view."""
    camera = optics.camera
    limit, sigma_magnitude = optics.magnitude_limit, conditions.magnitude
    catalog = source.rows(np.flatnonzero(source.magnitude < limit + _FAINTEST_SIGMAS * sigma_magnitude))
    catalog = merge_doubles(catalog, conditions.merge_px * camera.pixel_rad)
    field = _field(camera, optics.field_of_view_deg)
    tables = sky_tables(catalog.icrs, catalog.magnitude, field)
    widest = 2 * math.sin(optics.radius_rad())
    pairs = cKDTree(catalog.icrs).query_pairs(widest, output_type="ndarray").astype(np.int32)
    chord = np.linalg.norm(catalog.icrs[pairs[:, 0]] - catalog.icrs[pairs[:, 1]], axis=1)
    order = np.argsort(chord)
    seen = (1.0 - conditions.missing_share) * ndtr((limit - catalog.magnitude) / sigma_magnitude)
    known = np.array(
        [
            _sigma_rad(camera, conditions),
            sigma_magnitude,
            1.0 - conditions.missing_share,
            1.0 / (float(field[5]) * FALSE_MAGNITUDES),
        ]
    )
    return Sky(tables, 2 * np.arcsin(chord[order] / 2), pairs[order], np.log1p(-seen), known)


def _sigma_rad(camera: Camera, conditions: Conditions) -> float:
    """Noise of a place with the rounding to whole pixels."""
    return math.hypot(
        conditions.position_arcsec * ARCSEC_RAD, conditions.whole_pixels * camera.pixel_rad / math.sqrt(12)
    )


@compiled
def explored(
    tables: tuple[Any, ...],
    distance: NDArray[np.float64],
    pairs: NDArray[np.int32],
    log_dark: NDArray[np.float64],
    known: NDArray[np.float64],
    directions: NDArray[np.float64],
    brightness: NDArray[np.float64],
    magnitude: NDArray[np.float64],
    stars_seen: int,
    log_mass: NDArray[np.float64],
    rotations: NDArray[np.float64],
) -> int:
    """Fill ``log_mass`` (M,) and ``rotations`` (M, 3, 3) with the attitudes found; how many."""
    sky = SkyTables(*tables)
    objects = objects_of(directions, brightness)
    n = len(directions)
    noise = Noise(known[0], known[0], 1, 2e-4, np.nan, known[1])
    window, fainter = SIGMAS_OF_PLACE * math.sqrt(2.0) * known[0], SIGMAS_OF_BRIGHTNESS * known[1]
    rotation, pair = np.empty((3, 3)), np.full(n, -1)
    found = 0
    searched = n - stars_seen + 2
    for i in range(min(n, searched)):
        for j in range(i + 1, min(n, searched)):
            chord = math.sqrt(((directions[i] - directions[j]) ** 2).sum())
            angle = 2.0 * math.asin(min(1.0, chord / 2))
            if angle < 4.0 * window:
                continue
            low, high = np.searchsorted(distance, angle - window), np.searchsorted(distance, angle + window)
            for p in range(low, high):
                for turn in range(2):
                    s, t = pairs[p, turn], pairs[p, 1 - turn]
                    if abs(sky.magnitude[s] - magnitude[i]) > fainter or abs(sky.magnitude[t] - magnitude[j]) > fainter:
                        continue
                    pair_rotation(directions[i], directions[j], sky.icrs[s], sky.icrs[t], rotation)
                    axes = axis(rotation, 0), axis(rotation, 1), axis(rotation, 2)
                    if stars_near(sky.near_star, directions, axes) < min(4, stars_seen):
                        continue
                    pair[i], pair[j] = s, t
                    attempt, started = _attempt_with(sky, rotation.copy(), pair)
                    pair[i] = pair[j] = -1
                    if started < 2 or grow(sky, objects, attempt, noise) < 3:
                        continue
                    value = _log_mass(sky, objects, attempt, magnitude, log_dark, known, stars_seen)
                    found = _kept(attempt.rotation, value, found, log_mass, rotations)
    return found


@compiled
def _log_mass(
    sky: SkyTables,
    objects: Objects,
    attempt: Attempt,
    magnitude: NDArray[np.float64],
    log_dark: NDArray[np.float64],
    known: NDArray[np.float64],
    stars_seen: int,
) -> tuple[float, float]:
    """Logarithms of likelihood times volume of an attitude, against all objects false: so many stars, any number."""
    n = len(magnitude)
    sigma, sigma_magnitude, share, density = known[0], known[1], known[2], known[3]
    ways = np.zeros(n + 1)
    ways[0] = 1.0
    weight, total = np.zeros(n), 0.0
    for f in range(len(attempt.rows)):
        row = attempt.rows[f]
        total += log_dark[row]
        u, v = place(sky, attempt, f)
        for i in range(n):
            off = ((objects.uv[i, 0] - u) ** 2 + (objects.uv[i, 1] - v) ** 2) / (sigma * sigma)
            if off > 36.0:
                continue
            error = (magnitude[i] - sky.magnitude[row]) / sigma_magnitude
            likelihood = share * math.exp(-0.5 * (off + error * error)) / (2.0 * math.pi * sigma * sigma)
            likelihood /= math.sqrt(2.0 * math.pi) * sigma_magnitude * math.exp(log_dark[row])
            weight[i] += likelihood / density
    for i in range(n):  # sums of all products of so many weights
        for k in range(n, 0, -1):
            ways[k] += ways[k - 1] * weight[i]
    c = attempt.covariance
    determinant = (
        c[0, 0] * (c[1, 1] * c[2, 2] - c[1, 2] * c[2, 1])
        - c[0, 1] * (c[1, 0] * c[2, 2] - c[1, 2] * c[2, 0])
        + c[0, 2] * (c[1, 0] * c[2, 1] - c[1, 1] * c[2, 0])
    )
    volume = total + 0.5 * math.log(max(determinant, 1e-300)) - 0.5 * math.log(8.0 * math.pi)
    any_number, share_of = 0.0, 1.0
    for k in range(n + 1):  # k stars: which objects are false is one of (n - k)! orders of n!
        any_number += share_of * ways[k]
        share_of /= max(n - k, 1)
    return volume + math.log(max(ways[stars_seen], 1e-300)), volume + math.log(any_number)


@compiled
def _kept(
    rotation: NDArray[np.float64],
    value: tuple[float, float],
    found: int,
    log_mass: NDArray[np.float64],
    rotations: NDArray[np.float64],
) -> int:
    """Keep an attitude, once, where it is among the likeliest; how many are kept."""
    place_of = -1
    for m in range(found):
        trace = 0.0
        for j in range(3):
            for k in range(3):
                trace += rotation[j, k] * rotations[m, j, k]
        if 0.5 * (trace - 1.0) > SAME_COS:
            if value[0] <= log_mass[m, 0]:
                return found
            place_of = m
            break
    if place_of < 0 and found < len(log_mass):
        place_of, found = found, found + 1
    if place_of < 0:
        place_of = int(np.argmin(log_mass[:, 0]))
        if value[0] <= log_mass[place_of, 0]:
            return found
    log_mass[place_of, 0], log_mass[place_of, 1] = value
    rotations[place_of] = rotation
    return found


Answer = tuple[str, float]
"""Right, coarse or false, and the posterior."""


def answers(sky: Sky, optics: Optics, frame: SimulatedFrame) -> tuple[Answer, Answer]:
    """The likeliest attitudes where all is known, and where the number of stars is not."""
    magnitude = _zero_point(optics) - 2.5 * np.log10(frame.brightness)
    log_mass, rotations = np.full((MODES, 2), -np.inf), np.zeros((MODES, 3, 3))
    found = explored(
        tuple(sky.tables),
        sky.distance,
        sky.pairs,
        sky.log_dark,
        sky.known,
        np.ascontiguousarray(frame.directions_sensor),
        frame.brightness,
        magnitude,
        frame.real_stars,
        log_mass,
        rotations,
    )
    if found == 0:
        return ("none", 0.0), ("none", 0.0)
    return _likeliest(log_mass[:found, 0], -np.inf, rotations, frame), _likeliest(
        log_mass[:found, 1], 0.0, rotations, frame
    )


def _likeliest(
    log_mass: NDArray[np.float64], log_none: float, rotations: NDArray[np.float64], frame: SimulatedFrame
) -> Answer:
    first = int(np.argmax(log_mass))
    posterior = math.exp(log_mass[first] - np.logaddexp(np.logaddexp.reduce(log_mass), log_none))
    return judged(rotations[first, 2], frame), posterior


def main() -> None:
    """Print what the limits and ``robust`` make of the frames."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=2000)
    parser.add_argument("--every", type=int, default=1, help="take one of so many frames")
    parser.add_argument("--cell", default="A:worst")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    name, condition = arguments.cell.split(":")
    optics, conditions, source = OPTICS[name], CONDITIONS[condition], load_catalog()
    frames = frames_of(optics, conditions, source, arguments.frames, arguments.seed)[:: arguments.every]
    frames = [frame for frame in frames if frame.real_stars >= FEWEST_REAL_STARS]
    sky = sky_of(optics, conditions, source)
    sigma_px = float(sky.known[0]) / optics.camera.pixel_rad
    known = KnownSensor(sigma_px, _zero_point(optics), magnitude_sigma=conditions.magnitude)
    solvers = solver_of(robust_for(optics, source)), solver_of(robust_for(optics, source, known=known))
    limits: list[tuple[Answer, Answer]] = []
    robust: tuple[list[str], list[str]] = ([], [])
    for frame in frames:
        limits.append(answers(sky, optics, frame))
        for (solve, boresight_of), words in zip(solvers, robust, strict=True):
            boresight = boresight_of(solve(frame), frame)
            words.append("none" if boresight is None else judged(boresight, frame))
        if len(limits) % 50 == 0:
            _print(limits, *robust)
    _print(limits, *robust)


def _zero_point(optics: Optics) -> float:
    """Magnitude of index value 1 in the frames."""
    return optics.magnitude_limit - 7.5 + 2.5 * math.log10(4096)


def _print(limits: list[tuple[Answer, Answer]], robust: list[str], knowing: list[str]) -> None:
    print(f"\n{len(limits)} frames with at least {FEWEST_REAL_STARS} stars")
    print("| answer | right % | coarse % | false % | right, robust that knows as much not | the other way round |")
    print("|---|---|---|---|---|---|")
    for column, word in enumerate(("all known", "sensor known")):
        for level in LEVELS:
            given = [one[column][0] if one[column][1] > level else "none" for one in limits]
            only = f"{_only(given, knowing)} | {_only(knowing, given)}"
            print(f"| {word}, posterior > {level:g} | {_shares(given)} | {only} |")
    print(f"| robust, noise and zero point known | {_shares(knowing)} | | |")
    print(f"| robust | {_shares(robust)} | | |", flush=True)


def _shares(given: list[str]) -> str:
    return " | ".join(f"{100 * given.count(word) / len(given):.2f}" for word in ("right", "coarse", "false"))


def _only(given: list[str], others: list[str]) -> int:
    return sum(one == "right" != other for one, other in zip(given, others, strict=True))


if __name__ == "__main__":
    main()
