# Artix-7, without a processor: a JTAG cable reaches registers and 128 KB of block RAM, which the DMAs share.
create_bd_port -dir I -type clk -freq_hz [expr {int($board(clock_mhz) * 1000000)}] clock_in
create_bd_port -dir I -type rst reset_in_n
create_bd_port -dir O interrupt_out
set pll [create_bd_cell -type ip -vlnv xilinx.com:ip:clk_wiz:6.0 pll]
set_property -dict [list \
    CONFIG.PRIM_IN_FREQ $board(clock_mhz) \
    CONFIG.CLKOUT1_REQUESTED_OUT_FREQ $clock_mhz \
    CONFIG.RESET_TYPE ACTIVE_LOW \
    CONFIG.RESET_PORT resetn \
] $pll
connect_bd_net [get_bd_ports clock_in] [get_bd_pins pll/clk_in1]
connect_bd_net [get_bd_ports reset_in_n] [get_bd_pins pll/resetn]

set jtag [create_bd_cell -type ip -vlnv xilinx.com:ip:jtag_axi:1.2 jtag]
create_bd_cell -type ip -vlnv xilinx.com:ip:smartconnect:1.0 from_jtag
set_property -dict {CONFIG.NUM_SI 1 CONFIG.NUM_MI 2} [get_bd_cells from_jtag]
connect_bd_intf_net [get_bd_intf_pins jtag/M_AXI] [get_bd_intf_pins from_jtag/S00_AXI]

create_bd_cell -type ip -vlnv xilinx.com:ip:smartconnect:1.0 to_ram
set_property -dict {CONFIG.NUM_SI 2 CONFIG.NUM_MI 1} [get_bd_cells to_ram]
set ram_control [create_bd_cell -type ip -vlnv xilinx.com:ip:axi_bram_ctrl:4.1 ram_control]
set_property -dict {CONFIG.SINGLE_PORT_BRAM 1 CONFIG.DATA_WIDTH 64} $ram_control
create_bd_cell -type ip -vlnv xilinx.com:ip:blk_mem_gen:8.4 ram
connect_bd_intf_net [get_bd_intf_pins from_jtag/M01_AXI] [get_bd_intf_pins to_ram/S01_AXI]
connect_bd_intf_net [get_bd_intf_pins to_ram/M00_AXI] [get_bd_intf_pins ram_control/S_AXI]
connect_bd_intf_net [get_bd_intf_pins ram_control/BRAM_PORTA] [get_bd_intf_pins ram/BRAM_PORTA]
array set system {
    clock       pll/clk_out1
    reset_n     pll/locked
    manager     from_jtag/M00_AXI
    memory      to_ram/S00_AXI
    clocked     {jtag/aclk from_jtag/aclk to_ram/aclk ram_control/s_axi_aclk}
    reset       {jtag/aresetn from_jtag/aresetn to_ram/aresetn ram_control/s_axi_aresetn}
    address_bits 32
    memory_name ram_control
    memory_size 128K
}
set system(interrupt) [get_bd_ports interrupt_out]
