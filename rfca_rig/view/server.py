"""The view as a web application: a page, a stream of messages for it, and a way to request a stop."""

import asyncio
import json
import mimetypes
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, PlainTextResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp
from starlette.websockets import WebSocket, WebSocketDisconnect

from rfca_rig.trip_codes import Trip
from rfca_rig.view.admission import PROTOCOL, Admission
from rfca_rig.view.messages import Message
from rfca_rig.view.page_feed import Feed, FeedSource

STATIC = Path(__file__).with_name("static")
# Pages of trip codes: in a checkout, and in an installed package.
TRIPS = (Path(__file__).parents[2] / "docs" / "trips", Path(__file__).parents[1] / "shipped" / "docs" / "trips")
# Each page costs work at every beat, on the machine that runs the rig.
MOST_PAGES = 12
# WebSocket close code 1013, "try again later".
TRY_LATER = 1013
# Bytes of a stop request, which is some 20 bytes long; more is refused before it fills the memory.
LARGEST_BODY = 1000


class Beats:
    """Beat that all pages wait for."""

    def __init__(self) -> None:
        self._next = asyncio.Event()

    def notify_pages(self) -> None:
        """Wakes all waiting pages."""
        # A new event for each beat: a page that is slow simply waits for the next one, and misses nothing.
        struck, self._next = self._next, asyncio.Event()
        struck.set()

    async def heard(self) -> None:
        """Returns at the next beat."""
        await self._next.wait()


class Pages:
    """Open pages; `open` is their number."""

    def __init__(self, source: FeedSource, beats: Beats) -> None:
        self._source = source
        self._beats = beats
        self.open = 0

    async def stream(self, socket: WebSocket) -> None:
        """Serves one page until it is closed."""
        if self.open >= MOST_PAGES:
            # A browser learns code and reason only of a connection that was accepted.
            await socket.accept(PROTOCOL)
            await socket.close(TRY_LATER, f"{MOST_PAGES} pages are open already")
            return
        await socket.accept(PROTOCOL)
        self.open += 1
        try:
            await self._serve(socket)
        except WebSocketDisconnect:
            return
        finally:
            self.open -= 1

    async def _serve(self, socket: WebSocket) -> None:
        feed = self._source.feed()
        # Messages from the page are read in a task of their own; it ends when the page is closed.
        listener = asyncio.create_task(_listen(socket, feed))
        try:
            await socket.send_text(_text(self._source.hello()))
            while not listener.done():
                for message in feed.new_messages():
                    await socket.send_text(_text(message))
                await self._beats.heard()
        finally:
            listener.cancel()
            with suppress(asyncio.CancelledError, WebSocketDisconnect):
                await listener

    async def stop(self, request: Request) -> Response:
        """HTTP handler of a stop request, which goes to the run's one `StopRequest`."""
        try:
            is_asked = self._source.stop((await _read_body(request))["how"])
        except (LookupError, TypeError, ValueError):
            return PlainTextResponse('say {"how": "safe point"} or {"how": "now"}\n', 400)
        if not is_asked:
            return PlainTextResponse("nothing here can be stopped any more\n", 409)
        return PlainTextResponse("asked for\n", 202)


async def _listen(socket: WebSocket, feed: Feed) -> None:
    """Reads messages of the page until it is closed."""
    while True:
        # Invalid or deeply nested JSON, or a binary message (KeyError), is ignored: it must not end the stream.
        with suppress(ValueError, KeyError, RecursionError):
            message = json.loads(await socket.receive_text())
            if isinstance(message, dict):
                feed.hear(message)


async def _read_body(request: Request) -> Mapping[str, Any]:
    body = b""
    async for piece in request.stream():
        body += piece
        if len(body) > LARGEST_BODY:
            raise ValueError("too long")
    try:
        body_object = json.loads(body)
    except RecursionError as error:
        raise ValueError("nested too deeply") from error
    if not isinstance(body_object, dict):
        raise ValueError("no object")
    return body_object


def _text(message: Message) -> str:
    return json.dumps(message, allow_nan=False, separators=(",", ":"))


async def _page(_request: Request) -> Response:
    return FileResponse(STATIC / "index.html")


async def _confirm_admission(_request: Request) -> Response:
    """HTTP handler for a page that asks whether its token is right; others do not come so far."""
    return Response(status_code=204)


async def _trip(request: Request) -> Response:
    """HTTP handler for the documentation of a trip code."""
    # Only known codes become a file name, so that no path can leave the folder.
    code = request.path_params["code"]
    files = [folder / f"{code}.md" for folder in TRIPS] if code in set(Trip) else []
    for file in files:
        if file.is_file():
            return PlainTextResponse(file.read_text(encoding="utf-8"))
    return PlainTextResponse(f"nothing is known here of {code}\n", 404)


def application(pages: Pages, token: str) -> ASGIApp:
    """The whole web application, behind the access control."""
    # Some machines map .js to text/plain, and browsers then refuse the page's modules.
    mimetypes.add_type("text/javascript", ".js")
    routes = [
        Route("/", _page),
        Route("/admitted", _confirm_admission),
        Route("/stop", pages.stop, methods=["POST"]),
        WebSocketRoute("/stream", pages.stream),
        Route("/trips/{code}", _trip),
        Mount("/static", StaticFiles(directory=STATIC, check_dir=False)),
    ]
    return Admission(Starlette(routes=routes), token)
