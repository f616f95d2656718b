"""The wheel, unpacked into an empty environment, works outside the clone."""

import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest

CLONE = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An environment that holds the wheel, and sees the third-party packages of this one but not the clone.

    A path named in a .pth file is added without reading the .pth files in it, so the editable install stays out.
    """
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation", "--wheel-dir"]
    subprocess.run([*build, str(folder), str(CLONE)], check=True)
    (wheel,) = folder.glob("skymosaic-*.whl")
    venv.create(folder / "environment", with_pip=False)
    (packages,) = (folder / "environment" / "lib").glob("python*/site-packages")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(packages)
    (packages / "third_party.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return folder / "environment"


def test_the_wheel_carries_every_package_with_its_types_and_the_data_of_the_export(environment: Path) -> None:
    (packages,) = (environment / "lib").glob("python*/site-packages")
    shipped = ["golden_model", "hdl", "sim", "skymosaic", "constraints"]
    listed = ["git", "ls-files", *shipped]
    tracked = subprocess.run(listed, cwd=CLONE, capture_output=True, text=True, check=True).stdout.split()
    assert [path for path in tracked if not (packages / path).is_file()] == []
    assert all((packages / package / "py.typed").is_file() for package in shipped[:-1])


def test_the_demo_runs_outside_the_clone(environment: Path, tmp_path: Path) -> None:
    python = str(environment / "bin" / "python")
    # Isolated (-I): a PYTHONPATH that names the clone would hide the wheel.
    where = subprocess.run(
        [python, "-I", "-c", "import skymosaic; print(skymosaic.__file__)"],
        cwd=tmp_path, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert str(environment) in where.stdout
    demo = subprocess.run(
        [python, "-I", "-m", "skymosaic", "demo", "-o", "out", "--backend", "golden"],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert demo.returncode == 0, demo.stderr
    assert (tmp_path / "out" / "mosaic.png").exists()
