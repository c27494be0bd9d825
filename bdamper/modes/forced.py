"""Peaks under excitation, from a nonlinear mode.

At a resonance the excitation does the work that the losses of the mode take, ``xi omega Q_1^H M Q_1 = |Q_1^H f|``, a
quarter of a period ahead of the motion.  The mode alone is off by the answer of the other modes and by what the
excitation changes of its shape, so it is no more than a start for Newton's method on the peak itself.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bdamper.continuation.follower import TWO_PI
from bdamper.modes.result import NonlinearMode
from bdamper.peaks.newton import Peak, PeakOptions, find_peak, same_peak
from bdamper.problem.problem import Problem
from bdamper.problem.settings import check_result
from bdamper.util import validate
from bdamper.util.blas import one_thread


@one_thread
def peaks_from_mode(
    problem: Problem, mode: NonlinearMode, force: float | None = None, *, options: PeakOptions | None = None
) -> tuple[Peak, ...]:
    """Peaks of the forced response at which the excitation balances the damping of a mode.

    Parameters
    ----------
    problem : Problem
    mode : NonlinearMode
        Of this problem, or the same at another preload (:meth:`~bdamper.modes.result.NonlinearMode.at_preload`).
    force : float, N, optional
        Level of the excitation; that of the problem by default.
    options : PeakOptions

    Returns
    -------
    tuple of Peak
        Each solves its own equations; in the order of the branch.  Several where the damping falls again with the
        amplitude; none where the amplitudes of the mode do not reach so far.
    """
    check_result(problem, validate.instance("mode", mode, NonlinearMode), "mode")
    if force is not None:
        problem = problem.with_(excitation=replace(problem.excitation, amplitude=force))
    system = problem.system(mode.preload)
    c, s = system.slices(1)
    omega = TWO_PI * mode.frequency
    work = system.amplitudes(mode.unknowns, 1).conj() @ (system.force[c] - 1j * system.force[s])
    surplus = np.log(np.abs(work) / (2.0 * mode.damping_ratio * (omega * mode.modal_amplitude) ** 2))
    found: list[Peak] = []
    for i in np.flatnonzero((surplus[:-1] * surplus[1:] <= 0.0) & (mode.branch[:-1] == mode.branch[1:])):
        turn = np.angle(work[i]) - 0.5 * np.pi
        for part in (surplus[i] / (surplus[i] - surplus[i + 1]), 0.0, 1.0):  # between two points, or at either
            u = mode.unknowns[i] + part * (mode.unknowns[i + 1] - mode.unknowns[i])
            for l in range(1, system.n_harmonics + 1):
                a, (c, s) = system.amplitudes(u, l) * np.exp(1j * l * turn), system.slices(l)
                u[c], u[s] = a.real, -a.imag
            guess = np.append(u, omega[i] + part * (omega[i + 1] - omega[i]))
            peak = find_peak(system, guess, options=options, parameter=mode.preload)
            if peak.converged:
                break
        if peak.converged and not any(same_peak(peak, other) for other in found):
            found.append(replace(peak, **problem.recorded()))
    return tuple(found)
