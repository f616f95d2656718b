# Zynq-7000: the processor reaches the registers through a general-purpose port, the DMAs the memory through a
# high-performance one.
set ps [create_bd_cell -type ip -vlnv xilinx.com:ip:processing_system7:5.5 ps]
set_property -dict [list \
    CONFIG.PCW_CRYSTAL_PERIPHERAL_FREQMHZ $board(clock_mhz) \
    CONFIG.PCW_UIPARAM_DDR_PARTNO $board(ddr_part) \
    CONFIG.PCW_UIPARAM_DDR_BUS_WIDTH $board(ddr_width) \
    CONFIG.PCW_FPGA0_PERIPHERAL_FREQMHZ $clock_mhz \
    CONFIG.PCW_USE_M_AXI_GP0 1 \
    CONFIG.PCW_USE_S_AXI_HP0 1 \
    CONFIG.PCW_USE_FABRIC_INTERRUPT 1 \
    CONFIG.PCW_IRQ_F2P_INTR 1 \
] $ps
set_property CONFIG.PCW_EN_CLK0_PORT 1 $ps
make_bd_intf_pins_external [get_bd_intf_pins ps/DDR] [get_bd_intf_pins ps/FIXED_IO]
array set system {
    clock       ps/FCLK_CLK0
    reset_n     ps/FCLK_RESET0_N
    manager     ps/M_AXI_GP0
    memory      ps/S_AXI_HP0
    clocked     {ps/M_AXI_GP0_ACLK ps/S_AXI_HP0_ACLK}
    reset       {}
    address_bits 32
}
set system(interrupt) [get_bd_pins ps/IRQ_F2P]
