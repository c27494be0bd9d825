"""What accuracy costs on the reference bladed disk: ladders into docs/evidence/measured.md with figures.

``python -m benchmarks.bench_accuracy`` runs all ladders (minutes); names of ladders as arguments run only these and print;
``--draw`` draws the figures anew from the tables of the page.
Only ratios of times mean something.
"""

from __future__ import annotations

import argparse
import re
import time
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path

import numpy as np

import bdamper as bd
from bdamper.analyses.accuracy import AccuracyCost, Run
from bdamper.analyses.error_estimates import evaluate_peak, whole_curve
from bdamper.fem import MeshDensity, SectorFE, bladed_disk
from bdamper.harmonic_balance.equations import OK
from bdamper.harmonic_balance.problem import Problem
from bdamper.plot import plot_accuracy, save_figure
from bdamper.response.followed_peak import highest_peak
from bdamper.response.peak import Peak
from bdamper.time_domain.integration import STEPS, AllSectors, Motion
from bdamper.util.formatting import percent
from bdamper.util.progress import CostMeter
from benchmarks import PLAIN, convergence_scenes, estimate_scenes, fill
from tests.following import changed, find_start, slider_interval

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PRELOAD = 2000.0
LIMIT = (1, 2, 3, 5, 7, 9, 13, 20)
"""Harmonics beside time integration; the last is the limit."""
PRELOAD_9 = 5000.0
"""With nine points a face, which slip as much there."""
INTERVAL = (300.0, 370.0)
REPEATS = 3
Answer = tuple[float, float]
"""Amplitude (m) and frequency (Hz) of the highest peak."""
ALL = 0.99
"""Tolerance that all values of a ladder are within, so that none is left out."""
SHOWN = 0.01
"""Tolerance that their tables and figures show."""


def reference_study(points: int = 24, **settings: object) -> bd.Study:
    """Engine order 5, first mode; at 2 kN the contact slips and opens at the peak."""
    model = bd.reference_model("bladed_disk", points)
    return bd.Study(model, bd.Excitation("tip"), 5, friction_coefficient=0.3, **(PLAIN | settings))


def at_frequency(frequency: float) -> Callable[[bd.Study, float, tuple[float, float]], Answer]:
    """The response at one frequency, from nothing."""

    def solve(study: bd.Study, preload: float, interval: tuple[float, float]) -> Answer:
        y, _ = find_start(
            study.problem, preload, 2.0 * np.pi * frequency, bd.ContinuationOptions(), CostMeter()
        )
        if y is None:
            return np.nan, np.nan
        return float(abs(study.problem.system(preload).response(y[:-1])[1])), frequency

    return solve


def samples(separation: bool) -> AccuracyCost:
    study = reference_study(harmonics=3, separation=separation)
    values = [*(bd.AFT(n) for n in (32, 64, 128, 256, 512, 1024, 2048)), "event_driven"]
    return bd.accuracy_cost(
        study, PRELOAD, INTERVAL, quantity=at_frequency(352.25 if separation else 355.7), vary={"contact_forces": values},
        tolerance=ALL, sources=(),
    )  # fmt: skip


def peaks_by_samples() -> AccuracyCost:
    study = reference_study(harmonics=3)
    values = [*(bd.AFT(n) for n in (32, 64, 128, 256, 512)), "event_driven"]
    return bd.accuracy_cost(
        study, PRELOAD, INTERVAL, vary={"contact_forces": values}, tolerance=ALL, sources=()
    )


def harmonics() -> AccuracyCost:
    vary = {"harmonics": [1, 2, 3, 5, 7, 9, 11, 13, 15, 20]}
    return bd.accuracy_cost(
        reference_study(9), PRELOAD_9, INTERVAL, vary=vary, tolerance=ALL, sources=()
    )


@lru_cache
def model_192() -> bd.Model:
    """8 by 24 contact points on a face; fine meshes at the faces, coarse ones elsewhere, hence frequencies of its own."""
    mesh = MeshDensity(
        centre=2, contact=8, fillet=1, chord=12, disk=1, shank=1, platform=1, airfoil=3,
        damper_face=8, damper_ridge=1, damper_height=2, damper_length=12,
    )  # fmt: skip
    return bladed_disk(
        192, n_modes=20, n_damper_modes=6, nodal_diameters=(5,), fe=SectorFE(density=mesh)
    )


def contact_points(stiffness: str) -> AccuracyCost:
    settings = PLAIN | {"contact_stiffness": stiffness}
    study = bd.Study(model_192(), bd.Excitation("tip"), 5, friction_coefficient=0.3, **settings)
    vary = {"contact_points": [9, 24, 48, 96, 192]}
    return bd.accuracy_cost(study, 4000.0, (340.0, 380.0), vary=vary, tolerance=ALL, sources=())


def blade_modes(stiffness: str) -> AccuracyCost:
    study, vary = (
        reference_study(contact_stiffness=stiffness),
        {"blade_modes": [2, 5, 10, 20, 30, 40]},
    )
    return bd.accuracy_cost(study, PRELOAD, INTERVAL, vary=vary, tolerance=ALL, sources=())


def damper_modes() -> AccuracyCost:
    vary = {"damper_modes": [0, 1, 2, 4, 6, 8, 10]}
    return bd.accuracy_cost(
        reference_study(), PRELOAD, INTERVAL, vary=vary, tolerance=ALL, sources=()
    )


def friction_laws() -> AccuracyCost:
    laws = {
        "separable, exact events": {},
        "separable, 128 samples": {"contact_forces": bd.AFT(128)},
        "coupled, 64 samples": {"friction_law": "coupled", "contact_forces": bd.AFT(64)},
        "coupled, 128 samples": {"friction_law": "coupled", "contact_forces": bd.AFT(128)},
        "coupled, 512 samples": {"friction_law": "coupled", "contact_forces": bd.AFT(512)},
    }
    study = reference_study(9)
    problems = [study.replace(**given).problem for given in laws.values()]
    found = [
        evaluate_peak(problem, lambda p: whole_curve(p, PRELOAD_9, INTERVAL))
        for problem in problems
    ]
    top, runs = found[-1], []
    for name, one in zip(laws, found):
        error = max(
            abs(one.amplitude / top.amplitude - 1.0), abs(one.frequency / top.frequency - 1.0)
        )
        part = "richest" if one is top else "friction_law"
        runs.append(
            Run(part, (name,), one.amplitude, one.frequency, error, one.seconds, one.reason)
        )
    return AccuracyCost("curve", PRELOAD_9, INTERVAL, ALL, ("friction_law",), tuple(runs[::-1]))


def bases() -> AccuracyCost:
    study, vary = reference_study(9, harmonics=5), {"fundamental_modes_only": [True, False]}
    return bd.accuracy_cost(study, PRELOAD_9, INTERVAL, vary=vary, tolerance=ALL, sources=())


def combined() -> AccuracyCost:
    """What a user gets without any choice but the points, the preload and the tolerance."""
    study = bd.Study(
        bd.reference_model("bladed_disk", 24), bd.Excitation("tip"), 5, friction_coefficient=0.3
    )
    return bd.accuracy_cost(study, 6700.0, tolerance=0.05, sources=())


# ---- what is not a setting ----


def ways() -> str:
    """Ways to the peak of one and the same study."""
    study = reference_study()
    study.problem.system(PRELOAD)

    def tracked(options: bd.ContinuationOptions) -> Callable[[], Answer]:
        def solve() -> Answer:
            return place(study.frequency_response(PRELOAD, INTERVAL, options=options).peak)

        return solve

    def place(top: Peak) -> Answer:
        return top.amplitude, top.frequency

    coarse, fine = (
        bd.ContinuationOptions(locate=False, **o)
        for o in ({"step": 0.1}, {"step": 0.02, "max_step": 0.05})
    )
    given: dict[str, Callable[[], Answer]] = {
        "search for the peak": lambda: place(highest_peak(study.problem, PRELOAD, INTERVAL)),
        "tracking, maxima located": lambda: place(
            whole_curve(study.problem, PRELOAD, INTERVAL).peak
        ),
        "tracking, steps of 0.1": tracked(coarse),
        "tracking, steps of 0.02": tracked(fine),
        **{
            f"sweep of {n} frequencies": partial(sweep_peak, study.problem, PRELOAD, INTERVAL, n)
            for n in (50, 100, 200, 400)
        },
    }
    seconds: dict[str, list[float]] = {name: [] for name in given}
    answers: dict[str, Answer] = {}
    for _ in range(REPEATS):
        for name, solve in given.items():
            begin = time.process_time()
            answers[name] = solve()
            seconds[name].append(time.process_time() - begin)
    a, f = answers["search for the peak"]
    lines = ["| way | error of amplitude | error of frequency | time (ms) |", "|---|---|---|---|"]
    for name, (amplitude, frequency) in answers.items():
        middle = 1e3 * float(np.median(seconds[name]))
        lines.append(
            f"| {name} | {amplitude / a - 1.0:+.1e} | {frequency / f - 1.0:+.1e} | {middle:.3g} |"
        )
    return "\n".join(lines)


def sweep_peak(problem: Problem, preload: float, interval: tuple[float, float], n: int) -> Answer:
    """Largest response on a grid of frequencies, swept upward and downward by Newton at fixed frequency.

    Points at which Newton fails from the point before and from the stuck response are left out.
    """
    case = problem.at(preload)
    system, state, springs = case.equations, case.equilibrium, case.stuck_springs()
    omegas = 2.0 * np.pi * np.linspace(*interval, n)
    best = (np.nan, np.nan)
    for sweep in (omegas, omegas[::-1]):
        y = None
        for omega in sweep:
            stuck = system.layout.pack(
                state.q[: system.n_mean], system.structure.linear.response(omega, springs)
            )
            scale = np.ones(system.n_unknowns + 1)
            scale[: system.n_mean] = max(float(np.linalg.norm(state.q)), 1e-300)
            scale[system.n_mean : -1] = max(float(np.linalg.norm(stuck[system.n_mean :])), 1e-300)
            scale[-1] = omega
            for guess, search, iterations in ((y, False, 12), (stuck, True, 40)):
                if guess is None:
                    continue
                c = system.correct_at(guess, omega, scale, 1e-9, iterations, search)
                if c.status == OK:
                    y = c.y[:-1]
                    amplitude = float(abs(system.response(y)[1]))
                    if not best[0] >= amplitude:
                        best = amplitude, float(omega / (2.0 * np.pi))
                    break
            else:
                y = None
    return best


def jacobians() -> str:
    """Newton with the analytic Jacobian and with one by finite differences, at one frequency."""
    lines = [
        "| harmonics | unknowns | analytic (ms) | finite differences (ms) | ratio |",
        "|---|---|---|---|---|",
    ]
    for n in (1, 3, 5):
        study = reference_study(harmonics=n)
        system = study.problem.system(PRELOAD)
        y, _ = find_start(
            study.problem, PRELOAD, 2.0 * np.pi * 352.0, bd.ContinuationOptions(), CostMeter()
        )
        assert y is not None
        u, omega = y[:-1], float(y[-1])
        size = np.abs(u).max()
        seconds: dict[bool, list[float]] = {True: [], False: []}
        for _ in range(REPEATS):
            for analytic in (True, False):
                begin = time.process_time()
                v = u * (1.0 + 0.01 * np.cos(np.arange(len(u))))
                for _ in range(25):
                    r, J, _ = system.evaluate(v, omega)
                    if np.abs(r * system.row_scale).max() < 1e-9:
                        break
                    if not analytic:
                        J = _differences(system, v, omega, r, 1e-7 * size)
                    v = v - np.linalg.solve(J, r)
                seconds[analytic].append(time.process_time() - begin)
        a, d = (1e3 * float(np.median(seconds[k])) for k in (True, False))
        lines.append(f"| {n} | {system.n_unknowns} | {a:.3g} | {d:.3g} | {d / a:.1f} |")
    return "\n".join(lines)


def _differences(
    system: object, u: np.ndarray, omega: float, r: np.ndarray, h: float
) -> np.ndarray:
    J = np.empty((len(u), len(u)))
    moved = np.empty_like(r)
    for k in range(len(u)):
        v = u.copy()
        v[k] += h
        system.core.evaluate(np.append(v, omega), moved)  # type: ignore[attr-defined]
        J[:, k] = (moved - r) / h
    return J


def time_integration() -> str:
    """Harmonic balance beside time integration of the same reduced model from rest to the steady state."""
    omega = 2.0 * np.pi * 356.2
    study = reference_study(9, harmonics=5)
    balance = []
    for n in LIMIT:
        rung = study.replace(harmonics=n)
        rung.problem.system(PRELOAD_9)
        seconds = []
        for _ in range(REPEATS):
            begin = time.process_time()
            y, _ = find_start(rung.problem, PRELOAD_9, omega, bd.ContinuationOptions(), CostMeter())
            seconds.append(time.process_time() - begin)
        assert y is not None
        balance.append(
            (
                n,
                float(abs(rung.problem.system(PRELOAD_9).response(y[:-1])[1])),
                float(np.median(seconds)),
            )
        )
    limit = balance.pop()[1]
    resting, own = rung.problem.system(PRELOAD_9), y
    system = study.problem.system(PRELOAD_9)
    ring = AllSectors(system, study.model.n_blades, 5)
    steps = STEPS
    rest = np.zeros(system.n_unknowns)
    rest[: system.n_mean] = study.static(PRELOAD_9).q[: system.n_mean]
    q, v = ring.state(rest, omega, 0.0)
    w = np.tile(system.structure.points.slider, (ring.n, 1, 1)).astype(float)
    motion = Motion(q, v, w)
    in_time = []
    begin = time.process_time()
    for _ in range(14):
        motion, amplitudes, *_ = ring.integrate(motion, omega, steps, 25)
        in_time.append((float(abs(amplitudes[-1, 0, 1])), time.process_time() - begin))
    settled = in_time[-1][0]
    rests = np.isfinite(slider_interval(resting, own[:-1])[..., 0])
    scale = resting.units(own, own[-1])
    given = []
    for sector in motion.w:
        system = changed(resting, slider=np.where(rests, sector, resting.structure.points.slider))
        c = system.correct_at(own[:-1], omega, scale, 1e-9, 60, True)
        assert c.status == OK
        given.append(float(abs(system.response(c.y[:-1])[1])))
    finer = [abs(ring.integrate(motion, omega, k * steps, 20).harmonics[-1, 0, 1]) for k in (1, 2)]
    step_error = float(finer[0] / finer[1]) - 1.0
    lines = ["| harmonic balance | error of amplitude | time (ms) |", "|---|---|---|"]
    lines += [
        f"| {_harmonics(n)} | {a / limit - 1.0:+.1e} | {1e3 * t:.3g} |" for n, a, t in balance
    ]
    lines += [
        "",
        "| periods | error of amplitude | time (s) | as good | times slower |",
        "|---|---|---|---|---|",
    ]
    for k in (1, 3, 5, 7, 9, 11):
        a, spent = in_time[k]
        error = abs(a / settled - 1.0)
        good = [(t, n) for n, b, t in balance if abs(b / limit - 1.0) <= error]
        t, n = min(good, default=(np.nan, 0))
        name = _harmonics(n) if n else "more than 13 harmonics"
        lines.append(
            f"| {25 * (k + 1)} | {a / settled - 1.0:+.1e} | {spent:.3g} | {name} | {f'{spent / t:.0f}' if n else ''} |"
        )
    return (
        f"At {omega / (2.0 * np.pi):.5g} Hz and {PRELOAD_9:g} N, {ring.n} sectors, {steps} steps a period (as few as are "
        f"stable, central differences; twice as many change the amplitude by {abs(step_error):.1e}). Errors of "
        f"harmonic balance are those against 20 harmonics, errors in time those against {25 * len(in_time)} periods. Both "
        f"limits differ by {abs(settled / limit - 1.0):.1e}: points that never slip in the steady state keep the friction "
        f"force that the transient has left there. With the sliders of these points ({rests.sum()} of {rests.size} a "
        f"sector) as the integration has left them, harmonic balance gives {min(given) / limit - 1.0:+.1e} to "
        f"{max(given) / limit - 1.0:+.1e}, depending on the sector whose sliders are taken.\n\n"
        + "\n".join(lines)
    )


def work() -> str:
    """Work that is counted beside processor time that is measured, for curves of several sizes."""
    rows = []
    for points, preload in ((9, 50.0), (9, PRELOAD_9), (24, 200.0), (24, PRELOAD), (48, PRELOAD)):
        for n in (1, 3, 7):
            study = reference_study(points, harmonics=n)
            study.problem.system(preload)
            seconds = []
            for _ in range(REPEATS):
                begin = time.process_time()
                curve = study.frequency_response(preload, INTERVAL)
                seconds.append(time.process_time() - begin)
            rows.append(
                (points, preload, n, len(curve), curve.cost.work, float(np.median(seconds)))
            )
    unit = float(np.median([r[-1] / r[-2] for r in rows]))
    lines = [
        f"One million operations take {1e6 * unit:.3g} microseconds here (median); the ratio is measured over counted.",
        "",
        "| points | preload (N) | harmonics | points of the curve | work (million) | time (ms) | ratio |",
        "|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {p} | {f:g} | {n} | {m} | {w:.0f} | {1e3 * t:.3g} | {t / w / unit:.2f} |"
        for p, f, n, m, w, t in rows
    ]
    return "\n".join(lines)


def _harmonics(n: int) -> str:
    return f"{n} harmonic{'s' if n > 1 else ''}"


LADDERS: dict[str, Callable[[], AccuracyCost]] = {
    "samples": lambda: samples(True),
    "samples_without_separation": lambda: samples(False),
    "samples_peak": peaks_by_samples,
    "harmonics": harmonics,
    "contact_points": lambda: contact_points("unit_traction"),
    "contact_points_residual": lambda: contact_points("residual_modes"),
    "blade_modes": lambda: blade_modes("unit_traction"),
    "blade_modes_residual": lambda: blade_modes("residual_modes"),
    "damper_modes": damper_modes,
    "friction_laws": friction_laws,
    "bases": bases,
    "combined": combined,
}
TABLES: dict[str, Callable[[], str]] = {
    "ways": ways, "jacobians": jacobians, "time_integration": time_integration, "work": work,
    "convergence": convergence_scenes.table, "estimates": estimate_scenes.table,
}  # fmt: skip


def markdown(result: AccuracyCost) -> str:
    """Table of a ladder for documents."""
    names = [name.replace("_", " ") for name in result.varied]
    steps = ", ".join(f"{name} {percent(e)}" for name, e in zip(names, result.last_steps.values()))
    richest = ", ".join(f"{name} {value}" for name, value in zip(names, result.richest.values))
    lines = [
        f"Against {richest}; its last steps: {steps}.",
        "",
        f"| {' | '.join(names)} | error | time (ms) | ratio |",
        "|---" * (len(names) + 3) + "|",
    ]
    for r in sorted(result.runs, key=lambda r: r.seconds):
        error = (
            "richest"
            if r is result.richest
            else f"{r.difference:.1e}"
            if np.isfinite(r.difference)
            else "not known"
        )
        ratio = r.seconds / result.richest.seconds
        lines.append(f"| {' | '.join(r.values)} | {error} | {1e3 * r.seconds:.3g} | {ratio:.2g} |")
    return "\n".join(lines)


FIGURES = {
    "samples": ("Samples, with separation, preload 2 kN", "response at one frequency"),
    "samples_without_separation": (
        "Samples, without separation, preload 2 kN",
        "response at one frequency",
    ),
    "samples_peak": ("Samples, preload 2 kN", "peak"),
    "harmonics": ("Harmonics, preload 5 kN", "peak"),
    "contact_points": ("Contact points, unit tractions, preload 4 kN", "peak"),
    "contact_points_residual": ("Contact points, residual modes, preload 4 kN", "peak"),
    "blade_modes": ("Blade modes, unit tractions, preload 2 kN", "peak"),
    "blade_modes_residual": ("Blade modes, residual modes, preload 2 kN", "peak"),
    "damper_modes": ("Elastic modes of the damper, preload 2 kN", "peak"),
    "combined": ("All settings, preload 6.7 kN", "peak"),
}
"""Title of the figure of a ladder, and what its errors are of."""


def on_page(text: str, name: str) -> AccuracyCost:
    """A ladder as its table on the page says it, with the steps of its reference."""
    (table,) = re.findall(rf"<!-- {name} -->\n(.*?)<!-- end -->", text, re.S)
    head, *rows = [
        line.strip("| ").split(" | ") for line in table.splitlines() if line.startswith("| ")
    ]
    varied = tuple(column.replace(" ", "_") for column in head[:-3])
    (richest,) = (row for row in rows if row[-3] == "richest")
    runs = []
    for *values, error, milliseconds, _ in rows:
        poorer = [n for n, value, best in zip(varied, values, richest) if value != best]
        part = poorer[0] if len(poorer) == 1 else "combination"
        known = {"richest": 0.0, "not known": np.nan}
        number, seconds = (
            known[error] if error in known else float(error),
            float(milliseconds) / 1e3,
        )
        runs.append(
            Run("richest" if error == "richest" else part, tuple(values), 1.0, 1.0, number, seconds)
        )
    runs.sort(
        key=lambda r: (
            r.part != "richest",
            [-int("0" + re.sub(r"\D", "", value)) for value in r.values],
        )
    )
    return AccuracyCost(
        name, PRELOAD, INTERVAL, 0.05 if name == "combined" else SHOWN, varied, tuple(runs)
    )


def draw(name: str, given: AccuracyCost) -> None:
    """The figure of a ladder."""
    title, of = FIGURES[name]
    save_figure(plot_accuracy(given, title=title, of=of), DOCS / "images" / f"accuracy_{name}.png")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "names", nargs="*", help=f"out of {', '.join([*LADDERS, *TABLES])}; all by default"
    )
    parser.add_argument(
        "--write", action="store_true", help="write measured.md and its figures also for some names"
    )
    parser.add_argument(
        "--draw", action="store_true", help="only draw the figures, from the tables of the page"
    )
    given = parser.parse_args()
    if given.draw:
        for name in given.names or FIGURES:
            draw(name, on_page((DOCS / "evidence" / "measured.md").read_text(), name))
        return
    names = given.names or [*LADDERS, *TABLES]
    for name in names:
        begin = time.perf_counter()
        if name in LADDERS:
            result = LADDERS[name]()
            if result.tolerance == ALL:
                result = replace(result, tolerance=SHOWN)
            print(result, flush=True)
            table = markdown(result)
        else:
            table = TABLES[name]()
            print(table, flush=True)
        print(f"({name}: {time.perf_counter() - begin:.0f} s)\n", flush=True)
        if given.write or not given.names:
            page = DOCS / "evidence" / "measured.md"
            page.write_text(fill(page.read_text(), name, table))
            if f"accuracy_{name}.png" in page.read_text():
                draw(name, result)


if __name__ == "__main__":
    main()
