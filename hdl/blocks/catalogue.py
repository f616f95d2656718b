# amaranth: UnusedElaboratable=no
# Blocks that are refused are never elaborated, of which whoever reads the refusal would be warned, too.
"""The rows of blocks: what `skymosaic export block` writes, and what tests, netlists, area and clock are of."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from golden_model import front_end as golden_front_end
from golden_model.config import EstimatorConfig, MatcherConfig
from golden_model.feature import ilbp
from golden_model.fuzzy.sugeno import SugenoSystem
from golden_model.geometry.estimator import FrameMatches, estimate, homography_record
from golden_model.matching import correlation, rule_bases
from golden_model.matching.matcher import check_rule_base, match
from golden_model.records import MATCH
from hdl.blocks import axi
from hdl.blocks.chain import Descriptor
from hdl.blocks.flat import flat_values
from hdl.blocks.painting import make_line_reader, make_painter
from hdl.blocks.pixel import PIXEL_BLOCKS, BlockConfig, Entry
from hdl.blocks.vectors import Block, of_stream, packet, padded_status, rows, sample_image
from hdl.fuzzy.sugeno import Sugeno
from hdl.geometry.records import RecordEstimator
from hdl.matching.correlation import WindowCorrelation
from hdl.matching.fuzzy_correlation import FuzzyCorrelation
from hdl.matching.matcher import Matcher

MATCHED_FRAME_PX = 160
"""Has some ninety features, twelve times as many as the matcher compares at once."""


def _ilbp(config: BlockConfig) -> Block:
    pattern, size_px = config.pattern, 41
    scene = np.concatenate([sample_image(size_px, size_px, seed) for seed in range(24)])
    y, x = np.arange(24) * size_px + size_px // 2, np.full(24, size_px // 2)
    sectors, descriptors = ilbp.describe(scene, scene, x, y, pattern)
    rings = ilbp.gather(scene, x, y, [offset for ring in pattern.offsets for offset in ring]).T
    sent = [{"rings": ring.reshape(len(pattern.radii_px), -1).tolist()} for ring in rings]
    expected = [
        {"sector": sector, "descriptor": int.from_bytes(row.tobytes(), "little")}
        for sector, row in zip(sectors.tolist(), descriptors, strict=True)
    ]
    about = f"Orientation and descriptor ({pattern.name}) of the pixels on rings around a candidate."
    return of_stream(Descriptor(pattern=pattern), about, sent, expected)


def sugeno(system: SugenoSystem, value_bits: int, description: str, *, vectors: int) -> Block:
    """Make a block of a Sugeno system, with ``vectors`` at random, and those at the ends of its tables."""
    last = [each.entries - 1 for each in system.inputs]
    # The largest values lie beyond the tables, which then give their last degree.
    ends = [[0] * len(last), last, [(1 << value_bits) - 1] * len(last)]
    random = np.random.default_rng(5).integers(0, 1 << value_bits, (vectors, len(last)))
    inputs = np.vstack([ends, random])
    weights, chosen = system.evaluate(*inputs.T)
    expected = [{"weight": weight, "rule": rule} for weight, rule in np.stack([weights, chosen], 1).tolist()]
    return of_stream(Sugeno(system=system, value_bits=value_bits), description, inputs.tolist(), expected)


def _fuzzy(config: BlockConfig) -> Block:
    system = rule_bases.aerial_orientation(config.pattern.bits)
    names = ", ".join(variable.name for variable in system.inputs)
    about = f"Zero-order Sugeno system with the inputs {names}: weight (UQ0.8) and dominant rule."
    # 6 bits, because its tables are short: most values of 8 bits lie beyond them.
    return sugeno(system, 6, about, vectors=60)


def correlated(component: Any, about: str, pairs: NDArray[np.uint8], **answers: NDArray[np.integer]) -> Block:
    """Make a block that compares the windows of ``pairs`` (2, N, 9)."""
    sent = [dict(zip(("left", "right"), pair, strict=True)) for pair in pairs.swapaxes(0, 1).tolist()]
    found = np.stack(list(answers.values()), axis=1).tolist()
    return of_stream(component, about, sent, [dict(zip(answers, each, strict=True)) for each in found])


def correlation_scores(pairs: NDArray[np.uint8]) -> Block:
    """Make the block of the three scores."""
    scores = {name: getattr(correlation, name)(*pairs) for name in ("sad", "zssd", "ncc")}
    return correlated(WindowCorrelation(), "SAD, ZSSD and NCC of two windows of 3x3 pixels.", pairs, **scores)


def fuzzy_correlation(pairs: NDArray[np.uint8]) -> Block:
    """Make the block of the rules over the scores."""
    weight, rule = rule_bases.correlation().evaluate(*correlation.fuzzy_inputs(*pairs))
    about = "Weight (UQ0.8) of two windows of 3x3 pixels by the fuzzy rules for their scores, and the dominant rule."
    return correlated(FuzzyCorrelation(), about, pairs, weight=weight, rule=rule)


def _windows(*, noise: float) -> NDArray[np.uint8]:
    """Pairs of windows, the second one the first one with noise."""
    rng = np.random.default_rng(6)
    left = rng.integers(0, 256, (30, 9))
    return np.stack([left, left + rng.normal(0, noise, left.shape)]).clip(0, 255).astype(np.uint8)


def _frames(config: BlockConfig) -> list[golden_front_end.FrameFeatures]:
    scene = sample_image(MATCHED_FRAME_PX, MATCHED_FRAME_PX + 8)
    views = (np.ascontiguousarray(scene[:, shift : shift + MATCHED_FRAME_PX]) for shift in (0, 8))
    return [golden_front_end.extract(view, config, frame=number) for number, view in enumerate(views)]


def _matcher(config: BlockConfig) -> Block:
    rules = MatcherConfig(rule_base=config.rule_base, keep_above=config.keep_above)
    check_rule_base(config.pattern, rules)
    pattern, frames = config.pattern, _frames(config)
    matches = match(frames[0].features, frames[1].features, pattern, rules)
    counts = {"matches": len(matches), "kept": int(np.count_nonzero(matches["verdict"]))}
    statuses = [padded_status(frame.status, frame.features.dtype.itemsize) for frame in frames]
    sent = [word for frame, status in zip(frames, statuses, strict=True) for word in packet(frame.features, status)]
    expected = packet(padded_status(frames[0].status, MATCH.record_bytes))
    expected += packet(matches, padded_status(frames[1].status, MATCH.record_bytes, **counts))
    return Block(
        Matcher(config=rules, pattern=pattern, lanes=config.lanes, max_features=config.max_features),
        "Mutual nearest neighbours by Hamming distance, weighed by fuzzy rules: feature packets in, match packets out.",
        {"i_features": rows("i_features", sent)},
        {"o_matches": rows("o_matches", expected)},
        dict.fromkeys(("i_estimating", "i_refused", "i_hold_reference", "i_take_reference"), 0)
        | {"i_keep_above": config.keep_above},
        idle_cycles=20_000,
        remembers=True,
    )


def _homography(config: BlockConfig) -> Block:
    left, right = _frames(config)
    # A third of the matches, spread as all are; a fifth of them rejected, and none exactly where it should be.
    matches = match(left.features, right.features, config.pattern, MatcherConfig())[::3]
    random, settings = np.random.default_rng(8), EstimatorConfig(passes=1)
    matches["verdict"] = random.random(len(matches)) < 0.8
    for name in ("right_x", "right_y"):
        matches[name] += random.integers(0, 20, len(matches), np.uint16)
    result = estimate(FrameMatches.from_records(matches, right.status), settings)
    return Block(
        RecordEstimator(),
        "Estimates the homography of each frame's kept matches: packets of matches in, a packet of one record out for "
        "each.",
        {"i_matches": rows("i_matches", packet(matches, padded_status(right.status, MATCH.record_bytes)))},
        {"o": rows("o", packet(homography_record(result, frame=1)))},
        flat_values("i_settings", vars(settings)) | {"i_enable": 1, "i_clear": 0},
        idle_cycles=100_000,
        remembers=True,
    )


CATALOGUE = {
    **PIXEL_BLOCKS,
    "ilbp": Entry(_ilbp, ("descriptor",)),
    "fuzzy": Entry(_fuzzy),
    "correlation": Entry(lambda _: correlation_scores(_windows(noise=99))),
    "fuzzy_correlation": Entry(lambda _: fuzzy_correlation(_windows(noise=9))),
    "matcher": Entry(_matcher, ("lanes", "max_features", "descriptor", "rule_base", "keep_above")),
    "homography": Entry(_homography),
    "video_input": Entry(axi.make_video_input, ("video_bits",)),
    "packet_gate": Entry(lambda _: axi.make_packet_gate()),
    "burst_reader": Entry(lambda _: axi.make_burst_reader()),
    "line_reader": Entry(lambda _: make_line_reader()),
    "painter": Entry(lambda _: make_painter()),
}
"""The blocks by name."""


def make_block(name: str, settings: Mapping[str, Any]) -> Block:
    """Make a block of the catalogue with values of `BlockConfig`, which may be texts.

    Raises
    ------
    ValueError
        For an unknown block, name or value, naming the valid ones.
    """
    if name not in CATALOGUE:
        raise ValueError(f"unknown block {name!r}; valid: {', '.join(CATALOGUE)}, or MODULE:CLASS of your own")
    make, known = CATALOGUE[name]
    if unknown := next((key for key in settings if key not in known), ""):
        raise ValueError(f"{name} does not depend on {unknown!r}; valid: {', '.join(known) or 'none'}")
    usual = {"threshold": 12} if settings.get("detector") == "fast" else {}  # its scores are gray levels
    try:
        config = BlockConfig(**usual | {key: _read_value(value) for key, value in settings.items()})
        return replace(make(config), parameters={key: getattr(config, key) for key in known})
    except ValueError as error:
        # Elsewhere names in backquotes are those of options.
        raise ValueError(str(error).replace("`", "")) from None


def _read_value(value: Any) -> Any:
    """The number or truth value that a text is; the configuration refuses other texts."""
    words = {"true": True, "false": False}
    return value if type(value) is not str else int(value) if value.isdecimal() else words.get(value, value)
