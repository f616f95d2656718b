"""The streaming shell of a live build: from a camera's clock to rings of packets in memory, without software."""
