"""Whether the time integration can be relied on: random starts, and drawn scenes beside an explicit integration.

``python -m benchmarks.bench_trust starts`` integrates a thousand random motions of both disks over four periods:
coordinates and velocities of all modes drawn from a normal distribution and scaled so that the highest blade has 0.1 to 30
times the peak of the balance, sliders of each point anywhere within ten times that peak, frequency anywhere in the
interval, 128 or 256 steps a period.  Each must end finite, with no more energy than it had and was given,
or by ``IntegrationFailed``.

``python -m benchmarks.bench_trust scenes [first last]`` draws scenes as ``benchmarks.bench_labels`` does, with other
numbers, and asks ``study.time_response`` for the highest blade.  Its motion goes on for 15 periods in the explicit
integration of the tests, with 2,600 steps a period: the mean of the highest blade over the last 8 stands beside the answer.
Where amplitudes beat by more than 5 % it is 100 periods, and the mean over 80, as in the answer.
"""

from __future__ import annotations

import sys
import time
from math import tau

import numpy as np

from bdamper.time_domain import time_response
from bdamper.time_domain.integration import IntegrationFailed, Motion, all_sectors
from bdamper.time_domain.transient import Transient
from bdamper.util.errors import BdamperError
from benchmarks.bench_labels import BANDS, random
from tests.time_domain.test_explicit_reference import STEPS, explicit

FIRST = 100
"""Number of the first scene."""
STARTS, PERIODS = 1000, 4


def random_starts(scenes: int = 20) -> None:
    ended = {
        "finite": 0,
        "IntegrationFailed, 128 steps": 0,
        "IntegrationFailed, 256 steps": 0,
        "overflow": 0,
    }
    most, begin = 0.0, time.process_time()
    for number in range(FIRST, FIRST + scenes):
        made, name, preload, rng = random(number)
        peak = made.frequency_response(preload, BANDS[name]).peak.amplitude
        ring = all_sectors(made.problem, preload)
        like = ring.start(
            np.zeros(made.problem.system(preload).n_unknowns), tau * BANDS[name][0], 256
        )
        for _ in range(STARTS // scenes):
            omega = tau * rng.uniform(*BANDS[name])
            q, v = rng.standard_normal((2, like.q.size))
            own = np.sqrt(
                np.maximum(np.tile(ring.omega2, 2), omega**2)
            )  # all modes with the same energy
            q[ring.n_coordinates :][ring.real] = v[ring.n_coordinates :][ring.real] = 0.0
            q /= own
            size = peak * 10.0 ** rng.uniform(-1.0, 1.5) / np.abs(ring.rows @ q).max()
            w = like.w + 10.0 * peak * rng.uniform(-1.0, 1.0, like.w.shape)
            transient = Transient(
                ring, omega, Motion(size * q, size * v, w), int(rng.choice([128, 256]))
            )
            try:
                with np.errstate(all="ignore"):
                    transient.run(PERIODS)
            except IntegrationFailed:
                ended[f"IntegrationFailed, {transient.steps} steps"] += 1
                continue
            grown = np.abs(transient.blades).max() / (np.abs(ring.rows @ (size * q)).max() + peak)
            ended[
                "finite" if np.isfinite(transient.blades).all() and grown < 1e3 else "overflow"
            ] += 1
            most = max(most, float(grown))
        print(
            number,
            name,
            ended,
            f"{most:.3g} times the start at most, {time.process_time() - begin:.0f} s",
            flush=True,
        )


def scenes(first: int, last: int) -> None:
    said = time_response.of_blades
    print(
        "| scene | balance | highest blade in time (error), lowest | explicit | difference | status | s, explicit s |"
    )
    for number in range(first, last):
        made, name, preload, _ = random(number)
        begin, motions = time.process_time(), []
        time_response.of_blades = lambda transient, n, motions=motions: (
            motions.append(transient) or said(transient, n)
        )
        curve = made.frequency_response(preload, BANDS[name])
        order, friction = made.problem.engine_order, made.settings.friction_coefficient
        scene = f"{name}, engine order {order}, mu {friction:.2f}, {preload:.1f} N"
        try:
            found = made.time_response(curve)
        except BdamperError as error:
            print(f"| {scene} | | | | | {error} | |", flush=True)
            continue
        between = time.process_time()
        omega = tau * (found.frequency if found.frequency > 0.0 else curve.peak.frequency)
        ring = motions[-1].sectors if motions else all_sectors(made.problem, preload)
        start = motions[-1].motion if motions else ring.start(curve.peak.y[:-1], omega, 256)
        periods, window = (
            (100, 80) if found.highest_period > 1.05 * found.mean else (15, 8)
        )  # beats or not
        blades = 1e6 * np.abs(
            explicit(ring, Motion(*start[:3]), omega, periods, STEPS)[-window:]
        ).mean(axis=0)
        own = f"{1e6 * found.mean:.1f} ({1e6 * found.lowest:.1f} to {1e6 * found.highest:.1f}), {1e6 * found.spread[0]:.1f}"
        own += f" at {found.frequency:.2f} Hz"
        print(
            f"| {scene} | {1e6 * found.balance:.1f} | {own} | {blades.max():.1f}, {blades.min():.1f} | "
            f"{1e-6 * blades.max() / found.mean - 1.0:+.1%} | {found.status} | {between - begin:.0f}, "
            f"{time.process_time() - between:.0f} |",
            flush=True,
        )


def main() -> None:
    if "scenes" not in sys.argv:
        random_starts()
    if "starts" not in sys.argv:
        scenes(*(map(int, sys.argv[2:]) if sys.argv[2:] else (FIRST, FIRST + 20)))


if __name__ == "__main__":
    main()
