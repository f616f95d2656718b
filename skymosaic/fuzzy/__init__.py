"""User-defined fuzzy systems: how far the integer model is from real numbers, and Verilog."""
