"""The fuzzy systems of the matcher: the ``aerial`` preset's, and the thesis's fuzzy ILBP and fuzzy correlation.

Their numbers are in FLL, in `golden_model.fuzzy.rules.SHIPPED`.
"""

from golden_model.fuzzy.rules import match_tables, read_shipped
from golden_model.fuzzy.sugeno import SugenoSystem


def aerial(bits: int) -> SugenoSystem:
    """The rule base of the ``aerial`` preset: product, 8 rules, no division.

    Inputs: Hamming distance (low up to .10 of ``bits``, high from .34), margin to the second best (big from .10 of
    ``bits``), and the difference between the match's relative orientation and the most common one, in sectors. A match
    belongs fully to the common orientation up to one sector, .6 at two sectors, .2 at three, and not beyond. The values
    come from ablation on real flights.
    """
    return match_tables(read_shipped("aerial"), bits)


def aerial_orientation(bits: int) -> SugenoSystem:
    """The 4-rule system of distance and margin; its squared weight is a match's vote for a relative orientation."""
    return match_tables(read_shipped("aerial-turn"), bits)


def ilbp(bits: int) -> SugenoSystem:
    """The thesis's fuzzy ILBP: minimum, 4 rules over Hamming distance and the belongings r1 and r2.

    The thesis gives neither the corners of the sets nor which SAD determines which belonging. Our reading: both
    belongings follow from the SAD (equation III-1) between the 3x3 gray windows of the two features, per pixel. The
    SAD is symmetric, so r1 = r2 = r. Rules 3 and 4, which require one belonging without the other, therefore fire only
    for 0 < r < 1. At low distance and r <= 1/2, rules 1 and 3 balance: weight 1/2.

    The sigmoid is centred at 9.5 gray levels per pixel, midway between the SAD that Table III-1 calls surely good (6)
    and surely bad (13), where it is .95 and .05: its slope is 2 ln(.95 / .05) / 7. The distance is low up to 1/8 of
    ``bits`` and high from 3/8. The two sets cross at 1/4, which is 2.8 standard deviations below the mean distance of
    unrelated descriptors of 32 independent bits; the mean itself (1/2) is entirely high. Match is 1, no match 0, also
    where no rule fires.
    """
    return match_tables(read_shipped("ilbp"), bits)


def correlation() -> SugenoSystem:
    """The thesis's fuzzy correlation (Tables III-1, III-2): minimum, 27 rules over SAD, ZSSD and NCC.

    Inputs are scaled by `golden_model.matching.correlation.fuzzy_inputs`. Sets ramp where the ranges of the table
    overlap. The thesis does not give the lower edge of the medium NCC; here it ramps from .25 to .3. Any bad input
    gives a bad match (0), two or three good inputs a good match (1), everything else a medium match (.5).
    """
    # No input counts bits.
    return match_tables(read_shipped("correlation"), 0)
