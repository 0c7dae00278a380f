"""The program as a whole: its help, its version, its exit codes and streams."""

import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import typer.main

import gppcs
from command_line import FAST, files
from gppcs.app import program
from gppcs.methods.parameters import parameters_of


def test_version(printed):
    assert printed("--version") == f"{gppcs.__version__}\n"


COMMANDS = typer.main.get_command(program.program()).commands


@pytest.mark.parametrize("words", [(), ("-h",), *((name, "--help") for name in COMMANDS)])
def test_help(printed, words):
    """The bare command shows the help of the program."""
    out = printed(*words)
    assert "--help" in out
    assert len(words) == 2 or all(name in out for name in (*COMMANDS, "Examples"))


def test_flags_take_no_value_and_settings_are_completed(printed):
    out = printed("simplify", "--help")
    assert "--force" in out
    assert "bool>" not in out
    [settings] = [param for param in COMMANDS["simplify"].params if "--set" in param.opts]
    for method, text, expected in (
        ("gp", "feat", ["feature_weight="]),
        ("voxel", "keep=l", ["keep=lowest", "keep=least"]),
    ):
        context = SimpleNamespace(params={"method": method})
        assert [item.value for item in settings.shell_complete(context, text)] == expected


@pytest.mark.parametrize("name", gppcs.METHODS.built_in)
def test_methods_explains_one_and_each_of_its_parameters(printed, record, name):
    text, method = " ".join(printed("methods", name).split()), gppcs.METHODS[name]
    assert text.startswith(f"{name}: {method.summary}")
    assert method.source in text
    for key, parameter in parameters_of(method).items():
        assert f"{key} ({parameter.kind}, default {parameter.default}) {parameter.meaning}" in text
    meanings = {key: parameter.meaning for key, parameter in parameters_of(method).items()}
    assert record("methods", name)["meanings"] == meanings


@pytest.mark.parametrize(
    ("words", "made"),
    [
        (["evaluate", "table.dat", "small.ply"], None),
        (["compare", "table.dat", "--points", 30, "--methods", "fps", "--no-picture", "-o", "side"], "side"),
        (["report", "table.dat", "small.ply", "-o", "r.html"], "r.html"),
        (["view", "small.ply", "table.dat", "-o", "v.html", "--no-open"], "v.html"),
        (["render", "table.dat", "-o", "p.png", "--size", "100x80"], "p.png"),
        (["convert", "table.dat", "new.ply"], "new.ply"),
    ],
)
def test_a_table_of_any_name_and_columns_is_read_and_quiet_is_quiet(printed, scan, words, made):
    if words[0] == "render":
        pytest.importorskip("matplotlib")
    gppcs.write("small.ply", scan.take(range(50)))
    np.savetxt("table.dat", scan.points[:, ::-1], fmt="%.17g")
    before = files()
    assert printed(*words, "--from", "xyz", "--columns", "z,y,x", "-q") == ""
    assert set(files()) - set(before) == {made} - {None}


def test_the_module_runs_as_the_command():
    run = subprocess.run(
        [sys.executable, "-m", "gppcs", "info", "none.ply"], capture_output=True, text=True, check=False
    )
    assert (run.returncode, run.stdout, run.stderr) == (2, "", "gppcs: none.ply: No such file or directory\n")


@pytest.mark.parametrize("name", [None, *COMMANDS])
def test_examples_of_the_help_name_options_that_exist(name):
    text = (program.EPILOG if name is None else COMMANDS[name].epilog) or ""
    lines = [line.split("#")[0].split() for line in text.replace(" && ", "\n").split("\n") if line.startswith("gppcs ")]
    for _, command, *words in [line for line in lines if line[1] in COMMANDS]:
        known = {option for param in COMMANDS[command].params for option in (*param.opts, *param.secondary_opts)}
        assert {word.split("=")[0] for word in words if word.startswith("--")} <= {*known, "--help"}, command


@pytest.mark.slow
@pytest.mark.parametrize("encoding", ["ascii", "latin-1", ""])
def test_a_terminal_that_lacks_characters_is_no_reason_to_fail(scan, encoding):
    """The arrow of the title, and those in the name of the file."""
    Path("scan.ply").rename("sc\u00e4n\u2192.ply")
    words = [sys.executable, "-m", "gppcs", "simplify", "sc\u00e4n\u2192.ply", "-o", "out.ply", "--points", "9"]
    variables = os.environ | {"PYTHONIOENCODING": encoding, "LC_ALL": "C"}
    run = subprocess.run([*words, *FAST], capture_output=True, env=variables, check=False)
    assert (run.returncode, run.stderr) == (0, b"")
    assert run.stdout.startswith(b"sc")
    assert b"400 in, 9 out" in run.stdout
