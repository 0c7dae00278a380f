"""Conditions on attributes and coordinates, such as `classification == 6 and z > 2.5`, in a small safe grammar.

Numbers computed of them, such as `1 / (1 + exp(-opacity))`, have the same grammar.
"""

import ast
import operator
import re
import unicodedata
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.columns import CLASS_NAMES, CLASSIFICATION, EXACT
from gppcs.errors import InputError, ParameterError, nearest_name, shown

AXES = ("x", "y", "z")
GRAMMAR = "conditions such as 'classification == 6' and 'z > 2.5 and not nz < 0.5', or formulas such as '1/(x*x + y*y)'"
_QUOTED = r"(?P<quoted>'[^']*'|\"[^\"]*\")"
# Words of Python's statements may be names of attributes: `_MARK` in place of their first letter makes them names.
_MARK = "ʬ"
_RESERVED_WORDS = ("class", "def", "from", "global", "import", "pass", "return", "try", "while", "with")
_RESERVED = re.compile(rf"{_QUOTED}|\b(?P<name>{'|'.join(_RESERVED_WORDS)})\b")
_MARKED = {_MARK + word[1:]: word for word in _RESERVED_WORDS}
_ANY_NAME = "attributes"  # attributes["any name"] stands for an attribute whose name is no word
_COMPARISONS: dict[type[ast.AST], Callable[[Any, Any], Any]] = {
    ast.Eq: operator.eq, ast.NotEq: operator.ne, ast.Lt: operator.lt, ast.LtE: operator.le, ast.Gt: operator.gt,
    ast.GtE: operator.ge,
}  # fmt: skip
_ARITHMETIC: dict[type[ast.AST], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv,
    ast.Mod: operator.mod,
}  # fmt: skip


_FUNCTIONS: dict[str, Callable[[Any], Any]] = {"abs": np.abs, "exp": np.exp, "log": np.log, "sqrt": np.sqrt}
# The classes of LAS, such as high_vegetation, stand for their numbers.
_CLASSES = {name.replace(" ", "_"): number for number, name in enumerate(CLASS_NAMES) if name}


@dataclass(frozen=True)
class Expression:
    """A condition on the points of a cloud, or a number for each."""

    text: str
    source: str = field(repr=False)  # the text with `_MARK` in reserved words
    # Its syntax, which is Python's. Only what this class evaluates is allowed.
    tree: ast.expr = field(repr=False, compare=False)

    @classmethod
    def from_text(cls, text: Any) -> Self:
        """Read a condition."""
        # A longer text could nest so deeply that Python's parser fails.
        if not isinstance(text, str) or not text.strip() or len(text) > 2000:
            raise ParameterError(f"expected {GRAMMAR}, found {shown(text)}")
        text = re.sub(rf"{_QUOTED}|\s+", lambda match: match["quoted"] or " ", text.strip())
        if "#" in re.sub(_QUOTED, "", text):
            raise ParameterError(f"expected no comment in a condition, found {shown(text)}")
        source = _RESERVED.sub(lambda match: match["quoted"] or _MARK + match["name"][1:], text)
        try:
            with warnings.catch_warnings():
                # Python warns of `2and` and of unknown escapes in quotes: advice on source code, which this is not.
                warnings.simplefilter("ignore")
                return cls(text, source, ast.parse(source, mode="eval").body)
        except SyntaxError as error:
            raise ParameterError(f"{_at(text, (error.offset or len(text) + 1) - 1)}: expected {GRAMMAR}") from None
        except (RecursionError, MemoryError, ValueError):
            raise ParameterError(f"expected {GRAMMAR}, found {shown(text)}") from None

    def mask(self, cloud: PointCloud) -> NDArray[np.bool_]:
        """Return which points of a cloud meet the condition. Shapes: returns (N,)."""
        try:
            with np.errstate(all="ignore"):
                return np.broadcast_to(self._truth(self.tree, cloud), len(cloud)).copy()
        except RecursionError:
            raise ParameterError(f"expected a condition that is nested less deeply, found {shown(self.text)}") from None

    def numbers(self, cloud: PointCloud) -> NDArray[np.float64]:
        """Return the number of each point of a cloud, (N,)."""
        try:
            with np.errstate(all="ignore"):
                values = np.asarray(self._number(self.tree, cloud)).astype(np.float64)
        except RecursionError:
            raise ParameterError(f"expected a formula that is nested less deeply, found {shown(self.text)}") from None
        return np.broadcast_to(values, len(cloud))

    def _truth(self, node: ast.expr, cloud: PointCloud) -> NDArray[np.bool_]:
        """Return for which points a part of the condition is true."""
        if isinstance(node, ast.BoolOp):
            joined = np.logical_and if isinstance(node.op, ast.And) else np.logical_or
            return joined.reduce(np.broadcast_arrays(*(self._truth(value, cloud) for value in node.values)))
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            return ~self._truth(node.operand, cloud)
        if isinstance(node, ast.Compare):
            result: Any = np.True_
            left = self._value(node.left, cloud)
            for sign, right in zip(node.ops, node.comparators, strict=True):
                result = result & self._compared(left, sign, right, cloud)
                left = None if isinstance(sign, ast.In | ast.NotIn) else self._value(right, cloud)
            return np.asarray(result)
        value = self._value(node, cloud)
        if isinstance(value, np.ndarray) and value.dtype == np.bool_:
            return value
        raise self._error(node, "a condition, such as classification == 6")

    def _compared(self, left: Any, sign: ast.cmpop, node: ast.expr, cloud: PointCloud) -> NDArray[np.bool_]:
        """Return for which points one comparison is true; the values must both be numbers or both be texts."""
        if isinstance(sign, ast.In | ast.NotIn):
            if not isinstance(node, ast.List | ast.Tuple | ast.Set):
                raise self._error(node, "a list, such as [2, 6]")
            equal = [self._compared(left, ast.Eq(), element, cloud) for element in node.elts]
            among: NDArray[np.bool_] = np.logical_or.reduce(np.broadcast_arrays(np.False_, *equal))
            return ~among if isinstance(sign, ast.NotIn) else among
        if type(sign) not in _COMPARISONS:
            raise self._error(node, "==, !=, <, <=, >, >= or in before it")
        right = self._value(node, cloud)
        if _is_text(left) != _is_text(right):
            raise self._error(node, "a text in quotes" if _is_text(left) else "a number")
        try:
            return np.asarray(_COMPARISONS[type(sign)](left, right), dtype=np.bool_)
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
            return value if isinstance(node.op, ast.UAdd) else -value
        if isinstance(node, ast.BinOp) and type(node.op) in _ARITHMETIC:
            return self._computed(node, self._number(node.left, cloud), self._number(node.right, cloud))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            if node.func.id not in _FUNCTIONS or len(node.args) != 1 or node.keywords:
                raise self._error(node, f"a function of one number: {', '.join(_FUNCTIONS)}")
            return _FUNCTIONS[node.func.id](np.asarray(self._number(node.args[0], cloud)).astype(np.float64))
        raise self._error(node, "a number, a text in quotes, or the name of an attribute")

    def _computed(self, node: ast.BinOp, left: Any, right: Any) -> Any:
        """Compute with numbers: whole ones exactly, however large."""
        sizes = [_size(value) for value in (left, right) if _is_whole(value)]
        if isinstance(node.op, ast.Mod) and _is_whole(right) and not np.all(right):
            raise self._error(node.right, "a divisor other than 0")
        if len(sizes) == 2 and not isinstance(node.op, ast.Div):
            if (sizes[0] * sizes[1] if isinstance(node.op, ast.Mult) else sum(sizes)) > EXACT:
                left, right = np.asarray(left, object), np.asarray(right, object)
        elif max(sizes, default=0) > EXACT:
            raise self._error(node, f"whole numbers of at most {EXACT:,} beside fractions and in divisions")
        try:
            return _ARITHMETIC[type(node.op)](left, right)
        except (ZeroDivisionError, OverflowError):
            raise self._error(node, "a number that can be computed with") from None

    def _number(self, node: ast.expr, cloud: PointCloud) -> Any:
        """Return values to compute with."""
        value = self._value(node, cloud)
        if _is_text(value):
            raise self._error(node, "a number to compute with")
        return value * 1 if getattr(value, "dtype", None) == np.bool_ else value

    def _column(self, node: ast.expr, name: str, cloud: PointCloud) -> NDArray[Any]:
        """Return a coordinate or an attribute; its case does not matter if only one name fits."""
        names = [*cloud.attributes, *AXES]
        if name not in names:
            name = _MARKED.get(name, name)
            alike = [other for other in names if _plain(name) == _plain(other)]
            if not alike and CLASSIFICATION in names:
                if name in _CLASSES:
                    return np.full(len(cloud), _CLASSES[name])
                alike, names = [CLASSIFICATION] * (name == "class"), [*names, *_CLASSES]
            if len(alike) != 1:
                raise InputError(f"{self._at(node)}: the cloud has no attribute {name!r}{nearest_name(name, names)}")
            name = alike[0]
        if name not in cloud.attributes:
            return cloud.points[:, AXES.index(name)]
        values = cloud.attributes[name]
        if values.ndim != 1 or values.dtype.kind not in "biufUSOT":
            raise self._error(node, "an attribute with one number or text for each point")
        if values.dtype.kind in "iu":  # differences of small types could overflow
            wide = values.size and max(abs(int(values.min())), abs(int(values.max()))) > EXACT
            return values.astype(object if wide else np.int64)
        if values.dtype.kind == "S":
            return np.char.decode(values.astype(np.bytes_), "utf-8", "replace")
        return values.astype(str) if values.dtype.kind in "OT" else values

    def _error(self, node: ast.expr, expected: str) -> ParameterError:
        return ParameterError(f"{self._at(node)}: expected {expected}")

    def _at(self, node: ast.expr) -> str:
        return _at(self.text, len(self.source.encode()[: node.col_offset].decode()))


def _is_text(value: Any) -> bool:
    return isinstance(value, str) or (isinstance(value, np.ndarray) and value.dtype.kind == "U")


def _is_whole(value: Any) -> bool:
    return isinstance(value, int) or (isinstance(value, np.ndarray) and value.dtype.kind in "iO")


def _size(value: Any) -> int:
    """Return the largest absolute value of whole numbers."""
    return int(np.abs(value).max(initial=0)) if isinstance(value, np.ndarray) else abs(value)


def _plain(name: str) -> str:
    return unicodedata.normalize("NFKC", name).lower()


def _at(text: str, position: int) -> str:
    """Return where in a condition something is wrong; positions count from 0."""
    if position >= len(text):
        return f"{shown(text)}, at its end"
    return f"{shown(text)}, at character {position + 1} ({shown(text[position : position + 15])})"
