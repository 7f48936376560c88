"""What all tests share."""

from __future__ import annotations

import os
import shutil
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

# Where the user has no nuXmv, the NuSMV executable of pynusmv's build stands in for it: the same text and commands.
NUSMV = Path(sys.executable).with_name("NuSMV")
if NUSMV.exists() and not (shutil.which("nuXmv") or shutil.which("nuxmv")):
    os.environ.setdefault("SMV_PLANNER_NUXMV", str(NUSMV))


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--rewrite", action="store_true", help="write the golden texts anew instead of comparing")


@pytest.fixture
def interruptible() -> Iterator[None]:
    """Processes started in this test take note of an interrupt, even where the tests themselves run in the background."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture
def golden(request: pytest.FixtureRequest) -> Callable[[Path, str], None]:
    """Compares a text with the one kept in a file."""

    def compare(path: Path, text: str) -> None:
        if request.config.getoption("--rewrite"):
            path.write_text(text, encoding="utf-8", newline="\n")
        assert text == path.read_text(encoding="utf-8"), f"{path.name} changed; if you can say why, run pytest --rewrite"

    return compare


@pytest.hookimpl(wrapper=True)
def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> Iterator[None]:
    """Prints what tests have to report: how many generated questions of which kind were asked."""
    reports = [report for found in terminalreporter.stats.values() for report in found if hasattr(report, "user_properties")]
    for name, value in dict.fromkeys(pair for report in reports for pair in report.user_properties):
        terminalreporter.write_line(f"{name}: {value}")
    return (yield)
