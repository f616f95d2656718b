"""Made-up results, whose every number is known, and what a page says, as text."""

import html
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from nicegui import ui
from nicegui.element import Element

from golden_model.arrays import Records
from golden_model.config import preset_config
from golden_model.fuzzy.sugeno import Variable
from golden_model.matching.matcher import match
from sim.simulators.scoreboard import Coverage
from skymosaic.evaluation.hardware import Comparison
from skymosaic.features.methods import choose_method
from skymosaic.imagery.images import Photograph
from skymosaic.panel.explain import FiredRule, Input, explain
from skymosaic.panel.options import Options
from skymosaic.panel.pages.page_layout import fill_in
from skymosaic.panel.results import (
    Decoded,
    HardwareResult,
    InputFile,
    Link,
    MosaicResult,
    Picture,
    ShownMosaic,
    TrackingResult,
)
from skymosaic.registration.confidence import Evidence
from skymosaic.registration.pair import Pair
from skymosaic.tracking.output import TrackedCorners

RUN = Path("made up") / "07"
SQUARE = np.array([[0.0, 0], [60, 0], [60, 40], [0, 40]])
SAID = (
    "aria-label", "label", "title", "hint", "role", "href", "aria-current", "words", "min", "max", "start", "pictures",
    "tiles", "url", "accept", "indeterminate", "drawing", "curves", "corners", "high",
)  # fmt: skip
"""Properties by which a user or a screen reader knows an element, and our own drawings; its style is not recorded."""
MAX_SHOWN = 240
"""Of longer ones, as of curves, both ends."""


def features(shift_px: int) -> Records:
    """Eight corners in a row, each unlike the others, moved to the right."""
    pattern = preset_config("aerial").front_end.pattern
    found = np.zeros(8, pattern.record.dtype)
    number = np.arange(8)
    found["x"], found["y"] = 16 * (40 + 30 * number + shift_px), 16 * (90 - 5 * number) + 4
    found["level"], found["sector"], found["index"] = number % 2, number, number
    found["descriptor"][:] = 0
    for each in number:
        found["descriptor"][each, 2 * each : 2 * each + 2] = 255
    return found


def pair(left: str, right: str, options: Options, *, registered: bool = True) -> Pair:
    """A pair whose right photograph lies 10 px to the left; a match is rejected, and one is off the homography."""
    method, config = choose_method(options.base_config, options.detector, options.descriptor)
    one, other = features(0), features(-10)
    other["descriptor"][6, :2], other["sector"][6], other["x"][5] = (255, 240), 12, 3000
    matches = match(one, other, preset_config("aerial").front_end.pattern, preset_config("aerial").matcher)
    matches["rule"] = np.where(matches["rule"] < len(method.rule_names(config)), matches["rule"], 0)
    kept = matches[matches["verdict"] == 1]
    shift = np.array([[1.0, 0, -10], [0, 1, 0], [0, 0, 1]])
    nothing = np.zeros((0, 0, 0), np.uint8)
    return Pair(
        left=Photograph(left, nothing),
        right=Photograph(right, nothing),
        to_original=(np.eye(3), np.eye(3)),
        working=(nothing, nothing),
        visible=(None, None),
        features=(one, other),
        matches=matches,
        kept=kept,
        inliers=kept[kept["left_index"] != 5] if registered else kept[:0],
        refined_inliers=0,
        homography=shift if registered else None,
        reason="" if registered else "3 inliers are too few",
        config=config,
        method=method,
        estimator="prosac",
        effort="fast",
        passes=1,
        inverted=False,
        backend="golden",
        seconds={},
        known_evidence=Evidence(0.5, 5.0, 0.6, 6, 0.1, 0.8, 0.0, 0.5) if registered else None,
    )


def uploaded(name: str, *notes: str) -> InputFile:
    return InputFile.of_upload(name, Decoded((800, 600), notes, Path(f"uploads/{name}.png"), (640, 480)))


def pair_result(folder: Path) -> MosaicResult:
    """Two photographs in a mosaic with a seam; their rules can be edited."""
    options = Options.of_preset("aerial")
    working = Picture("/picture/07/a.png.png", 320, 120), Picture("/picture/07/b.png.png", 320, 120, 332)
    picture, tile = Picture("/picture/07/mosaic.jpg", 200, 100), Picture("/picture/07/tile.jpg", 50, 50, 10, 20, 0.5)
    outlines = {"a.png": SQUARE, "b.png": SQUARE + 20}
    return MosaicResult(
        folder=folder,
        pictures=RUN,
        command="skymosaic mosaic a.png b.png",
        options=options,
        paths={"a.png": "a.png", "b.png": "b.png"},
        pair=pair("a.png", "b.png", options),
        working=working,
        seconds={"reading": 0.5, "registering": 1.25},
        mosaic=ShownMosaic(picture, (400, 200), outlines, (SQUARE + 5,), (tile,)),
        facts={"size": "400x200"},
    )


def flight_result(folder: Path) -> MosaicResult:
    """Three photographs, one of them left out, by a method without rules that are edited."""
    result, options = pair_result(folder), Options.of_preset("aerial").changed("detector", "orb")
    options = options.changed("descriptor", "freak")
    return replace(
        result,
        command="skymosaic mosaic flight",
        options=options,
        pair=pair("a.png", "b.png", options),
        mosaic=result.mosaic and replace(result.mosaic, seams=(), tiles=()),
        left_out={"c.png": "no overlap", "gone.png": "unreadable"},
        links=(Link("a.png", "b.png", 50), Link("b.png", "c.png", 9)),
        problems={"c.png": ("blurred", "dark")},
    )


def hardware_result() -> HardwareResult:
    coverage = Coverage(frames=2, features=(900, 100), sectors=16, matches=300)
    notes = ("few features",)
    compared = Comparison(None, coverage, (308_200, 308_700), 0.5, 0.08, (640, 480), notes, (), {})
    return HardwareResult("rtl", compared, "skymosaic compare a.png b.png")


def tracking_result(folder: Path) -> TrackingResult:
    corners = ((1.0, 2.0), (11.0, 2.0), (11.0, 9.5), (1.0, 9.5))
    rows = TrackedCorners(0, 0.0, corners, "projective", 40), TrackedCorners(1, 0.04, None, "", 3, "too few matches")
    return TrackingResult(folder, RUN, "skymosaic track", RUN / "tracked.mp4", rows, 0.0125, ("2 frames are missing",))


def shorten(value: object) -> str:
    text, half = str(value), MAX_SHOWN // 2
    return text if len(text) <= MAX_SHOWN else f"{text[:half]} ... {text[-half:]}"


def words_of(markup: str) -> str:
    """What is read of HTML."""
    return " ".join(html.unescape(re.sub("<[^>]*>", " ", markup)).split())


def explanations() -> Iterator[tuple[str, list[str]]]:
    """Why matches were kept or rejected: by rules, more than the page lists, and by a ratio test without homography."""
    aerial = Options.of_preset("aerial")
    method = pair("a.png", "b.png", aerial.changed("detector", "orb").changed("descriptor", "freak"), registered=False)
    by_rules = pair("a.png", "b.png", aerial)
    for made, index in ((by_rules, 0), (by_rules, 5), (by_rules, 6), (method, 0)):
        explained = explain(made, index)
        yield f"match {index}", [words_of(fill_in("explanation.html", explanation=explained))]
    many = replace(explained, rules=(FiredRule("if near then sure", 0.5, 0.0, dominant=False),) * 9)
    table = np.array([0, 64, 256])
    distance = Variable("distance", {"far": table, "near": 256 - table})
    many = replace(many, inputs=(Input(distance, 7, {"far": 0.75, "near": 0.25}),))
    few = replace(many, rules=many.rules[:8])
    for name, each in (("nine rules", many), ("eight rules", few)):
        yield name, [words_of(fill_in("explanation.html", explanation=each))]


def describe(element: Element) -> Iterator[str]:
    """What one reads of an element and of all inside, a line for each that says something, and whether one sees it."""
    if isinstance(element, ui.timer):
        return
    shown: Any = element
    words = [f"{key}={shorten(element.props[key])}" for key in SAID if element.props.get(key) not in (None, False, "")]
    if isinstance(element, ui.select | ui.checkbox | ui.switch | ui.input | ui.linear_progress | ui.tab_panels):
        words.append(f"value={shown.value}")
    words += [f"of={shown.options}"] if isinstance(element, ui.select) else []
    words += [f"rows={shown.rows}"] if isinstance(element, ui.table) else []
    said = getattr(shown, "text", "") or words_of(str(element.props.get("innerHTML", "")))
    words += [f"says {said!r}"] if said and said != element.props.get("label") else []
    if words:
        states = (("disabled", not getattr(element, "enabled", True)), ("hidden", not element.visible))
        yield " ".join([type(element).__name__, *words, *(state for state, holds in states if holds)])
    for child in element.default_slot.children:
        yield from describe(child)
