"""What the server answers to requests for files: uploads, pictures, files of results and the archive."""

from __future__ import annotations

from typing import Literal

from fastapi import FastAPI, Request
from starlette.requests import ClientDisconnect
from starlette.responses import FileResponse, PlainTextResponse, Response, StreamingResponse

from skymosaic.panel.archive import zipped
from skymosaic.panel.session import Session
from skymosaic.panel.sessions import Sessions
from skymosaic.panel.uploads.received import UploadRefusedError
from skymosaic.panel.uploads.storage import BUSY

SECONDS_TO_RETRY = 10


class FileRoutes:
    """The routes for files; each serves the session that the request's cookie names, and no other."""

    def __init__(self, sessions: Sessions) -> None:
        self._sessions = sessions

    def add_to(self, app: FastAPI) -> None:
        """Add the routes to an application with session cookies."""
        app.post("/upload/{slot}")(self.upload)
        app.get("/picture/{key}")(self.picture)
        app.get("/file/{kind}/{name}")(self.file)
        app.get("/archive")(self.archive)

    async def upload(self, request: Request, slot: Literal["photograph", "template", "video"], name: str) -> Response:
        """Receive the body as a file, or refuse it with the reason."""
        session = self._session(request)
        if session is None:
            return PlainTextResponse("open the panel's page first", status_code=403)
        try:
            await session.upload(slot, request.stream(), name, request.is_disconnected)
        except ClientDisconnect:
            # The client has left; without an answer, the log would have a traceback.
            return Response(status_code=400)
        except UploadRefusedError as error:
            # Close the connection instead of reading the rest of a body that may be too large.
            return PlainTextResponse(str(error), status_code=error.status, headers=_refusal_headers(error.status))
        return Response(status_code=204)

    async def picture(self, request: Request, key: str) -> Response:
        """A picture that the session's page shows."""
        session = self._session(request)
        path = session.picture(key) if session else None
        if path is None:
            return PlainTextResponse("no such picture", status_code=404)
        # Names are free again when photographs and results are gone: a browser must ask each time.
        return FileResponse(path, headers={"cache-control": "private, no-cache"})

    async def file(self, request: Request, kind: str, name: str) -> Response:
        """One file of a result."""
        session = self._session(request)
        path = session.result_file(kind, name) if session else None
        if path is None:
            return PlainTextResponse("no such file", status_code=404)
        return FileResponse(path, filename=name)

    async def archive(self, request: Request) -> Response:
        """All results in one file."""
        session = self._session(request)
        folders = session.result_folders() if session else {}
        if not folders:
            return PlainTextResponse("there is no result yet", status_code=404)
        disposition = {"content-disposition": 'attachment; filename="skymosaic.zip"'}
        return StreamingResponse(zipped(folders), media_type="application/zip", headers=disposition)

    def _session(self, request: Request) -> Session | None:
        identifier = request.session.get("id")
        return self._sessions.get(identifier) if identifier else None


def _refusal_headers(status: int) -> dict[str, str]:
    closing = {"connection": "close"}
    return closing | {"retry-after": str(SECONDS_TO_RETRY)} if status == BUSY else closing
