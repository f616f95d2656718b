// Models of primitives of Lattice's ECP5 for simulation, as far as hdl/lib/ecp5.py uses them: one clock, no resets.

// 18 x 18 bits, with input, pipeline and output registers; each register is named with its clock enable.
module MULT18X18D (
    input A0, A1, A2, A3, A4, A5, A6, A7, A8, A9, A10, A11, A12, A13, A14, A15, A16, A17,
    input B0, B1, B2, B3, B4, B5, B6, B7, B8, B9, B10, B11, B12, B13, B14, B15, B16, B17,
    input C0, C1, C2, C3, C4, C5, C6, C7, C8, C9, C10, C11, C12, C13, C14, C15, C16, C17,
    input SIGNEDA, SIGNEDB, SOURCEA, SOURCEB,
    input CLK0, CLK1, CLK2, CLK3, CE0, CE1, CE2, CE3, RST0, RST1, RST2, RST3,
    output P0, P1, P2, P3, P4, P5, P6, P7, P8, P9, P10, P11, P12, P13, P14, P15, P16, P17, P18, P19, P20, P21, P22,
    P23, P24, P25, P26, P27, P28, P29, P30, P31, P32, P33, P34, P35
);
    parameter REG_INPUTA_CLK = "NONE", REG_INPUTA_CE = "CE0";
    parameter REG_INPUTB_CLK = "NONE", REG_INPUTB_CE = "CE0";
    parameter REG_PIPELINE_CLK = "NONE", REG_PIPELINE_CE = "CE0";
    parameter REG_OUTPUT_CLK = "NONE", REG_OUTPUT_CE = "CE0";

    function enabled(input [23:0] name);
        case (name)
            "CE0": enabled = CE0;
            "CE1": enabled = CE1;
            "CE2": enabled = CE2;
            "CE3": enabled = CE3;
            default: enabled = 1'bx;
        endcase
    endfunction

    wire [17:0] factor_a = {A17, A16, A15, A14, A13, A12, A11, A10, A9, A8, A7, A6, A5, A4, A3, A2, A1, A0};
    wire [17:0] factor_b = {B17, B16, B15, B14, B13, B12, B11, B10, B9, B8, B7, B6, B5, B4, B3, B2, B1, B0};
    reg signed [18:0] a, b;
    reg signed [35:0] multiplied, product;
    assign {P35, P34, P33, P32, P31, P30, P29, P28, P27, P26, P25, P24, P23, P22, P21, P20, P19, P18, P17, P16, P15,
    P14, P13, P12, P11, P10, P9, P8, P7, P6, P5, P4, P3, P2, P1, P0} = product;

    initial
        if ({REG_INPUTA_CLK, REG_INPUTB_CLK, REG_PIPELINE_CLK, REG_OUTPUT_CLK} != "CLK0CLK0CLK0CLK0") begin
            $display("MULT18X18D: the model has all its registers, on CLK0");
            $finish;
        end

    always @(posedge CLK0) begin
        if (enabled(REG_INPUTA_CE)) a <= {SIGNEDA & factor_a[17], factor_a};
        if (enabled(REG_INPUTB_CE)) b <= {SIGNEDB & factor_b[17], factor_b};
        if (enabled(REG_PIPELINE_CE)) multiplied <= a * b;
        if (enabled(REG_OUTPUT_CE)) product <= multiplied;
    end
endmodule

// 16 Kbit, or 18 Kbit in words of 9 or 18 bits. Port A writes, port B reads through its output register.
module DP16KD (
    input DIA0, DIA1, DIA2, DIA3, DIA4, DIA5, DIA6, DIA7, DIA8, DIA9, DIA10, DIA11, DIA12, DIA13, DIA14, DIA15, DIA16,
    DIA17,
    input DIB0, DIB1, DIB2, DIB3, DIB4, DIB5, DIB6, DIB7, DIB8, DIB9, DIB10, DIB11, DIB12, DIB13, DIB14, DIB15, DIB16,
    DIB17,
    input ADA0, ADA1, ADA2, ADA3, ADA4, ADA5, ADA6, ADA7, ADA8, ADA9, ADA10, ADA11, ADA12, ADA13,
    input ADB0, ADB1, ADB2, ADB3, ADB4, ADB5, ADB6, ADB7, ADB8, ADB9, ADB10, ADB11, ADB12, ADB13,
    input CLKA, CLKB, CEA, CEB, OCEA, OCEB, WEA, WEB, RSTA, RSTB, CSA0, CSA1, CSA2, CSB0, CSB1, CSB2,
    output DOB0, DOB1, DOB2, DOB3, DOB4, DOB5, DOB6, DOB7, DOB8, DOB9, DOB10, DOB11, DOB12, DOB13, DOB14, DOB15,
    DOB16, DOB17
);
    parameter DATA_WIDTH_A = 18, DATA_WIDTH_B = 18;
    parameter REGMODE_A = "NOREG", REGMODE_B = "NOREG", RESETMODE = "SYNC", GSR = "ENABLED";
    parameter WRITEMODE_A = "NORMAL", WRITEMODE_B = "NORMAL";

    // Addresses count bits, without the ninth of each byte.
    localparam LOW = DATA_WIDTH_A == 18 ? 4 : DATA_WIDTH_A == 9 ? 3 : DATA_WIDTH_A == 4 ? 2 : DATA_WIDTH_A - 1;

    reg [DATA_WIDTH_A-1:0] words [0:(1 << (14 - LOW))-1];
    wire [17:0] written = {DIA17, DIA16, DIA15, DIA14, DIA13, DIA12, DIA11, DIA10, DIA9, DIA8, DIA7, DIA6, DIA5, DIA4,
    DIA3, DIA2, DIA1, DIA0};
    wire [13:0] address_a = {ADA13, ADA12, ADA11, ADA10, ADA9, ADA8, ADA7, ADA6, ADA5, ADA4, ADA3, ADA2, ADA1, ADA0};
    wire [13:0] address_b = {ADB13, ADB12, ADB11, ADB10, ADB9, ADB8, ADB7, ADB6, ADB5, ADB4, ADB3, ADB2, ADB1, ADB0};
    wire writes = CEA & WEA & ~CSA0 & ~CSA1 & ~CSA2;
    wire reads = CEB & ~WEB & ~CSB0 & ~CSB1 & ~CSB2;
    reg [DATA_WIDTH_A-1:0] latch, taken;
    wire [17:0] read = taken;
    assign {DOB17, DOB16, DOB15, DOB14, DOB13, DOB12, DOB11, DOB10, DOB9, DOB8, DOB7, DOB6, DOB5, DOB4, DOB3, DOB2,
    DOB1, DOB0} = read;

    integer word;
    initial begin
        for (word = 0; word < 1 << (14 - LOW); word = word + 1) words[word] = 0;
        if (DATA_WIDTH_A != DATA_WIDTH_B || REGMODE_B != "OUTREG") begin
            $display("DP16KD: the model has one width, and the output register of port B");
            $finish;
        end
    end

    always @(posedge CLKA) begin
        if (writes & (DATA_WIDTH_A != 18 | &address_a[1:0])) words[address_a >> LOW] <= written[DATA_WIDTH_A-1:0];
        // What a read returns of a word that is being written is not specified.
        if (reads) latch <= words[address_b >> LOW] ^ {DATA_WIDTH_A{writes & address_a >> LOW == address_b >> LOW}};
        if (OCEB) taken <= latch;
    end
endmodule
