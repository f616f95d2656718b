"""The library's options on the command line: each is there, in its group, and what is typed becomes the object."""

import re
from pathlib import Path
from typing import Any

import pytest
import typer
from typer.testing import CliRunner, Result

from golden_model.config import preset_config
from golden_model.config_file import load_config
from golden_model.fuzzy.rules import MatchRules, shipped_rules
from skymosaic.cli.live import live as live_command
from skymosaic.cli.options import complete_command
from skymosaic.cli.session import session
from skymosaic.common.errors import InputError
from skymosaic.common.options import GROUPS, command_words, options_of
from skymosaic.mosaicking.options import MosaicOptions
from skymosaic.registration.options import PhotographOptions

read: list[PhotographOptions] = []


def everything(*, options: MosaicOptions) -> None:
    """A command with all options."""
    read.append(options)


def some(*, options: PhotographOptions = PhotographOptions(backend="rtl")) -> None:
    """A command with few options, one of which has another default."""
    read.append(options)


app = typer.Typer()
for command in (everything, some):
    app.command()(complete_command(command.__name__, command, {}))


def run(*words: object) -> Result:
    return CliRunner(env={"COLUMNS": "200"}).invoke(app, [str(word) for word in words])


def typed(*words: object) -> PhotographOptions:
    result = run(*words)
    assert result.exit_code == 0, result.output
    return read.pop()


def test_the_help_has_every_option_in_its_group_as_it_is_typed() -> None:
    shown = run("everything", "--help").output
    groups = [group for group in GROUPS if any(each.group == group for each in options_of(MosaicOptions))]
    headings = [shown.index(f"─ {group} ─") for group in groups]
    assert headings == sorted(headings)
    for each in options_of(MosaicOptions):
        begin = shown.index(f"─ {each.group} ─")
        panel = shown[begin : shown.index("╰", begin)]
        for flag in each.flags.split(" or "):
            assert f"{flag} " in panel
    assert re.search(r"--memory +MEGABYTES", shown)
    assert re.search(r"--canvas-limit +MEGAPIXELS", shown)
    assert "bytes, on the command line" not in shown
    assert "instead of --scale;" in shown
    live = typer.Typer()
    live.command()(complete_command("live", live_command, {}))
    assert re.search(r"--estimator +prosac\|fabric ", CliRunner(env={"COLUMNS": "200"}).invoke(live, "--help").output)


def test_a_command_has_the_options_of_its_class() -> None:
    assert typed("some") == PhotographOptions(backend="rtl")
    assert typed("some", "--preset", "thesis") == PhotographOptions(preset="thesis", backend="rtl")
    assert run("some", "--detector", "fast").exit_code == 2


def test_what_is_typed_becomes_the_object(tmp_path: Path) -> None:
    (tmp_path / "c.toml").write_text("[front_end]\nthreshold = 7\n")
    words = ("--blending", "average", "--memory", 100, "--canvas-limit", 3, "--gsd", 0.5, "--working-width", 640)
    options = typed("everything", *words, "--config", tmp_path / "c.toml", "--accept-poor", "--cache", tmp_path)
    assert isinstance(options, MosaicOptions)
    assert (options.blending, options.memory_bytes, options.canvas_limit_px) == ("average", 100 << 20, 3_000_000)
    assert (options.gsd_m, options.working_width_px, options.accept_poor, options.cache) == (0.5, 640, True, tmp_path)
    assert options.base_config.front_end.threshold == 7
    defaults = typed("everything")
    assert isinstance(defaults, MosaicOptions)
    assert all(getattr(defaults, each.name) == each.default for each in options_of(MosaicOptions))
    assert defaults.base_config == preset_config("aerial")


def test_the_words_for_options_are_read_as_these_options(tmp_path: Path) -> None:
    rules = shipped_rules("ilbp")
    files = {"config": tmp_path / "c.toml", "rules": tmp_path / "r.fll"}
    files["config"].write_text("[front_end]\nthreshold = 7\n")
    files["rules"].write_text(rules.text)
    options = MosaicOptions(
        config=load_config(files["config"], "thesis"),
        rules=MatchRules(rules.text),
        preset="thesis",
        blending="average",
        accept_poor=True,
        scale=0.3,
        memory_bytes=100 << 20,
        canvas_limit_px=3_000_000,
        cache=tmp_path,
        backend="board",
        address="192.0.2.7:5000",
    )
    words = command_words(options, {name: str(file) for name, file in files.items()})
    assert typed("everything", *words) == options
    assert command_words(MosaicOptions()) == []


def talk() -> None:
    """A command that prints each kind of line."""
    session.tell("progress")
    session.warn("something odd")
    session.show("result")


@pytest.mark.parametrize(
    ("before", "behind", "told"),
    [
        ({}, {}, ["progress", "warning: something odd"]),
        ({"quiet": True}, {}, ["warning: something odd"]),
        ({"quiet": False}, {"quiet": True}, ["warning: something odd"]),
        ({"verbose": True}, {}, ["skymosaic", "progress", "warning: something odd"]),
        ({"verbose": False}, {"verbose": True}, ["skymosaic", "progress", "warning: something odd"]),
    ],
)
def test_common_options_may_stand_before_the_command(
    before: dict[str, bool], behind: dict[str, bool], told: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    run = complete_command("talk", talk, before)
    run(**{"as_json": False, "quiet": False, "verbose": False, **behind})
    printed = capsys.readouterr()
    assert printed.out == "result\n"
    # The first line of details also has versions.
    assert [line if "Python" not in line else line.split()[0] for line in printed.err.splitlines()] == told


@pytest.mark.parametrize(
    ("missing", "says"),
    [
        ("nicegui", "talk needs nicegui; .*panel"),
        ("amaranth", "talk needs amaranth; .*hardware"),
        ("matplotlib", "talk needs matplotlib; .*plots"),
        ("numpy", None),
        (None, None),
    ],
)
def test_a_package_that_few_commands_need_is_named_with_its_remedy(missing: str | None, says: str | None) -> None:
    def command() -> None:
        raise ModuleNotFoundError("no module", name=missing)

    run: Any = complete_command("talk", command, {})
    with pytest.raises(InputError if says else ModuleNotFoundError, match=says):
        run(as_json=False, quiet=False, verbose=False)
