"""Normal loads of each contact point, with gaps where they are negative.

Loads of whole interfaces are settings of a study, ``fixed_loads``; here there may be points of one interface that are
apart at rest.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from bdamper.problem.asked import asked
from bdamper.problem.problem import Problem
from bdamper.util import validate
from bdamper.util.errors import SettingError


@asked
def prescribe_preload(problem: Problem, loads: Mapping[str, float | NDArray], *, settled: bool = True) -> Problem:
    """The same problem with normal loads of contact points and gaps between others; use it with ``preload=0``.

    Parameters
    ----------
    problem : Problem
    loads : mapping of interface name to (n_points,) float or float, N
        Normal load of each contact point, a number for all of an interface alike; a negative one stands for a gap of
        ``-load/kn``.  Interfaces that are not named keep their gaps and loads.
    settled : bool
        The loads are those at rest, after the structure has given way, whatever the other settings are
        (``fixed_loads``); otherwise those of a structure held in place, ``kn`` times an interference that stays.

    Returns
    -------
    Problem or Study, as given
        With ``fixed_loads`` and ``gap`` among its settings.

    Raises
    ------
    SettingError
        If an interface does not exist or is pressed by a free body, a load is not finite or has the wrong shape, a point
        has no normal stiffness, or the structure at rest cannot be found.
    """
    gaps, fixed = dict(problem.settings.gap or {}), dict(problem.settings.fixed_loads or {})
    for name, value in validate.mapping("prescribed loads", loads, problem.coupling.interfaces, "interfaces").items():
        item, kn = f"prescribed loads of '{name}'", problem.point_stiffness[problem.coupling.rows(name), 2]
        try:
            values = np.broadcast_to(np.asarray(value, float), kn.shape)
        except ValueError as error:
            raise SettingError(f"{item}: expected a number or {len(kn)} numbers, found shape {np.shape(value)}") from error
        validate.require(np.isfinite(values).all(), item, "finite newtons", np.asarray(value))
        validate.require((kn > 0.0).all(), item, "a positive normal stiffness at every point", kn.min())
        if settled:
            fixed[name] = values
        else:
            gaps[name] = -values / kn
    return problem.with_(gap=gaps or None, fixed_loads=fixed or None)
