"""Who may talk to the panel: Host and Origin of every request, checked before anything else sees it.

A web page of any other origin can reach a server on loopback through its session's browser: by a name that it lets
resolve to 127.0.0.1 (the Host gives it away), by forms and scripts, or by a websocket, which no browser confines to
its own origin (the Origin gives these away).
"""

from __future__ import annotations

from starlette.datastructures import Headers
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocketClose

SAFE_METHODS = ("GET", "HEAD")
SOCKET_PATH = "/_nicegui_ws"
# The page's framework compiles its templates in the browser, which needs 'unsafe-eval'; everything comes from here.
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
    """Refuses what does not come from the panel's own page; adds the headers that confine that page.

    Parameters
    ----------
    app : ASGI application
    port : int
        Of the server; with the loopback names it makes the only valid hosts and origins.
    """

    def __init__(self, app: ASGIApp, port: int) -> None:
        self.app = app
        self._hosts = {f"{name}:{port}" for name in ("127.0.0.1", "localhost", "[::1]")}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer 403 to a foreign request, pass on every other."""
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
            return
        reason = self._refusal(scope, Headers(scope=scope))
        if reason and scope["type"] == "websocket":
            await WebSocketClose(reason=reason)(scope, receive, send)
        elif reason:
            await PlainTextResponse(f"refused: {reason}\n", status_code=403)(scope, receive, send)
        else:
            await self.app(scope, receive, _with_headers(send))

    def _refusal(self, scope: Scope, headers: Headers) -> str:
        """Why the request is refused; empty where it is not."""
        if headers.get("host") not in self._hosts:
            return "the Host is not this panel's; open the address that the panel printed"
        origin = headers.get("origin")
        foreign = origin is not None and origin.removeprefix("http://") not in self._hosts
        if scope["type"] == "websocket":
            return "the Origin is not this panel's" if foreign or origin is None else ""
        if scope["path"].startswith(SOCKET_PATH):
            return "the socket takes websockets only"
        if scope["method"] not in SAFE_METHODS and (foreign or origin is None):
            return "the Origin is not this panel's"
        return ""


def _with_headers(send: Send) -> Send:
    async def sender(message: Message) -> None:
        if message["type"] == "http.response.start":
            added = [(name.encode(), value.encode()) for name, value in HEADERS.items()]
            message = {**message, "headers": [*message["headers"], *added]}
        await send(message)

    return sender
