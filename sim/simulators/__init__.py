"""Whole designs in Verilator, and the comparison of their results with the golden model."""
