"""Where the corners of a tile's cells lie in the frame."""

from amaranth import signed
from amaranth.lib import data

from golden_model.painting.corners import CORNER as CORNER_FORMAT
from golden_model.painting.corners import SIDE
from hdl.painting.tiles import TILE

CORNER = data.StructLayout({name: signed(CORNER_FORMAT.bits) for name in "xy"})
"""`golden_model.painting.corners.CORNER`, px."""
CORNERS = data.ArrayLayout(CORNER, SIDE**2)
"""Row by row."""
PROJECTED = data.StructLayout({"tile": TILE, "corners": CORNERS, "behind": 1})
"""A tile with its corners. ``behind``: one is not in front of the horizon, or does not fit `CORNER`; then the corners
mean nothing."""
