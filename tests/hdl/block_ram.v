// A block RAM of a Xilinx or Lattice device: two ports of any width over bytes of nine bits, as UG473 (7 series memory
// resources) and TN1264 (ECP5 memory) describe them. `tests.hdl.netlists` puts the vendors' cells around it.
module block_ram #(
    parameter ADDRESS_BITS = 15,  // Addresses count bits, without the ninth of each byte.
    // Of each port: bits of a word (0: the port does not read or write), what it reads while it writes, registers.
    parameter [15:0] READ_BITS = 0, WRITE_BITS = 0,
    parameter [3:0] MODE = 0,  // 0: nothing, the word before stays; 1: the old word; 2: the new word.
    parameter [1:0] HAS_REGISTER = 0
) (
    input [1:0] clock, enable, reset, register_enable,
    input [15:0] write,  // Of each byte of a word; words below a byte have one bit.
    input [31:0] address,
    input [143:0] data,
    output [143:0] q
);
    localparam BYTES = 1 << (ADDRESS_BITS - 3);
    reg [8:0] bytes [0:BYTES-1];

    genvar port;
    generate
        for (port = 0; port < 2; port = port + 1) begin : ports
            localparam READS = READ_BITS[8*port+:8], READ_BYTES = READS < 9 ? 1 : READS / 9;
            localparam WRITES = WRITE_BITS[8*port+:8], WRITE_BYTES = WRITES < 9 ? 1 : WRITES / 9;
            localparam OTHER_BYTES = WRITE_BITS[8*(1-port)+:8] < 9 ? 1 : WRITE_BITS[8*(1-port)+:8] / 9;
            wire [15:0] place = address[16*port+:16], other_place = address[16*(1-port)+:16];
            wire [15:0] read_at = place >> 3 & ~(READ_BYTES - 1), write_at = place >> 3 & ~(WRITE_BYTES - 1);
            wire [15:0] other_at = other_place >> 3 & ~(OTHER_BYTES - 1);
            wire [7:0] others = WRITE_BITS[8*(1-port)+:8] && enable[1-port] ? write[8*(1-port)+:8] : 8'd0;
            wire [2:0] low = WRITES < 9 ? place[2:0] & ~(WRITES - 1) : 3'd0;
            wire is_writing = WRITES && write[8*port+:8];
            reg [71:0] latch = 0, taken = 0;
            reg [8:0] mask, one;
            integer n;
            assign q[72*port+:72] = HAS_REGISTER[port] ? taken : latch;

            always @(posedge clock[port]) begin
                if (enable[port]) begin
                    if (READS && !(is_writing && MODE[2*port+:2] == 0))
                        for (n = 0; n < READ_BYTES; n = n + 1) begin
                            one = bytes[read_at + n];
                            if (is_writing && MODE[2*port+:2] == 2 && write[8*port+n]) one = data[72*port+9*n+:9];
                            // Unless the port that writes shows the old word, what the other one reads is not specified.
                            if (MODE[2*(1-port)+:2] != 1 && read_at + n >= other_at
                                && read_at + n < other_at + OTHER_BYTES && others[read_at + n - other_at]) one = 9'bx;
                            if (READS < 9) latch <= one[7:0] >> (place[2:0] & ~(READS - 1)) & ((1 << READS) - 1);
                            else latch[9*n+:9] <= one;
                        end
                    for (n = 0; n < WRITE_BYTES; n = n + 1)
                        if (is_writing && write[8*port+n]) begin
                            mask = WRITES < 9 ? ((1 << WRITES) - 1) << low : 9'h1ff;
                            bytes[write_at + n] <= bytes[write_at + n] & ~mask | data[72*port+9*n+:9] << low & mask;
                        end
                end
                if (reset[port]) latch <= 0;
                if (register_enable[port]) taken <= latch;
            end

            initial if (MODE[2*port+:2] == 2 && WRITES && READS && (WRITES != READS || WRITES < 9)) begin
                $display("block_ram: a port that shows the new word has one width, of whole bytes");
                $finish;
            end
        end
    endgenerate
endmodule
