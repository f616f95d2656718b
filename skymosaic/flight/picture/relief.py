"""Warps the photographs of a flight over relief, where matches that had no part in it agree better then."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from skymosaic.compositing.mesh import Frame, Judged, Mesh, Ties, fit_meshes
from skymosaic.flight.flight import Flight
from skymosaic.flight.layout.layout import Layout
from skymosaic.flight.linking.links import Link
from skymosaic.geometry.homography import transfer_error

TOGETHER = 100
"""Photographs whose meshes are fitted at once, which takes up to 3 MB for each."""


def follow_relief(flight: Flight) -> Flight:
    """The same flight, with a mesh for each photograph of the layouts whose held-out matches gain by it.

    Links and errors are those of warped photographs. The other bands of a set would not be bent with the first one:
    such photographs keep their shape.
    """
    if flight.sources[0].bands:
        return flight
    layouts = list[Layout]()
    for layout in flight.layouts:
        layouts.append(layout.with_meshes(*_fit_in_parts(flight, layout)))
    moves = {view: mesh.find for layout in layouts for view, mesh in layout.meshes.items()}
    if not moves:
        return flight
    links = {link: link.move(moves) for link in flight.links}
    return replace(flight, links=tuple(links.values()), layouts=tuple(_move_links(each, links) for each in layouts))


def _fit_in_parts(flight: Flight, layout: Layout) -> tuple[dict[int, Mesh], Judged]:
    """The meshes of a layout, and by how many matches they are judged in all.

    `TOGETHER` photographs at a time; they meet those before them where their meshes have put these.
    """
    frames = {m: Frame(flight.views[m].working_size, layout.transforms[m]) for m in layout.members}
    meshes, parts = dict[int, Mesh](), list[Judged]()
    for first in range(0, len(layout.members), TOGETHER):
        bent = layout.members[first : first + TOGETHER]
        moves = {view: mesh.find for view, mesh in meshes.items()}
        # Members rise, and the right view of a link is the later one.
        links = [link.move(moves) for link in layout.links if bent[0] <= link.right <= bent[-1]]
        fitted, judged = fit_meshes(frames, [_ties(link) for link in links], bent)
        meshes |= fitted
        parts.append(judged if fitted else judged._replace(warped=judged.plain))
    return meshes, Judged(*map(sum, zip(*parts, strict=True)))


def _ties(link: Link) -> Ties:
    left, right = (link.left_points, link.left_relief), (link.right_points, link.right_relief)
    return Ties(link.left, link.right, np.concatenate(left), np.concatenate(right))


def _move_links(layout: Layout, moved: Mapping[Link, Link]) -> Layout:
    links, contradicting = (tuple(moved[link] for link in each) for each in (layout.links, layout.contradicting))
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
    return f"photographs are bent over relief: {after} of the held-out matches lie within 2 px, {before} without"


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
