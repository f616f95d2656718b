"""What small commands print and how they end; the session, progress and times of all."""

import io
import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from rich.table import Table

from sim.backends.errors import BackendError
from sim.backends.interface import Mismatch
from sim.simulators.scoreboard import Coverage
from skymosaic import cli
from skymosaic.cli import compare, demo, progress
from skymosaic.cli.session import PIPED_WIDTH, Session, Terminal, session
from skymosaic.cli.track import _show_summary, _template_and_video
from skymosaic.common.errors import InputError, RegistrationError
from skymosaic.evaluation.hardware import Comparison
from skymosaic.registration.options import BackendOptions
from skymosaic.tracking.output import TrackedCorners
from skymosaic.tracking.template import Roi
from tests.conftest import Run


def test_a_closed_pipe_has_the_status_of_sigpipe(monkeypatch: pytest.MonkeyPatch) -> None:
    abandoned: list[bool] = []
    monkeypatch.setattr(cli, "abandon_output", lambda: abandoned.append(True))
    by_click = SystemExit(1)
    by_click.__context__ = BrokenPipeError()
    ends = (SystemExit(3), KeyboardInterrupt(), BrokenPipeError(), by_click)
    assert [cli._status_of(end) for end in ends] == [3, 130, 141, 141]
    assert len(abandoned) == 2


NAME = "photographs of the southern field/DJI_20260412_0001.JPG"


def named() -> Table:
    table = Table("photograph", "reason")
    table.add_row(NAME, "too few features, because nearly all of it is water")
    return table


def test_a_table_keeps_to_a_terminal_has_whole_rows_in_a_pipe_and_names_as_they_are(
    capsys: pytest.CaptureFixture[str],
) -> None:
    Terminal(width=60).show(named())
    printed = capsys.readouterr().out
    assert NAME in printed
    assert max(map(len, printed.splitlines())) < PIPED_WIDTH / 5
    shown = io.StringIO()
    Terminal(file=shown, force_terminal=True, color_system=None, width=60).show(named())
    assert "photographs" in shown.getvalue()
    assert max(map(len, shown.getvalue().splitlines())) <= 60
    terminal = Terminal(width=20)
    terminal.show(f"[bold]{NAME}[/bold]\n2")
    terminal.print_line(f"[red]{NAME}")
    assert capsys.readouterr().out.splitlines() == [f"[bold]{NAME}[/bold]\\n2", f"[red]{NAME}"]


def begun(*, quiet: bool = False, verbose: bool = False, as_json: bool = False, command: str = "mosaic") -> Session:
    session = Session()
    session.begin(command, started_s=0.0, quiet=quiet, verbose=verbose, as_json=as_json)
    return session


def test_the_object_has_what_was_told(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    session = begun(as_json=True)
    session.note("note: add `all_groups`")
    session.warn("`scale` is\nlarge")
    session.wrote(tmp_path)
    session.stream({"frame": 1, "error_px": float("nan")})
    session.show("a result")
    session.numbers = {"notes": ["turned"], "size": [3, 4]}
    with session.working("drawing") as step:
        step("half of it")
    session.end(2, "no `gsd_m`")
    first, last = map(json.loads, (printed := capsys.readouterr()).out.splitlines())
    assert first == {"frame": 1, "error_px": None}
    expected: dict[str, Any] = {
        "command": "mosaic", "status": 2, "error": "no --gsd", "warnings": ["--scale is\\nlarge"],
        "outputs": [str(tmp_path)], "notes": ["note: add --all-groups", "turned"], "size": [3, 4],
    }  # fmt: skip
    assert {key: last[key] for key in expected} == expected
    lines = ["note: add --all-groups", "warning: --scale is\\nlarge", "drawing", "half of it"]
    assert printed.err.splitlines() == lines


def test_standard_output_takes_one_thing(capfdbinary: pytest.CaptureFixture[bytes]) -> None:
    with pytest.raises(InputError, match="-o - and --json both write to standard output"):
        begun(as_json=True).destination(Path("-"), "m.png").__enter__()
    session = begun()
    with session.destination(Path("-"), "m.png") as path:
        path.write_bytes(b"a mosaic")
    session.show("wrote it")
    assert capfdbinary.readouterr() == (b"a mosaic", b"wrote it\n")
    with begun(as_json=True).destination(Path("m.png"), "other.png") as path:
        assert path == Path("m.png")


def test_beside_a_terminal_a_stage_is_a_line_at_its_begin_now_and_then_and_at_its_end(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now_s, told = [100.0], list[str]()
    monkeypatch.setattr(progress, "time", SimpleNamespace(monotonic=lambda: now_s[0]))
    show = progress.print_stages(told.append)
    for done in range(26):
        show("features", done, 25)
        now_s[0] += 1
    show("lens", 0, 0)
    show("links", 0, 25)
    assert told == ["features 0/25", "features 10/25", "features 20/25", "features 25/25", "lens", "links 0/25"]


COMPARED = Comparison(
    None, Coverage(2, (900, 100), 16, 300), (308_200, 308_700), 0.5, 0.08, (640, 480), (), (), {"rules": "aerial"}
)


def compare_with(found: Comparison | Exception, monkeypatch: pytest.MonkeyPatch) -> None:
    def compare(*_: object, **__: object) -> Comparison:
        if isinstance(found, Exception):
            raise found
        return found

    monkeypatch.setattr(demo, "compare", compare)
    demo._compare_hardware((Path("left.png"), Path("right.png")), BackendOptions(backend="rtl"))


def test_a_comparison_tells_clocks_and_fails_by_a_difference_alone(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    compare_with(COMPARED, monkeypatch)
    told = capsys.readouterr().out
    assert f"equal to the golden model bit for bit: {COMPARED.coverage}" in told
    assert "308200 clocks per frame, 1.23 M per second" in told
    assert session.numbers["hardware"]["equal"]
    assert 0 <= session.seconds["hardware"] < 60
    compare_with(BackendError("g++ is not installed"), monkeypatch)
    assert "hardware not simulated: g++ is not installed" in capsys.readouterr().err
    with pytest.raises(RegistrationError, match="differ: frame 1, half, level 1, x 3, y 4: expected 10, got 11"):
        compare_with(replace(COMPARED, mismatch=Mismatch(1, "half, level 1", 3, 4, 10, 11)), monkeypatch)


def test_a_difference_is_told_and_ends_with_status_1(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    different = replace(COMPARED, mismatch=Mismatch(0, "matches", None, None, 3, 2), notes=("there is no corner",))
    for found, verdict, ends_with in ((different, f"NOT EQUAL: {different.mismatch}", 1), (COMPARED, "equal", 0)):
        monkeypatch.setattr(compare, "compare_pair", lambda *_, result=found, **__: result)
        status, printed, errors = run("compare", "left.png", "right.png")
        assert status == ends_with
        assert printed.decode().splitlines()[:4] == [
            verdict,
            f"compared {found.coverage}",
            "cycles per frame 308200, 308700",
            "1.23 M cycles/s simulated",
        ]
        assert ("proves little: there is no corner" in errors) == bool(found.notes)


A, B = Path("a.png"), Path("b.mp4")


def test_the_object_is_a_picture_or_a_rectangle() -> None:
    assert _template_and_video([A, B], None) == (A, B)
    assert _template_and_video([B], "1,2,30,40") == (Roi(1, 2, 30, 40), B)
    for inputs, roi, fault in (
        ([B], None, "track takes TEMPLATE and VIDEO, or VIDEO and --roi"),
        ([A, B, B], None, "track takes TEMPLATE and VIDEO, or VIDEO and --roi"),
        ([A, B], "1,2,30,40", "with --roi, track takes the VIDEO alone"),
        ([B], "1,2,30", "--roi is '1,2,30'; give four whole numbers, x,y,width,height"),
        ([B], "1,2,30,4.5", "--roi is '1,2,30,4.5'; give four whole numbers, x,y,width,height"),
    ):
        with pytest.raises(InputError, match=f"^{fault}$"):
            _template_and_video(inputs, roi)


def test_the_summary_counts_and_says_where_the_object_was_lost(capsys: pytest.CaptureFixture[str]) -> None:
    corners = ((0.0, 0.0),) * 4
    reasons = ["", "hidden", "blurred", "", "", "left", ""]
    rows = [TrackedCorners(at, 0.1, None if why else corners, "", 0, why) for at, why in enumerate(reasons)]
    _show_summary(rows, 0.0126)
    assert capsys.readouterr().out.splitlines() == [
        "found in 4 of 7 frames, 13 ms per frame",
        "frames 1 to 2: blurred",
        "frames 5 to 5: left",
    ]
