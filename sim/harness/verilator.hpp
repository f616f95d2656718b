// A Verilator model: settle() and edge() are the halves of a clock, SET and GET access a port.

#include <memory>

#include "Vtop.h"
#include "verilated.h"
#ifdef WAVES
#include "verilated_vcd_c.h"
#endif

#define SET(port, value) (model.top.port = (value))
#define GET(port) (model.top.port)

struct Model {
    VerilatedContext context;
    Vtop top{&context};
#ifdef WAVES
    VerilatedVcdC vcd;
    uint64_t time = 0;

    explicit Model(const char *path) {
        context.traceEverOn(true);
        top.trace(&vcd, 99);
        vcd.open(path);
    }
    ~Model() { vcd.close(); }
    void dump() { vcd.dump(5 * time++); }
#else
    explicit Model(const char *) {}
    void dump() {}
#endif

    void reset(bool active) { top.aresetn = !active; }

    // No register reacts to the falling edge: this evaluation only updates the outputs from the inputs.
    void settle() {
        top.aclk = 0;
        top.eval();
        dump();
    }

    void edge() {
        top.aclk = 1;
        top.eval();
        dump();
    }
};
