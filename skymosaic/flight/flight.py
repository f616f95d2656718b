"""A flight laid out: its photographs, the links between them, and their layouts."""

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from golden_model.arrays import Array, Pixels
from skymosaic.flight.layout.agreement import compare_sharpness
from skymosaic.flight.layout.layout import Layout
from skymosaic.flight.layout.self_calibration import Calibration
from skymosaic.flight.linking.links import Link
from skymosaic.flight.linking.view import Settings, View
from skymosaic.imagery.lens import Lens
from skymosaic.imagery.photographs import Source, short_names
from skymosaic.maps.control_points import ControlPoints
from skymosaic.registration.pair import Pair

BLURRED = 0.27
"""Relative sharpness below which a photograph is blurred; sharp ones of public flights have 0.28 and more."""


@dataclass(frozen=True, eq=False)
class Flight:
    """A flight laid out."""

    names: tuple[str, ...]
    """Names of all photographs, as given."""
    sources: tuple[Source, ...]
    """The photographs that could be read, without repetitions."""
    views: tuple[View, ...]
    """One for each source. Links and layouts refer to views by their index in this tuple."""
    links: tuple[Link, ...]
    """Every pair that was tried."""
    layouts: tuple[Layout, ...]
    """Groups of at least two linked views, the largest first."""
    left_out: dict[int, str]
    """Photographs in none of the layouts, by their index among those given, with the reason."""
    settings: Settings
    seconds: dict[str, float]
    """Wall time of each stage."""
    pair: Pair | None = None
    """The registration of two photographs, see `skymosaic.flight.two_photographs`; None of more. Whoever registers two
    looks for the right one in the picture, as it is; how more become one, `skymosaic.flight.picture.preparation` says.
    """
    calibration: Calibration | None = None
    """The lens estimated from tie points. Views, links and layouts are then those of straightened photographs."""
    found_mask: Pixels | None = None
    """The lens's mask, where it was found in the photographs, see `skymosaic.flight.pairing.own_mask`."""
    onto: ControlPoints | None = None
    """What ties it to another map."""
    positions: str = ""
    """The file that says where the cameras were, instead of their GPS; else empty."""

    @property
    def lens(self) -> Lens:
        """The lens that straightens the photographs: as given, or as estimated from tie points."""
        return self.settings.lens if self.calibration is None else self.calibration.lens

    @cached_property
    def short_names(self) -> dict[str, str]:
        """By its name as given, what reports call a photograph: without folders, or with those that tell all apart."""
        names = list(dict.fromkeys([*self.names, *(view.name for view in self.views)]))
        return dict(zip(names, short_names(names), strict=True))

    @cached_property
    def view_names(self) -> list[str]:
        """The short name of each view."""
        return [self.short_names[view.name] for view in self.views]

    def shorten(self, text: str) -> str:
        """A text for a report, with short names."""
        folders = {name.removesuffix(short) for name, short in self.short_names.items()} - {"", os.sep}
        # Where a path begins, not wherever the folder's letters are.
        longest_first = map(re.escape, sorted(folders, key=len, reverse=True))
        return re.sub(rf"(?<![\w./\\-])(?:{'|'.join(longest_first)})", "", text)

    @property
    def folders(self) -> list[Path]:
        """Where the next run finds the photographs: the folders that were given, or those of the files."""
        return [folder for source in self.sources for folder in source.folders]

    def without(self, reasons: Mapping[int, str]) -> "Flight":
        """The same flight without some views in its layouts, by their indices, with the reasons."""
        layouts = (layout.without(reasons) for layout in self.layouts)
        left_out = self.left_out | {self.sources[view].index: reason for view, reason in reasons.items()}
        kept = tuple(layout for layout in layouts if len(layout.members) > 1)
        return replace(self, layouts=kept, left_out=left_out) if reasons else self

    @cached_property
    def relative_sharpness(self) -> Array:
        """Sharpness of each view over that of others of the same ground; outside layouts over the median of all, (V,).

        Sharpness depends more on the ground than on the lens.
        """
        own = np.array([float(np.median(view.sharpness)) for view in self.views])
        relative: Array = np.exp(own - np.median(own))
        for layout in self.layouts:
            pairs = {*layout.agreement.pairs, *((link.left, link.right) for link in layout.links)}
            for view, value in compare_sharpness(self.views, layout.transforms, pairs).items():
                relative[view] = value
        return relative

    def describe_blurred(self, layout: Layout) -> str:
        """Name the photographs of a layout that are blurred, beside others of the same ground; else empty."""
        # Two photographs are blended as they are.
        members = layout.members if self.pair is None else ()
        names = [self.view_names[m] for m in members if self.relative_sharpness[m] < BLURRED]
        return f"{', '.join(names)}: shown only where no other photograph is" if names else ""

    def absent_from(self, layout: Layout) -> dict[int, str]:
        """Photographs that are not in a layout, by their index among those given, with the reason."""
        absent = dict(self.left_out)
        group = {member: each for each in self.layouts for member in each.members}
        ends = [{group.get(link.left), group.get(link.right)} for link in self.links if link.holds]
        for member, other in group.items():
            if other is not layout:
                joining = ends.count({layout, other})
                false = other.apart or layout.apart or "contradict"
                why = f"whose links to it ({joining}) {false}" if joining else "which nothing links to this one"
                name, index = self.sources[member].name, self.sources[member].index
                absent[index] = f"{name}: in another group of {len(other.members)} photographs, {why}"
        return dict(sorted(absent.items()))
