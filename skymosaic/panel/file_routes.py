"""Answers requests for files: uploads, pictures, files of results and the archive."""

import asyncio
from pathlib import Path
from typing import Literal

from fastapi import FastAPI, Request
from starlette.background import BackgroundTask
from starlette.requests import ClientDisconnect
from starlette.responses import FileResponse, PlainTextResponse, Response

from skymosaic.panel.results import find_inside
from skymosaic.panel.session import Session
from skymosaic.panel.uploads import UploadRefusedError


class FileRoutes:
    """The routes for the files of the session."""

    def __init__(self, session: Session) -> None:
        self._session = session

    def add_to(self, app: FastAPI) -> None:
        """Add the routes to an application."""
        app.post("/upload/{slot}")(self.upload)
        app.get("/picture/{folder}/{name}")(self.picture)
        app.get("/file/{kind}/{path:path}")(self.file)
        app.get("/archive")(self.archive)
        app.get("/run/{name}/{path:path}")(self.kept_file)

    async def upload(self, request: Request, slot: Literal["photograph", "template", "video"], name: str) -> Response:
        """Receive the body as a file, or refuse it with the reason."""
        try:
            await self._session.inputs.upload(slot, request.stream(), name)
        except ClientDisconnect:
            # The client has left; without an answer, the log would have a traceback.
            return Response(status_code=400)
        except UploadRefusedError as error:
            # Close the connection instead of reading the rest of a body that may be too large.
            return PlainTextResponse(str(error), status_code=error.status, headers={"connection": "close"})
        return Response(status_code=204)

    async def picture(self, folder: str, name: str) -> Response:
        """Send a picture that a page shows."""
        return _send(self._session.files.find_picture(folder, name))

    async def file(self, kind: str, path: str) -> Response:
        """Send one file of a result; what lies in its folders belongs to pages, which are shown."""
        result = self._session.results.get(kind)
        found = find_inside(result.folder, path) if result else None
        return _send(found, filename=None if "/" in path else path)

    async def kept_file(self, name: str, path: str) -> Response:
        """Send a file of a finished run; its report is a page."""
        return _send(self._session.runs.find_file(name, path))

    async def archive(self) -> Response:
        """Send all results in one file."""
        session = self._session
        if not session.results:
            return PlainTextResponse("there is no result yet", status_code=404)
        # The page of runs may have deleted one that another page still shows.
        kept = {name: result for name, result in session.results.items() if result.folder.is_dir()}
        if not kept:
            return PlainTextResponse("the run was deleted; make the mosaic again", status_code=404)
        try:
            path = await asyncio.to_thread(session.files.write_archive, kept)
        except OSError as error:
            reason = f"the archive cannot be written ({error.strerror}); make room on the panel's disk"
            return PlainTextResponse(reason, status_code=507)
        return FileResponse(path, filename="skymosaic.zip", background=BackgroundTask(path.unlink))


def _send(path: Path | None, filename: str | None = None) -> Response:
    if path is None:
        return PlainTextResponse("no such file", status_code=404)
    # The next photograph or result may have the same name, so a browser must ask each time.
    return FileResponse(path, filename=filename, headers={"cache-control": "private, no-cache"})
