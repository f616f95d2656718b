// Runs the camera build between a camera with its own clock, a memory that waits and fails at random, and a host.
//
// The host is in Python: it reads memory, registers and scores, and sends hypotheses, between calls of camera_run().
// ports.hpp, generated for each design, names the ports that write into memory: WRITERS(X).

#include <cstdint>
#include <deque>
#include <vector>

#include "verilator.hpp"
#include "ports.hpp"
#include "registers.hpp"

namespace {

constexpr int RESET_CYCLES = 8;
constexpr uint64_t PAGE_BYTES = 4096;

struct Random {
    uint64_t state;
    uint32_t next() {  // xorshift64*
        state ^= state >> 12;
        state ^= state << 25;
        state ^= state >> 27;
        return static_cast<uint32_t>((state * 2685821657736338717ull) >> 32);
    }
    bool happens(uint32_t share) { return (next() & 255) < share; }
};

struct Burst {
    uint64_t address, words;
};

struct Word {
    uint64_t data;
    uint8_t strobe;
    bool last;
};

// What a channel offered and the memory did not take: it must stay as it is.
struct Offer {
    bool waits = false;
    uint64_t first = 0, second = 0;
};

// One AXI4 write port of the memory.
struct Channel {
    Offer address, data;
    std::deque<Burst> bursts;
    std::deque<Word> words;  // those of a burst may come before its address
    std::deque<std::pair<uint64_t, bool>> answers;  // cycle from which a response may come, and whether it is an error
    bool awready = false, wready = false, answered = false;
};

// The DMA of hypotheses and scores: it pauses as often as the memory.
struct Scoring {
    std::deque<std::pair<uint64_t, bool>> hypotheses;  // words, and whether each ends its packet
    std::deque<std::vector<uint64_t>> scores{1};       // packets; the last one is on its way
    std::vector<uint64_t> taken;                       // the packet that the host reads
    Offer offer;
    bool valid = false, ready = false;
};

struct Frame {
    const uint8_t *pixels;
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
constexpr int WRITER_COUNT = 0 WRITERS(ONE);

struct Bench {
    Model model{""};
    uint64_t cycle = 0, violations = 0, errors = 0;
    Random random{88172645463325252ull};
    uint8_t *memory = nullptr;
    uint64_t base = 0, length = 0;
    uint32_t waits = 0, latency = 0, failures = 0;
    Channel channels[WRITER_COUNT];
    Scoring scoring;
    Camera camera;

    Bench() {
        reset();
        cycle = 0;
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
#define DRIVE(index, port)                                                                              \
    {                                                                                                   \
        Channel &c = channels[index];                                                                   \
        c.awready = !random.happens(waits);                                                             \
        c.wready = !random.happens(waits);                                                              \
        c.answered = !c.answers.empty() && c.answers.front().first <= cycle;                            \
        SET(port(awready), c.awready);                                                                  \
        SET(port(wready), c.wready);                                                                    \
        SET(port(bvalid), c.answered);                                                                  \
        SET(port(bresp), c.answered && c.answers.front().second ? 2 : 0);                               \
    }
        WRITERS(DRIVE)
        // What is offered stays until it is taken.
        scoring.valid = !scoring.hypotheses.empty() && (scoring.valid || !random.happens(waits));
        scoring.ready = !random.happens(waits);
        SET(s_axis_hypotheses_tvalid, scoring.valid);
        SET(s_axis_hypotheses_tdata, scoring.valid ? scoring.hypotheses.front().first : 0);
        SET(s_axis_hypotheses_tlast, scoring.valid && scoring.hypotheses.front().second);
        SET(m_axis_scores_tready, scoring.ready);
        SET(video_aclk, 0);
        model.settle();
    }

    void edge() {
#define TAKE(index, port)                                                                               \
    {                                                                                                   \
        Channel &c = channels[index];                                                                   \
        hold(c.address, GET(port(awvalid)), c.awready, GET(port(awaddr)), GET(port(awlen)));            \
        hold(c.data, GET(port(wvalid)), c.wready, GET(port(wdata)), GET(port(wstrb)) << 1 | GET(port(wlast))); \
        if (c.answered && GET(port(bready))) c.answers.pop_front();                                     \
        if (c.awready && GET(port(awvalid))) open(c, GET(port(awaddr)), GET(port(awlen)) + 1);          \
        if (c.wready && GET(port(wvalid)))                                                              \
            c.words.push_back({GET(port(wdata)), static_cast<uint8_t>(GET(port(wstrb))), GET(port(wlast)) != 0}); \
        finish(c);                                                                                      \
    }
        WRITERS(TAKE)
        exchange();
        model.edge();
        cycle++;
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

    void exchange() {
        const bool scored = GET(m_axis_scores_tvalid);
        hold(scoring.offer, scored, scoring.ready, GET(m_axis_scores_tdata), GET(m_axis_scores_tlast));
        if (scored && scoring.ready) {
            scoring.scores.back().push_back(GET(m_axis_scores_tdata));
            if (GET(m_axis_scores_tlast)) scoring.scores.emplace_back();
        }
        if (scoring.valid && GET(s_axis_hypotheses_tready)) {
            scoring.hypotheses.pop_front();
            scoring.valid = false;
        }
    }

    void hold(Offer &offer, bool valid, bool ready, uint64_t first, uint64_t second) {
        if (offer.waits && (!valid || first != offer.first || second != offer.second)) violations++;
        offer = {valid && !ready, first, second};
    }

    void open(Channel &channel, uint64_t address, uint64_t words) {
        const uint64_t bytes = 8 * words;
        const bool crosses = address / PAGE_BYTES != (address + bytes - 1) / PAGE_BYTES;
        if (crosses || address < base || address + bytes > base + length) violations++;
        channel.bursts.push_back({address, words});
    }

    // Write the bursts of which address and all words are there.
    void finish(Channel &channel) {
        while (!channel.bursts.empty() && channel.words.size() >= channel.bursts.front().words) {
            const Burst burst = channel.bursts.front();
            channel.bursts.pop_front();
            const bool fails = random.happens(failures);
            errors += fails;
            uint64_t offset = burst.address - base;
            for (uint64_t i = 0; i < burst.words; i++) {
                const Word word = channel.words.front();
                channel.words.pop_front();
                if (word.last != (i == burst.words - 1)) violations++;
                for (int byte = 0; byte < 8; byte++, offset++)
                    if (!fails && (word.strobe >> byte & 1) && offset < length) memory[offset] = word.data >> 8 * byte;
            }
            channel.answers.push_back({cycle + 1 + (latency ? random.next() % latency : 0), fails});
        }
    }

    // Addresses, words and responses of bursts that have begun and not ended.
    uint64_t open_bursts() {
        uint64_t open = 0;
#define COUNT(index, port)                                                                              \
    open += channels[index].bursts.size() + channels[index].words.size() + channels[index].answers.size(); \
    open += GET(port(awvalid)) + GET(port(wvalid));
        WRITERS(COUNT)
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
        SET(VIDEO(tdata), frame.pixels[c.y * frame.width + c.x]);
        SET(VIDEO(tuser), c.x == 0 && c.y == 0);
        SET(VIDEO(tlast), c.x == frame.width - 1);
        if (++c.x < frame.width) return;
        c.x = 0;
        c.pause = c.line_blank + (c.jitter ? random.next() % c.jitter : 0);
        if (++c.y < frame.height) return;
        c.y = 0;
        c.pause += c.frame_blank;
        c.frames.pop_front();
        c.last_pixels.push_back(cycle);
    }
};

#pragma GCC visibility push(default)
extern "C" {
Bench *camera_open() { return new Bench(); }
void camera_close(Bench *bench) { delete bench; }
void camera_memory(Bench *bench, uint8_t *memory, uint64_t base, uint64_t length) {
    bench->memory = memory;
    bench->base = base;
    bench->length = length;
}
void camera_rules(Bench *bench, uint32_t waits, uint32_t latency, uint32_t failures, uint64_t seed) {
    bench->waits = waits;
    bench->latency = latency;
    bench->failures = failures;
    bench->random.state ^= seed * 0x9E3779B97F4A7C15ull;
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
void camera_hypotheses(Bench *bench, const uint64_t *words, uint64_t count, int ends) {
    for (uint64_t i = 0; i < count; i++) bench->scoring.hypotheses.push_back({words[i], ends && i == count - 1});
}
// The oldest whole packet of scores, or 0 words.
uint64_t camera_scores(Bench *bench, const uint64_t **words) {
    Scoring &scoring = bench->scoring;
    if (scoring.scores.size() == 1) return 0;
    scoring.taken = std::move(scoring.scores.front());
    scoring.scores.pop_front();
    *words = scoring.taken.data();
    return scoring.taken.size();
}
uint64_t camera_open_bursts(Bench *bench) { return bench->open_bursts(); }
uint64_t camera_cycle(const Bench *bench) { return bench->cycle; }
uint64_t camera_violations(const Bench *bench) { return bench->violations; }
uint64_t camera_errors(const Bench *bench) { return bench->errors; }
uint64_t camera_last_pixels(const Bench *bench, const uint64_t **cycles) {
    *cycles = bench->camera.last_pixels.data();
    return bench->camera.last_pixels.size();
}
}
