"""Pictures of a pair's corners and of its kept and rejected matches, coloured by the rule that decided."""

import math
from collections.abc import Sequence

import cv2
import numpy as np

from golden_model.arrays import Pixels, Records
from golden_model.feature.orientation import SECTORS
from golden_model.formats import POSITION
from golden_model.matching.matcher import describe_rules
from skymosaic.features.positions import match_points
from skymosaic.geometry import fuzzy_ransac
from skymosaic.geometry.estimators import FUZZY_RANSAC, fuzzy
from skymosaic.registration.pair import Pair

Color = tuple[int, int, int]
LEVEL_COLORS: tuple[Color, ...] = ((60, 220, 255), (255, 170, 60))
INLIER_COLOR: Color = (80, 230, 80)
TEXT_COLOR: Color = (245, 245, 245)
NO_RULE_COLOR: Color = (160, 160, 160)
_RULE_COLORS: tuple[Color, ...] = (
    (75, 180, 60), (60, 180, 200), (230, 190, 80), (200, 110, 90),
    (180, 80, 200), (60, 130, 245), (130, 130, 240), (70, 70, 220),
)  # fmt: skip
_SUBPIXEL_SHIFT = 4
_PANEL_GAP_PX = 8
_HEADER_ROW_PX = 26
_TEXT_GAP_PX = 16
_FONT, _FONT_SCALE = cv2.FONT_HERSHEY_SIMPLEX, 0.5


def draw_corners(image: Pixels, features: Records) -> Pixels:
    """Draw a circle for each feature (colour: level) with a tick in the direction of its sector."""
    canvas = _dim(image)
    for feature in features:
        x, y = int(feature["x"]), int(feature["y"])
        radius = (4 if feature["level"] == 0 else 8) << _SUBPIXEL_SHIFT
        angle = 2 * math.pi * int(feature["sector"]) / SECTORS
        tip = (x + round(radius * math.cos(angle)), y + round(radius * math.sin(angle)))
        color = LEVEL_COLORS[int(feature["level"])]
        cv2.circle(canvas, (x, y), radius, color, 1, cv2.LINE_AA, _SUBPIXEL_SHIFT)
        cv2.line(canvas, (x, y), tip, color, 1, cv2.LINE_AA, _SUBPIXEL_SHIFT)
    return add_header(
        canvas, f"{len(features)} features", (("full size", LEVEL_COLORS[0]), ("half size", LEVEL_COLORS[1]))
    )


def draw_matches(pair: Pair) -> Pixels:
    """Draw kept matches above and rejected ones below; each line has the colour of the rule that decided."""
    decided, rule_names = _find_deciding_rules(pair)
    kept, rejected = decided[decided["verdict"] == 1], decided[decided["verdict"] == 0]
    near = "accepted as inliers" if pair.estimator == FUZZY_RANSAC else "within 2 px of the homography"
    upper = _draw_panel(pair, kept, pair.inliers, f"{len(kept)} kept, {len(pair.inliers)} {near} (rings)", rule_names)
    lower = _draw_panel(pair, rejected, rejected[:0], f"{len(rejected)} rejected", rule_names)
    return np.concatenate((upper, lower), axis=0)


def _find_deciding_rules(pair: Pair) -> tuple[Records, Sequence[str]]:
    """The matches with the rules that decided on them, and the names of these rules; the last is that none fires.

    Fuzzy RANSAC decides on what the matcher proposes by six rules of its own.
    """
    decided, names = pair.matches.copy(), pair.method.rule_names(pair.config)
    system = pair.method.rules(pair.config)
    if pair.estimator == FUZZY_RANSAC:
        _, decision = fuzzy(*match_points(decided), decided["verdict"] == 1)
        if decision is not None:
            names = describe_rules(fuzzy_ransac.rule_base())
            decided["rule"], decided["verdict"] = decision.rule, decision.inliers
    elif system is not None:
        # A match has the number of the first rule where none fires, which may be the one that accepts.
        outputs = np.array([rule.output for rule in system.rules])
        decided["rule"][(decided["weight"] == 0) & (outputs[decided["rule"]] > 0)] = len(names)
    return decided, [*names, "no rule fires"]


def _rule_color(rule: int, rule_names: Sequence[str]) -> Color:
    return NO_RULE_COLOR if rule == len(rule_names) - 1 else _RULE_COLORS[rule % len(_RULE_COLORS)]


def _draw_panel(pair: Pair, shown: Records, ringed: Records, title: str, rule_names: Sequence[str]) -> Pixels:
    left, right = (_dim(image) for image in pair.working)
    offset_px = left.shape[1] + _PANEL_GAP_PX
    panel = np.full((max(left.shape[0], right.shape[0]), offset_px + right.shape[1], 3), 24, np.uint8)
    panel[: left.shape[0], : left.shape[1]] = left
    panel[: right.shape[0], offset_px:] = right
    for match in shown:
        start = (int(match["left_x"]), int(match["left_y"]))
        end = (int(match["right_x"]) + offset_px * POSITION.one, int(match["right_y"]))
        cv2.line(panel, start, end, _rule_color(int(match["rule"]), rule_names), 1, cv2.LINE_AA, _SUBPIXEL_SHIFT)
    for points, first_px in zip(match_points(ringed), (0, offset_px), strict=True):
        for x, y in points:
            cv2.circle(panel, (round(x) + first_px, round(y)), 3, INLIER_COLOR, 1, cv2.LINE_AA)
    count = np.bincount(shown["rule"], minlength=len(rule_names))
    legend = [
        (f"{name} {count[rule]}", _rule_color(rule, rule_names)) for rule, name in enumerate(rule_names) if count[rule]
    ]
    return add_header(panel, title, legend)


def _dim(image: Pixels) -> Pixels:
    """Copy an image in colour at 60 % brightness, so that lines stand out."""
    return np.asarray(cv2.convertScaleAbs(_in_colour(image), alpha=0.6), dtype=np.uint8)


def _in_colour(image: Pixels) -> Pixels:
    return image if image.ndim == 3 else np.asarray(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR), dtype=np.uint8)


def add_header(picture: Pixels, title: str, legend: Sequence[tuple[str, Color]] = ()) -> Pixels:
    """Put a title and a legend above a gray or BGR picture; they wrap at its width."""
    rows: list[list[tuple[str, Color, int]]] = [[]]
    x = _TEXT_GAP_PX
    for text, color in ((title, TEXT_COLOR), *legend):
        width = int(cv2.getTextSize(text, _FONT, _FONT_SCALE, 1)[0][0])
        if x + width > picture.shape[1] and rows[-1]:
            rows.append([])
            x = _TEXT_GAP_PX
        rows[-1].append((text, color, x))
        x += width + _TEXT_GAP_PX
    header = np.full((_HEADER_ROW_PX * len(rows), picture.shape[1], 3), 24, np.uint8)
    for index, row in enumerate(rows):
        for text, color, left in row:
            baseline = (left, _HEADER_ROW_PX * index + 18)
            cv2.putText(header, text, baseline, _FONT, _FONT_SCALE, color, 1, cv2.LINE_AA)
    return np.concatenate((header, _in_colour(picture)), axis=0)
