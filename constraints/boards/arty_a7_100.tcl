# Digilent Arty A7-100: XC7A100T-1CSG324C, 100 MHz clock.
array set board {
    name        arty_a7_100
    part        xc7a100tcsg324-1
    family      artix7
    clock_mhz   100
}
