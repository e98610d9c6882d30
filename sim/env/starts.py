"""Says how episodes begin: when, and how far off the log."""

import dataclasses

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int, PRNGKeyArray

from .. import geometry, motions, ranges
from ..metrics.build import EGO
from ..motion import Motion
from ..scene import Scene


@dataclasses.dataclass(frozen=True, kw_only=True)
class StartConfig:
    """How far an episode may begin from the log at its current step; not at all as is.

    Noise is Gaussian, on the first pose of each controlled object. Its past stays as
    logged.
    """

    position_noise: float = 0.0  # standard deviation along x and y each [m]
    yaw_noise: float = 0.0  # radians; turns the velocity too
    speed_noise: float = 0.0  # metres per second, along the heading
    latest: int = 0  # steps after the current one, up to which any is as likely

    def __post_init__(self) -> None:
        """Checks the ranges.

        Raises:
            ValueError: if a deviation is no number of at least 0, or `latest` is
                negative.
        """
        ranges.require_finite(
            self, "position_noise", "yaw_noise", "speed_noise", "latest"
        )

    @property
    def has_noise(self) -> bool:
        """Whether first poses are off the log."""
        return max(self.position_noise, self.yaw_noise, self.speed_noise) > 0


AS_LOGGED = StartConfig()


class StartScene(Scene):
    """A scenario as an episode sees it, whose first step is the current one."""

    start: Int[Array, ""]
    key: PRNGKeyArray  # of all that is random in the episode: see `lot_key`

    @property
    def current_step(self) -> Int[Array, ""]:
        """The step with which the episode begins."""
        return self.start


def lot_key(scene: Scene, number: int) -> PRNGKeyArray:
    """Returns the key by which something is drawn once an episode.

    Args:
        scene: of the episode as it begins.
        number: of what is drawn; each has one of its own.

    Raises:
        TypeError: if no episode begins.
    """
    if not isinstance(scene, StartScene):
        raise TypeError("lots are drawn as an episode begins, of its StartScene.")
    return jax.random.fold_in(scene.key, number)


def choose(config: StartConfig, scene: Scene, key: PRNGKeyArray) -> Int[Array, ""]:
    """Returns the step with which an episode begins.

    At least one step is left to simulate. Where the log lacks the ego at the step
    drawn, the episode begins at the current one.
    """
    current = scene.current_step
    if not config.latest:
        return current
    latest = jnp.clip(scene.num_steps - 2 - current, 0, config.latest)
    step = current + jax.random.randint(key, (), 0, latest + 1)
    return jnp.where(scene.log_at(step).valid[EGO], step, current)


def disturb(
    config: StartConfig,
    motion: Motion,
    mask: Bool[Array, " objects"],
    key: PRNGKeyArray,
) -> Motion:
    """Puts the objects of the mask off the log."""
    if not config.has_noise:
        return motion
    place_key, yaw_key, speed_key = jax.random.split(key, 3)
    shift = config.position_noise * jax.random.normal(place_key, motion.xy.shape)
    turn = config.yaw_noise * jax.random.normal(yaw_key, motion.yaw.shape)
    push = config.speed_noise * jax.random.normal(speed_key, motion.yaw.shape)
    yaw = geometry.wrap_angle(motion.yaw + turn)
    velocity = geometry.from_frame(motion.velocity, turn)
    disturbed = motion.replace(
        xyz=motion.xyz.at[:, :2].add(shift),
        yaw=yaw,
        velocity=velocity + push[:, None] * geometry.direction(yaw),
    )
    return motions.where(mask & motion.valid, disturbed, motion)
