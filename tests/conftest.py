"""Sets up JAX for all tests: strict shapes, and programs kept between runs."""

import os
import pathlib

import jax
import pytest

ROOT = pathlib.Path(__file__).resolve().parents[1]

jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_compilation_cache_dir", str(ROOT / ".jax_cache"))
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.2)
os.environ["MPLBACKEND"] = "Agg"


def pytest_addoption(parser: pytest.Parser) -> None:
    """Adds how thoroughly to damage files (see `tests/sim/data/hostile_test.py`)."""
    parser.addoption(
        "--mutations", type=int, default=100, help="damaged files a reader"
    )
