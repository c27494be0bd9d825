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

RIGID_TOLERANCE = 3e-3
"""Strain of a rigid motion: the root of its energy over that of a stretch with the same displacements."""


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
    """A stiffness matrix of a free body resists no rigid motion of its nodes.

    Energies are compared with those of three stretches about the same centre, so the measure is a strain: positions that
    are one percent too long show as 0.01, positions rounded to six digits as some 1e-4.
    """
    centre = 0.5 * (structure.nodes.min(axis=0) + structure.nodes.max(axis=0))
    arm = structure.nodes - centre
    motion = rigid_motions(structure.nodes, centre, np.eye(3))
    motion[:, :3] *= body.size
    stretch = np.stack([(arm * np.eye(3)[k]).ravel() for k in range(3)], axis=1)
    energy, scale = (np.einsum("ij,ij->j", u, structure.stiffness @ u) for u in (motion, stretch))
    if not scale.max() > 0.0:
        raise mismatch(f"{body.where}: stiffness matrix", "a body that resists being stretched", "no force at all")
    strain = np.sqrt(np.abs(energy) / scale.max())
    worst = int(np.argmax(strain))
    if not strain[worst] <= RIGID_TOLERANCE:
        if not strain[:3].max() <= RIGID_TOLERANCE:
            worst = int(np.argmax(strain[:3]))
            hint = "fixed nodes, springs to the ground, or a table of nodes and components that does not belong to it"
        else:
            hint = "positions that do not belong to it (order, units, axes), or nodes with axes of their own"
        kind = "translation along" if worst < 3 else "rotation about"
        raise mismatch(
            f"{body.where}: stiffness matrix",
            "a free body, which no rigid motion strains",
            f"a strain of {strain[worst]:.2g} of its size under a {kind} {'XYZ'[worst % 3]}: {hint}",
        )
    body.checks.append(f"{body.name}: rigid motions strain it by {strain.max():.1g} of a stretch of equal size")


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
