"""Unit of processor time, peak memory, processor, and work in a process of its own.

Processor times depend on the machine and on its other work.  A unit is the processor time of fixed
calculations in the same process, so that times in units can be compared between machines and
versions.  A unit consists of two parts of similar length:

* 1,000 LU factorisations of order 196 by LAPACK (three harmonics of the default study),
* 1,000 evaluations of the contact forces at 96 points with three harmonics by the C core.

The second part depends on the version of the core.  Both are therefore stored separately.
"""

from __future__ import annotations

import json
import os
import platform
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.linalg.lapack import dgetrf

from benchmarks.bench_core import Case

ORDER, FACTORISATIONS = 196, 1000
CONTACT_POINTS, MODES, HARMONICS, EVALUATIONS = 96, 16, 3, 1000
RUNS = 5
"""Runs of the unit in a process, of which the shortest counts."""
RESULTS = Path(__file__).parent / "results"
EVIDENCE = Path(__file__).parents[1] / "docs" / "evidence" / "times.md"
"""Page of the manual with times and growth."""
ONE_THREAD = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")


@dataclass(frozen=True)
class Unit:
    """Processor time of the fixed calculations.

    Parameters
    ----------
    factorisations, contact : float, s
    """

    factorisations: float
    contact: float

    @property
    def seconds(self) -> float:
        """Processor time of one unit (s)."""
        return self.factorisations + self.contact


class UnitClock:
    """Repeated measurement of the unit in this process."""

    def __init__(self) -> None:
        matrix = np.random.default_rng(1).normal(size=(ORDER, ORDER))
        self.matrix = np.asfortranarray(matrix)
        case = Case(CONTACT_POINTS, MODES, HARMONICS)
        self.equations = case.system()
        self.point = np.append(case.u, 0.7)
        n_coefficients = 2 * HARMONICS + 1
        self.motion = np.empty((CONTACT_POINTS, 3, n_coefficients))
        self.force = np.empty_like(self.motion)
        self.shares = np.empty((CONTACT_POINTS, 5))
        self.runs: list[Unit] = []

    def run(self, times: int) -> None:
        """Measure the unit a number of times."""
        for _ in range(times):
            self.runs.append(Unit(processor_time(self._factorise), processor_time(self._evaluate)))

    @property
    def shortest(self) -> Unit:
        """Shortest of all runs."""
        return min(self.runs, key=lambda unit: unit.seconds)

    def _factorise(self) -> None:
        for _ in range(FACTORISATIONS):
            dgetrf(self.matrix)

    def _evaluate(self) -> None:
        for _ in range(EVALUATIONS):
            self.equations.contact(self.point, self.motion, self.force, self.shares)


def processor_time(work: Callable[[], object]) -> float:
    """Return the processor time (s) of work on all threads of this process."""
    start = time.process_time()
    work()
    return time.process_time() - start


def peak_memory() -> float:
    """Return the peak memory (MB) of this process."""
    status = Path("/proc/self/status")
    if status.exists():
        # getrusage also counts the process that started this one
        return int(status.read_text().partition("VmHWM:")[2].split()[0]) / 1024.0
    # in bytes on macOS
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0**2


def processor_name() -> str:
    """Return the name of the processor."""
    information = Path("/proc/cpuinfo")
    if information.exists():
        for line in information.read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def in_own_process(module: str, *arguments: str) -> dict[str, Any]:
    """Return the JSON object that a module prints in a process of its own, on one thread.

    Progress goes to the error stream.
    """
    command = [sys.executable, "-m", module, *arguments]
    environment = os.environ | ONE_THREAD
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, env=environment)
    record: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return record


def write_lines(path: Path, records: list[dict[str, Any]]) -> None:
    """Write one JSON object a line."""
    path.write_text("".join(json.dumps(record) + "\n" for record in records))


def read_lines(path: Path) -> list[dict[str, Any]]:
    """Read one JSON object a line."""
    return [json.loads(line) for line in path.read_text().splitlines()]
