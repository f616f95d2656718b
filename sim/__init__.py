"""Runs the designs: simulators and the golden model behind one interface, test benches, and synthetic flights."""
