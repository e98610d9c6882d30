"""Makes scenarios of cars and lanes by hand."""

import numpy as np

from drivetrain.sim.scenario import (
    LaneLinks,
    Lights,
    MapType,
    ObjectType,
    Polylines,
    Scenario,
    Tracks,
)


def cars_on(
    lanes: dict[int, np.ndarray],
    xyz: np.ndarray,
    yaw: np.ndarray,
    size: tuple[float, float, float],
    links: LaneLinks | None = None,
) -> Scenario:
    """Returns a scenario in which cars are there at every step, the first the ego.

    Args:
        lanes: points by id, metres.
        xyz: of the cars [cars, steps, 3], metres.
        yaw: likewise [cars, steps], radians.
        size: of each of them, metres.
        links: between the lanes; None for no lane graph.
    """
    num_cars, num_steps, _ = xyz.shape
    return Scenario(
        scenario_id="hand",
        dataset="hand",
        current_step=10,
        tracks=Tracks(
            object_id=np.arange(num_cars),
            object_type=np.full(num_cars, int(ObjectType.VEHICLE)),
            xyz=xyz,
            yaw=yaw,
            velocity=np.gradient(xyz[..., :2], 0.1, axis=1),
            valid=np.ones((num_cars, num_steps), bool),
            size=np.tile(size, (num_cars, 1)),
            is_of_interest=np.zeros(num_cars, bool),
        ),
        ego_index=0,
        ego_source="marked",
        roads=Polylines(
            xyz=np.concatenate(list(lanes.values())),
            offset=np.cumsum([0, *map(len, lanes.values())]),
            map_type=np.full(len(lanes), int(MapType.LANE_SURFACE_STREET)),
            feature_id=np.array(list(lanes)),
        ),
        lights=Lights(
            lane_id=np.zeros(0, int),
            xyz=np.zeros((0, 3)),
            state=np.zeros((0, num_steps), int),
            valid=np.zeros((0, num_steps), bool),
        ),
        lane_links=links,
    )
