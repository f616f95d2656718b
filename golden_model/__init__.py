"""Integer NumPy models that define, bit for bit, what the hardware computes."""
