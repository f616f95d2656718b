"""A small system in FLL, after the example in IEC 61131-7: its ramps cross at 15 degrees and 75 bar."""

VALVE = """\
Engine: valve
InputVariable: temp
  range: 3 27
  term: cold Ramp 27 3
  term: hot Ramp 3 27   # they cross at 15
InputVariable: pressure
  range: 55 95
  term: low Ramp 95 55
  term: high Ramp 55 95
OutputVariable: valve
  range: -100 100
  defuzzifier: WeightedAverage
  default: 0
  term: drainage Constant -100
  term: closed Constant 0
  term: inlet Constant 100
RuleBlock: rules
  conjunction: Minimum
  rule: if temp is cold and pressure is low then valve is inlet
  rule: if temp is cold and pressure is high then valve is closed
  rule: if (temp is hot) and (pressure is low) then valve is closed
  rule: IF temp IS hot AND pressure IS high THEN valve IS drainage
"""
PRODUCT = VALVE.replace("Minimum", "AlgebraicProduct")
