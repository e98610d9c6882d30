"""Tests which past selves are kept and met."""

import jax
import jax.numpy as jnp
import numpy as np

from drivetrain.learners import pasts

NUM_DRAWS = 3000
# Frequencies of a third stray by 0.0086 (one standard deviation); this is four times.
SAMPLING = 0.035


def params(number: int) -> dict[str, jax.Array]:
    return {"w": jnp.full(2, float(number))}


def drawn(ring: pasts.Pasts) -> np.ndarray:
    keys = jax.random.split(jax.random.key(0), NUM_DRAWS)
    draw = jax.vmap(lambda key: pasts.at(ring, pasts.draw(ring, key)))
    return np.asarray(draw(keys)["w"][:, 0])


def test_only_those_put_in_are_drawn() -> None:
    ring = pasts.begin(params(1), 3)
    assert (drawn(ring) == 1).all()
    ring = pasts.keep(ring, params(2), jnp.bool_(True))
    assert set(drawn(ring)) == {1, 2}


def test_the_newest_replace_the_oldest_and_are_drawn_alike() -> None:
    ring = pasts.begin(params(1), 3)
    for number in range(2, 6):
        ring = pasts.keep(ring, params(number), jnp.bool_(True))
        ring = pasts.keep(ring, params(99), jnp.bool_(False))
    values, counts = np.unique(drawn(ring), return_counts=True)
    np.testing.assert_array_equal(values, [3, 4, 5])
    np.testing.assert_allclose(counts / NUM_DRAWS, 1 / 3, atol=SAMPLING)
