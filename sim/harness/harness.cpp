// Streams whole frames through a compiled design.
//
// ports.hpp, generated for each design, names its ports: VIDEO(member), OUTPUTS(X), TAPS(X), SETTINGS(X), and, if it
// has registers, CONTROL(member).

#include <cstdint>
#include <vector>

#include "verilator.hpp"
#include "ports.hpp"
#ifdef CONTROL
#include "registers.hpp"
#endif

namespace {

constexpr int RESET_CYCLES = 4;
constexpr uint8_t START_OF_FRAME = 1, END_OF_LINE = 2;

struct Output {
    std::vector<uint64_t> words;
    std::vector<uint64_t> ends;  // for each packet: the number of words up to its end, and the cycle of its last word

    void push(uint64_t word, bool last, uint64_t cycle) {
        words.push_back(word);
        if (last) ends.insert(ends.end(), {words.size(), cycle});
    }
    uint64_t packets() const { return ends.size() / 2; }
};

// Whether a stream pauses in a cycle, with a probability in 1/256; sim/simulators/recording.py has the same hash.
bool pauses(uint32_t share, uint32_t seed, uint32_t stream, uint64_t cycle) {
    if (share == 0) return false;
    uint32_t hash = (seed ^ (stream << 24) ^ static_cast<uint32_t>(cycle)) * 2654435761u;
    hash = (hash ^ (hash >> 15)) * 2246822519u;
    return ((hash ^ (hash >> 13)) & 255) < share;
}

}  // namespace

struct Request {
    const uint64_t *data;  // one per beat
    const uint8_t *flags;  // one per beat: START_OF_FRAME, END_OF_LINE
    uint64_t beats;
    uint64_t packets;      // the run is complete after so many packets on each output
    uint64_t cycle_limit;
    uint32_t gaps, stalls, seed;
    const uint64_t *rooms; // words that each output takes at most, up to the first packet's end; null: all
};

#define COUNT(index, port) +1
constexpr int OUTPUT_COUNT = 0 OUTPUTS(COUNT), STREAM_COUNT = OUTPUT_COUNT TAPS(COUNT);

struct Bench {
    Model model;
    uint64_t cycle = 0;
    uint64_t sent = 0;             // beats of the last run that went in
    std::vector<uint64_t> starts;  // cycle of every admitted start of frame
    Output streams[STREAM_COUNT];

    explicit Bench(const char *waves) : model(waves) { reset(); }

    void reset() {
        rest();
        model.reset(true);
        for (int i = 0; i < RESET_CYCLES; i++) {
            model.settle();
            model.edge();
        }
        model.reset(false);
        cycle = 0;
    }

    // Stop all streams.
    void rest() {
        SET(VIDEO(tvalid), 0);
#define NOT_READY(index, port) SET(port(tready), 0);
        OUTPUTS(NOT_READY)
    }

    // True if all beats went in and all packets came out before the limit.
    bool run(const Request &request) {
        const bool done = stream(request);
        rest();
        return done;
    }

    bool stream(const Request &request) {
        starts.clear();
        for (Output &stream : streams) stream = {};
        sent = 0;
        bool offered = false;
        for (const uint64_t limit = cycle + request.cycle_limit; cycle < limit; cycle++) {
            if (request.rooms ? complete_one() : sent == request.beats && complete(request.packets)) return true;
            offered = offered || (sent < request.beats && !pauses(request.gaps, request.seed, 0, cycle));
            if (offered) offer(request.data[sent], request.flags[sent]);
            SET(VIDEO(tvalid), offered);
            bool ready[OUTPUT_COUNT];
#define OFFER_READY(index, port)                                             \
    ready[index] = !pauses(request.stalls, request.seed, index + 1, cycle) && \
                   !(request.rooms && streams[index].words.size() >= request.rooms[index]); \
    SET(port(tready), ready[index]);
            OUTPUTS(OFFER_READY)
            model.settle();
            if (offered && GET(VIDEO(tready))) {
                if (request.flags[sent] & START_OF_FRAME) starts.push_back(cycle);
                sent++;
                offered = false;
            }
#define TAKE(index, port) \
    if (ready[index] && GET(port(tvalid))) streams[index].push(GET(port(tdata)), GET(port(tlast)), cycle);
            OUTPUTS(TAKE)
#define WATCH(index, port) \
    if (GET(port(tvalid))) streams[OUTPUT_COUNT + index].push(GET(port(tdata)), false, cycle);
            TAPS(WATCH)
            model.edge();
        }
        return false;
    }

    void offer(uint64_t data, uint8_t flags) {
        SET(VIDEO(tdata), data);
        SET(VIDEO(tuser), (flags & START_OF_FRAME) != 0);
        SET(VIDEO(tlast), (flags & END_OF_LINE) != 0);
    }

    bool complete(uint64_t packets) const {
        for (int i = 0; i < OUTPUT_COUNT; i++)
            if (streams[i].packets() < packets) return false;
        return true;
    }

    bool complete_one() const {
        for (int i = 0; i < OUTPUT_COUNT; i++)
            if (streams[i].packets()) return true;
        return false;
    }

    void set(int setting, uint64_t value) {
        switch (setting) {
#define SET_SETTING(index, port) \
    case index:                  \
        SET(port, value);        \
        break;
            SETTINGS(SET_SETTING)
        }
    }

    void settle() { model.settle(); }
    void edge() {
        model.edge();
        cycle++;
    }
};

// The functions that sim/simulators/compiled.py calls. All other symbols are hidden, since one process loads several designs.
#pragma GCC visibility push(default)
extern "C" {
Bench *bench_open(const char *waves) { return new Bench(waves); }
int bench_close(Bench *bench) {
    int error = bench->model.close();
    delete bench;
    return error;
}
void bench_reset(Bench *bench) { bench->reset(); }
void bench_set(Bench *bench, int setting, uint64_t value) { bench->set(setting, value); }
#ifdef CONTROL
int bench_write(Bench *bench, uint32_t address, uint32_t data) { return write_register(*bench, address, data); }
int bench_read(Bench *bench, uint32_t address, uint32_t *data) { return read_register(*bench, address, data); }
#else
int bench_write(Bench *, uint32_t, uint32_t) { return -1; }
int bench_read(Bench *, uint32_t, uint32_t *) { return -1; }
#endif
bool bench_run(Bench *bench, const Request *request) { return bench->run(*request); }
uint64_t bench_sent(const Bench *bench) { return bench->sent; }
uint64_t bench_cycle(const Bench *bench) { return bench->cycle; }

uint64_t bench_starts(const Bench *bench, const uint64_t **cycles) {
    *cycles = bench->starts.data();
    return bench->starts.size();
}
uint64_t bench_words(const Bench *bench, int stream, const uint64_t **words) {
    *words = bench->streams[stream].words.data();
    return bench->streams[stream].words.size();
}
uint64_t bench_ends(const Bench *bench, int stream, const uint64_t **ends) {
    *ends = bench->streams[stream].ends.data();
    return bench->streams[stream].packets();
}
}
