"""A self-checking Verilog test bench: it sends vectors, compares the answers, and prints one line with the verdict."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from hdl.blocks.vectors import Row

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
    """A stream of the module under test.

    Attributes
    ----------
    prefix : str
        Prefix of its ports' names: ``i_``, ``m_axis_features_t``.
    fields : mapping of str to int
        Widths of the ports that carry data.
    has_ready : bool
        Whether it can stall.
    rows : sequence of Row
        The rows to send, or the expected ones.
    clock : str
    condition : str
        A Verilog expression; rows are sent only while it is true.
    """

    prefix: str
    fields: Mapping[str, int]
    has_ready: bool
    rows: Sequence[Row]
    clock: str
    condition: str

    @property
    def name(self) -> str:
        """Name of its variables and files in the bench."""
        return self.prefix.rstrip("_")

    @property
    def valid(self) -> str:
        """The port that is high with a row."""
        return f"{self.prefix}valid"

    @property
    def ready(self) -> str:
        """The port that accepts a row; only with ``has_ready``."""
        return f"{self.prefix}ready"

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
    """A test bench for a Verilog module.

    Attributes
    ----------
    module : str
    ports : mapping of str to Port
    inputs, outputs : mapping of str to sequence of Row
        For the prefix of each stream, the rows to send and the expected ones, in order.
    settings : mapping of str to int
        Values of other inputs, which stay.
    spacing_cycles : int
        Minimum number of clocks from one input to the next.
    clocks : mapping of str to str
        Clocks of streams that do not have ``clock``, by prefix.
    conditions : mapping of str to str
        Verilog expressions for inputs that wait until they are true, by prefix.
    clock, reset : str
    reset_level : {0, 1}
        Active level of ``reset``.
    """

    module: str
    ports: Mapping[str, Port]
    inputs: Mapping[str, Sequence[Row]]
    outputs: Mapping[str, Sequence[Row]]
    settings: Mapping[str, int]
    spacing_cycles: int = 1
    clocks: Mapping[str, str] = field(default_factory=dict)
    conditions: Mapping[str, str] = field(default_factory=dict)
    clock: str = "clk"
    reset: str = "rst"
    reset_level: int = 1

    def files(self) -> dict[str, str]:
        """The files of the bench by name: Verilog, and vectors."""
        sources = [self._channel(*each) for each in self.inputs.items()]
        sinks = [self._channel(*each) for each in self.outputs.items()]
        files = {f"{each.name}.hex": each.words()[0] for each in (*sources, *sinks)}
        files |= {f"{each.name}_specified.hex": each.words()[1] for each in sinks}
        parts = [
            f"// Self-checking test bench of {self.module}; vectors from the golden model of skymosaic.",
            "`timescale 1ns / 1ps",
            f"module {self.module}_tb;",
            *self._declarations(),
            f"  {self.module} dut (",
            ",\n".join(f"    .{port}({port})" for port in self.ports),
            "  );",
            f"  wire running = {self.reset} != {self.reset_level};",
            "  integer cycle = 0;",
            "  integer idle = 0;",
            *(_source(each, self.spacing_cycles) for each in sources),
            *(_sink(each) for each in sinks),
            # Their edges meet those of the other clock in all phases.
            *(f"  always #7.3 {clock} = !{clock};" for clock in set(self.clocks.values())),
            self._control(sinks),
            "endmodule",
        ]
        return {**files, f"{self.module}_tb.v": "\n".join(parts) + "\n"}

    def _channel(self, prefix: str, rows: Sequence[Row]) -> Channel:
        names = [name for name in self.ports if name.startswith(prefix) and name not in self.settings]
        handshake = (f"{prefix}valid", f"{prefix}ready")
        return Channel(
            prefix,
            {name: self.ports[name].bits for name in names if name not in handshake},
            handshake[1] in names,
            rows,
            self.clocks.get(prefix, self.clock),
            self.conditions.get(prefix, "1"),
        )

    def _declarations(self) -> list[str]:
        lines = []
        clocks = dict.fromkeys((self.clock, *self.clocks.values()), 0)
        starts = {**clocks, self.reset: self.reset_level, **self.settings}
        for name, port in self.ports.items():
            bits = f"[{port.bits - 1}:0] " if port.bits > 1 else ""
            start = starts.get(name)
            value = "" if start is None else f" = {port.bits}'d{start}"
            lines.append(f"  {'reg' if port.is_input else 'wire'} {bits}{name}{value};")
        return lines

    def _control(self, sinks: Sequence[Channel]) -> str:
        complete = " && ".join(f"{each.name}_next == {len(each.rows)}" for each in sinks)
        answers = " || ".join(f"{each.name}_taken" for each in sinks)
        return f"""
  always #5 {self.clock} = !{self.clock};
  always @(posedge {self.clock}) begin
    cycle <= cycle + 1;
    // Here alone: of assignments in two blocks at one edge, either may be the last.
    idle <= running && ({answers}) ? 0 : idle + 1;
    if (cycle == {RESET_CYCLES}) {self.reset} <= {1 - self.reset_level};
    if (idle > {IDLE_CYCLES}) begin
      $display("FAIL: no answer for {IDLE_CYCLES} cycles");
      $fatal(1);
    end
    // A while longer, in which nothing may come.
    if ({complete} && idle > 200) begin
      $display("PASS: {sum(len(each.rows) for each in sinks)} answers in %0d cycles", cycle);
      $finish;
    end
  end"""


def _source(channel: Channel, spacing_cycles: int) -> str:
    """The Verilog that sends the rows, with gaps; fields are unknown (X) in clocks without a row."""
    name, unknown = channel.name, f"{{{channel.bits}{{1'bx}}}}"
    taken = f"{channel.valid} && {channel.ready}" if channel.has_ready else channel.valid
    # Gaps every 7 clocks and stalls every 5 meet in all phases. Unknowns between rows betray a block that reads them.
    return f"""
  reg [{channel.bits - 1}:0] {name}_rows [0:{len(channel.rows) - 1}];
  integer {name}_next = 0;
  integer {name}_wait = 0;
  initial begin
    $readmemh("{name}.hex", {name}_rows);
    {channel.valid} = 0;
    {channel.data} = {unknown};
  end
  always @(posedge {channel.clock}) if (running) begin
    if ({name}_wait > 0) {name}_wait <= {name}_wait - 1;
    if (!{channel.valid} || ({taken})) begin
      if ({name}_next < {len(channel.rows)} && {name}_wait == 0 && cycle % 7 != 3 && {channel.condition}) begin
        {channel.valid} <= 1;
        {channel.data} <= {name}_rows[{name}_next];
        {name}_next <= {name}_next + 1;
        {name}_wait <= {spacing_cycles - 1};
      end else begin
        {channel.valid} <= 0;
        {channel.data} <= {unknown};
      end
    end
  end"""


def _sink(channel: Channel) -> str:
    """The Verilog that accepts answers, with stalls, and compares their specified bits."""
    name, bits, rows = channel.name, channel.bits, len(channel.rows)
    taken, stalls = f"{channel.valid} === 1'b1", ""
    if channel.has_ready:
        taken += f" && {channel.ready}"
        stalls = f"""
  initial {channel.ready} = 0;
  always @(posedge {channel.clock}) {channel.ready} <= cycle % 5 != 2;"""
    return f"""
  reg [{bits - 1}:0] {name}_rows [0:{rows - 1}];
  reg [{bits - 1}:0] {name}_specified [0:{rows - 1}];
  integer {name}_next = 0;
  initial begin
    $readmemh("{name}.hex", {name}_rows);
    $readmemh("{name}_specified.hex", {name}_specified);
  end{stalls}
  wire {name}_taken = {taken};
  always @(posedge {channel.clock}) if (running) begin
    if ({channel.valid} === 1'bx) begin
      $display("FAIL: {channel.valid} is unknown in cycle %0d", cycle);
      $fatal(1);
    end
    if ({name}_taken) begin
      if ({name}_next >= {rows}) begin
        $display("FAIL: {name} gives more than {rows} answers");
        $fatal(1);
      end
      if ((({channel.data} ^ {name}_rows[{name}_next]) & {name}_specified[{name}_next]) !== {bits}'d0) begin
        $display("FAIL: {name} answer %0d is %h, expected %h, specified bits %h", {name}_next, {channel.data},
                 {name}_rows[{name}_next], {name}_specified[{name}_next]);
        $fatal(1);
      end
      {name}_next <= {name}_next + 1;
    end
  end"""
