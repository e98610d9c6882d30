"""Builds an agent from its config."""

import dataclasses
from dataclasses import field
from typing import Literal

import jax
import jax.numpy as jnp
from flax import nnx
from jaxtyping import Array, Float, Key

from ..sim import ranges
from ..sim.dynamics.base import ActionSpec, Discrete
from ..sim.observations.base import Observation
from . import plan
from .base import Agent, Memory, Output, Params
from .distributions import ActionValues
from .encoders.flat import FlatConfig, FlatEncoder
from .encoders.mlp import ResidualMLP
from .encoders.wayformer import Wayformer, WayformerConfig
from .heads.action_values import ActionValueHead, DuelingHead
from .heads.factored import FactoredCategoricalHead
from .heads.policy import policy_head
from .heads.trajectory import TrajectoryConfig
from .heads.value import ValueHead
from .planner import Planner, PlannerConfig
from .recurrent import GRU

EncoderConfig = WayformerConfig | FlatConfig
# What a learner asks of an agent: a policy, with a critic or without, what each action
# is worth, or where it may go.
Kind = Literal["policy", "actor_critic", "action_values", "trajectories"]


@dataclasses.dataclass(frozen=True, kw_only=True)
class AgentConfig:
    """The network: an encoder, what follows it, and details of its heads.

    Forecasts of trajectories come from the encoder's tokens, and drive by plans.
    """

    encoder: EncoderConfig = field(default_factory=WayformerConfig)
    hidden_width: int = 128  # of the perceptron behind the encoder
    num_hidden_layers: int = 4  # of it; 0 leaves it out
    memory_width: int = 0  # of a gated recurrent unit behind them; 0 leaves it out
    num_components: int = 10  # of the mixture over continuous actions
    factored: bool = False  # of numbered actions, each number has outputs of its own
    dueling: bool = False  # action values are those of a state and of advantages
    trajectory: TrajectoryConfig = field(default_factory=TrajectoryConfig)
    planner: PlannerConfig = field(default_factory=PlannerConfig)

    def __post_init__(self) -> None:
        """Checks the sizes.

        Raises:
            ValueError: if a size is too small, or a plan exceeds the forecast.
        """
        ranges.require_at_least(
            self, hidden_width=1, num_hidden_layers=0, memory_width=0, num_components=1
        )
        for name in ("num_steps", "num_modes"):
            planned = getattr(self.planner, name)
            forecast = getattr(self.trajectory, name)
            if planned > forecast:
                raise ValueError(
                    f"planner.{name} must be at most trajectory.{name}, got {planned} "
                    f"and {forecast}."
                )


class _Network(nnx.Module):
    """Encoder, perceptron, memory and heads."""

    def __init__(
        self,
        config: AgentConfig,
        observation: Observation,
        action_spec: ActionSpec,
        kind: Kind,
        *,
        rngs: nnx.Rngs,
    ):
        self.encoder, width = _encoder(config.encoder, observation, rngs)
        mlp = memory = critic = None
        if config.num_hidden_layers:
            size = config.hidden_width
            mlp = ResidualMLP(width, size, config.num_hidden_layers, rngs=rngs)
            width = size
        if config.memory_width:
            memory = GRU(width, config.memory_width, rngs=rngs)
            width = config.memory_width
        self.head = _head(config, width, action_spec, kind, rngs)
        if kind == "actor_critic":
            critic = ValueHead(width, rngs=rngs)
        self.mlp, self.memory, self.critic = mlp, memory, critic

    def __call__(
        self, memory: Memory, observation: Observation
    ) -> tuple[Memory, Output]:
        features = self.encoder(observation)
        if self.mlp is not None:
            features = self.mlp(features)
        if self.memory is not None:
            memory, features = self.memory(memory, features)
        value = jnp.zeros(()) if self.critic is None else self.critic(features)
        return memory, Output(policy=self.head(features), value=value)


class _ActionValues(nnx.Module):
    """Values of actions as the greedy policy over them."""

    def __init__(self, values: ActionValueHead | DuelingHead):
        self.values = values

    def __call__(self, features: Float[Array, " features"]) -> ActionValues:
        return ActionValues(values=self.values(features))


def _encoder(config: EncoderConfig, observation: Observation, rngs: nnx.Rngs):
    if isinstance(config, FlatConfig):
        return FlatEncoder(config, observation, rngs=rngs), config.widths[-1]
    return Wayformer(config, observation, rngs=rngs), config.width


def _head(
    config: AgentConfig, width: int, spec: ActionSpec, kind: Kind, rngs: nnx.Rngs
) -> nnx.Module:
    has_values = kind == "action_values"
    if config.dueling and not has_values:
        raise ValueError(
            "only values of actions, as dqn learns them, are told in two parts; set "
            "agent.dueling=false."
        )
    if not (has_values or config.factored):
        return policy_head(width, spec, config.num_components, rngs=rngs)
    if not isinstance(spec, Discrete):
        raise ValueError(
            "values of actions and factored choices need numbered actions, such as "
            "those of dynamics=bicycle_discrete"
        )
    if not has_values:
        return FactoredCategoricalHead(width, spec.bins, rngs=rngs)
    head = DuelingHead if config.dueling else ActionValueHead
    bins = spec.bins if config.factored else (spec.num_actions,)
    return _ActionValues(head(width, bins, rngs=rngs))


def _planner(
    config: AgentConfig, observation: Observation, spec: ActionSpec, rngs: nnx.Rngs
) -> Planner:
    if spec != plan.ACTION_SPEC:
        raise ValueError(
            "the learner of forecasts drives from pose to pose; set dynamics=delta"
        )
    if not isinstance(config.encoder, WayformerConfig):
        raise ValueError(
            "forecasts attend to tokens, and the encoder flat has none; set "
            "agent.encoder.name=wayformer"
        )
    if config.memory_width:
        raise ValueError(
            f"who drives by forecasts remembers its plan alone; set "
            f"agent.memory_width=0, got {config.memory_width}."
        )
    return Planner(
        config.encoder, config.trajectory, config.planner, observation, rngs=rngs
    )


def build(
    config: AgentConfig,
    observation: Observation,
    action_spec: ActionSpec,
    kind: Kind = "policy",
) -> Agent:
    """Builds the agent that the config describes.

    Args:
        config: the network.
        observation: one observation of the kind to come; only its shapes are read, so
            the result of `jax.eval_shape` will do.
        action_spec: the actions to choose among.
        kind: what the agent is to say of an observation.

    Raises:
        ValueError: if the actions do not suit the kind or the head.
    """

    def network(key: Key[Array, ""]) -> _Network | Planner:
        rngs = nnx.Rngs(params=key)
        if kind == "trajectories":
            return _planner(config, observation, action_spec, rngs)
        return _Network(config, observation, action_spec, kind, rngs=rngs)

    # The object is taken apart once: what is traced per call is a pure function.
    graphdef = nnx.graphdef(nnx.eval_shape(network, jax.random.key(0)))

    def init(key: Key[Array, ""]) -> Params:
        return nnx.to_pure_dict(nnx.state(network(key)))

    def memory() -> Memory:
        if kind == "trajectories":
            return plan.none_yet(config.planner.num_steps)
        return jnp.zeros(config.memory_width) if config.memory_width else ()

    def step(
        params: Params, memory: Memory, observation: Observation
    ) -> tuple[Memory, Output]:
        state = nnx.restore_int_paths(params)
        return nnx.merge(graphdef, state)(memory, observation)

    return Agent(init=init, memory=memory, step=step)
