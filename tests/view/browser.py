"""An installed browser for the tests of the page, and a page in it that tells on itself."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from urllib.parse import urlsplit

import pytest
from playwright.sync_api import (
    Browser,
    ConsoleMessage,
    Error,
    Page,
    Request,
    expect,
    sync_playwright,
)

NAMES = ("chromium", "chromium-browser", "google-chrome")
OPTIONS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
]
LOOPBACK = ("127.0.0.1", "localhost")
# a machine that is busy with something else is slow, which is no fault of the page
PATIENCE_MS = 30_000.0


@contextmanager
def browser() -> Iterator[Browser]:
    """An installed Chromium, else Playwright's own; skips the test where there is none."""
    installed = next((path for path in map(shutil.which, NAMES) if path), None)
    expect.set_options(timeout=PATIENCE_MS)
    with sync_playwright() as playwright:
        try:
            started = playwright.chromium.launch(executable_path=installed, args=OPTIONS)
        except Error as error:
            pytest.skip(
                "no browser: install chromium, or type playwright install chromium "
                f"({error.message.splitlines()[0]})"
            )
        yield started
        started.close()


class WatchedPage:
    """`complaints` are errors and warnings of its console, exceptions, and requests that leave
    this machine.
    """

    def __init__(self, page: Page) -> None:
        self.page = page
        self.complaints: list[str] = []
        page.on("console", self._console)
        page.on("pageerror", lambda error: self.complaints.append(f"exception: {error}"))
        page.on("request", self._request)

    def _console(self, message: ConsoleMessage) -> None:
        if (
            message.type in ("error", "warning") and "willReadFrequently" not in message.text
        ):  # the test reads pixels, the page does not
            self.complaints.append(f"{message.type}: {message.text}")

    def _request(self, request: Request) -> None:
        address = urlsplit(request.url)
        if address.scheme not in ("data", "blob") and address.hostname not in LOOPBACK:
            self.complaints.append(f"leaves this machine: {request.url}")
