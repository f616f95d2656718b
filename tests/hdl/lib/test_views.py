from typing import Any

from amaranth import ResetInserter, Signal
from amaranth.hdl import Module
from amaranth.lib import data
from amaranth.sim import Simulator

from hdl.lib.views import view_signal

LAYOUT = data.StructLayout({"x": 4, "y": 4})


def test_the_signal_has_the_name_of_its_variable_or_the_one_that_was_given() -> None:
    position = view_signal(LAYOUT)
    assert position.as_value().name == "position"
    assert view_signal(LAYOUT, name="other").as_value().name == "other"


def test_a_reset_clears_a_signal_unless_it_is_not_to() -> None:
    reset, m = Signal(), Module()
    kept, cleared = view_signal(LAYOUT, name="kept", reset_less=True), view_signal(LAYOUT, name="cleared")
    for each in (kept, cleared):
        m.d.sync += [each.x.eq(3), each.y.eq(5)]
    found: list[Any] = []

    async def run(ctx: Any) -> None:
        for resets in (0, 1, 0):
            found.append(tuple(ctx.get(each) for view in (kept, cleared) for each in (view.x, view.y)))
            ctx.set(reset, resets)
            await ctx.tick()

    simulator = Simulator(ResetInserter(reset)(m))
    simulator.add_clock(1e-6)
    simulator.add_testbench(run)
    simulator.run()
    assert found == [(0, 0, 0, 0), (3, 5, 3, 5), (3, 5, 0, 0)]
