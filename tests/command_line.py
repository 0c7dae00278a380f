"""Constants and checks that the tests of the command share."""

import sys
from pathlib import Path

from web_page import WebPage

COMMAND = Path(sys.executable).with_name("gppcs")
FAST = ("--method", "fps")  # for tests in which the method makes no difference
SIMPLIFY = ("simplify", "scan.ply", "-o", "out.ply", *FAST, "--points")


def files():
    """Return the names in the folder of the test."""
    return sorted(path.name for path in Path().iterdir())


def rows_of(printed):
    """Return the lines that a command prints, with single spaces."""
    return [" ".join(line.split()) for line in printed.splitlines()]


def described(page):
    """Return what a page in a file shows."""
    return WebPage(Path(page).read_text("utf-8")).described


def assert_one_line(result, *parts):
    """Check that a command failed with one line on stderr that contains all parts, and options for arguments."""
    code, out, err = result
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert err.startswith("gppcs: ")
    assert err.endswith("\n")
    assert not any(argument in err for argument in ("`", "n_points", "n_faces", "max_gap", "=True"))
    for part in parts:
        assert part in err
