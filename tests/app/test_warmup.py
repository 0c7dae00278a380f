"""`gppcs warmup`."""

import json
import re
from pathlib import Path

import pytest

import gppcs


@pytest.mark.slow
def test_warmup_says_how_many_kernels_it_compiled_and_where_they_are(gppcs_command):
    code, out, err = gppcs_command("warmup")
    assert (code, err) == (0, "")
    told = re.fullmatch(r"kernels compiled: \d+, in \d+\.\d s; all are kept in (.*)\n", out)
    code, out, err = gppcs_command("warmup", "--json")
    record = json.loads(out)
    assert (code, err) == (0, "")
    assert record.pop("seconds") > 0
    assert record == {"compiled": 0, "folders": told[1].split(", "), "version": gppcs.__version__}  # not a second time
    assert all(list(Path(folder).glob("*.nbc")) for folder in record["folders"])


def test_the_help_of_warmup_says_where_kernels_are_kept(gppcs_command):
    code, out, err = gppcs_command("warmup", "--help")
    assert (code, err) == (0, "")
    assert "NUMBA_CACHE_DIR" in out
