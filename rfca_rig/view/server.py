"""The view as a web application: a page, a stream of messages for it, and a way to request a stop.

The server is bound to this machine only; it runs until its `beat` ends it.
"""

import asyncio
import errno
import json
import logging
import mimetypes
import os
import socket
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import h11
import uvicorn
from starlette.applications import Starlette
from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import Request
from starlette.responses import FileResponse, PlainTextResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, Receive, Scope, Send
from starlette.types import Message as AsgiMessage
from starlette.websockets import WebSocket, WebSocketDisconnect
from uvicorn.protocols.http.h11_impl import H11Protocol

from rfca_rig.errors import NO_SUCH_ADDRESS, BadInput, Trip
from rfca_rig.view.messages import BEATS_HZ, Feed, FeedSource, Message
from rfca_rig.view.run_facts import is_token
from rfca_rig.view.run_queue import HOST

STATIC = Path(__file__).with_name("static")
# Pages of trip codes: in a checkout, and in an installed package.
TRIPS = (
    Path(__file__).parents[2] / "docs" / "trips",
    Path(__file__).parents[1] / "shipped" / "docs" / "trips",
)
# Each page costs work at every beat, on the machine that runs the rig.
MOST_PAGES = 12
# WebSocket close code 1013, "try again later".
TRY_LATER = 1013
# Bytes of a stop request, which is some 20 bytes long; more is refused before it fills the memory.
LARGEST_BODY = 1000

DEBUG_VARIABLE = "RFCA_RIG_DEBUG"
# Time in s that open connections get to close at the end.
CLOSED_WITHIN_S = 1
# Of all pages and requests. 12 pages with a browser's 6 connections each are 72 while they load; of
# 1024 files that a process may usually have open, the run's own take some 50.
MOST_CONNECTIONS = 128
# Connections that wait to be accepted. asyncio accepts so many at once, before the first of them
# can be refused. Where no file is left it fails so often in a row: with uvicorn's 2048 that were
# 2048 complaints a second. A browser opens 6 at once.
BACKLOG = 32
# From a connection's begin to the end of its one response, which takes milliseconds on this
# machine.
LONGEST_REQUEST_S = 10.0

LOOPBACK = ("127.0.0.1", "localhost", "::1")
# Served without a token: the empty page, scripts, style sheets and documentation, nothing of any
# run.
PAGE = "/"
FOR_ALL = ("/static/", "/trips/")
# Subprotocol of the stream. Its client names the token as a second one, which is never chosen.
PROTOCOL = "rfca-view"
BEARER = "Bearer"
# default-src 'self': the page loads nothing from elsewhere. no-referrer: linked pages do not learn
# of the view. frame-ancestors 'none': no other page can frame this one and make the operator click
# on its stop button unawares.
POLICY = {
    "content-security-policy": (
        "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data:; "
        "frame-ancestors 'none'"
    ),
    "referrer-policy": "no-referrer",
    "x-content-type-options": "nosniff",
    "cache-control": "no-store",
    # One request per connection: one that is kept open may be closed at the moment at which a stop
    # is sent on it.
    "connection": "close",
}
# Whether a pause is wanted, by the word that a page sends.
PAUSE_HOWS = {"pause": True, "continue": False}
CLEAR = "nobody is near the leg"
SAY_PAUSE = f'say {{"how": "pause"}}, or {{"how": "continue", "confirmed": "{CLEAR}"}}'
REFUSED = 1008  # websocket: policy violation


class Beats:
    """Beat that all pages wait for."""

    def __init__(self) -> None:
        self._next = asyncio.Event()

    def notify_pages(self) -> None:
        """Wakes all waiting pages."""
        # A new event for each beat: a page that is slow simply waits for the next one, and misses
        # nothing.
        struck = self._next
        self._next = asyncio.Event()
        struck.set()

    async def wait(self) -> None:
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
                await self._beats.wait()
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

    async def pause(self, request: Request) -> Response:
        """HTTP handler of a pause and of its end. The end of a pause starts motion again, so it
        names what the operator has looked at.
        """
        try:
            body = await _read_body(request)
            is_wanted = PAUSE_HOWS[body["how"]]
        except (LookupError, TypeError, ValueError):
            return PlainTextResponse(f"{SAY_PAUSE}\n", 400)
        if not is_wanted and body.get("confirmed") != CLEAR:
            return PlainTextResponse(f"{SAY_PAUSE}\n", 400)
        if not self._source.pause(is_wanted):
            return PlainTextResponse("that would change nothing\n", 409)
        return PlainTextResponse("asked for\n", 202)


async def _listen(socket: WebSocket, feed: Feed) -> None:
    """Reads messages of the page until it is closed."""
    while True:
        # Invalid or deeply nested JSON, or a binary message (KeyError), is ignored: it must not end
        # the stream.
        with suppress(ValueError, KeyError, RecursionError):
            message = json.loads(await socket.receive_text())
            if isinstance(message, dict):
                feed.handle_message(message)


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
    if code in set(Trip):
        files = [folder / f"{code}.md" for folder in TRIPS]
    else:
        files = []
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
        Route("/pause", pages.pause, methods=["POST"]),
        WebSocketRoute("/stream", pages.stream),
        Route("/trips/{code}", _trip),
        Mount("/static", StaticFiles(directory=STATIC, check_dir=False)),
    ]
    return Admission(Starlette(routes=routes), token)


class BoundedProtocol(H11Protocol):
    """HTTP for one request per connection, within a time, on no more than MOST_CONNECTIONS; a
    WebSocket may stay.

    Clients that send nothing, or a byte now and then, would otherwise hold their connections for
    ever.
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
    """A socket that listens on a port of this machine, 0 for any free port. Raises BadInput
    where it cannot.
    """
    # Bound before the server starts, so that an occupied port is an error of the command and the
    # port is known.
    listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    # A port whose last server ended a moment ago can be used again at once.
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((HOST, port))
        listening.listen()
    except OSError as error:
        listening.close()
        if error.errno == errno.EADDRINUSE:
            raise BadInput(
                f"port {port} is taken; name another one, or none for any that is free"
            ) from None
        if error.errno == errno.EADDRNOTAVAIL:
            raise BadInput(f"cannot listen on {HOST}: {NO_SUCH_ADDRESS}") from None
        raise BadInput(f"port {port} cannot be listened on: {error}; name another one") from None
    return listening


def port_of(listening: socket.socket) -> int:
    return int(listening.getsockname()[1])


async def serve(
    source: FeedSource,
    token: str,
    listening: socket.socket,
    ended: asyncio.Event,
    beat: Callable[[Pages], bool],
) -> None:
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
        # No start-up events, and no log: the terminal belongs to the run, and any client can make a
        # server complain of its requests.
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
    # A page notices that its socket is closed only at a beat, so beats go on until the server has
    # ended.
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
    """Exception handler of the loop: that no file is left for a connection is one line, not one
    per attempt.
    """

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
            print(
                (
                    "the view takes no more connections until others are closed: "
                    f"{error.strerror} (ulimit -n)"
                ),
                file=sys.stderr,
            )


class Admission:
    """ASGI middleware that passes only admitted requests to the wrapped application.

    A request needs the token, and must come from this machine and from a page of this server. The
    page reads the token from the fragment of its own address, which browsers never send. It
    presents it in a header: as a bearer, and where a browser sets no headers, on a WebSocket, as
    the second subprotocol. No cookie holds it: browsers send those to every port of a host.

    A page from elsewhere, open in the same browser, can send requests to this machine. It does not
    know the token, and its Origin differs. A domain name that resolves to this machine (DNS
    rebinding) shows in Host.
    """

    def __init__(self, application: ASGIApp, token: str) -> None:
        self._application = application
        self._token = token

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            await self._application(scope, receive, send)
            return
        refusal = self._refusal(scope)
        send = _with_policy(send)
        if not refusal:
            await self._application(scope, receive, send)
        elif scope["type"] == "websocket":
            # ASGI requires that the connect event is received before the socket may be closed.
            await receive()
            await send({"type": "websocket.close", "code": REFUSED, "reason": refusal})
        else:
            await PlainTextResponse(f"{refusal}\n", 403)(scope, receive, send)

    def _refusal(self, scope: Scope) -> str:
        """Reason for a refusal, "" where the request is admitted."""
        headers = Headers(scope=scope)
        hosts = headers.getlist("host")
        origins = headers.getlist("origin")
        # Exactly one Host: with two, this check and the server could go by different ones.
        if len(hosts) != 1 or not is_loopback(f"//{hosts[0]}"):
            return "only for this machine"
        # Browsers send Origin with every WebSocket and every POST; programs such as curl send none
        # and need the token only.
        if origins and not _is_same(origins, hosts[0]):
            return "only for pages from here"
        if scope["type"] == "http" and (scope["path"] == PAGE or scope["path"].startswith(FOR_ALL)):
            return ""
        if self._has_token(scope, headers):
            return ""
        return "the token is missing or wrong; open the address that was printed"

    def _has_token(self, scope: Scope, headers: Headers) -> bool:
        if scope["type"] == "websocket":
            scheme = PROTOCOL
            given = scope["subprotocols"]
        else:
            scheme = BEARER
            given = " ".join(headers.getlist("authorization")).split()
        return len(given) == 2 and given[0] == scheme and is_token(given[1], self._token)


def _with_policy(send: Send) -> Send:
    """Every response has the headers of POLICY, files of /static too."""

    async def send_with_policy(message: AsgiMessage) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            for name, value in POLICY.items():
                headers[name] = value
        await send(message)

    return send_with_policy


def is_loopback(address: str) -> bool:
    """Whether the host of an address is a loopback name, which no DNS server of somebody else
    can define.
    """
    try:
        return urlsplit(address).hostname in LOOPBACK
    except ValueError:
        return False


def _is_same(origins: Sequence[str], host: str) -> bool:
    return len(origins) == 1 and origins[0].lower() == f"http://{host.lower()}"
