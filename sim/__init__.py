"""Runs the designs: one interface, four simulators, and synthetic flights to feed them."""
