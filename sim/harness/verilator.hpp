// A Verilator model: settle() and edge() are the halves of a clock, SET and GET access a port.

#include <cerrno>
#include <memory>

#include "Vtop.h"
#include "verilated.h"
#ifdef WAVES
#include "verilated_vcd_c.h"
#endif

#define SET(port, value) (model.top.port = (value))
#define GET(port) (model.top.port)

#ifdef WAVES
// Keeps the error of a file that cannot be written, where Verilator's own would end the process.
struct WaveFile : VerilatedVcdFile {
    int error = 0;

    bool open(const std::string &name) override {
        bool opened = VerilatedVcdFile::open(name);
        if (!opened) error = errno;
        return opened;
    }
    ssize_t write(const char *data, ssize_t size) override {
        ssize_t written = error ? size : VerilatedVcdFile::write(data, size);
        if (written >= 0 || errno == EAGAIN || errno == EINTR) return written;
        error = errno;
        return size;
    }
};
#endif

struct Model {
    VerilatedContext context;
    Vtop top{&context};
#ifdef WAVES
    WaveFile file;
    VerilatedVcdC vcd{&file};
    uint64_t time = 0;

    explicit Model(const char *path) {
        context.traceEverOn(true);
        top.trace(&vcd, 99);
        vcd.open(path);
    }
    // The error number of waves that could not be written; else 0.
    int close() {
        vcd.close();
        return file.error;
    }
    void dump() { vcd.dump(5 * time++); }
#else
    explicit Model(const char *) {}
    int close() { return 0; }
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
