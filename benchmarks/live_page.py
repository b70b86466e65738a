"""Cost of the glance page: lag of a panorama, processor time, and bytes, with many browsers.

    python benchmarks/live_page.py [--browsers 10] [--seconds 20]

A session's results are shown at 10 Hz. Clients ask for each document after the one before, as the page does, in a
process of their own. The lag is from the result to the client that parsed it.
"""

import argparse
import asyncio
import json
import statistics
import sys
import threading
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path

from tornado.websocket import websocket_connect

from gse.view.glance import Glance
from gse.view.live_state import LiveState
from gse.view.server import Content, ViewServer

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))  # after gse: tests has a folder of that name
from skies.one_by_one import results_of
from skies.synthetic_night import synthetic_frames, synthetic_night

RATE_HZ = 10.0


async def _read(port: int, browsers: int, seconds: float) -> tuple[list[float], int]:
    """Lags in seconds, and bytes of one client."""
    sockets = [await websocket_connect(f"ws://127.0.0.1:{port}/live") for _ in range(browsers)]
    until_s, lags, size = time.monotonic() + seconds, [], 0

    async def one(socket: object) -> None:
        nonlocal size
        shown = ""
        while time.monotonic() < until_s:
            text = await socket.read_message()
            document = json.loads(text)
            size += len(text)
            if document["data_utc"] and document["data_utc"] != shown:
                shown = document["data_utc"]
                lags.append(time.time() - document["frames_lost"] / 1000)
            await socket.write_message("next")
        socket.close()

    await asyncio.gather(*map(one, sockets))
    return lags, size // browsers


def clients(port: int, browsers: int, seconds: float) -> tuple[list[float], int]:
    """Read as many pages as there are browsers."""
    return asyncio.run(_read(port, browsers, seconds))


def measured(browsers: int, seconds: float) -> tuple[float, list[float], int]:
    """Processor time of this process per second, lags in seconds, bytes of a browser per second."""
    session = synthetic_night(20)
    frames = list(synthetic_frames(200, trouble=False))
    live = LiveState(session.station)
    glance = Glance(live)
    with ViewServer("127.0.0.1", 0, Content(glance=glance)) as server, ProcessPoolExecutor(1) as pool:
        pool.submit(int).result()
        reading = pool.submit(clients, server.port, browsers, seconds) if browsers else None
        pause, began_s, used_s, number = threading.Event(), time.monotonic(), time.process_time(), 0
        while time.monotonic() - began_s < seconds:
            frame = frames[number % len(frames)]
            panorama = replace(frame.panorama, utc_ns=frames[0].panorama.utc_ns + round(number / RATE_HZ * 1e9))
            # The client gets the host's time in milliseconds through a counter that the page only shows.
            session.link.frames_lost = round(time.time() * 1000)
            live.on_results(results_of([replace(frame, panorama=panorama)]), session)
            number += 1
            pause.wait(max(0.0, began_s + number / RATE_HZ - time.monotonic()))
        used = (time.process_time() - used_s) / seconds
        lags, size = reading.result() if reading else ([], 0)
    return used, lags, round(size / seconds)


def main() -> None:
    """Print the table."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--browsers", type=int, default=10)
    options.add_argument("--seconds", type=float, default=20.0)
    asked = options.parse_args()
    print("| browsers | processor time | lag, median | lag, 99 % | bytes per second and browser |")
    print("|---|---|---|---|---|")
    for browsers in (0, asked.browsers):
        used, lags, size = measured(browsers, asked.seconds)
        ordered = sorted(lags)
        median = f"{statistics.median(ordered):.2f} s" if ordered else "-"
        late = f"{ordered[int(0.99 * (len(ordered) - 1))]:.2f} s" if ordered else "-"
        print(f"| {browsers} | {100 * used:.2f} % of one core | {median} | {late} | {size} |")


if __name__ == "__main__":
    main()
