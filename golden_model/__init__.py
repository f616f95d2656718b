"""Integer NumPy models: the definition of what the hardware computes."""
