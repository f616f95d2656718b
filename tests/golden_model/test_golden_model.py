"""Formats, records, small files, advice and the version."""

import enum
import errno
import os
import sys
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from golden_model import code_digest
from golden_model.code_digest import digest_code
from golden_model.feature.ilbp import PATTERNS
from golden_model.formats import RESPONSE_CODE, SQ, UQ, decode_response, encode_response, round_shift
from golden_model.geometry.estimator import EstimateCause
from golden_model.painting.pose import PoseCause
from golden_model.records import FRAME_STATUS, HOMOGRAPHY, MATCH, Cause, Record
from golden_model.small_files import MAX_TEXT_BYTES, open_regular, read_small_file
from golden_model.text import how_to_install
from golden_model.version import VERSION

responses = st.one_of(st.integers(0, 5000), st.integers(0, 2**31 - 1), st.integers(0, 30).map(lambda n: 2**n))


@given(st.lists(responses, min_size=1))
def test_code_keeps_eleven_leading_bits(values: Any) -> None:
    codes = encode_response(np.array(values, np.int64))
    dropped = [max(value.bit_length() - 11, 0) for value in values]
    assert decode_response(codes).tolist() == [value >> d << d for value, d in zip(values, dropped, strict=True)]
    assert codes.tolist() == [1024 * d + (value >> d) for value, d in zip(values, dropped, strict=True)]
    assert RESPONSE_CODE.holds(codes)


@given(st.integers(-(2**40), 2**40), st.integers(0, 20))
def test_round_shift_rounds_halves_up(value: Any, shift: Any) -> None:
    assert round_shift(np.array(value), shift) == (2 * value + 2**shift) // 2 ** (shift + 1)


def test_ranges_and_quantisation() -> None:
    assert (SQ(11).min_raw, SQ(11).max_raw, UQ(12, 4).max_raw, UQ(1, 8).one) == (-1024, 1023, 65535, 256)
    assert UQ(0, 8).quantise(0.25) == 64
    with pytest.raises(ValueError, match=r"1\.0 does not fit UQ\(0, 8\)"):
        UQ(0, 8).quantise(1.0)
    assert SQ(11).holds(np.array([-1024, 1023]))
    assert SQ(11).holds(np.zeros(0, int))
    assert not any(SQ(11).holds(np.array([0, beyond])) for beyond in (-1025, 1024))


_FEATURE = "level:1 sector:4 reserved:8 index:16 response:15 x:16 y:16 frame:32 descriptor:"
_ELEMENTS = "h00:32 h01:32 h02:32 h10:32 h11:32 h12:32 h20:32 h21:32 h22:32"


@pytest.mark.parametrize(
    ("record", "tag", "length_bytes", "fields"),
    [
        (PATTERNS["ilbp-128"].record, 1, 32, f"{_FEATURE}128"),
        (PATTERNS["ilbp-256"].record, 1, 48, f"{_FEATURE}256"),
        (PATTERNS["thesis-ilbp-4"].record, 1, 32, f"{_FEATURE}32 window:72"),
        (
            MATCH, 2, 24, "verdict:1 rule:5 weight:8 left_index:16 right_index:16 left_x:16 left_y:16 right_x:16 "
            "right_y:16 distance:16 margin:16 turn:4 peak_turn:4 reference:16",
        ),
        (
            FRAME_STATUS, 3, 24, "good:1 causes:16 frame:32 width:16 height:16 features:16 matches:16 kept:16 "
            "threshold:15 cycles:32",
        ),
        (
            HOMOGRAPHY, 6, 64, "causes:8 inliers:16 frame:32 score:32 support:32 cycles:32 cells:16 reference:16 "
            f"{_ELEMENTS}",
        ),
    ],
)  # fmt: skip
def test_records_are_those_that_hosts_read(record: Record, tag: int, length_bytes: int, fields: str) -> None:
    assert (record.tag, record.record_bytes) == (tag, length_bytes)
    assert " ".join(f"{field.name}:{field.bits}" for field in record.fields) == fields


@pytest.mark.parametrize(
    ("kind", "names"),
    [
        (Cause, "short_line long_line early_end missing_start too_many_features invalid_settings cleared"),
        (
            EstimateCause,
            "bad_frame too_few_matches too_many_matches invalid_settings no_hypothesis too_few_inliers too_few_cells",
        ),
        (PoseCause, "out_of_range singular unknown_reference unanchored"),
    ],
)
def test_each_cause_has_a_bit(kind: type[enum.IntFlag], names: str) -> None:
    expected = {name: 1 << n for n, name in enumerate(names.split())}
    assert {name.lower(): int(value) for name, value in kind.__members__.items()} == expected


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


@pytest.mark.parametrize(
    ("prefix", "active", "says"),
    [
        ("/usr", None, "run pip install '.[sim]'"),
        ("/home/a/.venv", "/home/a/.venv", "run pip install '.[sim]'"),
        ("/home/a/.venv", None, "run '/home/a b/.venv/bin/python' -m pip install '.[sim]'"),
        ("/home/a/.venv", "/home/a/other", "run '/home/a b/.venv/bin/python' -m pip install '.[sim]'"),
    ],
)
def test_an_extra_goes_into_the_environment_that_runs(
    monkeypatch: pytest.MonkeyPatch, prefix: str, active: str | None, says: str
) -> None:
    monkeypatch.setattr(sys, "prefix", prefix)
    monkeypatch.setattr(sys, "base_prefix", "/usr")
    monkeypatch.setattr(sys, "executable", "/home/a b/.venv/bin/python")
    monkeypatch.delenv("VIRTUAL_ENV", raising=False)
    if active is not None:
        monkeypatch.setenv("VIRTUAL_ENV", active)
    assert how_to_install("sim").endswith(says)


def test_an_extra_of_a_wheel_is_installed_from_that_wheel(monkeypatch: pytest.MonkeyPatch) -> None:
    origin = SimpleNamespace(read_text=lambda _name: '{"url": "file:///dl/skymosaic-1-py3-none-any.whl"}')
    monkeypatch.setattr(metadata, "distributions", lambda **_: iter([origin]))
    assert how_to_install("sim").endswith(" install 'skymosaic[sim] @ file:///dl/skymosaic-1-py3-none-any.whl'")


CITATION = Path(__file__).parents[2] / "CITATION.cff"


def test_the_version_fits_the_register_and_is_that_of_the_citation() -> None:
    numbers = [int(number) for number in VERSION.split(".")]
    assert len(numbers) == 3
    assert all(0 <= number < 256 for number in numbers)
    assert f"\nversion: {VERSION}\n" in CITATION.read_text()
    assert "\nreferences:\n  - type: thesis\n" in CITATION.read_text()


FILES = {
    "golden_model/__init__.py": '"""The model."""',
    "golden_model/root.py": "from golden_model import inner\nimport hdl.adder as adder\n",
    "golden_model/inner/__init__.py": "from golden_model.inner.shown import Shown\n",
    "golden_model/inner/shown.py": "from golden_model.root import adder\nclass Shown: ...\n",
    "golden_model/unused.py": "from golden_model.root import adder\n",
    "golden_model/systems/rules.fll": "Engine: rules\n",
    "hdl/__init__.py": "",
    "hdl/adder.py": "def add():\n    from golden_model.late import value\n    return [lambda: __import__('os')]\n",
    "hdl/named.py": "",
    "hdl/cells.v": "module cell; endmodule\n",
    "golden_model/late.py": "import numpy\nvalue = 'a message'\n",
    "skymosaic/harness.cpp": "",
}
UNUSED = {"golden_model/unused.py", "hdl/__init__.py", "hdl/named.py", "skymosaic/harness.cpp"}


def forget() -> None:
    for function in (digest_code, code_digest._modules, code_digest._read):
        function.cache_clear()


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.setattr(code_digest, "ROOT", tmp_path)
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    forget()
    yield tmp_path
    forget()


@pytest.mark.parametrize("name", FILES)
def test_what_is_imported_and_data_count_and_nothing_else(project: Path, name: str) -> None:
    before = digest_code("golden_model.root")
    (project / name).write_text(FILES[name] + "\n")
    forget()
    assert (digest_code("golden_model.root") != before) == (name not in UNUSED)


def test_every_module_that_is_given_counts(project: Path) -> None:
    assert digest_code("golden_model.root", "hdl.named") != digest_code("golden_model.root")
    with pytest.raises(KeyError, match=r"golden_model\.missing"):
        digest_code("golden_model.missing")


def test_the_folder_of_the_project_does_not_count(project: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    before = digest_code("golden_model.root")
    other = tmp_path_factory.mktemp("other") / "with space"
    project.rename(other)
    code_digest.ROOT = other
    forget()
    assert digest_code("golden_model.root") == before
    other.rename(project)
