"""Limit cycles of a blade in a destabilising flow.

An aerodynamic force proportional to mass times velocity has the form of the force in a nonlinear
mode. If the damping ratios of mode and flow add up to zero, the motion sustains itself and solves
the autonomous equations exactly.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bdamper.analyses.nonlinear_mode import NonlinearMode, mode_system, nonlinear_mode
from bdamper.harmonic_balance.equations import OK, Plane
from bdamper.harmonic_balance.problem import Problem
from bdamper.response.continuation import TWO_PI
from bdamper.response.events import ContinuationOptions
from bdamper.response.optimal_curve import preload_values
from bdamper.util import validation
from bdamper.util.display import Plottable, Result
from bdamper.util.errors import COMPLETE, INCOMPLETE, Ending, separated
from bdamper.util.formatting import amount, listed, short_repr
from bdamper.util.progress import one_thread, progress_stages, shows_progress
from bdamper.util.records import Data
from bdamper.util.statement import Row, Statement
from bdamper.util.storage import Recorded, Storable
from bdamper.util.tables import Hertz, Metres, Newtons, Numbers, Quantity, Tabular


@short_repr
@dataclass(frozen=True)
class Flutter(Result, Plottable, Tabular, Recorded, Storable, kind="bdamper-flutter", row="cycle"):
    """Equilibria and limit cycles of a blade in a flow, for each preload and nodal diameter.

    ``plot`` draws them against the preload (:func:`bdamper.plot.plot_flutter`).

    Parameters
    ----------
    preload : (n,) float, N
    nodal_diameter : (n,) int
    amplitude : (n,) float, m
        Amplitude of the first harmonic of the response; 0 for the equilibrium, with frequency and
        damping of the lowest amplitude.
    frequency : (n,) float, Hz
    stable : (n,) bool
        Whether small changes of the amplitude decay. Beyond an unstable limit cycle the amplitude
        grows to the next stable one or without bound.
    highest : float, m
        Upper limit of the searched amplitudes.
    aerodynamic_damping : mapping of nodal diameter to complex
    statuses, reasons : tuple of str
        Status of each row, and the reason for it.
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
    reasons: Annotated[tuple[str, ...], Data(derived=True), Quantity(name="reason")] = ()

    def __post_init__(self) -> None:
        if not self.reasons:
            # files of version 0.10 have the reasons in the statuses
            pairs = [separated(text) for text in self.statuses]
            object.__setattr__(self, "statuses", tuple(status for status, _ in pairs))
            object.__setattr__(self, "reasons", tuple(reason for _, reason in pairs))

    @property
    def safe(self) -> NDArray:
        """Largest amplitude up to which the vibration stays bounded, m, (n,).

        Each value belongs to the preload and nodal diameter of its row.  The amplitude is infinite
        if there is no unstable limit cycle below ``highest``; 0 if the equilibrium and all limit
        cycles are unstable.
        """
        safe = np.full(len(self.preload), np.inf)
        for i in range(len(self.preload)):
            same_preload = self.preload == self.preload[i]
            same_diameter = self.nodal_diameter == self.nodal_diameter[i]
            rows = np.flatnonzero(same_preload & same_diameter)
            stable = self.stable[rows]
            # rows from the first stable one
            bounded = np.maximum.accumulate(stable)
            if bounded.any():
                ends = self.amplitude[rows][~stable & bounded]
                safe[i] = ends.min(initial=np.inf)
            else:
                safe[i] = 0.0
        return safe

    def _statement(self) -> Statement:
        safe = self.safe
        least = int(np.argmin(safe))
        highest = amount(self.highest, "m")
        stable = self.amplitude[self.stable & (self.amplitude > 0.0)]
        leaves_rest = bool(np.any(~self.stable & (self.amplitude == 0.0)))
        from_rest = ""
        if leaves_rest and stable.size:
            from_rest = f"limit cycles of up to {amount(stable.max(), 'm')} from rest"
        if safe[least] == 0.0:
            verdict = f"Flutter from rest: {self._where(safe == 0.0)}"
        elif np.isinf(safe[least]) and from_rest:
            verdict = (
                f"Bounded flutter: {from_rest}; no vibration below {highest} grows without bound"
            )
        elif np.isinf(safe[least]) and not stable.size:
            verdict = f"No flutter: stable at rest, no limit cycle up to {highest}"
        elif np.isinf(safe[least]):
            verdict = f"No flutter: no vibration below {highest} grows without bound"
        else:
            verdict = (
                f"Flutter above {amount(safe[least], 'm')}: {self._where(safe == safe[least])}"
            )
            if from_rest:
                verdict += f"; {from_rest}"
        n_cycles = int(np.count_nonzero(self.amplitude))
        largest = f"stable up to {amount(stable.max(), 'm')}" if stable.size else ""
        rows = [
            Row("Limit cycles", str(n_cycles), largest),
            Row("Amplitudes", f"up to {highest}", "searched"),
        ]
        elsewhere = np.isfinite(safe) & (safe > safe[least])
        if elsewhere.any():
            lowest = amount(safe[elsewhere].min(), "m")
            rows.insert(0, Row("Flutter above", lowest, f"or more: {self._where(elsewhere)}"))
        table, further = self._few_rows()
        remarks = list(further)
        if np.any(self.amplitude == 0.0):
            remarks.append("Rows with amplitude 0 are the state of rest")
        return Statement([verdict], rows, remarks=remarks, table=table)

    def _where(self, rows: NDArray) -> str:
        """Return the preloads and nodal diameters of some rows (n,) bool."""
        all_preloads = np.unique(self.preload)
        preloads = np.unique(self.preload[rows])
        loads = listed(amount(preload, "N") for preload in preloads)
        if len(all_preloads) == 1:
            text = f"preload {loads}"
        elif len(preloads) == len(all_preloads):
            ends = f"{amount(preloads[0], 'N')} to {amount(preloads[-1], 'N')}"
            text = f"all {len(preloads)} preloads, {ends}"
        else:
            text = f"{len(preloads)} of {len(all_preloads)} preloads, {loads}"
        diameters = np.unique(self.nodal_diameter[rows])
        numbers = listed(map(str, diameters))
        return f"{text}; nodal diameter{'s' if len(diameters) > 1 else ''} {numbers}"


class _Motion(NamedTuple):
    """Limit cycle or equilibrium: amplitude (m), frequency (Hz), stability, status and reason."""

    amplitude: float
    frequency: float
    stable: bool
    status: str = COMPLETE
    reason: str = ""


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
    if isinstance(aerodynamic_damping, Mapping):
        by_diameter = aerodynamic_damping
    else:
        by_diameter = {own_diameter: aerodynamic_damping}
    rows: list[tuple[float, int, _Motion]] = []
    n_steps = len(values) * len(by_diameter)
    with progress_stages(shows_progress(progress), "flutter", "preload") as report:
        for k, (diameter, value) in enumerate(by_diameter.items()):
            shift, damping_ratio = _shift_and_damping(diameter, value)
            at_diameter = problem
            if diameter != own_diameter:
                # the engine order n_blades excites nodal diameter 0
                order = int(diameter) or problem.model.n_blades
                at_diameter = problem.replace(engine_order=order)
            at_diameter = _shifted(at_diameter, shift, float(values[-1]), mode)
            curve: NonlinearMode | None = None
            # from the highest preload, because a mode scales to lower ones
            for i, p in enumerate(values[::-1].tolist(), k * len(values)):
                report(f"{p:.4g} N, nodal diameter {diameter}", i, n_steps)
                if curve is None or p > curve.scales_to:
                    reach = high
                    # cycles at the lowest preload are scaled from larger amplitudes
                    if curve is None and values[0] > 0.0:
                        reach = high * (values[-1] / values[0])
                    curve = nonlinear_mode(
                        at_diameter, p, mode, (low, reach), options=options, progress=False
                    )
                    cycles = _cycles(at_diameter, curve, damping_ratio)
                factor = p / curve.preload if curve.scales_to else 1.0
                scaled = [cycle._replace(amplitude=factor * cycle.amplitude) for cycle in cycles]
                within = sorted(cycle for cycle in scaled if cycle.amplitude <= high)
                rest_is_stable = damping_ratio + float(curve.damping_ratio[0]) > 0.0
                equilibrium = _Motion(
                    amplitude=0.0, frequency=float(curve.frequency[0]), stable=rest_is_stable
                )
                rows += [(p, diameter, motion) for motion in (equilibrium, *within)]
    motions = [motion for _, _, motion in rows]
    return Flutter(
        preload=np.array([p for p, _, _ in rows]),
        nodal_diameter=np.array([diameter for _, diameter, _ in rows], int),
        amplitude=np.array([motion.amplitude for motion in motions]),
        frequency=np.array([motion.frequency for motion in motions]),
        stable=np.array([motion.stable for motion in motions], bool),
        highest=high,
        aerodynamic_damping={
            str(diameter): [complex(value).real, complex(value).imag]
            for diameter, value in by_diameter.items()
        },
        statuses=tuple(motion.status for motion in motions),
        reasons=tuple(motion.reason for motion in motions),
        **problem.recorded(options),
    )


def _shift_and_damping(diameter: int, value: Any) -> tuple[float, float]:
    """Return the relative frequency shift and the aerodynamic damping ratio.

    A complex number has both, a real one is the damping ratio.
    """
    item = f"aerodynamic_damping at nodal diameter {diameter}"
    kinds = (int, float, complex, np.number)
    flow = complex(validation.instance(item, value, kinds, "a finite number"))
    validation.check_value(np.isfinite(flow), item, "a finite number", value)
    if isinstance(value, complex):
        return flow.real, flow.imag
    return 0.0, flow.real


def _shifted(problem: Problem, shift: float, preload: float, mode: int) -> Problem:
    """Return the problem with a stiffness proportional to mass that shifts a mode."""
    if shift == 0.0:
        return problem
    # the stuck frequency does not depend on the amplitude, here 1 m
    _, omega = mode_system(problem, preload, mode, low=1.0)
    stiffness_per_mass = 2.0 * shift * omega**2
    mean, *harmonics = problem.bases
    shifted = []
    for basis in harmonics:
        # rigid body modes keep their frequency of zero
        elastic = basis.omega2 > 0.0
        moved = replace(
            basis,
            omega2=basis.omega2 + stiffness_per_mass * basis.mass * elastic,
            damping_ratio=0.0 * basis.omega2,
            drag=basis.damping,
        )
        shifted.append(moved)
    return problem.given(bases=[mean, *shifted])


def _cycles(problem: Problem, mode: NonlinearMode, damping_ratio: float) -> list[_Motion]:
    """Return the motions of a mode whose damping cancels the damping ratio of the flow."""
    validation.check(
        len(mode), "flutter", f"a mode under {mode.preload:g} N", f"none: {mode.reason}"
    )
    system, _ = mode_system(problem, mode.preload, mode.mode, low=float(mode.amplitude.min()))

    def point(i: int) -> NDArray:
        omega = TWO_PI * mode.frequency[i]
        return system.structure.point(mode.unknowns[i], omega, mode.damping_ratio[i])

    total = mode.damping_ratio + damping_ratio
    crosses = (total[:-1] * total[1:] <= 0.0) & (total[1:] != 0.0)
    same_branch = mode.branch[:-1] == mode.branch[1:]
    cycles = []
    for i in np.flatnonzero(crosses & same_branch).tolist():
        before = point(i)
        after = point(i + 1)
        share = total[i] / (total[i] - total[i + 1])
        y = before + share * (after - before)
        # at constant damping ratio, the last unknown but one
        constant_damping = Plane(np.eye(len(y))[-2])
        solution = system.solve(
            y,
            constant_damping,
            system.units(y, 1.0),
            tolerance=1e-10,
            max_iterations=20,
            line_search=1,
        )
        ending = Ending()
        if solution.status == OK:
            y = solution.y
        else:
            interpolated = (
                "the limit cycle is interpolated between two points of the nonlinear mode, because "
                "its equations did not converge"
            )
            ending = Ending(INCOMPLETE, interpolated)
        # damping that rises with the amplitude is stable
        stable = bool((total[i + 1] - total[i]) * (after[-1] - before[-1]) > 0.0)
        amplitude = float(system.structure.reference * np.exp(y[-1]))
        frequency = float(y[-3]) / TWO_PI
        cycles.append(_Motion(amplitude, frequency, stable, ending.status, ending.reason))
    return cycles
