"""Synthetic flights: a generated landscape, a camera above it, and the exact homographies between its views."""

from sim.scene.camera import Camera, CameraPose, Photometry, project, render_view
from sim.scene.flight import Flight, make_lawnmower, make_pair
from sim.scene.ground import render_ground, render_heights
from sim.scene.target import Pursuit, make_pursuit

__all__ = [
    "Camera",
    "CameraPose",
    "Flight",
    "Photometry",
    "Pursuit",
    "make_lawnmower",
    "make_pair",
    "make_pursuit",
    "project",
    "render_ground",
    "render_heights",
    "render_view",
]
