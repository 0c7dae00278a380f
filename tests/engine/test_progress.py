"""The progress bar in a terminal, and lines for other programs."""

import os
import pty
import subprocess
import sys

import pytest

from gppcs.engine import progress
from gppcs.engine.timer import Timer


def in_terminal(code, term="xterm"):
    """Return what Python code prints to stderr where that is a terminal, and its exit code."""
    master, slave = pty.openpty()
    environment = os.environ | {"TERM": term}
    with subprocess.Popen([sys.executable, "-c", code], stderr=slave, env=environment) as run:
        os.close(slave)
        shown = b""
        try:
            while part := os.read(master, 4096):
                shown += part
        except OSError:  # how Linux says that the other end is closed
            pass
        os.close(master)
    return shown.decode(), run.returncode


STAGE = """
import time
from gppcs.engine import progress
from gppcs.engine.timer import Timer
progress.PATIENCE = 0.2
with Timer(progress.ProgressBar())("slow stage", 4) as on_progress:
    for _ in range(4):
        time.sleep({seconds})
        on_progress(1)
    {end}
"""


SHOW_CURSOR, ERASE_LINE = "\x1b[?25h", "\x1b[2K"


@pytest.mark.parametrize("expected", [0, 7])
def test_a_bar_shows_for_a_slow_stage_and_goes_away_even_if_it_fails(expected):
    shown, code = in_terminal(STAGE.format(seconds=0.2, end=f"raise SystemExit({expected})"))
    assert code == expected
    assert "slow stage" in shown
    assert shown.rindex(ERASE_LINE) > shown.rindex("slow stage")
    assert SHOW_CURSOR in shown


@pytest.mark.parametrize(("seconds", "term"), [(0, "xterm"), (0.2, "dumb")])
def test_no_bar_for_quick_stages_and_plain_terminals(seconds, term):
    assert in_terminal(STAGE.format(seconds=seconds, end="pass"), term) == ("", 0)


def test_lines_for_programs_name_each_stage_and_each_percent_once(capsys):
    timer = Timer(progress.ProgressLines())
    with timer("choice", 1_000) as on_progress:
        for _ in range(10):
            on_progress(25)
        for _ in range(30):
            on_progress(1)
    with timer("writing"):
        pass
    percents = [2, 5, 7, 10, 12, 15, 17, 20, 22, 25, 26, 27, 28]
    expected = ["progress: choice", *(f"progress: choice {percent} %" for percent in percents), "progress: writing"]
    assert capsys.readouterr().err.splitlines() == expected
