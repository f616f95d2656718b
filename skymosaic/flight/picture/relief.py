"""Warps the photographs of a flight over relief, where matches that had no part in it agree better then."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from golden_model.arrays import Points
from skymosaic.compositing.mesh import Frame, Ties, fit_meshes
from skymosaic.flight.flight import Flight
from skymosaic.flight.layout.layout import Layout
from skymosaic.flight.linking.links import Link
from skymosaic.geometry.homography import transfer_error


def follow_relief(flight: Flight) -> Flight:
    """The same flight, with a mesh for each photograph of the layouts whose held-out matches gain by it.

    Links and errors are those of warped photographs. The other bands of a set would not be bent with the first one:
    such photographs keep their shape.
    """
    if flight.sources[0].bands:
        return flight
    layouts = list[Layout]()
    for layout in flight.layouts:
        frames = {m: Frame(flight.views[m].working_size, layout.transforms[m]) for m in layout.members}
        meshes, shares = fit_meshes(frames, [_ties(link) for link in layout.links], layout.members)
        layouts.append(replace(layout, bent=shares, meshes=meshes) if meshes else layout)
    moves = {view: mesh.find for layout in layouts for view, mesh in layout.meshes.items()}
    if not moves:
        return flight
    links = tuple(link.move(moves) for link in flight.links)
    return replace(flight, links=links, layouts=tuple(_move_links(layout, moves) for layout in layouts))


def _ties(link: Link) -> Ties:
    left, right = (link.left_points, link.left_relief), (link.right_points, link.right_relief)
    return Ties(link.left, link.right, np.concatenate(left), np.concatenate(right))


def _move_links(layout: Layout, moves: Mapping[int, Callable[[Points], Points]]) -> Layout:
    links, contradicting = (tuple(link.move(moves) for link in each) for each in (layout.links, layout.contradicting))
    errors_px = []
    for link in links:
        to_right = np.linalg.inv(layout.transforms[link.right]) @ layout.transforms[link.left]
        errors_px.append(transfer_error(to_right, link.left_points, link.right_points))
    return replace(layout, links=links, contradicting=contradicting, errors_px=tuple(errors_px))


def describe_bending(layout: Layout) -> str:
    """Say in one line what warping the photographs of a layout gained; empty where they keep their shape."""
    if layout.bent is None:
        return ""
    before, after = (f"{share:.0%}" for share in layout.bent)
    return (
        f"a mesh warps each photograph over relief: {after} of the held-out matches lie within 2 px, {before} without"
    )


def bending_numbers(flight: Flight, layout: Layout) -> dict[str, Any] | None:
    """The same in numbers, with the meshes: displacements in px of a picture of ``size``, see `Mesh`."""
    if layout.bent is None:
        return None
    return {
        "held_out_within_2_px": layout.bent,
        "meshes": {
            flight.view_names[member]: {"size": mesh.size, "nodes_px": mesh.nodes_px.round(2).tolist()}
            for member, mesh in layout.meshes.items()
        },
    }
