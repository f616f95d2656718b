"""Rules from a file decide in every command, or are refused in one line."""

import json
from pathlib import Path

import pytest

from bench.designs import largest_rules
from golden_model.fuzzy.rules import MatchRules, read_shipped
from sim.scene import make_pair
from tests.conftest import Run
from tests.made import write_pictures
from tests.system.command_line import only_error

AERIAL = read_shipped("aerial")
OWN = AERIAL.replace("Engine: aerial", "Engine: own").replace("likely Constant 0.6", "likely Constant 0.4")


@pytest.fixture(autouse=True)
def _files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    write_pictures(tmp_path, make_pair(seed=5, size=(320, 240)).images, ("left.png", "right.png"))
    Path("own.fll").write_text(OWN)
    Path("own.toml").write_text('[matcher]\nrule_base = "own.fll"\n')


def numbers(run: Run, *words: str) -> dict[str, object]:
    status, out, errors = run(*words, "--json")
    assert status == 0, errors
    found: dict[str, object] = json.loads(out)
    return found


def test_a_written_file_gives_the_same_registration(run: Run) -> None:
    assert run("fuzzy", "aerial", "--write", "aerial.fll")[0] == 0
    usual = numbers(run, "register", "left.png", "right.png")
    same = numbers(run, "register", "left.png", "right.png", "--rules", "aerial.fll")
    for key in usual.keys() - {"seconds", "written"}:
        assert same[key] == usual[key], key


def test_rules_decide_and_are_reported(run: Run) -> None:
    usual = numbers(run, "register", "left.png", "right.png")
    own = numbers(run, "register", "left.png", "right.png", "--rules", "own.fll")
    digest = f"{MatchRules(OWN).tables(128).digest:08x}"
    assert (own["rules"], own["rules_digest"]) == ("own", digest)
    assert own["rules_digest"] != usual["rules_digest"]
    assert 0 < own["kept"] < usual["kept"]  # type: ignore[operator]
    configured = numbers(run, "register", "left.png", "right.png", "--config", "own.toml")
    assert configured["homography"] == own["homography"]
    mosaic = numbers(run, "mosaic", "left.png", "right.png", "--rules", "own.fll", "-o", "m.png", "--report", "report")
    assert mosaic["rules_digest"] == digest
    report = json.loads(Path("report/report.json").read_text())
    assert report["rules_digest"] == digest
    assert report["configuration"]["matcher"]["rule_base"]["text"] == OWN


def test_an_export_refuses_bad_rules_and_writes_nothing(run: Run) -> None:
    Path("bad.fll").write_text(OWN.replace("range: 0 8", "range: 0 180"))
    status, _, errors = run("export", "board", "pynq_z2", "--rules", "bad.fll", "-o", "out")
    assert status == 2
    assert "bad.fll: line 17: the range of orientation is 0 to 180; it must be 0 to 8" in only_error(errors)
    assert not Path("out").exists()


@pytest.mark.slow
@pytest.mark.parametrize("rules", [MatchRules(OWN), largest_rules()], ids=lambda rules: rules.name)
def test_the_hardware_decides_as_the_golden_model(run: Run, rules: MatchRules) -> None:
    Path("own.fll").write_text(rules.text)
    found = numbers(run, "compare", "left.png", "right.png", "--rules", "own.fll")
    assert found["equal"]
    assert found["rules"] == rules.name
