"""Single blocks for export: with flat ports, and with vectors of the golden model for a test bench."""
