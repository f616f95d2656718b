"""User-defined zero-order Sugeno systems: read from FLL files, evaluated, turned into integers and Verilog."""
