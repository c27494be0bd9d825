"""Limit cycles of a blade in a destabilising flow.

An aerodynamic force proportional to mass times velocity has the form of the force in a nonlinear mode. If the damping
ratios of mode and flow add up to zero, the motion sustains itself and solves the autonomous equations exactly.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from bdamper.analyses.nonlinear_mode import NonlinearMode, mode_system, nonlinear_mode
from bdamper.harmonic_balance.equations import OK, Plane
from bdamper.harmonic_balance.problem import Problem
from bdamper.response.continuation import TWO_PI
from bdamper.response.events import ContinuationOptions
from bdamper.response.optimal_curve import preload_values
from bdamper.util import validation
from bdamper.util.display import Plottable
from bdamper.util.errors import COMPLETE, INCOMPLETE, with_reason
from bdamper.util.formatting import amount, counted, short_repr
from bdamper.util.progress import one_thread, progress_stages, shows_progress
from bdamper.util.storage import Recorded, Storable
from bdamper.util.tables import Hertz, Metres, Newtons, Numbers, Quantity, Tabular


@short_repr
@dataclass(frozen=True)
class Flutter(Plottable, Tabular, Recorded, Storable, kind="bdamper-flutter", row="cycle"):
    """Equilibria and limit cycles of a blade in a flow, over preload and nodal diameter.

    ``plot`` draws them over the preload (:func:`bdamper.plot.plot_flutter`).

    Parameters
    ----------
    preload : (n,) float, N
    nodal_diameter : (n,) int
    amplitude : (n,) float, m
        Amplitude of the first harmonic of the response; 0 for the equilibrium, with frequency and damping of the lowest
        amplitude.
    frequency : (n,) float, Hz
    stable : (n,) bool
        Whether small changes of the amplitude decay. Beyond an unstable limit cycle the amplitude grows to the next stable
        one or without bound.
    highest : float, m
        Upper limit of the searched amplitudes.
    aerodynamic_damping : mapping of nodal diameter to complex
    statuses : tuple of str
        Status of each row.
    settings : mapping
    model_hash : str
    """

    preload: Newtons
    nodal_diameter: Numbers
    amplitude: Metres
    frequency: Hertz
    stable: Numbers
    highest: float
    aerodynamic_damping: dict[str, list[float]]
    statuses: Annotated[tuple[str, ...], Quantity(name="status")]

    @property
    def safe(self) -> NDArray:
        """Amplitude (n,) in m up to which the vibration stays bounded, at preload and nodal diameter of each row.

        Infinite if there is no unstable limit cycle below ``highest``; 0 if the equilibrium and all limit cycles are
        unstable.
        """
        out = np.full(len(self.preload), np.inf)
        for k, case in enumerate(zip(self.preload, self.nodal_diameter)):
            rows = np.flatnonzero((self.preload == case[0]) & (self.nodal_diameter == case[1]))
            bounded = np.maximum.accumulate(self.stable[rows])  # rows from the first stable one
            ends = self.amplitude[rows][~self.stable[rows] & bounded]
            out[k] = 0.0 if not bounded.any() else ends.min(initial=np.inf)
        return out

    def _headline(self) -> str:
        safe = self.safe
        k = int(np.argmin(safe))
        where = f"a preload of {amount(self.preload[k], 'N')} and nodal diameter {self.nodal_diameter[k]}"
        cycles = f"{counted(int(np.count_nonzero(self.amplitude)), 'limit cycle')} found"
        if (stable := self.amplitude[self.stable]).any():
            cycles += f", stable ones up to {amount(stable.max(), 'm')}"
        if np.isinf(safe[k]):
            return (
                f"No flutter: vibration below {amount(self.highest, 'm')} stays bounded, {cycles}."
            )
        if safe[k] == 0.0:
            return f"Flutter: at {where} vibration grows from rest, {cycles}."
        return f"Flutter above {amount(safe[k], 'm')} (least value, at {where}), {cycles}."


@one_thread
def flutter(
    problem: Problem,
    preload: float | tuple[float, float] | Sequence[float] | NDArray,
    aerodynamic_damping: complex | Mapping[int, complex],
    *,
    mode: int = 1,
    amplitude: tuple[float, float] = (1e-6, 1e-2),
    n: int = 9,
    options: ContinuationOptions | None = None,
    progress: bool | None = None,
) -> Flutter:
    """See :meth:`bdamper.Study.flutter`."""
    low, high = validation.interval("amplitude", amplitude, "m")
    if np.ndim(preload):
        values = preload_values(preload, n)
    else:
        values = np.array([problem.check_preload(preload)])  # type: ignore[arg-type]
    own_diameter = problem.model.folded_nodal_diameter(int(problem.engine_order))[0]
    by_diameter = (
        aerodynamic_damping
        if isinstance(aerodynamic_damping, Mapping)
        else {own_diameter: aerodynamic_damping}
    )
    rows: list[tuple[Any, ...]] = []
    with progress_stages(shows_progress(progress), "flutter", "preload") as report:
        for k, (d, value) in enumerate(by_diameter.items()):
            item = f"aerodynamic_damping at nodal diameter {d}"
            flow = complex(
                validation.instance(
                    item, value, (int, float, complex, np.number), "a finite number"
                )
            )
            validation.check_value(np.isfinite(flow), item, "a finite number", value)
            zeta = flow.imag if isinstance(value, complex) else flow.real
            one = (
                problem
                if d == own_diameter
                else problem.replace(engine_order=int(d) or problem.model.n_blades)
            )
            one = _shifted(
                one, flow.real if isinstance(value, complex) else 0.0, float(values[-1]), mode
            )
            curve: NonlinearMode | None = None
            for i, p in enumerate(values[::-1].tolist(), k * len(values)):
                report(f"{p:.4g} N, nodal diameter {d}", i, len(values) * len(by_diameter))
                if curve is None or p > curve.scales_to:
                    reach = (
                        low,
                        high
                        * (values[-1] / values[0] if curve is None and values[0] > 0.0 else 1.0),
                    )
                    curve = nonlinear_mode(one, p, mode, reach, options=options, progress=False)
                    cycles = _cycles(one, curve, zeta)
                s = p / curve.preload if curve.scales_to else 1.0
                rest = zeta + float(curve.damping_ratio[0]) > 0.0
                scaled = [(s * a, *rest_of_it) for a, *rest_of_it in cycles if s * a <= high]
                rows += [
                    (p, d, *row)
                    for row in ((0.0, float(curve.frequency[0]), rest, COMPLETE), *sorted(scaled))
                ]
    preloads, diameters, amplitudes, frequencies, stable, statuses = zip(*rows)
    return Flutter(
        preload=np.array(preloads),
        nodal_diameter=np.array(diameters, int),
        amplitude=np.array(amplitudes),
        frequency=np.array(frequencies),
        stable=np.array(stable, bool),
        highest=high,
        aerodynamic_damping={
            str(d): [complex(z).real, complex(z).imag] for d, z in by_diameter.items()
        },
        statuses=statuses,
        **problem.recorded(options),
    )


def _shifted(problem: Problem, shift: float, preload: float, mode: int) -> Problem:
    """Return the problem with a stiffness proportional to mass that shifts the frequency of the mode."""
    if shift == 0.0:
        return problem
    square = 2.0 * shift * mode_system(problem, preload, mode, 1.0)[1] ** 2
    mean, *others = problem.bases
    moved = [
        replace(
            b,
            omega2=b.omega2 + square * b.mass * (b.omega2 > 0.0),
            damping_ratio=0.0 * b.omega2,
            drag=b.damping,
        )
        for b in others
    ]
    return problem.given(bases=[mean, *moved])


def _cycles(
    problem: Problem, mode: NonlinearMode, zeta: float
) -> list[tuple[float, float, bool, str]]:
    """Return amplitude (m), frequency (Hz), stability and status of the motions with a damping ratio of ``-zeta``."""
    validation.check(
        len(mode), "flutter", f"a mode under {mode.preload:g} N", f"none: {mode.reason}"
    )
    system, _ = mode_system(problem, mode.preload, mode.mode, float(mode.amplitude.min()))
    g, out = mode.damping_ratio + zeta, []
    for i in np.flatnonzero(
        (g[:-1] * g[1:] <= 0.0) & (g[1:] != 0.0) & (mode.branch[:-1] == mode.branch[1:])
    ):
        a, b = (
            system.structure.point(
                mode.unknowns[j], TWO_PI * mode.frequency[j], mode.damping_ratio[j]
            )
            for j in (i, i + 1)
        )
        guess = a + g[i] / (g[i] - g[i + 1]) * (b - a)
        scale = system.units(guess, 1.0)
        c = system.solve(guess, Plane(np.eye(len(guess))[-2]), scale, 1e-10, 20, True)
        solved = c.status == OK
        y, status = (
            (c.y, COMPLETE)
            if solved
            else (guess, with_reason(INCOMPLETE, "between two points of the mode"))
        )
        stable = bool((g[i + 1] - g[i]) * (b[-1] - a[-1]) > 0.0)
        out.append(
            (
                float(system.structure.reference * np.exp(y[-1])),
                float(y[-3]) / TWO_PI,
                stable,
                status,
            )
        )
    return out
