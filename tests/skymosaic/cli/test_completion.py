"""The shell completes from a table, which is that of the commands, and imports none of them for it."""

import os
import sys
from pathlib import Path

import cv2
import pytest

from sim.scene import make_pair
from skymosaic.cli.commands import COMMANDS
from skymosaic.cli.completion import TABLE
from tests.system.command_line import captured
from tools.completion import describe_commands

PROGRAM = """
import atexit, sys
atexit.register(lambda: print(*sys.modules, file=sys.stderr))
from skymosaic.cli import main
main()
"""
HEAVY = ("numpy", "cv2", "scipy", "rasterio")


def imported(*words: str, **environment: str) -> tuple[list[str], set[str]]:
    """What a command line prints, word by word, and the packages that it imports."""
    command = [sys.executable, "-c", PROGRAM, *words]
    done = captured(command, env={**os.environ, **environment})
    packages = {name.split(".")[0] for name in done.stderr.split()}
    assert "skymosaic" in packages
    return done.stdout.split(), packages


@pytest.mark.parametrize(
    ("typed", "offered"),
    [
        ("skymosaic reg", ["register"]),
        ("skymosaic register --detector a", ["akaze"]),
        ("skymosaic register a.jpg b.jpg --working", ["--working-width"]),
        ("skymosaic panel --no-", ["--no-browser"]),
        ("skymosaic export board zy", ["zybo_z7_20"]),
        # A value of its own, or a file, which the shell completes.
        ("skymosaic mosaic --scale ", []),
        ("skymosaic mosaic a.jpg ", []),
    ],
)
def test_a_key_is_answered_without_what_computes(typed: str, offered: list[str]) -> None:
    count = str(len(typed.split(" ")) - 1)
    asked = {"_SKYMOSAIC_COMPLETE": "complete_bash", "COMP_WORDS": typed, "COMP_CWORD": count}
    words, packages = imported(**asked)
    assert words == offered
    assert packages.isdisjoint(HEAVY)


@pytest.mark.parametrize("flag", ["--version", "--help"])
def test_the_program_introduces_itself_at_once(flag: str) -> None:
    words, packages = imported(flag)
    assert "skymosaic" in words
    assert packages.isdisjoint((*HEAVY, "rich", "typer" if flag == "--version" else ""))
    if flag == "--help":
        # Whole sentences, which plain help would cut.
        assert all(summary.split()[-1] in words for summary in COMMANDS.values())


def test_the_table_is_that_of_the_commands() -> None:
    assert TABLE.read_text(encoding="utf-8") == describe_commands(), "run python -m tools.completion"


def test_two_photographs_are_registered_without_what_only_others_need(tmp_path: Path) -> None:
    files = [tmp_path / f"{number}.png" for number in range(2)]
    for file, image in zip(files, make_pair(seed=5, size=(640, 480)).images, strict=True):
        cv2.imwrite(str(file), image)
    words, packages = imported("register", *map(str, files))
    assert {"confidence", "good"} <= {word.strip("(:;,") for word in words}
    assert packages.isdisjoint(("scipy", "rasterio", "av"))
