"""The name `-` of standard input and standard output, in all commands."""

import io
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import gppcs
from command_line import files
from web_page import WebPage


@pytest.fixture
def piped(monkeypatch):
    """Put a file on standard input."""

    def pipe(path):
        class Stream:
            buffer = io.BufferedReader(io.BytesIO(Path(path).read_bytes()))

        monkeypatch.setattr(sys, "stdin", Stream)

    return pipe


def test_convert_is_a_filter(printed, piped):
    Path("table").write_text("# x y z label\n0.5 1 2 7\n")
    piped("table")
    assert printed("convert", "-", "-", "--from", "xyz", "--to", "csv") == "x,y,z,label\n0.5,1.0,2.0,7\n"


def test_simplify_is_a_filter(printed, scan, piped):
    words = ["--to", "csv", "--points", 20, "--method", "random", "-q"]
    piped("scan.ply")
    out = printed("simplify", "-", "-o", "-", *words)
    printed("simplify", "scan.ply", "-o", "few.csv", *words)
    assert out == Path("few.csv").read_text()


def test_a_sample_goes_to_standard_output(printed, folder):
    words = ["sample", "fan", "--points", 30]
    out = printed(*words, "-o", "-", "--to", "csv", "--json")
    assert printed(*words, "-o", "fan.csv") == "fan.csv: 30 points\n"
    assert out == Path("fan.csv").read_text()
    assert files() == ["fan.csv"]


@pytest.mark.parametrize("words", [["view", "scan.ply"], ["report", "scan.ply", "scan.ply"], ["view", "-"]])
def test_pages_go_to_standard_output(printed, scan, piped, monkeypatch, words):
    monkeypatch.setattr("webbrowser.open", lambda page: pytest.fail(f"opens {page}"))
    piped("scan.ply")
    out = printed(*words, "-o", "-")
    assert files() == ["scan.ply"]
    assert [each["name"] for each in WebPage(out).described["clouds"]] == words[1:]


@pytest.mark.skipif(sys.platform == "win32", reason="no sh")
def test_closed_streams_do_no_harm(folder, scan):
    words = f'"{sys.executable}" -m gppcs simplify scan.ply -o out.ply --points 9 --method fps 2>&- >&-'
    assert subprocess.run(words, shell=True, check=False).returncode == 0
    assert len(gppcs.read("out.ply")) == 9


@pytest.mark.skipif(sys.platform == "win32", reason="no sh")
@pytest.mark.parametrize(
    "words",
    ["info scan.ply", "convert scan.ply - --to ply", "methods", "simplify scan.ply -o out.ply --points 9 --dry-run"],
)
def test_results_that_nobody_gets_are_an_error(folder, scan, words):
    run = subprocess.run(
        f'"{sys.executable}" -m gppcs {words} >&-', shell=True, check=False, capture_output=True, text=True
    )
    assert run.returncode != 0
    assert "found that it is closed" in run.stderr


@pytest.mark.parametrize(
    "command", [("info",), ("simplify", "-o", "out.ply", "--points", 5, "--method", "fps", "--force")]
)
def test_text_from_files_does_not_control_the_terminal(gppcs_command, folder, command):
    names = ["red \x1b[31m", "reversed \u202e", "[bold]x[/bold]"]
    cloud = gppcs.PointCloud(np.random.default_rng(0).random((50, 3)), {name: np.arange(50) for name in names})
    gppcs.write("evil \x1b]0;title\x07.npz", cloud)
    for more in ((), ("--only", "none_such > 1")):
        _, *streams = gppcs_command(command[0], "evil \x1b]0;title\x07.npz", *command[1:], *more)
        printed = "".join(streams)
        assert r"evil \x1b]0;title\x07.npz" in printed
        assert not set(printed) & set("\x1b\x07\u202e")
        if more or command[0] == "info":
            assert r"red \x1b[31m" in printed
            assert r"reversed \u202e" in printed
            assert "[bold]x[/bold]" in printed
