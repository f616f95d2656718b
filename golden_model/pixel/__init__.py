"""Pixel-rate stages in integers: gray, pyramid level, smoothing, gradients, corner response, suppression."""
