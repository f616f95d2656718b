"""Whole designs in Verilator and in Amaranth's own simulator."""
