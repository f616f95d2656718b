"""Temporary files and folders belong to whoever holds their lock, in whatever container that is."""

import errno
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from golden_model import temporary

WRITER = """
import sys
from pathlib import Path
from golden_model.temporary import temporary_file, temporary_folder

with temporary_file(Path(sys.argv[1])) as file, temporary_folder(Path(sys.argv[1])) as folder:
    file.write_text("half")
    (folder / "inside").write_text("half")
    print("writing", flush=True)
    sys.stdin.read()
    assert file.read_text() == (folder / "inside").read_text() == "half"
"""
NAMESPACE = ("unshare", "--pid", "--fork", "--mount-proc")


@contextmanager
def writing(folder: Path, *around: str) -> Iterator[subprocess.Popen[str]]:
    """A process that writes a temporary file and a temporary folder until its standard input ends."""
    command = [*around, sys.executable, "-c", WRITER, str(folder)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout
        assert process.stdout.readline() == "writing\n"
        yield process
        process.communicate()


def sweep(folder: Path) -> None:
    """What the next run in a folder does, in this process."""
    temporary.remove_left_overs.cache_clear()
    with temporary.temporary_file(folder):
        pass


@pytest.mark.parametrize("around", [(), NAMESPACE], ids=["another process", "another PID namespace"])
def test_what_another_process_writes_stays(tmp_path: Path, around: tuple[str, ...]) -> None:
    if around and subprocess.run([*around, "true"], capture_output=True, check=False).returncode:
        pytest.skip("this user may make no PID namespace")
    with writing(tmp_path, *around) as process:
        before = sorted(tmp_path.iterdir())
        sweep(tmp_path)
        assert sorted(tmp_path.iterdir()) == before
        assert len(before) == 4
    assert process.returncode == 0
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(os.name == "nt", reason="needs symbolic links")
def test_what_a_killed_process_leaves_is_removed_by_the_next_run(tmp_path: Path) -> None:
    (tmp_path / "kept").mkdir()
    (tmp_path / "kept" / "inside").touch()
    with writing(tmp_path) as process:
        process.send_signal(signal.SIGKILL)
    lock = temporary.lock_for(tmp_path / "mosaic.png", tmp_path)
    lock.touch()
    (tmp_path / ".skymosaic-link.lock").touch()
    (tmp_path / ".skymosaic-link").symlink_to(tmp_path / "kept")
    assert len(list(tmp_path.iterdir())) == 8
    sweep(tmp_path)
    assert [path.name for path in tmp_path.rglob("*")] == ["kept", "inside"]


def test_without_a_lock_nothing_is_removed(tmp_path: Path) -> None:
    (tmp_path / ".skymosaic-x").touch()
    (tmp_path / ".skymosaic-outputs").touch()
    sweep(tmp_path)
    assert len(list(tmp_path.iterdir())) == 2


def test_a_file_system_without_locks_keeps_left_overs_and_nobody_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSYS, "Function not implemented")

    monkeypatch.setattr("fcntl.flock", refuse)
    with temporary.temporary_file(tmp_path) as path:
        assert path.exists()
        sweep(tmp_path)
        assert path.exists()
        with temporary.hold(tmp_path / "a.lock") as first, temporary.hold(tmp_path / "a.lock", timeout_s=0) as second:
            assert (first, second) == (False, False)
    assert not list(tmp_path.iterdir())


def test_a_lock_keeps_others_out_until_it_ends(tmp_path: Path) -> None:
    path = tmp_path / "a.lock"
    with temporary.hold(path) as locked:
        assert locked
        with pytest.raises(TimeoutError), temporary.hold(path, timeout_s=0):
            pass
        assert path.exists()
    assert not path.exists()


def test_a_lock_that_was_removed_while_it_was_waited_for_is_made_anew(tmp_path: Path) -> None:
    path = tmp_path / "a.lock"
    waiter = (
        "import sys; from pathlib import Path; from golden_model.temporary import hold\nprint('waits', flush=True)\n"
        "with hold(Path(sys.argv[1])):\n    print(Path(sys.argv[1]).exists())"
    )
    command = [sys.executable, "-c", waiter, str(path)]
    with temporary.hold(path):
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert process.stdout
        assert process.stdout.readline() == "waits\n"
        # Long enough for it to have opened the file.
        with pytest.raises(subprocess.TimeoutExpired):
            process.wait(timeout=1)
    assert process.communicate()[0] == "True\n"


@pytest.mark.parametrize("beside", [True, False])
def test_a_temporary_folder_is_hidden_beside_an_output_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, beside: bool
) -> None:
    monkeypatch.setattr(tempfile, "gettempdir", lambda: str(tmp_path / "system"))
    for name in ("system", "output"):
        (tmp_path / name).mkdir()
    with temporary.temporary_folder(tmp_path / "output" if beside else None) as folder:
        assert folder.parent == tmp_path / ("output" if beside else "system")
        assert folder.name.startswith(".") == beside
    assert not folder.exists()
