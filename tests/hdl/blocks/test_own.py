# amaranth: UnusedElaboratable=no
"""A class of one's own gets test benches from a function that says what it answers."""

from pathlib import Path

import pytest
from amaranth.hdl import Module, signed
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from hdl.blocks.export import write_block
from hdl.blocks.own import LINE, LINES, make_own
from hdl.blocks.vectors import Row
from tests.hdl.blocks.test_export import run_cocotb, simulate

pytestmark = pytest.mark.usefixtures("unused_blocks")
BEAT = data.StructLayout({"valid": 1, "x": 12, "y": 12, "pixel": 8})
ANSWER = data.StructLayout({"valid": 1, "x": 12, "y": 12, "darker": signed(9)})


class Darker(wiring.Component):
    """Negative of each pixel, less an offset."""

    i: In(BEAT)
    i_offset: In(4)
    o: Out(ANSWER)

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.d.sync += [self.o[name].eq(self.i[name]) for name in ("valid", "x", "y")]
        m.d.sync += self.o.darker.eq(-self.i.pixel - self.i_offset)
        return m


class Doubled(wiring.Component):
    """Twice each number of a stream."""

    i: In(stream.Signature(8))
    o: Out(stream.Signature(9))

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.d.comb += [self.o.payload.eq(self.i.payload << 1), self.o.valid.eq(self.i.valid)]
        m.d.comb += self.i.ready.eq(self.o.ready)
        return m


def darker(i: list[Row], i_offset: int = 5) -> dict[str, list[Row]]:
    return {"o": [{"o_x": b["i_x"], "o_y": b["i_y"], "o_darker": -b["i_pixel"] - i_offset} for b in i]}


def doubled(i: list[Row]) -> dict[str, list[Row]]:
    return {"o": [{"o": 2 * record["i"]} for record in i]}


def misnamed(i: list[Row]) -> dict[str, list[Row]]:
    return {"o": [{"p": 0} for _ in i]}


def silent(i: list[Row]) -> dict[str, list[Row]]:
    return {"o": i[:0]}


def listed(i: list[Row]) -> list[Row]:
    return i


def path(name: object) -> str:
    return f"{__name__}:{name}"


@pytest.mark.needs("icarus")
@pytest.mark.parametrize(("made", "model"), [("Darker", "darker"), ("Doubled", "doubled")])
def test_the_benches_compare_with_the_model(tmp_path: Path, made: str, model: str) -> None:
    block = make_own(path(made), path(model))
    places = [(row["i_x"], row["i_y"]) for row in block.inputs["i"] if made == "Darker"]
    assert places in ([], [(x, y) for y in range(LINES) for x in range(LINE)])
    write_block(tmp_path, "own", block)
    run = simulate(tmp_path, "own")
    assert run.stdout.startswith(f"PASS: {LINE * LINES} answers"), run.stdout
    assert made == "Doubled" or run_cocotb(tmp_path, "test_own").returncode == 0
    # It is not ours to license.
    assert (tmp_path / "own.v").read_text().startswith("// Made by skymosaic ")
    assert block.description in (tmp_path / "README.md").read_text()


@pytest.mark.parametrize(
    ("made", "model", "message"),
    [
        ("Doubled", "nothing", "has no attribute 'nothing'; return a dictionary with a list of records for o"),
        ("Doubled", "misnamed", "answer o with records of o, at least one"),
        ("Doubled", "silent", "answer o with records of o, at least one"),
        ("Doubled", "listed", "return a dictionary with a list of records for o"),
        ("Doubled", "path", "unexpected keyword argument 'i'"),
        ("darker", "darker", "missing 1 required positional argument: 'i'"),
    ],
)
def test_what_is_no_model_is_refused(made: str, model: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make_own(path(made), path(model))
