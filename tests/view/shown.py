"""The page in a browser on the scripted server, as tests hold it."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from playwright.sync_api import Page, ViewportSize

from tests.view import messages
from tests.view.browser import PATIENCE_MS, WatchedPage, browser
from tests.view.scripted_server import TOKEN, ScriptedServer, serving

DESKTOP = ViewportSize(width=1280, height=800)


@dataclass
class Shown:
    """A page, and the server it looks at."""

    server: ScriptedServer
    page: Page
    watched: WatchedPage

    def opened(self) -> "Shown":
        """The page anew, as if it had just been opened."""
        self.page.goto("about:blank")
        self.server.heard.clear()
        self.page.goto(f"http://127.0.0.1:{self.server.port}/#token={TOKEN}")
        self.page.wait_for_function("() => window.rfcaView?.shown.state")
        return self

    def told(self) -> "Shown":
        """The page as it is, told the hello and the state by the server, which is much quicker."""
        self.server.say(self.server.hello, {**self.server.state, "serial": time.monotonic()})
        self.page.wait_for_function(
            "serial => rfcaView.shown.state.serial === serial", arg=self.server.state["serial"]
        )
        return self

    def brought(
        self,
        hello: dict[str, Any] | None = None,
        state: dict[str, Any] | None = None,
        anew: bool = False,
    ) -> "Shown":
        """The page at that hello and state; `anew` opens it again, for tests of what a page
        remembers.
        """
        self.server.begin(hello or messages.hello(), state or messages.state())
        if anew or not self.server.has_pages:
            return self.opened()
        return self.told()


@contextmanager
def one_page_shown() -> Iterator[Shown]:
    """One browser, one page, one server."""
    server = ScriptedServer()
    with browser() as started, serving(server):
        watched = WatchedPage(started.new_page(viewport=DESKTOP))
        yield Shown(server, watched.page, watched)


def painted(shown: Shown) -> None:
    """Returns when what was sent is drawn: messages come in order, so the page has them all once
    it has the last one.
    """
    shown.server.say({**shown.server.state, "serial": time.monotonic()})
    shown.page.wait_for_function(
        "serial => rfcaView.shown.state.serial === serial", arg=shown.server.state["serial"]
    )
    frames = (
        "() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => "
        "requestAnimationFrame(done))))"
    )
    shown.page.evaluate(frames)


def heard(shown: Shown, kind: str) -> list[dict[str, Any]]:
    """What the page sent of that kind, once there is some."""
    for _ in range(round(PATIENCE_MS / 10.0)):
        found = [message for message in shown.server.heard if message["kind"] == kind]
        if found:
            return found
        shown.page.wait_for_timeout(10)
    return []
