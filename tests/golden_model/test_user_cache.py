import stat
from pathlib import Path

import pytest

from golden_model.user_cache import cache_folder, make_private


def test_the_folder_is_in_the_users_cache(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    assert cache_folder() == tmp_path / ".cache" / "skymosaic"
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "elsewhere"))
    assert cache_folder() == tmp_path / "elsewhere" / "skymosaic"


def test_a_folder_becomes_its_owners_alone(tmp_path: Path) -> None:
    folder = tmp_path / "above" / "cache"
    for _ in range(2):
        make_private(folder)
        assert stat.S_IMODE(folder.stat().st_mode) == 0o700
        folder.chmod(0o777)


def test_another_users_folder_stays_as_it_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError("not the owner")

    monkeypatch.setattr(Path, "chmod", refuse)
    make_private(tmp_path / "cache")
    assert (tmp_path / "cache").is_dir()
