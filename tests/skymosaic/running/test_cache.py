import ast
import subprocess
import sys
from pathlib import Path

import pytest

from golden_model.code_digest import digest_each
from skymosaic.common.errors import InputError
from skymosaic.flight.linking.links import link_views
from skymosaic.flight.linking.view import describe, describe_thumbnail
from skymosaic.running.cache import key_of, open_cache


def test_keys_change_with_every_part_and_with_the_code(monkeypatch: pytest.MonkeyPatch) -> None:
    assert key_of(describe, 1, "a") == key_of(describe, 1, "a")
    keys = [key_of(describe, 1, "a"), key_of(describe, 1, "b"), key_of(describe, "1", "a"), key_of(link_views, 1, "a")]
    assert len({*keys, key_of(describe_thumbnail, 1, "a")}) == 5
    monkeypatch.setattr("skymosaic.running.cache.digest_code", lambda module: f"changed {module}")
    assert key_of(describe, 1, "a") not in keys
    assert key_of(describe, 1, "a") != key_of(link_views, 1, "a")


LOADED = """
import sys
import numpy as np
from golden_model.config import Config
from skymosaic.flight.linking.view import Settings, describe
from skymosaic.imagery.photographs import Source

describe(Source(0, "image", np.zeros((64, 64), np.uint8)), Settings(Config()))
print(*(name for name in sys.modules if name.partition(".")[0] in ("golden_model", "hdl", "sim", "skymosaic")))
"""


def test_all_that_a_stage_loads_is_in_its_key() -> None:
    """The backend among it, which is imported by its name; without the hardware, which it does not load."""
    printed = subprocess.run([sys.executable, "-c", LOADED], check=True, capture_output=True, text=True).stdout
    in_key = digest_each(describe.__module__, "sim.backends.golden")
    assert {"sim.backends.golden", "golden_model.pixel.harris"} <= in_key.keys()
    assert not [name for name in in_key if name.startswith(("hdl", "skymosaic.maps", "skymosaic.compositing"))]
    for name in {*printed.split()} - in_key.keys() - {"skymosaic"}:
        (docstring,) = ast.parse(Path(*name.split("."), "__init__.py").read_text()).body
        assert isinstance(docstring, ast.Expr)


def test_a_folder_that_the_user_named_must_be_usable(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match=r"cache: cannot be made \(Not a directory\); choose another cache"):
        open_cache(tmp_path / "file" / "cache", print)


def test_the_users_own_folder_that_cannot_be_used_is_noted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setattr("skymosaic.running.cache.cache_folder", lambda: tmp_path / "file")
    lines: list[str] = []
    assert open_cache(None, lines.append).load("key") is None
    (line,) = lines
    assert line.startswith("note: features and links are not kept for the next run: ")
    assert line.endswith("flights: cannot be made (Not a directory)")
