"""States what every state of the program is made of: frozen records of arrays."""

from flax import struct


class Record(struct.PyTreeNode):
    """A frozen record of arrays that passes through jit, vmap and scan.

    The annotations of its fields state the shapes for one scenario. Run-time shape
    checks look at the arguments of functions and leave the constructor of a record
    alone: `jax.tree` rebuilds records with batched leaves and with placeholders.
    """

    __no_type_check__ = True
