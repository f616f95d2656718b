// Adapts a CXXRTL model to harness.cpp.

#include <cstdint>
#include <fstream>

#include "design.hpp"
#ifdef WAVES
#include <cxxrtl/cxxrtl_vcd.h>
#endif

#define SET(port, value) (model.top.port.template set<uint64_t>(value))
#define GET(port) (model.top.port.template get<uint64_t>())

struct Model {
    cxxrtl_design::p_top top;
#ifdef WAVES
    std::ofstream file;
    cxxrtl::vcd_writer vcd;
    cxxrtl::debug_items items;
    uint64_t time = 0;

    explicit Model(const char *path) : file(path) {
        top.debug_info(&items, nullptr, "");
        vcd.timescale(1, "ns");
        vcd.add_without_memories(items);
    }
    void dump() {
        vcd.sample(5 * time++);
        file << vcd.buffer;
        vcd.buffer.clear();
    }
#else
    explicit Model(const char *) {}
#endif

    void reset(bool active) { top.p_aresetn.set<uint32_t>(!active); }

    // One evaluation is enough for both halves of a clock: from the registers before the edge, eval() computes the
    // outputs of this cycle and the next values of the registers; commit() is the edge.
    void settle() {
        top.p_aclk.set<uint32_t>(1);
        top.prev_p_aclk.set<uint32_t>(0);
        top.eval();
#ifdef WAVES
        top.p_aclk.set<uint32_t>(0);
        dump();
        top.p_aclk.set<uint32_t>(1);
#endif
    }

    void edge() {
        top.commit();
#ifdef WAVES
        top.eval();  // without an edge: updates the outputs from the new register values
        dump();
#endif
    }
};
