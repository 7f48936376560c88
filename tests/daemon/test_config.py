"""Where settings come from, and that a mistake in any of them is told."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from smv_planner.daemon.config import SETTINGS, resolved
from smv_planner.errors import UsageError

FILE = 'cell = "of_the_file"\ndeadline = 7\nconnect = ["tcp/127.0.0.1:1", "tcp/127.0.0.1:2"]\ninsecure_lan = true\n'


def found(
    folder: Path, flags: dict[str, Any] | None = None, environment: dict[str, str] | None = None, text: str = FILE
) -> dict[str, tuple[Any, str]]:
    file = folder / "settings.toml"
    file.write_text(text)
    config = resolved(flags or {}, environment or {}, str(file), {"cell": "of_the_scenario"}, "/state")
    return {name: (one.value, one.origin.split()[0]) for name, one in config.items()}


def test_flags_come_before_the_environment_before_the_file_before_the_scenario_before_defaults(tmp_path: Path) -> None:
    flags, environment = {"cell": "of_the_flag"}, {"SMV_PLANNER_CELL": "of_the_environment"}
    assert found(tmp_path, flags, environment)["cell"] == ("of_the_flag", "flag")
    assert found(tmp_path, {}, environment)["cell"] == ("of_the_environment", "environment")
    assert found(tmp_path)["cell"] == ("of_the_file", "file")
    assert found(tmp_path, text="")["cell"] == ("of_the_scenario", "scenario")
    assert found(tmp_path)["engine"] == ("auto", "default")


def test_the_same_word_means_the_same_wherever_it_stands(tmp_path: Path) -> None:
    environment = {
        "SMV_PLANNER_CONNECT": "tcp/127.0.0.1:1,tcp/127.0.0.1:2",
        "SMV_PLANNER_DEADLINE": "7",
        "SMV_PLANNER_INSECURE_LAN": "true",
    }
    written, said = found(tmp_path), found(tmp_path, {}, environment, text="")
    for name in ("connect", "deadline", "insecure_lan"):
        assert written[name][0] == said[name][0] != SETTINGS[name].default


def test_the_journal_is_kept_by_cell_where_programs_keep_their_state(tmp_path: Path) -> None:
    assert found(tmp_path)["journal"] == ("/state/smv_planner/of_the_file", "default")


def test_every_mistake_is_told_with_its_origin(tmp_path: Path) -> None:
    text = 'dedline = 3\nmetrics = "many"\ninsecure_lan = 3\n'
    with pytest.raises(UsageError) as raised:
        found(tmp_path, {"deadline": "soon"}, {"SMV_PLANNER_JURNAL": "x", "SMV_PLANNER_NUXMV": "/usr/bin/nuxmv"}, text)
    told = str(raised.value)
    for part in (
        "'dedline'",
        "deadline",
        "flag --deadline",
        "'metrics' cannot be 'many'",
        "'insecure_lan'",
        "SMV_PLANNER_JURNAL",
    ):
        assert part in told
    assert "NUXMV" not in told
    assert len(raised.value.mistakes) == 5


@pytest.mark.parametrize("text", ["cell = ", "\x00", "[[["])
def test_a_file_that_is_no_toml_is_told(tmp_path: Path, text: str) -> None:
    with pytest.raises(UsageError, match="cannot read settings"):
        found(tmp_path, text=text)
