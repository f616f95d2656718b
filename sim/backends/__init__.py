"""What computes features and matches: the interface, the golden model and a board."""
