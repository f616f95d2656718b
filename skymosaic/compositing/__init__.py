"""From laid-out photographs to one picture: warping, exposure, seams, blending."""
