"""The AXI4-Lite register maps and the register file that serves them."""
