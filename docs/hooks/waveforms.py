"""Waveform diagrams, each of a block that is simulated while the site is built: `waves/NAME.svg` beside the pages.

The clocks are the first ones of the run in which a row is compared with the golden model, so a wrong picture is a
failed build.
"""

import json
import re
from collections.abc import Callable
from typing import Any

import wavedrom
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

from hdl.blocks.axi import make_packet_gate
from hdl.blocks.catalogue import make_block
from hdl.blocks.vectors import Block, of_stream
from hdl.lib.skid_buffer import SkidBuffer
from sim.benches.rows import record


def _numbers() -> Block:
    return of_stream(SkidBuffer(shape=8), "", range(1, 40), range(1, 40))


PICTURES: dict[str, tuple[Callable[[], Block], str, str, int, int]] = {
    "beat": (lambda: make_block("gray", {}), "x y data", "x y pixel", 0, 11),
    "line": (lambda: make_block("half", {}), "x y pixel", "x y pixel", 37, 57),
    "stream": (_numbers, "", "", 0, 20),
    "packet": (make_packet_gate, "data last", "data last", 0, 20),
}
"""What is drawn of a block: ports of ``i`` and ``o``, from one clock up to another. Those called data are
hexadecimal."""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pictures below ``explanation/``."""
    for name, picture in PICTURES.items():
        files.append(File.generated(config, f"explanation/waves/{name}.svg", content=draw(*picture)))
    return files


def draw(make: Callable[[], Block], i: str, o: str, first: int, end: int) -> str:
    """Simulate a block, and draw its ports as SVG."""
    recorded = {name: values[first:] for name, values in record(make(), end).items()}
    groups: list[Any] = [{"name": "clk", "wave": "p" + "." * (end - first - 1)}]
    longest = 0
    for port, fields in (("i", i), ("o", o)):
        valid, ready = recorded[f"{port}_valid"], recorded.get(f"{port}_ready")
        # What waits to be taken is one word, and what is not valid is none.
        waits = [False, *(v and not r for v, r in zip(valid, ready or valid, strict=True))]
        wave = "".join("x" if not v else "." if w else "=" for v, w in zip(valid, waits, strict=False))
        levels = {f"{port}_valid": valid} | ({f"{port}_ready": ready} if ready else {})
        lanes: list[Any] = [{"name": name, "wave": _merge("".join(map(str, bits)))} for name, bits in levels.items()]
        for name in [f"{port}_{field}" for field in fields.split()] or [port]:
            form = "{:x}" if name.endswith("data") else "{}"
            data = [form.format(value) for value, kind in zip(recorded[name], wave, strict=True) if kind == "="]
            longest = max(longest, *map(len, data))
            lanes.append({"name": name, "wave": wave, "data": data})
        groups += [{}, [port, *lanes]]
    drawing = {"signal": groups, "config": {"hscale": 1 + longest // 6}}
    return str(wavedrom.render(json.dumps(drawing)).tostring())


def _merge(levels: str) -> str:
    """Draw a level that stays as a line without marks."""
    return re.sub(r"(.)\1+", lambda same: same[1] + "." * (len(same[0]) - 1), levels)
