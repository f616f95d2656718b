"""Opens files that others name: a regular file of limited size, where a pipe or a device would block or never end."""

import errno
import os
import stat
from pathlib import Path

MAX_TEXT_BYTES = 1 << 20
"""Room for any configuration or camera file."""


def open_regular(path: str, flags: int) -> int:
    """``opener`` of the built-in ``open`` and of ``io.FileIO`` that refuses anything but a regular file.

    Raises
    ------
    OSError
        Also for a pipe, a device or a socket.
    """
    # Without O_NONBLOCK, opening a pipe waits for its writer. Windows has none, and no pipes among its files.
    descriptor = os.open(path, flags | getattr(os, "O_NONBLOCK", 0))
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise OSError(errno.EINVAL, "not a regular file", path)
    return descriptor


def read_small_file(path: str | Path, max_bytes: int = MAX_TEXT_BYTES) -> bytes:
    """Read a regular file of at most ``max_bytes``.

    Raises
    ------
    OSError
        For any other, with the reason in ``strerror``.
    """
    with open(path, "rb", opener=open_regular) as file:
        # Python reserves all that it is asked for at once.
        data = file.read(min(os.fstat(file.fileno()).st_size, max_bytes) + 1)
    if len(data) > max_bytes:
        raise OSError(errno.EFBIG, f"larger than {max_bytes // 1000} kB", str(path))
    return data
