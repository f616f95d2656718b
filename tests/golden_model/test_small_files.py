"""Regular files of limited size, and nothing else; `tests/system/test_small_inputs.py` has every reader of them."""

import errno
import os
from pathlib import Path

import pytest

from golden_model.small_files import MAX_TEXT_BYTES, open_regular, read_small_file


def test_a_file_is_read_up_to_the_limit_and_not_beyond(tmp_path: Path) -> None:
    path = tmp_path / "text"
    path.write_bytes(b"twelve bytes")
    assert read_small_file(path) == read_small_file(str(path), 12) == b"twelve bytes"
    with pytest.raises(OSError, match="larger than 0 kB") as caught:
        read_small_file(path, 11)
    assert (caught.value.errno, caught.value.filename) == (errno.EFBIG, str(path))
    with path.open("wb") as file:
        file.truncate(MAX_TEXT_BYTES + 1)
    with pytest.raises(OSError, match="larger than 1048 kB"):
        read_small_file(path)
    with pytest.raises(FileNotFoundError):
        read_small_file(tmp_path / "none")


def count_open() -> int:
    return sum(1 for _ in Path("/proc/self/fd").iterdir())


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="counts open files in Linux")
def test_a_pipe_without_writer_is_refused_at_once_and_closed(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    before = count_open()
    for _ in range(3):
        with pytest.raises(OSError, match="not a regular file"), open(tmp_path / "pipe", opener=open_regular):
            pass
    assert count_open() == before
    with pytest.raises(OSError, match="not a regular file"):
        read_small_file("/dev/zero")
