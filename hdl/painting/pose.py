"""Poses: set by the host, or composed."""

from amaranth import signed
from amaranth.lib import data

from golden_model.painting.pose import ELEMENT

COLUMN = data.StructLayout({name: signed(ELEMENT.bits) for name in "xyw"})
"""A column of a pose. A pose is a packet of three of these: what is constant, and the factors of X and Y."""
