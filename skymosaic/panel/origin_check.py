"""Checks Host and Origin of every request before anything else of the panel sees it.

A page of another origin can reach a server on loopback through the user's browser: by a host name that its owner lets
resolve to 127.0.0.1, by forms and scripts, or by a websocket, which browsers do not confine to its own origin. The Host
header reveals the first, the Origin header the others.
"""

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocketClose

SAFE_METHODS = ("GET", "HEAD")
HTTP_PORT = 80
SOCKET_PATH = "/_nicegui_ws"
# NiceGUI compiles its templates in the browser, which needs 'unsafe-eval'; nothing is loaded from other servers.
CONTENT_POLICY = (
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; font-src 'self' data:; connect-src 'self'; frame-ancestors 'none'; base-uri 'self'; "
    "form-action 'self'; object-src 'none'"
)
HEADERS = {
    "content-security-policy": CONTENT_POLICY,
    "cross-origin-resource-policy": "same-origin",
    "referrer-policy": "no-referrer",
    "x-content-type-options": "nosniff",
}


class OriginCheck:
    """Refuses requests that do not come from the panel's own page, and adds the headers that confine that page."""

    def __init__(self, app: ASGIApp, port: int) -> None:
        self.app = app
        names = ("127.0.0.1", "localhost", "[::1]")
        self._hosts = {f"{name}:{port}" for name in names}
        # Browsers leave out the port that is HTTP's own.
        self._hosts |= set(names) if port == HTTP_PORT else set()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a foreign request with 403 and pass on every other."""
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
            return
        reason = self._refusal(scope, Headers(scope=scope))
        if reason and scope["type"] == "websocket":
            await WebSocketClose(reason=reason)(scope, receive, send)
        elif reason:
            await PlainTextResponse(f"refused: {reason}\n", status_code=403, headers=HEADERS)(scope, receive, send)
        else:
            await self.app(scope, receive, _with_headers(send))

    def _refusal(self, scope: Scope, headers: Headers) -> str:
        """Why the request is refused; empty if it is accepted."""
        if headers.get("host") not in self._hosts:
            return "the Host is not this panel's; open the address that the panel printed"
        # Socket.IO's polling would let a plain GET act, which no Origin accompanies.
        if scope["type"] == "http" and scope["path"].startswith(SOCKET_PATH):
            return "this path accepts websockets only"
        acts = scope["type"] == "websocket" or scope["method"] not in SAFE_METHODS
        is_own = headers.get("origin", "").removeprefix("http://") in self._hosts
        return "the Origin is not this panel's" if acts and not is_own else ""


def _with_headers(send: Send) -> Send:
    async def sender(message: Message) -> None:
        if message["type"] == "http.response.start":
            MutableHeaders(scope=message).update(HEADERS)
        await send(message)

    return sender
