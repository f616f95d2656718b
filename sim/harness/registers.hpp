// AXI4-Lite accesses: they return the response, or -1 if there is none. The bench's settle() and edge() are a clock.

#include <cstdint>

constexpr int ACCESS_CYCLES = 64;  // a register access that takes longer has failed

template <class Bench>
int write_register(Bench &bench, uint32_t address, uint32_t data) {
    auto &model = bench.model;
    SET(CONTROL(awaddr), address);
    SET(CONTROL(wdata), data);
    SET(CONTROL(wstrb), 15);
    bool address_offered = true, data_offered = true;
    int response = -1;
    for (int i = 0; i < ACCESS_CYCLES && response < 0; i++) {
        SET(CONTROL(awvalid), address_offered);
        SET(CONTROL(wvalid), data_offered);
        SET(CONTROL(bready), 1);
        bench.settle();
        if (GET(CONTROL(awready))) address_offered = false;
        if (GET(CONTROL(wready))) data_offered = false;
        if (GET(CONTROL(bvalid))) response = GET(CONTROL(bresp));
        bench.edge();
    }
    SET(CONTROL(bready), 0);
    return response;
}

template <class Bench>
int read_register(Bench &bench, uint32_t address, uint32_t *data) {
    auto &model = bench.model;
    SET(CONTROL(araddr), address);
    bool address_offered = true;
    int response = -1;
    for (int i = 0; i < ACCESS_CYCLES && response < 0; i++) {
        SET(CONTROL(arvalid), address_offered);
        SET(CONTROL(rready), 1);
        bench.settle();
        if (GET(CONTROL(arready))) address_offered = false;
        if (GET(CONTROL(rvalid))) {
            response = GET(CONTROL(rresp));
            *data = GET(CONTROL(rdata));
        }
        bench.edge();
    }
    SET(CONTROL(rready), 0);
    return response;
}
