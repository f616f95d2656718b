"""What computes features and matches: the interface, and the golden model behind it."""
