"""`gppcs view` of a large COPC file, which is served to the browser until Ctrl-C."""

import os
import signal
import subprocess
import urllib.error
import urllib.request
from pathlib import Path

import numpy as np
import pytest

import gppcs
from command_line import COMMAND
from gppcs.drawing.web.layers import MOST_SHOWN
from web_page import WebPage

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals as on Unix")
BROWSER = """#!/bin/sh
(echo $1; ls -l ${1#file://}; cat ${1#file://}) >opened.part
mv opened.part opened
"""


@pytest.mark.slow
def test_a_large_file_is_served_until_ctrl_c(folder, kernels):
    points = np.random.default_rng(0).uniform(0, 100, (MOST_SHOWN + 1, 3))
    gppcs.write("large.copc.laz", gppcs.PointCloud(points), levels_by="order")
    Path("browser").write_text(BROWSER)
    Path("browser").chmod(0o700)
    before = set(Path().iterdir())
    command = [COMMAND, "view", "large.copc.laz"]
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    restored = {"preexec_fn": lambda: signal.signal(signal.SIGINT, signal.SIG_DFL)}
    with subprocess.Popen(command, **streams, **restored, env=os.environ | {"BROWSER": "./browser"}) as run:
        url = run.stdout.readline().strip()
        with urllib.request.urlopen(url, timeout=60) as answer:
            [cloud] = WebPage(answer.read().decode()).described["clouds"]
        with urllib.request.urlopen(f"{url}{cloud['octree']['inside']}", timeout=60) as answer:
            assert answer.status == 200
        run.send_signal(signal.SIGINT)
        _, err = run.communicate(timeout=60)
    assert cloud["points"] == MOST_SHOWN + 1
    assert run.returncode == 128 + signal.SIGINT
    assert "until Ctrl-C" in err
    assert err.endswith("gppcs: interrupted\n")
    address, listed, page = Path("opened").read_text().splitlines()
    assert address.startswith("file:///")
    assert listed.startswith("-rw-------")
    assert f"url={url}" in page
    assert not Path(address.removeprefix("file://")).exists()
    assert set(Path().iterdir()) - before == {Path("opened")}
    with pytest.raises(urllib.error.URLError):
        urllib.request.urlopen(url, timeout=60)
