"""Whole designs in Verilator and in Amaranth's own simulator, and the comparison of their results."""
