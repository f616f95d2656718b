"""Every design whose area or clock is recorded: blocks, levels, front ends and whole accelerators."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from amaranth import Cat, Fragment, Module, Signal, Value
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from golden_model.config import PRESETS, Config, EstimatorConfig, FrontEndConfig
from golden_model.fuzzy.fll import MAX_PARAMETERS, MAX_TERMS
from golden_model.fuzzy.rules import INPUTS, QUANTITIES, MatchRules
from golden_model.fuzzy.sugeno import MAX_RULES
from hdl.accelerator import AcceleratorTop
from hdl.blocks.catalogue import make_block
from hdl.build import BUILDS, Build
from hdl.feature.extractor import CandidateFeatures
from hdl.feature.ring_window import RingWindow
from hdl.front_end import FrontEnd
from hdl.level import Level
from hdl.lib.delay import delayed
from hdl.selection.selection import CellSelection
from hdl.shell.camera import CameraCrossing, CameraGate
from hdl.shell.camera_top import CameraAccelerator, CameraTop
from hdl.shell.ring_writer import RingWriter

AERIAL, THESIS = PRESETS["aerial"], PRESETS["thesis"]
WIDTH_PX = Build.max_width_px


class Design(NamedTuple):
    """What is synthesised, and how many bits of line memory it cannot do without."""

    build: Callable[[], wiring.Component]
    memory_bits: int = 0


class FewPins(wiring.Component):
    """A component with more ports than a package has pins: inputs are shifted in, and of outputs the parity is seen."""

    i: Signal
    o: Signal

    def __init__(self, component: wiring.Component) -> None:
        self._component = component
        super().__init__({"i": In(1), "o": Out(1)})

    def elaborate(self, platform: object) -> Module:
        """Registers on all sides, so that only paths inside the component count."""
        m = Module()
        m.submodules.component = component = self._component
        ports = [(member.flow, Value.cast(port)) for _, member, port in component.signature.flatten(component)]
        inputs, outputs = (Cat(port for flow, port in ports if flow == side) for side in (In, Out))
        m.d.sync += inputs.eq(Cat(self.i, inputs))
        seen: Value = delayed(m, outputs, 1)
        while len(seen) > 1:
            seen = delayed(m, Cat(seen[n : n + 4].xor() for n in range(0, len(seen), 4)), 1)
        m.d.comb += self.o.eq(seen)
        return m


def front_end(config: FrontEndConfig, width_px: int, levels: int, video_bits: int = Build.video_bits) -> Design:
    """The front end for frames up to ``width_px`` wide."""
    config, height_px = replace(config, levels=levels), max(Build.max_height_px, width_px * 9 // 16)
    build = Build(
        config=Config(front_end=config), max_width_px=width_px, max_height_px=height_px, video_bits=video_bits
    )
    return Design(lambda: FrontEnd(build), sum(line_memory_bits(config, width_px >> level) for level in range(levels)))


def line_memory_bits(config: FrontEndConfig, width_px: int) -> int:
    """What a level's line buffers hold: gray, smoothed gray, gradients, responses, ring pixels."""
    pattern, window_px, radius_px = config.pattern, config.tensor_window_px, config.suppression_radius_px
    corner_lag_px = config.response_support_px + radius_px
    gray_lines = max(corner_lag_px, pattern.support_px) - corner_lag_px + 2
    bits = 8 * gray_lines + 8 * 2 * config.smoothed_gradients + 22 * (window_px - 1) + 15 * 2 * radius_px
    return width_px * (bits + 8 * 2 * max(pattern.radii_px))


def block(component: type[wiring.Component], **parameters: Any) -> Design:
    """A block of the aerial preset that is no row of the catalogue."""
    return Design(lambda: component(**parameters))


def listed(name: str, part: str = "", /, **settings: Any) -> Design:
    """A row of the catalogue, or the ``part`` of its chain, without the memory of lines in front."""

    def build() -> wiring.Component:
        made: Any = make_block(name, settings).component
        if part:
            # Amaranth warns of what nothing elaborates: the rest of the chain.
            Fragment.get(made, None)
        return made.blocks[part] if part else made

    return Design(build)


def largest_rules() -> MatchRules:
    """The largest rules that decide matches: 16 terms for each input, and 32 rules that name all of them.

    Synthesis can gain from no pattern in the terms. AND is the minimum, which ends in a division; combinations that no
    rule names are rejected.
    """
    rng = np.random.default_rng(1)
    lines, chosen = ["Engine: largest"], []
    for name in INPUTS[0]:
        high = QUANTITIES[name][0]
        lines += [f"InputVariable: {name}", f"  range: 0 {high}"]
        points = np.linspace(0, high, MAX_PARAMETERS // 2)
        for n, degrees in enumerate(rng.random((MAX_TERMS, len(points)))):
            parameters = " ".join(f"{x} {y}" for x, y in zip(points, degrees, strict=True))
            lines.append(f"  term: t{n} Discrete {parameters}")
        chosen.append(rng.permutation(np.arange(MAX_RULES) % MAX_TERMS))
    lines += ["OutputVariable: weight", "  range: 0 1", "  defuzzifier: WeightedAverage", "  default: 0"]
    constants = (f"  term: c{n} Constant {n / (MAX_RULES - 1)}" for n in range(MAX_RULES))
    lines += [*constants, "RuleBlock: rules", "  conjunction: Minimum"]
    for n, terms in enumerate(zip(*chosen, strict=True)):
        conditions = " and ".join(f"{name} is t{term}" for name, term in zip(INPUTS[0], terms, strict=True))
        # Scattered, so that neighbouring rules decide differently.
        lines.append(f"  rule: if {conditions} then weight is c{7 * n % MAX_RULES}")
    return MatchRules("\n".join(lines) + "\n", "largest")


def accelerator(config: Config) -> Design:
    """The whole accelerator with two levels."""
    return Design(lambda: AcceleratorTop(Build(config=config)), front_end(config.front_end, WIDTH_PX, 2).memory_bits)


def designs() -> dict[str, Design]:
    """Every design whose area is recorded, by name."""
    config, wide = AERIAL.front_end, {"width_px": WIDTH_PX}
    estimating = replace(AERIAL, estimator=EstimatorConfig())
    painting = replace(BUILDS["camera"], config=estimating, painter=True)
    pattern, banks = config.pattern, {"lanes": Build.lanes, "max_features": config.max_features}
    return {
        "gray": listed("gray"),
        "half": listed("half"),
        "binomial 3x3": listed("smooth", "block"),
        "binomial 5x5": listed("smooth", "block", window_px=5),
        "sobel": listed("sobel", "block"),
        "gradient columns": listed("harris", "columns"),
        "structure tensor": listed("harris", "tensor"),
        "raw response": listed("harris", "raw"),
        "response code": listed("harris", "code"),
        "fast": listed("fast", "block"),
        "suppression": listed("nms"),
        "corners": listed("corners", "corners"),
        "ring window": block(RingWindow, pattern=pattern, **wide),
        "candidate features": block(CandidateFeatures, pattern=pattern, spacing_cycles=2, level=0, lag_px=17),
        "cell selection": block(CellSelection, pattern=pattern, **wide),
        "level 0": block(Level, config=config, level=0, **wide),
        "level 1": block(Level, config=config, level=1, width_px=WIDTH_PX // 2),
        **{
            f"front end, {width_px} wide, {levels} level{'s' * (levels > 1)}": front_end(config, width_px, levels)
            for width_px in (640, WIDTH_PX)
            for levels in (1, 2)
        },
        "front end, 1920 wide, two pixels per clock": front_end(config, WIDTH_PX, 2, video_bits=48),
        "front end, 3840 wide, two pixels per clock": front_end(config, 2 * WIDTH_PX, 2, video_bits=48),
        "front end, thesis, 1920 wide": front_end(THESIS.front_end, WIDTH_PX, 1),
        "window correlation": listed("correlation"),
        "fuzzy correlation": listed("fuzzy_correlation"),
        "matcher": listed("matcher", **banks),
        "matcher, largest rules": listed("matcher", rule_base=largest_rules(), **banks),
        "homography estimator": listed("homography"),
        "camera crossing": block(CameraCrossing, video_bits=24, depth=4096),
        "camera gate": block(CameraGate),
        "ring writer": block(RingWriter, record_words=6, max_words=6 * (config.max_features + 2)),
        "painter": listed("painter"),
        "accelerator": accelerator(AERIAL),
        "accelerator, homography": accelerator(estimating),
        "camera, homography, painter": Design(lambda: CameraTop(painting), accelerator(estimating).memory_bits),
    }


def placed_designs() -> dict[str, Design]:
    """Designs of which only the clock is recorded: a camera build with the painter for which an ECP5-85 has room."""
    kit = BUILDS["ulx3s"]
    config = replace(AERIAL, estimator=EstimatorConfig(), front_end=kit.config.front_end)
    build = replace(BUILDS["camera"], config=config, lanes=kit.lanes, max_width_px=640, max_height_px=480, painter=True)
    return {"camera, homography, painter, 640 wide, 1 level": Design(lambda: CameraAccelerator(build))}
