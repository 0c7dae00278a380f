"""The plugin of QGIS, from its zip, in QGIS itself: without a window, with its own Python."""

import ast
import configparser
import json
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import gppcs

ROOT = Path(__file__).parents[1]
PLUGIN = ROOT / "qgis" / "gppcs_provider"
# Debian's wrapper passes options of the desktop program, which this program does not know.
QGIS = shutil.which("qgis_process.bin") or shutil.which("qgis_process")
PYTHON = "/usr/bin/python3"  # for which Debian installs the modules of QGIS

# Runs an algorithm as the desktop program does, and cancels it in another thread as soon as gppcs has started.
IMPATIENT = """
import sys, threading
sys.path[:0] = ["/usr/share/qgis/python/plugins", sys.argv[1]]
from qgis.core import QgsApplication, QgsProcessingException, QgsProcessingFeedback
app = QgsApplication([], False)
app.initQgis()
import processing
from processing.core.Processing import Processing
Processing.initialize()
import gppcs_provider
plugin = gppcs_provider.classFactory(None)
plugin.initGui()
class Feedback(QgsProcessingFeedback):
    def setProgressText(self, text):
        threading.Thread(target=self.cancel).start()
try:
    processing.run("gppcs:make_mesh", {"INPUT": sys.argv[2], "OUTPUT": sys.argv[3]}, feedback=Feedback())
except QgsProcessingException as error:
    print(error)
plugin.unload()
"""


def constant(name):
    """Return a constant of the algorithms, which only QGIS can import."""
    tree = ast.parse((PLUGIN / "algorithms.py").read_text(encoding="utf-8"))
    (value,) = (node.value for node in tree.body if isinstance(node, ast.Assign) and node.targets[0].id == name)
    return ast.literal_eval(value)


def test_the_plugin_has_the_version_and_the_methods_of_the_package():
    about = configparser.ConfigParser()
    about.read(PLUGIN / "metadata.txt", encoding="utf-8")
    assert about["general"]["version"] == gppcs.__version__
    assert constant("METHODS") == list(gppcs.METHODS.built_in)


@pytest.fixture(scope="module")
def qgis(tmp_path_factory):
    """A folder with a scan, and a function that runs QGIS there, where the plugin is installed from its zip."""
    if not QGIS:
        pytest.skip("QGIS is not installed: no qgis_process; on Debian: apt-get install qgis qgis-providers")
    folder = tmp_path_factory.mktemp("qgis")
    made = folder / "plugin.zip"
    subprocess.run(["make", "-s", "-C", ROOT, "qgis", f"PYTHON={sys.executable}", f"ZIP={made}"], check=True)
    with zipfile.ZipFile(made) as plugin:
        plugin.extractall(folder / "plugins")
    profile = folder / "profiles" / "default" / "QGIS"
    profile.mkdir(parents=True)
    (profile / "QGIS3.ini").write_text("[PythonPlugins]\ngppcs_provider=true\nprocessing=true\n")
    command = folder / "bin" / "gppcs"  # with the package that is tested, though QGIS drops PYTHONPATH
    command.parent.mkdir()
    package = Path(gppcs.__file__).parents[1]
    command.write_text(f'#!/bin/sh\nPYTHONPATH="{package}" exec "{sys.executable}" -m gppcs "$@"\n')
    command.chmod(0o755)
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")} | {
        "PATH": f"{command.parent}:/usr/bin:/bin",
        "QGIS_CUSTOM_CONFIG_PATH": str(folder),
        "QGIS_PLUGINPATH": str(folder / "plugins"),
        "QT_QPA_PLATFORM": "offscreen",
    }

    def run(*words, code=0, **changed):
        done = subprocess.run(
            words, cwd=folder, env=environment | changed, capture_output=True, encoding="utf-8", check=False
        )
        assert done.returncode == code, done.stdout + done.stderr
        return done.stdout if code == 0 else done.stderr

    gppcs.write(folder / "scan.laz", gppcs.sample("street", n_points=20_000), lossy=True)
    return SimpleNamespace(folder=folder, run=run)


def algorithm(qgis, name, **parameters):
    """Run an algorithm of the plugin; return its results and what it told."""
    given = [f"{key}={value}" for key, value in parameters.items()]
    record = json.loads(qgis.run(QGIS, "run", "--json", f"gppcs:{name}", "--", *given))
    return record["results"], record["log"]


@pytest.mark.slow
def test_qgis_thins_a_cloud_and_evaluates_it(qgis):
    results, log = algorithm(qgis, "thin_point_cloud", INPUT="scan.laz", OUTPUT="small.laz", SIZE="3%", WEIGHT=0.8)
    assert results == {"OUTPUT": "small.laz"}
    assert "20,000 in, 600 out (3 %)" in log["info"][-1]
    scan, small = gppcs.read(qgis.folder / "scan.laz"), gppcs.read(qgis.folder / "small.laz")
    expected = gppcs.simplify(scan, n_points=600, method=gppcs.LocalGP(feature_weight=0.8), order="input").cloud
    np.testing.assert_array_equal(small.points, expected.points)
    for name, values in expected.attributes.items():
        np.testing.assert_array_equal(small.attributes[name], values)
    results, log = algorithm(qgis, "evaluate", INPUT="scan.laz", THINNED="small.laz")
    figures = gppcs.evaluate(scan, small).figures()
    assert results == pytest.approx({name.upper(): figures[name] for name in constant("FIGURES")})
    assert f"surface max: {figures['surface_max']:.6g}" in log["info"]


@pytest.mark.slow
def test_qgis_makes_a_mesh_and_passes_options_on(qgis):
    asked = {"INPUT": "scan.laz", "SIZE": "1.5k", "OPTIONS": "--moved --fill-holes '1 m' --unit m"}
    results, _ = algorithm(qgis, "make_mesh", OUTPUT="TEMPORARY_OUTPUT", **asked)
    assert results["OUTPUT"].endswith(".ply")
    asked["OPTIONS"] = "--quota 'marking == 1: 100'"
    algorithm(qgis, "thin_point_cloud", OUTPUT="marked.laz", METHOD="fps", **asked)
    marked = gppcs.read(qgis.folder / "marked.laz")
    assert (len(marked), marked.attributes["marking"].sum()) == (1500, 100)


@pytest.mark.slow
def test_errors_are_those_of_gppcs(qgis):
    missing = [QGIS, "run", "gppcs:thin_point_cloud", "--", "INPUT=missing.laz", "OUTPUT=none.laz"]
    assert "missing.laz: No such file or directory" in qgis.run(*missing, code=1)
    assert "Install gppcs in a Python" in qgis.run(*missing, code=1, PATH="/usr/bin:/bin")
    settings = qgis.folder / "profiles" / "default" / "QGIS" / "QGIS3.ini"
    before = settings.read_text()
    for command, told in (("bin/gppcs", "missing.laz: No such file"), ("bin", "bin cannot be run (Permission denied)")):
        settings.write_text(before + f"[Processing]\nConfiguration\\GPPCS_COMMAND={qgis.folder}/{command}\n")
        assert told in qgis.run(*missing, code=1, PATH="/usr/bin:/bin")
    settings.write_text(before)


@pytest.mark.slow
def test_canceling_ends_gppcs_and_leaves_the_old_file(qgis):
    (qgis.folder / "old.ply").write_text("old")
    files = set(qgis.folder.iterdir())
    printed = qgis.run(PYTHON, "-c", IMPATIENT, qgis.folder / "plugins", "scan.laz", "old.ply")
    assert printed.endswith("Canceled.\n")
    assert (qgis.folder / "old.ply").read_text() == "old"
    assert set(qgis.folder.iterdir()) == files
