"""Zero-order Sugeno systems: in real numbers, read from FLL or MATLAB's files, and as the hardware's integers."""
