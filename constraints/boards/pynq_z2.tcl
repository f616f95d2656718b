# TUL PYNQ-Z2: XC7Z020-1CLG400C, 512 MB DDR3 on 16 bits, 50 MHz PS clock.
array set board {
    name        pynq_z2
    part        xc7z020clg400-1
    family      zynq
    clock_mhz   50
    ddr_part    {MT41K256M16 RE-125}
    ddr_width   {16 Bit}
}
