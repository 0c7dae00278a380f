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

SMALL = ("--points", 60, "--method", "random")


@pytest.fixture
def piped(monkeypatch):
    """Put a file on standard input."""

    def pipe(path):
        class Stream:
            buffer = io.BufferedReader(io.BytesIO(Path(path).read_bytes()))

        monkeypatch.setattr(sys, "stdin", Stream)

    return pipe


def test_a_sample_goes_to_standard_output(printed, folder):
    words = ["sample", "fan", "--points", 30]
    out = printed(*words, "-o", "-", "--to", "csv", "--json")
    assert printed(*words, "-o", "fan.csv") == "fan.csv: 30 points\n"
    assert out == Path("fan.csv").read_text()
    assert files() == ["fan.csv"]


@pytest.mark.parametrize("words", [["view", "scan.ply"], ["report", "scan.ply", "scan.ply"], ["view", "-"]])
def test_pages_go_to_standard_output(gppcs_command, scan, piped, monkeypatch, words):
    monkeypatch.setattr("webbrowser.open", lambda page: pytest.fail(f"opens {page}"))
    piped("scan.ply")
    code, out, err = gppcs_command(*words, "-o", "-")
    assert (code, err, files()) == (0, "", ["scan.ply"])
    assert [each["name"] for each in WebPage(out).described["clouds"]] == words[1:]


def test_a_file_may_be_called_like_standard_output(printed, record, refused, scan, folder):
    """`./-` names it, as in other programs."""
    assert printed("sample", "fan", "-o", "./-", "--to", "ply", "--points", 30, "-q") == ""
    assert files() == ["-", "scan.ply"]
    assert record("info", "./-")["points"] == 30
    for command in (("convert", "./-", ".//-"), ("simplify", "./-", "-o", ".//-", *SMALL)):
        refused((*command, "--to", "csv", "--force"), "found an input")
    assert printed("simplify", "scan.ply", "-o", "././-", "--to", "csv", "--force", "-q", *SMALL) == ""
    assert len(gppcs.read("./-", "csv")) == 60
    gppcs.write("./-", gppcs.read("scan.ply"), "ply", force=True)
    assert len(gppcs.read("./-")) == 400


@pytest.mark.skipif(sys.platform == "win32", reason="no sh")
@pytest.mark.parametrize("closed", ["2>&-", ">&-", "2>&- >&-"])
def test_a_closed_stream_does_no_harm(folder, scan, closed):
    words = f'"{sys.executable}" -m gppcs simplify scan.ply -o out.ply --points 9 --method fps {closed}'
    assert subprocess.run(words, shell=True, check=False).returncode == 0
    assert len(gppcs.read("out.ply")) == 9


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


def test_a_deleted_working_directory_does_no_harm(folder, scan):
    (gone := folder / "gone").mkdir()
    words = ["simplify", folder / "scan.ply", "-o", folder / "out.ply", "--points", "9", "--method", "fps"]
    code = f"import os; os.rmdir({str(gone)!r}); from gppcs.app.cli import main; main()"
    found = subprocess.run([sys.executable, "-c", code, *map(str, words)], cwd=gone, check=False, capture_output=True)
    assert (found.returncode, found.stderr) == (0, b"")
    assert len(gppcs.read("out.ply")) == 9
