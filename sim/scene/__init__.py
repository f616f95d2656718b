"""Synthetic flights: an invented landscape, a camera over it, and the exact homographies between its views."""

from sim.scene.camera import Camera, CameraPose, Photometry, project, render_view
from sim.scene.flight import Flight, lawnmower, pair
from sim.scene.ground import render_ground

__all__ = [
    "Camera",
    "CameraPose",
    "Flight",
    "Photometry",
    "lawnmower",
    "pair",
    "project",
    "render_ground",
    "render_view",
]
