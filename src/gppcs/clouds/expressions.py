"""Conditions on attributes and coordinates, such as `classification == 6 and z > 2.5`, in a small safe grammar."""

from __future__ import annotations

import ast
import operator
import re
import unicodedata
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.errors import InputError, ParameterError, nearest_name, shown

AXES = ("x", "y", "z")
LONGEST = 2000  # characters
GRAMMAR = "conditions such as 'classification == 6', 'z > 2.5 and not intensity < 10' or 'classification in [2, 6]'"
_EXACT = 2**53  # Larger whole numbers are no doubles.
_LARGEST = 2**63 - 1  # Larger ones are computed with one by one.
_QUOTED = r"'[^']*'|\"[^\"]*\""
_SPACE = re.compile(rf"(?P<quoted>{_QUOTED})|\s+")
_ANY_NAME = "attributes"  # attributes["any name"] stands for an attribute whose name is no word
# Words of Python's statements, which could be names of attributes.
_RESERVED = re.compile(rf"(?P<quoted>{_QUOTED})|\b(?P<name>class|def|from|global|import|pass|return|try|while|with)\b")
_COMPARISONS: dict[type[ast.AST], Callable[[Any, Any], Any]] = {
    ast.Eq: operator.eq, ast.NotEq: operator.ne, ast.Lt: operator.lt, ast.LtE: operator.le, ast.Gt: operator.gt,
    ast.GtE: operator.ge,
}  # fmt: skip
_ARITHMETIC: dict[type[ast.AST], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv,
    ast.Mod: operator.mod,
}  # fmt: skip


@dataclass(frozen=True)
class Expression:
    """A condition on the points of a cloud."""

    text: str
    # Its syntax, which is Python's. Only what this class evaluates is allowed.
    tree: ast.expr = field(repr=False, compare=False)

    @classmethod
    def of(cls, text: Any) -> Expression:
        """Read a condition."""
        if not isinstance(text, str) or not text.strip() or len(text) > LONGEST or "\0" in text:
            raise ParameterError(f"expected {GRAMMAR}, found {shown(text)}")
        text = _SPACE.sub(lambda found: found["quoted"] or " ", text.strip())
        bare = re.sub(_QUOTED, lambda quoted: " " * len(quoted[0]), text)
        if assignment := re.search(r"(?<![=!<>:])=(?!=)", bare):
            raise ParameterError(f"{_at(text, assignment.start())}: expected == to compare, found a single =")
        if "#" in bare:
            raise ParameterError(f"{_at(text, bare.index('#'))}: expected no comment")
        try:
            with warnings.catch_warnings():
                # Python warns of `2and` and of unknown escapes in quotes: advice on source code, which this is not.
                warnings.simplefilter("ignore")
                tree = ast.parse(_RESERVED.sub(_as_attribute, text), mode="eval").body
        except UnicodeEncodeError:
            raise ParameterError(f"expected {GRAMMAR}, found {shown(text)}") from None
        except SyntaxError as error:
            place = (error.offset or len(text) + 1) - 1
            for found in _RESERVED.finditer(text):
                if found["name"] and found.start() < place:
                    place -= len(_as_attribute(found)) - len(found["name"])
            raise ParameterError(f"{_at(text, place)}: expected {GRAMMAR}") from None
        except (RecursionError, MemoryError, ValueError):
            raise ParameterError(f"expected a condition that is nested less deeply, found {shown(text)}") from None
        return cls(text, tree)

    def mask(self, cloud: PointCloud) -> NDArray[np.bool_]:
        """Return which points of a cloud meet the condition. Shapes: returns (N,)."""
        try:
            with np.errstate(all="ignore"):
                found = self._truth(self.tree, cloud)
        except RecursionError:
            raise ParameterError(f"expected a condition that is nested less deeply, found {shown(self.text)}") from None
        return np.broadcast_to(found, len(cloud)).copy()

    def _truth(self, node: ast.expr, cloud: PointCloud) -> NDArray[np.bool_]:
        """Return for which points a part of the condition is true."""
        if isinstance(node, ast.BoolOp):
            parts = [self._truth(value, cloud) for value in node.values]
            joined = np.logical_and if isinstance(node.op, ast.And) else np.logical_or
            return joined.reduce(np.broadcast_arrays(*parts))
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            return ~self._truth(node.operand, cloud)
        if isinstance(node, ast.Compare):
            return self._compared(node, cloud)
        value = self._value(node, cloud)
        if isinstance(value, np.ndarray) and value.dtype == np.bool_:
            return value
        raise self._error(node, "a condition, such as classification == 6")

    def _compared(self, node: ast.Compare, cloud: PointCloud) -> NDArray[np.bool_]:
        """Return for which points a chain of comparisons is true."""
        result: Any = np.True_
        left = self._value(node.left, cloud)
        for sign, right_node in zip(node.ops, node.comparators, strict=True):
            if isinstance(sign, ast.In | ast.NotIn):
                if not isinstance(right_node, ast.List | ast.Tuple | ast.Set):
                    raise self._error(right_node, "a list, such as [2, 6]")
                right: Any = None
                among = [self._equal(left, self._value(each, cloud), operator.eq, each) for each in right_node.elts]
                found = np.logical_or.reduce(np.broadcast_arrays(np.False_, *among))
                result = result & (~found if isinstance(sign, ast.NotIn) else found)
            elif type(sign) in _COMPARISONS:
                right = self._value(right_node, cloud)
                result = result & self._equal(left, right, _COMPARISONS[type(sign)], right_node)
            else:
                raise self._error(right_node, "==, !=, <, <=, >, >= or in before it")
            left = right
        return np.asarray(result)

    def _equal(self, left: Any, right: Any, compare: Callable[[Any, Any], Any], node: ast.expr) -> NDArray[np.bool_]:
        """Compare two values, of which both are numbers or both are texts."""
        if _is_text(left) != _is_text(right):
            raise self._error(node, "a text in quotes" if _is_text(left) else "a number")
        try:
            if _is_whole(left) != _is_whole(right):  # Python compares whole numbers and fractions exactly
                left, right = (_of_python(each) if _is_whole(each) else each for each in (left, right))
            return np.asarray(compare(left, right), dtype=np.bool_)
        except OverflowError:
            raise self._error(node, "a number that can be computed with") from None

    def _value(self, node: ast.expr, cloud: PointCloud) -> Any:
        """Return the values of a part of the condition: of each point, or one for all."""
        if isinstance(node, ast.Constant) and isinstance(node.value, int | float | str):
            return np.bool_(node.value) if isinstance(node.value, bool) else node.value
        if isinstance(node, ast.Name):
            return self._column(node, node.id, cloud)
        if isinstance(node, ast.Subscript) and isinstance(node.value, ast.Name) and node.value.id == _ANY_NAME:
            if isinstance(node.slice, ast.Constant) and isinstance(node.slice.value, str):
                return self._column(node, node.slice.value, cloud)
            raise self._error(node.slice, "the name of an attribute in quotes")
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.UAdd):
            value = self._number(node.operand, cloud)
            if isinstance(node.op, ast.UAdd):
                return value
            lowest = isinstance(value, np.ndarray) and value.dtype.kind == "i" and _size(value) > _LARGEST
            return -value.astype(object) if lowest else -value
        if isinstance(node, ast.BinOp) and type(node.op) in _ARITHMETIC:
            left, right = self._number(node.left, cloud), self._number(node.right, cloud)
            return self._computed(node, left, right)
        raise self._error(node, "a number, a text in quotes, or the name of an attribute")

    def _computed(self, node: ast.BinOp, left: Any, right: Any) -> Any:
        """Compute with numbers: whole ones exactly, however large."""
        whole = [_is_whole(each) for each in (left, right)]
        if isinstance(node.op, ast.Mod) and whole[1] and not np.all(right):
            raise self._error(node.right, "a divisor other than 0")
        exact = whole[0] and whole[1] and not isinstance(node.op, ast.Div)
        sizes = [_size(each) if each_whole else 0 for each, each_whole in zip((left, right), whole, strict=True)]
        if max(sizes) > _EXACT and not exact:
            raise self._error(node, f"whole numbers of at most {_EXACT:,} beside fractions and in divisions")
        if exact and (sizes[0] * sizes[1] if isinstance(node.op, ast.Mult) else sum(sizes)) > _LARGEST:
            left, right = (each.astype(object) if isinstance(each, np.ndarray) else each for each in (left, right))
        try:
            return _ARITHMETIC[type(node.op)](left, right)
        except (ZeroDivisionError, OverflowError):
            raise self._error(node, "a number that can be computed with") from None

    def _number(self, node: ast.expr, cloud: PointCloud) -> Any:
        """Return values to compute with."""
        value = self._value(node, cloud)
        if _is_text(value):
            raise self._error(node, "a number to compute with")
        if isinstance(value, np.bool_):
            return int(value)
        if isinstance(value, np.ndarray) and value.dtype.kind in "bu":  # differences of these would be none
            return value.astype(np.int64 if _size(value) <= _LARGEST else object)
        return value

    def _column(self, node: ast.expr, name: str, cloud: PointCloud) -> NDArray[Any]:
        """Return a coordinate or an attribute; its case does not matter if only one name fits."""
        if name not in cloud.attributes and name not in AXES:
            name = self._known(node, name, [*cloud.attributes, *AXES])
        if name not in cloud.attributes:
            return cloud.points[:, AXES.index(name)]
        values = cloud.attributes[name]
        if values.ndim != 1 or values.dtype.kind not in "biufUSOT":
            raise self._error(node, "an attribute with one number or text for each point")
        if values.dtype.kind in "iu" and values.dtype.itemsize < 8:  # differences of small types could overflow
            return values.astype(np.int64)
        if values.dtype.kind == "S":
            return np.char.decode(values.astype(np.bytes_), "utf-8", "replace")
        return values.astype(str) if values.dtype.kind in "OT" else values

    def _known(self, node: ast.expr, name: str, names: Sequence[str]) -> str:
        """Return the name that differs by case only, or by what Python's syntax makes of a letter such as µ."""
        alike = [known for known in names if _plain(known) == _plain(name)]
        if len(alike) == 1:
            return alike[0]
        near = nearest_name(name, names)
        raise InputError(f"{self._at(node)}: the cloud has no attribute {name!r}{near}")

    def _error(self, node: ast.expr, expected: str) -> ParameterError:
        return ParameterError(f"{self._at(node)}: expected {expected}")

    def _at(self, node: ast.expr) -> str:
        return _at(self.text, len(self.text.encode()[: node.col_offset].decode()))


def _is_text(value: Any) -> bool:
    return isinstance(value, str) or (isinstance(value, np.ndarray) and value.dtype.kind in "UT")


def _is_whole(value: Any) -> bool:
    return isinstance(value, int) or (isinstance(value, np.ndarray) and value.dtype.kind in "iuO")


def _size(value: Any) -> int:
    """Return the largest absolute value of whole numbers."""
    if isinstance(value, np.ndarray):
        return max(abs(int(value.min())), abs(int(value.max()))) if value.size else 0
    return abs(int(value))


def _of_python(value: Any) -> Any:
    """Return whole numbers as Python's, if doubles do not hold them."""
    return value.astype(object) if isinstance(value, np.ndarray) and _size(value) > _EXACT else value


def _plain(name: str) -> str:
    return unicodedata.normalize("NFKC", name).lower()


def _at(text: str, place: int) -> str:
    """Return where in a condition something is wrong; `place` counts from 0."""
    if place >= len(text):
        return f"{shown(text)}, at its end"
    return f"{shown(text)}, at character {place + 1} ({shown(text[place : place + 15])})"


def _as_attribute(found: re.Match[str]) -> str:
    """Return a reserved word as the name of an attribute, and quoted text as it is."""
    return found["quoted"] or f'{_ANY_NAME}["{found["name"]}"]'
