// Runs the camera build between a camera with its own clock, a memory that waits and fails at random, and a host.
//
// The host is in Python: it reads memory and registers between calls of camera_run().
// ports.hpp, generated for each design, names the ports to memory: WRITERS(X) and READERS(X).

#include <array>
#include <vector>

#include "verilator.hpp"
#include "ports.hpp"
#include "memory.hpp"
#include "registers.hpp"

namespace {

constexpr int RESET_CYCLES = 8;

struct Frame {
    const uint8_t *pixels;  // gray, or blue, green, red
    uint32_t width, height;
};

struct Camera {
    uint32_t line_blank = 0, frame_blank = 0, jitter = 0, steps = 1, period = 1;
    std::deque<Frame> frames;
    uint64_t phase = 0, x = 0, y = 0, pause = 0;
    std::vector<uint64_t> last_pixels;  // cycle of each frame's last pixel
};

}  // namespace

#define ONE(index, port) +1

struct Bench {
    Model model{""};
    Memory memory;
    std::array<WritePort, 0 WRITERS(ONE)> writers;
    std::array<ReadPort, 0 READERS(ONE)> readers;
    Camera camera;
    std::vector<uint64_t> pixels;  // a display has taken: data, first, last

    Bench() {
        reset();
        memory.cycle = 0;
    }

    void reset() {
        model.reset(true);
        for (int i = 0; i < RESET_CYCLES; i++) {
            settle();
            edge();
        }
        model.reset(false);
    }

    void settle() {
        WRITERS(DRIVE_WRITER)
        READERS(DRIVE_READER)
#define DRIVE_DISPLAY(index, port) SET(port(tready), memory.accepts());
        OUTPUTS(DRIVE_DISPLAY)
        SET(video_aclk, 0);
        model.settle();
    }

    void edge() {
        WRITERS(TAKE_WRITER)
        READERS(TAKE_READER)
#define TAKE_PIXEL(index, port)                  \
    if (GET(port(tvalid)) && GET(port(tready))) \
        pixels.push_back(GET(port(tdata)) | GET(port(tuser)) << 24 | GET(port(tlast)) << 25);
        OUTPUTS(TAKE_PIXEL)
        model.edge();
        memory.cycle++;
        // The camera's edges lie behind the others: its clock is asynchronous.
        for (camera.phase += camera.steps; camera.phase >= camera.period; camera.phase -= camera.period) {
            pixel();
            SET(video_aclk, 1);
            model.top.eval();
            if (camera.phase >= 2 * camera.period) {
                SET(video_aclk, 0);
                model.top.eval();
            }
        }
    }

    // Addresses, words and responses of bursts that have begun and not ended.
    uint64_t open_bursts() {
        uint64_t open = 0;
#define COUNT_WRITER(index, port) open += writers[index].open() + GET(port(awvalid)) + GET(port(wvalid));
#define COUNT_READER(index, port) open += readers[index].open() + GET(port(arvalid));
        WRITERS(COUNT_WRITER)
        READERS(COUNT_READER)
        return open;
    }

    // What the camera shows in its next clock: a pixel, or a pause.
    void pixel() {
        Camera &c = camera;
        const bool valid = !c.pause && !c.frames.empty();
        SET(VIDEO(tvalid), valid);
        if (c.pause) c.pause--;
        if (!valid) return;
        const Frame frame = c.frames.front();
        const uint64_t place = c.y * frame.width + c.x;
        if (sizeof GET(VIDEO(tdata)) == 1)
            SET(VIDEO(tdata), frame.pixels[place]);
        else  // green in the lowest byte, then blue, red
            SET(VIDEO(tdata), frame.pixels[3 * place + 1] | frame.pixels[3 * place] << 8 | frame.pixels[3 * place + 2] << 16);
        SET(VIDEO(tuser), c.x == 0 && c.y == 0);
        SET(VIDEO(tlast), c.x == frame.width - 1);
        if (++c.x < frame.width) return;
        c.x = 0;
        c.pause = c.line_blank + (c.jitter ? memory.random.next() % c.jitter : 0);
        if (++c.y < frame.height) return;
        c.y = 0;
        c.pause += c.frame_blank;
        c.frames.pop_front();
        c.last_pixels.push_back(memory.cycle);
    }
};

#pragma GCC visibility push(default)
extern "C" {
Bench *camera_open() { return new Bench(); }
void camera_close(Bench *bench) { delete bench; }
void camera_memory(Bench *bench, uint8_t *bytes, uint64_t base, uint64_t length) {
    bench->memory.bytes = bytes;
    bench->memory.base = base;
    bench->memory.length = length;
}
void camera_rules(Bench *bench, uint32_t waits, uint32_t latency, uint32_t failures, uint64_t seed) {
    bench->memory.rules(waits, latency, failures, seed);
}
// The camera's clock has `steps` edges in `period` clocks of the design.
void camera_timing(Bench *bench, uint32_t line_blank, uint32_t frame_blank, uint32_t jitter, uint32_t steps,
                 uint32_t period) {
    Camera &camera = bench->camera;
    camera.line_blank = line_blank;
    camera.frame_blank = frame_blank;
    camera.jitter = jitter;
    camera.steps = steps;
    camera.period = period;
}
void camera_frame(Bench *bench, const uint8_t *pixels, uint32_t width, uint32_t height) {
    bench->camera.frames.push_back({pixels, width, height});
}
void camera_run(Bench *bench, uint64_t clocks) {
    for (uint64_t i = 0; i < clocks; i++) {
        bench->settle();
        bench->edge();
    }
}
int camera_write(Bench *bench, uint32_t address, uint32_t data) { return write_register(*bench, address, data); }
int camera_read(Bench *bench, uint32_t address, uint32_t *data) { return read_register(*bench, address, data); }
void camera_reset(Bench *bench) { bench->reset(); }
uint64_t camera_open_bursts(Bench *bench) { return bench->open_bursts(); }
uint64_t camera_cycle(const Bench *bench) { return bench->memory.cycle; }
uint64_t camera_violations(const Bench *bench) { return bench->memory.violations; }
uint64_t camera_errors(const Bench *bench) { return bench->memory.errors; }
uint64_t camera_pixels(const Bench *bench, const uint64_t **pixels) {
    *pixels = bench->pixels.data();
    return bench->pixels.size();
}
uint64_t camera_last_pixels(const Bench *bench, const uint64_t **cycles) {
    *cycles = bench->camera.last_pixels.data();
    return bench->camera.last_pixels.size();
}
}
