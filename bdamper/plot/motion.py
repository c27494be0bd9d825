"""Motion of bodies in metres and radians, and states of contact points, computed from a solution.

A mass-normalised translation mode has the amplitude ``1/sqrt(m)`` everywhere; a rotation mode about
a principal axis has the angle ``1/sqrt(I)``.  The products with the modal coefficients are the
displacement of the centre of mass along X, Y, Z of the damper and its rotation about them (X
tangential, Y along the load, Z along the rotation axis).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.laws import LAW_BONDED, LAW_CONSTANT, LAW_COUPLED_CONSTANT, refuse
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.sector import segments
from bdamper.harmonic_balance.study_boundary import accepts_study
from bdamper.model.kinematics import RIGID_NAMES, body_axes, principal_axes
from bdamper.model.structure import Model, SurfaceMesh, turn
from bdamper.util import validation
from bdamper.util.errors import SettingError, warn_implausible
from bdamper.util.formatting import short_repr

LARGEST_DRAWN = 1.0 / 15.0
"""Largest displacement in a line drawing, relative to the size of the bodies."""
LARGEST_MISSING = 0.01
"""Share of the motion in modes without shapes on the mesh, above which a warning is shown."""
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
        shares = np.zeros((len(self.points), 2, 3))
        for point, directions in enumerate(self.parts):
            for direction, parts in enumerate(directions):
                for start, end, state in parts:
                    shares[point, direction, state] += (end - start) / (2.0 * np.pi)
        return shares


def _solutions(problem: Problem, unknowns: NDArray) -> NDArray:
    """Check that unknowns (..., n_unknowns) are finite and fit the study."""
    mean, *harmonics = problem.bases
    # each harmonic has a cosine and a sine
    n = len(mean.omega2) + 2 * sum(len(basis.omega2) for basis in harmonics)
    try:
        converted = np.asarray(unknowns, float)
    except (TypeError, ValueError):
        converted = np.empty(0)
    if converted.ndim == 0 or converted.shape[-1] != n or not np.isfinite(converted).all():
        expected = f"solutions of this study, {n} finite numbers each"
        raise validation.invalid("unknowns", expected, unknowns)
    return converted


def modal_amplitudes(problem: Problem, unknowns: NDArray) -> list[NDArray]:
    """Return the modal coordinates (..., n_modes) of each harmonic.

    The coordinates of the mean are real; those of the other harmonics are complex amplitudes.
    """
    mean, *harmonics = problem.bases
    n_mean = len(mean.omega2)
    amplitudes = [unknowns[..., :n_mean]]
    start = n_mean
    for basis in harmonics:
        n_modes = len(basis.omega2)
        cosine = unknowns[..., start : start + n_modes]
        sine = unknowns[..., start + n_modes : start + 2 * n_modes]
        amplitudes.append(cosine - 1j * sine)
        start += 2 * n_modes
    return amplitudes


@accepts_study
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
    # displacement and rotation of the mass-normalised modes
    unit = 1.0 / np.sqrt(np.concatenate([np.full(3, part.mass), moments]))
    unknowns = _solutions(problem, unknowns)
    # coordinates (..., harmonic, mode) of the rigid modes; missing modes do not move
    modal = np.zeros((*unknowns.shape[:-1], len(problem.bases), len(RIGID_NAMES)), complex)
    for harmonic, amplitude in enumerate(modal_amplitudes(problem, unknowns)):
        for k, coordinate in enumerate(problem.bases[harmonic].coordinates):
            if coordinate.body == body and coordinate.name in RIGID_NAMES:
                mode = RIGID_NAMES.index(coordinate.name)
                modal[..., harmonic, mode] = amplitude[..., k]
    modal_bias = modal[..., 0, :].real
    modal_vibratory = modal[..., 1:, :]
    return RigidMotion(
        body=body,
        bias=modal_bias * unit,
        vibratory=modal_vibratory * unit,
        modal_bias=modal_bias,
        modal_vibratory=modal_vibratory,
    )


@accepts_study
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
    elements = system.structure.points
    refuse(elements.own, "the states of a cycle")
    motion, _, _ = system.contact(_solutions(problem, unknowns))
    coupling = problem.coupling
    # the model with merged contact points, if the study merges them
    faces = [coupling.model.interfaces[name] for name in coupling.interfaces]
    face_of_point: list[str] = []
    for name, face in zip(coupling.interfaces, faces):
        face_of_point += [name] * face.n_points
    points = np.concatenate([face.points for face in faces])
    # points that are not in the equations never touch
    always_open = ((0.0, 2.0 * np.pi, OPEN),)
    parts: list[tuple[Parts, ...]] = [(always_open, always_open)] * len(points)
    point_of_element = np.arange(len(motion)) if elements.index is None else elements.index
    # a point may have two elements, of which the first one is drawn
    points_with_element, first_element = np.unique(point_of_element, return_index=True)
    for point, element in zip(points_with_element, first_element):
        parts[point] = _parts_of_element(problem, system.structure.arrays, motion, element)
    return ContactStatus(points, tuple(face_of_point), tuple(parts))


def _parts_of_element(
    problem: Problem, elements: Mapping[str, NDArray], motion: NDArray, i: int
) -> tuple[Parts, ...]:
    """Return the parts of the period for both tangential directions of a contact element.

    Parameters
    ----------
    problem : Problem
    elements : mapping of name to array
        Constants of all elements.
    motion : (n_elements, ...) float
        Harmonics of the relative motion of all elements.
    i : int
        Index of the element.
    """
    normal_stiffness = float(elements["kn"][i])
    normal_load = float(elements["n0"][i])
    law = int(elements["law"][i])
    of_directions = segments(
        motion[i],
        kt=elements["kt"][i],
        kn=normal_stiffness,
        mu=float(elements["mu"][i]),
        n0=normal_load,
        slider=elements["w"][i],
        law=law,
        contact_forces=problem.settings.contact_forces,
        load=float(elements["load"][i]),
    )
    is_two_sided = law in (LAW_CONSTANT, LAW_COUPLED_CONSTANT, LAW_BONDED)
    parts = []
    for pieces in of_directions:
        # a point without friction has no pieces
        if not pieces:
            pieces = _without_friction(motion[i], normal_stiffness, normal_load, is_two_sided)
        parts.append(_joined(pieces))
    return tuple(parts)


def _joined(pieces: list[tuple[float, float, int]]) -> Parts:
    """Return the parts of the period, each with start, end and the state for plots.

    The codes of the kernel tell the direction of slip, the states for plots do not.  Adjacent parts
    with the same state are merged.
    """
    joined: list[tuple[float, float, int]] = []
    for start, end, code in pieces:
        state = PLAIN[code]
        if joined:
            previous_start, _, previous_state = joined[-1]
            if previous_state == state:
                joined[-1] = (previous_start, end, state)
                continue
        joined.append((start, end, state))
    return tuple(joined)


def _without_friction(
    x: NDArray, kn: float, n0: float, two_sided: bool
) -> list[tuple[float, float, int]]:
    """Return the parts of the period of a frictionless point, which slips if it is in contact."""
    sliding = PLAIN.index(SLIP)
    separated = PLAIN.index(OPEN)
    if two_sided:
        return [(0.0, 2.0 * np.pi, sliding)]
    friction = 1e-12  # nearly zero, so that the parts in contact are listed
    parts = segments(x, np.full(2, kn), kn, friction, n0, np.zeros(2))[0]
    return [(start, end, code if code == separated else sliding) for start, end, code in parts]


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
    axes = body_axes(part)
    _, principal = principal_axes(part)
    # displacement (point, axis, component) by a unit rotation about each principal axis
    by_rotation = np.cross(principal[None], (points - part.centre)[:, None, :])

    def displacement(rigid: NDArray) -> NDArray:
        return rigid[:3] @ axes + np.einsum("k,pkx->px", rigid[3:], by_rotation)

    return displacement(motion.bias), displacement(motion.vibratory[0])


@accepts_study
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
    motions = {}
    for name, mesh in problem.model.meshes.items():
        kind = problem.model.bodies[name].kind
        if kind == "free":
            mean, amplitude = _rigid_displacement(problem, unknowns, name, mesh.points)
        elif kind in ("constrained", "ring"):
            mean, amplitude = _elastic_displacement(problem, unknowns, name, mesh)
        else:
            mean = np.zeros(mesh.points.shape)
            amplitude = np.zeros(mesh.points.shape, complex)
        motions[name] = SurfaceMotion(mesh.points, mean, amplitude)
    return motions


def _elastic_displacement(
    problem: Problem, unknowns: NDArray, name: str, mesh: SurfaceMesh
) -> tuple[NDArray, NDArray]:
    """Return mean and complex fundamental amplitude (n, 3), m, of a constrained body."""
    engine_order = int(problem.engine_order)
    mean = np.zeros(mesh.points.shape)
    amplitude = np.zeros(mesh.points.shape, complex)
    for harmonic, coordinates in enumerate(modal_amplitudes(problem, unknowns)[:2]):
        diameter, conjugate = problem.model.folded_nodal_diameter(engine_order * harmonic)
        shapes = mesh.modes.get(diameter)
        if shapes is None:
            if harmonic == 0:
                mean[:] = np.nan
                continue
            raise SettingError(
                f"motion of surfaces: the mesh of '{name}' needs mode shapes of nodal diameter "
                f"{diameter}; it has {sorted(mesh.modes) or 'none'}"
            )
        if conjugate:
            shapes = shapes.conj()
        modes = problem.bases[harmonic].coordinates
        of_body = np.array([k for k, mode in enumerate(modes) if mode.body == name], int)
        index = np.array([modes[k].index for k in of_body], int)
        has_shape = index < shapes.shape[2]
        displacement = shapes[..., index[has_shape]] @ coordinates[of_body[has_shape]]
        if harmonic == 0:
            mean += displacement.real
            continue
        amplitude += displacement
        size = max(float(np.linalg.norm(coordinates[of_body])), 1e-300)
        missing = float(np.linalg.norm(coordinates[of_body[~has_shape]])) / size
        _warn_of_missing(name, missing)
    return mean, amplitude


def _warn_of_missing(body: str, missing: float) -> None:
    """Warn if a share of the motion of a body is in modes without shapes on the mesh."""
    if missing > LARGEST_MISSING:
        limit = f"at most {100 * LARGEST_MISSING:g} % of the motion"
        plausible = f"{limit} in modes without shapes on the mesh"
        warn_implausible(f"motion of the surface of '{body}'", plausible, f"{100 * missing:.2g} %")


def sectors_shown(model: Model) -> list[tuple[str, int, NDArray]]:
    """Return bodies with a mesh, the sectors that show them, and rotations (3, 3) into these."""
    joined = set()
    for face in model.interfaces.values():
        joined.add((face.body_a, face.sector_a))
        joined.add((face.body_b, face.sector_b))
    # without contacts every body is in its own sector
    if not joined:
        joined = {(name, 0) for name in model.meshes}
    shown = []
    for name, sector in sorted(joined):
        if name in model.meshes:
            shown.append((name, sector, turn(2.0 * np.pi * sector / model.n_blades)))
    return shown


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


@accepts_study
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
    model = problem.model
    motions = surface_motion(problem, unknowns)
    validation.check(motions, "drawing of a motion", "a model with the mesh of a body", "none")
    positions = []
    amplitudes = []
    faces = []
    bodies: list[str] = []
    n_nodes = 0
    for name, sector, rotation in sectors_shown(model):
        motion = motions[name]
        quads = model.meshes[name].quads
        view = VIEW @ rotation
        phase = 2.0 * np.pi * problem.settings.engine_order * sector / model.n_blades
        positions.append(motion.points @ view.T)
        amplitudes.append(motion.amplitude @ view.T * np.exp(1j * phase))
        faces.append(quads + n_nodes)
        bodies += [name] * len(quads)
        n_nodes += len(motion.points)
    position = np.concatenate(positions)
    amplitude = np.concatenate(amplitudes)
    quads = np.concatenate(faces)
    # the third direction is toward the viewer
    farthest_first = np.argsort(position[quads, 2].mean(axis=1))
    largest = float(np.linalg.norm(np.abs(amplitude), axis=1).max())
    size = float(np.ptp(position[:, :2], axis=0).max())
    return LineDrawing(
        points=position[:, :2],
        amplitude=amplitude[:, :2],
        quads=quads[farthest_first],
        body=tuple(bodies[k] for k in farthest_first),
        magnification=LARGEST_DRAWN * size / max(largest, 1e-300),
    )
