"""Files of servers in place of local ones."""

from pathlib import Path

import pytest

import gppcs
from gppcs.app import program

fsspec = pytest.importorskip("fsspec")
ADDRESS = "memory://a.ply"


@pytest.fixture
def run(scan, capsys):
    """Run the command in this process on the cloud at the address; return its exit code and all that it prints."""
    files = fsspec.filesystem("memory")
    files.pipe("/a.ply", Path("scan.ply").read_bytes())

    def run(*arguments):
        code = program.run(list(arguments))
        return code, "".join(capsys.readouterr())

    yield run
    files.rm("/a.ply")


def test_a_file_of_a_server_is_simplified_and_named_by_its_address(run):
    code, printed = run("simplify", ADDRESS, "-o", "out.ply", "--method", "random", "--points", "20")
    assert code == 0
    assert f"{ADDRESS} →" in printed
    assert len(gppcs.read("out.ply")) == 20
    code, printed = run("simplify", "memory://none.ply", "-o", "none.ply", "--points", "20")
    assert code == 2
    assert "memory://none.ply" in printed
    assert "memory:/n" not in printed


def test_a_report_shows_a_file_of_a_server(run):
    gppcs.write("few.ply", gppcs.read("scan.ply")[:50])
    code, printed = run("report", ADDRESS, "few.ply", "-o", "report.html")
    assert code == 0, printed
    assert Path("report.html").stat().st_size
