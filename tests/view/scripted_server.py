"""The view's server with nothing behind it: says to the page, message by message, what a test
tells it to, and notes what it is sent.
"""

import asyncio
import json
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocket, WebSocketDisconnect

import rfca_rig.view
from rfca_rig.view.server import PROTOCOL

STATIC = Path(rfca_rig.view.__file__).parent / "static"
TOKEN = "scripted"
STATE_EVERY_S = 0.2


class ScriptedServer:
    """`hello` and `state` are what a page gets when it comes, `state` every 0.2 s too while not
    `is_silent`.
    """

    def __init__(self) -> None:
        self.begin({}, {})
        self.port = 0
        self.loop: asyncio.AbstractEventLoop | None = None
        self._sockets: list[WebSocket] = []
        routes = [
            Route("/", self._page),
            Route("/admitted", self._admitted),
            Route("/stop", self._stop, methods=["POST"]),
            Route("/pause", self._pause, methods=["POST"]),
            WebSocketRoute("/stream", self._stream),
            Mount("/static", StaticFiles(directory=STATIC)),
        ]
        self.app = Starlette(routes=routes)

    def begin(self, hello: dict[str, Any], state: dict[str, Any]) -> None:
        """Forgets what was before."""
        self.hello = hello
        self.state = state
        self.is_silent = False
        self.stop_status = 202
        self.stops: list[dict[str, Any]] = []
        self.pauses: list[dict[str, Any]] = []
        self.heard: list[dict[str, Any]] = []

    @property
    def has_pages(self) -> bool:
        return bool(self._sockets)

    def say(self, *messages: dict[str, Any]) -> None:
        """To every page that is there."""
        assert self.loop is not None
        for message in messages:
            if message["kind"] == "state":
                self.state = message
            asyncio.run_coroutine_threadsafe(self._send(message), self.loop).result(60)

    def hang_up(self) -> None:
        """Closes every socket."""
        assert self.loop is not None
        for socket in list(self._sockets):
            asyncio.run_coroutine_threadsafe(socket.close(), self.loop).result(60)

    async def _send(self, message: dict[str, Any]) -> None:
        for socket in list(self._sockets):
            await socket.send_text(json.dumps(message))

    async def _page(self, _request: Request) -> Response:
        return FileResponse(STATIC / "index.html")

    async def _admitted(self, request: Request) -> Response:
        return Response(
            status_code=204 if request.headers.get("authorization") == f"Bearer {TOKEN}" else 403
        )

    async def _stop(self, request: Request) -> Response:
        if request.headers.get("authorization") != f"Bearer {TOKEN}":
            return Response(status_code=403)
        self.stops.append(await request.json())
        return Response(status_code=self.stop_status)

    async def _pause(self, request: Request) -> Response:
        if request.headers.get("authorization") != f"Bearer {TOKEN}":
            return Response(status_code=403)
        self.pauses.append(await request.json())
        return Response(status_code=self.stop_status)

    async def _stream(self, socket: WebSocket) -> None:
        if socket.scope["subprotocols"] != [PROTOCOL, TOKEN]:
            await socket.close(1008)
            return
        await socket.accept(PROTOCOL)
        self.loop = asyncio.get_running_loop()
        self._sockets.append(
            socket
        )  # before the page hears anything: whoever sees the state on it may hang up at once
        beat = asyncio.ensure_future(self._beat(socket))
        try:
            with suppress(WebSocketDisconnect):
                await self._talk(socket)
        finally:
            beat.cancel()
            self._sockets.remove(socket)

    async def _talk(self, socket: WebSocket) -> None:
        await socket.send_text(json.dumps(self.hello))
        await socket.send_text(json.dumps(self.state))
        while True:
            said = await socket.receive_text()
            self.heard.append(json.loads(said))  # into the list of now: a test may have begun since

    async def _beat(self, socket: WebSocket) -> None:
        with suppress(RuntimeError, WebSocketDisconnect):
            while True:
                await asyncio.sleep(STATE_EVERY_S)
                if not self.is_silent:
                    await socket.send_text(json.dumps(self.state))


@contextmanager
def serving(scripted: ScriptedServer) -> Iterator[None]:
    """Serves on loopback from a thread, at `scripted.port`."""
    server = uvicorn.Server(
        uvicorn.Config(
            scripted.app,
            host="127.0.0.1",
            port=0,
            log_level="error",
            ws="websockets-sansio",
            lifespan="off",
        )
    )
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    while not server.started:
        time.sleep(0.005)
    scripted.port = server.servers[0].sockets[0].getsockname()[1]
    try:
        yield
    finally:
        server.should_exit = server.force_exit = True
        thread.join(10)
