"""Stages for every pixel, in integers: gray, half size, smoothing, gradients, corner response, suppression."""
