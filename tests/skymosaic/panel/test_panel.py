"""Small modules of the panel: results, steps, folders, files of a session, options, and where it listens."""

import itertools
from pathlib import Path

import pytest

from skymosaic.common.errors import InputError
from skymosaic.panel.folders import Roots
from skymosaic.panel.options import OPTION_VALUES, SCALES, STRONGEST, Options, SliderScale, fault_of
from skymosaic.panel.server import _listen
from skymosaic.panel.session_files import SessionFiles
from skymosaic.panel.tasks.jobs import Steps
from tests.skymosaic.panel.visitor import noise_png


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    now = [100.0]
    monkeypatch.setattr("skymosaic.panel.tasks.jobs.time.monotonic", lambda: now[0])
    return now


def test_the_time_left_follows_the_pace_of_the_stage(clock: list[float]) -> None:
    followed = Steps()
    followed.follow("features", 0, 10)
    assert followed.seconds_left() is None
    clock[0] += 6
    # Not before the first of the steps is done.
    assert followed.seconds_left() is None
    followed.follow("features", 1, 10)
    assert followed.seconds_left() == pytest.approx(54)
    followed.follow("features", 3, 10)
    assert followed.share == pytest.approx(0.3)
    assert followed.seconds_left() == pytest.approx(14)
    followed.follow("pairs", 1, 4)
    clock[0] += 0.9
    followed.follow("pairs", 3, 4)
    assert followed.seconds_left() is None
    clock[0] += 4.1
    assert followed.seconds_left() == pytest.approx(2.5)
    followed.follow("writing", 0, 0)
    assert followed.share is None
    assert followed.seconds_left() is None


def test_the_panel_listens_on_this_machine_only_and_refuses_a_taken_port() -> None:
    with _listen(0) as listener:
        host, port = listener.getsockname()
        assert host == "127.0.0.1"
        with pytest.raises(InputError, match=rf"port {port}: cannot be used \(Address already in use\); choose"):
            _listen(port)


def test_only_files_count_and_only_pictures_are_found(tmp_path: Path) -> None:
    files = SessionFiles(tmp_path / "root")
    assert (files.size_bytes, files.find_picture("uploads", "a.png")) == (0, None)
    for folder, name in (("pictures/uploads", "a.png"), ("uploads", "a.jpg")):
        (files.folder(folder) / name).write_bytes(bytes(7))
    assert files.size_bytes == 14
    assert files.find_picture("uploads", "a.png") == tmp_path / "root" / "pictures/uploads/a.png"
    assert files.find_picture("../uploads", "a.jpg") is None


@pytest.fixture
def flights(tmp_path: Path) -> Path:
    """A root with a flight, beside a folder that is none of it."""
    for folder in ("root/flight", "root/.hidden", "outside", "root with more"):
        (tmp_path / folder).mkdir(parents=True)
    for folder in ("root/flight", "outside"):
        for number in (10, 2):
            (tmp_path / folder / f"DJI_{number}.png").write_bytes(noise_png(number))
    return tmp_path / "root"


def test_photographs_inside_are_listed_as_by_every_command(flights: Path) -> None:
    roots = Roots([flights])
    folder = roots.find_folder("flight")
    assert folder == roots.find_folder(str(flights / "flight" / ".." / "flight")) == flights / "flight"
    assert [path.name for path in roots.list_photographs(folder).pictures] == ["DJI_2.png", "DJI_10.png"]
    assert roots.list_folders(folder) == [flights]
    assert roots.list_folders(flights) == [flights / "flight"]


@pytest.mark.parametrize(
    "path",
    ["..", "flight/../../outside", "{top}/outside", "{top}/root with more", "/", "/etc", "/no such folder", "~root",
     "link", "link/../outside", "{top}/root/link", "\0", "flight\0", "x" * 5000, "loop", "~no such user/x"],
)  # fmt: skip
def test_no_path_leads_out(flights: Path, path: str) -> None:
    (flights / "link").symlink_to(flights.parent / "outside")
    (flights / "loop").symlink_to(flights / "loop")
    roots = Roots([flights])
    with pytest.raises(InputError) as refused:
        roots.find_folder(path.format(top=flights.parent))
    assert "\n" not in str(refused.value)
    assert flights / "link" not in roots.list_folders(flights)


def test_a_photograph_that_is_a_link_out_is_refused_by_name(flights: Path) -> None:
    roots = Roots([flights])
    (flights / "flight" / "inside.png").symlink_to("DJI_2.png")
    assert len(roots.list_photographs(flights / "flight").pictures) == 3
    (flights / "flight" / "secret.png").symlink_to(flights.parent / "outside" / "DJI_2.png")
    with pytest.raises(InputError, match=r"secret\.png: a link that leads out"):
        roots.list_photographs(flights / "flight")


def test_a_folder_without_pictures_says_what_to_do(flights: Path) -> None:
    roots = Roots([flights, flights.parent / "outside"])
    for folder, says in (
        (flights / ".hidden", "open another folder"),
        (flights, r"2 .* inside \(flight\): open one of them"),
    ):
        with pytest.raises(InputError, match=f"contains no pictures; {says}$"):
            roots.list_photographs(folder)
    # Each of the roots may be opened, a relative path is below the first.
    assert roots.find_folder(str(flights.parent / "outside")) == flights.parent / "outside"
    assert roots.find_folder("flight") == flights / "flight"


def test_links_lead_nowhere_else_and_refusals_tell_nothing(flights: Path) -> None:
    """The refusal is the same for a folder that exists and one that does not."""
    refusals = []
    for name in ("outside", "nowhere"):
        with pytest.raises(InputError) as refused:
            Roots([flights]).find_folder(str(flights.parent / name))
        refusals.append(str(refused.value).replace(f"/{name}", ""))
    assert refusals[0] == refusals[1]
    (flights.parent / "link").symlink_to(flights)
    assert Roots([flights.parent / "link"]).find_folder("flight") == flights / "flight"


@pytest.mark.parametrize(
    ("slider", "lowest", "second", "highest"),
    [
        (SCALES["harris"], (19, 2), 1024, (48, 1 << 24)),
        (SCALES["fast"], (1, 1), 2, (120, 120)),
        (STRONGEST, (14, 128), 181, (22, 2048)),
    ],
    ids=lambda value: value.title if isinstance(value, SliderScale) else "",
)
def test_a_slider_has_a_value_at_each_position(
    slider: SliderScale, lowest: tuple[int, int], second: int, highest: tuple[int, int]
) -> None:
    assert sorted(SCALES) == ["fast", "harris"]
    values = [*slider.values.items()]
    assert (values[0], values[1][1], values[-1]) == (lowest, second, highest)
    assert [position for position, _ in values] == [*range(lowest[0], highest[0] + 1)]
    assert [slider.position(value) for _, value in sorted(values, key=lambda each: each[1])] == [*slider.values]
    # A value between two positions is at the upper one, and one beyond all at the last.
    assert [slider.position(each) for each in (0, lowest[1] + 1, 1 << 30)] == [lowest[0], lowest[0] + 1, highest[0]]


def test_every_combination_of_options_resolves_or_is_refused_with_a_reason() -> None:
    lists = (OPTION_VALUES[name] for name in ("preset", "detector", "descriptor", "rules"))
    reasons = [_why_refused(*combination) for combination in itertools.product(*lists)]
    assert reasons.count("") > 200
    assert "another method" not in reasons
    assert not any("\n" in reason for reason in reasons)


def _why_refused(preset: str, detector: str, descriptor: str, rules: str) -> str:
    options = Options.of_preset(preset).changed("detector", detector).changed("descriptor", descriptor)
    try:
        method, _ = options.changed("rules", rules).choose_method()
    except InputError as error:
        return str(error)
    return "" if (method.detector, method.descriptor) == (detector, descriptor) else "another method"


def test_the_slider_sets_the_front_end_and_a_preset_resets_it() -> None:
    harris = Options.of_preset("aerial").changed("position", 20)
    assert harris.choose_method()[1].front_end.threshold == 1024
    strongest = harris.changed("detector", "sift").changed("position", 16)
    assert strongest.choose_method()[1].front_end.max_features == 256
    changed = Options.of_preset("aerial").changed("detector", "fast").changed("descriptor", "ilbp-256")
    assert changed.changed("preset", "thesis") == Options.of_preset("thesis")


def test_a_flight_and_a_backend_have_fewer_options() -> None:
    aerial = Options.of_preset("aerial")
    assert fault_of(aerial, 3) == fault_of(aerial.changed("detector", "fast"), 3) == ""
    for name, value in (("detector", "sift"), ("estimator", "magsac"), ("accept_poor", True)):
        changed = aerial.changed(name, value)
        assert fault_of(changed) == ""
        assert "keep only two photographs" in fault_of(changed, 3)
    # By the names that the page shows.
    assert fault_of(aerial.changed("estimator", "magsac"), 3).startswith("Estimator magsac: ")
    assert fault_of(aerial.changed("accept_poor", True), 3).startswith("Deliver a poor pair: ")
    simulated = Options.of_preset("aerial").changed("backend", "rtl")
    assert fault_of(simulated) == ""
    assert "computes only harris, fast" in fault_of(simulated.changed("detector", "orb"))
