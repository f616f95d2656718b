"""The schedule of the processor's programs; what they leave is in `test_estimator`, their size in the area."""

from golden_model.geometry.program import LATENCY_CYCLES
from golden_model.geometry.programs import PROGRAMS


def test_the_schedule_uses_no_result_too_early() -> None:
    """Executed in its order of issue, no instruction of a program reads a register while a write to it is under way."""
    for program in PROGRAMS:
        written: dict[int, int] = {}
        clock = 0
        for each in program.instructions:
            read = {each.b, each.c} | ({each.a} if each.source != 2 else set())
            assert all(written.get(register, -LATENCY_CYCLES) + LATENCY_CYCLES <= clock for register in read - {0, 1})
            if each.result:
                written[each.result] = clock
            clock += 1 + each.wait
        assert program.cycles >= clock
