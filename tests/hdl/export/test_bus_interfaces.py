"""Ports are grouped into the buses that their names say."""

from hdl.export.bus_interfaces import bus_interfaces, vivado_attributes

PORTS = [
    "aclk",
    "aresetn",
    "interrupt",
    "s_axis_video_tdata",
    "s_axis_video_tvalid",
    "m_axi_ring_awaddr",
    "s_axi_ctrl_rdata",
]


def test_a_bus_has_the_ports_of_its_prefix_and_its_direction() -> None:
    found = {each.name: each for each in bus_interfaces(PORTS)}
    video, ring, control = found["s_axis_video"], found["m_axi_ring"], found["s_axi_ctrl"]
    assert (video.bus, video.manager) == ("axis", False)
    assert video.ports == {"TDATA": "s_axis_video_tdata", "TVALID": "s_axis_video_tvalid"}
    assert (ring.bus, ring.manager, ring.ports) == ("aximm", True, {"AWADDR": "m_axi_ring_awaddr"})
    assert (control.bus, control.manager) == ("aximm", False)


def test_the_clock_names_all_buses_and_the_reset_is_active_low() -> None:
    found = {each.name: each for each in bus_interfaces(PORTS)}
    assert found["aclk"].parameters == {
        "ASSOCIATED_BUSIF": "s_axis_video:m_axi_ring:s_axi_ctrl",
        "ASSOCIATED_RESET": "aresetn",
    }
    assert found["aresetn"].parameters == {"POLARITY": "ACTIVE_LOW"}
    assert [each.name for each in found.values() if each.manager] == ["m_axi_ring", "interrupt"]


def test_every_port_has_an_attribute_and_the_name_of_its_interface_comes_first() -> None:
    attributes = vivado_attributes(PORTS)
    assert sorted(attributes) == sorted(PORTS)
    assert attributes["m_axi_ring_awaddr"] == {"X_INTERFACE_INFO": "xilinx.com:interface:aximm:1.0 m_axi_ring AWADDR"}
    assert attributes["aclk"]["X_INTERFACE_INFO"] == "xilinx.com:signal:clock:1.0 aclk CLK"
    assert attributes["aresetn"]["X_INTERFACE_PARAMETER"] == "XIL_INTERFACENAME aresetn, POLARITY ACTIVE_LOW"
