# Zynq UltraScale+: as on the Zynq-7000. The memory is not set here: the module's boot firmware does that. Both ports
# have the 128 bits that they start with: PYNQ sets their width registers, another Linux does not, and where port and
# register differ, words are lost without an error.
set ps [create_bd_cell -type ip -vlnv [lindex [lsort [get_ipdefs xilinx.com:ip:zynq_ultra_ps_e:*]] end] ps]
set_property -dict [list \
    CONFIG.PSU__PSS_REF_CLK__FREQMHZ $board(clock_mhz) \
    CONFIG.PSU__FPGA_PL0_ENABLE 1 \
    CONFIG.PSU__CRL_APB__PL0_REF_CTRL__FREQMHZ $clock_mhz \
    CONFIG.PSU__USE__M_AXI_GP0 1 \
    CONFIG.PSU__USE__M_AXI_GP1 0 \
    CONFIG.PSU__USE__M_AXI_GP2 0 \
    CONFIG.PSU__USE__S_AXI_GP2 1 \
    CONFIG.PSU__MAXIGP0__DATA_WIDTH 128 \
    CONFIG.PSU__SAXIGP2__DATA_WIDTH 128 \
    CONFIG.PSU__HIGH_ADDRESS__ENABLE 1 \
    CONFIG.PSU__USE__IRQ0 1 \
] $ps
# Half of the memory lies beyond 32 address bits.
array set system {
    clock       ps/pl_clk0
    reset_n     ps/pl_resetn0
    manager     ps/M_AXI_HPM0_FPD
    memory      ps/S_AXI_HP0_FPD
    clocked     {ps/maxihpm0_fpd_aclk ps/saxihp0_fpd_aclk}
    reset       {}
    address_bits 40
}
set system(interrupt) [get_bd_pins ps/pl_ps_irq0]
