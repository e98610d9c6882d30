"""Sets up JAX for all tests: strict shapes, and programs kept between runs."""

import os
import pathlib

import jax

ROOT = pathlib.Path(__file__).resolve().parents[1]

jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_compilation_cache_dir", str(ROOT / ".jax_cache"))
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.2)
os.environ["MPLBACKEND"] = "Agg"
