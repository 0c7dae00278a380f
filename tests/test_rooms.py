"""A room of the package imports only from rooms below it."""

import ast
from pathlib import Path

import pytest

import gppcs

PACKAGE = Path(gppcs.__file__).parent
# From low to high; rooms on one line stand side by side. "gppcs" is the package's own __init__.py.
FLOORS = (
    ("gppcs.errors",),
    ("gppcs.engine",),
    ("gppcs.spatial",),
    ("gppcs.clouds",),
    ("gppcs.io", "gppcs.scans", "gppcs.surface"),
    ("gppcs.gp", "gppcs.gp.local", "gppcs.gp.spectral"),
    ("gppcs.methods",),
    ("gppcs.amounts",),
    ("gppcs.simplification",),
    ("gppcs.meshing", "gppcs.streaming"),
    ("gppcs.evaluation",),
    ("gppcs.drawing",),
    ("gppcs",),
    ("gppcs.app",),
    ("gppcs.__main__",),
)
FLOOR = {room: number for number, rooms in enumerate(FLOORS) for room in rooms}


def room_of(module):
    """The most specific room that a module is in."""
    inside = [room for room in FLOOR if f"{module}.".startswith(f"{room}.") and (room != "gppcs" or module == "gppcs")]
    assert inside, f"{module} is in no room: add it to FLOORS in {Path(__file__).name}"
    return max(inside, key=len)


def imports(source, is_module):
    """Each module of the package that some code imports, anywhere in it, and the line."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"line {node.lineno}: write the import with the full name of its module"
            within = [f"{node.module}.{alias.name}" for alias in node.names]
            names = [name if is_module(name) else node.module for name in within]
        else:
            continue
        yield from ((node.lineno, name) for name in names if name.split(".")[0] == "gppcs")


def faults(module, source, is_module):
    """What is wrong with the imports of a module."""
    room = room_of(module)
    for line, name in imports(source, is_module):
        other = room_of(name)
        if other != room and FLOOR[other] >= FLOOR[room]:
            yield f"{line}: imports {name}, but {room} may import only from rooms below it, and {other} is not"


def modules():
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
        yield ".".join(parts[:-1] if parts[-1] == "__init__" else parts), path


MODULES = dict(modules())


@pytest.mark.parametrize("module", MODULES)
def test_modules_import_only_from_rooms_below(module):
    path = MODULES[module]
    found = [f"{path}:{fault}" for fault in faults(module, path.read_text(encoding="utf-8"), MODULES.__contains__)]
    assert not found, "\n".join(found)


def test_every_room_is_there():
    assert FLOOR.keys() <= MODULES.keys()


@pytest.mark.parametrize(
    ("module", "line", "is_fine"),
    [
        ("gppcs.surface.normals", "from gppcs.clouds.cloud import PointCloud", True),
        ("gppcs.clouds.cloud", "from gppcs.surface.normals import estimate_normals", False),
        ("gppcs.clouds.cloud", "def f():\n    import gppcs.surface.normals", False),
        ("gppcs.clouds.cloud", "if TYPE_CHECKING:\n    from gppcs.io import read", False),
        ("gppcs.scans.fan", "from gppcs.io import read", False),
        ("gppcs.gp.local.density", "from gppcs.gp.spectral.kernel import kernel_features", False),
        ("gppcs.gp.local.density", "from gppcs.gp.local.kernel import anything", True),
        ("gppcs.methods.hc", "from gppcs.methods.hc.clustering import hierarchical_clusters", True),
        ("gppcs.evaluation.judge", "from gppcs import simplify", False),
        ("gppcs.evaluation.judge", "from gppcs import errors", True),
        ("gppcs.app.cli", "from gppcs import __version__", True),
        ("gppcs.drawing.pair", "import numpy, gppcs.app", False),
    ],
)
def test_the_order_is_held(module, line, is_fine):
    assert (not list(faults(module, line, MODULES.__contains__))) == is_fine


def test_a_module_outside_every_room_is_named():
    with pytest.raises(AssertionError, match=r"gppcs\.utils is in no room"):
        room_of("gppcs.utils")
