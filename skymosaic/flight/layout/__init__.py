"""One layout of all photographs of a flight, from their links."""
