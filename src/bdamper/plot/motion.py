"""What a solution means at the damper: its motion as a rigid body, in metres and radians, and the state of its contacts.

A mass-normalised translation has the amplitude ``1/sqrt(m)`` everywhere, a rotation about a principal axis the angle
``1/sqrt(I)``: dividing the modal coefficients by these roots gives the displacement of the centre of mass along X, Y, Z
of the damper and its rotation about them (X tangential, Y along the load, Z along the axis of rotation).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.laws import LAW_BONDED, LAW_CONSTANT, LAW_COUPLED_CONSTANT, refuse
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.result_checks import asked
from bdamper.harmonic_balance.sector import segments
from bdamper.model.kinematics import RIGID_NAMES, body_axes, principal_axes
from bdamper.model.structure import Model, turn
from bdamper.util import validation
from bdamper.util.errors import SettingError, warn_implausible
from bdamper.util.formatting import short_repr

LARGEST_DRAWN = 1.0 / 15.0
"""Largest displacement in a line drawing, over the size of the bodies."""
VIEW = np.array([[0.766, 0.0, 0.643], [0.199, 0.951, -0.237], [-0.611, 0.309, 0.729]])
"""Directions of a line drawing in X, Y, Z: to the right, upward and toward the eye, as in the pictures of models."""
STATES = ("stick", "slip", "open")
STICK, SLIP, OPEN = range(len(STATES))
"""States of a contact point in pictures and maps."""
PLAIN = (STICK, SLIP, SLIP, OPEN)
"""The same of the core, which tells the ways of slip apart."""
Parts = tuple[tuple[float, float, int], ...]


@short_repr
@dataclass(frozen=True)
class RigidMotion:
    """Motion of a free body at one or several solutions.

    Parameters
    ----------
    body : str
    bias : (..., 6) float
        Mean translation of the centre of mass (m) and mean rotation (rad) along and about X, Y, Z of the damper.
    vibratory : (..., n_harmonics, 6) complex
        Amplitudes of each harmonic, ``Re sum_l A_l exp(i l omega t)``.
    modal_bias : (..., 6) float, kg^1/2 m
        The coefficients of the mass-normalised modes, as in the paper's Figs 12 and 13.
    modal_vibratory : (..., n_harmonics, 6) complex, kg^1/2 m
    """

    body: str
    bias: NDArray
    vibratory: NDArray
    modal_bias: NDArray
    modal_vibratory: NDArray

    @property
    def amplitude(self) -> NDArray:
        """(..., 6) float, m and rad: amplitude of the fundamental harmonic."""
        return np.abs(self.vibratory[..., 0, :])


@short_repr
@dataclass(frozen=True)
class ContactStatus:
    """State of every contact point over one period.

    Parameters
    ----------
    points : (n_points, 3) float, m
    interface : tuple of str
        Interface of each point.
    parts : tuple of two tuples for each point
        Exact (start, end, state) of the parts of the period, in the two tangential directions: angles of the excitation in
        rad, 0 stick, 1 slip, 2 open.
    """

    points: NDArray
    interface: tuple[str, ...]
    parts: tuple[tuple[Parts, ...], ...]

    def rows(self, interface: str) -> NDArray:
        """Indices of the points of one interface."""
        return np.flatnonzero(np.array(self.interface) == interface)

    @property
    def share(self) -> NDArray:
        """(n_points, 2, 3) float: shares of the period that stick, slip and are open."""
        out = np.zeros((len(self.points), 2, 3))
        for i, directions in enumerate(self.parts):
            for d, parts in enumerate(directions):
                for start, end, state in parts:
                    out[i, d, state] += (end - start) / (2.0 * np.pi)
        return out


def _solutions(problem: Problem, unknowns: NDArray) -> NDArray:
    """Unknowns (..., n_unknowns) that can be solutions of a study."""
    n = len(problem.bases[0].omega2) + 2 * sum(len(basis.omega2) for basis in problem.bases[1:])
    try:
        out = np.asarray(unknowns, float)
    except (TypeError, ValueError):
        out = np.empty(0)
    if out.ndim == 0 or out.shape[-1] != n or not np.isfinite(out).all():
        raise validation.invalid("unknowns", f"solutions of this study, {n} finite numbers each", unknowns)
    return out


def modal_amplitudes(problem: Problem, unknowns: NDArray) -> list[NDArray]:
    """Modal coordinates (..., n_modes) of each harmonic: those of the mean, then complex amplitudes."""
    sizes = [len(basis.omega2) for basis in problem.bases]
    parts = np.split(unknowns, np.cumsum([sizes[0], *np.repeat(sizes[1:], 2)])[:-1], axis=-1)
    return [parts[0], *(cosine - 1j * sine for cosine, sine in zip(parts[1::2], parts[2::2]))]


@asked
def rigid_motion(problem: Problem, unknowns: NDArray, body: str | None = None) -> RigidMotion:
    """Rigid-body motion of a free body.

    Parameters
    ----------
    problem : Problem
    unknowns : (..., n_unknowns) float
        Solutions of this study, for example rows of ``curve.unknowns``.
    body : str, optional
        The only free body by default.

    Raises
    ------
    SettingError
        If there is no such free body.
    """
    bodies = [name for name, part in problem.model.bodies.items() if part.kind == "free"]
    if body is None and len(bodies) == 1:
        body = bodies[0]
    if body is None or body not in bodies:
        raise SettingError(f"rigid motion: expected one of the free bodies {bodies}, found {body!r}")
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
    """Contact states of the points over the cycle: stick, slip or open.

    Parameters
    ----------
    problem : Problem
    unknowns : (n_unknowns,) float
        One solution of this study, for example ``curve.unknowns[curve.peak.index]``.
    preload : float, N
        Of that solution.
    """
    system = problem.system(preload)
    refuse(system.structure.points.own, "the states of a cycle")
    X, _, _ = system.contact(_solutions(problem, unknowns))
    p = system.structure.arrays
    model = problem.coupling.model  # with united contact points, if the study asks for that
    names = tuple(name for name in problem.coupling.interfaces for _ in range(model.interfaces[name].n_points))
    points = np.concatenate([model.interfaces[name].points for name in problem.coupling.interfaces])
    whole = ((0.0, 2.0 * np.pi, OPEN),)
    parts: list[tuple[Parts, ...]] = [(whole, whole)] * len(points)  # points that the equations leave out are open
    index = np.arange(len(X)) if system.structure.points.index is None else system.structure.points.index
    for at, i in zip(*np.unique(index, return_index=True)):  # of two elements of a point the first
        found = segments(
            X[i], p["kt"][i], float(p["kn"][i]), float(p["mu"][i]), float(p["n0"][i]), p["w"][i], int(p["law"][i]),
            problem.settings.contact_forces, float(p["load"][i]),
        )  # fmt: skip
        two_sided = p["law"][i] in (LAW_CONSTANT, LAW_COUPLED_CONSTANT, LAW_BONDED)
        pieces = (listed or _without_friction(X[i], p["kn"][i], p["n0"][i], two_sided) for listed in found)
        parts[at] = tuple(_joined(listed) for listed in pieces)
    return ContactStatus(points, names, tuple(parts))


def _joined(pieces: list[tuple[float, float, int]]) -> Parts:
    """Parts of the period in the states of pictures, those of slip in both ways as one."""
    runs = [list(alike) for _, alike in groupby(pieces, lambda part: PLAIN[part[2]])]
    return tuple((alike[0][0], alike[-1][1], PLAIN[alike[0][2]]) for alike in runs)


def _without_friction(x: NDArray, kn: float, n0: float, two_sided: bool) -> list[tuple[float, float, int]]:
    """Parts of the period of a point without friction: what is not open slides."""
    sliding = 1
    if two_sided:
        return [(0.0, 2.0 * np.pi, sliding)]
    friction = 1e-12  # next to none, so that the parts in contact are listed
    parts = segments(x, np.full(2, kn), float(kn), friction, float(n0), np.zeros(2))[0]
    return [(start, end, state if state == 3 else sliding) for start, end, state in parts]


@short_repr
@dataclass(frozen=True)
class SurfaceMotion:
    """Motion of the surface of a body.

    Parameters
    ----------
    points : (n_nodes, 3) float, m
        At rest.
    mean : (n_nodes, 3) float, m
    amplitude : (n_nodes, 3) complex, m
        Of the fundamental harmonic, ``Re A exp(i omega t)``, along X, Y, Z.
    """

    points: NDArray
    mean: NDArray
    amplitude: NDArray


def _rigid_displacement(problem: Problem, unknowns: NDArray, body: str, points: NDArray) -> tuple[NDArray, NDArray]:
    """Mean (n, 3) and complex fundamental amplitude (n, 3) in m of points of a free body that moves as a rigid one."""
    motion = rigid_motion(problem, unknowns, body)
    part = problem.model.bodies[body]
    assert part.centre is not None
    _, turn = principal_axes(part)
    rotation = np.cross(turn[None], (points - part.centre)[:, None, :])  # (n_points, 3 axes, 3)
    axes = body_axes(part)
    mean = motion.bias[:3] @ axes + np.einsum("k,pkx->px", motion.bias[3:], rotation)
    first = motion.vibratory[0]
    return mean, first[:3] @ axes + np.einsum("k,pkx->px", first[3:], rotation)


@asked
def surface_motion(problem: Problem, unknowns: NDArray) -> dict[str, SurfaceMotion]:
    """Motion of all bodies that carry a surface, for pictures.

    Free bodies move with their rigid-body modes, constrained ones with those of their retained modes whose shapes the
    model carries (``model.meshes[...].modes``, at the nodal diameter of the fundamental); the mean motion of constrained
    bodies is NaN unless they carry shapes of nodal diameter 0.

    Raises
    ------
    SettingError
        If a constrained body has a surface without shapes at the nodal diameter of the fundamental.

    Warns
    -----
    PlausibilityWarning
        If the modes without shapes hold more than a hundredth of the motion, in the norm of the mass matrix.
    """
    unknowns = _solutions(problem, unknowns)
    q0, q1, *_ = modal_amplitudes(problem, unknowns)
    out = {}
    # share of the modal motion in modes without shapes on the mesh, above which a picture of it warns
    largest_missing = 0.01
    for name, mesh in problem.model.meshes.items():
        body = problem.model.bodies[name]
        mean, amplitude = np.zeros(mesh.points.shape), np.zeros(mesh.points.shape, complex)
        if body.kind == "free":
            mean, amplitude = _rigid_displacement(problem, unknowns, name, mesh.points)
        elif body.kind == "constrained":
            for target, q, harmonic in ((mean, q0, 0), (amplitude, q1, 1)):
                d, conjugate = problem.model.folded_nodal_diameter(int(problem.engine_order) * harmonic)
                shapes = mesh.modes.get(d)
                if shapes is None and harmonic == 0:
                    mean[:] = np.nan
                    continue
                if shapes is None:
                    raise SettingError(
                        f"motion of surfaces: expected mode shapes of nodal diameter {d} on the mesh of '{name}', found "
                        + (f"those of {sorted(mesh.modes)}" if mesh.modes else "none")
                    )
                shapes = shapes.conj() if conjugate else shapes
                coordinates = problem.bases[harmonic].coordinates
                own = np.array([k for k, c in enumerate(coordinates) if c.body == name], int)
                index = np.array([coordinates[k].index for k in own], int)
                known = index < shapes.shape[2]
                move = shapes[..., index[known]] @ q[own[known]]
                target += move.real if harmonic == 0 else move
                missing = np.linalg.norm(q[own[~known]]) / max(float(np.linalg.norm(q[own])), 1e-300)
                if harmonic == 1 and missing > largest_missing:
                    most = f"at most {100 * largest_missing:g} % of the motion in modes without shapes on the mesh"
                    warn_implausible(f"motion of the surface of '{name}'", most, f"{100 * missing:.2g} %")
        out[name] = SurfaceMotion(mesh.points, mean, amplitude)
    return out


def sectors_shown(model: Model) -> list[tuple[str, int, NDArray]]:
    """Bodies with a surface, the sectors in which the interfaces show them, and the rotations (3, 3) into these."""
    places = {(face.body_a, face.sector_a) for face in model.interfaces.values()}
    places |= {(face.body_b, face.sector_b) for face in model.interfaces.values()}
    shown = sorted(place for place in places if place[0] in model.meshes)
    return [(name, sector, turn(2.0 * np.pi * sector / model.n_blades)) for name, sector in shown]


@short_repr
@dataclass(frozen=True)
class LineDrawing:
    """Moving surfaces as seen from one side, so that faces painted in their order hide the lines behind them.

    Parameters
    ----------
    points : (n_nodes, 2) float, m
        Places at rest in the plane of the picture, to the right and upward.
    amplitude : (n_nodes, 2) complex, m
        Of the vibration there, not magnified: ``Re A exp(i omega t)``.
    quads : (n_faces, 4) int
        Nodes of each face, the farthest face first.
    body : tuple of str
        Body of each face.
    magnification : float
        With which the largest displacement is a fixed part of the size of the bodies.
    """

    points: NDArray
    amplitude: NDArray
    quads: NDArray
    body: tuple[str, ...]
    magnification: float


@asked
def line_drawing(problem: Problem, unknowns: NDArray) -> LineDrawing:
    """The vibration of all bodies that carry a surface, in the sectors that a contact joins, for an animation.

    Parameters
    ----------
    problem : Problem
    unknowns : (n_unknowns,) float
        One solution of this study.

    Raises
    ------
    SettingError
        If the model has no surface, or one without shapes at the nodal diameter of the fundamental.
    """
    model, motions = problem.model, surface_motion(problem, unknowns)
    validation.check(motions, "drawing of a motion", "a model with the surface of a body", "none")
    places, moved, faces, names, n = [], [], [], [], 0
    for name, sector, turned in sectors_shown(model):
        motion, quads, seen = motions[name], model.meshes[name].quads, VIEW @ turned
        phase = 2.0 * np.pi * problem.settings.engine_order * sector / model.n_blades
        places.append(motion.points @ seen.T)
        moved.append(motion.amplitude @ seen.T * np.exp(1j * phase))
        faces.append(quads + n)
        names += [name] * len(quads)
        n += len(motion.points)
    at, amplitude, quads = np.concatenate(places), np.concatenate(moved), np.concatenate(faces)
    order = np.argsort(at[quads, 2].mean(axis=1))
    largest, size = float(np.linalg.norm(np.abs(amplitude), axis=1).max()), float(np.ptp(at[:, :2], axis=0).max())
    body = tuple(names[k] for k in order)
    magnified = LARGEST_DRAWN * size / max(largest, 1e-300)
    return LineDrawing(at[:, :2], amplitude[:, :2], quads[order], body, magnified)
