"""Ends a worker with all that it started, and limits what it may use: by groups and limits of POSIX, or without."""

import contextlib
import importlib
import os
import signal
import subprocess
import threading
import time
from pathlib import Path
from typing import Any

IS_POSIX = hasattr(os, "killpg")
TOO_LONG = 124
"""Exit status of a worker that ended itself because it used too much processor time."""
MISSING_LIMITS = (
    "" if IS_POSIX else "this system limits time alone, not memory: open photographs only of those whom you trust"
)
"""What the user has to know where the system cannot limit a process; else empty."""


def lead_group() -> None:
    """Make this process the leader of all that it will start."""
    if IS_POSIX:
        os.setsid()


def end_group(leader: int) -> None:
    """End a process at once, with all that it started."""
    if IS_POSIX:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(leader, signal.SIGKILL)
    else:
        with contextlib.suppress(OSError):
            subprocess.run(["taskkill", "/F", "/T", "/PID", str(leader)], capture_output=True, check=False)


def limit_worker(processor_seconds: int, memory_bytes: int) -> None:
    """End this process beyond a processor time, and where the system can, refuse it more memory than it has now."""
    if not IS_POSIX:
        threading.Thread(target=_watch_time, args=(processor_seconds,), daemon=True).start()
        return
    resource: Any = importlib.import_module("resource")
    # The libraries that are already loaded have reserved far more address space than they use.
    with contextlib.suppress(OSError):
        reserved_pages = int(Path("/proc/self/statm").read_text().split()[0])
        limit = reserved_pages * resource.getpagesize() + memory_bytes
        resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    resource.setrlimit(resource.RLIMIT_CPU, (processor_seconds, processor_seconds + 1))


def _watch_time(processor_seconds: int) -> None:
    while time.process_time() < processor_seconds:
        time.sleep(0.1)
    os._exit(TOO_LONG)


def took_too_long(status: int | None) -> bool:
    """Whether a worker ended, with this exit status, because of its processor time."""
    return status == (-signal.SIGXCPU if IS_POSIX else TOO_LONG)
