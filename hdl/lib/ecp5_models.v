// A model of the multiplier of Lattice's ECP5 for simulation: one clock, no resets.

// 18 x 18 bits, with any of its input, pipeline and output registers; each is named with its clock enable.
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
    wire signed [18:0] factor_b_signed = {SIGNEDB & factor_b[17], factor_b};
    wire signed [18:0] factor_a_signed = {SIGNEDA & factor_a[17], factor_a};
    localparam [3:0] HAS = {
        REG_INPUTA_CLK == "CLK0", REG_INPUTB_CLK == "CLK0", REG_PIPELINE_CLK == "CLK0", REG_OUTPUT_CLK == "CLK0"};
    localparam [3:0] LACKS = {
        REG_INPUTA_CLK == "NONE", REG_INPUTB_CLK == "NONE", REG_PIPELINE_CLK == "NONE", REG_OUTPUT_CLK == "NONE"};
    reg signed [18:0] a, b;
    reg signed [35:0] multiplied, product;
    wire signed [35:0] to_pipeline = (HAS[3] ? a : factor_a_signed) * (HAS[2] ? b : factor_b_signed);
    wire signed [35:0] to_output = HAS[1] ? multiplied : to_pipeline;
    assign {P35, P34, P33, P32, P31, P30, P29, P28, P27, P26, P25, P24, P23, P22, P21, P20, P19, P18, P17, P16, P15,
    P14, P13, P12, P11, P10, P9, P8, P7, P6, P5, P4, P3, P2, P1, P0} = HAS[0] ? product : to_output;

    initial
        if ((HAS | LACKS) != 4'b1111) begin
            $display("MULT18X18D: the model has its registers on CLK0");
            $finish;
        end

    always @(posedge CLK0) begin
        if (enabled(REG_INPUTA_CE)) a <= factor_a_signed;
        if (enabled(REG_INPUTB_CE)) b <= factor_b_signed;
        if (enabled(REG_PIPELINE_CE)) multiplied <= to_pipeline;
        if (enabled(REG_OUTPUT_CE)) product <= to_output;
    end
endmodule
