"""Prescribed normal loads and gaps, for structures without a free body that a load would press against its neighbours.

A contact point carries ``N = max(n0 + kn v, 0)`` with the closing ``v`` of the surfaces.  A positive ``n0`` is what an
interference ``-gap = n0/kn`` gives, a negative one a gap ``-n0/kn``.  Under its contact loads the structure gives way;
for the loads at rest to be the prescribed ones, the interference must be larger by that displacement:

    n0 = N_prescribed - kn v,      K q = -G^T F(T, N_prescribed),      v = (G q)_n,

where the friction ``T`` is that of surfaces that stick or slip while the loads are put on.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.preload import static_state
from bdamper.problem.problem import Problem
from bdamper.util import validate
from bdamper.util.errors import SettingError

P = TypeVar("P", bound=Problem)


def prescribe_preload(problem: P, loads: Mapping[str, float | NDArray], *, settled: bool = True) -> P:
    """The same problem with prescribed normal loads and gaps at rest; use it with ``preload=0``.

    Parameters
    ----------
    problem : Problem
        Its model has no free body if ``settled``.
    loads : mapping of interface name to (n_points,) float or float, N
        Normal load of each contact point; a negative one stands for a gap of ``-load/kn``.  Interfaces that are not
        named keep their gaps.
    settled : bool
        The loads are those at rest, after the structure has given way; otherwise those of a structure held in place.

    Returns
    -------
    Problem or Study, as given
        With a model whose gaps (``Interface.gap``, negative for interference) produce the loads.

    Raises
    ------
    SettingError
        If an interface does not exist, a load is not finite or has the wrong shape, a point has no normal stiffness, or
        the structure at rest cannot be found.
    """
    validate.instance("problem", problem, Problem, "a study")
    validate.require(problem.contact_points is None, "prescribed loads", "contact_points=None", problem.contact_points)
    names = problem.coupling.interfaces
    kn = problem.point_stiffness[:, 2]
    target = -kn * problem.point_gaps
    for name, value in validate.mapping("prescribed loads", loads, names, "interfaces").items():
        rows, item = problem.coupling.rows(name), f"prescribed loads of '{name}'"
        n = rows.stop - rows.start
        try:
            target[rows] = np.broadcast_to(np.asarray(value, float), (n,))
        except ValueError as error:
            raise SettingError(f"{item}: expected a number or {n} numbers, found shape {np.shape(value)}") from error
        validate.require(np.isfinite(target[rows]).all(), item, "finite newtons", np.asarray(value))
        validate.require((kn[rows] > 0.0).all(), item, "a positive normal stiffness at every point", kn[rows].min())
    n0 = target.copy()
    if settled:
        free = [body.name for body in problem.model.bodies.values() if body.kind == "free"]
        validate.require(not free, "prescribed loads", "no free body (or settled=False)", free)
        basis = problem.static_basis
        # a normal spring that is all but missing keeps N at its prescribed value while the structure moves
        state = static_state(replace(problem.static_system, kn=1e-12 * kn, n0=target), 0.0)
        if not state.converged:
            raise SettingError(f"prescribed loads: expected a structure that can carry them at rest, found: {state.note}")
        n0 = target - kn * (basis.G.real @ state.q)[:, 2]
    interfaces = dict(problem.model.interfaces)
    for name in names:
        rows = problem.coupling.rows(name)
        stiff = kn[rows] > 0.0
        gap = np.where(stiff, -n0[rows] / np.where(stiff, kn[rows], 1.0), interfaces[name].gap)
        interfaces[name] = replace(interfaces[name], gap=gap)
    return replace(problem, model=replace(problem.model, interfaces=interfaces))
