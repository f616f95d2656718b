"""What leaves the project: Verilog, IP packaging, boards and register documents."""
