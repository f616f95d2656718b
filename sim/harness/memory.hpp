// A memory behind AXI4 ports with 64 bits: it waits and fails at random, and counts where a design breaks AXI's rules.
//
// ports.hpp names the ports: WRITERS(X) and READERS(X).

#include <cstdint>
#include <deque>
#include <utility>

constexpr uint64_t PAGE_BYTES = 4096;

struct Random {
    uint64_t state = 88172645463325252ull;
    uint32_t next() {  // xorshift64*
        state ^= state >> 12;
        state ^= state << 25;
        state ^= state >> 27;
        return static_cast<uint32_t>((state * 2685821657736338717ull) >> 32);
    }
    bool happens(uint32_t share) { return (next() & 255) < share; }
};

struct Memory {
    uint8_t *bytes = nullptr;
    uint64_t base = 0, length = 0;
    uint32_t waits = 0, latency = 0, failures = 0;
    uint64_t cycle = 0, violations = 0, errors = 0;
    Random random;

    void rules(uint32_t new_waits, uint32_t new_latency, uint32_t new_failures, uint64_t seed) {
        waits = new_waits;
        latency = new_latency;
        failures = new_failures;
        random.state ^= seed * 0x9E3779B97F4A7C15ull;
    }
    bool accepts() { return !random.happens(waits); }
    // The cycle from which a burst may be answered.
    uint64_t due() { return cycle + 1 + (latency ? random.next() % latency : 0); }
    bool fails() {
        const bool result = random.happens(failures);
        errors += result;
        return result;
    }
    void check(uint64_t address, uint64_t words) {
        const uint64_t bytes = 8 * words;
        const bool crosses = address / PAGE_BYTES != (address + bytes - 1) / PAGE_BYTES;
        if (crosses || address < base || address + bytes > base + length) violations++;
    }
};

// What a channel offered and the memory did not take: it must stay as it is.
struct Offer {
    bool waits = false;
    uint64_t first = 0, second = 0;

    void hold(Memory &memory, bool valid, bool ready, uint64_t new_first, uint64_t new_second) {
        if (waits && (!valid || new_first != first || new_second != second)) memory.violations++;
        *this = {valid && !ready, new_first, new_second};
    }
};

struct WritePort {
    struct Burst {
        uint64_t address, words;
    };
    struct Word {
        uint64_t data;
        uint8_t strobe;
        bool last;
    };
    Offer address, data;
    std::deque<Burst> bursts;
    std::deque<Word> words;  // those of a burst may come before its address
    std::deque<std::pair<uint64_t, bool>> answers;  // cycle from which a response may come, and whether it is an error
    bool awready = false, wready = false, answered = false;

    void drive(Memory &memory) {
        awready = memory.accepts();
        wready = memory.accepts();
        answered = !answers.empty() && answers.front().first <= memory.cycle;
    }
    // Write the bursts of which address and all words are there.
    void finish(Memory &memory) {
        while (!bursts.empty() && words.size() >= bursts.front().words) {
            const Burst burst = bursts.front();
            bursts.pop_front();
            const bool fails = memory.fails();
            uint64_t offset = burst.address - memory.base;
            for (uint64_t i = 0; i < burst.words; i++) {
                const Word word = words.front();
                words.pop_front();
                if (word.last != (i == burst.words - 1)) memory.violations++;
                for (int byte = 0; byte < 8; byte++, offset++)
                    if (!fails && (word.strobe >> byte & 1) && offset < memory.length)
                        memory.bytes[offset] = word.data >> 8 * byte;
            }
            answers.push_back({memory.due(), fails});
        }
    }
    uint64_t open() const { return bursts.size() + words.size() + answers.size(); }
};

struct ReadPort {
    struct Word {
        uint64_t due, data;
        bool fails, last;
    };
    Offer address;
    std::deque<Word> words;
    bool arready = false, given = false;

    void drive(Memory &memory) {
        arready = memory.accepts();
        // A word that is offered stays until it is taken.
        given = !words.empty() && (given || (words.front().due <= memory.cycle && memory.accepts()));
    }
    Word offered() const { return given ? words.front() : Word{}; }
    void take() {
        words.pop_front();
        given = false;
    }
    void read(Memory &memory, uint64_t from, uint64_t count) {
        memory.check(from, count);
        const bool fails = memory.fails();
        const uint64_t due = memory.due();
        for (uint64_t i = 0; i < count; i++) {
            uint64_t offset = from - memory.base + 8 * i, data = fails ? memory.random.next() : 0;
            for (int byte = 0; byte < 8 && !fails && offset + byte < memory.length; byte++)
                data |= static_cast<uint64_t>(memory.bytes[offset + byte]) << 8 * byte;
            words.push_back({due, data, fails, i == count - 1});
        }
    }
    uint64_t open() const { return words.size(); }
};

// For WRITERS(X) and READERS(X), in a bench with `model`, `memory`, `writers` and `readers`: before and at a clock's edge.
#define DRIVE_WRITER(index, port)                                                                       \
    {                                                                                                   \
        WritePort &w = writers[index];                                                                  \
        w.drive(memory);                                                                                \
        SET(port(awready), w.awready);                                                                  \
        SET(port(wready), w.wready);                                                                    \
        SET(port(bvalid), w.answered);                                                                  \
        SET(port(bresp), w.answered && w.answers.front().second ? 2 : 0);                               \
    }
#define TAKE_WRITER(index, port)                                                                        \
    {                                                                                                   \
        WritePort &w = writers[index];                                                                  \
        w.address.hold(memory, GET(port(awvalid)), w.awready, GET(port(awaddr)), GET(port(awlen)));     \
        const uint64_t flags = GET(port(wstrb)) << 1 | GET(port(wlast));                                \
        w.data.hold(memory, GET(port(wvalid)), w.wready, GET(port(wdata)), flags);                      \
        if (w.answered && GET(port(bready))) w.answers.pop_front();                                     \
        if (w.awready && GET(port(awvalid))) {                                                          \
            const uint64_t address = GET(port(awaddr)), count = GET(port(awlen)) + 1;                   \
            memory.check(address, count);                                                               \
            w.bursts.push_back({address, count});                                                       \
        }                                                                                               \
        if (w.wready && GET(port(wvalid)))                                                              \
            w.words.push_back({GET(port(wdata)), static_cast<uint8_t>(GET(port(wstrb))), GET(port(wlast)) != 0}); \
        w.finish(memory);                                                                               \
    }
#define DRIVE_READER(index, port)                                                                       \
    {                                                                                                   \
        ReadPort &r = readers[index];                                                                   \
        r.drive(memory);                                                                                \
        const ReadPort::Word word = r.offered();                                                        \
        SET(port(arready), r.arready);                                                                  \
        SET(port(rvalid), r.given);                                                                     \
        SET(port(rdata), word.data);                                                                    \
        SET(port(rlast), word.last);                                                                    \
        SET(port(rresp), word.fails ? 2 : 0);                                                           \
    }
#define TAKE_READER(index, port)                                                                        \
    {                                                                                                   \
        ReadPort &r = readers[index];                                                                   \
        r.address.hold(memory, GET(port(arvalid)), r.arready, GET(port(araddr)), GET(port(arlen)));     \
        if (r.given && GET(port(rready))) r.take();                                                     \
        if (r.arready && GET(port(arvalid))) r.read(memory, GET(port(araddr)), GET(port(arlen)) + 1);   \
    }
