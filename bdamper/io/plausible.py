"""Numbers that no machine has: mistaken units are suspected and named."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from bdamper.errors import mismatch
from bdamper.io.fe_body import UNITS
from bdamper.io.prepare import PreparedBody
from bdamper.model import Body
from bdamper.reduction.free_body import rigid_motions
from bdamper.reduction.structure import Structure

SIZE = (1e-3, 30.0)
"""Largest extent of a body, m."""

DENSITY = (200.0, 30000.0)
"""Mass over volume, kg/m3."""

FREQUENCY = (0.1, 5e6)
"""Lowest elastic frequency, Hz."""

AGREEMENT = 0.01
"""Relative difference up to which two programs are said to agree on a frequency."""

RIGID_TOLERANCE = 1e-4
"""Force of a rigid motion relative to the forces that cancel in it."""


def ratio_in_words(ratio: float) -> str | None:
    """What a ratio of two frequencies that should be equal looks like; None if like nothing in particular."""
    candidates = {
        "2 pi: hertz against radians per second": 2.0 * np.pi,
        "1/(2 pi): radians per second against hertz": 0.5 / np.pi,
    }
    for k in range(-12, 13):
        if k != 0:
            words = f"10^{k // 2}" if k % 2 == 0 else f"10^({k}/2)"
            candidates[f"{words}: units of length, mass or force (mm and m, t and kg)"] = 10.0 ** (0.5 * k)
    for words, value in candidates.items():
        if abs(ratio / value - 1.0) < 0.02:
            return words
    return None


def compare_frequencies(found: NDArray, expected: NDArray, item: str, source: str) -> float:
    """Largest relative difference of the frequencies that both have.

    Raises
    ------
    ModelError
        If they do not agree; a ratio that looks like a mistaken unit is named.
    """
    n = min(len(found), len(expected))
    if n == 0:
        raise mismatch(item, f"frequencies to compare with {source}", "none")
    found, expected = np.sort(found)[:n], np.sort(expected)[:n]
    ratio = found / np.maximum(expected, 1e-300)
    error = float(np.abs(ratio - 1.0).max())
    if error <= AGREEMENT:
        return error
    middle = float(np.median(ratio))
    shown = ", ".join(f"{f:.6g}" for f in found[:3])
    wanted = ", ".join(f"{f:.6g}" for f in expected[:3])
    words = ratio_in_words(middle) if np.abs(ratio / middle - 1.0).max() < 0.02 else None
    suspicion = f"; the ratio {middle:.6g} is {words}" if words else f"; ratios {ratio.min():.4g} to {ratio.max():.4g}"
    raise mismatch(item, f"the frequencies of {source}, {wanted}, ... Hz", f"{shown}, ... Hz{suspicion}")


def check_frequencies_against(
    frequencies: Mapping[int, NDArray], expected: Mapping[int, Sequence[float]], name: str, source: str
) -> str:
    """Compare with what the user knows; the text of the check."""
    worst = 0.0
    for d, values in expected.items():
        if d not in frequencies:
            raise mismatch(source, f"nodal diameters out of {sorted(frequencies)}", d)
        item = f"{name}, nodal diameter {d}"
        worst = max(worst, compare_frequencies(frequencies[d], np.asarray(values, float), item, source))
    return f"frequencies agree with {source} to {100 * worst:.2g} %"


def check_rigid_motion(body: PreparedBody, structure: Structure) -> None:
    """A stiffness matrix of a free body resists no rigid motion of its nodes."""
    centre = structure.nodes.mean(axis=0)
    motion = rigid_motions(structure.nodes, centre, np.eye(3))
    force = np.abs(structure.stiffness @ motion).max(axis=0)
    size = (abs(structure.stiffness) @ np.abs(motion)).max(axis=0)
    share = force / np.maximum(size, 1e-300)
    worst = int(np.argmax(share))
    if share[worst] > RIGID_TOLERANCE:
        if share[:3].max() > RIGID_TOLERANCE:
            hint = "fixed nodes, springs to the ground, or a table of nodes and components that does not belong to it"
        else:
            hint = "positions that do not belong to it (order, units, axes), or nodes with axes of their own"
        kind = "translation along" if worst < 3 else "rotation about"
        raise mismatch(
            f"{body.where}: stiffness matrix",
            "a free body, which no rigid motion strains",
            f"a force {share[worst]:.2g} of its size under a {kind} {'XYZ'[worst % 3]}: {hint}",
        )
    body.checks.append(f"{body.name}: rigid motions cost {share.max():.1g} of the forces that cancel in them")


def check_sizes(body: PreparedBody, made: Body) -> list[str]:
    """Refuse sizes, densities and frequencies far from anything built; the texts of the checks otherwise."""
    texts = []
    given = next((name for name, u in UNITS.items() if u == body.place.units), "the given units")
    override = "pass check_units=False if they are right"
    if not SIZE[0] <= body.size <= SIZE[1]:
        factor = "millimetres" if body.size > SIZE[1] else "another unit of length"
        raise mismatch(
            f"{body.where}: positions",
            f"an extent of {SIZE[0]:g} to {SIZE[1]:g} m",
            f"{body.size:.4g} m with units='{given}': {factor} suspected; {override}",
        )
    texts.append(f"{body.name}: extent {body.size:.4g} m")
    if body.volume is not None and body.has_matrices:
        along = np.tile([0.0, 0.0, 1.0], len(body.nodes))
        mass = float(along @ (body.structure.mass @ along))
        density = mass / body.volume if body.volume > 0 else np.inf
        if not DENSITY[0] <= density <= DENSITY[1]:
            u = body.place.units
            raw = density / u.mass * u.length**3
            fitting = [k for k, v in UNITS.items() if DENSITY[0] <= raw * v.mass / v.length**3 <= DENSITY[1]]
            hint = f"units='{fitting[0]}' would fit" if fitting else "the mass matrix is in other units"
            raise mismatch(
                f"{body.where}: mass matrix",
                f"a density of {DENSITY[0]:g} to {DENSITY[1]:g} kg/m3",
                f"{density:.4g} kg/m3 with units='{given}': {hint}; {override}",
            )
        texts.append(f"{body.name}: mass {mass:.6g} kg on free nodes, volume {body.volume:.6g} m3, {density:.4g} kg/m3")
    for d, basis in made.bases.items():
        elastic = basis.omega2[basis.omega2 > 0.0]
        if len(elastic):
            lowest = float(np.sqrt(elastic.min()) / (2.0 * np.pi))
            if not FREQUENCY[0] <= lowest <= FREQUENCY[1]:
                raise mismatch(
                    f"{body.where}: nodal diameter {d}",
                    f"a lowest frequency of {FREQUENCY[0]:g} to {FREQUENCY[1]:g} Hz",
                    f"{lowest:.4g} Hz with units='{given}': units of mass or stiffness off by powers of 10 suspected; "
                    f"{override}",
                )
    return texts
