"""Tests of what perception adds to a generated log."""

import numpy as np

from drivetrain.sim.data.synthetic import noise, sight
from drivetrain.sim.data.synthetic.log import PlanarTracks
from drivetrain.sim.scenario import ObjectType

NUM_OBJECTS, NUM_STEPS = 200, 91


def straight(speed: float) -> PlanarTracks:
    """Returns cars that drive side by side along x, 2 m apart."""
    time = 0.1 * np.arange(NUM_STEPS)
    xy = np.zeros((NUM_OBJECTS, NUM_STEPS, 2))
    xy[..., 0] = speed * time
    xy[..., 1] = 2.0 * np.arange(NUM_OBJECTS)[:, None]
    velocity = np.zeros_like(xy)
    velocity[..., 0] = speed
    return PlanarTracks(
        object_type=np.full(NUM_OBJECTS, int(ObjectType.VEHICLE)),
        size=np.tile([4.5, 2.0, 1.5], (NUM_OBJECTS, 1)),
        xy=xy,
        yaw=np.zeros((NUM_OBJECTS, NUM_STEPS)),
        velocity=velocity,
        valid=np.ones((NUM_OBJECTS, NUM_STEPS), bool),
    )


def test_errors_are_centimetres_and_smooth() -> None:
    tracks = straight(10.0)
    error = noise.perceived(np.random.default_rng(0), tracks).xy - tracks.xy
    late = error[1:, 30:]
    assert 0.02 < late.std() < 0.05
    assert np.abs(error).max() < 0.2
    # From one step to the next they change by much less than their size.
    assert np.diff(late, axis=1).std() < 0.25 * late.std()


def test_the_ego_and_what_stands_have_no_changing_error() -> None:
    moving, standing = straight(10.0), straight(0.0)
    seen = noise.perceived(np.random.default_rng(0), moving)
    np.testing.assert_array_equal(seen.xy[0], moving.xy[0])
    seen = noise.perceived(np.random.default_rng(0), standing)
    assert (np.diff(seen.xy, axis=1) == 0).all()
    assert (seen.velocity == 0).all()


def test_the_velocity_is_that_of_the_noisy_track() -> None:
    seen = noise.perceived(np.random.default_rng(0), straight(10.0))
    moved = np.diff(seen.xy, axis=1)[..., 1]
    np.testing.assert_allclose(seen.velocity[:, :-1, 1] * 0.1, moved, atol=2.0**-16)


def test_the_near_is_always_seen_and_the_far_now_and_then() -> None:
    tracks = straight(0.0)
    seen = sight.seen(np.random.default_rng(0), tracks)
    assert seen[:7].all()  # up to 12 m
    assert not seen[45:].any()  # from 90 m on
    middle = seen[15:28].mean()  # 30 to 54 m
    assert 0.3 < middle < 0.95
    changes = np.diff(seen[15:28].astype(int), axis=1)
    assert (changes == 1).any() and (changes == -1).any()
