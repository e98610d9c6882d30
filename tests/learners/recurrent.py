"""A small agent with memory, for learners that must go through steps in a row."""

import jax
import jax.numpy as jnp

from drivetrain.agents.base import Agent, Memory, Output
from drivetrain.agents.distributions import Categorical
from drivetrain.sim.observations.base import Observation
from tests.learners import probes

WIDTH = 8


def gru_agent() -> Agent:
    """Builds a gated recurrent unit (Cho et al. 2014) with linear outputs."""

    def init(key: jax.Array) -> dict[str, jax.Array]:
        gate_key, new_key, out_key = jax.random.split(key, 3)
        num_inputs = probes.NUM_FEATURES + WIDTH
        scale = num_inputs**-0.5
        return {
            "gates": scale * jax.random.normal(gate_key, (num_inputs, 2 * WIDTH)),
            "new": scale * jax.random.normal(new_key, (num_inputs, WIDTH)),
            "out": 0.1 * jax.random.normal(out_key, (WIDTH + probes.NUM_FEATURES, 3)),
        }

    def step(
        params: dict[str, jax.Array], memory: Memory, observation: Observation
    ) -> tuple[Memory, Output]:
        seen = observation["coin"].values.reshape(-1)
        gates = jax.nn.sigmoid(jnp.append(seen, memory) @ params["gates"])
        keep, use = gates[:WIDTH], gates[WIDTH:]
        new = jnp.tanh(jnp.append(seen, use * memory) @ params["new"])
        memory = keep * memory + (1 - keep) * new
        values = jnp.append(seen, memory) @ params["out"]
        return memory, Output(policy=Categorical(logits=values[:2]), value=values[2])

    return Agent(init=init, memory=lambda: jnp.zeros(WIDTH), step=step)
