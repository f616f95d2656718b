from collections.abc import Iterator
from pathlib import Path

import pytest

from golden_model import code_digest
from golden_model.code_digest import digest_code

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
