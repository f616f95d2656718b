import os
import subprocess
import sys

from skymosaic import temporary


def test_left_overs_of_killed_processes_are_removed(tmp_path):
    machine = temporary_name(tmp_path).rsplit("-", 2)[0]
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    for name in (f"{machine}-{ended.pid}-x", f"{machine}-{os.getpid()}-y", f".skymosaic-elsewhere-{ended.pid}-z"):
        (tmp_path / name).touch()
    temporary.remove_left_overs.cache_clear()
    with temporary.temporary_file(tmp_path):
        pass
    assert sorted(path.name.rsplit("-")[-1] for path in tmp_path.iterdir()) == ["y", "z"]


def temporary_name(folder):
    with temporary.temporary_file(folder) as path:
        return path.name
