"""A page without a browser: what a view's process says to whoever opens it."""

import json
import threading
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from rfca_rig.view.server import PROTOCOL


def stream_of(url: str, **more: object) -> ClientConnection:
    """The stream of a page at that address; the token goes where a browser puts it."""
    place, _, token = url.partition("/#token=")
    protocols = [Subprotocol(PROTOCOL), Subprotocol(token)]
    return connect(
        f"ws{place.removeprefix('http')}/stream",
        subprotocols=protocols,
        max_size=None,
        compression=None,
        **more,
    )


def asked_to_stop(url: str, body: bytes, **headers: str) -> int:
    """The status of the answer."""
    return posted(url, "stop", body, **headers)


def posted(url: str, path: str, body: bytes, **headers: str) -> int:
    """The status of the answer."""
    place, _, token = url.partition("/#token=")
    headers = {"Authorization": f"Bearer {token}", **headers}
    request = urllib.request.Request(f"{place}/{path}", data=body, headers=headers, method="POST")
    try:
        with urllib.request.urlopen(request, timeout=60.0) as answer:
            return int(answer.status)
    except urllib.error.HTTPError as refused:
        return refused.code


def got(url: str, path: str) -> tuple[int, str, str]:
    """Status, text and kind of what is there, without the token."""
    try:
        with urllib.request.urlopen(f"{url.partition('/#')[0]}{path}", timeout=60.0) as answer:
            return int(answer.status), answer.read().decode(), answer.headers["content-type"]
    except urllib.error.HTTPError as refused:
        return refused.code, "", ""


class Page:
    """Gathers every message, with the thread that reads them."""

    def __init__(self, socket: ClientConnection) -> None:
        self._socket = socket
        self.messages: list[dict] = []
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        try:
            while True:
                self.messages.append(json.loads(self._socket.recv()))
        except ConnectionClosed:
            return

    def all_after_end(self, within_s: float = 30.0) -> list[dict]:
        """Waits for the state that says how the run ended, or for the end of the view."""
        waited = threading.Event()
        for _ in range(int(within_s / 0.02)):
            if (
                any(message["kind"] == "state" and message["ended"] for message in self.messages)
                or not self._thread.is_alive()
            ):
                return list(self.messages)
            waited.wait(0.02)
        raise AssertionError("no word of the run's end")


@contextmanager
def opened(url: str) -> Iterator[Page]:
    with stream_of(url) as socket:
        yield Page(socket)
