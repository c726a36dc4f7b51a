"""Access control of the view: a request needs the token, and must come from this machine and from a page of this server.

The page reads the token from the fragment of its own address, which browsers never send. It presents it in a header: as a bearer, and where
a browser sets no headers, on a WebSocket, as the second subprotocol. No cookie holds it: browsers send those to every port of a host.

A page from elsewhere, open in the same browser, can send requests to this machine. It does not know the token, and its Origin differs.
A domain name that resolves to this machine (DNS rebinding) shows in Host.
"""

from collections.abc import Sequence
from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from rfca_rig.view.run_facts import is_token

LOOPBACK = ("127.0.0.1", "localhost", "::1")
# Served without a token: the empty page, scripts, style sheets and documentation, nothing of any run.
PAGE = "/"
FOR_ALL = ("/static/", "/trips/")
# Subprotocol of the stream. Its client names the token as a second one, which is never chosen.
PROTOCOL = "rfca-view"
BEARER = "Bearer"
# default-src 'self': the page loads nothing from elsewhere. no-referrer: linked pages do not learn of the view.
# frame-ancestors 'none': no other page can frame this one and make the operator click on its stop button unawares.
POLICY = {
    "content-security-policy": "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data:; frame-ancestors 'none'",
    "referrer-policy": "no-referrer",
    "x-content-type-options": "nosniff",
    "cache-control": "no-store",
    # One request per connection: one that is kept open may be closed at the moment at which a stop is sent on it.
    "connection": "close",
}
REFUSED = 1008  # websocket: policy violation


class Admission:
    """ASGI middleware that passes only admitted requests to the wrapped application."""

    def __init__(self, application: ASGIApp, token: str) -> None:
        self._application = application
        self._token = token

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            await self._application(scope, receive, send)
            return
        refusal, send = self._refusal(scope), _with_policy(send)
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
        hosts, origins = headers.getlist("host"), headers.getlist("origin")
        # Exactly one Host: with two, this check and the server could go by different ones.
        if len(hosts) != 1 or not is_loopback(f"//{hosts[0]}"):
            return "only for this machine"
        # Browsers send Origin with every WebSocket and every POST; programs such as curl send none and need the token only.
        if origins and not _is_same(origins, hosts[0]):
            return "only for pages from here"
        if scope["type"] == "http" and (scope["path"] == PAGE or scope["path"].startswith(FOR_ALL)):
            return ""
        return "" if self._has_token(scope, headers) else "the token is missing or wrong; open the address that was printed"

    def _has_token(self, scope: Scope, headers: Headers) -> bool:
        given = scope["subprotocols"] if scope["type"] == "websocket" else " ".join(headers.getlist("authorization")).split()
        return len(given) == 2 and given[0] == (PROTOCOL if scope["type"] == "websocket" else BEARER) and is_token(given[1], self._token)


def _with_policy(send: Send) -> Send:
    """Every response has the headers of POLICY, files of /static too."""

    async def send_with_policy(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            for name, value in POLICY.items():
                headers[name] = value
        await send(message)

    return send_with_policy


def is_loopback(address: str) -> bool:
    """Whether the host of an address is a loopback name, which no DNS server of somebody else can define."""
    try:
        return urlsplit(address).hostname in LOOPBACK
    except ValueError:
        return False


def _is_same(origins: Sequence[str], host: str) -> bool:
    return len(origins) == 1 and origins[0].lower() == f"http://{host.lower()}"
