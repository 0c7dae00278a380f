"""Files of servers in place of local ones."""

from pathlib import Path

import pytest

import gppcs

fsspec = pytest.importorskip("fsspec")
ADDRESS = "memory://a.ply"


def test_a_file_of_a_server_is_named_by_its_address(printed, refused, scan):
    fsspec.filesystem("memory").pipe("/a.ply", Path("scan.ply").read_bytes())
    assert f"{ADDRESS} →" in printed("simplify", ADDRESS, "-o", "few.ply", "--method", "random", "--points", "20")
    assert len(gppcs.read("few.ply")) == 20
    assert printed("report", ADDRESS, "few.ply", "-o", "report.html").startswith("report.html: ")
    refused(("simplify", "memory://none.ply", "-o", "none.ply", "--points", "20"), "gppcs: memory://none.ply")
