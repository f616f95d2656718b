"""Zero-order Sugeno systems: in real numbers, read from FLL files, and as the tables and integers of the hardware."""
