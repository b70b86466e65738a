"""Makes the sessions of this folder from its tables: each panorama becomes one frame on the wire, as a sensor sends it.

    python replays/lowell/make.py

Existing sessions are replaced; the same tables give the same bytes.
"""

import json
from pathlib import Path
from typing import Any

from drivers.chunk import Chunk
from drivers.session_file.writer import CaptureWriter
from gse import instant
from gse.imaging.panorama_table import read_panorama_table
from gse.station.reception import BITS_PER_BYTE
from protocols import PanoramaMessage, load_protocol

HERE = Path(__file__).parent
PROTOCOL = "panorama-v1-subpixel"
BYTE_NS = BITS_PER_BYTE * instant.NS_PER_S // 115200
SENSOR_TIME_US = 3_600_000_000


def make(name: str, frame: dict[str, Any], station_text: str) -> None:
    """One session; its bytes come when the exposure ends."""
    xy_px, brightness = read_panorama_table(HERE / "tables" / f"{name}.csv")
    protocol = load_protocol(PROTOCOL)
    message = PanoramaMessage(
        time_us=SENSOR_TIME_US,
        frame_no=int(name),
        exposure_s=frame["exposure_s"],
        flags=frozenset(),
        temperature_c=20.0,
        xy_px=xy_px,
        index=brightness,
    )
    end_ns = instant.from_text(frame["utc_middle"]) + round(frame["exposure_s"] / 2 * instant.NS_PER_S)
    path = HERE / f"{name}.mcap"
    path.unlink(missing_ok=True)
    with CaptureWriter(path) as writer:
        writer.attach("station.yaml", "application/yaml", station_text.encode())
        writer.attach("protocol.yaml", "application/yaml", protocol.text.encode())
        writer.rx(Chunk(end_ns + BYTE_NS, SENSOR_TIME_US * 1000 + BYTE_NS, protocol.encode(message, sequence=1)))


def main() -> None:
    """Make all."""
    station_text = (HERE / "station.yaml").read_text(encoding="utf-8")
    for name, frame in json.loads((HERE / "frames.json").read_text(encoding="utf-8")).items():
        make(name, frame, station_text)


if __name__ == "__main__":
    main()
