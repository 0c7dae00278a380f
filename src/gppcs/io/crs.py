"""Coordinate reference systems: their names and units, as well-known text (WKT) or keys of GeoTIFF say them."""

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from gppcs.spatial.units import Units

_TOKEN = re.compile(r'\s*(?:"(?P<text>[^"]*)"|(?P<open>[\[(])|(?P<close>[\])])|,|(?P<word>[^\s,"\[\]()]+))\s*')
LENGTH, DEPTH = 1 << 17, 64  # at most: characters of a coordinate system, and nodes around a node
_GEOGRAPHIC = ("GEOGCS", "GEOGCRS", "GEOGRAPHICCRS", "GEODCRS", "GEODETICCRS")
_IN_LENGTHS = (
    "PROJCS", "PROJCRS", "PROJECTEDCRS", "DERIVEDPROJCRS", "LOCAL_CS", "ENGCRS", "ENGINEERINGCRS", "GEOCCS",
)  # fmt: skip
_VERTICAL = ("VERT_CS", "VERTCS", "VERTCRS", "VERTICALCRS")
_WITHIN = ("COMPD_CS", "COMPOUNDCRS", "BOUNDCRS", "SOURCECRS")  # hold systems
# Units of GeoTIFF by their codes.
_LENGTH_UNITS = {9001: 1.0, 9002: 0.3048, 9003: 1200 / 3937}  # metre, foot, foot of the US survey
_ANGLES = {9101: 1.0, 9102: math.pi / 180, 9105: math.pi / 200}  # radian, degree, grad
_HEIGHTS = {5703: 1.0, 8228: 0.3048, 6360: 1200 / 3937, 5702: 1200 / 3937}  # NAVD88 in three units, NGVD29


@dataclass
class _Node:
    """A keyword of WKT with its values, and the nodes inside."""

    keyword: str
    values: list[str] = field(default_factory=list)
    nodes: list["_Node"] = field(default_factory=list)

    def named(self, *keywords: str) -> list["_Node"]:
        """Return the nodes inside with one of some keywords."""
        return [node for node in self.nodes if node.keyword in keywords]


def name_of_wkt(text: str) -> str | None:
    """Return the name and the code of a coordinate system."""
    name = re.match(r'\w+\s*[\[(]\s*"([^"]+)"', text)
    code = re.search(r'(?:AUTHORITY|ID)\s*[\[(]\s*"(\w+)"\s*,\s*"?(\w+)"?\s*[\])]\s*[\])]$', text)
    return name and in_one_line(f"{name[1]} ({code[1]}:{code[2]})" if code else name[1])


def in_one_line(text: str) -> str:
    """Return a text without control characters and line breaks."""
    return re.sub(r"[\s\x00-\x1f\x7f-\x9f]+", " ", text)


def units_of_wkt(text: str) -> Units | None:
    """Return the units of a coordinate system, of WKT 1 or 2; None if it does not tell that of x and y.

    Heights have the unit of x and y if it says nothing else, or are in metres if x and y are angles.
    """
    horizontal, vertical, is_geographic = None, None, False
    for system in _systems(_nodes(text)):
        if system.keyword in _VERTICAL:
            vertical = _unit(system, 0)
        elif horizontal is None:
            is_cartesian = any(node.values[:1] == ["Cartesian"] for node in system.named("CS"))  # geocentric
            is_geographic = system.keyword in _GEOGRAPHIC and not is_cartesian
            horizontal = _unit(system, 0, is_geographic)
            vertical = _unit(system, 2, is_geographic) or vertical
    return None if horizontal is None else _units(horizontal, vertical, is_geographic)


def _units(horizontal: float, vertical: float | None, is_geographic: bool) -> Units:
    """Return the units of x, y and z, of which that of z may not be known."""
    return Units(horizontal, vertical or (1.0 if is_geographic else horizontal), is_geographic)


def _nodes(text: str) -> list[_Node]:
    """Return the nodes of a text of WKT, of which some programs join two; none if it is damaged."""
    stack, position = [_Node("")], 0
    while position < len(text) <= LENGTH and 0 < len(stack) <= DEPTH:
        token = _TOKEN.match(text, position)
        if not token:
            return []
        position = token.end()
        if token["open"]:
            keyword = stack[-1].values.pop() if stack[-1].values else ""
            stack[-1].nodes.append(_Node(keyword.upper()))
            stack.append(stack[-1].nodes[-1])
        elif token["close"]:
            stack.pop()
        else:
            stack[-1].values += [value for value in (token["text"], token["word"]) if value is not None]
    return stack[0].nodes if len(stack) == 1 else []


def _systems(nodes: list[_Node]) -> Iterator[_Node]:
    """Yield the systems of which a system consists."""
    for node in nodes:
        if node.keyword in _WITHIN:
            yield from _systems(node.nodes)
        elif node.keyword in (*_GEOGRAPHIC, *_IN_LENGTHS, *_VERTICAL):
            yield node


def _unit(system: _Node, axis: int, is_geographic: bool = False) -> float | None:
    """Return the unit of an axis of a system: in metres, or in radians for the first two of a geographic one."""
    axes, kinds = system.named("AXIS"), ("LENGTHUNIT", "UNIT")
    if is_geographic:
        kinds = ("ANGLEUNIT", "UNIT") if axis < 2 else ("LENGTHUNIT", "")
    elif axis == 2 and len(axes) < 3:
        return None
    units = [*(axes[axis].named(*kinds) if axis < len(axes) else ()), *system.named(*kinds)[-1:]]
    try:
        value = float(units[0].values[1])
    except (IndexError, ValueError):
        return None
    return value if 0.0 < value < math.inf else None


def units_of_keys(keys: Mapping[int, int]) -> Units | None:
    """Return the units that GeoTIFF keys tell by their codes; None if they do not tell that of x and y."""
    geographic, projected = 2048 in keys, 3072 in keys or 3076 in keys
    is_geographic = keys.get(1024, 2 if geographic and not projected else 1) == 2  # GTModelTypeGeoKey
    # GeogAngularUnitsGeoKey or ProjLinearUnitsGeoKey
    horizontal = _ANGLES.get(keys.get(2054, 9102)) if is_geographic else _LENGTH_UNITS.get(keys.get(3076, 0))
    if horizontal is None:
        return None
    # VerticalUnitsGeoKey, or what VerticalCSTypeGeoKey implies
    vertical = _LENGTH_UNITS.get(keys.get(4099, 0)) or _HEIGHTS.get(keys.get(4096, 0))
    return _units(horizontal, vertical, is_geographic)
