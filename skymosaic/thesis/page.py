"""The HTML page: what the thesis shows, what the same experiment gives here, and why the two differ."""

import base64
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import cv2

from golden_model.arrays import Pixels
from skymosaic.fuzzy.plots import draw_system
from skymosaic.fuzzy.plotted_systems import PLOTTED_SYSTEMS
from skymosaic.imagery.images import reduce_to_width
from skymosaic.reports.pages import render
from skymosaic.thesis import charts, tables
from skymosaic.thesis.corners import CORNERS, QUALITY_TARGET
from skymosaic.thesis.dataset import WORKING_WIDTH_PX
from skymosaic.thesis.measurements import Measurements
from skymosaic.thesis.rejection import KEY_POINTS
from skymosaic.thesis.tables import Sheet

PICTURE_WIDTH_PX = 1200
JPEG_QUALITY = 85
SYSTEMS = ("correlation", "ilbp", "ransac")
"""Fuzzy systems that the page shows."""


@dataclass(frozen=True)
class Section:
    """One experiment: its question, its tables and diagram, and a remark on how and why our results differ."""

    title: str
    question: str
    sheets: Sequence[Callable[[Measurements], Sheet]]
    remark: str
    chart: Callable[[Measurements], bytes] | None = None
    by_group: tuple[str, str] | None = None


SECTIONS = (
    Section(
        "Table IV-1: Harris corners against the threshold",
        "How many corners does each threshold leave? Harris measure (III-7) with k = 0.04, 3x3 window and suppression.",
        (tables.tabulate_corners,),
        "The thesis does not state the scale of its measure. Our thresholds are scaled so that both columns agree at "
        "5000, so only the shapes of the curves can be compared. The published counts level off at about 730 although "
        "the threshold falls further; ours keep growing, because every local maximum of a 3x3 window counts. A limit "
        "on the number of corners or a larger suppression window would explain the difference, but the thesis "
        "mentions neither.",
        charts.plot_corners,
    ),
    Section(
        "Sections II.2.1.2 and III.6.1.1: the adaptive threshold",
        "The threshold starts low and doubles until the quality of matches (here: the share of mutual SAD matches of "
        f"10x10 windows within 4 px of the homography that RANSAC finds) reaches {QUALITY_TARGET:.0%}.",
        (tables.tabulate_adaptive_threshold,),
        "If views are rotated against each other, windows never match, and the threshold rises until few corners are "
        "left: the method then loses corners without any gain. Repeatability at the lowest threshold is too high by "
        "chance: with thousands of corners, some lie near any position. The accelerator's own adaptive threshold keeps "
        "the number of features near a target instead, which needs no matching.",
    ),
    Section(
        "Table IV-2: SAD against the size of the window",
        f"Mutual best SAD matches between the {CORNERS} strongest corners of each image; good means within 3 px of the "
        "true homography.",
        (tables.tabulate_windows,),
        "The thesis does not say how it decided that a match is good, nor how many corners it matched here. Our time "
        "is that of the golden model (NumPy, one direction), the thesis's that of MATLAB on another machine: compare "
        "their growth, not the seconds. Beyond about 22 px there is no further gain, as in the thesis (24 at 30x30): "
        "a larger window distinguishes more corners, but perspective, rotation and relief change more of it. "
        "Correlation is not invariant to rotation: rotated pairs give hardly any good match at any size (see the "
        "groups).",
        charts.plot_windows,
        ("IV-2", "px"),
    ),
    Section(
        "Table IV-3: ILBP against the number of rings",
        f"Mutual nearest neighbours in Hamming distance between the {CORNERS} strongest corners of each image.",
        (tables.tabulate_rings,),
        "More rings give more good matches and a smaller share of false ones, as published. The number of matches "
        "behaves differently: the thesis's falls with N, ours rises at first. One ring has only 256 possible values "
        f"for {CORNERS} corners, so many are equal, and of equal ones only the first can be a mutual match. The thesis "
        "does not say how it treats them. We find fewer good matches in views that are rotated, scaled or differently "
        "exposed: the descriptor compares unsmoothed pixels in upright rings and is not invariant to these changes.",
        charts.plot_rings,
        ("IV-3", "rings"),
    ),
    Section(
        "Table IV-4: fuzzy RANSAC",
        f"{KEY_POINTS} SIFT key points per image, a descriptor, and the ratio test at 0.8 with one match for each "
        "feature of image 2 (II-7). Then the bidirectional check and RANSAC with τ = 4 px, each on every match by "
        "itself. The last column counts the matches that the six rules of Table III-3 accept.",
        (tables.tabulate_fuzzy_ransac,),
        "Counts are means over all pairs. The thesis's own combination, SIFT key points with upright, unsmoothed ILBP, "
        "gives far fewer matches here than published, and hardly any on rotated views. With ILBP-128, which is "
        "smoothed and follows the key point's orientation, nearly the published proportions pass the checks. "
        "If most matches are good, the two checks agree and the rules change little; they matter where many matches "
        "are bad.",
        charts.plot_fuzzy_ransac,
    ),
    Section(
        "Table IV-5: RMSE",
        "The root mean square distance of the inliers under the estimated homography, as in (IV-3) to (IV-5), on pairs "
        "that were registered, that is, with a mean error over the overlap below 5 px. The last column is the distance "
        "from the true homography, which the thesis did not have.",
        (tables.tabulate_errors,),
        "RMSE over a method's own inliers measures how well they agree, not how accurate the homography is: a stricter "
        "tolerance lowers it by rejecting more matches, and the homography may still get worse. The aerial preset "
        "keeps many more inliers, from two image scales, so its RMSE is not the smallest; compare its distance from "
        "the truth. On photographs of ground with relief, about one pixel remains that no homography can remove.",
        charts.plot_errors,
    ),
    Section(
        "Table IV-6: recall and precision",
        "Share of the good matches that were kept (IV-6), and share of false ones among the kept (IV-7), over all "
        "pairs together.",
        (tables.tabulate_recall,),
        "The published recall of scenes and tests is Table IV-4's inliers divided by its matches (83 of 110 is 0.75). "
        "This counts every match as correct, so that rejecting a false match lowers the value. The first column is "
        "computed in the same way. In the others, a match is good if it agrees with the true homography within 3 px; "
        "inliers of a wrong homography are false.",
    ),
    Section(
        "What the fuzzy stages do",
        "Every stage compared with the true homography: true and false positives and negatives (means over the pairs), "
        "shares over all pairs together, and the number of pairs that RANSAC registers with all matches and with the "
        "kept ones.",
        (tables.tabulate_stages,),
        "A stage helps if its dot lies to the right of its square; it costs matches if its cross lies far below 1, or "
        "if fewer pairs are registered. With windows of 10x10 or larger, fuzzy correlation keeps almost only good "
        "matches, but it rejects most of the good ones, so that some pairs can no longer be registered. Nine in ten of "
        "the rejected good matches have a good NCC and a bad ZSSD: Table III-1 calls a ZSSD above 50 bad, that is, "
        "differences with a standard deviation above 7 gray levels, and on textured ground a displacement of half a "
        "pixel is enough for that. Fuzzy ILBP raises the share of good matches; it loses more good ones the more the "
        "exposures differ, because of its SAD inputs. The aerial rules keep nearly every good match.",
        charts.plot_stages,
    ),
    Section(
        "Figure IV-6: repeatability against scale",
        "The left picture of each pair is reduced by area. How many of the reduced picture's key points lie within "
        "1.5 px of one in the full picture? Both have the same number of key points per area of the scene, "
        f"{CORNERS} in the full picture.",
        (),
        "SIFT's key points have a scale and are found again; Harris corners have only one scale and are lost. The "
        "dotted lines are the same measure after shifting the reduced picture by 12 px: the agreement by chance.",
        charts.plot_scales,
    ),
    Section(
        "Table IV-7: time for a mosaic",
        "Time from two decoded images to their mosaic with distance-weighted blending, for pairs that were registered.",
        (tables.tabulate_seconds,),
        "The published times are for MATLAB on an i7 with 4 GB, ours for NumPy and OpenCV on one core of this machine. "
        "Pairs, sizes and machines differ, so only the order of magnitude can be compared. The thesis preset does not "
        "select corners by cells, so it first searches a threshold that leaves at most 2048 corners.",
    ),
)


def compose_page(m: Measurements, source: str, pictures: Iterable[tuple[str, Pixels]], pair: str) -> bytes:
    """Compose the page as one self-contained HTML file.

    Parameters
    ----------
    m : Measurements
    source : str
        Origin of the pairs, as text.
    pictures : iterable of (str, ndarray)
        Captions and pictures of one pair.
    pair : str
        The name of that pair.
    """
    groups = ", ".join(f"{group} ({_count_pairs(m, group)})" for group in m.groups)
    return render(
        "thesis.html",
        title="The thesis's experiments, repeated",
        rows=[("pairs", f"{len(m.pairs)}: {source}"), ("groups", groups), ("images", f"{WORKING_WIDTH_PX} px at most")],
        trends=tables.check_trends(m),
        sections=[_fill_section(section, m) for section in SECTIONS],
        systems=[
            (system.title, _embed(draw_system(system), "png")) for system in (PLOTTED_SYSTEMS[name] for name in SYSTEMS)
        ],
        pair=pair,
        pictures=[(caption, _embed(_encode_jpeg(picture), "jpeg")) for caption, picture in pictures],
    )


def _count_pairs(m: Measurements, group: str) -> int:
    return len({line.pair for line in m.lines if line.group == group})


def _fill_section(section: Section, m: Measurements) -> dict[str, object]:
    """Fill in what the template shows of a section."""
    return {
        "title": section.title,
        "question": section.question,
        "sheets": [sheet(m) for sheet in section.sheets],
        "chart": _embed(section.chart(m), "svg+xml") if section.chart else "",
        "remark": section.remark,
        "by_group": tables.tabulate_groups(m, *section.by_group) if section.by_group else None,
    }


def _embed(picture: bytes, kind: str) -> str:
    """Turn a picture into a data URL, so that the page needs no other file."""
    return f"data:image/{kind};base64,{base64.b64encode(picture).decode()}"


def _encode_jpeg(picture: Pixels) -> bytes:
    narrow, _ = reduce_to_width(picture, PICTURE_WIDTH_PX)
    return bytes(cv2.imencode(".jpg", narrow, (cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY))[1].tobytes())
