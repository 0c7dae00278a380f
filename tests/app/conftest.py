"""Fixtures of the tests of the command."""

import json
from functools import cache
from pathlib import Path

import pytest
import typer.main

import gppcs
from command_line import assert_one_line
from gppcs.app import program
from gppcs.engine import timer


@pytest.fixture(scope="session")
def kernels():
    """Compile the kernels, so that the command does not print the notice of a first run."""
    cloud = gppcs.sample("bracket", 5000)  # more than there are landmarks
    for method in gppcs.METHODS.built_in:
        gppcs.evaluate(cloud, gppcs.simplify(cloud, ratio=0.1, method=method).cloud)
    gppcs.info(cloud)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Run the test in an empty folder of its own."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def scan(folder):
    """The cloud in the file scan.ply."""
    cloud = gppcs.sample("bracket", 400)
    gppcs.write("scan.ply", cloud)
    return cloud


@pytest.fixture(scope="session")
def parser():
    """Build the parser of the command line once, not for each run."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(typer.main, "get_command", cache(typer.main.get_command))
        yield


@pytest.fixture
def gppcs_command(kernels, parser, folder, capsys):
    """Run the command in this process; return its exit code, stdout and stderr, less the notice of a first run."""

    def run(*arguments):
        code = program.run(list(map(str, arguments)))
        out, err = capsys.readouterr()
        return code, out, err.replace(f"gppcs: {timer.NOTICE}\n", "")

    return run


@pytest.fixture
def printed(gppcs_command):
    """Run the command, check that it works without a word on stderr, and return what it prints."""

    def run(*arguments):
        code, out, err = gppcs_command(*arguments)
        notes = [line for line in err.splitlines() if not line.startswith("progress: ")]  # on a slow machine
        assert (code, notes) == (0, []), arguments
        return out

    return run


@pytest.fixture
def record(printed):
    """Run the command with --json, and return the object that it prints."""
    return lambda *arguments: json.loads(printed(*arguments, "--json"), parse_constant=pytest.fail)


@pytest.fixture
def refused(gppcs_command):
    """Run the command, and check that it fails with one line that has all parts, and leaves all files as they are."""

    def contents():
        return {path: path.is_file() and path.read_bytes() for path in Path().rglob("*")}

    def run(arguments, *parts):
        before = contents()
        assert_one_line(gppcs_command(*arguments), *parts)
        assert contents() == before

    return run
