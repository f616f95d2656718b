"""No output is an input: a table of commands, their outputs and their inputs, made of what the commands declare."""

import inspect
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args

import pytest

from skymosaic.cli.commands import COMMANDS, import_functions
from skymosaic.cli.outputs import Reads, Writes, check_typed_outputs, claimed
from skymosaic.common.errors import InputError
from skymosaic.common.options import OUTPUT
from skymosaic.evaluation.known_pairs import COLUMNS
from skymosaic.imagery.images import check_unused
from tests.conftest import Run
from tests.system.command_line import only_error

READ = {"left", "right", "inputs", "file", "data", "config", "camera", "mask"}
READ |= {"control_points", "positions", "onto", "boundary"}
OF_OURS = {
    "cache": "a folder of entries whose names are digests",
    "runs": "a folder in which each run makes a new one",
    "root": "folders that the panel shows",
}
FILES = ("made.png", "made_2.png", "made.preview.jpg")
IN_FOLDERS = ("index.html", "mosaic_2.jpg", "7/3/a.webp", "report/index.html", "left.png", "rtl/a.v", "config.toml")
SIGNATURES = {
    words: inspect.signature(function) for name in COMMANDS for words, function in import_functions(name, {}).items()
}
"""What is typed for each command."""


def mark(parameter: inspect.Parameter, kind: type[Any]) -> Any:
    return next((mark for mark in get_args(parameter.annotation) if isinstance(mark, kind)), None)


def spelt(parameter: inspect.Parameter) -> str:
    return str(get_args(parameter.annotation)[0])


TABLE = [
    (command, output)
    for command, signature in SIGNATURES.items()
    for output, parameter in signature.parameters.items()
    if mark(parameter, Writes)
]


def test_every_path_is_an_output_or_read() -> None:
    for command, signature in SIGNATURES.items():
        for name, parameter in signature.parameters.items():
            if "Path" in spelt(parameter):
                assert bool(mark(parameter, Writes)) != (name in READ or name in OF_OURS), (command, name)
                is_output = get_args(parameter.annotation)[1].rich_help_panel == OUTPUT
                assert mark(parameter, Writes) or not is_output, (command, name)
    assert {command for command, _ in TABLE} == set(SIGNATURES) - {"register", "panel"}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current folder, in which a file has each name that an output may replace."""
    monkeypatch.chdir(tmp_path)
    for name in (*FILES, *(f"{made}/{each}" for made in ("made", "made_2") for each in IN_FOLDERS)):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(name)
    (tmp_path / "elsewhere").mkdir()
    return tmp_path


def typed_for(command: str, **given: object) -> dict[str, Any]:
    """What is typed where all switches are on, of which some name outputs."""
    parameters = SIGNATURES[command].parameters.values()
    switches = {each.name: True if "bool" in spelt(each) else None for each in parameters}
    return {**switches, **given}


def targets(command: str, output: str) -> list[tuple[Path, Path]]:
    """What is typed for an output, and each name in the folder that it replaces."""
    writes = mark(SIGNATURES[command].parameters[output], Writes)
    path = Path("made" if writes.own else "made.png")
    listed = list(writes.list_outputs(path, typed_for(command)))
    if not writes.own:
        return [(path, Path(name)) for name in FILES if Path(name) in listed]
    fit = [Path(name) for name in IN_FOLDERS if re.fullmatch(writes.own, Path(name).parts[0])]
    return [(path, made / name) for made in listed for name in fit]


def itself(target: Path) -> Path:
    return target


def by_a_pattern(target: Path) -> Path:
    return target.with_name(f"{target.name[:-1]}[{target.name[-1]}]")


SPELLINGS = (itself, by_a_pattern)
"""Links and other paths to a file are those of `test_a_file_is_replaced_under_each_of_its_names`."""


@pytest.mark.parametrize("spell", SPELLINGS)
@pytest.mark.parametrize(("command", "output"), TABLE)
def test_no_output_is_an_input(folder: Path, command: str, output: str, spell: Callable[[Path], Path]) -> None:
    signature = SIGNATURES[command]
    chosen = targets(command, output)
    assert chosen
    for path, target in chosen:
        given = spell(target)
        for name, parameter in signature.parameters.items():
            if mark(parameter, Writes) or not ("Path" in spelt(parameter) or "str" in spelt(parameter)):
                continue
            value = given if "Path" in spelt(parameter) else str(given)
            typed = typed_for(command, **{output: path, name: [value] if "list" in spelt(parameter) else value})
            with pytest.raises(InputError, match=r"^made.* one of the inputs; choose another (name|folder)$"):
                check_typed_outputs(signature, typed)
            check_typed_outputs(signature, typed | {output: Path("elsewhere", "new.png")})


@pytest.mark.parametrize(("command", "output"), TABLE)
def test_what_a_folder_holds_is_an_input(folder: Path, command: str, output: str) -> None:
    signature = SIGNATURES[command]
    for name, parameter in signature.parameters.items():
        for path, target in targets(command, output) if mark(parameter, Reads) else ():
            read = Path("elsewhere", "photograph.png")
            os.link(target, read)
            (Path("elsewhere") / "pairs.csv").write_text(
                f"{','.join(COLUMNS)}\na,b,photograph.png,photograph.png,1,0,0,0,1,0,0,0,1\n"
            )
            value = ["elsewhere"] if "list" in spelt(parameter) else Path("elsewhere")
            with pytest.raises(InputError, match="one of the inputs"):
                check_typed_outputs(signature, typed_for(command, **{output: path, name: value}))
            read.unlink()


@pytest.mark.parametrize(
    "words",
    [
        ("mosaic", "mosaic.jpg", "p1.jpg", "-o", "elsewhere.png", "--report", "."),
        ("mosaic", "mosaic.jpg", "p1.jpg", "-o", "m.png", "--mask", "m.png"),
        ("mosaic", ".", "-o", "p1.jpg"),
        ("live", ".", "-o", "p1.jpg"),
        ("live", ".", "-o", "grown.png"),
        ("track", "p1.jpg", "film.mp4", "-o", "film.mp4"),
        ("compare", "p1.jpg", "mosaic.jpg", "--waves", "waves.vcd"),
        ("export", "board", "pynq_z2", "--config", "made/config.toml", "-o", "made"),
        ("export", "fuzzy", "a.fll", "-o", "."),
        ("fuzzy", "a.fll", "--write", "a.fll"),
    ],
    ids=" ".join,
)
def test_the_command_line_refuses_in_one_line_and_writes_nothing(run: Run, tmp_path: Path, words: list[str]) -> None:
    for name in ("mosaic.jpg", "p1.jpg", "m.png", "grown.preview.jpg", "film.mp4", "made/config.toml", "a.fll"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(name)
    (tmp_path / "waves.vcd").hardlink_to(tmp_path / "p1.jpg")
    (tmp_path / "README.md").symlink_to("a.fll")
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    status, out, errors = run(*words, "--overwrite")
    assert (status, out) == (2, b"")
    assert "one of the inputs; choose another" in only_error(errors)
    assert len(errors.splitlines()) == 1
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before


def test_outputs_are_apart() -> None:
    mosaic, track = SIGNATURES["mosaic"], SIGNATURES["track"]
    for given, says in (
        ({"report": Path("x"), "tiles": Path("./x")}, "x: is both --tiles and --report; name two folders"),
        (
            {"output": Path("x/MOSAIC.jpg"), "report": Path("x")},
            "x/MOSAIC.jpg: would be replaced by a file of --report",
        ),
        ({"output": Path("m.png"), "save_camera": Path("./m.png")}, "m.png: is both --output and --save-camera; name"),
        ({"report": Path("x/7/r"), "tiles": Path("x")}, "x/7/r: would be replaced by a file of --tiles x; choose"),
    ):
        with pytest.raises(InputError, match=f"^{re.escape(says)}"):
            check_typed_outputs(mosaic, typed_for("mosaic", **given))
    check_typed_outputs(track, typed_for("track", output=Path("a.mp4"), corners=Path("a.csv")))
    check_typed_outputs(mosaic, typed_for("mosaic", output=Path("x/m.png"), report=Path("x"), tiles=Path("x/tiles")))
    check_typed_outputs(
        mosaic, typed_for("mosaic", output=Path("-"), report=Path("-"), camera="rtsp://a/b\0", mask="x" * 999)
    )


HOLDER = """
import sys
from pathlib import Path
from skymosaic.cli.outputs import claimed

with claimed([Path(name) for name in sys.argv[1:]]):
    print("claimed", flush=True)
    sys.stdin.read()
"""


@pytest.mark.parametrize(
    "words",
    [
        ("mosaic", "photographs", "-o", "out/made.png"),
        ("mosaic", "photographs", "-o", "other.png", "--tiles", "linked/tiles"),
        ("live", "broken.mp4", "-o", "made.mp4.png"),
    ],
    ids=" ".join,
)
def test_of_two_runs_with_one_output_the_second_is_refused(run: Run, tmp_path: Path, words: list[str]) -> None:
    for name in ("out", "photographs"):
        (tmp_path / name).mkdir()
    (tmp_path / "linked").symlink_to("out")
    (tmp_path / "broken.mp4").write_text("no video")
    (tmp_path / "out" / "made.png").write_text("the first one's")
    outputs = ("out/made.png", "out/tiles", "made.mp4.preview.jpg")
    # Claimed by another process, which may know the folder by another name.
    command = [sys.executable, "-c", HOLDER, *(str(tmp_path / output) for output in outputs)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as first:
        assert first.stdout
        assert first.stdout.readline() == "claimed\n"
        before = sorted(tmp_path.rglob("*"))
        status, out, errors = run(*words, "--overwrite")
        assert (status, out) == (2, b"")
        assert only_error(errors).endswith(
            ": is being written by another run; wait for its end, or choose another name"
        )
        assert len(errors.splitlines()) == 1
        assert sorted(tmp_path.rglob("*")) == before
        first.communicate()
    assert not list(tmp_path.rglob(".skymosaic-*"))
    # The next one gets further.
    assert "another run" not in run(*words, "--overwrite")[2]


def test_an_empty_folder_stays_empty_for_the_check_when_an_output_in_it_is_claimed(tmp_path: Path) -> None:
    with claimed([tmp_path / "m.png", Path("/"), tmp_path / "missing" / "m.png"]):
        assert len(list(tmp_path.iterdir())) == 2
        check_unused(tmp_path, overwrite=False)
        (tmp_path / "other").touch()
        with pytest.raises(InputError, match="is a folder with files in it"):
            check_unused(tmp_path, overwrite=False)
