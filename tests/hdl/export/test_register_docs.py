import re
import runpy
import subprocess
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from hdl.export import register_docs
from hdl.registers.register_map import REGISTERS, Access

PAGE = Path(__file__).parents[3] / "docs" / "reference" / "register_map.md"


@pytest.mark.filterwarnings("ignore:'hdl.export.register_docs' found in sys.modules:RuntimeWarning")
def test_the_page_in_docs_is_current(capsys: pytest.CaptureFixture[str]) -> None:
    runpy.run_module("hdl.export.register_docs", run_name="__main__")
    assert PAGE.read_text() == capsys.readouterr().out, (
        "run: python -m hdl.export.register_docs > docs/reference/register_map.md"
    )


def test_the_svd_tells_every_field() -> None:
    device = ET.fromstring(register_docs.svd())
    told = {
        (register.findtext("name"), field.findtext("name"), field.findtext("bitOffset"), field.findtext("bitWidth"))
        for register in device.iter("register")
        for field in register.iter("field")
    }
    assert told == {(r.name, f.name, str(f.low), str(f.bits)) for r in REGISTERS for f in r.fields}
    assert [int(r.findtext("addressOffset", ""), 16) for r in device.iter("register")] == [r.offset for r in REGISTERS]


def test_the_svd_does_not_say_that_a_constant_is_0() -> None:
    constants = {register.name for register in REGISTERS if register.fields[0].access is Access.CONSTANT}
    device = ET.fromstring(register_docs.svd())
    assert {r.findtext("name") for r in device.iter("register") if r.find("resetValue") is None} == constants


@pytest.mark.needs("compiler")
def test_the_c_header_compiles_and_agrees(tmp_path: Path) -> None:
    (tmp_path / "registers.h").write_text(register_docs.c_header())
    macros = re.findall(r"#define (\w+) 0x\w+u", register_docs.c_header())
    prints = "".join(f'std::printf("{macro} %u\\n", {macro});' for macro in macros)
    (tmp_path / "t.cpp").write_text(f'#include <cstdio>\n#include "registers.h"\nint main() {{ {prints} }}\n')
    subprocess.run(["g++", "-Wall", "-Werror", "-o", "t", "t.cpp"], cwd=tmp_path, check=True)
    out = subprocess.run([str(tmp_path / "t")], capture_output=True, text=True, check=True).stdout
    values = dict(line.rsplit(" ", 1) for line in out.splitlines())
    for register in REGISTERS:
        assert int(values[f"SKYMOSAIC_{register.name}"]) == register.offset
        for field in register.fields:
            assert int(values[f"SKYMOSAIC_{register.name}_{field.name.upper()}_MASK"]) == field.mask
