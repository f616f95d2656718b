"""What a test sees of a page in a browser: barriers, pictures that do not show, what is wider than the screen.

And what it sees of a picture: whether corners lie where they are said to, and whether two places look alike.
"""

from collections.abc import Sequence
from typing import Literal
from urllib.parse import urljoin

import cv2
import numpy as np
from axe_playwright_python.base import AXE_SCRIPT
from playwright.sync_api import Page, ViewportSize

from golden_model.arrays import Pixels, Points
from golden_model.pixel.gray import to_gray
from tools.panel import PHONE, WINDOW

MARKS = """() => [...document.querySelectorAll(".membership, .curves-plot")].flatMap(drawing => {
    if (!drawing.checkVisibility()) return [];
    const onScreen = (shape, x, y) => new DOMPoint(x, y).matrixTransform(shape.getScreenCTM());
    const shares = Array.from({ length: 1001 }, (_, n) => n / 1000);
    const curves = [...drawing.querySelectorAll("polyline.set")].flatMap(curve => {
        const length = curve.getTotalLength();
        return shares.map(share => curve.getPointAtLength(share * length)).map(at => onScreen(curve, at.x, at.y));
    });
    return [...drawing.querySelectorAll("circle")].map(mark => {
        const at = onScreen(mark, mark.cx.baseVal.value, mark.cy.baseVal.value);
        return Math.min(...curves.map(on => Math.hypot(on.x - at.x, on.y - at.y)));
    });
})"""
"""Distances between the marks of membership curves and the nearest curve, screen px."""
PATCH_PX = 9
View = tuple[ViewportSize, Literal["light", "dark"]]
VIEWS: tuple[View, ...] = ((WINDOW, "light"), (PHONE, "dark"))
"""Both widths and both schemes: no colour depends on the width."""
MIN_CONTRAST = 16
"""Gray levels that a picture spans at least; JPEG leaves a few in one that is of one colour."""
PICTURES = """() => Promise.all([...document.querySelectorAll("img, image")].map(async shown => {
    const { x, y, width, height } = shown.getBoundingClientRect();
    const picture = new Image();
    shown.loading = "eager";
    picture.src = shown.href ? shown.href.baseVal : shown.src;
    await picture.decode().catch(() => {});
    return [picture.src.slice(-60), picture.naturalWidth, x + scrollX, y + scrollY, width, height];
}))"""


def barriers(page: Page) -> list[str]:
    """What axe-core finds, as rule and element."""
    if page.evaluate("window.axe === undefined"):
        page.evaluate(AXE_SCRIPT)
    # Without `preload`, which asks for the style sheets again: a browser refuses that of files.
    options = {"resultTypes": ["violations"], "preload": False}
    found = page.evaluate("async options => (await axe.run(options)).violations", options)
    return [f"{each['id']}: {node['html'][:200]}" for each in found for node in each["nodes"]]


def drawn(page: Page) -> None:
    """Wait until the page has drawn what was changed."""
    page.evaluate("() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")


def photograph(page: Page) -> Pixels:
    """The whole page as it is drawn, in BGR."""
    taken = page.screenshot(full_page=True, type="jpeg", quality=90)
    return np.asarray(cv2.imdecode(np.frombuffer(taken, np.uint8), cv2.IMREAD_COLOR), dtype=np.uint8)


def hidden_pictures(page: Page) -> list[str]:
    """Pictures that cannot be decoded, or that are drawn as a single colour."""
    pictures, found = page.evaluate(PICTURES), []
    seen = photograph(page) if pictures else np.zeros((0, 0, 3), np.uint8)
    for name, natural_px, x, y, width, height in pictures:
        if not natural_px:
            found.append(f"{name}: cannot be shown")
        # Without the border, whose corners are round; nor what reaches beyond the page, as tiles do.
        elif min(x, y) >= 0 and x + width <= seen.shape[1] and y + height <= seen.shape[0] and min(width, height) > 10:
            part = seen[int(y) + 3 : int(y + height) - 3, int(x) + 3 : int(x + width) - 3]
            found += [f"{name}: is of one colour"] if np.ptp(part) < MIN_CONTRAST else []
    return found


def names_of_options(page: Page) -> list[str]:
    """Words in backquotes outside code: options as messages name them before they are spelled for people."""
    return page.evaluate(
        """() => {
            const body = document.body.cloneNode(true);
            body.querySelectorAll("pre, code, script, style, textarea").forEach((each) => each.remove());
            return body.textContent.match(/`\\w+`/g) ?? [];
        }"""
    )


def look(page: Page, views: Sequence[View] = VIEWS, *, for_barriers: bool = True) -> list[str]:
    """What is wrong with a page, by default on a desk in light and on a phone in dark; it stays in the last view."""
    found = []
    for window, scheme in views:
        page.set_viewport_size(window)
        page.emulate_media(color_scheme=scheme)
        drawn(page)
        width = page.evaluate("Math.max(document.documentElement.scrollWidth, document.body.scrollWidth)")
        seen = [f"{width} px wide"] if width > window["width"] else []
        seen += hidden_pictures(page) + names_of_options(page)
        if for_barriers:
            seen += barriers(page)
        found += [f"{window['width']} px, {scheme}: {each}" for each in seen]
    return found


def listen(page: Page) -> list[str]:
    """Errors that the browser reports from now on."""
    heard: list[str] = []
    page.on("pageerror", lambda error: heard.append(str(error)))
    page.on("console", lambda said: heard.append(f"{said.text} {said.location}") if said.type == "error" else None)
    return heard


def alike(one: Pixels, other: Pixels) -> float:
    """Correlation of two pictures, -1 to 1."""
    return float(np.corrcoef(to_gray(one).ravel(), to_gray(other).ravel())[0, 1])


def share_on_corners(picture: Pixels, points: Points) -> float:
    """Share of the points (N, 2) with the strongest corner of the 9x9 pixels around within a pixel."""
    response = cv2.cornerHarris(cv2.GaussianBlur(to_gray(picture), (0, 0), 1), 3, 3, 0.04)
    beside, around = (cv2.dilate(response, np.ones((side, side))) for side in (3, 9))
    x, y = np.rint(points).astype(int).T
    return float(np.mean(beside[y, x] >= around[y, x]))


def marks_beside_curves(page: Page) -> list[str]:
    """Marks of membership curves that do not lie on one."""
    far_px = page.evaluate(MARKS)
    return [f"a mark {each:.1f} px beside its curve" for each in far_px if each > 1.5] if far_px else ["no marks"]


def patch(picture: Pixels, point: Points) -> Pixels:
    """What lies around a point."""
    return np.asarray(cv2.getRectSubPix(picture, (PATCH_PX, PATCH_PX), tuple(map(float, point))), dtype=np.uint8)


def pictures_of(page: Page, viewer: str) -> list[tuple[Pixels, float]]:
    """The pictures of one of the panel's viewers, each with its left end there."""
    images = page.get_by_role("group", name=viewer).locator("image")
    shown = images.evaluate_all("all => all.map(each => [each.href.baseVal, each.x.baseVal.value])")
    found = []
    for address, left in shown:
        body = page.request.get(urljoin(page.url, address)).body()
        found.append((np.asarray(cv2.imdecode(np.frombuffer(body, np.uint8), cv2.IMREAD_COLOR), np.uint8), left))
    return found
