# Builds the bitstream: the board's system (system.tcl), a DMA per stream, interrupt controller, skymosaic.
#
#   vivado -mode batch -source build.tcl                  fabric clock of 150 MHz
#   vivado -mode batch -source build.tcl -tclargs 125     another one
#
# Run package_ip.tcl first. Results in vivado/result: skymosaic.bit, skymosaic.hwh, utilisation and timing reports.

set here [file normalize [file dirname [info script]]]
source [file join $here board.tcl]
set clock_mhz [expr {[llength $argv] > 0 ? [lindex $argv 0] : 150}]
set result [file join $here result]
file mkdir $result

create_project -force -part $board(part) skymosaic_$board(name) [file join $here project]
set_property ip_repo_paths [file join $here ip] [current_project]
update_ip_catalog
create_bd_design skymosaic_system

# What masters the registers, holds the frames and gives the clock.
source [file join $here system.tcl]

create_bd_cell -type ip -vlnv $board(core) skymosaic
create_bd_cell -type ip -vlnv xilinx.com:ip:proc_sys_reset:5.0 reset

# 26 bits of length: a transfer of up to 64 MB.
proc make_dma {name directions} {
    global system
    set dma [create_bd_cell -type ip -vlnv xilinx.com:ip:axi_dma:7.1 $name]
    set_property -dict [concat {CONFIG.c_include_sg 0 CONFIG.c_sg_length_width 26} $directions] $dma
    set_property CONFIG.c_addr_width $system(address_bits) $dma
}
# A DMA has no stream of 24 or 48 bits: the last quarter of its words is dropped.
set dma_bits $board(video_bits)
if {$dma_bits % 24 == 0} {
    set dma_bits [expr {$dma_bits / 3 * 4}]
}
make_dma dma_video "
    CONFIG.c_include_mm2s 1 CONFIG.c_include_s2mm 0
    CONFIG.c_m_axis_mm2s_tdata_width $dma_bits CONFIG.c_m_axi_mm2s_data_width 64
"
foreach output $board(outputs) {
    make_dma dma_$output {
        CONFIG.c_include_mm2s 0 CONFIG.c_include_s2mm 1
        CONFIG.c_s_axis_s2mm_tdata_width 64 CONFIG.c_m_axi_s2mm_data_width 64
    }
    connect_bd_intf_net [get_bd_intf_pins skymosaic/m_axis_$output] [get_bd_intf_pins dma_$output/S_AXIS_S2MM]
}
set clocked $system(clocked)
set reset $system(reset)
if {$dma_bits == $board(video_bits)} {
    connect_bd_intf_net [get_bd_intf_pins dma_video/M_AXIS_MM2S] [get_bd_intf_pins skymosaic/s_axis_video]
} else {
    create_bd_cell -type ip -vlnv xilinx.com:ip:axis_subset_converter:1.1 to_rgb
    set last_bit [expr {$board(video_bits) - 1}]
    set_property -dict [list \
        CONFIG.S_TDATA_NUM_BYTES.VALUE_SRC USER CONFIG.M_TDATA_NUM_BYTES.VALUE_SRC USER \
        CONFIG.S_TDATA_NUM_BYTES [expr {$dma_bits / 8}] CONFIG.M_TDATA_NUM_BYTES [expr {$board(video_bits) / 8}] \
        CONFIG.TDATA_REMAP "tdata\[$last_bit:0\]" \
    ] [get_bd_cells to_rgb]
    connect_bd_intf_net [get_bd_intf_pins dma_video/M_AXIS_MM2S] [get_bd_intf_pins to_rgb/S_AXIS]
    connect_bd_intf_net [get_bd_intf_pins to_rgb/M_AXIS] [get_bd_intf_pins skymosaic/s_axis_video]
    lappend clocked to_rgb/aclk
    lappend reset to_rgb/aresetn
}

# PYNQ serves one fabric interrupt, IRQ_F2P[0]: a controller gathers all.
create_bd_cell -type ip -vlnv xilinx.com:ip:axi_intc:4.1 interrupts
set_property CONFIG.C_IRQ_CONNECTION 1 [get_bd_cells interrupts]
# From Vivado 2024.2 on, ilconcat stands for xlconcat, which will go.
set concat [lindex [get_ipdefs xilinx.com:inline_hdl:ilconcat:*] end]
if {$concat ne ""} {
    create_bd_cell -type inline_hdl -vlnv $concat sources
} else {
    create_bd_cell -type ip -vlnv xilinx.com:ip:xlconcat:2.1 sources
}
set interrupts {skymosaic/interrupt dma_video/mm2s_introut}
foreach output $board(outputs) {
    lappend interrupts dma_$output/s2mm_introut
}
set_property CONFIG.NUM_PORTS [llength $interrupts] [get_bd_cells sources]
set number 0
foreach pin $interrupts {
    connect_bd_net [get_bd_pins $pin] [get_bd_pins sources/In$number]
    incr number
}
connect_bd_net [get_bd_pins sources/dout] [get_bd_pins interrupts/intr]
connect_bd_net [get_bd_pins interrupts/irq] $system(interrupt)

# Registers from the system's manager, memory from the DMAs.
create_bd_cell -type ip -vlnv xilinx.com:ip:smartconnect:1.0 to_registers
create_bd_cell -type ip -vlnv xilinx.com:ip:smartconnect:1.0 to_memory
connect_bd_intf_net [get_bd_intf_pins $system(manager)] [get_bd_intf_pins to_registers/S00_AXI]
set with_registers {skymosaic/s_axi_ctrl dma_video/S_AXI_LITE interrupts/s_axi}
set with_memory {dma_video/M_AXI_MM2S}
foreach output $board(outputs) {
    lappend with_registers dma_$output/S_AXI_LITE
    lappend with_memory dma_$output/M_AXI_S2MM
}
set_property -dict [list CONFIG.NUM_SI 1 CONFIG.NUM_MI [llength $with_registers]] [get_bd_cells to_registers]
set_property -dict [list CONFIG.NUM_SI [llength $with_memory] CONFIG.NUM_MI 1] [get_bd_cells to_memory]
set number 0
foreach pin $with_registers {
    connect_bd_intf_net [get_bd_intf_pins to_registers/M0${number}_AXI] [get_bd_intf_pins $pin]
    incr number
}
set number 0
foreach pin $with_memory {
    connect_bd_intf_net [get_bd_intf_pins $pin] [get_bd_intf_pins to_memory/S0${number}_AXI]
    incr number
}
connect_bd_intf_net [get_bd_intf_pins to_memory/M00_AXI] [get_bd_intf_pins $system(memory)]

# One clock, one reset.
lappend clocked {*}{
    reset/slowest_sync_clk skymosaic/aclk
    dma_video/s_axi_lite_aclk dma_video/m_axi_mm2s_aclk
    to_registers/aclk to_memory/aclk interrupts/s_axi_aclk
}
lappend reset {*}{
    skymosaic/aresetn dma_video/axi_resetn
    to_registers/aresetn to_memory/aresetn interrupts/s_axi_aresetn
}
foreach output $board(outputs) {
    lappend clocked dma_$output/s_axi_lite_aclk dma_$output/m_axi_s2mm_aclk
    lappend reset dma_$output/axi_resetn
}
foreach pin $clocked {
    connect_bd_net [get_bd_pins $system(clock)] [get_bd_pins $pin]
}
connect_bd_net [get_bd_pins $system(reset_n)] [get_bd_pins reset/ext_reset_in]
foreach pin $reset {
    connect_bd_net [get_bd_pins reset/peripheral_aresetn] [get_bd_pins $pin]
}
assign_bd_address
if {[info exists system(memory_size)]} {
    set_property range $system(memory_size) [get_bd_addr_segs -filter "NAME =~ SEG_$system(memory_name)_*"]
}
validate_bd_design
save_bd_design
# The board's clock generator divides by integers: it rarely gives what it is asked for.
set clock_hz [get_property CONFIG.FREQ_HZ [get_bd_pins skymosaic/aclk]]
puts "fabric clock: $clock_mhz MHz requested, $clock_hz Hz given"

set design [get_files skymosaic_system.bd]
make_wrapper -files $design -top -import
set_property top skymosaic_system_wrapper [current_fileset]
add_files -fileset constrs_1 -norecurse {*}[glob -directory $here bitstream*.xdc]
update_compile_order -fileset sources_1

launch_runs synth_1 -jobs 4
wait_on_run synth_1
launch_runs impl_1 -to_step write_bitstream -jobs 4
wait_on_run impl_1
if {[get_property PROGRESS [get_runs impl_1]] ne "100%"} {
    error "the implementation did not finish; see the log of impl_1"
}
open_run impl_1
report_utilization -hierarchical -file [file join $result utilization.txt]
report_timing_summary -file [file join $result timing.txt]
set setup_ns [get_property SLACK [get_timing_paths -delay_type max]]
set hold_ns [get_property SLACK [get_timing_paths -delay_type min]]
puts "worst slack at $clock_hz Hz: $setup_ns ns for setup, $hold_ns ns for hold"

set run [get_property DIRECTORY [get_runs impl_1]]
file copy -force [file join $run skymosaic_system_wrapper.bit] [file join $result skymosaic.bit]
set handoff [glob -directory [file join $here project] */*/*/skymosaic_system/hw_handoff/skymosaic_system.hwh]
file copy -force [lindex $handoff 0] [file join $result skymosaic.hwh]
puts "built [file join $result skymosaic.bit] and skymosaic.hwh"
if {$setup_ns < 0} {
    error "setup times are not met; build with a slower clock: vivado -mode batch -source build.tcl -tclargs 125"
}
if {$hold_ns < 0} {
    error "hold times are not met, which a slower clock does not mend; see timing.txt"
}
