"""What accuracy costs on the reference bladed disk: ladders of settings, written into docs/accuracy.md with figures.

``python -m benchmarks.bench_accuracy`` runs all ladders (minutes); names of ladders as arguments run only these and print.
Every ladder is timed within one run with its rungs taking turns; only ratios of times mean something.
"""

from __future__ import annotations

import argparse
import re
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

import bdamper as bd
from bdamper.accuracy import AccuracyCost, Answer, by_peak, by_sweep, by_tracking, by_tracking_with
from bdamper.plotting import plot_accuracy, save_figure
from bdamper.timedomain import Ring

DOCS = Path(__file__).parents[1] / "docs"
PRELOAD = 2000.0
PRELOAD_9 = 5000.0
"""With nine points a face, which slip as much there."""
INTERVAL = (300.0, 370.0)
REPEATS = 3


def reference_study(points: int = 24, **settings: object) -> bd.Study:
    """Engine order 5, first mode; at 2 kN the contact slips and opens at the peak."""
    model = bd.reference_model("bladed_disk", points)
    return bd.Study(model, bd.Excitation("tip"), 5, friction_coefficient=0.3, **settings)  # type: ignore[arg-type]


def at_frequency(frequency: float) -> Callable[[bd.Study, float, tuple[float, float]], Answer]:
    """The response at one frequency, from nothing."""

    def solve(study: bd.Study, preload: float, interval: tuple[float, float]) -> Answer:
        y, _ = study.find_start(preload, 2.0 * np.pi * frequency, bd.ContinuationOptions(), _meter())
        if y is None:
            return np.nan, np.nan
        return float(abs(study.system(preload).response(y[:-1])[1])), frequency

    return solve


def _meter() -> object:
    from bdamper.system import CostMeter

    return CostMeter(time.perf_counter())


def samples(separation: bool) -> AccuracyCost:
    study = reference_study(harmonics=3, separation=separation)
    values = [*(bd.Sampled(n) for n in (32, 64, 128, 256, 512, 1024, 2048)), "exact"]
    return bd.accuracy_cost(
        study, PRELOAD, INTERVAL, quantity=at_frequency(352.25 if separation else 355.7), vary={"evaluation": values},
        tolerance=1e-3, repeats=7 * REPEATS, reference_quantity=True,
    )  # fmt: skip


def peaks_by_samples() -> AccuracyCost:
    study = reference_study(harmonics=3)
    values = [*(bd.Sampled(n) for n in (32, 64, 128, 256, 512)), "exact"]
    return bd.accuracy_cost(
        study, PRELOAD, INTERVAL, quantity="curve", vary={"evaluation": values}, tolerance=1e-3, repeats=REPEATS
    )  # fmt: skip


def harmonics() -> AccuracyCost:
    return bd.accuracy_cost(
        reference_study(9), PRELOAD_9, INTERVAL, quantity="curve", vary={"harmonics": [1, 2, 3, 5, 7, 9, 11, 13, 15]},
        reference={"harmonics": 20}, tolerance=0.01, repeats=REPEATS,
    )  # fmt: skip


def contact_points() -> AccuracyCost:
    return bd.accuracy_cost(
        reference_study(48), PRELOAD, (250.0, 370.0), quantity="curve", vary={"contact_points": [9, 16, 24, 36, 48]},
        tolerance=0.05, repeats=REPEATS,
    )  # fmt: skip


def blade_modes(stiffness: str) -> AccuracyCost:
    return bd.accuracy_cost(
        reference_study(contact_stiffness=stiffness), PRELOAD, (300.0, 370.0), quantity="curve",
        vary={"blade_modes": [2, 5, 10, 20, 30, 40]}, tolerance=0.05, repeats=REPEATS,
    )  # fmt: skip


def damper_modes() -> AccuracyCost:
    return bd.accuracy_cost(
        reference_study(), PRELOAD, (300.0, 370.0), quantity="curve", vary={"damper_modes": [0, 1, 2, 4, 6, 8]},
        tolerance=0.01, repeats=REPEATS,
    )  # fmt: skip


def friction_laws() -> AccuracyCost:
    def rung(name: str, **changes: object) -> bd.Setting:
        return bd.Setting("friction law", name, changes)

    settings = [
        rung("separable, exact events"),
        rung("separable along major axes, exact events", friction_axes="major"),
        rung("separable, 128 samples", evaluation=bd.Sampled(128)),
        rung("coupled, 64 samples", friction_law="coupled", evaluation=bd.Sampled(64)),
        rung("coupled, 128 samples", friction_law="coupled", evaluation=bd.Sampled(128)),
    ]
    return bd.accuracy_cost(
        reference_study(9), PRELOAD_9, INTERVAL, quantity="curve", vary=settings, tolerance=0.05, repeats=REPEATS,
        reference={"friction_law": "coupled", "evaluation": bd.Sampled(512)},
    )  # fmt: skip


def bases() -> AccuracyCost:
    return bd.accuracy_cost(
        reference_study(9, harmonics=5), PRELOAD_9, INTERVAL, quantity="curve", vary={"single_basis": [True, False]},
        tolerance=0.01, repeats=REPEATS,
    )  # fmt: skip


def ways() -> AccuracyCost:
    coarse = bd.ContinuationOptions(step=0.1, locate=False)
    fine = bd.ContinuationOptions(step=0.02, max_step=0.05, locate=False)
    settings = [
        bd.Setting("way to the peak", "search for the peak", solver=by_peak),
        bd.Setting("way to the peak", "tracking, maxima located", solver=by_tracking),
        bd.Setting("way to the peak", "tracking, steps of 0.1", solver=by_tracking_with(coarse)),
        bd.Setting("way to the peak", "tracking, steps of 0.02", solver=by_tracking_with(fine)),
        *(bd.Setting("way to the peak", f"sweep of {n} frequencies", solver=by_sweep(n)) for n in (50, 100, 200, 400)),
    ]
    return bd.accuracy_cost(
        reference_study(), PRELOAD, INTERVAL, vary=settings, tolerance=1e-3, repeats=REPEATS
    )  # fmt: skip


# ---- what is not a setting ----


def jacobians() -> str:
    """Newton with the analytic Jacobian and with one by finite differences, at one frequency."""
    lines = ["| harmonics | unknowns | analytic (ms) | finite differences (ms) | ratio |", "|---|---|---|---|---|"]
    for n in (1, 3, 5):
        study = reference_study(harmonics=n)
        system = study.system(PRELOAD)
        y, _ = study.find_start(PRELOAD, 2.0 * np.pi * 352.0, bd.ContinuationOptions(), _meter())  # type: ignore[arg-type]
        assert y is not None
        u, omega = y[:-1], float(y[-1])
        size = np.abs(u).max()
        seconds: dict[bool, list[float]] = {True: [], False: []}
        for _ in range(REPEATS):
            for analytic in (True, False):
                begin = time.perf_counter()
                v = u * (1.0 + 0.01 * np.cos(np.arange(len(u))))
                for _ in range(25):
                    r, J, _ = system.evaluate(v, omega)
                    if np.abs(r * system.row_scale).max() < 1e-9:
                        break
                    if not analytic:
                        J = _differences(system, v, omega, r, 1e-7 * size)
                    v = v - np.linalg.solve(J, r)
                seconds[analytic].append(time.perf_counter() - begin)
        a, d = (1e3 * float(np.median(seconds[k])) for k in (True, False))
        lines.append(f"| {n} | {system.n_unknowns} | {a:.3g} | {d:.3g} | {d / a:.1f} |")
    return "\n".join(lines)


def _differences(system: object, u: np.ndarray, omega: float, r: np.ndarray, h: float) -> np.ndarray:
    J = np.empty((len(u), len(u)))
    moved = np.empty_like(r)
    for k in range(len(u)):
        v = u.copy()
        v[k] += h
        system.core.evaluate(v, omega, moved)  # type: ignore[attr-defined]
        J[:, k] = (moved - r) / h
    return J


def time_integration() -> str:
    """Harmonic balance beside time integration of the same reduced model from rest to the steady state."""
    study = reference_study(9, harmonics=5)
    peak = study.peak(PRELOAD_9, INTERVAL)
    frequency = 0.99 * peak.frequency
    omega = 2.0 * np.pi * frequency
    begin = time.perf_counter()
    y, _ = study.find_start(PRELOAD_9, omega, bd.ContinuationOptions(), _meter())  # type: ignore[arg-type]
    balance = time.perf_counter() - begin
    assert y is not None
    system = study.system(PRELOAD_9)
    expected = float(abs(system.response(y[:-1])[1]))
    richer = replace(study, harmonics=10)
    z, _ = richer.find_start(PRELOAD_9, omega, bd.ContinuationOptions(), _meter())  # type: ignore[arg-type]
    truncation = abs(expected / float(abs(richer.system(PRELOAD_9).response(z[:-1])[1])) - 1.0) if z is not None else np.nan
    ring = Ring(system, study.model.n_blades, 5)
    steps = max(256, ring.steps_for(omega, 0.3))
    rest = np.zeros(system.n_unknowns)
    rest[: system.n_mean] = study.static(PRELOAD_9).q[: system.n_mean]
    q, v = ring.state(rest, omega, 0.0)
    w = np.tile(system.points.slider, (ring.n, 1, 1)).astype(float)
    row = ring.response_row()
    wave = np.exp(-2j * np.pi * np.arange(steps) / steps) * 2.0 / steps
    lines = ["| periods | difference from harmonic balance | time (s) | ratio |", "|---|---|---|---|"]
    begin = time.perf_counter()
    for periods in (25, 50, 100, 200):
        done = 0 if periods == 25 else periods // 2
        q, v, w, _ = ring.march(q, v, w, omega, steps, periods - done - 1)
        q, v, w, x = ring.march(q, v, w, omega, steps, 1, row)
        spent = time.perf_counter() - begin
        error = float(abs(wave @ x)) / expected - 1.0
        lines.append(f"| {periods} | {error:+.1e} | {spent:.3g} | {spent / balance:.0f} |")
    head = (
        f"At {frequency:.5g} Hz, {ring.n} sectors, {steps} steps a period, central differences in NumPy; harmonic balance "
        f"with 5 harmonics from nothing takes {1e3 * balance:.3g} ms, and ten harmonics change it by {truncation:.1e}.\n\n"
    )
    return head + "\n".join(lines)


LADDERS: dict[str, Callable[[], AccuracyCost]] = {
    "samples": lambda: samples(True),
    "samples_without_separation": lambda: samples(False),
    "samples_peak": peaks_by_samples,
    "harmonics": harmonics,
    "contact_points": contact_points,
    "blade_modes": lambda: blade_modes("unit_traction"),
    "blade_modes_residual": lambda: blade_modes("residual_modes"),
    "damper_modes": damper_modes,
    "friction_laws": friction_laws,
    "bases": bases,
    "ways": ways,
}
TABLES: dict[str, Callable[[], str]] = {"jacobians": jacobians, "time_integration": time_integration}


def fill(text: str, name: str, table: str) -> str:
    """The document with the table between the marks of a name replaced."""
    pattern = rf"(<!-- {name} -->\n).*?(<!-- end -->)"
    if not re.search(pattern, text, re.S):
        raise ValueError(f"no place for '{name}' in the document")
    return re.sub(pattern, lambda m: m.group(1) + table + "\n" + m.group(2), text, flags=re.S)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help=f"out of {', '.join([*LADDERS, *TABLES])}; all by default")
    parser.add_argument("--write", action="store_true", help="write docs/accuracy.md and its figures also for some names")
    given = parser.parse_args()
    names = given.names or [*LADDERS, *TABLES]
    for name in names:
        begin = time.perf_counter()
        if name in LADDERS:
            result = LADDERS[name]()
            print(result, flush=True)
            table = result.markdown(result.ladders[0])
        else:
            table = TABLES[name]()
            print(table, flush=True)
        print(f"({name}: {time.perf_counter() - begin:.0f} s)\n", flush=True)
        if given.write or not given.names:
            page = DOCS / "accuracy.md"
            page.write_text(fill(page.read_text(), name, table))
            if name in LADDERS:
                save_figure(plot_accuracy(result), DOCS / "images" / f"accuracy_{name}.png")


if __name__ == "__main__":
    main()
