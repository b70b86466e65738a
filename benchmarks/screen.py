"""What a screen as sky is good for: its fit, its stars in a real browser, and its speed.

    python benchmarks/screen.py fit [--draws 40]
    python benchmarks/screen.py scenes [--scenes 300]
    python benchmarks/screen.py lens [--scenes 60]
    python benchmarks/screen.py night [--seconds 60]
    python benchmarks/screen.py speed

``fit`` rehearses the scene screen-fit before screens whose values differ from the stated ones, and tells in how many
draws each parameter of the fit lies within its stated half-width of 95 %. The others need Chromium and playwright.
``scenes`` photographs attitudes of a spiral over the sky as screenshots, extracts and identifies them, and compares the
attitude with what was shown; ``lens`` does so through a lens of its own: distorted, turned, blurred, noisy, 12 bits.
``night`` runs 'gse run' with a page of 1280 x 720 and a sensor at 2 Hz on a pty, which reads the page's pixels: two
fields, a change in the middle of an exposure, and a turn of 0.5 deg/s. ``speed`` draws scenes of 500 spots, and tells
the size of the page and how soon it shows its first star. Prints Markdown tables.
"""

import argparse
import io
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.request import urlopen

import numpy as np
from PIL import Image
from scipy.ndimage import gaussian_filter, map_coordinates

from gse.catalog import load_catalog, mission_catalog
from gse.config.station import parse_station
from gse.identifier import Identification, make_identifier
from gse.imaging.extraction import extract_sub_pixel
from gse.sessions.screen import Stage, screen_content, sky_document
from gse.simulator.pty_endpoint import PtyEndpoint
from gse.simulator.scenario import parse_scenario
from gse.values.attitude import Attitude
from gse.values.camera import Camera
from gse.values.constants import ARCSEC_PER_RAD
from gse.values.identifier_options import IdentifierOptions
from gse.values.screen import Screen
from gse.view.server import ViewServer
from protocols import PanoramaMessage, load_protocol

sys.path.append(str(Path(__file__).parents[1] / "tests"))

from devices.browser import browser
from devices.screen_panoramas import fitted

LAB = """\
version: 1
sensor: {name: lab, rows: 1024, columns: 1024, focal_length_px: 4170}
site: {name: lab, latitude_deg: 48, longitude_deg: 11, height_m: 500}
mount: {inertial: {ra_deg: 83, de_deg: -2}}
screen: {pixel_pitch_mm: 0.1, columns: 1920, rows: 1080, focal_length_mm: 500}
protocol: panorama-v1-subpixel
"""
NAMES = ("x_deg", "y_deg", "roll_deg", "focal_length_mm", "k1", "k2", "gamma", "latency_ms")
SPREAD = np.array([1.0, 1.0, 10.0, 3.0, 0.01, 0.005, 0.2, 20.0])
"""Standard deviations of the real values about the stated ones."""


def fits(draws: int) -> None:
    """A table of the parameters with the share of the draws inside, and the root mean square of the errors."""
    station, off, widths = parse_station(LAB), [], []
    for seed in range(draws):
        real = _real(np.random.default_rng(1000 + seed))
        screen = fitted(station, LAB, {"screen": _keys(real)}, seed).screen
        off.append(_values(screen) - real)
        widths.append(_half_widths(screen))
    off_all, width_all = np.array(off), np.array(widths)
    print("| parameter | inside 95 % | rms error | mean half-width |", "|---|---|---|---|", sep="\n")
    for place, name in enumerate(NAMES):
        inside = int((np.abs(off_all[:, place]) <= width_all[:, place]).sum())
        rms = float(np.sqrt((off_all[:, place] ** 2).mean()))
        print(f"| {name} | {inside} of {draws} | {rms:.3g} | {width_all[:, place].mean():.3g} |")


def _real(random: np.random.Generator) -> np.ndarray:
    """The values of one draw; a latency is never negative."""
    values = np.array([0.0, 0.0, 0.0, 500.0, 0.0, 0.0, 2.2, 30.0]) + SPREAD * random.normal(size=len(NAMES))
    values[-1] = max(values[-1], 1.0)
    return values


def _keys(values: np.ndarray) -> dict[str, object]:
    x, y, roll, focal, k1, k2, gamma, latency = values.tolist()
    looks = {"x_deg": x, "y_deg": y, "roll_deg": roll}
    lens = {"focal_length_mm": focal, "radial_distortion": [k1, k2]}
    return {**lens, "gamma": gamma, "latency_ms": latency, "to_sensor": looks}


def _values(screen: Screen) -> np.ndarray:
    looks = screen.to_sensor
    assert screen.focal_length_mm is not None
    lens = screen.focal_length_mm, *screen.radial_distortion
    return np.array([looks.x_deg, looks.y_deg, looks.roll_deg, *lens, screen.gamma, screen.latency_ms])


def _half_widths(screen: Screen) -> np.ndarray:
    known, looks = screen.uncertainty, screen.to_sensor.uncertainty
    across_deg, roll_deg = looks.across_arcsec / 3600, looks.roll_arcsec / 3600
    lens = known.away_mm, *known.radial_distortion
    return np.array([across_deg, across_deg, roll_deg, *lens, known.gamma, screen.latency_uncertainty_ms])


PANELS = ((1920, 1080), (2560, 1440))
STARTS_S = 30.0


@contextmanager
def opened(columns: int, rows: int) -> Iterator[tuple[Any, Stage]]:
    """A page of Chromium that has the sky of a screen of this size, and the stage that serves it."""
    text = LAB.replace("columns: 1920, rows: 1080", f"columns: {columns}, rows: {rows}")
    stage = Stage(parse_station(text), parse_scenario("text: still", "still"))
    content = ViewServer("127.0.0.1", 0, screen_content(stage))
    with content as server, browser() as visit, visit(size=(columns, rows)) as visited:
        visited.page.goto(server.url)
        until_s = time.monotonic() + STARTS_S
        while not visited.page.evaluate("sky !== null"):
            assert time.monotonic() < until_s
            time.sleep(0.05)
        yield visited.page, stage


def spiral(count: int) -> np.ndarray:
    """Attitudes (N, 3): RA and DE on a spiral over the sky, and a roll that goes around."""
    place = np.arange(count) + 0.5
    de = np.degrees(np.arcsin(1 - 2 * place / count))
    return np.column_stack([(place * 137.50776) % 360, de, (place * 17.0) % 360])


def photograph(page: Any, angles: np.ndarray) -> np.ndarray:
    """The light (rows, columns) of the page, from 0 to 1, while it shows an attitude at rest."""
    axes = Attitude.from_angles(*angles.tolist()).icrs_to_sensor.tolist()
    step = {"step": 0, "from_ms": 0, "axes": axes, "turn_rad_per_s": [0, 0, 0], "spots": []}
    page.evaluate("(step) => { scene = step; drawn = 0; say.textContent = ''; draw(0); }", step)
    image = Image.open(io.BytesIO(page.screenshot())).convert("L")
    return (np.asarray(image, dtype=np.float64) / 255) ** 2.2


def scenes(count: int, *, lens: bool) -> None:
    """A table of the errors of the attitudes of a spiral, for each size of a panel."""
    print("| panel | scenes | answered | across, rms px | across, 95 % px | roll, rms arcsec |")
    print("|---|---|---|---|---|---|")
    for columns, rows in PANELS[:1] if lens else PANELS:
        with opened(columns, rows) as (page, stage):
            errors = [_error(page, stage.screen, angles, seed, lens=lens) for seed, angles in enumerate(spiral(count))]
        found = np.array([error for error in errors if error is not None])
        across = np.hypot(found[:, 0], found[:, 1])
        rms, most = float(np.sqrt((found[:, :2] ** 2).mean())), float(np.quantile(across, 0.95))
        roll = float(np.sqrt((found[:, 2] ** 2).mean())) * ARCSEC_PER_RAD
        focal_px = stage.screen.camera().focal_length_px
        cells = f"{len(found)} | {rms * focal_px:.4f} | {most * focal_px:.4f} | {roll:.2f}"
        print(f"| {columns} x {rows} | {count} | {cells} |", flush=True)


LENS = Camera(1024, 1024, 4000.0, (505.0, 520.0), (-0.02, 0.01))
LOOKS = {"x_deg": 0.5, "y_deg": -0.3, "roll_deg": 2.0}
BLUR_PX, NOISE_COUNTS = 0.6, 3.0


def _error(page: Any, screen: Screen, angles: np.ndarray, seed: int, *, lens: bool) -> np.ndarray | None:
    """The small turn (3,) between what was shown and what the stars say; None without an answer."""
    light, camera = photograph(page, angles), screen.camera()
    shown = Attitude.from_angles(*angles.tolist()).icrs_to_sensor
    if lens:
        camera, looks = LENS, type(screen.to_sensor)(**LOOKS).rotation()
        light, shown = _through(screen, looks, light, np.random.default_rng(seed)), looks @ shown
    xy_px, index = extract_sub_pixel(np.rint(np.clip(light, 0, 1) * 4095).astype(np.uint16))
    identifier = _identifier(camera)
    answer = identifier.identify(camera.directions(xy_px), index)
    if not isinstance(answer, Identification):
        return None
    seen, true = camera.directions(xy_px[answer.objects]), identifier.catalog.icrs[answer.stars] @ shown.T
    # Small angles: a star that is seen at seen = true + turn x true, clipped of blends and neighbours.
    kept = np.ones(len(seen), dtype=bool)
    for _ in range(4):
        rows = np.concatenate([_cross(one) for one in true[kept]])
        turn = np.linalg.lstsq(rows, (seen - true)[kept].ravel(), rcond=None)[0]
        left = np.linalg.norm(seen - true - np.cross(turn, true), axis=1)
        kept = left <= 4 * max(float(np.median(left)), 1e-9)
    return np.asarray(turn)


def _cross(vector: np.ndarray) -> np.ndarray:
    """The matrix that takes a turn to turn x vector."""
    x, y, z = vector.tolist()
    return np.array([[0, z, -y], [-z, 0, x], [y, -x, 0]])


def _through(screen: Screen, looks: np.ndarray, light: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """The same light on the detector behind LENS, blurred, with noise."""
    x, y = np.meshgrid(np.arange(LENS.columns), np.arange(LENS.rows))
    directions = LENS.directions(np.column_stack([x.ravel(), y.ravel()])) @ looks
    places = screen.camera().pixels(directions)
    seen = map_coordinates(light, places[:, ::-1].T, order=3).reshape(LENS.rows, LENS.columns)
    return np.asarray(gaussian_filter(seen, BLUR_PX) + random.normal(0, NOISE_COUNTS / 4095, seen.shape))


_IDENTIFIERS: dict[Camera, Any] = {}


def _identifier(camera: Camera) -> Any:
    if camera not in _IDENTIFIERS:
        catalog = load_catalog(faintest_magnitude=6.0).at_epoch(2026.9)
        stars = mission_catalog(catalog, camera, "auto")
        _IDENTIFIERS[camera] = make_identifier(IdentifierOptions(algorithm="robust"), camera, stars)
    return _IDENTIFIERS[camera]


NIGHT = """\
version: 1
sensor: {name: canvas, rows: 720, columns: 1280, focal_length_px: 4170, time: {scale: unix, uncertainty_ms: 20}}
site: {name: lab, latitude_deg: 48, longitude_deg: 11, height_m: 500}
mount: {inertial: {ra_deg: 83, de_deg: -2}}
screen: {pixel_pitch_mm: 0.1, columns: 1280, rows: 720, focal_length_mm: 417, latency_uncertainty_ms: 5}
protocol: panorama-v1-subpixel
identifier: {algorithm: robust}
limits: {slew_deg_per_s: 0.5, false_share: 0.1}
"""
SCENE = """\
text: two fields at rest, then a turn
scene:
  steps:
    - {{ra_deg: 83, de_deg: -2, for_s: {0}}}
    - {{ra_deg: 310, de_deg: 40, for_s: {0}}}
    - {{ra_deg: 83, de_deg: -2, turn_deg_per_s: [0, 0.5, 0], for_s: {0}}}
"""
READ = """() => new Promise((done) => requestAnimationFrame((now) => {
  const spots = touched.map(([left, top, right, bottom]) => {
    const rows = [];
    for (let row = top; row <= bottom; row += 1) {
      const at = row * sky.columns;
      rows.push(Array.from(pixels.subarray(at + left, at + right + 1), (pixel) => pixel & 255));
    }
    return [left, top, rows];
  });
  done([performance.timeOrigin + now + 500 / 60, spots]);
}))"""
"""What the page has just handed to the panel, and the middle of its time there; a screenshot has no time of its own."""
EXPOSURE_S, RATE_HZ = 0.4, 2.0


def night(seconds: float) -> None:
    """The report of a real session whose sensor reads the page's pixels at 2 Hz."""
    with tempfile.TemporaryDirectory() as folder:
        endpoint, protocol = PtyEndpoint(), load_protocol("panorama-v1-subpixel")
        lab, scene = Path(folder, "lab.yaml"), Path(folder, "scene.yaml")
        lab.write_text(NIGHT)
        scene.write_text(SCENE.format(seconds))
        command = [str(Path(sys.executable).with_name("gse")), "run", str(lab), "--port", endpoint.address]
        command += ["--scene", str(scene), "--no-plots", "--clock-error", "1ms", "--out", folder]
        with subprocess.Popen(command) as running, browser() as visit, visit(size=(1280, 720)) as visited:
            _visit_when_served(visited.page)
            sent = 0
            while running.poll() is None:
                due_s = time.monotonic() + 1 / RATE_HZ
                at_ms, spots = visited.page.evaluate(READ)
                light = np.zeros((720, 1280))
                for left, top, rows in spots:
                    levels = np.array(rows)
                    light[top : top + len(levels), left : left + levels.shape[1]] = (levels / 255) ** 2.2
                xy_px, index = extract_sub_pixel(np.rint(light * 4095).astype(np.uint16))
                message = PanoramaMessage(round(at_ms * 1000), sent, EXPOSURE_S, frozenset(), 20.0, xy_px, index)
                endpoint.send(protocol.encode(message, sent % 65536))
                sent += 1
                time.sleep(max(due_s - time.monotonic(), 0))
        (report,) = Path(folder).glob("*/report.json")
        _print_night(json.loads(report.read_text()), sent)


def _visit_when_served(page: Any) -> None:
    until_s = time.monotonic() + STARTS_S
    while True:
        try:
            urlopen("http://127.0.0.1:8430/", timeout=1)
            break
        except OSError:
            assert time.monotonic() < until_s
            time.sleep(0.2)
    page.goto("http://127.0.0.1:8430/")


def _print_night(report: dict[str, Any], sent: int) -> None:
    print(f"{sent} frames, {report['word']}: {'; '.join(report['reasons'])}")
    print("| rate, deg/s | frames | answered | 95 % of dRA*, arcsec | 95 % of dDE, arcsec | outcome |")
    print("|---|---|---|---|---|---|")
    for step in report["slew"]:
        print(f"| {step['rate_deg_per_s']:g} | {step['frames']} | {step['available']:.3f} | "
              f"{step['p95_d_ra_cosde_arcsec']:.1f} | {step['p95_d_de_arcsec']:.1f} | {step['outcome']} |")  # fmt: skip
    for one in report["exclusions"]:
        if one["frames"]:
            print(f"left out, {one['cause']}: {one['frames']} frames, {one['reason']}")


DRAW = """(scenes) => {
  const began = performance.now();
  for (let k = 0; k < scenes; k += 1) {
    const place = (n) => [(n * 71.3 + k * 13.7) % sky.columns, (n * 37.9 + k * 7.1) % sky.rows, 3];
    scene.spots = Array.from({ length: 500 }, (_, n) => place(n));
    draw(0);
  }
  return (performance.now() - began) / scenes;
}"""


def speed() -> None:
    """A table of the milliseconds that a scene of 500 spots takes, and how soon the first star is there."""
    print("| panel | ms a scene of 500 spots | scenes a second |", "|---|---|---|", sep="\n")
    for columns, rows in PANELS:
        with opened(columns, rows) as (page, stage):
            photograph(page, np.array([83.0, -2.0, 0.0]))
            each_ms = min(page.evaluate(DRAW, 50) for _ in range(3))
            print(f"| {columns} x {rows} | {each_ms:.1f} | {1000 / each_ms:.0f} |", flush=True)
            began_s = time.monotonic()
            page.reload()
            while not page.evaluate("sky !== null"):
                time.sleep(0.01)
            photograph(page, np.array([83.0, -2.0, 0.0]))
            first_s, sky = time.monotonic() - began_s, len(json.dumps(sky_document(stage)))
            print(f"\nfirst star after {first_s:.2f} s; the stars are {sky / 1e3:.0f} kB")


def main() -> None:
    """The figures that the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("fit", "scenes", "lens", "night", "speed"))
    parser.add_argument("--draws", type=int, default=40)
    parser.add_argument("--scenes", type=int, default=300)
    parser.add_argument("--seconds", type=float, default=60.0)
    asked = parser.parse_args()
    if asked.what == "fit":
        fits(asked.draws)
    elif asked.what in ("scenes", "lens"):
        scenes(asked.scenes, lens=asked.what == "lens")
    elif asked.what == "night":
        night(asked.seconds)
    else:
        speed()


if __name__ == "__main__":
    main()
