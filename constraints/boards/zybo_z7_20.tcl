# Digilent Zybo Z7-20: XC7Z020-1CLG400C, 1 GB DDR3L on 32 bits, 33.333 MHz PS clock.
array set board {
    name        zybo_z7_20
    part        xc7z020clg400-1
    family      zynq
    clock_mhz   33.333333
    ddr_part    {MT41K256M16 RE-125}
    ddr_width   {32 Bit}
}
