"""Turns registered photographs into one picture: warping, exposure, seams, blending."""
