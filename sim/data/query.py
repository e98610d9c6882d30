"""Chooses scenarios by what a manifest says of them."""

import dataclasses

from .entry import Entry

MOVING = 0.2  # metres that a moving ego gets away, at least (N app. A, of vehicles)
INTERACTIVE = 3.0  # seconds between the ego and another at one place, at most


@dataclasses.dataclass(frozen=True, kw_only=True)
class Query:
    """Which scenarios are wanted; what is None or 0 does not matter."""

    moving_ego: bool | None = None  # gets over 0.2 m away after the current step
    interactive: bool | None = None  # another comes where the ego is, within 3 s
    junction: bool | None = None  # a lane crosses the ego's way
    feasible_goal: bool | None = None  # the ego's log crosses no road edge (N app. E)
    lights: bool | None = None  # has traffic lights
    min_objects: int = 0
    max_objects: int | None = None
    dataset: str | None = None  # the reader that made it, such as womd_scenario

    def __post_init__(self) -> None:
        """Checks the counts.

        Raises:
            ValueError: if one is negative, or no count of objects is between them.
        """
        for name in ("min_objects", "max_objects"):
            if (getattr(self, name) or 0) < 0:
                raise ValueError(
                    f"{name} must be at least 0, got {getattr(self, name)}."
                )
        if self.max_objects is not None and self.max_objects < self.min_objects:
            raise ValueError(
                f"no scenario has at least {self.min_objects} and at most "
                f"{self.max_objects} objects; exchange min_objects and max_objects."
            )

    @property
    def is_open(self) -> bool:
        """Whether every scenario is wanted."""
        return self == EVERYTHING

    def conditions(self) -> dict[str, "Query"]:
        """Returns each condition alone, by its text, such as `lights=true`."""
        fields = {field.name: field for field in dataclasses.fields(self)}
        found = {}
        for name, value in dataclasses.asdict(self).items():
            if value != fields[name].default:
                text = str(value).lower() if isinstance(value, bool) else value
                alone = dataclasses.replace(EVERYTHING, **{name: value})
                found[f"{name}={text}"] = alone
        return found

    def matches(self, entry: Entry) -> bool:
        """Tells whether a scenario is wanted."""
        encounter = entry.encounter
        facts = (
            (self.moving_ego, entry.ego_distance > MOVING),
            (self.interactive, encounter is not None and encounter <= INTERACTIVE),
            (self.junction, entry.is_at_junction),
            (self.feasible_goal, entry.is_goal_feasible),
            (self.lights, entry.num_lights > 0),
            (self.dataset, entry.dataset),
        )
        most = self.max_objects
        fits = most is None or entry.num_objects <= most
        return (
            all(wanted in (None, fact) for wanted, fact in facts)
            and entry.num_objects >= self.min_objects
            and fits
        )


EVERYTHING = Query()
