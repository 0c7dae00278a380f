import os
import sys
from pathlib import Path
from types import SimpleNamespace

import laspy
import numpy as np
import pytest
from hypothesis import settings

import gppcs
from las_file import las_of
from shapes import on_sphere

# A busy machine is no failure. Each run draws other examples, so few are enough.
settings.register_profile("gppcs", deadline=None, max_examples=20, derandomize=False)
settings.load_profile("gppcs")


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real clouds; tests that need it are skipped where it is missing."""
    folder = Path(os.environ.get("GPPCS_DATA", Path(__file__).parents[2] / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"no real clouds at {folder}; set GPPCS_DATA to their folder")
    return folder


@pytest.fixture(scope="session")
def bracket() -> np.ndarray:
    """20,000 points of a machine part with sharp edges."""
    return gppcs.sample("bracket", n_points=20_000).points


@pytest.fixture(scope="session")
def sphere() -> np.ndarray:
    """40,000 random points of the unit sphere."""
    return on_sphere(40_000)


@pytest.fixture
def notebook(monkeypatch) -> list[str]:
    """What this process shows as if it were the kernel of a notebook, as HTML."""
    shown = []

    def display(thing, display_id=False):
        shown.append(thing._repr_html_())
        return SimpleNamespace(update=display) if display_id else None

    shell = SimpleNamespace(kernel=None)
    modules = {
        "IPython": SimpleNamespace(get_ipython=lambda: shell, version_info=(9, 0)),  # matplotlib asks for the version
        "IPython.display": SimpleNamespace(
            display=display, HTML=lambda html: SimpleNamespace(_repr_html_=lambda: html)
        ),
    }
    for name, module in modules.items():
        monkeypatch.setitem(sys.modules, name, module)
    return shown


@pytest.fixture
def two_systems(tmp_path) -> list[Path]:
    """The files a.las and b.las of 500 points, of which each names another coordinate system."""
    for name, crs in (("a.las", b"UTM 32N"), ("b.las", b"ETRS89 / UTM 32N")):
        las = las_of(np.random.default_rng(len(crs)).uniform(0, 9, (500, 3)))
        las.header.global_encoding.wkt = True
        las.header.vlrs.append(laspy.VLR("LASF_Projection", 2112, "", b'PROJCS["' + crs + b'"]\0'))
        las.write(tmp_path / name)
    return [tmp_path / "a.las", tmp_path / "b.las"]


@pytest.fixture
def default_threads():
    """Undo what a test sets."""
    yield
    gppcs.set_threads(None)


@pytest.fixture(params=[1, 2])
def threads(request, default_threads):
    """The number of threads that kernels run on."""
    gppcs.set_threads(request.param)
    return request.param


@pytest.fixture
def on_threads(default_threads):
    """Call a function with 1, 2, 3 and 8 threads, and return the results."""

    def call(function):
        results = []
        for count in (1, 2, 3, 8):
            gppcs.set_threads(count)
            results.append(function())
        return results

    return call
