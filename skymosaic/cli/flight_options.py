"""Options that the commands for flights share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

MORE = "More than two photographs"

PhotographsArgument = Annotated[
    list[str],
    typer.Argument(help="Overlapping photographs, folders of them, or a video.", metavar="PHOTOGRAPHS|FOLDER|VIDEO"),
]
CameraOption = Annotated[Path | None, typer.Option("--camera", help="TOML file with intrinsics and distortion.")]
MaskOption = Annotated[Path | None, typer.Option("--mask", help="Picture, black where photographs show no ground.")]
SchedulerOption = Annotated[str | None, typer.Option(help="Dask scheduler (tcp://HOST:PORT) instead of threads.")]
CacheOption = Annotated[
    Path | None, typer.Option("--cache", rich_help_panel=MORE, help="Folder that keeps features and links of flights.")
]
