r"""First loading of a seated damper along its faces: force over displacement at constant preload.

The static equations of :mod:`bdamper.contact.preload` under the load :math:`P` that seats the damper, then a force
:math:`Q` at a location of it, growing from zero while :math:`P` stays:

.. math:: K q + G^T F(G q + P x_0) = P f + Q d,

:math:`d` the modes of the location in the direction of :math:`Q`.  Residual modes do not move the location and :math:`Q`
does no work on them, so curves of different contact stiffnesses differ by the contact alone.  As points begin to slip one
after the other the slope decreases from the stuck stiffness to zero, at the force at which the damper slides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.preload import OPEN, SLIP_MINUS, SLIP_PLUS, static_state
from bdamper.model.loads import direction_vector
from bdamper.problem.asked import asked
from bdamper.problem.problem import Problem
from bdamper.util import validate
from bdamper.util.errors import ModelError, SettingError
from bdamper.util.hdf5 import Storable
from bdamper.util.plotting import Plottable
from bdamper.util.repr import brief
from bdamper.util.tables import Metres, Newtons, Numbers, Tabular
from bdamper.util.text import amount, percent


@brief
@dataclass(frozen=True)
class Microslip(Plottable, Tabular, Storable, kind="bdamper-microslip"):
    """A curve of first loading.

    ``plot`` draws force over displacement (:func:`bdamper.plot.plot_microslip`).

    Parameters
    ----------
    preload : float, N
    force : (n,) float, N
        From zero, as far as equilibria were found.
    displacement : (n,) float, m
        Of the location along the force, since the force is there.
    slipping, open : (n,) float
        Share of the closed points that slip in either direction; share of all points that are apart.
    residual : (n,) float
        Of modal equilibrium, relative.
    complete : bool
        Whether the last force asked for was reached; otherwise the damper slides.
    """

    preload: float
    force: Newtons
    displacement: Metres
    slipping: Numbers
    open: Numbers
    residual: Numbers
    complete: bool

    @property
    def stiffness(self) -> NDArray:
        """(n - 1,) slope of the chords between neighbouring forces, N/m."""
        return np.diff(self.force) / np.diff(self.displacement)

    def bottom_line(self) -> str:
        way = f"{amount(self.displacement[-1], 'm')} under {amount(self.force[-1], 'N')}"
        slips = f"{percent(self.slipping[-1])} of the contact slips{'' if self.complete else ', beyond it slides'}"
        return f"At a preload of {amount(self.preload, 'N')} the damper moves by {way}; {slips}."


@asked
def microslip(
    problem: Problem,
    preload: float,
    forces: Sequence[float] | NDArray,
    *,
    location: str = "damper",
    direction: tuple[float, float, float] = (0.0, 0.0, 1.0),
) -> Microslip:
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
    Microslip

    Raises
    ------
    SettingError
        If the forces do not increase from zero.
    ModelError
        If there is no static state under the preload.
    """
    validate.instance("problem", problem, Problem)
    wanted = validate.numbers("microslip forces", forces, above=0.0, unit="N")
    validate.that(not np.any(np.diff(wanted) <= 0.0), "microslip forces", "increasing forces above 0 N", forces)
    validate.choice("microslip location", location, sorted(problem.model.locations))
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
    states, reached = [state], [0.0]
    for force in wanted:
        state = static_state(system, float(force), start=state, steps=2)
        if not state.converged:
            break
        states.append(state)
        reached.append(float(force))
    closed = np.array([np.mean(s.status[:, 0] != OPEN) for s in states])
    slips = [((s.status == SLIP_PLUS) | (s.status == SLIP_MINUS)).any(axis=1).mean() for s in states]
    moved, residual = (np.array(x) for x in zip(*((d.real @ (s.q - seat.q), s.residual) for s in states)))
    slipping = np.array(slips) / np.maximum(closed, 1e-300)
    return Microslip(float(preload), np.array(reached), moved, slipping, 1.0 - closed, residual, state.converged)
