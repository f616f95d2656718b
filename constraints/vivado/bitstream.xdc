# Nothing leaves the chip but through the processing system, so there are no pins to place.
set_property BITSTREAM.GENERAL.COMPRESS TRUE [current_design]
