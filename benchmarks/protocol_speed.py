"""Speed of the protocols: frames found, messages read and written, noise and worst garbage refused.

    python benchmarks/protocol_speed.py

Times are the best of several passes, in CPU time of one core, so that other work on the machine counts little.
"""

import time
from collections.abc import Callable

import numpy as np

from protocols import Discard, Frame, FrameDecoder, PanoramaMessage, Protocol, built_in_names, load_protocol

FRAMES = 20_000
NOISE_BYTES = 20_000_000
BLOCK_BYTES = 65_536


def best_s(work: Callable[[], object], passes: int = 5) -> float:
    """Least CPU seconds of several passes."""
    seconds = []
    for _ in range(passes):
        start = time.process_time()
        work()
        seconds.append(time.process_time() - start)
    return min(seconds)


def decode(protocol: Protocol, stream: bytes, block_bytes: int) -> list[Frame | Discard]:
    """All of a stream, fed in blocks."""
    decoder = FrameDecoder(protocol)
    found: list[Frame | Discard] = []
    for at in range(0, len(stream), block_bytes):
        found += decoder.feed(stream[at : at + block_bytes])
    return found + decoder.finish()


def full_panorama(protocol: Protocol, rng: np.random.Generator) -> PanoramaMessage:
    """A panorama with all slots used."""
    xy_px = np.round(rng.uniform(0, 1023, (protocol.slots, 2)))
    index = np.sort(rng.integers(100, 4096, protocol.slots))[::-1].astype(np.float64)
    return PanoramaMessage(123_456_789, 17, 0.1, frozenset(), 21.25, xy_px, index)


def figures(name: str, rng: np.random.Generator) -> list[tuple[str, float, str]]:
    """What one protocol reaches."""
    protocol = load_protocol(name)
    message = full_panorama(protocol, rng)
    wire = protocol.encode(message, 1)
    [frame] = FrameDecoder(protocol).feed(wire)
    assert isinstance(frame, Frame)
    stream = wire * FRAMES
    noise = rng.integers(0, 256, NOISE_BYTES, dtype=np.uint8).tobytes()
    garbage = wire[:12] * (NOISE_BYTES // 48)
    return [
        ("frames found, blocks of 64 KiB", FRAMES / best_s(lambda: decode(protocol, stream, BLOCK_BYTES)), "1/s"),
        ("frames found, chunks of 20 bytes", FRAMES / best_s(lambda: decode(protocol, stream, 20), 2), "1/s"),
        ("panorama read", 1e6 / 2000 * best_s(lambda: [protocol.decode(frame) for _ in range(2000)]), "us"),
        ("panorama written", 1e6 / 1000 * best_s(lambda: [protocol.encode(message, 1) for _ in range(1000)]), "us"),
        ("noise refused", NOISE_BYTES / 1e6 / best_s(lambda: decode(protocol, noise, BLOCK_BYTES), 2), "MB/s"),
        (
            "frame heads and no frame",
            len(garbage) / 1e6 / best_s(lambda: decode(protocol, garbage, BLOCK_BYTES), 2),
            "MB/s",
        ),
        ("description loaded", 1e3 * best_s(lambda: load_protocol(name)), "ms"),
    ]


def main() -> None:
    """Print the table."""
    for name in built_in_names():
        panoramas = load_protocol(name).panoramas
        if panoramas is None or panoramas.in_parts:
            continue
        print(name)
        for what, value, unit in figures(name, np.random.default_rng(1)):
            print(f"    {what:<34}{value:>12.1f} {unit}")


if __name__ == "__main__":
    main()
