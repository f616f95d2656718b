"""The accelerator's AXI side: video input, packet outputs, AXI4-Lite registers and their documentation."""
