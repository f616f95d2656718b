"""What the passes over a pair have found: features and matches of all of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from golden_model.arrays import Records


@dataclass(frozen=True, eq=False)
class Evidence:
    """Features and matches of all passes so far, in pixels of the working images.

    Attributes
    ----------
    features : tuple of structured arrays
        Left and right, pass by pass.
    matches : structured array
        Their indices refer to ``features``.
    """

    features: tuple[Records, Records]
    matches: Records

    def with_pass(self, other: Evidence) -> Evidence:
        """This evidence and that of a further pass, whose features are appended."""
        matches = other.matches.copy()
        for side, features in zip(("left", "right"), self.features, strict=True):
            matches[f"{side}_index"] += len(features)
        left, right = (np.concatenate(sides) for sides in zip(self.features, other.features, strict=True))
        return Evidence((left, right), np.concatenate((self.matches, matches)))

    @property
    def kept(self) -> Records:
        """The matches that the fuzzy stage keeps."""
        kept: Records = self.matches[self.matches["verdict"] == 1]
        return kept
