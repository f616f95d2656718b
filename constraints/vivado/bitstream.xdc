# Pins are in bitstream_pins.xdc, on boards where anything leaves the chip other than through a processing system.
set_property BITSTREAM.GENERAL.COMPRESS TRUE [current_design]
