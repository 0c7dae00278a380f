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
    ("gppcs.result", "gppcs.streaming"),
    ("gppcs.steps",),
    ("gppcs.simplification",),
    ("gppcs.estimator", "gppcs.meshing"),
    ("gppcs.evaluation",),
    ("gppcs.drawing",),
    ("gppcs",),
    ("gppcs.cloudcompare", "gppcs.pdal"),
    ("gppcs.app",),
    ("gppcs.__main__",),
)
FLOOR = {room: number for number, rooms in enumerate(FLOORS) for room in rooms}


def room_of(module):
    """The most specific room that a module is in."""
    inside = [room for room in FLOOR if f"{module}.".startswith(f"{room}.") and (room != "gppcs" or module == "gppcs")]
    assert inside, f"{module} is in no room: add it to FLOORS in {Path(__file__).name}"
    return max(inside, key=len)


def imports(source):
    """Each module of the package that some code imports, anywhere in it, and the line."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"line {node.lineno}: write the import with the full name of its module"
            within = [f"{node.module}.{alias.name}" for alias in node.names]
            names = [name if name in MODULES else node.module for name in within]
        else:
            continue
        yield from ((node.lineno, name) for name in names if name.split(".")[0] == "gppcs")


def modules():
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
        yield ".".join(parts[:-1] if parts[-1] == "__init__" else parts), path


MODULES = dict(modules())


@pytest.mark.parametrize("module", MODULES)
def test_modules_import_only_from_rooms_below(module):
    path, room = MODULES[module], room_of(module)
    for line, name in imports(path.read_text(encoding="utf-8")):
        other = room_of(name)
        assert other == room or FLOOR[other] < FLOOR[room], f"{path}:{line}: {name} is not in a room below {room}"
