"""A self-checking Verilog test bench: it sends vectors, compares the answers, and prints one line with the verdict."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from hdl.blocks.vectors import Memory, Row
from hdl.templates import render

RESET_CYCLES = 8
IDLE_CYCLES = 1 << 16
"""Clocks without an answer after which a bench fails."""


@dataclass(frozen=True)
class Port:
    """A port of the module under test."""

    bits: int
    is_input: bool


@dataclass(frozen=True)
class Channel:
    """A stream of the module under test."""

    prefix: str
    """Prefix of its ports' names: ``i_``, ``m_axis_features_t``."""
    fields: Mapping[str, int]
    """Widths of the ports that carry data."""
    has_ready: bool
    """Whether it can stall."""
    rows: Sequence[Row]
    """The rows to send, or the expected ones."""
    clock: str
    condition: str
    """A Verilog expression; rows are sent only while it is true."""

    @property
    def name(self) -> str:
        """Name of its variables and files in the bench."""
        return self.prefix.rstrip("_")

    @property
    def bits(self) -> int:
        """Width of a row."""
        return sum(self.fields.values())

    @property
    def data(self) -> str:
        """The fields as one Verilog vector, the last one lowest."""
        return "{" + ", ".join(self.fields) + "}"

    def words(self) -> tuple[str, str]:
        """Convert the rows to hexadecimal words for ``$readmemh``, and to masks of their specified bits."""
        digits = -(-self.bits // 4)
        values, specified = [], []
        for row in self.rows:
            value = care = 0
            for name, bits in self.fields.items():
                ones = (1 << bits) - 1
                value = value << bits | row.get(name, 0) & ones
                care = care << bits | (ones if name in row else 0)
            values.append(f"{value:0{digits}x}\n")
            specified.append(f"{care:0{digits}x}\n")
        return "".join(values), "".join(specified)


@dataclass(frozen=True)
class VerilogBench:
    """A test bench for a Verilog module."""

    module: str
    ports: Mapping[str, Port]
    inputs: Mapping[str, Sequence[Row]]
    outputs: Mapping[str, Sequence[Row]]
    """For the prefix of each stream, the rows to send and the expected ones, in order."""
    settings: Mapping[str, int] = field(default_factory=dict)
    """Values of other inputs, which stay."""
    spacing_cycles: int = 1
    """Minimum number of clocks from one input to the next."""
    clocks: Mapping[str, str] = field(default_factory=dict)
    """Clocks of streams that do not have ``clock``, by prefix."""
    conditions: Mapping[str, str] = field(default_factory=dict)
    """Verilog expressions for inputs that wait until they are true, by prefix."""
    memory: Memory | None = None
    clock: str = "clk"
    reset: str = "rst"
    reset_level: int = 1
    """Active level of ``reset``."""

    def files(self) -> dict[str, str]:
        """The files of the bench by name: Verilog, and vectors."""
        sources, sinks = self._channels()
        files = {f"{each.name}.hex": each.words()[0] for each in (*sources, *sinks)}
        files |= {f"{each.name}_specified.hex": each.words()[1] for each in sinks}
        files |= {"memory.hex": "".join(f"{word:016x}\n" for word in self.memory.words)} if self.memory else {}
        files[f"{self.module}_tb.v"] = self._render("testbench.v")
        return files

    def cocotb_test(self, start_cycles: int) -> str:
        """A cocotb test with the same vectors, for modules of one clock."""
        buses = (*self.memory.writers, *self.memory.readers) if self.memory else ()
        idle = {name: 0 for name, port in self.ports.items() if port.is_input and name.startswith(buses)}
        return self._render("cocotb_test.py.jinja", start_cycles=start_cycles, settings={**idle, **self.settings})

    def _render(self, template: str, **others: object) -> str:
        sources, sinks = self._channels()
        clocks = dict.fromkeys((self.clock, *self.clocks.values()), 0)
        return render(
            template,
            sources=sources,
            sinks=sinks,
            starts={**clocks, self.reset: self.reset_level, **self.settings},
            other_clocks=set(self.clocks.values()),
            reset_cycles=RESET_CYCLES,
            idle_cycles=IDLE_CYCLES,
            **vars(self) | others,
        )

    def _channels(self) -> tuple[list[Channel], list[Channel]]:
        inputs, outputs = self.inputs.items(), self.outputs.items()
        return [self._channel(*each) for each in inputs], [self._channel(*each) for each in outputs]

    def _channel(self, prefix: str, rows: Sequence[Row]) -> Channel:
        # A stream of plain numbers has its prefix as the name of its data.
        names = [name for name in self.ports if f"{name}_".startswith(prefix) and name not in self.settings]
        longer = tuple(each for each in self.inputs if each.startswith(prefix) and each != prefix)
        names = [name for name in names if not (longer and name.startswith(longer))]
        handshake = (f"{prefix}valid", f"{prefix}ready")
        return Channel(
            prefix,
            {name: self.ports[name].bits for name in names if name not in handshake},
            handshake[1] in names,
            rows,
            self.clocks.get(prefix, self.clock),
            self.conditions.get(prefix, "1"),
        )
