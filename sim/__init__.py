"""Runs the designs: simulators and a board behind one interface, test benches, and synthetic flights as input."""
