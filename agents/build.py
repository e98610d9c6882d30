"""Builds an agent from its config."""

import dataclasses

import jax
import jax.numpy as jnp
from flax import nnx
from jaxtyping import Array, Key

from ..sim.dynamics.base import ActionSpec
from ..sim.observations.base import Observation
from .base import Agent, Memory, Output, Params
from .encoders.mlp import ResidualMLP
from .encoders.wayformer import Wayformer, WayformerConfig
from .heads.policy import policy_head


@dataclasses.dataclass(frozen=True, kw_only=True)
class AgentConfig(WayformerConfig):
    """The size of the network: the fields of the encoder, then what follows it."""

    hidden_width: int = 128
    num_hidden_layers: int = 4
    num_components: int = 10  # of the mixture over continuous actions


class _Network(nnx.Module):
    """Encoder, residual perceptron and policy head."""

    def __init__(
        self,
        config: AgentConfig,
        observation: Observation,
        action_spec: ActionSpec,
        *,
        rngs: nnx.Rngs,
    ):
        self.encoder = Wayformer(config, observation, rngs=rngs)
        self.mlp = ResidualMLP(
            config.width, config.hidden_width, config.num_hidden_layers, rngs=rngs
        )
        self.head = policy_head(
            config.hidden_width, action_spec, config.num_components, rngs=rngs
        )

    def __call__(self, observation: Observation) -> Output:
        features = self.mlp(self.encoder(observation))
        return Output(policy=self.head(features), value=jnp.zeros(()))


def build(
    config: AgentConfig, observation: Observation, action_spec: ActionSpec
) -> Agent:
    """Builds the agent that the config describes.

    Args:
        config: the size of the network.
        observation: one observation of the kind to come; only its shapes are read, so
            the result of `jax.eval_shape` will do.
        action_spec: the actions to choose among.

    Raises:
        ValueError: if a size is below 1 or the heads do not divide the width.
    """
    for name, value in dataclasses.asdict(config).items():
        if value < 1:
            raise ValueError(f"{name} must be at least 1, got {value}.")
    if config.width % config.num_heads:
        raise ValueError(
            f"num_heads must divide width, got {config.num_heads} heads for a width of "
            f"{config.width}."
        )

    def network(key: Key[Array, ""]) -> _Network:
        return _Network(config, observation, action_spec, rngs=nnx.Rngs(params=key))

    # The object is taken apart once: what is traced per call is a pure function.
    graphdef = nnx.graphdef(nnx.eval_shape(network, jax.random.key(0)))

    def init(key: Key[Array, ""]) -> Params:
        return nnx.to_pure_dict(nnx.state(network(key)))

    def step(
        params: Params, memory: Memory, observation: Observation
    ) -> tuple[Memory, Output]:
        state = nnx.restore_int_paths(params)
        return memory, nnx.merge(graphdef, state)(observation)

    return Agent(init=init, memory=lambda: (), step=step)
