"""Web server around a source of messages: bound to this machine only, it runs until its `beat` ends it."""

import asyncio
import errno
import logging
import os
import socket
import sys
from collections.abc import Callable
from typing import Any

import h11
import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from rfca_rig.errors import BadInput
from rfca_rig.view.live_view import HOST
from rfca_rig.view.page_feed import BEATS_HZ, FeedSource
from rfca_rig.view.server import Beats, Pages, application

DEBUG_VARIABLE = "RFCA_RIG_DEBUG"
# Time in s that open connections get to close at the end.
CLOSED_WITHIN_S = 1
# Of all pages and requests. 12 pages with a browser's 6 connections each are 72 while they load; of 1024 files that a process may usually
# have open, the run's own take some 50.
MOST_CONNECTIONS = 128
# Connections that wait to be accepted. asyncio accepts so many at once, before the first of them can be refused. Where no file is left
# it fails so often in a row: with uvicorn's 2048 that were 2048 complaints a second. A browser opens 6 at once.
BACKLOG = 32
# From a connection's begin to the end of its one response, which takes milliseconds on this machine.
LONGEST_REQUEST_S = 10.0


class BoundedProtocol(H11Protocol):
    """HTTP for one request per connection, within a time, on no more than MOST_CONNECTIONS; a WebSocket may stay.

    Clients that send nothing, or a byte now and then, would otherwise hold their connections for ever.
    """

    _expiry: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        if len(self.connections) > MOST_CONNECTIONS:
            transport.abort()
            return
        self._expiry = self.loop.call_later(LONGEST_REQUEST_S, transport.abort)

    def connection_lost(self, exc: Exception | None) -> None:
        self._keep()
        super().connection_lost(exc)

    def handle_websocket_upgrade(self, event: h11.Request) -> None:
        self._keep()
        super().handle_websocket_upgrade(event)

    def _keep(self) -> None:
        if self._expiry is not None:
            self._expiry.cancel()


def listen_on(port: int) -> socket.socket:
    """A socket that listens on a port of this machine, 0 for any free port. Raises BadInput where it cannot."""
    # Bound before the server starts, so that an occupied port is an error of the command and the port is known.
    listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    # A port whose last server ended a moment ago can be used again at once.
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((HOST, port))
        listening.listen()
    except OSError as error:
        listening.close()
        if error.errno == errno.EADDRINUSE:
            raise BadInput(f"port {port} is taken; name another one, or none for any that is free") from None
        raise BadInput(f"port {port} cannot be listened on: {error}; name another one") from None
    return listening


def port_of(listening: socket.socket) -> int:
    return int(listening.getsockname()[1])


async def serve(source: FeedSource, token: str, listening: socket.socket, ended: asyncio.Event, beat: Callable[[Pages], bool]) -> None:
    """Serves pages until `beat` returns False or `ended` is set.

    Parameters
    ----------
    source
        Source of the messages.
    token
        Token that requests must carry.
    listening
        Socket from `listen_on`.
    ended
        Set from outside to end the server.
    beat
        Called at every beat with the open pages; returns whether to go on.
    """
    asyncio.get_running_loop().set_exception_handler(_FailureReport(listening))
    beats = Beats()
    pages = Pages(source, beats)
    config = uvicorn.Config(
        application(pages, token),
        # No start-up events, and no log: the terminal belongs to the run, and any client can make a server complain of its requests.
        lifespan="off",
        log_config=None,
        log_level=None if os.environ.get(DEBUG_VARIABLE) else logging.CRITICAL,
        access_log=False,
        http=BoundedProtocol,
        backlog=BACKLOG,
        ws="websockets-sansio",
        ws_max_size=65536,
        ws_per_message_deflate=False,
        timeout_graceful_shutdown=CLOSED_WITHIN_S,
        server_header=False,
    )
    server = uvicorn.Server(config)
    serving = asyncio.create_task(server.serve(sockets=[listening]))
    while not serving.done() and not ended.is_set() and beat(pages):
        beats.notify_pages()
        await _next_beat(ended)
    server.should_exit = True
    # A page notices that its socket is closed only at a beat, so beats go on until the server has ended.
    while not serving.done():
        beats.notify_pages()
        await asyncio.wait([serving], timeout=1.0 / BEATS_HZ)
    await serving


async def _next_beat(ended: asyncio.Event) -> None:
    try:
        await asyncio.wait_for(ended.wait(), 1.0 / BEATS_HZ)
    except TimeoutError:
        return


class _FailureReport:
    """Exception handler of the loop: that no file is left for a connection is one line, not one per attempt."""

    def __init__(self, listening: socket.socket) -> None:
        self._listening = listening
        self._is_announced = False

    def __call__(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        error = context.get("exception")
        # asyncio's second attempt to accept, after the server has ended.
        if isinstance(error, ValueError) and self._listening.fileno() < 0:
            return
        if not (isinstance(error, OSError) and error.errno in (errno.EMFILE, errno.ENFILE)):
            loop.default_exception_handler(context)
        elif not self._is_announced:
            self._is_announced = True
            print(f"the view takes no more connections until others are closed: {error.strerror} (ulimit -n)", file=sys.stderr)
