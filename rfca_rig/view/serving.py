"""Web server around a source of messages: bound to this machine only, it runs until its `beat` ends it."""

import asyncio
import errno
import socket
from collections.abc import Callable

import uvicorn

from rfca_rig.errors import BadInput
from rfca_rig.view.live_view import HOST
from rfca_rig.view.page_feed import BEATS_HZ, FeedSource
from rfca_rig.view.server import Beats, Pages, application

# Time in s that open connections get to close at the end.
CLOSED_WITHIN_S = 1


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
    beats = Beats()
    pages = Pages(source, beats)
    config = uvicorn.Config(
        application(pages, token),
        # No start-up events, and no log: the terminal belongs to the run, and an access log would show the token.
        lifespan="off",
        log_config=None,
        access_log=False,
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
