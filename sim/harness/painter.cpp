// Runs the painter between a camera and a memory that waits and fails at random. The host is in Python: it queues frames
// and poses, and reads memory and reports, between calls of painter_run().

#include <vector>

#include "verilator.hpp"
#include "ports.hpp"
#include "memory.hpp"

namespace {

constexpr int RESET_CYCLES = 8;
constexpr int ELEMENTS = 9;

struct Frame {
    const uint8_t *pixels;  // blue, green, red
    uint32_t width, height;
};

struct Placement {
    int32_t elements[ELEMENTS];
    uint32_t frame, reference, composed;
};

}  // namespace

#define ONE(index, port) +1
#define EVENTS(X) X(o_refused) X(o_unmatched) X(o_unplaced) X(o_cut) X(o_lost) X(o_skipped)
#define REPORT(X) \
    X(o_frame) X(o_counts_offered) X(o_counts_behind) X(o_counts_too_large) X(o_counts_cannot_win) X(o_counts_painted) \
    X(o_counts_failed) X(o_counts_has_errors)
#define COUNT_ONE(name) +1

struct Bench {
    Model model{""};
    Memory memory;
    WritePort writers[0 WRITERS(ONE)];
    ReadPort readers[0 READERS(ONE)];
    std::deque<Frame> frames;
    std::deque<Placement> poses;
    std::vector<uint64_t> reports;  // of each: the cycle in which it came, and its fields
    uint64_t events[0 EVENTS(COUNT_ONE)] = {};
    std::vector<uint64_t> pixels;  // of pictures: data, first, last
    uint64_t x = 0, y = 0;
    Offer picture;
    uint32_t display_waits = 0;
    bool ready = false, display_ready = false;

    Bench() { reset(); }

    // All begins anew: what waits for the memory is forgotten, too.
    void reset() {
        for (WritePort &port : writers) port = {};
        for (ReadPort &port : readers) port = {};
        frames.clear();
        poses.clear();
        reports.clear();
        pixels.clear();
        picture = {};
        x = y = 0;
        model.reset(true);
        for (int i = 0; i < RESET_CYCLES; i++) {
            model.settle();
            model.edge();
        }
        model.reset(false);
        memory.cycle = 0;
    }

    void settle() {
        WRITERS(DRIVE_WRITER)
        READERS(DRIVE_READER)
        SET(i_poses_valid, !poses.empty());
        if (!poses.empty()) {
            const Placement &pose = poses.front();
#define ELEMENT(n) SET(i_poses_elements_##n, pose.elements[n]);
            ELEMENT(0) ELEMENT(1) ELEMENT(2) ELEMENT(3) ELEMENT(4) ELEMENT(5) ELEMENT(6) ELEMENT(7) ELEMENT(8)
            SET(i_poses_frame, pose.frame);
            SET(i_poses_reference, pose.reference);
            SET(i_poses_composed, pose.composed);
        }
        ready = memory.accepts();
        SET(o_ready, ready);
        display_ready = !memory.random.happens(display_waits);
        SET(o_picture_ready, display_ready);
        show();
        model.settle();
    }

    // The camera's pixel in this clock.
    void show() {
        SET(i_valid, !frames.empty());
        if (frames.empty()) return;
        const Frame frame = frames.front();
        const uint8_t *pixel = frame.pixels + 3 * (y * frame.width + x);
        SET(i_data, pixel[1] | pixel[0] << 8 | pixel[2] << 16);
        SET(i_first, x == 0 && y == 0);
        SET(i_last, x == frame.width - 1);
        if (++x < frame.width) return;
        x = 0;
        if (++y < frame.height) return;
        y = 0;
        frames.pop_front();
    }

    void edge() {
        WRITERS(TAKE_WRITER)
        READERS(TAKE_READER)
        if (!poses.empty() && GET(i_poses_ready)) poses.pop_front();
        if (ready && GET(o_valid)) {
            reports.push_back(memory.cycle);
#define KEEP(name) reports.push_back(GET(name));
            REPORT(KEEP)
        }
        const uint64_t pixel = GET(o_picture_data) | GET(o_picture_first) << 24 | GET(o_picture_last) << 25;
        picture.hold(memory, GET(o_picture_valid), display_ready, pixel, 0);
        if (display_ready && GET(o_picture_valid)) pixels.push_back(pixel);
        uint64_t *event = events;
#define COUNT_EVENT(name) *event++ += GET(name);
        EVENTS(COUNT_EVENT)
        model.edge();
        memory.cycle++;
    }

    uint64_t open_bursts() {
        uint64_t open = 0;
#define COUNT_WRITER(index, port) open += writers[index].open() + GET(port(awvalid)) + GET(port(wvalid));
#define COUNT_READER(index, port) open += readers[index].open() + GET(port(arvalid));
        WRITERS(COUNT_WRITER)
        READERS(COUNT_READER)
        return open;
    }
};

#pragma GCC visibility push(default)
extern "C" {
Bench *painter_open() { return new Bench(); }
void painter_close(Bench *bench) { delete bench; }
void painter_reset(Bench *bench) { bench->reset(); }
void painter_memory(Bench *bench, uint8_t *bytes, uint64_t base, uint64_t length) {
    bench->memory.bytes = bytes;
    bench->memory.base = base;
    bench->memory.length = length;
}
void painter_rules(Bench *bench, uint32_t waits, uint32_t latency, uint32_t failures, uint64_t seed) {
    bench->memory.rules(waits, latency, failures, seed);
}
void painter_set(Bench *bench, int index, uint64_t value) {
    auto &model = bench->model;
#define SET_ONE(number, name) if (index == number) SET(name, value);
    SETTINGS(SET_ONE)
}
void painter_frame(Bench *bench, const uint8_t *pixels, uint32_t width, uint32_t height) {
    bench->frames.push_back({pixels, width, height});
}
void painter_pose(Bench *bench, const int32_t *elements, uint32_t frame, uint32_t reference, uint32_t composed) {
    Placement pose = {{}, frame, reference, composed};
    for (int n = 0; n < ELEMENTS; n++) pose.elements[n] = elements[n];
    bench->poses.push_back(pose);
}
// Runs until there are so many values of reports, or for so many clocks; returns the values.
uint64_t painter_run(Bench *bench, uint64_t clocks, uint64_t values, const uint64_t **reports) {
    for (uint64_t i = 0; i < clocks && bench->reports.size() < values; i++) {
        bench->settle();
        bench->edge();
    }
    *reports = bench->reports.data();
    return bench->reports.size();
}
void painter_display(Bench *bench, uint32_t waits) { bench->display_waits = waits; }
uint64_t painter_pixels(Bench *bench, const uint64_t **pixels) {
    *pixels = bench->pixels.data();
    return bench->pixels.size();
}
uint64_t painter_events(Bench *bench, const uint64_t **events) {
    *events = bench->events;
    return 0 EVENTS(COUNT_ONE);
}
int painter_idle(Bench *bench) { return bench->model.top.o_idle && !bench->open_bursts() && bench->frames.empty(); }
// After the last clock, whatever has been set since.
int painter_shown(Bench *bench) { return bench->model.top.o_shown; }
int painter_held(Bench *bench) { return bench->model.top.o_held; }
uint64_t painter_cycle(const Bench *bench) { return bench->memory.cycle; }
uint64_t painter_violations(const Bench *bench) { return bench->memory.violations; }
uint64_t painter_errors(const Bench *bench) { return bench->memory.errors; }
}
