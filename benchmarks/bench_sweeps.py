"""Sweeps of many points: efficiency of two workers, memory of the client, and the overhead of a point.

Each case runs in a process of its own, so that its peak of memory is its own.  The efficiency is the time of the points on
the workers over the time that two workers were there.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import numpy as np

import bdamper as bd
from benchmarks import PLAIN
from benchmarks.measuring import peak_memory

WORKERS = 2
STAND_IN = 200_000
REAL = 2_000
MODEL = Path(__file__).parents[1] / "tests" / "models" / "paper_disk_24.h5"


def stand_in(study: bd.Study, preload: float) -> dict[str, float | str]:
    """Answer like a search for a peak after 1 ms."""
    time.sleep(1e-3)
    numbers = dict.fromkeys(("frequency", "residual", "stick", "slip", "open"), 1.0 / preload)
    return {"amplitude": 2.0 * preload, **numbers, "search_status": "complete", "warning": ""}


def lumped() -> bd.Study:
    """Return two masses with a contact."""
    contact = bd.Contact((1, 0), normal=1, kt=1.0, kn=1.0, mu=0.5)
    ways = {"contacts": [contact], "forces": {0: 0.1}, "load_per_preload": {1: 1.0}, "harmonics": 1}
    return bd.lumped([1.0, 0.1], [0.02, 0.02], [1.0, 0.1], **ways)


@contextmanager
def workers(name: str) -> Iterator[Executor | None]:
    """Provide an executor whose workers have started."""
    if name == "Dask":
        import distributed

        with (
            distributed.LocalCluster(
                n_workers=WORKERS, threads_per_worker=1, dashboard_address=None
            ) as cluster,
            distributed.Client(cluster) as client,
        ):
            yield client.get_executor()
    elif name == "process pool":
        with ProcessPoolExecutor(WORKERS) as pool:
            list(pool.map(time.sleep, [0.1] * WORKERS))
            yield pool
    else:
        yield None


def case(name: str, points: int) -> None:
    """Run a sweep of stand-in points with a results file, continue it when it is complete, and print a row."""
    with tempfile.TemporaryDirectory() as folder, workers(name) as executor:
        path, over, study = (
            Path(folder) / "sweep.jsonl",
            {"preload": np.linspace(1.0, 2.0, points)},
            lumped(),
        )
        bd.sweep(
            study, {"preload": np.linspace(1.0, 2.0, 64)}, stand_in, executor=executor
        )  # imports of the workers
        begin, client = time.perf_counter(), time.process_time()
        result = bd.sweep(study, over, stand_in, executor=executor, resume=path)
        span, client = time.perf_counter() - begin, time.process_time() - client
        assert result.complete
        assert np.array_equal(result.array("amplitude"), 2.0 * over["preload"])
        share = result.seconds.sum() / span / (WORKERS if executor else 1)
        cells = (
            name,
            points,
            f"{span:.1f}",
            f"{share:.0%}",
            f"{1e3 * client / points:.2f}",
            f"{peak_memory():.0f}",
        )
        print("|", " | ".join(map(str, cells)), "|", flush=True)
        subprocess.run(
            [sys.executable, "-m", "benchmarks.bench_sweeps", "continued", str(points), str(path)],
            check=True,
        )


def continued(points: int, path: str) -> None:
    """Read the results file of a complete sweep and print a row."""
    study, begin, client = lumped(), time.perf_counter(), time.process_time()
    assert bd.sweep(
        study, {"preload": np.linspace(1.0, 2.0, points)}, stand_in, resume=path
    ).complete
    span, client = time.perf_counter() - begin, time.process_time() - client
    print(
        f"| continued | {points} | {span:.1f} | | {1e3 * client / points:.2f} | {peak_memory():.0f} |",
        flush=True,
    )


def real(points: int) -> None:
    """Compare peaks of a shipped model on workers with a tenth of them in sequence, and print three rows.

    The second efficiency is the time that the sequence needs for as many points over the time of both workers.
    """
    study = bd.Study(
        bd.load_model(MODEL), bd.Excitation("tip"), 5, friction_coefficient=0.3, **PLAIN
    )
    friction, preload = np.linspace(0.1, 0.6, points // 10), np.geomspace(1e3, 5e3, 10)
    first: bd.SweepResult | None = None
    for name, every in (("sequence", 10), ("process pool", 1), ("Dask", 1)):
        with workers(name) as executor:
            begin, client = time.perf_counter(), time.process_time()
            result = bd.sweep(
                study,
                {"friction_coefficient": friction[::every], "preload": preload},
                executor=executor,
            )
            span, client = time.perf_counter() - begin, time.process_time() - client
        n, all_workers = len(result), span * (WORKERS if executor else 1)
        first = first or result
        assert (
            first.array("amplitude").tolist() == result.array("amplitude")[:: 10 // every].tolist()
        ), "to the last bit"
        share = f"{result.seconds.sum() / all_workers:.0%}, {first.seconds.mean() * n / all_workers:.0%}"
        processor = f"{1e3 * result.cost['processor'].mean():.0f} ms of processor"
        cells = f"peaks, {name}, {processor}", n, f"{span:.1f}", share, f"{1e3 * client / n:.2f}"
        print("|", " | ".join(map(str, cells)), f"| {peak_memory():.0f} |", flush=True)


def main() -> None:
    """Print a table of all cases."""
    print(
        "| sweep | points | seconds | efficiency | processor time of the client (ms a point) | peak of its memory (MB) |"
    )
    print("|---|---|---|---|---|---|", flush=True)
    for arguments in (("Dask", STAND_IN), ("process pool", STAND_IN), ("real", REAL)):
        subprocess.run(
            [sys.executable, "-m", "benchmarks.bench_sweeps", *map(str, arguments)], check=True
        )


if __name__ == "__main__":
    if len(sys.argv) < 3:
        main()
    elif sys.argv[1] == "continued":
        continued(int(sys.argv[2]), sys.argv[3])
    elif sys.argv[1] == "real":
        real(int(sys.argv[2]))
    else:
        case(sys.argv[1], int(sys.argv[2]))
