"""Makes the sessions of this folder: each panorama of benchmarks/real-sky becomes one frame on the wire.

    python replays/night-sky/make.py

Existing sessions are replaced; the same tables give the same bytes.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np

from drivers.chunk import Chunk
from drivers.session_file.writer import CaptureWriter
from gse import instant
from gse.imaging.panorama_table import read_panorama_table
from gse.station.reception import BITS_PER_BYTE
from protocols import PanoramaMessage, load_protocol

HERE = Path(__file__).parent
SET = HERE.parents[1] / "benchmarks" / "real-sky"
BYTE_NS = BITS_PER_BYTE * instant.NS_PER_S // 115200
SENSOR_TIME_US = 1_000_000
ALTITUDE_INDEX_ERROR_DEG = 1.4
"""The five frames, looking in four directions, all stand 1.1 to 1.6 deg higher than the altitude scale says."""

KINDS = {"": "panorama-v1", "-literal": "panorama-v1", "-subpixel": "panorama-v1-subpixel"}

STATION = """\
# {title}
version: 1
sensor:
  name: {camera}
  rows: {rows}
  columns: {columns}
  focal_length_px: {focal_length_px}
  radial_distortion: [{radial_distortion_k1}, 0]
site:
  name: {site}
"""
NOORDWIJK = """\
  latitude_deg: 52.22
  longitude_deg: 4.42
  height_m: 20
mount:      # the scales said azimuth {azimuth_deg}, altitude {altitude_deg}; README.md tells of the 1.4 deg
  azimuth_deg: {azimuth_deg}
  altitude_deg: {mount_altitude_deg}
limits:     # the mount was read off its scales, and the time of each frame off a stopwatch
  d_ra_cosde_arcsec: 1800
  d_de_arcsec: 1800
"""
GRANADA = """\
  latitude_deg: 37.18
  longitude_deg: -3.61
  height_m: 680
"""


def station_text(name: str, truth: dict[str, Any], protocol: str) -> str:
    """The station file of one image."""
    rooftop = "utc" in truth
    head = STATION + (NOORDWIJK if rooftop else GRANADA)
    title = f"{name}: " + ("ESA's star camera on a rooftop" if rooftop else "a camera on a tripod, at a time unknown")
    words = {"title": title, "camera": "rooftop-camera" if rooftop else "tripod-camera"}
    words["site"] = "Noordwijk (nominal)" if rooftop else "Granada (nominal)"
    if rooftop:
        words["mount_altitude_deg"] = f"{truth['altitude_deg'] + ALTITUDE_INDEX_ERROR_DEG:g}"
    return head.format(**truth, **words) + f"protocol: {protocol}\n"


def make(name: str, kind: str, truth: dict[str, Any]) -> None:
    """One session and, for whole pixels, the station file beside it."""
    xy_px, brightness = read_panorama_table(SET / "tables" / f"{name}{kind}.csv")
    protocol = load_protocol(KINDS[kind])
    text = station_text(name, truth, protocol.name)
    (HERE / f"{name}{kind}.yaml").write_text(text) if kind != "-literal" else None
    message = PanoramaMessage(
        time_us=SENSOR_TIME_US,
        frame_no=1,
        exposure_s=0.0,
        flags=frozenset(),
        temperature_c=20.0,
        xy_px=xy_px,
        index=np.minimum(brightness, 4096.0),
    )
    utc_ns = instant.from_text(truth["utc"]) if "utc" in truth else 0
    path = HERE / f"{name}{kind}.mcap"
    path.unlink(missing_ok=True)
    with CaptureWriter(path) as writer:
        writer.attach("station.yaml", "application/yaml", text.encode())
        writer.attach("protocol.yaml", "application/yaml", protocol.text.encode())
        writer.rx(Chunk(utc_ns + BYTE_NS, BYTE_NS, protocol.encode(message, sequence=1)))


def main() -> None:
    """Make all."""
    truths = json.loads((SET / "truth.json").read_text())
    for name, truth in truths.items():
        for kind in KINDS if not name.startswith("telephoto") else ():
            make(name, kind, truth)


if __name__ == "__main__":
    main()
