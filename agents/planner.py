"""Drives by forecasts: plans along the likeliest, and plans anew when that is done."""

import dataclasses

import jax.numpy as jnp
from flax import nnx

from ..sim import ranges
from ..sim.observations.base import Observation
from . import modes, plan
from .base import Output
from .encoders.wayformer import Wayformer, WayformerConfig
from .heads.trajectory import TrajectoryConfig, TrajectoryHead
from .plan import Plan, Planned
from .trajectories import Trajectories


@dataclasses.dataclass(frozen=True, kw_only=True)
class PlannerConfig:
    """How a forecast becomes a plan."""

    num_steps: int = 5  # of a plan, from one look to the next
    num_modes: int = 6  # into which a forecast is merged, to take the likeliest
    threshold: float = 2.5  # how far apart their members' ends may be [m]
    num_refinements: int = 3  # of the merging

    def __post_init__(self) -> None:
        """Checks the ranges.

        Raises:
            ValueError: if a count is too small or the threshold is negative.
        """
        ranges.require_at_least(
            self, num_steps=1, num_modes=1, threshold=0, num_refinements=0
        )


class Planner(nnx.Module):
    """The Wayformer agent (Gulino et al. 2023, 5.2).

    It forecasts its own trajectories, merges them into a few, and takes the first steps
    of the most likely, five by default, before it looks again.

    Worlds that play side by side are one program, which forecasts at every step and
    keeps every fifth: batched, the network costs five times what it has to.
    """

    def __init__(
        self,
        encoder: WayformerConfig,
        head: TrajectoryConfig,
        config: PlannerConfig,
        observation: Observation,
        *,
        rngs: nnx.Rngs,
    ):
        """Draws parameters for observations of this one's groups and shapes."""
        self.encoder = Wayformer(encoder, observation, rngs=rngs)
        self.head = TrajectoryHead(encoder.width, head, rngs=rngs)
        self.config = config

    def forecast(self, observation: Observation) -> Trajectories:
        """Returns where the viewer may go."""
        return self.head(*self.encoder.encode(observation))

    def __call__(self, memory: Plan, observation: Observation) -> tuple[Plan, Output]:
        """Follows the plan, or a fresh one where it is done."""
        forecast = self.forecast(observation)
        config = self.config
        merged = modes.aggregate(
            forecast, config.num_modes, config.threshold, config.num_refinements
        )
        fresh = plan.along(merged.mode()[: config.num_steps])
        memory, action = plan.continued(memory, fresh)
        policy = Planned(action=action, forecast=forecast)
        return memory, Output(policy=policy, value=jnp.zeros(()))
