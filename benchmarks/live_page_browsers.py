"""Cost of the live page of a real session at 10 Hz, with ten clients, three of them Chromium of phone to desk size.

    python benchmarks/live_page_browsers.py [--clients 10] [--seconds 20]

An emulated sensor sends on a TCP port, `gse run --view web` receives. Processor time is that of the station's process,
without clients, with them, and without them again. The lag is from the middle of the exposure to the client: so the
exposure, the wire and the identification are in it. Wants Chromium and playwright; run it on quiet cores.
"""

import argparse
import asyncio
import contextlib
import json
import os
import re
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from datetime import datetime
from pathlib import Path
from typing import Any

from playwright.sync_api import sync_playwright
from tornado.websocket import websocket_connect

GSE = str(Path(sys.executable).with_name("gse"))
PORT = "socket://127.0.0.1:5099"
SIZES = {"phone": (390, 844), "laptop": (1280, 720), "desk": (1920, 1080)}
_LAGS = """() => { window.lags = []; let seen = ""; setInterval(() => { if (latest && latest.data_utc !== seen) {
    seen = latest.data_utc; window.lags.push((Date.now() - Date.parse(seen)) / 1000); } }, 10); }"""
_PAINT_MS = "performance.getEntriesByName('first-contentful-paint')[0].startTime"
_BYTES = "performance.getEntriesByType('navigation')[0].transferSize"


async def _read(url: str, clients: int, seconds: float) -> list[float]:
    sockets = [await websocket_connect(url.replace("http", "ws") + "live") for _ in range(clients)]
    until_s, lags = time.monotonic() + seconds, []

    async def one(socket: Any) -> None:
        seen = ""
        while time.monotonic() < until_s:
            document = json.loads(await socket.read_message())
            if document["data_utc"] and document["data_utc"] != seen:
                seen = document["data_utc"]
                lags.append(time.time() - datetime.fromisoformat(seen).timestamp())
            await socket.write_message("next")
        socket.close()

    await asyncio.gather(*map(one, sockets))
    return lags


def read(url: str, clients: int, seconds: float) -> list[float]:
    """Lags of clients that are no browsers, in seconds."""
    return asyncio.run(_read(url, clients, seconds))


def processor_s(process: int) -> float:
    """User and system time of a process so far."""
    fields = Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()
    return sum(map(int, fields[11:13])) / os.sysconf("SC_CLK_TCK")


@contextlib.contextmanager
def session(folder: Path) -> Iterator[tuple[int, str]]:
    """A running station's process, and the address of its page."""
    station = folder / "roof.yaml"
    subprocess.run([GSE, "config", "init", str(station), "--yes", "--port", PORT], check=True, capture_output=True)
    emulate = [GSE, "emulate", "--tcp", PORT.removeprefix("socket://"), "--station", str(station), "--dark"]
    run = [GSE, "run", "--station", str(station), "--view", "web", "--http-port", "0", "--out", str(folder)]
    log = folder / "run.txt"
    with (
        subprocess.Popen(emulate, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as sensor,
        log.open("w") as messages,
    ):
        assert sensor.stdout is not None
        sensor.stdout.readline()
        with subprocess.Popen(run, stdout=subprocess.DEVNULL, stderr=messages) as station_process:
            while not (found := re.search(r"http://\S+?/", log.read_text())):
                time.sleep(0.1)
            try:
                yield station_process.pid, found[0]
            finally:
                station_process.terminate()
                station_process.wait()
                sensor.terminate()


@contextlib.contextmanager
def browsers(url: str) -> Iterator[list[Any]]:
    """A page in a Chromium of its own for each size, with its first paint printed."""
    with sync_playwright() as driver, contextlib.ExitStack() as opened:
        pages = []
        for name, (width, height) in SIZES.items():
            browser = driver.chromium.launch(executable_path="/usr/bin/chromium", args=["--no-sandbox"])
            opened.callback(browser.close)
            pages.append(page := browser.new_page(viewport={"width": width, "height": height}))
            page.goto(url)
            page.wait_for_selector("#axis-1")
            paint_ms, size = page.evaluate(f"[{_PAINT_MS}, {_BYTES}]")
            print(
                f"first paint, {name} {width} x {height}, new browser: {paint_ms / 1000:.2f} s, {size} bytes",
                flush=True,
            )
            page.evaluate(_LAGS)
        yield pages


def measured(process: int, seconds: float) -> float:
    """Share of a core that the process takes from now on."""
    began_s, used_s = time.monotonic(), processor_s(process)
    time.sleep(seconds)
    return (processor_s(process) - used_s) / (time.monotonic() - began_s)


def row(what: str, share: float, lags: list[float]) -> str:
    """A row of the table."""
    ordered = sorted(lags)
    text = f"{statistics.median(ordered):.2f} s | {ordered[int(0.99 * (len(ordered) - 1))]:.2f} s" if lags else "- | -"
    return f"| {what} | {100 * share:.1f} % of a core | {text} |"


def main() -> None:
    """Print the table."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--clients", type=int, default=10)
    options.add_argument("--seconds", type=float, default=20.0)
    asked = options.parse_args()
    others = asked.clients - len(SIZES)
    with tempfile.TemporaryDirectory() as name, session(Path(name)) as (process, url), ProcessPoolExecutor(1) as pool:
        pool.submit(int).result()
        time.sleep(10)  # the first identification, and what it reads
        alone = measured(process, asked.seconds)
        with browsers(url) as pages:
            reading = pool.submit(read, url, others, asked.seconds)
            shared = measured(process, asked.seconds)
            lags = [page.evaluate("window.lags") for page in pages]
            plain = reading.result()
        again = measured(process, asked.seconds)
    print(f"load average {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores\n")
    print("| clients | processor time of the station | lag, median | lag, 99 % |\n|---|---|---|---|")
    print(row("none", alone, []))
    print(row(f"{asked.clients}: the {others} that are no browsers", shared, plain))
    for size, seen in zip(SIZES, lags, strict=True):
        print(row(f"{asked.clients}: Chromium, {size}", shared, seen))
    print(row("none again", again, []))


if __name__ == "__main__":
    main()
