"""Builds an observer from its config."""

from .base import Observer
from .compact import CompactConfig, compact
from .nocturne import NocturneConfig, nocturne
from .vector import VectorConfig, vector

ObservationConfig = VectorConfig | CompactConfig | NocturneConfig


def build(config: ObservationConfig) -> Observer:
    """Builds the observer of a config; the type of the config says which."""
    match config:
        case VectorConfig():
            return vector(config)
        case CompactConfig():
            return compact(config)
        case NocturneConfig():
            return nocturne(config)
