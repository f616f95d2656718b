"""Runs the notebook of the export on the simulated accelerator, and writes its page in the documentation.

    python bench/notebook.py [--page FILE] [--pictures DIR]

The notebook is executed as it is exported, by a Jupyter kernel of its own in a folder with the exported programs; a
module ``pynq`` stands for the board's. Pictures are written as WebP.
"""

from __future__ import annotations

import base64
import os
import tempfile
from pathlib import Path
from typing import Annotated, Any

import cv2
import nbformat
import numpy as np
import typer
from nbclient import NotebookClient

from golden_model.config import PRESETS
from hdl.export.accelerator import write_host
from hdl.export.boards import SOURCES
from sim.scene import make_pair

ROOT = Path(__file__).parents[1]
NOTEBOOK = SOURCES / "pynq" / "skymosaic.ipynb"
SIZE_PX = (320, 240)
STAND_IN = "from sim.benches.pynq_stand_in import DefaultIP, Overlay, allocate\n"
HEAD = """<!-- Written by `python bench/notebook.py`. -->

!!! note
    This is `pynq/skymosaic.ipynb` of `skymosaic export --board pynq_z2`, run on the simulated accelerator by
    `python bench/notebook.py`. It has not yet run on a board.
"""


def executed(size_px: tuple[int, int] = SIZE_PX) -> Any:
    """The notebook with its outputs, for a rendered pair."""
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        write_host(folder, "pynq", PRESETS["aerial"])
        (folder / "pynq.py").write_text(STAND_IN)
        for name, image in zip(("left", "right"), make_pair(seed=9, size=size_px).images, strict=True):
            np.save(folder / f"{name}.npy", np.ascontiguousarray(image[..., 1]))
        environment = {**os.environ, "PYTHONPATH": str(ROOT), "IPYTHONDIR": str(folder / "ipython")}
        client = NotebookClient(notebook, timeout=None, resources={"metadata": {"path": str(folder)}})
        client.execute(env=environment)
    return notebook


def page(notebook: Any, pictures: Path, relative: str) -> str:
    """The notebook as Markdown; its pictures are written into a folder."""
    parts = [HEAD]
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            parts.append(cell.source)
            continue
        parts.append(f"```python\n{cell.source}\n```")
        for output in cell.outputs:
            if output.output_type == "stream":
                parts.append(f"```text\n{output.text.rstrip()}\n```")
            elif "image/png" in output.get("data", {}):
                name = f"notebook-{cell.id}.webp"
                decoded = cv2.imdecode(np.frombuffer(base64.b64decode(output.data["image/png"]), np.uint8), 1)
                cv2.imwrite(str(pictures / name), decoded, [cv2.IMWRITE_WEBP_QUALITY, 80])
                parts.append(f"![{cell.id}]({relative}/{name})")
    title = next(part for part in parts if part.startswith("# "))
    first_line, _, rest = title.partition("\n")
    body = [rest if part is title else part for part in parts[1:]]
    return "\n\n".join([first_line, HEAD.strip(), *(part.strip() for part in body)]) + "\n"


def main(
    page_file: Annotated[Path, typer.Option("--page", help="The page to write.")] = ROOT / "docs/how-to/notebook.md",
    pictures: Annotated[Path, typer.Option(help="Where its pictures go.")] = ROOT / "docs/images",
) -> None:
    """Run the notebook and write its page."""
    relative = os.path.relpath(pictures, page_file.parent)
    page_file.write_text(page(executed(), pictures, relative))
    print(f"wrote {page_file}")


if __name__ == "__main__":
    typer.run(main)
