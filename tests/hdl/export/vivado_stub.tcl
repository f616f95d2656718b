# Enough of Vivado to run the project's scripts: it knows the commands, properties and pins in the tables below and
# refuses every other one. Each table names the AMD document it was taken from. validate_bd_design refuses what Vivado's
# validation would: clocks of different frequencies, streams of different widths. create_bd_cell refuses a core that
# does not support the part's family.

# UG835, Vivado Tcl Command Reference: commands the scripts may use. UG1118: the ipx commands.
set known_commands {
    create_project add_files set_property get_files current_fileset update_compile_order close_project
    current_project update_ip_catalog create_bd_design create_bd_cell make_bd_intf_pins_external get_bd_intf_pins
    get_bd_pins get_bd_cells connect_bd_intf_net connect_bd_net get_bd_ports create_bd_port get_ipdefs get_bd_addr_segs assign_bd_address validate_bd_design save_bd_design
    get_property make_wrapper launch_runs wait_on_run get_runs open_run report_utilization report_timing_summary
    get_timing_paths
    ipx::package_project ipx::current_core ipx::get_bus_interfaces ipx::get_bus_parameters ipx::add_bus_parameter
    ipx::get_memory_maps ipx::add_memory_map ipx::get_address_blocks ipx::add_address_block ipx::check_integrity
    ipx::save_core
}
# UG912, Vivado Properties; UG1118 for the core's.
set known_properties {
    USED_IN top name version core_revision display_name description supported_families value value_resolve_type slave_memory_map_ref range
    ip_repo_paths PROGRESS SLACK DIRECTORY
}
# The IP's own CONFIG parameters: PG082 (processing_system7), PG201 (zynq_ultra_ps_e), PG021 (axi_dma), PG099
# (axi_intc), xlconcat, PG247 (smartconnect), PG065 (clk_wiz), PG085 (axis_subset_converter), PG174 (jtag_axi), PG078
# (axi_bram_ctrl), PG058 (blk_mem_gen).
array set known_parameters {
    xilinx.com:ip:processing_system7:5.5 {
        PCW_CRYSTAL_PERIPHERAL_FREQMHZ PCW_UIPARAM_DDR_PARTNO PCW_UIPARAM_DDR_BUS_WIDTH PCW_FPGA0_PERIPHERAL_FREQMHZ
        PCW_USE_M_AXI_GP0 PCW_USE_S_AXI_HP0 PCW_USE_FABRIC_INTERRUPT PCW_IRQ_F2P_INTR PCW_EN_CLK0_PORT
    }
    xilinx.com:ip:axi_dma:7.1 {
        c_include_sg c_sg_length_width c_include_mm2s c_include_s2mm c_m_axis_mm2s_tdata_width c_m_axi_mm2s_data_width
        c_addr_width c_s_axis_s2mm_tdata_width c_m_axi_s2mm_data_width
    }
    xilinx.com:ip:axi_intc:4.1 {C_IRQ_CONNECTION}
    xilinx.com:ip:zynq_ultra_ps_e:3.4 {
        PSU__PSS_REF_CLK__FREQMHZ PSU__FPGA_PL0_ENABLE PSU__CRL_APB__PL0_REF_CTRL__FREQMHZ PSU__USE__M_AXI_GP0
        PSU__USE__M_AXI_GP1 PSU__USE__M_AXI_GP2 PSU__USE__S_AXI_GP2 PSU__MAXIGP0__DATA_WIDTH PSU__SAXIGP2__DATA_WIDTH
        PSU__HIGH_ADDRESS__ENABLE PSU__USE__IRQ0
    }
    xilinx.com:ip:clk_wiz:6.0 {PRIM_IN_FREQ CLKOUT1_REQUESTED_OUT_FREQ RESET_TYPE RESET_PORT}
    xilinx.com:ip:axis_subset_converter:1.1 {
        S_TDATA_NUM_BYTES.VALUE_SRC M_TDATA_NUM_BYTES.VALUE_SRC S_TDATA_NUM_BYTES M_TDATA_NUM_BYTES TDATA_REMAP
    }
    xilinx.com:ip:jtag_axi:1.2 {}
    xilinx.com:ip:axi_bram_ctrl:4.1 {SINGLE_PORT_BRAM DATA_WIDTH}
    xilinx.com:ip:blk_mem_gen:8.4 {}
    xilinx.com:ip:xlconcat:2.1 {NUM_PORTS}
    xilinx.com:inline_hdl:ilconcat:1.0 {NUM_PORTS}
    xilinx.com:ip:smartconnect:1.0 {NUM_SI NUM_MI}
    xilinx.com:ip:proc_sys_reset:5.0 {}
}
# Pins and interfaces, from the same documents; those of our own core are set by the test, from the Verilog.
array set known_pins {
    xilinx.com:ip:processing_system7:5.5 {
        DDR FIXED_IO M_AXI_GP0 S_AXI_HP0 M_AXI_GP0_ACLK S_AXI_HP0_ACLK FCLK_CLK0 FCLK_RESET0_N IRQ_F2P
    }
    xilinx.com:ip:axi_dma:7.1 {
        M_AXIS_MM2S S_AXIS_S2MM S_AXI_LITE M_AXI_MM2S M_AXI_S2MM mm2s_introut s2mm_introut s_axi_lite_aclk
        m_axi_mm2s_aclk m_axi_s2mm_aclk axi_resetn
    }
    xilinx.com:ip:axi_intc:4.1 {s_axi intr irq s_axi_aclk s_axi_aresetn}
    xilinx.com:ip:zynq_ultra_ps_e:3.4 {
        M_AXI_HPM0_FPD S_AXI_HP0_FPD maxihpm0_fpd_aclk saxihp0_fpd_aclk pl_clk0 pl_resetn0 pl_ps_irq0
    }
    xilinx.com:ip:clk_wiz:6.0 {clk_in1 clk_out1 resetn locked}
    xilinx.com:ip:axis_subset_converter:1.1 {S_AXIS M_AXIS aclk aresetn}
    xilinx.com:ip:jtag_axi:1.2 {M_AXI aclk aresetn}
    xilinx.com:ip:axi_bram_ctrl:4.1 {S_AXI BRAM_PORTA s_axi_aclk s_axi_aresetn}
    xilinx.com:ip:blk_mem_gen:8.4 {BRAM_PORTA}
    xilinx.com:ip:xlconcat:2.1 {In0 In1 In2 In3 In4 dout}
    xilinx.com:inline_hdl:ilconcat:1.0 {In0 In1 In2 In3 In4 dout}
    xilinx.com:ip:smartconnect:1.0 {
        S00_AXI S01_AXI S02_AXI S03_AXI M00_AXI M01_AXI M02_AXI M03_AXI M04_AXI M05_AXI aclk aresetn
    }
    xilinx.com:ip:proc_sys_reset:5.0 {slowest_sync_clk ext_reset_in peripheral_aresetn}
}
# Clock outputs, the parameter that asks for their frequency in MHz, and what the generator divides: the Zynq's and
# the Zynq UltraScale+'s I/O PLL. A clk_wiz (0) makes what it is asked for.
array set known_clocks {
    FCLK_CLK0 {PCW_FPGA0_PERIPHERAL_FREQMHZ 999999924}
    pl_clk0   {PSU__CRL_APB__PL0_REF_CTRL__FREQMHZ 1499985000}
    clk_out1  {CLKOUT1_REQUESTED_OUT_FREQ 0}
}
# Bytes of TDATA: a number of bits, or the parameter that holds bits or bytes.
array set known_widths {
    M_AXIS_MM2S {c_m_axis_mm2s_tdata_width 8} S_AXIS_S2MM {c_s_axis_s2mm_tdata_width 8}
    S_AXIS {S_TDATA_NUM_BYTES 1} M_AXIS {M_TDATA_NUM_BYTES 1}
}
# Widths of the processor's ports until software sets AFI_FS and AFIFM_*CTRL (UG1087), which Linux does not.
array set reset_widths {PSU__MAXIGP0__DATA_WIDTH 128 PSU__SAXIGP2__DATA_WIDTH 128}
array set known_families {xc7z zynq xck2 zynquplus xc7a artix7 xc7k kintex7}

namespace eval ipx {}
array set values {}
array set resolved {}
set nets {}
set families {}
set slack_ns(max) 0.1
set slack_ns(min) 0.05
array set cells {}
array set connected {}
set parameters {}

proc refuse {message} {
    error "stub: $message"
}

proc unknown {command args} {
    refuse "unknown command $command"
}

proc check_files {arguments} {
    foreach argument $arguments {
        if {[string match -* $argument] || $argument in {constrs_1}} continue
        if {![file exists $argument]} { refuse "no such file $argument" }
    }
}

proc check_pin {path} {
    global cells known_pins
    lassign [split $path /] cell pin
    if {![info exists cells($cell)]} { refuse "no cell $cell" }
    if {$pin ni $known_pins($cells($cell))} { refuse "$cells($cell) has no pin $pin" }
    return $path
}

proc connect {arguments} {
    global connected nets
    lappend nets $arguments
    foreach path $arguments { incr connected($path) }
}

proc check_property {name object} {
    global known_properties known_parameters cells
    if {$name eq "CONFIG.FREQ_HZ"} {
        check_pin $object
    } elseif {[string match CONFIG.* $name]} {
        set parameter [string range $name 7 end]
        if {![info exists cells($object)]} { refuse "$name of $object, which is no cell" }
        if {$parameter ni $known_parameters($cells($object))} { refuse "$cells($object) has no parameter $parameter" }
    } elseif {$name ni $known_properties} {
        refuse "unknown property $name"
    }
}

foreach command $known_commands {
    proc $command args {}
}
proc create_project args {
    global family known_families
    set part [string range [lindex $args [expr {[lsearch $args -part] + 1}]] 0 3]
    if {![info exists known_families($part)]} { refuse "unknown part $part" }
    set family $known_families($part)
}
proc add_files args { check_files [lrange $args [expr {[lindex $args 0] eq "-fileset" ? 2 : 0}] end] }
proc current_fileset {} { return fileset }
proc current_project {} { return project }
proc get_files {name} { return $name }
proc get_runs {name} { return $name }
proc get_timing_paths {flag type} { return $type }
proc get_ipdefs {pattern} {
    global known_parameters
    return [array names known_parameters $pattern]
}
proc get_bd_ports {name} {
    global cells
    if {![info exists cells($name)]} { refuse "no port $name" }
    return $name
}
proc create_bd_port args {
    global cells
    set cells([lindex $args end]) port
}
proc create_bd_cell {type_flag type vlnv_flag vlnv name} {
    global cells known_parameters family families
    if {[string match skymosaic:* $vlnv] && $family ni $families} {
        refuse "$vlnv does not support the family $family"
    }
    if {$vlnv ni [array names known_parameters]} { refuse "unknown IP $vlnv" }
    if {($type eq "inline_hdl") != [string match *:inline_hdl:* $vlnv]} { refuse "$vlnv is not of the type $type" }
    set cells($name) $vlnv
    return $name
}
proc get_bd_cells {name} {
    global cells
    if {![info exists cells($name)]} { refuse "no cell $name" }
    return $name
}
proc get_bd_pins {path} { return [check_pin $path] }
proc get_bd_intf_pins {path} { return [check_pin $path] }
proc connect_bd_net args { connect $args }
proc connect_bd_intf_net args { connect $args }
proc make_bd_intf_pins_external args { connect $args }
proc set_property args {
    global values families resolved
    if {[lindex $args 0] eq "-dict"} {
        lassign $args flag pairs object
    } else {
        lassign $args name value object
        set pairs [list $name $value]
    }
    foreach {name value} $pairs {
        check_property $name $object
        set values($object.$name) $value
        switch $name {
            supported_families { set families [dict keys $value] }
            value_resolve_type { set resolved($object) $value }
            version { define_core $value }
        }
    }
}
proc define_core {version} {
    # UG1118: major.minor. The catalogue then has the core by this version, with the interfaces of the Verilog.
    global known_parameters known_pins interfaces
    if {![regexp {^\d+\.\d+$} $version]} { refuse "version $version is not major.minor" }
    set known_parameters(skymosaic:vision:skymosaic:$version) {}
    set known_pins(skymosaic:vision:skymosaic:$version) $interfaces
}
proc frequency {pin} {
    # Of the clock output that drives a pin, in Hz.
    global nets known_clocks values cells
    foreach net $nets {
        if {$pin ni $net} continue
        foreach source $net {
            lassign [split $source /] cell output
            if {![info exists known_clocks($output)]} continue
            lassign $known_clocks($output) parameter pll_hz
            set asked_hz [expr {$values($cell.CONFIG.$parameter) * 1e6}]
            return [expr {$pll_hz ? int($pll_hz / round($pll_hz / $asked_hz)) : int($asked_hz)}]
        }
    }
    refuse "no clock drives $pin"
}
proc stream_bytes {path} {
    global known_widths core_streams values
    lassign [split $path /] cell pin
    if {$cell eq "skymosaic"} {
        return [expr {[info exists core_streams($pin)] ? $core_streams($pin) : 0}]
    }
    if {![info exists known_widths($pin)]} { return 0 }
    lassign $known_widths($pin) parameter divisor
    return [expr {$values($cell.CONFIG.$parameter) / $divisor}]
}
proc validate_bd_design {} {
    global nets values resolved reset_widths
    foreach {port width} [array get reset_widths] {
        if {[info exists values(ps.CONFIG.$port)] && $values(ps.CONFIG.$port) != $width} {
            refuse "$port is not the $width bits of a reset"
        }
    }
    foreach net $nets {
        set bytes [lsort -unique [lmap path $net { stream_bytes $path }]]
        if {[llength $bytes] > 1} { refuse "TDATA_NUM_BYTES does not match between $net: $bytes" }
    }
    set fixed [expr {[info exists values(FREQ_HZ.value)] ? $values(FREQ_HZ.value) : {}}]
    set follows [expr {[info exists resolved(FREQ_HZ)] && $resolved(FREQ_HZ) eq "user"}]
    if {!$follows && $fixed eq ""} { refuse "FREQ_HZ of skymosaic/aclk is neither fixed nor left to the user" }
    if {$fixed ne "" && $fixed != [frequency skymosaic/aclk]} {
        refuse "FREQ_HZ does not match between skymosaic/aclk ($fixed) and its clock ([frequency skymosaic/aclk])"
    }
}
proc get_property {name object} {
    check_property $name $object
    global run_folder slack_ns
    switch $name {
        PROGRESS { return 100% }
        SLACK { return $slack_ns($object) }
        DIRECTORY { return $run_folder }
        CONFIG.FREQ_HZ { return [frequency $object] }
        default { refuse "$name of $object is not known before it is set" }
    }
}
proc open_run args {}
proc launch_runs {run args} {
    # What an implementation leaves behind, as far as the script picks it up.
    global run_folder here
    file mkdir $run_folder
    close [open [file join $run_folder skymosaic_system_wrapper.bit] w]
    set handoff [file join $here project p.gen sources_1 bd skymosaic_system hw_handoff]
    file mkdir $handoff
    close [open [file join $handoff skymosaic_system.hwh] w]
}
proc ipx::current_core {} { return core }
proc ipx::get_bus_interfaces {name of core} {
    global interfaces
    return [expr {$name in $interfaces ? $name : {}}]
}
proc ipx::get_bus_parameters {name of bus} {
    global parameters
    return [expr {"$bus.$name" in $parameters ? $name : {}}]
}
proc ipx::add_bus_parameter {name bus} {
    global parameters
    lappend parameters $bus.$name
}
