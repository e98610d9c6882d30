"""Views one scenario of a bank: each accessor gathers just what is asked for.

The frame is the scenario's: the map frame of its file, moved so that the ego stands in
the origin at the current step.
"""

import functools

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from . import edge_search, geometry, map_search
from .data import edge_index, packed
from .data.bank import Bank
from .data.parts import POLYGONS
from .motion import Motion
from .records import Record
from .scene_records import Edge, Lights, PathSegments, Points, Segments, StopSigns


class Scene(Record):
    """One scenario of a bank, by its number."""

    bank: Bank
    index: Int[Array, ""]

    @property
    def current_step(self) -> Int[Array, ""]:
        """The last step of history."""
        return self.bank.current_step[self.index]

    @property
    def num_steps(self) -> Int[Array, ""]:
        """How many logged steps the scenario has."""
        return self.bank.num_steps[self.index]

    @property
    def object_mask(self) -> Bool[Array, " objects"]:
        """Which object slots the scenario uses."""
        slots = jnp.arange(self.bank.sizes.num_objects)
        return slots < self.bank.num_objects[self.index]

    @property
    def object_size(self) -> Float[Array, "objects 3"]:
        """Length, width and height of each object [m]; zero in empty slots."""
        size = self._objects(self.bank.object_size)
        return jnp.where(self.object_mask[:, None], size, 0.0)

    @property
    def object_type(self) -> Int[Array, " objects"]:
        """The ObjectType of each object; zero in empty slots."""
        kinds = self._objects(self.bank.object_type).astype(jnp.int32)
        return jnp.where(self.object_mask, kinds, 0)

    @property
    def goal_feasible(self) -> Bool[Array, " objects"]:
        """Whose log crosses no road edge on the way to its end (N app. E)."""
        return self._objects(self.bank.goal_feasible) & self.object_mask

    def log_at(self, step: Int[Array, ""]) -> Motion:
        """Returns the logged motion of all objects at a step; none is valid outside."""
        bits, is_still, first_row = map(
            self._objects,
            (self.bank.valid_bits, self.bank.is_still, self.bank.first_row),
        )
        return self._log(bits, is_still, first_row, step, self.object_mask)

    def log_of(self, number: Int[Array, ""]) -> Motion:
        """Returns the logged motion of one object at all steps of the bank."""
        place = self.bank.first_object[self.index] + number
        steps = jnp.arange(self.bank.sizes.num_steps)
        log = functools.partial(
            self._log,
            self.bank.valid_bits[place],
            self.bank.is_still[place],
            self.bank.first_row[place],
        )
        return jax.vmap(log, in_axes=(0, None))(steps, self.object_mask[number])

    def _log(self, bits, is_still, first_row, step, exists) -> Motion:
        """Gathers a step: its row is the number of valid steps before it.

        Objects that stand still have one row for all of them.
        """
        in_log = (step >= 0) & (step < self.num_steps)
        step = jnp.where(in_log, step, 0).astype(jnp.uint32)
        word, bit = step // 32, step % 32
        words = jnp.arange(bits.shape[-1], dtype=jnp.uint32)
        before = jnp.where(words == word, (jnp.uint32(1) << bit) - 1, 0)
        before = jnp.where(words < word, jnp.uint32(0xFFFFFFFF), before)
        before = jnp.broadcast_to(before, bits.shape)
        rank = jnp.sum(
            jax.lax.population_count(bits & before), axis=-1, dtype=jnp.int32
        )
        rank = jnp.where(is_still, 0, rank)
        is_set = (jnp.take(bits, word, axis=-1) >> bit) & 1
        return self._rows(first_row + rank, (is_set == 1) & in_log & exists)

    def log_end(self) -> Motion:
        """Returns the last valid logged motion of each object."""
        bits, is_still, first_row = map(
            self._objects,
            (self.bank.valid_bits, self.bank.is_still, self.bank.first_row),
        )
        count = jnp.sum(jax.lax.population_count(bits), axis=-1, dtype=jnp.int32)
        last = first_row + jnp.where(is_still, 0, count - 1)
        return self._rows(last, (count > 0) & self.object_mask)

    def _rows(self, row, valid) -> Motion:
        row = jnp.where(valid, row, 0)
        turns = self.bank.turns[row]
        yaw, velocity = turns[..., 0], turns[..., 1:]
        if not jnp.issubdtype(turns.dtype, jnp.floating):
            yaw = yaw * jnp.float32(packed.YAW_QUANTUM)
            velocity = velocity * jnp.float32(packed.QUANTUM)
        return Motion(
            xyz=jnp.where(valid[..., None], self._metres(self.bank.poses[row]), 0.0),
            yaw=jnp.where(valid, yaw, 0.0),
            velocity=jnp.where(valid[..., None], velocity, 0.0),
            valid=valid,
        )

    def lights_at(self, step: Int[Array, ""]) -> Lights:
        """Returns the traffic lights at a step; none is valid outside the log."""
        first = self.bank.first_light[self.index]
        count = self.bank.sizes.num_lights
        state = jax.lax.dynamic_slice_in_dim(self.bank.light_state, first, count)
        state = jnp.take(state, step, axis=1, mode="clip")
        in_log = (step >= 0) & (step < self.num_steps)
        slots = jnp.arange(count) < self.bank.num_lights[self.index]
        valid = (state >= packed.LIGHT_VALID) & in_log & slots
        xyz = jax.lax.dynamic_slice_in_dim(self.bank.light_xyz, first, count)
        yaw = jax.lax.dynamic_slice_in_dim(self.bank.light_yaw, first, count)
        has_lane = jax.lax.dynamic_slice_in_dim(self.bank.light_has_lane, first, count)
        has_lane &= valid
        return Lights(
            xyz=jnp.where(valid[:, None], self._metres(xyz), 0.0),
            state=jnp.where(valid, state % packed.LIGHT_VALID, 0).astype(jnp.int32),
            yaw=jnp.where(has_lane, self._radians(yaw), 0.0),
            has_lane=has_lane,
            valid=valid,
        )

    def map_segments(self) -> Segments:
        """Returns the whole map in pieces; signs are pieces of no length."""
        bank, count = self.bank, self.bank.sizes.num_vertices
        first = bank.first_vertex[self.index]
        stored = jax.lax.dynamic_slice_in_dim(bank.vertices, first, count)
        tag = jax.lax.dynamic_slice_in_dim(bank.vertex_tag, first, count)
        vertices, joined = self._metres(stored), tag >= packed.JOINED
        ended = jnp.roll(joined, 1).at[0].set(False)
        exists = jnp.arange(count) < bank.num_vertices[self.index]
        return Segments(
            start=vertices,
            end=jnp.where(joined[:, None], jnp.roll(vertices, -1, axis=0), vertices),
            map_type=(tag % packed.JOINED).astype(jnp.int32),
            valid=exists & (joined | ~ended),
        )

    def stop_signs(self) -> StopSigns:
        """Returns the stop signs."""
        bank, index, count = self.bank, self.index, self.bank.sizes.num_stop_signs
        vertex = bank.first_vertex[index] + bank.num_edge_vertices[index]
        sign = bank.first_stop_sign[index]
        stored = jax.lax.dynamic_slice_in_dim(bank.vertices, vertex, count)
        yaw = jax.lax.dynamic_slice_in_dim(bank.stop_yaw, sign, count)
        has_lane = jax.lax.dynamic_slice_in_dim(bank.stop_has_lane, sign, count)
        valid = jnp.arange(count) < bank.num_stop_signs[index]
        has_lane &= valid
        return StopSigns(
            xyz=jnp.where(valid[:, None], self._metres(stored), 0.0),
            yaw=jnp.where(has_lane, self._radians(yaw), 0.0),
            has_lane=has_lane,
            valid=valid,
        )

    def nearest_pieces(
        self, xy: Float[Array, " 2"], count: int, radius: float, by_segment: bool
    ) -> Segments:
        """Returns the pieces of the map nearest to a place, nearest first.

        Args:
            xy: the place [m].
            count: how many to return; where fewer are near, the rest is not valid.
            radius: beyond which none is near [m].
            by_segment: whether the distance is that to the segment or to its start.
        """
        bank = self.bank
        near = map_search.nearest_pieces(
            bank, self.index, xy, map_search.Reach(count, radius, by_segment)
        )
        vertex = bank.first_vertex[self.index] + near.number
        tag = bank.vertex_tag[vertex]
        end = vertex + (tag >= packed.JOINED)
        return Segments(
            start=self._metres(bank.vertices[vertex]),
            end=self._metres(bank.vertices[end]),
            map_type=(tag % packed.JOINED).astype(jnp.int32),
            valid=near.valid,
        )

    def map_points(self, numbers: Int[Array, " points"]) -> Points:
        """Returns points of the map, each with the one that follows it.

        Polygons end with their last corner: the point that closes them is left out.
        """
        pair = self.bank.first_vertex[self.index] + numbers[:, None]
        pair = pair + jnp.arange(2)[None]
        xyz = self._metres(self.bank.vertices[pair])
        tag = self.bank.vertex_tag[pair]
        joined = tag >= packed.JOINED
        map_type = (tag[:, 0] % packed.JOINED).astype(jnp.int32)
        closes = jnp.isin(map_type, jnp.array(POLYGONS))[:, None] & ~joined
        has_next = joined[:, 0] & ~closes[:, 1]
        return Points(
            xyz=xyz[:, 0],
            next_xyz=jnp.where(has_next[:, None], xyz[:, 1], xyz[:, 0]),
            map_type=map_type,
            valid=(numbers < self.bank.num_vertices[self.index]) & ~closes[:, 0],
        )

    def nearest_edge(
        self, points: Float[Array, "points 3"], valid: Bool[Array, ""] | bool = True
    ) -> Edge:
        """Finds the nearest road edge of each point and the side on which it lies.

        Nearest is meant in (x, y, 2 z); the distance is planar. The road lies to the
        left of an edge; where the nearest place is a vertex, the edges that meet there
        decide together (see `pack`).

        Args:
            points: where to look [m].
            valid: whether to look at all.
        """
        valid = jnp.broadcast_to(valid, points.shape[:1])
        found = edge_search.nearest_vertices(self.bank, self.index, points, valid)
        return jax.vmap(self._edge)(points, found)

    def _edge(self, point: Float[Array, " 3"], number: Int[Array, ""]) -> Edge:
        """Returns where a point lies relative to the edge after a vertex."""
        bank, exists = self.bank, number >= 0
        number = jnp.maximum(number, 0)
        vertex = bank.first_vertex[self.index] + number
        ends = self._metres(bank.vertices[vertex + jnp.arange(2)])
        stretch = jnp.array([1.0, 1.0, edge_index.HEIGHT_WEIGHT])
        share = geometry.nearest_on_segment(
            point * stretch, ends[0] * stretch, ends[1] * stretch
        )
        along = ends[1, :2] - ends[0, :2]
        planar = point[:2] - ends[0, :2] - share * along

        at_end = (share >= 1.0).astype(jnp.int32)
        normal = bank.edge_normal[bank.first_edge[self.index] + number + at_end]
        inside = (share > 0.0) & (share < 1.0)
        left = jnp.where(
            inside,
            jnp.stack([-along[1], along[0]]),
            geometry.direction(self._radians(normal)),
        )
        off_road = geometry.dot(planar, left) < 0
        distance = geometry.norm(planar)
        signed = jnp.where(off_road, distance, -distance)
        return Edge(signed_distance=jnp.where(exists, signed, -jnp.inf), valid=exists)

    def touches_edge(
        self,
        xyz: Float[Array, " 3"],
        yaw: Float[Array, ""],
        size: Float[Array, " 3"],
        level: float,
    ) -> Bool[Array, ""]:
        """Tells whether a closed box, seen from above, meets a road edge.

        Args:
            xyz: the box's centre [m].
            yaw: of the box [rad].
            size: length, width and height [m].
            level: edge segments whose middle lies more than this [m] above or below
                the centre are not looked at.
        """
        box = map_search.FlatBox(xyz=xyz, yaw=yaw, size=size)
        return map_search.touches_edge(self.bank, self.index, box, level)

    def path_segments(self) -> PathSegments:
        """Returns the ways that the ego could take, in pieces."""
        bank, index = self.bank, self.index
        first, count = bank.first_path_vertex[index], bank.sizes.num_path_vertices
        cut = functools.partial(
            jax.lax.dynamic_slice_in_dim, start_index=first, slice_size=count
        )
        xy = cut(bank.path_vertices)
        xy = bank.centre[index, None, :2] + bank.quantum[index] * xy
        number = cut(bank.path_number).astype(jnp.int32)
        has_next = jnp.arange(count) + 1 < bank.num_path_vertices[index]
        valid = has_next & (number == jnp.roll(number, -1))
        path = bank.first_path[index] + jnp.where(valid, number, 0)
        limit = jnp.where(valid, cut(bank.path_limit), 0)
        return PathSegments(
            start=xy,
            end=jnp.where(valid[:, None], jnp.roll(xy, -1, axis=0), xy),
            arc=cut(bank.path_arc),
            path=number,
            speed_limit=limit * jnp.float32(packed.LIMIT_QUANTUM),
            is_limited=limit > 0,
            on_route=bank.path_on_route[path] & valid,
            log_arc=bank.path_log_arc[path],
            valid=valid,
        )

    def _objects(self, table: Array) -> Array:
        first = self.bank.first_object[self.index]
        count = self.bank.sizes.num_objects
        return jax.lax.dynamic_slice_in_dim(table, first, count)

    def _radians(self, stored: Array) -> Array:
        if jnp.issubdtype(stored.dtype, jnp.floating):
            return stored
        return stored * jnp.float32(packed.YAW_QUANTUM)

    def _metres(self, stored: Array) -> Array:
        metres = self.bank.quantum[self.index] * stored
        return jnp.broadcast_to(self.bank.centre[self.index], metres.shape) + metres
