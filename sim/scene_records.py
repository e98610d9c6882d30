"""States what a scene shows of its map: lights, signs, pieces, paths, edges."""

from jaxtyping import Array, Bool, Float, Int

from .records import Record


class Lights(Record):
    """The traffic lights of a scenario at one step."""

    xyz: Float[Array, "lights 3"]  # stop points [m]
    state: Int[Array, " lights"]  # LightState
    yaw: Float[Array, " lights"]  # of the lane at the stop point; zero without lane
    has_lane: Bool[Array, " lights"]  # whether the lane is in the map
    valid: Bool[Array, " lights"]


class StopSigns(Record):
    """The stop signs of a scenario."""

    xyz: Float[Array, "signs 3"]  # where they stand [m]
    yaw: Float[Array, " signs"]  # of a lane that the sign stops; zero without lane
    has_lane: Bool[Array, " signs"]  # whether the map tells that lane
    valid: Bool[Array, " signs"]


class Segments(Record):
    """Pieces of map features: a straight piece, or a point where both ends agree."""

    start: Float[Array, "segments 3"]  # metres
    end: Float[Array, "segments 3"]  # metres
    map_type: Int[Array, " segments"]  # MapType
    valid: Bool[Array, " segments"]


class Points(Record):
    """Points of map features, each with the one that follows it in its feature."""

    xyz: Float[Array, "points 3"]  # metres
    next_xyz: Float[Array, "points 3"]  # metres; of the last point, itself
    map_type: Int[Array, " points"]  # MapType
    valid: Bool[Array, " points"]


class PathSegments(Record):
    """Pieces of the ways that the ego could take."""

    start: Float[Array, "segments 2"]  # metres
    end: Float[Array, "segments 2"]  # metres
    arc: Float[Array, " segments"]  # of the start, along its path [m]
    path: Int[Array, " segments"]
    speed_limit: Float[Array, " segments"]  # metres per second; zero without limit
    is_limited: Bool[Array, " segments"]  # whether the map tells the limit
    on_route: Bool[Array, " segments"]
    log_arc: Float[Array, "segments 2"]  # of the log's first and last position [m]
    valid: Bool[Array, " segments"]


class Edge(Record):
    """The nearest road edge of a point."""

    signed_distance: Float[Array, ""]  # metres, positive off the road
    valid: Bool[Array, ""]  # False if the scenario has no road edge
