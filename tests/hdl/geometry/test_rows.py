# amaranth: UnusedElaboratable=no
"""The estimator's arithmetic (`floating`, `match_gain`) equals the golden model at its limits."""

import numpy as np

from golden_model.geometry.floating import MANTISSA_BITS, MAX_EXPONENT, MIN_EXPONENT, Floats
from golden_model.geometry.match_gain import gain
from hdl.blocks.vectors import Block, of_stream
from hdl.geometry.floating import MultiplyAdd
from hdl.geometry.match_gain import PAIR, MatchGain
from tests.hdl.geometry.match_cases import extreme_hypotheses, extreme_matches, matches, near_truth
from tests.hdl.rows import Clocked, row_test


def numbers(count: int, seed: int) -> Floats:
    """Normalised, not normalised, and zero, with exponents close to each other or far apart."""
    rng = np.random.default_rng(seed)
    mantissa = rng.integers(1 << MANTISSA_BITS - 1, 1 << MANTISSA_BITS, count)
    mantissa[::7] >>= rng.integers(1, 16, len(mantissa[::7]))
    exponent = rng.integers(-4, 5, count) * rng.choice([1, 1, 10, 120], count)
    mantissa[3::11], exponent[3::11] = 0, MIN_EXPONENT
    mantissa[5::13] = (1 << MANTISSA_BITS) - 1
    exponent[6::29], exponent[8::31] = MAX_EXPONENT, MIN_EXPONENT
    return Floats(mantissa, exponent, rng.random(count) < 0.5)


def sums() -> Block:
    """Products with a third number added or subtracted; every third sum nearly cancels."""
    count = 600
    a, b, c = (numbers(count, seed) for seed in (1, 2, 3))
    product = Floats.from_real(np.zeros(count)).plus(a, b)
    for name in ("mantissa", "exponent"):
        getattr(c, name)[::3] = getattr(product, name)[::3]
    c.mantissa[::6] ^= 1 << 5
    negate = np.random.default_rng(4).random(count) < 0.5
    plus, minus = c.plus(a, b), c.minus(a, b)
    # The sign of zeros, too: estimates differ where a pivot is a zero of the other sign.
    found = Floats(*(np.where(negate, getattr(minus, n), getattr(plus, n)) for n in vars(plus)))
    assert (found.mantissa == 0).sum() > 30
    assert {MIN_EXPONENT, MAX_EXPONENT} < set(found.exponent.tolist())
    fields = list(vars(plus))
    ports = [
        [dict(zip(fields, each, strict=True)) for each in zip(*(getattr(x, n).tolist() for n in fields), strict=True)]
        for x in (a, b, c, found)
    ]
    sent = [{"a": x, "b": y, "c": z, "negate": int(sign)} for x, y, z, sign in zip(*ports[:3], negate, strict=True)]
    return of_stream(Clocked(MultiplyAdd()), "", sent, [{"data": each} for each in ports[3]])


def gains() -> Block:
    """Another hypothesis and another match in every clock."""
    (left, right, _), some = extreme_matches(), matches(30)
    pairs = np.hstack((np.vstack((left, some[0])), np.vstack((right, some[1]))))
    hypotheses = np.concatenate((extreme_hypotheses(), near_truth(12)))
    every = np.indices((len(hypotheses), len(pairs))).reshape(2, -1)
    h, n = every[:, np.random.default_rng(4).permutation(every.shape[1])[:500]]
    found = gain(hypotheses, pairs[:, :2], pairs[:, 2:])[h, n].tolist()
    assert len(set(found)) > 15
    sent = [
        {"hypothesis": each, "match": dict(zip(PAIR.members, pair, strict=True))}
        for each, pair in zip(hypotheses[h].reshape(-1, 9).tolist(), pairs[n].tolist(), strict=True)
    ]
    return of_stream(Clocked(MatchGain()), "", sent, [{"gain": each} for each in found])


test_rows = row_test({"sums": sums, "gains": gains})
