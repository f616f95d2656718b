"""The accelerator's AXI side: video input, packet outputs, AXI4-Lite access, and bursts to memory."""
