r"""First loading of a seated damper along its faces: force over displacement at constant preload.

The static equations of :mod:`bdamper.contact.static_state` under the load :math:`P` that seats the damper, then a force
:math:`Q` at a location of it, growing from zero while :math:`P` stays:

.. math:: K q + G^T F(G q + P x_0) = P f + Q d,

:math:`d` the modes of the location in the direction of :math:`Q`.  Residual modes do not move the location and :math:`Q`
does no work on them, so curves of different contact stiffnesses differ by the contact alone.  As points begin to slip one
after the other the slope decreases from the stuck stiffness to zero, at the force at which the damper slides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bdamper.analyses.sweep import SweepResult
from bdamper.contact.static_state import OPEN, SLIP_MINUS, SLIP_PLUS, PreloadState, static_state
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.study_dispatch import asked
from bdamper.model.loads import direction_vector
from bdamper.util import validation
from bdamper.util.errors import ModelError, SettingError
from bdamper.util.status import COMPLETE, FAILED, because


@asked
def microslip(
    problem: Problem,
    preload: float,
    forces: Sequence[float] | NDArray,
    *,
    location: str = "damper",
    direction: tuple[float, float, float] = (0.0, 0.0, 1.0),
) -> SweepResult:
    """Displacement of a location under forces that grow while the load stays.

    Parameters
    ----------
    problem : Problem
    preload : float, N
    forces : (n,) float, N
        Increasing, above zero.
    location : str
    direction : (3,) float
        Of the force, along X, Y, Z.

    Returns
    -------
    SweepResult
        Over "force", from zero: "displacement" of the location along it (m), since the force is there; "slipping" and
        "open", shares of the closed points that slip in either direction and of all points that are apart; "residual" of
        modal equilibrium, relative.  Forces under which the damper slides have failed.

    Raises
    ------
    SettingError
        If the forces do not increase from zero.
    ModelError
        If there is no static state under the preload.
    """
    wanted = validation.numbers("microslip forces", forces, above=0.0, unit="N")
    validation.that(not np.any(np.diff(wanted) <= 0.0), "microslip forces", "increasing forces above 0 N", forces)
    validation.choice("microslip location", location, sorted(problem.model.locations))
    seat = problem.static(preload)
    if not seat.converged:
        raise ModelError(f"microslip: no static state under {preload:g} N: {seat.note}")
    basis = problem.static_basis
    along = problem.coupling.location_modes(location, 0).real
    d = direction_vector(direction, "microslip direction") @ np.pad(along, ((0, 0), (0, basis.n_modes - along.shape[1])))
    if not np.any(d):
        raise SettingError(f"microslip: expected a location that moves along {direction}, '{location}' does not")
    own = problem.static_system
    system = replace(
        own, force=d.real, shift=np.zeros_like(own.shift), constant_force=preload * own.force + own.constant_force,
        constant_shift=own.shift_at(preload),
    )  # fmt: skip
    state = replace(seat, load=0.0)
    values = [_answers(state, 0.0)]
    for force in wanted:
        state = static_state(system, float(force), start=state, steps=2)
        if not state.converged:
            break
        values.append(_answers(state, float(d.real @ (state.q - seat.q))))
    beyond = len(wanted) + 1 - len(values)
    status = (COMPLETE,) * len(values) + (because(FAILED, "the damper slides"),) * beyond
    points = tuple({"force": force} for force in (0.0, *wanted.tolist()))
    found = (*values, *[{}] * beyond)
    return SweepResult(("force",), points, found, status, np.zeros(len(points)), (len(points),), **problem.recorded())


def _answers(state: PreloadState, moved: float) -> dict[str, float]:
    closed = float(np.mean(state.status[:, 0] != OPEN))
    slips = float(((state.status == SLIP_PLUS) | (state.status == SLIP_MINUS)).any(axis=1).mean())
    slipping = slips / max(closed, 1e-300)
    return {"displacement": moved, "slipping": slipping, "open": 1.0 - closed, "residual": state.residual}
