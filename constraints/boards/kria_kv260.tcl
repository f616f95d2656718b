# AMD Kria KV260: K26 module with XCK26-SFVC784-2LV-C and 4 GB DDR4, 33.333 MHz PS clock.
array set board {
    name        kria_kv260
    part        xck26-sfvc784-2LV-c
    family      zynquplus
    clock_mhz   33.333333
}
