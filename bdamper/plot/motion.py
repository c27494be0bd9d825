"""Motion of bodies in metres and radians, and states of contact points, computed from a solution.

A mass-normalised translation mode has the amplitude ``1/sqrt(m)`` everywhere; a rotation mode about
a principal axis has the angle ``1/sqrt(I)``.  The products with the modal coefficients are the
displacement of the centre of mass along X, Y, Z of the damper and its rotation about them (X
tangential, Y along the load, Z along the rotation axis).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.laws import LAW_BONDED, LAW_CONSTANT, LAW_COUPLED_CONSTANT, refuse
from bdamper.harmonic_balance.checks import asked
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.sector import segments
from bdamper.model.kinematics import RIGID_NAMES, body_axes, principal_axes
from bdamper.model.structure import Model, turn
from bdamper.util import validation
from bdamper.util.errors import SettingError, warn_implausible
from bdamper.util.formatting import short_repr

LARGEST_DRAWN = 1.0 / 15.0
"""Largest displacement in a line drawing, relative to the size of the bodies."""
VIEW = np.array([[0.766, 0.0, 0.643], [0.199, 0.951, -0.237], [-0.611, 0.309, 0.729]])
"""Directions right, up and toward the viewer of a line drawing, in X, Y, Z."""
STATES = ("stick", "slip", "open")
STICK, SLIP, OPEN = range(len(STATES))
"""States of a contact point in plots and maps."""
PLAIN = (STICK, SLIP, SLIP, OPEN)
"""The same states by the codes of the core, which distinguishes two directions of slip."""
Parts = tuple[tuple[float, float, int], ...]


@short_repr
@dataclass(frozen=True)
class RigidMotion:
    """Motion of a free body at one or several solutions.

    Parameters
    ----------
    body : str
    bias : (..., 6) float
        Mean translation of the centre of mass (m) and mean rotation (rad) along and about X, Y, Z
        of the damper.
    vibratory : (..., n_harmonics, 6) complex
        Amplitudes of each harmonic, ``Re sum_l A_l exp(i l omega t)``.
    modal_bias : (..., 6) float, kg^1/2 m
        Coefficients of the mass-normalised modes, as in the paper's Figs 12 and 13.
    modal_vibratory : (..., n_harmonics, 6) complex, kg^1/2 m
    """

    body: str
    bias: NDArray
    vibratory: NDArray
    modal_bias: NDArray
    modal_vibratory: NDArray

    @property
    def amplitude(self) -> NDArray:
        """Amplitude (..., 6) of the fundamental harmonic, m and rad."""
        return np.abs(self.vibratory[..., 0, :])


@short_repr
@dataclass(frozen=True)
class ContactStatus:
    """States of all contact points over one period.

    Parameters
    ----------
    points : (n_points, 3) float, m
    interface : tuple of str
        Interface of each point.
    parts : tuple of two tuples for each point
        Exact (start, end, state) of the parts of the period, for both tangential directions.  Start
        and end are angles of the excitation in rad; the state is 0 (stick), 1 (slip) or 2 (open).
    """

    points: NDArray
    interface: tuple[str, ...]
    parts: tuple[tuple[Parts, ...], ...]

    def rows(self, interface: str) -> NDArray:
        """Return the indices of the points of an interface."""
        return np.flatnonzero(np.array(self.interface) == interface)

    @property
    def share(self) -> NDArray:
        """Fractions (n_points, 2, 3) of the period by tangential direction and state."""
        out = np.zeros((len(self.points), 2, 3))
        for i, directions in enumerate(self.parts):
            for d, parts in enumerate(directions):
                for start, end, state in parts:
                    out[i, d, state] += (end - start) / (2.0 * np.pi)
        return out


def _solutions(problem: Problem, unknowns: NDArray) -> NDArray:
    """Check that unknowns (..., n_unknowns) are finite and fit the study."""
    n = len(problem.bases[0].omega2) + 2 * sum(len(basis.omega2) for basis in problem.bases[1:])
    try:
        out = np.asarray(unknowns, float)
    except (TypeError, ValueError):
        out = np.empty(0)
    if out.ndim == 0 or out.shape[-1] != n or not np.isfinite(out).all():
        raise validation.invalid(
            "unknowns", f"solutions of this study, {n} finite numbers each", unknowns
        )
    return out


def modal_amplitudes(problem: Problem, unknowns: NDArray) -> list[NDArray]:
    """Return modal coordinates (..., n_modes) of each harmonic: the real mean, complex amplitudes."""
    sizes = [len(basis.omega2) for basis in problem.bases]
    parts = np.split(unknowns, np.cumsum([sizes[0], *np.repeat(sizes[1:], 2)])[:-1], axis=-1)
    return [parts[0], *(cosine - 1j * sine for cosine, sine in zip(parts[1::2], parts[2::2]))]


@asked
def rigid_motion(problem: Problem, unknowns: NDArray, body: str | None = None) -> RigidMotion:
    """Compute the rigid-body motion of a free body.

    Parameters
    ----------
    problem : Problem
    unknowns : (..., n_unknowns) float
        Solutions of this study, for example rows of ``curve.unknowns``.
    body : str, optional
        By default the only free body.

    Raises
    ------
    SettingError
        If there is no such free body.
    """
    bodies = [name for name, part in problem.model.bodies.items() if part.kind == "free"]
    if body is None and len(bodies) == 1:
        body = bodies[0]
    if body is None or body not in bodies:
        raise SettingError(
            f"rigid motion: body must be one of the free bodies {bodies}, found {body!r}"
        )
    part = problem.model.bodies[body]
    assert part.mass is not None
    moments, _ = principal_axes(part)
    unit = 1.0 / np.sqrt(np.concatenate([np.full(3, part.mass), moments]))
    unknowns = _solutions(problem, unknowns)
    motion = np.zeros((*unknowns.shape[:-1], len(problem.bases), 6), complex)
    for l, (basis, q) in enumerate(zip(problem.bases, modal_amplitudes(problem, unknowns))):
        for k, coordinate in enumerate(basis.coordinates):
            if coordinate.body == body and coordinate.name in RIGID_NAMES:
                motion[..., l, RIGID_NAMES.index(coordinate.name)] = q[..., k]
    bias, vibratory = motion[..., 0, :].real, motion[..., 1:, :]
    return RigidMotion(body, bias * unit, vibratory * unit, bias, vibratory)


@asked
def contact_status(problem: Problem, unknowns: NDArray, preload: float) -> ContactStatus:
    """Compute the states of the contact points over the cycle: stick, slip or separation.

    Parameters
    ----------
    problem : Problem
    unknowns : (n_unknowns,) float
        One solution of this study, for example ``curve.peak.y[:-1]``.
    preload : float, N
        Preload of the solution.
    """
    system = problem.system(preload)
    refuse(system.structure.points.own, "the states of a cycle")
    X, _, _ = system.contact(_solutions(problem, unknowns))
    p = system.structure.arrays
    model = problem.coupling.model  # with merged contact points, if the study merges them
    names = tuple(
        name for name in problem.coupling.interfaces for _ in range(model.interfaces[name].n_points)
    )
    points = np.concatenate([model.interfaces[name].points for name in problem.coupling.interfaces])
    always_open = ((0.0, 2.0 * np.pi, OPEN),)
    parts: list[tuple[Parts, ...]] = [(always_open, always_open)] * len(
        points
    )  # for points not in the equations
    index = (
        np.arange(len(X))
        if system.structure.points.index is None
        else system.structure.points.index
    )
    for point, i in zip(
        *np.unique(index, return_index=True)
    ):  # the first of two elements at a point
        directions = segments(
            X[i], p["kt"][i], float(p["kn"][i]), float(p["mu"][i]), float(p["n0"][i]), p["w"][i], int(p["law"][i]),
            problem.settings.contact_forces, float(p["load"][i]),
        )  # fmt: skip
        two_sided = p["law"][i] in (LAW_CONSTANT, LAW_COUPLED_CONSTANT, LAW_BONDED)
        pieces = (
            listed or _without_friction(X[i], p["kn"][i], p["n0"][i], two_sided)
            for listed in directions
        )
        parts[point] = tuple(_joined(listed) for listed in pieces)
    return ContactStatus(points, names, tuple(parts))


def _joined(pieces: list[tuple[float, float, int]]) -> Parts:
    """Return the parts of the period with the states of plots.

    Adjacent parts with slip in either direction are merged.
    """
    runs = [list(run) for _, run in groupby(pieces, lambda part: PLAIN[part[2]])]
    return tuple((run[0][0], run[-1][1], PLAIN[run[0][2]]) for run in runs)


def _without_friction(
    x: NDArray, kn: float, n0: float, two_sided: bool
) -> list[tuple[float, float, int]]:
    """Return the parts of the period of a frictionless point, which slips if it is in contact."""
    sliding = 1
    if two_sided:
        return [(0.0, 2.0 * np.pi, sliding)]
    friction = 1e-12  # nearly zero, so that the parts in contact are listed
    parts = segments(x, np.full(2, kn), float(kn), friction, float(n0), np.zeros(2))[0]
    return [(start, end, state if state == 3 else sliding) for start, end, state in parts]


@short_repr
@dataclass(frozen=True)
class SurfaceMotion:
    """Motion of the surface of a body.

    Parameters
    ----------
    points : (n_nodes, 3) float, m
        Positions at rest.
    mean : (n_nodes, 3) float, m
    amplitude : (n_nodes, 3) complex, m
        Fundamental harmonic, ``Re A exp(i omega t)``, along X, Y, Z.
    """

    points: NDArray
    mean: NDArray
    amplitude: NDArray


def _rigid_displacement(
    problem: Problem, unknowns: NDArray, body: str, points: NDArray
) -> tuple[NDArray, NDArray]:
    """Return mean and complex fundamental amplitude (n, 3), m, of points of a rigid free body."""
    motion = rigid_motion(problem, unknowns, body)
    part = problem.model.bodies[body]
    assert part.centre is not None
    _, principal = principal_axes(part)
    rotation = np.cross(
        principal[None], (points - part.centre)[:, None, :]
    )  # (n_points, 3 axes, 3)
    axes = body_axes(part)
    mean = motion.bias[:3] @ axes + np.einsum("k,pkx->px", motion.bias[3:], rotation)
    first = motion.vibratory[0]
    return mean, first[:3] @ axes + np.einsum("k,pkx->px", first[3:], rotation)


@asked
def surface_motion(problem: Problem, unknowns: NDArray) -> dict[str, SurfaceMotion]:
    """Compute the motion of all bodies with a surface mesh.

    Free bodies move with their rigid-body modes.  Constrained bodies move with the retained modes
    that have shapes on the mesh (``model.meshes[...].modes``, at the nodal diameter of the
    fundamental).  Their mean motion is NaN without shapes of nodal diameter 0.

    Raises
    ------
    SettingError
        If the mesh of a constrained body has no shapes at the nodal diameter of the fundamental.

    Warns
    -----
    PlausibilityWarning
        If modes without shapes contribute more than 1 % of the motion, in the norm of the mass
        matrix.
    """
    unknowns = _solutions(problem, unknowns)
    q0, q1, *_ = modal_amplitudes(problem, unknowns)
    out = {}
    largest_missing = (
        0.01  # share of the motion in modes without shapes, above which a warning is shown
    )
    for name, mesh in problem.model.meshes.items():
        body = problem.model.bodies[name]
        mean, amplitude = np.zeros(mesh.points.shape), np.zeros(mesh.points.shape, complex)
        if body.kind == "free":
            mean, amplitude = _rigid_displacement(problem, unknowns, name, mesh.points)
        elif body.kind == "constrained":
            for target, q, harmonic in ((mean, q0, 0), (amplitude, q1, 1)):
                d, conjugate = problem.model.folded_nodal_diameter(
                    int(problem.engine_order) * harmonic
                )
                shapes = mesh.modes.get(d)
                if shapes is None and harmonic == 0:
                    mean[:] = np.nan
                    continue
                if shapes is None:
                    raise SettingError(
                        f"motion of surfaces: the mesh of '{name}' needs mode shapes of nodal diameter {d}; it has "
                        f"{sorted(mesh.modes) or 'none'}"
                    )
                shapes = shapes.conj() if conjugate else shapes
                coordinates = problem.bases[harmonic].coordinates
                of_body = np.array([k for k, c in enumerate(coordinates) if c.body == name], int)
                index = np.array([coordinates[k].index for k in of_body], int)
                known = index < shapes.shape[2]
                displacement = shapes[..., index[known]] @ q[of_body[known]]
                target += displacement.real if harmonic == 0 else displacement
                missing = np.linalg.norm(q[of_body[~known]]) / max(
                    float(np.linalg.norm(q[of_body])), 1e-300
                )
                if harmonic == 1 and missing > largest_missing:
                    most = f"at most {100 * largest_missing:g} % of the motion in modes without shapes on the mesh"
                    warn_implausible(
                        f"motion of the surface of '{name}'", most, f"{100 * missing:.2g} %"
                    )
        out[name] = SurfaceMotion(mesh.points, mean, amplitude)
    return out


def sectors_shown(model: Model) -> list[tuple[str, int, NDArray]]:
    """Return bodies with a mesh, the sectors that show them, and rotations (3, 3) into these."""
    bodies = {(face.body_a, face.sector_a) for face in model.interfaces.values()}
    bodies |= {(face.body_b, face.sector_b) for face in model.interfaces.values()}
    # without contacts every body is in its own sector
    bodies = bodies or {(name, 0) for name in model.meshes}
    shown = sorted((name, sector) for name, sector in bodies if name in model.meshes)
    return [(name, sector, turn(2.0 * np.pi * sector / model.n_blades)) for name, sector in shown]


@short_repr
@dataclass(frozen=True)
class LineDrawing:
    """Drawing of vibrating surfaces in a view from one side.

    The faces are sorted from the farthest to the nearest, so that each face hides the lines behind
    it.

    Parameters
    ----------
    points : (n_nodes, 2) float, m
        Positions at rest in the drawing plane, to the right and upward.
    amplitude : (n_nodes, 2) complex, m
        Vibration ``Re A exp(i omega t)`` in the drawing plane, not magnified.
    quads : (n_faces, 4) int
        Nodes of each face.
    body : tuple of str
        Body of each face.
    magnification : float
        Factor that makes the largest displacement a fixed fraction of the size of the bodies.
    """

    points: NDArray
    amplitude: NDArray
    quads: NDArray
    body: tuple[str, ...]
    magnification: float


@asked
def line_drawing(problem: Problem, unknowns: NDArray) -> LineDrawing:
    """Compute the vibration of all meshes, in all sectors that a contact joins, for an animation.

    Parameters
    ----------
    problem : Problem
    unknowns : (n_unknowns,) float
        One solution of this study.

    Raises
    ------
    SettingError
        If the model has no mesh, or a mesh has no shapes at the nodal diameter of the fundamental.
    """
    model, motions = problem.model, surface_motion(problem, unknowns)
    validation.check(motions, "drawing of a motion", "a model with the mesh of a body", "none")
    positions, amplitudes, faces, names, n = [], [], [], [], 0
    for name, sector, rotation in sectors_shown(model):
        motion, quads, view = motions[name], model.meshes[name].quads, VIEW @ rotation
        phase = 2.0 * np.pi * problem.settings.engine_order * sector / model.n_blades
        positions.append(motion.points @ view.T)
        amplitudes.append(motion.amplitude @ view.T * np.exp(1j * phase))
        faces.append(quads + n)
        names += [name] * len(quads)
        n += len(motion.points)
    position, amplitude, quads = (
        np.concatenate(positions),
        np.concatenate(amplitudes),
        np.concatenate(faces),
    )
    order = np.argsort(position[quads, 2].mean(axis=1))
    largest, size = (
        float(np.linalg.norm(np.abs(amplitude), axis=1).max()),
        float(np.ptp(position[:, :2], axis=0).max()),
    )
    body = tuple(names[k] for k in order)
    magnification = LARGEST_DRAWN * size / max(largest, 1e-300)
    return LineDrawing(position[:, :2], amplitude[:, :2], quads[order], body, magnification)
