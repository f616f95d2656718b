"""The panel's server on loopback, with its pages."""

import os
import secrets
import socket
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path

import uvicorn
from fastapi import FastAPI
from nicegui import app as page_app
from nicegui import ui

from skymosaic.common.errors import InputError
from skymosaic.panel.access import AccessCheck
from skymosaic.panel.file_routes import FileRoutes
from skymosaic.panel.folders import Roots
from skymosaic.panel.pages.mosaic_page import build_mosaic_page
from skymosaic.panel.pages.page_layout import PAGES
from skymosaic.panel.pages.runs_page import build_runs_page
from skymosaic.panel.pages.tracking_page import build_tracking_page
from skymosaic.panel.runs import open_runs
from skymosaic.panel.session import Session
from skymosaic.panel.tasks.containment import MISSING_LIMITS
from skymosaic.panel.tasks.jobs import prepare_workers

HOST = "127.0.0.1"
SECONDS_TO_CLOSE = 2
SECONDS_TO_RECONNECT = 30
"""With the usual 3, a page reloads itself when a busy browser has not answered for 2 seconds."""


def serve(
    port: int, boards: tuple[str, ...], roots: Sequence[Path], runs: Path, announce: Callable[[str, str], None]
) -> None:
    """Run the panel until it is interrupted; port 0 takes any free one.

    It serves its owner: whoever comes by the announced address, may open photographs below the roots, and finds the
    finished runs of ``runs``. ``announce`` receives that address, with its token, once browsers can open it; and what
    the system cannot limit, or nothing.

    Raises
    ------
    InputError
        If the port is taken, a root is no folder, or the folder of the runs cannot be made.
    """
    listener = _listen(port)
    allowed, stack = Roots(roots), ExitStack()
    session = Session(stack.enter_context(open_runs(runs)), allowed, boards)
    stack.callback(session.close)
    # Clean up on shutdown, not after `run`: uvicorn raises the signal that stopped it again, so nothing after runs.
    page_app.on_shutdown(stack.close)
    prepare_workers(session.runs.unfinished)
    port, token = listener.getsockname()[1], secrets.token_urlsafe()
    announce(f"http://{HOST}:{port}/?token={token}", MISSING_LIMITS)
    config = uvicorn.Config(
        AccessCheck(_application(session), port, token),
        log_level="warning",
        ws="wsproto",
        server_header=False,
        timeout_graceful_shutdown=SECONDS_TO_CLOSE,
    )
    uvicorn.Server(config).run(sockets=[listener])


def _listen(port: int) -> socket.socket:
    try:
        # Also a port that a panel has just left. Browsers that come before the server is ready wait in its queue.
        return socket.create_server((HOST, port))
    except OSError as error:
        reason = os.strerror(error.errno or 0)
        raise InputError(f"port {port}: cannot be used ({reason}); choose another with --port") from None


def _application(session: Session) -> FastAPI:
    """The application: the routes for files, and the pages, which NiceGUI serves."""
    app = FastAPI(openapi_url=None)
    FileRoutes(session).add_to(app)
    for path, build in (("/", build_mosaic_page), ("/tracking", build_tracking_page), ("/runs", build_runs_page)):
        # With the session filled in, no parameter is left that an address could set.
        ui.page(path, title=f"{PAGES[path]} - skymosaic")(partial(build, session))
    # Long work has a bar of its own. Quasar's, for every request of a viewer, has no name for a screen reader.
    page_app.config.quasar_config["loadingBar"]["skipHijack"] = True
    # Dark where the system is; the language is what a screen reader pronounces.
    ui.run_with(
        app,
        title="skymosaic",
        language="en-US",
        dark=None,
        reconnect_timeout=SECONDS_TO_RECONNECT,
        show_welcome_message=False,
        gzip_middleware_factory=None,
    )
    return app
