"""A toy task for learners: the expert acts on one token of a bank of random tokens."""

from collections.abc import Callable

import jax
import jax.numpy as jnp

from drivetrain.agents import build as agents
from drivetrain.agents.base import Agent, Memory, Output
from drivetrain.agents.distributions import Categorical
from drivetrain.agents.encoders.wayformer import WayformerConfig
from drivetrain.sim.data import dealing
from drivetrain.sim.data.stratum import Stratum
from drivetrain.sim.dynamics.base import ActionSpec, Discrete
from drivetrain.sim.env.demonstrations import Demonstration, Sample
from drivetrain.sim.observations.base import Observation, TokenGroup

NUM_TOKENS, NUM_STEPS, NUM_FEATURES = 6, 4, 2
NUM_STRATA = 8  # as learners have if nobody says otherwise
SMALL = agents.AgentConfig(
    encoder=WayformerConfig(width=16, num_heads=2, num_layers=1, num_latents=2),
    hidden_width=16,
    num_hidden_layers=2,
    num_components=3,
)


def bank(num_devices: int, num_scenarios: int = 512) -> dict[str, jax.Array]:
    """Draws tokens, and deals them out to the devices, its leading axis."""
    shape = (num_scenarios, NUM_TOKENS, NUM_STEPS, NUM_FEATURES)
    tokens = jax.random.normal(jax.random.key(7), shape)
    dealt = dealing.by_stratum(num_scenarios, num_devices, NUM_STRATA)
    return {"tokens": tokens[jnp.array(dealt)]}


def first_token(values: jax.Array) -> Observation:
    """Shows a first token, and the others as absent but left in place."""
    mask = jnp.zeros((NUM_TOKENS, NUM_STEPS), bool).at[0].set(True)
    return {"objects": TokenGroup(values=values, mask=mask)}


def sampler(
    act: Callable[[jax.Array], jax.Array], see: Callable = first_token
) -> Sample:
    """Makes a `sample` whose expert does `act(values)` on seeing `see(values)`."""

    def sample(
        bank: dict[str, jax.Array], stratum: Stratum, key: jax.Array
    ) -> Demonstration:
        count = len(bank["tokens"]) // stratum.stride
        turn = jax.random.randint(key, (), 0, count)
        values = bank["tokens"][stratum.first + stratum.stride * turn]
        return Demonstration(
            observation=see(values), action=act(values), weight=jnp.ones(())
        )

    return sample


def sign(values: jax.Array) -> jax.Array:
    """Acts on the sign of the first feature of the first token, at its last step."""
    return (values[0, -1, 0] > 0).astype(jnp.int32)


def agent(action_spec: ActionSpec = Discrete(2)) -> Agent:  # noqa: B008 (frozen)
    """Builds a small agent for the observations above."""
    values = jnp.zeros((NUM_TOKENS, NUM_STEPS, NUM_FEATURES))
    return agents.build(SMALL, first_token(values), action_spec)


def linear_agent() -> Agent:
    """Builds an agent that compiles at once: logits linear in what is present."""
    num_values = NUM_TOKENS * NUM_STEPS * NUM_FEATURES

    def logits(params: jax.Array, observation: Observation) -> jax.Array:
        group = observation["objects"]
        present = jnp.where(group.mask[..., None], group.values, 0.0)
        return present.reshape(-1) @ params

    return softmax(lambda key: jax.random.normal(key, (num_values, 2)), logits)


def softmax(init: Callable, logits: Callable) -> Agent:
    """Builds an agent without memory from its logits of parameters and observation."""

    def step(
        params: jax.Array, memory: Memory, observation: Observation
    ) -> tuple[Memory, Output]:
        policy = Categorical(logits=logits(params, observation))
        return memory, Output(policy=policy, value=jnp.zeros(()))

    return Agent(init=init, memory=lambda: (), step=step)
