"""Reads the traffic signs of CommonRoad: speed limits and stops."""

import dataclasses
from collections.abc import Iterable
from xml.etree.ElementTree import Element

import numpy as np
from jaxtyping import Float

from . import commonroad_values as values
from .lane_map import Lane

# Numbers in the catalogues of Germany and the United States.
_SPEED_LIMITS = frozenset({"274", "R2-1"})
_STOPS = frozenset({"206", "R1-1"})


@dataclasses.dataclass(frozen=True, kw_only=True)
class Signs:
    """The signs of a scenario, and the lanes that they rule."""

    limits: dict[int, float]  # by sign [m/s]
    stops: list[tuple[int, int]]  # a stop sign and a lane that it stops
    places: dict[int, tuple[float, float, float]]  # of signs that have one [m]

    def speed_limit(self, lanelet: Element) -> float:
        """Returns the lowest limit of a lanelet [m/s], 0 where there is none.

        Version 2018b writes it into the lanelet, 2020a on the signs it refers to.

        Raises:
            ScenarioError: if a limit is no number.
        """
        found = [self.limits[s] for s in _signs_of(lanelet) if s in self.limits]
        found += [
            values.number(limit, "the speed limit of a lanelet")
            for limit in lanelet.iterfind("speedLimit")
        ]
        return min(found, default=0.0)

    def stop_places(
        self, lanes: Iterable[Lane]
    ) -> list[tuple[int, Float[np.ndarray, "1 3"]]]:
        """Returns where the stop signs are, if not told at the end of a lane."""
        ends = {lane.lane_id: lane.end for lane in lanes}
        found = {}
        for sign, lane in self.stops:
            if sign in self.places:
                found[sign] = np.array([self.places[sign]])
            elif lane in ends:
                found.setdefault(sign, ends[lane][None])
        return list(found.items())


def read(root: Element) -> Signs:
    """Reads the signs of a document.

    Raises:
        ScenarioError: if a sign is malformed.
    """
    limits, stop_signs, places = {}, set(), {}
    for sign in root.iterfind("trafficSign"):
        sign_id = values.integer(sign.get("id"), "'id' of a trafficSign")
        for element in sign.iterfind("trafficSignElement"):
            name = (element.findtext("trafficSignID") or "").strip()
            if name in _SPEED_LIMITS:
                value = element.find("additionalValue")
                limits[sign_id] = values.number(value, f"the limit of sign {sign_id}")
            if name in _STOPS:
                stop_signs.add(sign_id)
        if sign.find("position/point") is not None:
            places[sign_id] = values.centre(sign.find("position"), f"sign {sign_id}")
    stops = [
        (sign, values.integer(lanelet.get("id"), "'id' of a lanelet"))
        for lanelet in root.iterfind("lanelet")
        for sign in _signs_of(lanelet)
        if sign in stop_signs
    ]
    return Signs(limits=limits, stops=stops, places=places)


def _signs_of(lanelet: Element) -> list[int]:
    """Returns the signs to which a lanelet refers, itself or where traffic stops."""
    return [
        *values.references(lanelet, "trafficSignRef"),
        *values.references(lanelet, "stopLine/trafficSignRef"),
    ]
