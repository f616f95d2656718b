// Self-checking test bench of {{ module }}; vectors from the golden model of skymosaic.
module {{ module }}_tb;
{% for name, port in ports.items() %}
  {{ "reg" if port.is_input else "wire" }} {% if port.bits > 1 %}[{{ port.bits - 1 }}:0] {% endif %}{{ name }}
  {%- if name in starts %} = {{ port.bits }}'d{{ starts[name] }}{% endif %};
{% endfor %}
  {{ module }} dut (
{% for name in ports %}
    .{{ name }}({{ name }}){{ "," if not loop.last }}
{% endfor %}
  );
  // +dump=waves.vcd writes all signals.
  reg [8191:0] dump;
  initial if ($value$plusargs("dump=%s", dump)) begin
    $dumpfile(dump);
    $dumpvars(0, {{ module }}_tb);
  end
  wire running = {{ reset }} != {{ reset_level }};
  integer cycle = 0;
  integer idle = 0;
{# Sends the rows of a stream with gaps; its fields are unknown (X) in clocks without a row. Gaps every 7 clocks and
   stalls every 5 meet in all phases. Unknowns between rows betray a block that reads them. #}
{% for each in sources %}
{% set name, count = each.name, each.rows | length %}

  reg [{{ each.bits - 1 }}:0] {{ name }}_vectors [0:{{ count - 1 }}];
  integer {{ name }}_next = 0;
  integer {{ name }}_wait = 0;
  initial begin
    $readmemh("{{ name }}.hex", {{ name }}_vectors);
    {{ each.prefix }}valid = 0;
    {{ each.data }} = {{ each.bits }}'bx;
  end
  always @(posedge {{ each.clock }}) if (running) begin
    if ({{ name }}_wait > 0) {{ name }}_wait <= {{ name }}_wait - 1;
    if (!{{ each.prefix }}valid || ({{ each.prefix }}valid{{ " && " ~ each.prefix ~ "ready" if each.has_ready }})) begin
      if ({{ name }}_next < {{ count }} && {{ name }}_wait == 0 && cycle % 7 != 3 && {{ each.condition }}) begin
        {{ each.prefix }}valid <= 1;
        {{ each.data }} <= {{ name }}_vectors[{{ name }}_next];
        {{ name }}_next <= {{ name }}_next + 1;
        {{ name }}_wait <= {{ spacing_cycles - 1 }};
      end else begin
        {{ each.prefix }}valid <= 0;
        {{ each.data }} <= {{ each.bits }}'bx;
      end
    end
  end
{% endfor %}
{# Accepts the answers of a stream, with stalls, and compares their specified bits. #}
{% for each in sinks %}
{% set name, count = each.name, each.rows | length %}

  reg [{{ each.bits - 1 }}:0] {{ name }}_vectors [0:{{ count - 1 }}];
  reg [{{ each.bits - 1 }}:0] {{ name }}_specified [0:{{ count - 1 }}];
  integer {{ name }}_next = 0;
  initial begin
    $readmemh("{{ name }}.hex", {{ name }}_vectors);
    $readmemh("{{ name }}_specified.hex", {{ name }}_specified);
  end
{% if each.has_ready %}
  initial {{ each.prefix }}ready = 0;
  always @(posedge {{ each.clock }}) {{ each.prefix }}ready <= cycle % 5 != 2;
{% endif %}
  wire {{ name }}_taken = {{ each.prefix }}valid === 1'b1{{ " && " ~ each.prefix ~ "ready" if each.has_ready }};
  always @(posedge {{ each.clock }}) if (running) begin
    if ({{ each.prefix }}valid === 1'bx) begin
      $display("FAIL: {{ each.prefix }}valid is unknown in cycle %0d", cycle);
      $fatal(1);
    end
    if ({{ name }}_taken) begin
      if ({{ name }}_next >= {{ count }}) begin
        $display("FAIL: {{ name }} gives more than {{ count }} answers");
        $fatal(1);
      end
      if ((({{ each.data }} ^ {{ name }}_vectors[{{ name }}_next]) & {{ name }}_specified[{{ name }}_next]) !== {{ each.bits }}'d0) begin
        $display("FAIL: {{ name }} answer %0d is %h, expected %h, specified bits %h", {{ name }}_next, {{ each.data }},
                 {{ name }}_vectors[{{ name }}_next], {{ name }}_specified[{{ name }}_next]);
        $fatal(1);
      end
      {{ name }}_next <= {{ name }}_next + 1;
    end
  end
{% endfor %}
{% if memory %}
{# Takes a burst at a time on each port, with stalls. It begins unknown, so that what reads too early or elsewhere is
   seen, and gives unknown data in clocks without a word. #}

  // A memory behind AXI4; in the end it is as expected.
  reg [63:0] memory [0:{{ memory.words | length - 1 }}];
  reg [63:0] memory_expected [0:{{ memory.words | length - 1 }}];
  initial $readmemh("memory.hex", memory_expected);
{% for each in memory.writers %}
  integer {{ each }}left = 0;
  integer {{ each }}word;
  integer {{ each }}bursts = 0;
  integer {{ each }}byte;
  initial begin
    {{ each }}bvalid = 0;
    {{ each }}bresp = 0;
  end
  always @* {{ each }}awready = !{{ each }}left && !{{ each }}bvalid && cycle % 5 != 2;
  always @* {{ each }}wready = {{ each }}left && cycle % 7 != 3;
  always @(posedge {{ clock }}) if (running) begin
    if ({{ each }}awvalid && {{ each }}awready) begin
      {{ each }}left <= {{ each }}awlen + 1;
      {{ each }}word <= ({{ each }}awaddr - 64'd{{ memory.base }}) / 8;
    end
    if ({{ each }}wvalid && {{ each }}wready) begin
      if ({{ each }}word < 0 || {{ each }}word >= {{ memory.words | length }} || {{ each }}wlast !== ({{ each }}left == 1)) begin
        $display("FAIL: {{ each }}w is not a word of a burst into the memory in cycle %0d", cycle);
        $fatal(1);
      end
      for ({{ each }}byte = 0; {{ each }}byte < 8; {{ each }}byte = {{ each }}byte + 1)
        if ({{ each }}wstrb[{{ each }}byte]) memory[{{ each }}word][8*{{ each }}byte+:8] <= {{ each }}wdata[8*{{ each }}byte+:8];
      {{ each }}left <= {{ each }}left - 1;
      {{ each }}word <= {{ each }}word + 1;
      {{ each }}bvalid <= {{ each }}left == 1;
    end
    if ({{ each }}bvalid && {{ each }}bready) begin
      {{ each }}bvalid <= 0;
      {{ each }}bursts <= {{ each }}bursts + 1;
    end
  end
{% endfor %}
{% for each in memory.readers %}
  integer {{ each }}left = 0;
  integer {{ each }}word;
  initial begin
    {{ each }}rvalid = 0;
    {{ each }}rresp = 0;
  end
  always @* {{ each }}arready = !{{ each }}left && cycle % 5 != 2;
  always @(posedge {{ clock }}) if (running) begin
    if ({{ each }}arvalid && {{ each }}arready) begin
      {{ each }}left <= {{ each }}arlen + 1;
      {{ each }}word <= ({{ each }}araddr - 64'd{{ memory.base }}) / 8;
    end
    if (!{{ each }}rvalid || {{ each }}rready) begin
      {{ each }}rvalid <= {{ each }}left && cycle % 7 != 3;
      {{ each }}rlast <= {{ each }}left == 1;
      {{ each }}rdata <= 64'bx;
      if ({{ each }}left && cycle % 7 != 3) begin
        {{ each }}rdata <= memory[{{ each }}word];
        {{ each }}left <= {{ each }}left - 1;
        {{ each }}word <= {{ each }}word + 1;
      end
    end
  end
{% endfor %}
  wire memory_written = {% for each in memory.writers %}({{ each }}wvalid && {{ each }}wready){{ " || " if not loop.last }}{% endfor %};
  wire memory_done = {% for each in memory.writers %}{{ each }}bursts{{ " + " if not loop.last }}{% endfor %} == {{ memory.bursts }};
  integer at;
{% endif %}
{# The edges of other clocks meet those of the first in all phases. #}
{% for each in other_clocks %}
  always #7.3 {{ each }} = !{{ each }};
{% endfor %}

  always #5 {{ clock }} = !{{ clock }};
  always @(posedge {{ clock }}) begin
    cycle <= cycle + 1;
    // Here alone: of assignments in two blocks at one edge, either may be the last.
    idle <= running && ({% for each in sinks %}{{ each.name }}_taken{{ " || " if not loop.last }}{% endfor %}{{ " || memory_written" if memory }}) ? 0 : idle + 1;
    if (cycle == {{ reset_cycles }}) {{ reset }} <= {{ 1 - reset_level }};
    if (idle > {{ idle_cycles }}) begin
      $display("FAIL: no answer for {{ idle_cycles }} cycles");
      $fatal(1);
    end
    // A while longer, in which nothing may come.
    if ({% for each in sinks %}{{ each.name }}_next == {{ each.rows | length }} && {% endfor %}{{ "memory_done && " if memory }}idle > 200) begin
{% if memory %}
      for (at = 0; at < {{ memory.words | length }}; at = at + 1) if (memory[at] !== memory_expected[at]) begin
        $display("FAIL: memory at %h is %h, expected %h", 64'd{{ memory.base }} + 8 * at, memory[at], memory_expected[at]);
        $fatal(1);
      end
{% endif %}
      $display("PASS: {{ sinks | map(attribute="rows") | map("length") | sum }} answers in %0d cycles", cycle);
      $finish;
    end
  end
endmodule
