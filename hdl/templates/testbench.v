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

  reg [{{ each.bits - 1 }}:0] {{ name }}_rows [0:{{ count - 1 }}];
  integer {{ name }}_next = 0;
  integer {{ name }}_wait = 0;
  initial begin
    $readmemh("{{ name }}.hex", {{ name }}_rows);
    {{ each.prefix }}valid = 0;
    {{ each.data }} = {{ each.bits }}'bx;
  end
  always @(posedge {{ each.clock }}) if (running) begin
    if ({{ name }}_wait > 0) {{ name }}_wait <= {{ name }}_wait - 1;
    if (!{{ each.prefix }}valid || ({{ each.prefix }}valid{{ " && " ~ each.prefix ~ "ready" if each.has_ready }})) begin
      if ({{ name }}_next < {{ count }} && {{ name }}_wait == 0 && cycle % 7 != 3 && {{ each.condition }}) begin
        {{ each.prefix }}valid <= 1;
        {{ each.data }} <= {{ name }}_rows[{{ name }}_next];
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

  reg [{{ each.bits - 1 }}:0] {{ name }}_rows [0:{{ count - 1 }}];
  reg [{{ each.bits - 1 }}:0] {{ name }}_specified [0:{{ count - 1 }}];
  integer {{ name }}_next = 0;
  initial begin
    $readmemh("{{ name }}.hex", {{ name }}_rows);
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
      if ((({{ each.data }} ^ {{ name }}_rows[{{ name }}_next]) & {{ name }}_specified[{{ name }}_next]) !== {{ each.bits }}'d0) begin
        $display("FAIL: {{ name }} answer %0d is %h, expected %h, specified bits %h", {{ name }}_next, {{ each.data }},
                 {{ name }}_rows[{{ name }}_next], {{ name }}_specified[{{ name }}_next]);
        $fatal(1);
      end
      {{ name }}_next <= {{ name }}_next + 1;
    end
  end
{% endfor %}
{# The edges of other clocks meet those of the first in all phases. #}
{% for each in other_clocks %}
  always #7.3 {{ each }} = !{{ each }};
{% endfor %}

  always #5 {{ clock }} = !{{ clock }};
  always @(posedge {{ clock }}) begin
    cycle <= cycle + 1;
    // Here alone: of assignments in two blocks at one edge, either may be the last.
    idle <= running && ({% for each in sinks %}{{ each.name }}_taken{{ " || " if not loop.last }}{% endfor %}) ? 0 : idle + 1;
    if (cycle == {{ reset_cycles }}) {{ reset }} <= {{ 1 - reset_level }};
    if (idle > {{ idle_cycles }}) begin
      $display("FAIL: no answer for {{ idle_cycles }} cycles");
      $fatal(1);
    end
    // A while longer, in which nothing may come.
    if ({% for each in sinks %}{{ each.name }}_next == {{ each.rows | length }} && {% endfor %}idle > 200) begin
      $display("PASS: {{ sinks | map(attribute="rows") | map("length") | sum }} answers in %0d cycles", cycle);
      $finish;
    end
  end
endmodule
