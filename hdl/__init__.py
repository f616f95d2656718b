"""The vision front end in Amaranth HDL, one file for each golden-model block."""
