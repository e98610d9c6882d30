"""Takes numbers, places and references out of the XML of CommonRoad."""

from collections.abc import Sequence
from xml.etree.ElementTree import Element

import numpy as np
from jaxtyping import Float

from ..scenario import ScenarioError

_AXES = ("x", "y", "z")
_CENTRES = ("point", "rectangle/center", "circle/center")


def number(element: Element | None, place: str) -> float:
    """Returns a number that is exact, or the middle of an interval.

    Args:
        element: `<exact>`, `<intervalStart>` and `<intervalEnd>`, or the number itself.
        place: how a sentence is to name the element.

    Raises:
        ScenarioError: if it is missing, or no finite number.
    """
    if element is None:
        raise ScenarioError(f"{place} is missing")
    interval = element.find("intervalStart"), element.find("intervalEnd")
    if interval[0] is not None and interval[1] is not None:
        return (_float(interval[0], place) + _float(interval[1], place)) / 2
    exact = element.find("exact")
    return _float(element if exact is None else exact, place)


def integer(text: str | None, place: str) -> int:
    """Returns an id.

    Raises:
        ScenarioError: if it is missing, or no integer of 64 bits.
    """
    try:
        value = int(text or "")
    except ValueError:
        value = None
    if value is None or not -(2**63) <= value < 2**63:
        raise ScenarioError(f"{place} must be an integer, got {text!r:.40}")
    return value


def references(element: Element, tag: str) -> tuple[int, ...]:
    """Returns the ids to which the children of a tag refer.

    Raises:
        ScenarioError: if one is no integer.
    """
    return tuple(
        integer(child.get("ref"), f"'ref' of a {tag}")
        for child in element.iterfind(tag)
    )


def point(element: Element, place: str) -> tuple[float, float, float]:
    """Returns the coordinates of a point [m]; z is 0 where it is not given.

    Raises:
        ScenarioError: if x or y is missing, or one is no finite number.
    """
    x, y, z = (element.find(axis) for axis in _AXES)
    return number(x, place), number(y, place), 0.0 if z is None else number(z, place)


def points(element: Element | None, place: str) -> Float[np.ndarray, "points 3"]:
    """Returns the points that an element lists [m].

    Raises:
        ScenarioError: if the element is missing, or a coordinate.
    """
    if element is None:
        raise ScenarioError(f"{place} is missing")
    children = element.findall("point")
    found = _columns(children, _AXES)
    if found is None:
        found = np.array([point(child, place) for child in children])
    return found.reshape(-1, 3)


def centre(element: Element | None, place: str) -> tuple[float, float, float]:
    """Returns a position [m]: a point, or the centre of the shape that it lies in.

    Raises:
        ScenarioError: if it has neither.
    """
    if element is None:
        raise ScenarioError(f"{place} is missing")
    for path in _CENTRES:
        found = element.find(path)
        if found is not None:
            return point(found, place)
    corners = points(element.find("polygon"), place)
    if not len(corners):
        raise ScenarioError(f"{place} has no point")
    x, y, z = ((corners.min(axis=0) + corners.max(axis=0)) / 2).tolist()
    return x, y, z


def numbers(
    elements: Sequence[Element], path: str, place: str
) -> Float[np.ndarray, " elements"]:
    """Returns the number that each element has at a path, as `number` does.

    Raises:
        ScenarioError: if one is missing, or no finite number.
    """
    found = _columns(elements, (f"{path}/exact",))
    if found is None:
        return np.array([number(element.find(path), place) for element in elements])
    return found[:, 0]


def centres(
    elements: Sequence[Element], path: str, place: str
) -> Float[np.ndarray, "elements 3"]:
    """Returns the position that each element has at a path [m], as `centre` does.

    Raises:
        ScenarioError: if one is missing.
    """
    found = _columns(elements, tuple(f"{path}/point/{axis}" for axis in _AXES))
    if found is None:
        found = np.array([centre(element.find(path), place) for element in elements])
    return found.reshape(-1, 3)


def _columns(
    elements: Sequence[Element], paths: tuple[str, ...]
) -> Float[np.ndarray, "elements paths"] | None:
    """Returns plain numbers at paths; None where some are missing or otherwise told.

    A log has 10,000 of them, nearly all of one form: this is the quick way. Heights may
    be missing from all.
    """
    texts = [[element.findtext(path) for element in elements] for path in paths]
    if len(paths) == len(_AXES) and not any(texts[-1]):
        texts[-1] = ["0"] * len(elements)
    try:
        found = np.array([[float(text or "") for text in row] for row in texts])
    except ValueError:
        return None
    return found.T if np.isfinite(found).all() else None


def _float(element: Element, place: str) -> float:
    try:
        value = float(element.text or "")
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise ScenarioError(
            f"{place} must be a finite number, got {element.text!r:.40}"
        )
    return value
