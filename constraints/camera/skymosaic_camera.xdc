# Paths between the two clocks of skymosaic_camera: read_xdc -ref skymosaic_camera skymosaic_camera.xdc
# The bits of a Gray counter must arrive within one clock of each other. 6.6 ns is less than a period of any clock up to 150 MHz: take less for a faster one. Its
# highest bit equals that of the binary counter beside it: a tool may keep either register of the two.
set_max_delay -datapath_only 6.6 -from [get_cells {core/shell/crossing/queue/unbuffered/produce_w_gry_reg[*] core/shell/crossing/queue/unbuffered/produce_w_bin_reg[*]}] -to [get_cells {core/shell/crossing/queue/unbuffered/produce_cdc/stage0_reg[*]}]
set_max_delay -datapath_only 6.6 -from [get_cells {core/shell/crossing/queue/unbuffered/consume_r_gry_reg[*] core/shell/crossing/queue/unbuffered/consume_r_bin_reg[*]}] -to [get_cells {core/shell/crossing/queue/unbuffered/consume_cdc/stage0_reg[*]}]
# Resets: asynchronous where they begin, synchronised where they end.
set_false_path -to [get_pins {camera_reset/stage0_reg/PRE camera_reset/stage1_reg/PRE}]
set_false_path -to [get_pins {core/shell/crossing/queue/unbuffered/rst_cdc/stage0_reg/PRE core/shell/crossing/queue/unbuffered/rst_cdc/stage1_reg/PRE}]
