# Clock, reset button and LED 4 (the interrupt) of the Arty A7, from Digilent's master constraints.
set_property -dict {PACKAGE_PIN E3 IOSTANDARD LVCMOS33} [get_ports clock_in]
set_property -dict {PACKAGE_PIN C2 IOSTANDARD LVCMOS33} [get_ports reset_in_n]
set_property -dict {PACKAGE_PIN H5 IOSTANDARD LVCMOS33} [get_ports interrupt_out]
set_property CFGBVS VCCO [current_design]
set_property CONFIG_VOLTAGE 3.3 [current_design]
