"""The demonstration comes to its end and leaves nothing behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).parents[2]


def started(*words: str, folder: Path = ROOT) -> subprocess.Popen[str]:
    station = str(ROOT / "scenarios/assembly_station")
    command = [sys.executable, "-P", "-m", "smv_planner", "demo", station, "--case", "e7", *words]
    return subprocess.Popen(
        command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True
    )


def of_session(session: int) -> list[str]:
    """The processes of a session that are still there."""
    found = []
    for each in Path("/proc").glob("[0-9]*/stat"):
        try:
            _, _, rest = each.read_text().rpartition(") ")
        except OSError:
            continue
        state, _, _, its = rest.split()[:4]
        if int(its) == session and state != "Z":
            found.append(each.parent.name)
    return found


def nothing_is_left(session: int) -> bool:
    ends = time.monotonic() + 30
    while of_session(session) and time.monotonic() < ends:
        time.sleep(0.05)
    return not of_session(session)


def test_a_robot_dies_and_the_bolts_are_tightened() -> None:
    demo = started("--pace", "12")
    told, _ = demo.communicate()
    assert demo.returncode == 0, told
    assert "what the case tells happens now" in told
    assert "lost       'r2'" in told
    assert "Remove the nutrunner from r2 by hand" in told
    assert "TP w/MT" in told.splitlines()[-1]
    assert nothing_is_left(demo.pid)


def test_interrupted_it_leaves_nothing_behind() -> None:
    demo = started()
    assert demo.stdout
    for line in demo.stdout:
        if "executing" in line:
            break
    assert len(of_session(demo.pid)) > 4
    os.killpg(demo.pid, signal.SIGINT)  # as a terminal does
    told = demo.communicate()[0]
    assert demo.returncode == 130, told
    assert nothing_is_left(demo.pid)


def test_killed_it_leaves_nothing_behind_and_nothing_of_the_folder_is_run(tmp_path: Path) -> None:
    (tmp_path / "smv_planner.py").write_text("raise SystemExit('this is not the planner')\n")
    demo = started(folder=tmp_path)
    assert demo.stdout
    with demo.stdout:
        for line in demo.stdout:
            if "executing" in line:
                break
        assert len(of_session(demo.pid)) > 4
        demo.kill()
        demo.wait()
    assert nothing_is_left(demo.pid)
