"""A digest of the code that decides a result: it changes with what is computed, not with words, names or files.

The digest starts at a class or a function and follows every name used there to its definition in this project, and so
on. Only definitions that are reached this way count. They count without comments, docstrings, annotations, imports,
messages and names of stages. The project's own names do not count either: where a name is used, the code of its
definition stands in its place. So neither a renaming nor a move to another file changes the digest.
"""

from __future__ import annotations

import ast
import hashlib
import importlib.util
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from itertools import groupby
from pathlib import Path

import gppcs
from gppcs.spatial.cells import first_occurrences
from gppcs.spatial.scaling import normalised

Root = type | Callable[..., object]

PACKAGES = ("gppcs", "conditions")  # names are followed within these only
APART = ("gppcs.engine", "gppcs.errors", "gppcs.clouds", "gppcs.io")  # they time, report, hold and read
EVERY_METHOD = (normalised, first_occurrences)  # what `simplify` does to the points first
DIGITS = 16
DEEPEST = 64  # calls within calls, more than there are


@dataclass(frozen=True)
class Place:
    """A definition of a module; the module itself if the name is empty."""

    module: str
    name: str = ""


Uses = frozenset[Place]
Token = str | Uses


@dataclass(frozen=True)
class Module:
    """The definitions of a module and its imports from this project, by name."""

    definitions: dict[str, ast.stmt]
    imports: dict[str, Place]


def of_method(method: gppcs.Method, *others: Root) -> str:
    """Return the digest of what a method with these parameters chooses, and of other code where it takes part."""
    return of_code(type(method), *EVERY_METHOD, *others, parameters=repr(method))


@cache
def of_code(*roots: Root, parameters: str = "") -> str:
    """Return the digest of all that some classes and functions use.

    Each definition begins with an empty digest. Then, again and again, its digest is made anew from its own code and
    the digests of the definitions that it uses. After as many rounds as calls are nested, all code has come in.
    """
    places = [found for root in roots if (found := definition_at(Place(root.__module__, root.__name__)))]
    tokens = tokens_of(places)
    digests = dict.fromkeys(tokens, "")
    for _ in range(DEEPEST):
        digests = {
            place: hashed(*(token if isinstance(token, str) else used_digests(token, digests) for token in of_place))
            for place, of_place in tokens.items()
        }
    return hashed(parameters, *(digests[place] for place in places))[:DIGITS]


def used_digests(uses: Uses, digests: Mapping[Place, str]) -> str:
    """Return the digests of definitions that are used, in an order that does not depend on their names."""
    return " ".join(sorted(digests[place] for place in uses))


def hashed(*words: str) -> str:
    """Return the SHA-256 of some words."""
    return hashlib.sha256("\n".join(words).encode()).hexdigest()


def tokens_of(roots: list[Place]) -> dict[Place, list[Token]]:
    """Return the code of all definitions that are used, as words and uses of other definitions.

    A function of a class counts if any of this code uses its name.
    """
    found: dict[Place, Code] = {}
    waiting, names = list(roots), set[str]()
    while waiting:
        place = waiting.pop()
        found[place] = code_of(place)
        names |= found[place].attributes
        functions = (each for code in found.values() for name, each in code.functions.items() if name in names)
        waiting = list({*waiting, *found[place].uses, *functions} - set(found))
    fields, functions_of = defaultdict[str, set[str]](set), defaultdict[str, set[Place]](set)
    for code in found.values():
        for number, name in enumerate(code.fields):
            fields[name].add(f"{number} of {len(code.fields)}")
        for name in names & set(code.functions):
            functions_of[name].add(code.functions[name])
    known: dict[str, Token] = {name: " ".join(sorted(places)) for name, places in fields.items()}
    known |= {name: frozenset(places) for name, places in functions_of.items()}
    return {place: list(joined(code.tokens(known))) for place, code in found.items()}


def joined(tokens: Iterable[Token]) -> Iterator[Token]:
    """Yield the same with one word in place of several in a row."""
    for word, group in groupby(tokens, lambda token: isinstance(token, str)):
        part = list(group)
        yield from [hashed(*part)] if word else part


@cache
def module_of(name: str) -> Module:
    """Read a module."""
    tree = ast.parse(Path(str(importlib.util.find_spec(name).origin)).read_text())
    definitions: dict[str, ast.stmt] = {}
    for statement in tree.body:
        if isinstance(statement, ast.FunctionDef | ast.ClassDef):
            definitions[statement.name] = statement
        elif isinstance(statement, ast.Assign | ast.AnnAssign):
            definitions |= dict.fromkeys(assigned(statement), statement)
    outside = ast.Module([each for each in tree.body if each not in definitions.values()], [])
    return Module(definitions, imports_in(outside))


def assigned(tree: ast.AST) -> list[str]:
    """Return the names that a piece of code gives a value, in order: variables, arguments, functions within."""
    names = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            names.append(node.id)
        elif isinstance(node, ast.arg):
            names.append(node.arg)
        elif isinstance(node, ast.FunctionDef) and node is not tree:
            names.append(node.name)
    return list(dict.fromkeys(names))


def imports_in(tree: ast.AST) -> dict[str, Place]:
    """Return what a piece of code imports from this project."""
    found: dict[str, Place] = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {each.name: Place(each.name) for each in node.names if "." not in each.name}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {each.asname or each.name: Place(node.module, each.name) for each in node.names}
    return {name: place for name, place in found.items() if place.module.split(".")[0] in PACKAGES}


def followed(module: str) -> bool:
    """Tell whether names are followed into a module."""
    return module.split(".")[0] in PACKAGES and not any(f"{module}.".startswith(f"{each}.") for each in APART)


def definition_at(place: Place) -> Place | None:
    """Return where a name is defined that may be imported from elsewhere; None outside of what is followed."""
    if not followed(place.module):
        return None
    known = module_of(place.module)
    if not place.name or place.name in known.definitions:
        return place
    if place.name in known.imports:
        return definition_at(known.imports[place.name])
    inner = f"{place.module}.{place.name}"
    return Place(inner) if followed(inner) and importlib.util.find_spec(inner) else None


@cache
def code_of(place: Place) -> Code:
    """Read a definition."""
    return Code(place)


class Code:
    """The code of a definition: of a constant, a function, a class without its functions, or a function of a class.

    Attributes
    ----------
    uses : set of Place
        The definitions that it names.
    attributes : set of str
        The names after a dot.
    fields : list of str
        Of a dataclass or a named tuple, in order.
    functions : mapping of name to Place
        Those of a class, but for the special ones such as `__call__`, which are part of its code.
    """

    def __init__(self, place: Place) -> None:
        self.place, known = place, module_of(place.module)
        outer, _, inner = place.name.partition(".")
        self.definitions, definition = known.definitions, known.definitions[outer]
        self.imports = known.imports | imports_in(definition)
        self.bare = Bare().visit(ast.parse(ast.unparse(definition))).body[0]
        self.fields, self.functions = [], {}
        if isinstance(definition, ast.ClassDef):
            self.fields = [each.target.id for each in definition.body if isinstance(each, ast.AnnAssign)]
            own = {
                each.name: each
                for each in self.bare.body
                if isinstance(each, ast.FunctionDef) and not each.name.startswith("__")
            }
            if inner:
                self.bare = own[inner]
            else:
                self.functions = {name: Place(place.module, f"{outer}.{name}") for name in own}
                self.bare.body = [each for each in self.bare.body if each not in own.values()]
        self.own = {name: number for number, name in enumerate(assigned(self.bare))}
        self.attributes = {node.attr for node in ast.walk(self.bare) if isinstance(node, ast.Attribute)}
        self.uses = {used for token in self.tokens({}) if not isinstance(token, str) for used in token}

    def tokens(self, known: Mapping[str, Token]) -> Iterator[Token]:
        """Yield words and uses; `known` has what stands for the names of fields and functions of classes."""
        if isinstance(self.bare, ast.Assign):  # which of several names
            yield str(self.own[self.place.name])
        yield from self._of(self.bare, known)

    def _of(self, node: ast.AST, known: Mapping[str, Token]) -> Iterator[Token]:
        """Yield the tokens of a part; what is empty is left out, since it differs between versions of Python."""
        used = self._use(node)
        if used:
            yield frozenset([used])
            return
        yield type(node).__name__
        for field, value in ast.iter_fields(node):
            if isinstance(value, str) and not isinstance(node, ast.Constant):
                yield self._anonymous(node, value, known)
            elif isinstance(value, ast.AST | list):
                parts = value if isinstance(value, list) else [value]
                for part in parts if field != "ctx" else ():
                    yield from self._of(part, known) if isinstance(part, ast.AST) else (repr(part),)
                yield f"end of {field}" if parts else ""
            elif value is not None or isinstance(node, ast.Constant):
                yield repr(value)

    def _use(self, node: ast.AST) -> Place | None:
        """Return the definition that a name, or an attribute of a module, stands for."""
        if isinstance(node, ast.Name) and node.id not in self.own:
            here = Place(self.place.module, node.id) if node.id in self.definitions else self.imports.get(node.id)
            found = definition_at(here) if here else None
            return found if found and found.name else None
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in self.imports:
            home = definition_at(self.imports[node.value.id])
            return definition_at(Place(home.module, node.attr)) if home and not home.name else None
        return None

    def _anonymous(self, node: ast.AST, name: str, known: Mapping[str, Token]) -> Token:
        """Return what stands for a name: the number of a variable or a field, or the functions of that name.

        Other names, such as those of NumPy, stand for themselves.
        """
        if isinstance(node, ast.Name | ast.arg) and name in self.own:
            return f"variable {self.own[name]}"
        if isinstance(node, ast.Attribute | ast.keyword) and name in known:
            return known[name]
        return "" if isinstance(node, ast.FunctionDef | ast.ClassDef) and not name.startswith("__") else name


class Bare(ast.NodeTransformer):
    """Takes out of code what does not decide its results."""

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        """Drop docstring and annotations."""
        node.returns = None
        for argument in ast.walk(node.args):
            if isinstance(argument, ast.arg):
                argument.annotation = None
        node.body = without_docstring(node.body)
        return self.generic_visit(node)

    def visit_ClassDef(self, node: ast.ClassDef) -> ast.AST:
        """Drop docstring and texts; of a method also its parameters and their checks: `of_method` has their values."""
        method = any(isinstance(base, ast.Name) and base.id == "Method" for base in node.bases)
        node.body = [each for each in without_docstring(node.body) if not says(each) and not (method and sets(each))]
        if method:
            node.bases = []
        return self.generic_visit(node)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.AST | None:
        """Drop the annotation, and what is only declared."""
        return self.generic_visit(ast.Assign([node.target], node.value, lineno=0)) if node.value else None

    def visit_Raise(self, node: ast.Raise) -> ast.AST:
        """Drop what is said of an error."""
        return ast.Raise()

    def visit_Assert(self, node: ast.Assert) -> ast.AST:
        """Drop the message."""
        node.msg = None
        return self.generic_visit(node)

    def visit_Import(self, node: ast.Import) -> None:
        """Drop imports: files may move."""

    def visit_ImportFrom(self, node: ast.ImportFrom) -> None:
        """Drop imports: files may move."""

    def visit_Call(self, node: ast.Call) -> ast.AST:
        """Drop the names of stages."""
        if isinstance(node.func, ast.Name) and node.func.id == "stages":
            node.args, node.keywords = [], []
        return self.generic_visit(node)


def without_docstring(body: list[ast.stmt]) -> list[ast.stmt]:
    """Return statements without texts that stand alone; `pass` if there were no others."""
    kept = [each for each in body if not (isinstance(each, ast.Expr) and isinstance(each.value, ast.Constant))]
    return kept or [ast.Pass()]


def says(statement: ast.stmt) -> bool:
    """Tell whether a statement of a class sets a text, or describes a field by a call."""
    value = getattr(statement, "value", None)
    if isinstance(statement, ast.Assign):
        return isinstance(value, ast.Constant) and isinstance(value.value, str)
    return isinstance(statement, ast.AnnAssign) and isinstance(value, ast.Call)


def sets(statement: ast.stmt) -> bool:
    """Tell whether a statement of a method's class declares a parameter or checks them all."""
    return isinstance(statement, ast.AnnAssign) or getattr(statement, "name", "") == "__post_init__"
