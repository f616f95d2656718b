"""Your own zero-order Sugeno systems: read from FLL files, evaluated, and turned into the integer model."""
