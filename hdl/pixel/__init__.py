"""Pixel-rate blocks: gray, pyramid level, line buffers, smoothing, gradients, corner response, suppression."""
