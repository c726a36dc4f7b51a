"""Who is let in: only with the token, only from this machine, never a page from elsewhere."""

import asyncio

import pytest

from rfca_rig.view.run_facts import new_token
from rfca_rig.view.server import Admission

TOKEN = "Vr5UP1U5KcYRKtLTgvuAyMsX2-D6plbd"  # the names of tests must be the same in every process
HERE = {"host": "127.0.0.1:8650"}


def asked(kind="http", path="/stop", token=TOKEN, headers=HERE):
    """What became of a request: "in", or what was sent instead."""
    sent = []

    async def application(scope, receive, send):
        sent.append("in")

    async def receive():
        return {"type": "websocket.connect"}

    async def send(message):
        sent.append(message)

    pairs = list(headers.items() if isinstance(headers, dict) else headers)
    if token is not None and kind == "http":
        pairs.append(("authorization", f"Bearer {token}"))
    scope = {
        "type": kind,
        "path": path,
        "query_string": f"token={TOKEN}".encode(),  # an address may hold it, but no address opens
        "subprotocols": [] if token is None else ["rfca-view", token],
        "headers": [(name.encode(), value.encode()) for name, value in pairs],
    }
    asyncio.run(Admission(application, TOKEN)(scope, receive, send))
    return sent[0]


def test_every_response_has_the_headers_of_the_policy():
    sent = []

    async def application(scope, receive, send):
        await send(
            {
                "type": "http.response.start",
                "status": 200,
                "headers": [(b"cache-control", b"max-age=99")],
            }
        )

    async def send(message):
        sent.append(message)

    scope = {
        "type": "http",
        "path": "/static/view.js",
        "query_string": b"",
        "headers": [(b"host", b"127.0.0.1:8650")],
    }
    asyncio.run(Admission(application, TOKEN)(scope, None, send))
    headers = dict(sent[0]["headers"])
    assert headers[b"x-content-type-options"] == b"nosniff"
    assert b"default-src 'self'" in headers[b"content-security-policy"]
    assert headers[b"cache-control"] == b"no-store"


def is_refused(found):
    return found != "in" and (found.get("status") == 403 or found["type"] == "websocket.close")


@pytest.mark.parametrize("kind", ["http", "websocket"])
@pytest.mark.parametrize("host", ["127.0.0.1:8650", "localhost:8650", "LOCALHOST", "[::1]:8650"])
def test_the_token_from_this_machine_opens(kind, host):
    assert asked(kind, headers={"host": host}) == "in"
    assert asked(kind, headers={"host": host, "origin": f"http://{host}"}) == "in"


@pytest.mark.parametrize("kind", ["http", "websocket"])
@pytest.mark.parametrize(
    "token", [None, "", TOKEN[:-1], f"{TOKEN}x", f"{TOKEN} {TOKEN}", "\xff\xfe"]
)
def test_without_the_token_in_its_header_nothing_opens(kind, token):
    assert is_refused(asked(kind, token=token))


def test_a_token_that_is_offered_otherwise_opens_nothing():
    for authorization in (TOKEN, f"Basic {TOKEN}", f"rfca-view {TOKEN}"):
        assert is_refused(asked(token=None, headers={**HERE, "authorization": authorization}))
    assert is_refused(asked(token=None, headers={**HERE, "cookie": f"token={TOKEN}"}))
    assert is_refused(
        asked("websocket", token=None, headers={**HERE, "authorization": f"Bearer {TOKEN}"})
    )
    assert is_refused(asked(headers=[*HERE.items(), ("authorization", f"Bearer {TOKEN}")]))


@pytest.mark.parametrize("kind", ["http", "websocket"])
@pytest.mark.parametrize(
    "host",
    [
        "rig.example.com",
        "127.0.0.1.example.com",
        "127.0.0.1@example.com",
        "0.0.0.0:8650",
        "192.168.1.5:8650",
        "",
        "[::1",
    ],
)
def test_another_name_for_this_machine_is_refused_though_the_token_is_right(kind, host):
    assert is_refused(asked(kind, headers={"host": host}))


@pytest.mark.parametrize("kind", ["http", "websocket"])
@pytest.mark.parametrize(
    "origin",
    [
        "http://example.com",
        "null",
        "https://127.0.0.1:8650",
        "http://127.0.0.1:80",
        "http://localhost:8650",
        "",
    ],
)
def test_a_page_from_elsewhere_is_refused_though_the_token_is_right(kind, origin):
    assert is_refused(asked(kind, headers={**HERE, "origin": origin}))


def test_two_hosts_or_none_are_refused():
    assert is_refused(asked(headers=[("host", "127.0.0.1"), ("host", "example.com")]))
    assert is_refused(asked(headers={}))


def test_the_page_s_own_files_need_no_token_but_do_need_this_machine():
    for path in ("/", "/static/view.js"):
        assert asked(path=path, token=None) == "in"
        assert is_refused(asked(path=path, token=None, headers={"host": "example.com"}))
        assert is_refused(asked("websocket", path, token=None))
    assert is_refused(asked(path="/statics", token=None)) and is_refused(
        asked(path="/admitted", token=None)
    )
    assert is_refused(asked("websocket", "/static/../stream", token=None))


def test_tokens_differ_and_are_long():
    assert len({new_token() for _ in range(50)}) == 50 and len(TOKEN) >= 32
