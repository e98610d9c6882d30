"""Says how heads begin."""

from flax import nnx

# Small last weights: at first what a head says hardly depends on the observation, so
# that early errors are those of what is learned from, and not the network's.
LAST_KERNEL = nnx.initializers.variance_scaling(0.01, "fan_in", "normal")
