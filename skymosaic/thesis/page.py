"""The HTML page: what the thesis shows, what the same experiment gives here, and why the two differ."""

from __future__ import annotations

import base64
import html
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import cv2

from golden_model.arrays import Pixels
from skymosaic.reports import fuzzy_plots
from skymosaic.reports.fuzzy_systems import PLOTTED_SYSTEMS
from skymosaic.thesis import charts, tables
from skymosaic.thesis.corners import CORNERS, QUALITY_TARGET
from skymosaic.thesis.dataset import WORKING_WIDTH_PX
from skymosaic.thesis.measurements import Measurements
from skymosaic.thesis.rejection import KEY_POINTS
from skymosaic.thesis.tables import Sheet

PICTURE_WIDTH_PX = 1200
JPEG_QUALITY = 85

_STYLE = """
body { font: 16px/1.55 Georgia, 'DejaVu Serif', serif; color: #1d1d1d; margin: 2.5rem auto; max-width: 1000px;
  padding: 0 1.2rem }
h1 { font-size: 1.9rem; margin-bottom: .2rem }
h2 { margin-top: 3rem; border-bottom: 1px solid #ccc; padding-bottom: .2rem }
.lead { color: #555; margin-top: 0 }
table { border-collapse: collapse; margin: 1rem 0; font: 14px/1.4 system-ui, 'DejaVu Sans', sans-serif }
th, td { padding: .3rem .8rem; text-align: right; border-bottom: 1px solid #e4e4e4 }
th { border-bottom: 2px solid #999; font-weight: 600; vertical-align: bottom }
th:first-child, td:first-child { text-align: left }
tr.thesis td { color: #666; background: #f6f6f4 }
figure { margin: 1.2rem 0 }
figcaption { color: #555; font-size: .9rem }
img { width: 100% }
.yes { color: #2a7f62; font-weight: 600 }
.no { color: #a33; font-weight: 600 }
.remark { background: #f6f6f4; border-left: 4px solid #bbb; padding: .6rem 1rem }
details { margin: .8rem 0 }
summary { cursor: pointer; color: #33658a }
@media print { h2 { break-after: avoid } figure, table { break-inside: avoid } }
"""


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
        (tables.corners,),
        "The thesis does not state the scale of its measure. Our thresholds are scaled so that both columns agree at "
        "5000, so only the shapes of the curves can be compared. The published counts level off at about 730 although "
        "the threshold falls further; ours keep growing, because every local maximum of a 3x3 window counts. A limit "
        "on the number of corners or a larger suppression window would explain the difference, but the thesis "
        "mentions neither.",
        charts.corners,
    ),
    Section(
        "Sections II.2.1.2 and III.6.1.1: the adaptive threshold",
        "The threshold starts low and doubles until the quality of matches (here: the share of mutual SAD matches of "
        f"10x10 windows within 4 px of the homography that RANSAC finds) reaches {QUALITY_TARGET:.0%}.",
        (tables.adaptive,),
        "If views are rotated against each other, windows never match, and the threshold rises until few corners are "
        "left: the method then loses corners without any gain. Repeatability at the lowest threshold is too high by "
        "chance: with thousands of corners, some lie near any position. The accelerator's own adaptive threshold keeps "
        "the number of features near a target instead, which needs no matching.",
    ),
    Section(
        "Table IV-2: SAD against the size of the window",
        f"Mutual best SAD matches between the {CORNERS} strongest corners of each image; good means within 3 px of the "
        "true homography.",
        (tables.windows,),
        "The thesis does not say how it decided that a match is good, nor how many corners it matched here. Our time "
        "is that of the golden model (NumPy, one direction), the thesis's that of MATLAB on another machine: compare "
        "their growth, not the seconds. Beyond about 22 px there is no further gain, as in the thesis (24 at 30x30): "
        "a larger window distinguishes more corners, but perspective, rotation and relief change more of it. "
        "Correlation is not invariant to rotation: rotated pairs give hardly any good match at any size (see the "
        "groups).",
        charts.windows,
        ("IV-2", "px"),
    ),
    Section(
        "Table IV-3: ILBP against the number of rings",
        f"Mutual nearest neighbours in Hamming distance between the {CORNERS} strongest corners of each image.",
        (tables.rings,),
        "More rings give more good matches and a smaller share of false ones, as published. The number of matches "
        "behaves differently: the thesis's falls with N, ours rises at first. One ring has only 256 possible values "
        f"for {CORNERS} corners, so many are equal, and of equal ones only the first can be a mutual match. The thesis "
        "does not say how it treats them. We find fewer good matches in views that are rotated, scaled or differently "
        "exposed: the descriptor compares unsmoothed pixels in upright rings and is not invariant to these changes.",
        charts.rings,
        ("IV-3", "rings"),
    ),
    Section(
        "Table IV-4: fuzzy RANSAC",
        f"{KEY_POINTS} SIFT key points per image, a descriptor, and the ratio test at 0.8 with one match for each "
        "feature of image 2 (II-7). Then the bidirectional check and RANSAC with τ = 4 px, each on every match by "
        "itself. The last column counts the matches that the six rules of Table III-3 accept.",
        (tables.fuzzy_ransac,),
        "Counts are means over all pairs. The thesis's own combination, SIFT key points with upright, unsmoothed ILBP, "
        "gives far fewer matches here than published, and hardly any on rotated views. With ILBP-128, which is "
        "smoothed and follows the key point's orientation, nearly the published proportions pass the checks. "
        "If most matches are good, the two checks agree and the rules change little; they matter where many matches "
        "are bad.",
        charts.fuzzy_ransac,
    ),
    Section(
        "Table IV-5: RMSE",
        "The root mean square distance of the inliers under the estimated homography, as in (IV-3) to (IV-5), on pairs "
        "that were registered, that is, with a mean error over the overlap below 5 px. The last column is the distance "
        "from the true homography, which the thesis did not have.",
        (tables.errors,),
        "RMSE over a method's own inliers measures how well they agree, not how accurate the homography is: a stricter "
        "tolerance lowers it by rejecting more matches, and the homography may still get worse. The aerial preset "
        "keeps many more inliers, from two image scales, so its RMSE is not the smallest; compare its distance from "
        "the truth. On photographs of ground with relief, about one pixel remains that no homography can remove.",
        charts.errors,
    ),
    Section(
        "Table IV-6: recall and precision",
        "Share of the good matches that were kept (IV-6), and share of false ones among the kept (IV-7), over all "
        "pairs together.",
        (tables.recall,),
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
        (tables.stages,),
        "A stage helps if its dot lies to the right of its square; it costs matches if its cross lies far below 1, or "
        "if fewer pairs are registered. With windows of 10x10 or larger, fuzzy correlation keeps almost only good "
        "matches, but it rejects most of the good ones, so that some pairs can no longer be registered. Nine in ten of "
        "the rejected good matches have a good NCC and a bad ZSSD: Table III-1 calls a ZSSD above 50 bad, that is, "
        "differences with a standard deviation above 7 gray levels, and on textured ground a displacement of half a "
        "pixel is enough for that. Fuzzy ILBP raises the share of good matches; it loses more good ones the more the "
        "exposures differ, because of its SAD inputs. The aerial rules keep nearly every good match.",
        charts.stages,
    ),
    Section(
        "Figure IV-6: repeatability against scale",
        "The left picture of each pair is reduced by area. How many of the reduced picture's key points lie within "
        "1.5 px of one in the full picture? Both have the same number of key points per area of the scene, "
        f"{CORNERS} in the full picture.",
        (),
        "SIFT's key points have a scale and are found again; Harris corners have only one scale and are lost. The "
        "dotted lines are the same measure after shifting the reduced picture by 12 px: the agreement by chance.",
        charts.scales,
    ),
    Section(
        "Table IV-7: time for a mosaic",
        "Time from two decoded images to their mosaic with distance-weighted blending, for pairs that were registered.",
        (tables.seconds,),
        "The published times are for MATLAB on an i7 with 4 GB, ours for NumPy and OpenCV on one core of this machine. "
        "Pairs, sizes and machines differ, so only the order of magnitude can be compared. The thesis preset does not "
        "select corners by cells, so it first searches a threshold that leaves at most 2048 corners.",
    ),
)


def compose(m: Measurements, source: str, pictures: Iterable[tuple[str, Pixels]], pair: str) -> str:
    """The whole page as one self-contained HTML file.

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
    groups = ", ".join(f"{group} ({_pairs_of(m, group)})" for group in m.groups)
    parts = [
        "<h1>The thesis's experiments, repeated</h1>",
        f"<p class=lead>Fuzzy feature matching for UAV image mosaicing, tables IV-1 to IV-7 and figure IV-6, on "
        f"{len(m.pairs)} pairs: {_text(source)}. Groups: {_text(groups)}. Images are at most {WORKING_WIDTH_PX} px "
        "wide.</p>",
        "<p>Gray rows and dashed lines are the published figures; the others were measured for this page. The thesis's "
        "scenes are not public, so the figures cannot be expected to agree, but the trends can.</p>",
        _trends(m),
        *(_section(section, m) for section in SECTIONS),
        "<h2>The fuzzy systems</h2>",
        *(_figure(fuzzy_plots.picture(PLOTTED_SYSTEMS[name]), "png", "") for name in ("correlation", "ilbp", "ransac")),
        f"<h2>One pair in pictures: {_text(pair)}</h2>",
        *(_figure(_jpeg(picture), "jpeg", caption) for caption, picture in pictures),
    ]
    return (
        "<!doctype html><html lang=en><head><meta charset=utf-8><title>The thesis's experiments, repeated</title>"
        f"<style>{_STYLE}</style></head><body>{''.join(parts)}</body></html>\n"
    )


def _pairs_of(m: Measurements, group: str) -> int:
    return len({line.pair for line in m.lines if line.group == group})


def _trends(m: Measurements) -> str:
    rows = "".join(
        f"<tr><td>{_text(trend.statement)}</td><td class={'yes' if trend.holds else 'no'}>"
        f"{'holds' if trend.holds else 'does not hold'}</td><td>{_text(trend.numbers)}</td></tr>"
        for trend in tables.trends(m)
    )
    head = "<tr><th>the thesis shows that</th><th>here it</th><th></th></tr>"
    return f"<h2>Which trends hold here</h2><table>{head}{rows}</table>"


def _section(section: Section, m: Measurements) -> str:
    parts = [f"<h2>{_text(section.title)}</h2><p>{_text(section.question)}</p>"]
    parts += [_table(sheet(m)) for sheet in section.sheets]
    if section.chart:
        parts.append(_figure(section.chart(m), "svg+xml", ""))
    parts.append(f"<p class=remark>{_text(section.remark)}</p>")
    if section.by_group:
        table, unit = section.by_group
        parts.append(f"<details><summary>By group</summary>{_table(tables.by_group(m, table, unit))}</details>")
    return "".join(parts)


def _table(sheet: Sheet) -> str:
    head = "".join(f"<th>{_text(heading)}</th>" for heading in sheet.headings)
    rows = "".join(
        f"<tr{' class=thesis' if row[0].startswith('thesis') else ''}>"
        + "".join(f"<td>{_text(cell)}</td>" for cell in row)
        + "</tr>"
        for row in sheet.rows
    )
    return f"<table><tr>{head}</tr>{rows}</table>"


def _figure(data: bytes, kind: str, caption: str) -> str:
    encoded = base64.b64encode(data).decode()
    text = f"<figcaption>{_text(caption)}</figcaption>" if caption else ""
    return f"<figure><img src='data:image/{kind};base64,{encoded}' alt='{_text(caption)}'>{text}</figure>"


def _jpeg(picture: Pixels) -> bytes:
    height, width = picture.shape[:2]
    if width > PICTURE_WIDTH_PX:
        size = PICTURE_WIDTH_PX, round(height * PICTURE_WIDTH_PX / width)
        picture = cv2.resize(picture, size, interpolation=cv2.INTER_AREA).astype(picture.dtype, copy=False)
    return bytes(cv2.imencode(".jpg", picture, (cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY))[1].tobytes())


def _text(words: str) -> str:
    return html.escape(words)
