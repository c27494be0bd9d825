"""A sweep of 1,000 points on two workers of Dask against two of a process pool: ratios within one run.

Blocks of points take turns on the two, so that what else the machine does touches both alike.  Processor time counts
this process and all below it: the scheduler of Dask, its workers, those of the pool.
"""

from __future__ import annotations

import sys
import time
from concurrent.futures import Executor, ProcessPoolExecutor

import distributed
import numpy as np
import psutil

import bdamper as bd
from benchmarks import PLAIN

POINTS, BLOCKS = 1000, 10


def processor_seconds() -> float:
    """Of this process and all that it has started and that still run."""
    own = psutil.Process()
    times = [p.cpu_times() for p in [own, *own.children(recursive=True)]]
    return float(sum(t.user + t.system for t in times))


def main(points: int = POINTS) -> None:
    """Print seconds, processor seconds and their ratios."""
    study = bd.Study(
        bd.reference_model(contact_points=24), bd.Excitation("tip"), 5, friction_coefficient=0.3, **PLAIN
    )  # fmt: skip
    friction = np.linspace(0.1, 0.6, points // BLOCKS)

    def asked(executor: Executor, preload: float, friction: np.ndarray) -> list[dict]:
        over = {"friction_coefficient": friction, "preload": [preload]}
        result = bd.sweep(study, over, frequency=(330.0, 380.0), executor=executor)
        assert len(result.values) == len(friction)
        return list(result.values)

    with (
        ProcessPoolExecutor(2) as pool,
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        ways: dict[str, Executor] = {"process pool": pool, "Dask": client.get_executor()}
        spent = {name: np.zeros(2) for name in ways}
        for executor in ways.values():
            asked(executor, 1000.0, friction[:8])
        for k, preload in enumerate(np.geomspace(1000.0, 5000.0, BLOCKS)):
            answers = []
            for name in list(ways)[:: 1 if k % 2 else -1]:
                start = np.array([time.perf_counter(), processor_seconds()])
                answers.append(asked(ways[name], float(preload), friction))
                spent[name] += np.array([time.perf_counter(), processor_seconds()]) - start
            assert answers[0] == answers[1]
    for name, (seconds, processor) in spent.items():
        print(f"{name}: {points} points in {seconds:.1f} s, {processor:.1f} s of the processor")
    ratio = spent["Dask"] / spent["process pool"]
    print(f"Dask over process pool: {ratio[0]:.2f} in time, {ratio[1]:.2f} in processor time")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else POINTS)
