"""The streaming shell of a camera build: from a camera's clock to rings of packets in memory, without software."""
