"""Joins the processes of a job, be they started here or by a scheduler."""

import os
import pathlib
import threading
import time

import jax

COORDINATOR = "DRIVETRAIN_COORDINATOR"  # address and port of the first process
PROCESSES = "DRIVETRAIN_PROCESSES"  # how many
PROCESS = "DRIVETRAIN_PROCESS"  # which this is, from 0 on
DEVICES = "DRIVETRAIN_DEVICES"  # of each process, where several share a machine
PULSE = "DRIVETRAIN_PULSE"  # a file to touch as long as the process is well
PULSE_SECONDS = 1.0
LOST = 69  # exit code of who has lost the others: BSD's EX_UNAVAILABLE
HEARTBEAT_SECONDS = 25  # after which JAX takes a silent process for lost
SHUTDOWN_SECONDS = 15  # for which a process that ends waits for the others


def join() -> None:
    """Joins the other processes of a job, if this one is of several.

    A job is told by the variables above, or by Slurm, Open MPI or Cloud TPU. Must come
    before anything else asks JAX for its devices.

    Raises:
        ValueError: if the variables do not fit together.
    """
    own = os.environ.get(DEVICES)
    if own is not None:
        jax.config.update("jax_num_cpu_devices", int(own))
    if PULSE in os.environ:
        _beat(pathlib.Path(os.environ[PULSE]))
    if PROCESSES in os.environ:
        number = int(os.environ[PROCESS])
        local = (
            None if own is None else range(number * int(own), (number + 1) * int(own))
        )
        jax.distributed.initialize(
            coordinator_address=os.environ[COORDINATOR],
            num_processes=int(os.environ[PROCESSES]),
            process_id=number,
            local_device_ids=local,
            heartbeat_timeout_seconds=HEARTBEAT_SECONDS,
            shutdown_timeout_seconds=SHUTDOWN_SECONDS,
        )
    elif _is_scheduled():
        jax.distributed.initialize(
            heartbeat_timeout_seconds=HEARTBEAT_SECONDS,
            shutdown_timeout_seconds=SHUTDOWN_SECONDS,
        )
        os.environ[PROCESS] = str(jax.process_index())


def speaks() -> bool:
    """Tells whether this process speaks for the job: the first one does."""
    return os.environ.get(PROCESS, "0") == "0"


def _is_scheduled() -> bool:
    """Tells whether a scheduler has started several processes of this program."""
    counts = ("SLURM_STEP_NUM_TASKS", "OMPI_COMM_WORLD_SIZE")
    hosts = os.environ.get("TPU_WORKER_HOSTNAMES", "").split(",")
    return len(hosts) > 1 or any(int(os.environ.get(name, 1)) > 1 for name in counts)


def _beat(path: pathlib.Path) -> None:
    """Touches a file now and then, and ends the process when its parent is gone."""
    parent = os.getppid()

    def beat() -> None:
        while True:
            path.touch()
            if os.getppid() != parent:
                os._exit(1)
            time.sleep(PULSE_SECONDS)

    threading.Thread(target=beat, name="drivetrain-pulse", daemon=True).start()
