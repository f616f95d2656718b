"""Zero-order Sugeno systems of anyone: read from FLL and FCL files, evaluated, and turned into the integer model."""
