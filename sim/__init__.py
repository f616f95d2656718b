"""Run the designs: one interface, three simulators and a board, and synthetic flights as their input."""
