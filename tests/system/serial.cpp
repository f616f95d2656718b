// Runs the top of the ULX3S at its pins: bytes of the host become bits, and bits become bytes again.

#include <cstdint>
#include <deque>
#include <vector>

#include "Vtop.h"
#include "verilated.h"

namespace {

constexpr int DATA_BITS = 8;

}  // namespace

struct Bench {
    VerilatedContext context;
    Vtop top{&context};
    uint32_t clocks_per_bit;
    uint64_t cycle = 0;
    std::deque<uint8_t> waiting;
    std::vector<uint8_t> received;
    uint32_t out_bits = 0, out_left = 0, out_clock = 0;  // the byte that is sent: its bits, and how many are left
    int32_t in_clock = -1, in_bit = 0;                   // clocks to the middle of the next bit; -1: no byte
    uint8_t in_byte = 0;
    uint64_t broken = 0;

    explicit Bench(uint32_t clocks) : clocks_per_bit(clocks) { top.ftdi_txd = 1; }

    void clock() {
        drive();
        top.clk_25mhz = 0;
        top.eval();
        top.clk_25mhz = 1;
        top.eval();
        cycle++;
        sample();
    }

    void drive() {
        if (!out_left && !waiting.empty()) {
            out_bits = (waiting.front() | 1u << DATA_BITS) << 1;
            out_left = DATA_BITS + 2;
            out_clock = 0;
            waiting.pop_front();
        }
        top.ftdi_txd = out_left ? out_bits & 1 : 1;
        if (out_left && ++out_clock == clocks_per_bit) {
            out_clock = 0;
            out_bits >>= 1;
            out_left--;
        }
    }

    void sample() {
        if (in_clock < 0) {
            if (top.ftdi_rxd) return;
            in_clock = clocks_per_bit + clocks_per_bit / 2;
            in_bit = 0;
        }
        if (in_clock-- > 0) return;
        if (in_bit == DATA_BITS) {
            if (top.ftdi_rxd)
                received.push_back(in_byte);
            else
                broken++;
            return;
        }
        in_byte = in_byte >> 1 | top.ftdi_rxd << (DATA_BITS - 1);
        in_bit++;
        in_clock = clocks_per_bit - 1;
    }
};

#pragma GCC visibility push(default)
extern "C" {
Bench *serial_open(uint32_t clocks_per_bit) { return new Bench(clocks_per_bit); }
void serial_close(Bench *bench) { delete bench; }
void serial_send(Bench *bench, const uint8_t *bytes, uint64_t count) {
    bench->waiting.insert(bench->waiting.end(), bytes, bytes + count);
}
// Runs until so many bytes have come, or none for so many clocks in which none was sent; returns how many there are.
uint64_t serial_run(Bench *bench, uint64_t count, uint64_t patience) {
    uint64_t quiet = 0, before = bench->received.size();
    while (bench->received.size() < count && quiet < patience) {
        bench->clock();
        quiet = bench->received.size() != before || bench->out_left ? 0 : quiet + 1;
        before = bench->received.size();
    }
    return bench->received.size();
}
void serial_take(Bench *bench, uint8_t *bytes, uint64_t count) {
    std::copy(bench->received.begin(), bench->received.begin() + count, bytes);
    bench->received.erase(bench->received.begin(), bench->received.begin() + count);
}
uint64_t serial_cycle(const Bench *bench) { return bench->cycle; }
uint64_t serial_broken(const Bench *bench) { return bench->broken; }
}
