import os
import stat
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from golden_model.cache import Cache, _checksum, cache_folder, digest


def test_the_folder_is_in_the_users_cache(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    assert cache_folder() == tmp_path / ".cache" / "skymosaic"
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "elsewhere"))
    assert cache_folder() == tmp_path / "elsewhere" / "skymosaic"


def test_a_damaged_cache_file_counts_as_missing(tmp_path: Path) -> None:
    cache = Cache(tmp_path)
    cache.save("key", {"values": np.arange(1000)})
    path = tmp_path / "key.entry"
    whole = path.read_bytes()
    for damaged in (b"", whole[:200], whole[:2000] + b"\xff" + whole[2001:], whole + b"more"):
        path.write_bytes(damaged)
        assert cache.load("key") is None
    (tmp_path / "other.entry").write_bytes(whole)
    assert cache.load("other") is None
    cache.save("key", {"values": np.arange(1000)})
    loaded = cache.load("key")
    assert loaded
    np.testing.assert_array_equal(loaded["values"], np.arange(1000))


FEATURES = np.dtype([("index", "<u2"), ("response", "<f4"), ("descriptor", "u1", (16,))])


def test_arrays_come_back_with_their_types_and_shapes(tmp_path: Path) -> None:
    saved = {
        "features": np.frombuffer(bytes(range(110)), FEATURES),
        "none": np.zeros((0, 2)),
        "strided": np.arange(12, dtype=np.int16).reshape(3, 4)[:, ::2],
        "one": np.array(True),
    }
    cache = Cache(tmp_path)
    cache.save("key", saved)
    loaded = cache.load("key")
    assert loaded is not None
    assert list(loaded) == list(saved)
    for name, array in saved.items():
        assert (loaded[name].dtype, loaded[name].shape) == (array.dtype, array.shape)
        np.testing.assert_array_equal(loaded[name], array)
        assert loaded[name].flags.writeable


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"[]\n",
        b"\x80\n",
        b"[" * 100_000,
        b'{"a": 3}\n',
        b'{"a": ["(", [1]]}\n1',
        b'{"a": [[["x"]], [2]]}\n',
        b'{"a": ["|O", [1]]}\n12345678',
        b'{"a": ["<f8", [2]]}\n12345678',
        b'{"a": ["<f8", [99999999999999999999]]}\n',
    ],
)
def test_an_entry_that_somebody_made_up_counts_as_missing(data: bytes, tmp_path: Path) -> None:
    (tmp_path / "key.entry").write_bytes(_checksum("key", data) + data)
    assert Cache(tmp_path).load("key") is None


THREADS = """
import gc
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
import numpy as np
from golden_model.cache import Cache

class Garbage:
    def __init__(self):
        self.me = self

    def __del__(self):
        sum(range(100))  # enough for another thread to take over

def load(_turn):
    _garbage = [Garbage() for _ in range(20)]
    return cache.load("key") is not None

cache = Cache(Path(sys.argv[1]))
cache.save("key", {"values": np.zeros(5, [(f"field{index}", "u1") for index in range(40)])})
sys.setswitchinterval(1e-6)
gc.set_threshold(50)
with ThreadPoolExecutor(8) as threads:
    assert all(threads.map(load, range(2000)))
"""


def test_threads_load_at_the_same_time(tmp_path: Path) -> None:
    subprocess.run([sys.executable, "-c", THREADS, str(tmp_path)], check=True)


def test_a_cache_that_cannot_be_written_keeps_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").touch()
    lines: list[str] = []
    cache = Cache(tmp_path / "file" / "cache", tell=lines.append)
    cache.save("key", {"values": np.arange(3)})
    assert cache.load("key") is None
    with pytest.raises(OSError, match="Not a directory"):
        Cache(tmp_path / "file" / "cache", required=True)

    def full(_path: Any, _data: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    cache = Cache(tmp_path / "cache", required=True, tell=lines.append)
    cache.save("key", {"values": np.arange(3)})
    cache.save("other", {"values": np.arange(3)})
    assert len(lines) == 2
    assert "cannot be made" in lines[0]
    assert "No space left" in lines[1]


def test_the_usual_folder_is_its_owners_alone(tmp_path: Path) -> None:
    def mode_after(mode: int, *, required: bool) -> int:
        (tmp_path / "cache").mkdir(exist_ok=True)
        (tmp_path / "cache").chmod(mode)
        Cache(tmp_path / "cache", required=required)
        return stat.S_IMODE((tmp_path / "cache").stat().st_mode)

    assert mode_after(0o755, required=False) == 0o700
    assert mode_after(0o770, required=True) == 0o770, "the user shares it"


def test_another_users_folder_stays_as_it_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError("not the owner")

    monkeypatch.setattr(Path, "chmod", refuse)
    Cache(tmp_path).save("key", {"values": np.arange(3)})
    assert Cache(tmp_path).load("key")


SHARED = """
import sys
from pathlib import Path
import numpy as np
from golden_model.cache import Cache
cache, found = Cache(Path(sys.argv[1])), 0
for turn in range(300):
    key = turn % 7
    cache.save(str(key), {"values": np.full(2000, key)})
    loaded = cache.load(str((key + 3) % 7))
    if loaded is not None:
        assert (loaded["values"] == (key + 3) % 7).all()
        found += 1
print(found)
"""


def test_two_processes_share_a_cache(tmp_path: Path) -> None:
    command = [sys.executable, "-c", SHARED, str(tmp_path / "cache")]
    both = [subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) for _ in range(2)]
    for process in both:
        printed, errors = process.communicate()
        assert process.returncode == 0, errors
        assert int(printed) > 250, "an entry that is being replaced is there all the time"
    assert len(list((tmp_path / "cache").iterdir())) == 7


def test_what_was_not_used_for_longest_goes_first(tmp_path: Path) -> None:
    cache = Cache(tmp_path)
    for age, key in enumerate(("newest", "used", "old", "oldest")):
        cache.save(key, {"values": np.arange(1000)})
        os.utime(tmp_path / f"{key}.entry", (1e9 - age, 1e9 - age))
    assert cache.load("oldest")
    size = (tmp_path / "used.entry").stat().st_size
    again = Cache(tmp_path, limit_bytes=3 * size)
    assert [key for key in ("oldest", "newest", "used", "old") if again.load(key)] == ["oldest", "newest", "used"]


def test_digest_tells_parts_apart() -> None:
    keys = {digest("ab", "c"), digest("a", "bc"), digest("abc"), digest("ab", "d"), digest()}
    assert len(keys) == 5
