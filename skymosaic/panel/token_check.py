"""Checks that a request comes from the panel's owner: from a browser that was given the address with the token.

Other users and programs of this machine reach the port, too.
"""

import secrets

from starlette.requests import HTTPConnection
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Receive, Scope, Send
from starlette.websockets import WebSocketClose

REFUSAL = "refused: open the address with the token, which the panel printed where it was started"
COOKIE_SECONDS = 14 * 24 * 3600
"""How long a browser keeps the token; it is worth nothing once the panel has ended."""


class TokenCheck:
    """Refuses requests without the token; the page's address with the token in it puts it into a cookie."""

    def __init__(self, app: ASGIApp, port: int, token: str) -> None:
        self.app, self._token = app, token
        # Cookies do not distinguish ports, so the name does, for two panels on one machine.
        self._cookie = f"skymosaic_{port}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer with 403 whoever has no token, and pass on every request of the owner."""
        answer = self.app if scope["type"] == "lifespan" else self._answer(HTTPConnection(scope))
        await answer(scope, receive, send)

    def _answer(self, request: HTTPConnection) -> ASGIApp:
        if request.url.path == "/" and self._is_token(request.query_params.get("token", "")):
            # To the address without it: neither a bookmark nor the history needs the token.
            entered: Response = RedirectResponse("/", status_code=303)
            entered.set_cookie(self._cookie, self._token, COOKIE_SECONDS, httponly=True, samesite="lax")
            return entered
        if self._is_token(request.cookies.get(self._cookie, "")):
            return self.app
        if request.scope["type"] == "websocket":
            return WebSocketClose(reason=REFUSAL)
        return PlainTextResponse(f"{REFUSAL}\n", status_code=403)

    def _is_token(self, given: str) -> bool:
        return secrets.compare_digest(given.encode(), self._token.encode())
