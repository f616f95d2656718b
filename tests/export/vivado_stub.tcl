# Enough of Vivado to run the project's scripts: it knows the commands, properties and pins in the tables below and
# refuses every other one. Each table names the AMD document it was taken from.

# UG835, Vivado Tcl Command Reference: commands the scripts may use. UG1118: the ipx commands.
set known_commands {
    create_project add_files set_property get_files current_fileset update_compile_order close_project
    current_project update_ip_catalog create_bd_design create_bd_cell make_bd_intf_pins_external get_bd_intf_pins
    get_bd_pins get_bd_cells connect_bd_intf_net connect_bd_net assign_bd_address validate_bd_design save_bd_design
    get_property make_wrapper launch_runs wait_on_run get_runs open_run report_utilization report_timing_summary
    get_timing_paths
    ipx::package_project ipx::current_core ipx::infer_bus_interfaces ipx::infer_bus_interface
    ipx::associate_bus_interfaces ipx::get_bus_interfaces ipx::get_bus_parameters ipx::add_bus_parameter
    ipx::get_memory_maps ipx::add_memory_map ipx::get_address_blocks ipx::add_address_block ipx::check_integrity
    ipx::save_core
}
# UG912, Vivado Properties; UG1118 for the core's.
set known_properties {
    USED_IN top name version display_name description supported_families value slave_memory_map_ref range
    ip_repo_paths PROGRESS SLACK DIRECTORY
}
# The IP's own CONFIG parameters: PG082 (processing_system7), PG021 (axi_dma), PG099 (axi_intc), xlconcat, PG247
# (smartconnect).
array set known_parameters {
    xilinx.com:ip:processing_system7:5.5 {
        PCW_CRYSTAL_PERIPHERAL_FREQMHZ PCW_UIPARAM_DDR_PARTNO PCW_UIPARAM_DDR_BUS_WIDTH PCW_FPGA0_PERIPHERAL_FREQMHZ
        PCW_USE_M_AXI_GP0 PCW_USE_S_AXI_HP0 PCW_USE_FABRIC_INTERRUPT PCW_IRQ_F2P_INTR PCW_EN_CLK0_PORT
        PCW_ACT_FPGA0_PERIPHERAL_FREQMHZ
    }
    xilinx.com:ip:axi_dma:7.1 {
        c_include_sg c_sg_length_width c_include_mm2s c_include_s2mm c_m_axis_mm2s_tdata_width c_m_axi_mm2s_data_width
        c_s_axis_s2mm_tdata_width c_m_axi_s2mm_data_width
    }
    xilinx.com:ip:axi_intc:4.1 {C_IRQ_CONNECTION}
    xilinx.com:ip:xlconcat:2.1 {NUM_PORTS}
    xilinx.com:ip:smartconnect:1.0 {NUM_SI NUM_MI}
    xilinx.com:ip:proc_sys_reset:5.0 {}
    skymosaic:vision:skymosaic:1.0 {}
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
    xilinx.com:ip:xlconcat:2.1 {In0 In1 In2 In3 dout}
    xilinx.com:ip:smartconnect:1.0 {S00_AXI S01_AXI S02_AXI M00_AXI M01_AXI M02_AXI M03_AXI M04_AXI aclk aresetn}
    xilinx.com:ip:proc_sys_reset:5.0 {slowest_sync_clk ext_reset_in peripheral_aresetn}
}

namespace eval ipx {}
array set cells {}
array set connected {}
set interfaces {}
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
    global connected
    foreach path $arguments { incr connected($path) }
}

proc check_property {name object} {
    global known_properties known_parameters cells
    if {[string match CONFIG.* $name]} {
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
proc add_files args { check_files [lrange $args [expr {[lindex $args 0] eq "-fileset" ? 2 : 0}] end] }
proc current_fileset {} { return fileset }
proc current_project {} { return project }
proc get_files {name} { return $name }
proc get_runs {name} { return $name }
proc get_timing_paths {} { return path }
proc create_bd_cell {type_flag type vlnv_flag vlnv name} {
    global cells known_parameters
    if {$vlnv ni [array names known_parameters]} { refuse "unknown IP $vlnv" }
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
    if {[lindex $args 0] eq "-dict"} {
        foreach {name value} [lindex $args 1] { check_property $name [lindex $args 2] }
    } else {
        check_property [lindex $args 0] [lindex $args 2]
    }
}
proc get_property {name object} {
    check_property $name $object
    global run_folder
    switch $name {
        PROGRESS { return 100% }
        SLACK { return 0.1 }
        DIRECTORY { return $run_folder }
        default { return 150.0 }
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
    if {$name ni $interfaces} { refuse "the core has no interface $name" }
    return $name
}
proc ipx::infer_bus_interfaces {vlnv core} {
    global interfaces core_interfaces
    if {![info exists core_interfaces($vlnv)]} { refuse "no interface of the core is $vlnv" }
    lappend interfaces {*}$core_interfaces($vlnv)
}
proc ipx::infer_bus_interface {port vlnv core} {
    global interfaces core_ports
    if {$port ni $core_ports} { refuse "the core has no port $port" }
    lappend interfaces $port
}
proc ipx::associate_bus_interfaces args {
    foreach {flag value} [lrange $args 0 end-1] {
        if {$flag ni {-busif -clock -reset}} { refuse "unknown option $flag" }
        ipx::get_bus_interfaces $value -of_objects core
    }
}
proc ipx::get_bus_parameters {name of bus} {
    global parameters
    return [expr {"$bus.$name" in $parameters ? $name : {}}]
}
proc ipx::add_bus_parameter {name bus} {
    global parameters
    lappend parameters $bus.$name
}
