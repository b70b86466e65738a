"""Chromium as a device under test: Debian's package, driven by playwright."""

import functools
import shutil
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import urlsplit

import pytest
from devices.patience import PATIENCE_S

SOFTWARE_GRAPHICS = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")


@dataclass
class Visit:
    """A page, every request that it made or tried, and what its console called an error."""

    page: Any
    requests: list[str] = field(default_factory=list)
    errors: list[str] = field(default_factory=list)

    def hosts(self) -> set[str | None]:
        """The hosts of all requests that need a network."""
        urls = [urlsplit(url) for url in self.requests]
        return {url.hostname for url in urls if url.scheme not in ("file", "data", "blob")}


def chromium() -> str:
    """The browser's path; the test is skipped where there is none."""
    found = shutil.which("chromium") or shutil.which("chromium-browser")
    if found is None:
        pytest.skip("no Chromium on this machine (Debian: apt install chromium)")
    return found


Visits = Callable[..., AbstractContextManager[Visit]]


@contextmanager
def browser() -> Iterator[Visits]:
    """A browser for the tests of a module, each with fresh pages of its own; gives ``visit``."""
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    with sync_api.sync_playwright() as driver:
        arguments = ["--no-sandbox", *SOFTWARE_GRAPHICS]
        running = driver.chromium.launch(executable_path=chromium(), args=arguments, timeout=1000 * PATIENCE_S)
        try:
            yield functools.partial(_visit, running)
        finally:
            running.close()


@contextmanager
def _visit(
    running: Any, *, offline: bool = False, size: tuple[int, int] = (1000, 600), ratio: float = 1.0
) -> Iterator[Visit]:
    """A fresh page, which shares nothing with those before it; ``ratio`` is that of a scaled display, or a zoom."""
    viewport = {"width": size[0], "height": size[1]}
    context = running.new_context(offline=offline, viewport=viewport, device_scale_factor=ratio)
    context.set_default_timeout(1000 * PATIENCE_S)
    opened = Visit(context.new_page())
    context.on("request", lambda request: opened.requests.append(request.url))
    opened.page.on("pageerror", lambda error: opened.errors.append(str(error)))
    opened.page.on("console", lambda text: opened.errors.append(text.text) if text.type == "error" else None)
    try:
        yield opened
    finally:
        context.close()
