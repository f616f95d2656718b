from dataclasses import replace
from pathlib import Path

import pytest

from golden_model import code_digest
from hdl.pixel.sobel import Sobel
from sim.backends.interface import silent
from sim.simulators import design
from tests.sim.simulators.row_difference import DESIGN


@pytest.mark.parametrize("module", [Sobel.__module__, "hdl.netlist", "hdl.port_names"])
def test_a_netlist_is_forgotten_when_the_code_changes_that_writes_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, module: str
) -> None:
    names: list[str] = []

    def find(name: str, *_: object, **__: object) -> Path:
        names.append(name)
        return tmp_path

    (tmp_path / "design").touch()
    monkeypatch.setattr(design, "build_once", find)
    monkeypatch.setattr(design, "digest_code", code_digest.digest_code.__wrapped__)
    block = replace(DESIGN, top=Sobel)
    for _ in range(2):
        block.verilog(silent)
    read = code_digest._read
    monkeypatch.setattr(code_digest, "_read", lambda name: ("other", read(name)[1]) if name == module else read(name))
    block.verilog(silent)
    block.verilog(silent, flat=True)
    assert names[0] == names[1]
    assert len(set(names)) == 3
