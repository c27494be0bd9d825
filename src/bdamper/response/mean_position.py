"""Mean positions of free bodies along a curve: where they drift, what does not determine them, why there is none."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from bdamper.harmonic_balance.equations import Correction, Equations
from bdamper.harmonic_balance.sector import Sector
from bdamper.model.kinematics import Coordinate
from bdamper.model.structure import Model
from bdamper.response.continuation import TWO_PI


def _displacement(model: Model, coordinate: Coordinate, q: float) -> str:
    body = model.bodies.get(coordinate.body)  # residual modes belong to none
    if body is not None and body.mass is not None and coordinate.name in ("TX", "TY", "TZ"):
        return f"{q / np.sqrt(body.mass):.3g} m"
    return f"{q:.3g} kg^1/2 m"


def notes(
    system: Equations[Sector], model: Model, coordinates: Sequence[Coordinate], points: Sequence[Correction]
) -> tuple[str, ...]:
    """Stretches on which the mean position drifts, and mean positions determined by least norm only."""
    out = []
    stretches = ((kind, list(pairs)) for kind, pairs in groupby(enumerate(points), key=lambda pair: pair[1].kind))
    for stretch in (pairs for kind, pairs in stretches if kind == "drift"):
        (first, point), (_, last) = stretch[0], stretch[-1]
        a, b = points[max(first - 1, 0)].y, last.y
        k = int(np.argmax(np.abs((b - a)[: system.n_mean])))
        c = coordinates[k]
        out.append(
            f"{c.body} drifts along {c.name} at {point.y[-1] / TWO_PI:.6g} Hz, where its mean force vanishes: from "
            f"{_displacement(model, c, a[k])} to {_displacement(model, c, b[k])}"
        )
    free = [p for p in points if p.rank_deficiency > 0]
    if free:
        some = free[:: max(1, len(free) // 20)]
        names = sorted({name for p in some for name in neutral_directions(system, coordinates, p.y)})
        out.append(f"nothing determines the mean along {', '.join(names)} at {len(free)} points: held by least norm")
    return tuple(out)


def neutral_directions(system: Equations[Sector], coordinates: Sequence[Coordinate], y: NDArray) -> list[str]:
    """Names of the mean coordinates that dominate the null space of the mean part of the Jacobian."""
    n = system.n_mean
    columns = system.evaluate_at(y)[1][:, :n]
    size = np.abs(columns).max(axis=0)
    size = np.where(size > 1e-13 * size.max(), size, size.max())
    _, s, vt = np.linalg.svd(columns / size)
    s = np.concatenate([s, np.zeros(n - len(s))])
    names = []
    for row in vt[s < 1e-11 * max(s[0], 1e-300)]:
        k = int(np.argmax(np.abs(row / size)))
        names.append(f"{coordinates[k].name} of {coordinates[k].body}")
    return names


def why_no_solution(system: Equations[Sector], model: Model, coordinates: Sequence[Coordinate], y: NDArray) -> str:
    """If a free body cannot be in equilibrium where Newton ended: which mean force is left, and what that means."""
    try:
        r, J, _ = system.evaluate(y[:-1], y[-1])
    except FloatingPointError:
        return ""
    _, _, share = system.contact(y[:-1])
    for k, c in enumerate(coordinates):
        body = model.bodies.get(c.body)  # residual modes belong to none
        if body is None or body.kind != "free" or not c.name.startswith("T") or body.mass is None:
            continue
        force = float(r[k]) * np.sqrt(body.mass)
        stiff = float(np.abs(J[k]).max())
        if abs(r[k]) * system.row_scale[k] > 1e-6 and stiff < 1e-9 * float(np.abs(J).max()):
            if share[:, 4].min() >= 1.0:
                return (
                    f"no periodic solution: all contacts of {c.body} are open through the cycle and a static load of "
                    f"{abs(force):.3g} N acts along {c.name}"
                )
            return (
                f"no periodic solution near here: a mean force of {force:.3g} N along {c.name} drives {c.body}, whatever "
                "its mean position; it drifts until a constraint plane carries load, and none does"
            )
    return ""
