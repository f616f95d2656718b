# Packages rtl/skymosaic.v as an IP core in vivado/ip.
#
#   vivado -mode batch -source package_ip.tcl

set here [file normalize [file dirname [info script]]]
source [file join $here board.tcl]
set ip_folder [file join $here ip]

create_project -force -part $board(part) package_ip [file join $here package_ip]
add_files -norecurse [file join $here .. rtl skymosaic.v]
add_files -fileset constrs_1 -norecurse [file join $here skymosaic_ooc.xdc]
set_property USED_IN {synthesis implementation out_of_context} [get_files skymosaic_ooc.xdc]
set_property top skymosaic [current_fileset]
update_compile_order -fileset sources_1

ipx::package_project -root_dir $ip_folder -vendor skymosaic -library vision -taxonomy /UserIP -import_files -force
set core [ipx::current_core]
set_property name skymosaic $core
set_property version $board(core_version) $core
set_property core_revision $board(core_revision) $core
set_property display_name {skymosaic vision front end} $core
set_property description {Corners, descriptors, matches and fuzzy weights of UAV video} $core
set_property supported_families {
    zynq Production zynquplus Production artix7 Production kintex7 Production
} $core

# Vivado made the interfaces from the attributes X_INTERFACE_INFO in the Verilog.
set expected {s_axis_video s_axi_ctrl aclk aresetn interrupt}
foreach output $board(outputs) {
    lappend expected m_axis_$output
}
foreach interface $expected {
    if {[llength [ipx::get_bus_interfaces $interface -of_objects $core]] == 0} {
        error "no interface $interface was found in skymosaic.v"
    }
}
# A frequency fixed here would have to equal the block design's clock to the hertz; left to the user, it follows it.
set clock [ipx::get_bus_interfaces aclk -of_objects $core]
if {[llength [ipx::get_bus_parameters FREQ_HZ -of_objects $clock]] == 0} {
    ipx::add_bus_parameter FREQ_HZ $clock
}
set_property value_resolve_type user [ipx::get_bus_parameters FREQ_HZ -of_objects $clock]

# 4 KB of registers.
if {[llength [ipx::get_memory_maps s_axi_ctrl -of_objects $core]] == 0} {
    ipx::add_memory_map s_axi_ctrl $core
    set_property slave_memory_map_ref s_axi_ctrl [ipx::get_bus_interfaces s_axi_ctrl -of_objects $core]
}
set map [ipx::get_memory_maps s_axi_ctrl -of_objects $core]
if {[llength [ipx::get_address_blocks reg0 -of_objects $map]] == 0} {
    ipx::add_address_block reg0 $map
}
set_property range 4096 [ipx::get_address_blocks reg0 -of_objects $map]

ipx::check_integrity $core
ipx::save_core $core
close_project
puts "packaged $board(core) in $ip_folder"
