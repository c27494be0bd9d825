"""Beside pyHarm: ``make peers``, or ``python -m benchmarks.peers PYTHON`` with the interpreter of its environment.

One and two masses with Jenkins elements, seven harmonics, residuals to 1e-9.  pyHarm samples the cycle (1024 times) and
follows a curve through points of its own; bdamper solves the same equations in closed form, locates the peak and says
whether the curve is complete.  At every point of pyHarm the amplitude is compared with that of bdamper at its frequency.
Processor seconds, the better of two runs after a first one, which for pyHarm compiles.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

import bdamper as bd

SAME = 1e-3
"""Largest difference of amplitudes, relative to the highest, that counts as the same answer: that of the samples."""
COMMON = {"harmonics": 7, "samples": 1024, "tolerance": 1e-9, "response": 0, "forced": 0}
PROBLEMS: dict[str, dict[str, Any]] = {
    "one mass": {
        "M": [[1.0]], "C": [[0.02]], "K": [[1.0]], "force": 1.0, "band": [0.6, 1.9], "step": 0.3,
        "jenkins": [{"nodes": [0], "kt": 1.0, "limit": 1.0}],
    },
    "two masses": {
        "M": [[1.0, 0.0], [0.0, 0.5]], "C": [[0.02, 0.0], [0.0, 0.01]], "K": [[1.5, -0.5], [-0.5, 1.0]], "force": 0.3,
        "band": [0.5, 2.2], "step": 0.5, "jenkins": [{"nodes": [0, 1], "kt": 0.5, "limit": 0.2}],
    },
}  # fmt: skip


def ours(problem: dict[str, Any], there: np.ndarray) -> tuple[float, bd.ResponseCurve, np.ndarray]:
    """Processor seconds of a curve, the curve, and the amplitudes at other frequencies (rad/s)."""
    contacts = [
        bd.Contact(
            tuple(j["nodes"]) if len(j["nodes"]) == 2 else j["nodes"][0],
            kt=j["kt"],
            mu=1.0,
            preload=j["limit"],
        )
        for j in problem["jenkins"]
    ]
    study = bd.lumped(
        *(problem[name] for name in "MCK"), contacts=contacts, forces={problem["forced"]: problem["force"]},
        response=problem["response"], harmonics=problem["harmonics"],
    )  # fmt: skip
    low, high = (w / (2.0 * np.pi) for w in problem["band"])
    options = bd.ContinuationOptions(tolerance=problem["tolerance"])
    seconds = []
    for _ in range(3):
        started = time.process_time()
        curve = study.frequency_response(0.0, (low, high), options=options)
        seconds.append(time.process_time() - started)
    system, amplitudes = study.problem.system(0.0), []
    for omega in there:
        near = curve.unknowns[np.argmin(np.abs(curve.frequency - omega / (2.0 * np.pi)))]
        scale = np.full(len(near) + 1, np.linalg.norm(near))
        point = system.correct_at(near, omega, scale, problem["tolerance"], 60, line_search=True)
        amplitudes.append(abs(system.response(point.y[:-1])[1]) if point.status == 0 else np.nan)
    return min(seconds[1:]), curve, np.array(amplitudes)


def theirs(python: str, problem: dict[str, Any]) -> dict[str, Any]:
    """What pyHarm says in the environment of that interpreter."""
    script = Path(__file__).resolve().with_name("run_pyharm.py")
    quiet = {**os.environ, "JAX_PLATFORMS": "cpu"}
    command = [os.path.abspath(python), str(script)]
    with tempfile.TemporaryDirectory() as folder:  # it writes where it runs
        run = subprocess.run(
            command,
            input=json.dumps(problem),
            capture_output=True,
            text=True,
            env=quiet,
            cwd=folder,
        )
    if run.returncode:
        sys.exit(f"peers: pyHarm failed\n{run.stderr[-2000:]}")
    out: dict[str, Any] = json.loads(run.stdout.splitlines()[-1])
    return out


def main() -> None:
    """Print the table; ends with an error where the answers differ."""
    if len(sys.argv) != 2 or not Path(sys.argv[1]).exists():
        sys.exit(
            "peers: expected the interpreter of an environment with pyHarm-os; `make peers` makes it"
        )
    print("| problem | points | highest amplitude | s | pyHarm: points | highest amplitude | s | first run, s |"
          " ratio of times | largest difference of amplitudes |\n|---|---|---|---|---|---|---|---|---|---|")  # fmt: skip
    differ = []
    for name, part in PROBLEMS.items():
        problem = {**COMMON, **part}
        peer = theirs(sys.argv[1], problem)
        omega, c, s = np.array(peer["points"]).T
        inside = (omega > problem["band"][0]) & (omega < problem["band"][1])
        seconds, curve, amplitude = ours(problem, omega[inside])
        off = float(np.abs(np.hypot(c, s)[inside] - amplitude).max() / amplitude.max())
        row = [
            name,
            len(curve),
            f"{curve.peak.amplitude:.6f}",
            f"{seconds:.4f}",
            len(omega),
            f"{np.hypot(c, s).max():.6f}",
        ]
        row += [
            f"{peer['seconds']:.2f}",
            f"{peer['first']:.1f}",
            f"{peer['seconds'] / seconds:.0f}",
            f"{off:.0e}",
        ]
        print("| " + " | ".join(map(str, row)) + " |", flush=True)
        if not off <= SAME or not curve.complete:
            differ.append(name)
    print(f"\nbdamper {bd.__version__}, pyHarm-os {peer['version']}")
    if differ:
        sys.exit(f"peers: the answers differ: {differ}")


if __name__ == "__main__":
    main()
