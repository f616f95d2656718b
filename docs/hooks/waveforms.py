"""Waveform diagrams, each of a block that is simulated while the site is built: `waves/NAME.svg` beside the pages.

The clocks are the first ones of the run in which a row is compared with the golden model, so a wrong picture is a
failed build.
"""

import json
from collections.abc import Callable, Iterable
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import wavedrom
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

from golden_model.records import FRAME_STATUS, MATCH, Tag
from hdl.axi.packet_gate import PacketGate
from hdl.blocks.catalogue import make_block
from hdl.blocks.vectors import Block, of_stream, packet, padded_status
from hdl.lib.skid_buffer import SkidBuffer
from sim.benches.rows import Row, record


class Picture(NamedTuple):
    """What is drawn of a block: ports of ``i`` and ``o``, from one clock up to another."""

    make: Callable[[], Block]
    i: str
    o: str
    clocks: tuple[int, int]
    hexadecimal: str = ""
    """The end of the names of ports whose values are drawn like that."""


def _numbers() -> Block:
    return of_stream(SkidBuffer(shape=8), "", range(1, 40), range(1, 40))


def _packets() -> Block:
    match, status = np.zeros((), MATCH.dtype), np.zeros(1, FRAME_STATUS.dtype)[0]
    match["tag"], match["verdict"], match["distance"] = Tag.MATCH, 1, 9
    status["tag"], status["good"] = Tag.FRAME_STATUS, 1
    words = packet(match, padded_status(status, MATCH.record_bytes)) * 4
    return of_stream(PacketGate(record_bytes=MATCH.record_bytes), "", words, words, i_enable=1)


PICTURES = {
    "beat": Picture(lambda: make_block("gray", {}), "x y data", "x y pixel", (0, 11), "data"),
    "line": Picture(lambda: make_block("half", {}), "x y pixel", "x y pixel", (37, 57)),
    "stream": Picture(_numbers, "", "", (0, 20)),
    "packet": Picture(_packets, "data last", "data last", (0, 20), "data"),
}


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pictures below ``explanation/``."""
    for name, picture in PICTURES.items():
        files.append(File.generated(config, f"explanation/waves/{name}.svg", content=draw(picture)))
    return files


def draw(picture: Picture) -> str:
    """Simulate a block, and draw its ports as SVG."""
    first, end = picture.clocks
    recorded = {name: values[first:] for name, values in record(Row(picture.make), end).items()}
    groups: list[Any] = [{"name": "clk", "wave": "p" + "." * (end - first - 1)}]
    longest = 0
    for port, fields in (("i", picture.i), ("o", picture.o)):
        valid, ready = recorded[f"{port}_valid"], recorded.get(f"{port}_ready")
        bits = [f"{port}_valid", *([f"{port}_ready"] if ready else [])]
        lanes: list[dict[str, Any]] = [{"name": name, "wave": _merge(map(str, recorded[name]))} for name in bits]
        for name in [f"{port}_{field}" for field in fields.split()] or [port]:
            form = "{:x}" if picture.hexadecimal and name.endswith(picture.hexadecimal) else "{}"
            # What waits to be taken is one word, and what is not valid is none.
            waits = [False, *(v and not r for v, r in zip(valid, ready or valid, strict=True))]
            wave = "".join("x" if not v else "." if w else "=" for v, w in zip(valid, waits, strict=False))
            data = [form.format(value) for value, kind in zip(recorded[name], wave, strict=True) if kind == "="]
            longest = max(longest, *map(len, data))
            lanes.append({"name": name, "wave": wave, "data": data})
        groups += [{}, [port, *lanes]]
    drawing = {"signal": groups, "config": {"hscale": 1 + longest // 6}}
    return str(wavedrom.render(json.dumps(drawing)).tostring())


def _merge(levels: Iterable[str]) -> str:
    """A level that stays is drawn in one line."""
    before = "".join(levels)
    return before[0] + "".join("." if now == last else now for last, now in pairwise(before))
