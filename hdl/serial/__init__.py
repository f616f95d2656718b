"""The accelerator behind a serial port, for boards without a processor that open tools can build for."""
