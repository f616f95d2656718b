"""Benches at the AXI boundary of the exported Verilog: cocotb with the AXI managers and streams of cocotbext-axi.

`sim.cocotb.runner` compiles and runs; `sim.cocotb.bench` is what the benches share; ``access``, ``frames``,
``faults`` and ``settings`` hold the cases. cocotb re-enters Python at every clock, so frames are small here; whole ones
belong to `sim.simulators.verilator`.
"""
