"""Runs a script in a process that sees several devices, all of them this machine's."""

import json
import os
import pathlib
import subprocess
import sys
from typing import Any

ROOT = pathlib.Path(__file__).resolve().parents[2]


def run(module: str, num_devices: int) -> Any:
    """Returns the JSON that a module under `tests.learners` prints."""
    flags = f"--xla_force_host_platform_device_count={num_devices}"
    finished = subprocess.run(
        [sys.executable, "-m", f"tests.learners.{module}"],
        cwd=ROOT,
        env=os.environ | {"XLA_FLAGS": flags, "JAX_PLATFORMS": "cpu"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert finished.returncode == 0, finished.stderr
    return json.loads(finished.stdout)
