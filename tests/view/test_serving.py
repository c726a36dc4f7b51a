"""The view's server against clients that send too much, too little, too slowly or nonsense: one
refusal each, and the page goes on.
"""

import asyncio
import json
import logging
import resource
import socket
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import pytest
from websockets.exceptions import ConnectionClosed

from rfca_rig.view import server
from rfca_rig.view.run_queue import url_of
from rfca_rig.view.server import MOST_PAGES
from tests.view.pages import asked_to_stop, got, posted, stream_of
from tests.waiting import wait_for

TOKEN = "Vr5UP1U5KcYRKtLTgvuAyMsX2-D6plbd"
HEAD = f"Host: 127.0.0.1\r\nAuthorization: Bearer {TOKEN}\r\n"


class Nothing:
    """A source with nothing to tell but a hello; remembers what it was told."""

    def __init__(self) -> None:
        self.heard: list[object] = []
        self.pauses: list[bool] = []

    def hello(self):
        return {"kind": "hello"}

    def feed(self):
        return self

    def new_messages(self):
        return ()

    def handle_message(self, said):
        self.heard.append(said)

    def stop(self, how):
        return {"now": True}[how]

    def pause(self, is_wanted):
        self.pauses.append(is_wanted)
        return is_wanted


@contextmanager
def served() -> Iterator[tuple[str, Nothing]]:
    """The address of a server in a thread, and its source."""
    source = Nothing()
    begun = threading.Event()
    listening = server.listen_on(0)
    over = []

    async def serve() -> None:
        over.append((asyncio.get_running_loop(), asyncio.Event()))
        begun.set()
        await server.serve(source, TOKEN, listening, over[0][1], lambda _pages: True)

    thread = threading.Thread(target=asyncio.run, args=(serve(),), daemon=True)
    thread.start()
    begun.wait(10.0)
    try:
        yield url_of(server.port_of(listening), TOKEN), source
    finally:
        over[0][0].call_soon_threadsafe(over[0][1].set)
        thread.join(20.0)


@pytest.fixture
def view(capfd, caplog) -> Iterator[tuple[str, Nothing]]:
    """A served view; at the end it still answers, and has printed nothing."""
    with served() as (url, source):
        yield url, source
        assert got(url, "/")[0] == 200
    said = capfd.readouterr()
    assert (said.out, said.err) == ("", "")
    assert not [record for record in caplog.get_records("call") if record.levelno > logging.INFO]


def connected(url: str) -> socket.socket:
    place = url.partition("//")[2].partition("/")[0].split(":")
    return socket.create_connection((place[0], int(place[1])), timeout=60.0)


def answered(url: str, *pieces: bytes) -> bytes:
    """What comes back until the server hangs up."""
    with connected(url) as client:
        found = b""
        try:
            for piece in pieces:
                client.sendall(piece)
            while received := client.recv(1 << 16):
                found += received
        except ConnectionError:
            pass
        return found


@pytest.mark.parametrize(
    "request_bytes",
    [
        b"\x00\x01\x02\xff" * 50 + b"\r\n\r\n",
        b"GET\r\n\r\n",
        b"GET / HTTP/9.9\r\n\r\n",
        b"GET / HTTP/1.1\r\n" + b"a: b\r\n" * 100_000 + b"\r\n",
        b"GET /" + b"a" * 1_000_000 + b" HTTP/1.1\r\n\r\n",
        b"POST /stop HTTP/1.1\r\nContent-Length: -5\r\n\r\n",
        b"POST /stop HTTP/1.1\r\nContent-Length: 5\r\nTransfer-Encoding: chunked\r\n\r\nzz\r\n",
        b"GET / HTTP/1.1\r\nHost: a\r\nHost: b\r\n\r\n",
        b"GET /\xff\xfe HTTP/1.1\r\n\r\n",
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03",
    ],
)
def test_a_request_that_is_none_is_refused_without_a_word_on_the_terminal(
    view, monkeypatch, request_bytes
):
    monkeypatch.setattr(server, "LONGEST_REQUEST_S", 1.0)
    found = answered(view[0], request_bytes)
    assert found == b"" or found.split(b" ")[1] in (b"400", b"403", b"405", b"431")
    assert b"Traceback" not in found


def test_paths_out_of_the_folder_and_odd_methods_are_refused(view):
    for target in (
        "/static/../server.py",
        "/static/%2e%2e/server.py",
        "/static//etc/passwd",
        "/static/%00",
        "/trips/../x",
        "/trips/%00",
    ):
        assert (
            answered(view[0], f"GET {target} HTTP/1.1\r\n{HEAD}\r\n".encode()).split(b" ")[1]
            == b"404"
        )
    for method in ("PUT", "DELETE", "TRACE", "OPTIONS", "GET"):
        assert (
            answered(view[0], f"{method} /stop HTTP/1.1\r\n{HEAD}\r\n".encode()).split(b" ")[1]
            == b"405"
        )


@pytest.mark.parametrize(
    "body",
    [
        b"[" * 900,
        b'{"how": ' * 100,
        b"\xff\xfe",
        b'{"how": 1e999}',
        b"null",
        b'{"how": {}}',
        b"a" * 5000,
    ],
)
def test_a_stop_that_makes_no_sense_is_refused(view, body):
    assert asked_to_stop(view[0], body) == 400


@pytest.mark.parametrize(
    ("body", "status"),
    [
        (b'{"how": "pause"}', 202),
        # Nothing is paused that could go on.
        (b'{"how": "continue", "confirmed": "nobody is near the leg"}', 409),
        (b'{"how": "continue"}', 400),
        (b'{"how": "continue", "confirmed": true}', 400),
        (b'{"how": "later"}', 400),
        (b'{"how": ["pause"]}', 400),
        (b"[" * 900, 400),
    ],
)
def test_a_pause_is_asked_for_plainly_and_its_end_with_a_confirmation(view, body, status):
    before = len(view[1].pauses)
    assert posted(view[0], "pause", body) == status
    assert len(view[1].pauses) == before + (status != 400)


def test_a_pause_without_the_token_is_refused(view):
    assert posted(view[0], "pause", b'{"how": "pause"}', Authorization="Bearer wrong") == 403
    assert posted(view[0], "pause", b'{"how": "pause"}', Origin="http://elsewhere.com") == 403


def test_an_endless_body_is_cut_off(view):
    head = f"POST /stop HTTP/1.1\r\n{HEAD}Content-Length: 1000000000\r\n\r\n".encode()
    assert answered(view[0], head, *[b"a" * 60_000] * 100)[:12] in (b"HTTP/1.1 400", b"")


@pytest.mark.parametrize(
    "begin",
    [
        b"",
        b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n",
        f"POST /stop HTTP/1.1\r\n{HEAD}Content-Length: 20\r\n\r\n{{".encode(),
    ],
)
def test_who_does_not_finish_a_request_is_hung_up_on(view, monkeypatch, begin):
    monkeypatch.setattr(server, "LONGEST_REQUEST_S", 0.3)
    assert answered(view[0], begin) == b""


def test_a_response_ends_its_connection_and_a_stream_outlasts_a_request(view, monkeypatch):
    assert (
        b"connection: close"
        in answered(view[0], b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n").lower()
    )
    # A busy machine may take more than a second to open a stream.
    monkeypatch.setattr(server, "LONGEST_REQUEST_S", 3.0)
    with stream_of(view[0]) as page:
        assert json.loads(page.recv())["kind"] == "hello"
        with pytest.raises(TimeoutError):
            page.recv(timeout=3.5)
        page.send('{"kind": "still here"}')


def test_more_connections_than_there_may_be_are_closed_and_pages_go_on(view, monkeypatch):
    monkeypatch.setattr(server, "MOST_CONNECTIONS", 20)
    with ExitStack() as crowd:
        page = crowd.enter_context(stream_of(view[0]))
        page.recv()
        others = [crowd.enter_context(connected(view[0])) for _ in range(60)]
        for client in others:
            client.settimeout(0.2)
        assert sum(is_closed(client) for client in others) >= 40
        page.send('{"kind": "still here"}')


def is_closed(client: socket.socket) -> bool:
    try:
        return client.recv(10) == b""
    except TimeoutError:
        return False
    except ConnectionError:
        return True


def test_a_page_too_many_is_told_why(view):
    with ExitStack() as pages:
        for _ in range(MOST_PAGES):
            pages.enter_context(stream_of(view[0])).recv()
        with stream_of(view[0]) as one_more, pytest.raises(ConnectionClosed) as closed:
            one_more.recv()
    assert (closed.value.rcvd.code, closed.value.rcvd.reason) == (
        1013,
        f"{MOST_PAGES} pages are open already",
    )


@pytest.mark.parametrize(
    "frames",
    [
        b"\xff" * 100,  # reserved bits and opcode
        b"\x81\x05hello",  # not masked
        b"\x81\xff\x7f\xff\xff\xff\xff\xff\xff\xff" + bytes(4),  # 2^63 bytes announced
        b"\x89\xfe\x01\x00" + bytes(260),  # a ping longer than a control frame may be
        b"\x81\x82" + bytes(4) + b"\xff\xfe",  # not UTF-8
        b"\x80\x80" + bytes(4),  # goes on with nothing
        b"\x88\x81" + bytes(4) + b"\x00",  # a close with half a code
    ],
)
def test_a_malformed_frame_closes_its_own_stream_only(view, frames):
    with stream_of(view[0]) as other:
        other.recv()
        with stream_of(view[0]) as page:
            page.recv()
            page.socket.sendall(frames)
            with pytest.raises(ConnectionClosed):
                while True:
                    page.recv(timeout=30.0)
        other.send('{"kind": "still here"}')


def test_nested_and_odd_messages_are_ignored_and_large_ones_close_the_stream(view):
    url, source = view
    with stream_of(url) as page:
        page.recv()
        for message in ("[" * 60_000, "{", "null", "3", b"\x00\xff", '{"a": 1e999}', "\x00"):
            page.send(message)
        page.send('{"kind": "last"}')
        wait_for(lambda: {"kind": "last"} in source.heard)
        assert source.heard[-1] == {"kind": "last"}
        page.send("a" * 100_000)
        with pytest.raises(ConnectionClosed) as closed:
            page.recv(timeout=30.0)
    assert closed.value.rcvd.code == 1009


@pytest.mark.skipif(sys.platform != "linux", reason="the limit of Unix")
def test_without_a_file_left_there_is_one_line_and_the_page_goes_on(capfd, monkeypatch):
    """The limit falls to what is open already, so that not one more connection can be accepted."""
    report = server._FailureReport.__call__
    failed = []

    def counted(self, loop, context):
        failed.append(context)
        report(self, loop, context)

    monkeypatch.setattr(server._FailureReport, "__call__", counted)
    monkeypatch.setattr(asyncio.constants, "ACCEPT_RETRY_DELAY", 0.05)
    limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    with served() as (url, source), stream_of(url) as page, ExitStack() as crowd:
        page.recv()
        clients = [crowd.enter_context(socket.socket()) for _ in range(4)]
        highest = max(client.fileno() for client in clients)
        place = url.partition("//")[2].partition("/")[0].split(":")
        resource.setrlimit(resource.RLIMIT_NOFILE, (highest + 1, limits[1]))
        try:
            for client in clients:
                client.connect((place[0], int(place[1])))
            wait_for(lambda: len(failed) >= 4 * server.BACKLOG)
            page.send('{"kind": "still here"}')
        finally:
            resource.setrlimit(resource.RLIMIT_NOFILE, limits)
    lines = capfd.readouterr().err.splitlines()
    assert lines == [
        (
            "the view takes no more connections until others are closed: Too many open files "
            "(ulimit -n)"
        )
    ]
    assert {"kind": "still here"} in source.heard
