# For synthesis out of context only; in a block design the clock comes from the processing system.
create_clock -name aclk -period 6.667 [get_ports aclk]
