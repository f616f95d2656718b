"""The page of the board's notebook, with pictures: ``python -m tests.system.board.notebook`` writes it.

The notebook is executed as it is exported, on the simulated accelerator, by a Jupyter kernel of its own in a folder
with the exported programs, on PYNQ's own classes.
"""

import base64
import os
import tempfile
from pathlib import Path
from typing import Any

import nbformat
import numpy as np
from nbclient import NotebookClient

from hdl.build import BUILDS
from hdl.export.boards import SOURCES
from hdl.export.host import write_host
from sim.scene import make_pair
from tests.system.board.pynq_package import NEWEST
from tools.pictures import PICTURES, SEED, decode, save

ROOT = Path(__file__).parents[3]
PAGE = ROOT / "docs" / "how-to" / "notebook.md"
NOTEBOOK = SOURCES / "pynq" / "skymosaic.ipynb"
SIZE_PX = (320, 240)
PYNQ = "from tests.system.board.pynq_board import open_board\n\nopen_board(version={!r})\n"
"""A module of the name: importing it puts PYNQ's own package in its place."""
NOTE = """<!-- Written by `python -m tests.system.board.notebook`. -->

!!! note
    This is `pynq/skymosaic.ipynb` of `skymosaic export board pynq_z2`, run on the simulated accelerator by
    `python -m tests.system.board.notebook`."""


def run_notebook(size_px: tuple[int, int] = SIZE_PX, pynq: str = NEWEST) -> Any:
    """The notebook with its outputs, for a rendered pair, on a version of PYNQ."""
    executed = nbformat.read(NOTEBOOK, as_version=4)
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        write_host(folder, BUILDS["pynq_z2"])
        (folder / "pynq.py").write_text(PYNQ.format(pynq))
        for name, image in zip(("left", "right"), make_pair(seed=SEED, size=size_px).images, strict=True):
            np.save(folder / f"{name}.npy", np.ascontiguousarray(image[..., 1]))
        environment = {
            **os.environ,
            "PYTHONPATH": str(ROOT),
            "IPYTHONDIR": str(folder / "ipython"),
            "TMPDIR": temporary,
        }
        client = NotebookClient(executed, timeout=None, resources={"metadata": {"path": str(folder)}})
        client.execute(env=environment)
    return executed


def format_page(executed: Any) -> str:
    """The notebook as Markdown; its pictures are written into the folder of the documentation's."""
    parts: list[str] = []
    for cell in executed.cells:
        if cell.cell_type == "markdown":
            title, line, rest = cell.source.partition("\n")
            parts += [title, NOTE, rest] if title.startswith("# ") else [title + line + rest]
            continue
        parts.append(f"```python\n{cell.source}\n```")
        for output in cell.outputs:
            if output.output_type == "stream":
                parts.append(f"```text\n{output.text.rstrip()}\n```")
            elif "image/png" in output.get("data", {}):
                path = PICTURES / f"notebook-{cell.id}.webp"
                save(path, decode(base64.b64decode(output.data["image/png"])))
                parts.append(f"![{cell.id}]({os.path.relpath(path, PAGE.parent)})")
    return "\n\n".join(part.strip() for part in parts) + "\n"


if __name__ == "__main__":
    PAGE.write_text(format_page(run_notebook()), encoding="utf-8")
