"""Samples of four matches in the order of PROSAC: first from the best matches, at last from all.

The sequence has `STEPS` steps; in step j samples are drawn from the best n = N j / 16 of N matches, rounded up. That
begins with fewer than PROSAC's own growth, N (j / 16)^(1/4) (Chum and Matas, Matching with PROSAC, CVPR 2005), because
the weights of the fuzzy rules separate right from wrong well.
Four different ranks take four random numbers (Floyd's algorithm): the k-th is drawn from the first n - 3 + k, and where
it has been drawn before, it is n - 4 + k instead.
"""

SAMPLE = 4
STEPS = 16
SHARE_BITS = 10
SHARES = tuple((j << SHARE_BITS) // STEPS for j in range(1, STEPS + 1))
"""Share of the matches that each step draws from, in 1/1024."""
RANDOM_BITS = 32
DRAW_BITS = 16
"""Leading bits of a random number that are used."""
SHIFTS = (13, 17, 5)
"""Left, right, left: the generator's shifts (Marsaglia, Xorshift RNGs, 2003). Its period is 2^32 - 1."""


def subset_size(matches: int, step: int) -> int:
    """Number of the best matches that a step, 0 to 15, draws from; at least 4."""
    return max(SAMPLE, matches * SHARES[step] + (1 << SHARE_BITS) - 1 >> SHARE_BITS)


def advance(state: int) -> int:
    """Next state of the generator; never 0 unless the given one is."""
    left, right, last = SHIFTS
    mask = (1 << RANDOM_BITS) - 1
    state ^= state << left & mask
    state ^= state >> right
    return state ^ (state << last & mask)


def draw(state: int, size: int) -> tuple[list[int], int]:
    """Draw four different ranks below ``size``; returns them and the generator's next state."""
    ranks: list[int] = []
    for last in range(size - SAMPLE, size):
        rank = (state >> RANDOM_BITS - DRAW_BITS) * (last + 1) >> DRAW_BITS
        ranks.append(last if rank in ranks else rank)
        state = advance(state)
    return ranks, state
