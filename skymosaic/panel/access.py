"""Checks who asks, and from where, before anything else of the panel sees a request.

A page of another origin can reach a server on loopback through the user's browser: by a host name that its owner lets
resolve to 127.0.0.1, by forms and scripts, or by a websocket, which browsers do not confine to its own origin. The Host
header reveals the first, the Origin header the others. Other users and programs of this machine reach the port, too:
the owner's browser was given the address with the token.
"""

import secrets

from starlette.datastructures import MutableHeaders
from starlette.requests import HTTPConnection
from starlette.responses import PlainTextResponse, RedirectResponse, Response
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
NO_TOKEN = "open the address with the token, which the panel printed where it was started"
COOKIE_SECONDS = 14 * 24 * 3600
"""How long a browser keeps the token; it is worth nothing once the panel has ended."""


class AccessCheck:
    """Refuses requests that do not come from the panel's own page in a browser of its owner, and confines that page.

    The page's address with the token in it puts the token into a cookie.
    """

    def __init__(self, app: ASGIApp, port: int, token: str) -> None:
        self.app, self._token = app, token
        names = ("127.0.0.1", "localhost", "[::1]")
        self._hosts = {f"{name}:{port}" for name in names}
        # Browsers leave out the port that is HTTP's own.
        self._hosts |= set(names) if port == HTTP_PORT else set()
        # Cookies do not distinguish ports, so the name does, for two panels on one machine.
        self._cookie = f"skymosaic_{port}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a foreign request, and one without the token, with 403, and pass on every other."""
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
        else:
            await self._answer(HTTPConnection(scope))(scope, receive, _with_headers(send))

    def _answer(self, request: HTTPConnection) -> ASGIApp:
        reason = self._foreign(request)
        if not reason and request.url.path == "/" and self._is_token(request.query_params.get("token", "")):
            # To the address without it: neither a bookmark nor the history needs the token.
            entered: Response = RedirectResponse("/", status_code=303)
            entered.set_cookie(self._cookie, self._token, COOKIE_SECONDS, httponly=True, samesite="lax")
            return entered
        if not reason and self._is_token(request.cookies.get(self._cookie, "")):
            return self.app
        refusal = f"refused: {reason or NO_TOKEN}"
        if request.scope["type"] == "websocket":
            return WebSocketClose(reason=refusal)
        return PlainTextResponse(f"{refusal}\n", status_code=403)

    def _foreign(self, request: HTTPConnection) -> str:
        """Why the request does not come from the panel's own page; empty if it does."""
        scope = request.scope
        if request.headers.get("host") not in self._hosts:
            return "the Host is not this panel's; open the address that the panel printed"
        # Socket.IO's polling would let a plain GET act, which no Origin accompanies.
        if scope["type"] == "http" and scope["path"].startswith(SOCKET_PATH):
            return "this path accepts websockets only"
        acts = scope["type"] == "websocket" or scope["method"] not in SAFE_METHODS
        is_own = request.headers.get("origin", "").removeprefix("http://") in self._hosts
        return "the Origin is not this panel's" if acts and not is_own else ""

    def _is_token(self, given: str) -> bool:
        return secrets.compare_digest(given.encode(), self._token.encode())


def _with_headers(send: Send) -> Send:
    async def sender(message: Message) -> None:
        if message["type"] == "http.response.start":
            MutableHeaders(scope=message).update(HEADERS)
        await send(message)

    return sender
