"""Who may look, and who may stop: whoever was told the token, from this very machine, by a page that came from here.

A page from elsewhere, open in the same browser, can send requests to this machine. It does not know the token, its Origin is another
one, and a name of its own that leads here (DNS rebinding) is in Host.
"""

from collections.abc import Sequence
from urllib.parse import parse_qs, urlsplit

from starlette.datastructures import Headers
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Receive, Scope, Send

from rfca_rig.view.access_token import is_token

LOOPBACK = ("127.0.0.1", "localhost", "::1")
FOR_ALL = ("/static/", "/trips/")  # nothing of any run is there
POLICY = {
    "content-security-policy": "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data:; frame-ancestors 'none'",
    "referrer-policy": "no-referrer",
    "x-content-type-options": "nosniff",
    "cache-control": "no-store",
}
REFUSED = 1008  # websocket: policy violation


class Admission:
    """An ASGI application before another one, which hears only of what is admitted."""

    def __init__(self, application: ASGIApp, token: str) -> None:
        self._application = application
        self._token = token

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            await self._application(scope, receive, send)
            return
        refusal = self._refusal(scope)
        if not refusal:
            await self._application(scope, receive, send)
        elif scope["type"] == "websocket":
            await receive()
            await send({"type": "websocket.close", "code": REFUSED, "reason": refusal})
        else:
            await PlainTextResponse(f"{refusal}\n", 403, POLICY)(scope, receive, send)

    def _refusal(self, scope: Scope) -> str:
        """Why not; "" for one who may."""
        headers = Headers(scope=scope)
        hosts, origins = headers.getlist("host"), headers.getlist("origin")
        if len(hosts) != 1 or not is_loopback(f"//{hosts[0]}"):
            return "only for this machine"
        if origins and not _is_same(origins, hosts[0]):
            return "only for pages from here"
        if scope["path"].startswith(FOR_ALL) and scope["type"] == "http":
            return ""
        return "" if self._has_token(scope) else "the token is missing or wrong; open the address that was printed"

    def _has_token(self, scope: Scope) -> bool:
        given = parse_qs(scope["query_string"].decode("latin-1")).get("token", [])
        return len(given) == 1 and is_token(given[0], self._token)


def is_loopback(address: str) -> bool:
    """Whether the host of an address is this machine by a name that nobody else can give away."""
    try:
        return urlsplit(address).hostname in LOOPBACK
    except ValueError:
        return False


def _is_same(origins: Sequence[str], host: str) -> bool:
    return len(origins) == 1 and origins[0].lower() == f"http://{host.lower()}"
