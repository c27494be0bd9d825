"""Free dampers that roll because their faces have too few rows of contact points.

A wedge can turn about the point in which the normals of its two faces meet.  Friction resists with
the distance ``r`` of a face from this point as its lever, and the normal force by shifting along
the face, by half of its length ``a`` at most.  If friction is at its limit on both faces, the
damper is in equilibrium as long as

    sum mu N r <= sum N a

and then it slides.  A load that does not pass through this point adds its moment to the left-hand
side.  Otherwise the damper rolls on the edges of its faces, with much less dissipation.  The points
of a face lie at the centres of ``n`` strips, so that the normal force shifts by ``(n - 1) / n a``
only, and a damper may roll on its points although the whole faces would slide.  Its amplitude is
then wrong by several times (docs/evidence/measured-contact.md, rows of contact points).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.laws import LAW_COUPLED, LAW_SEPARABLE
from bdamper.harmonic_balance.problem import Problem
from bdamper.model.contact_points import rows_of_points
from bdamper.model.structure import Body, Interface
from bdamper.util.formatting import counted

ALONG_AXIS = 0.1
"""Largest share of a normal across the axis of rotation with which a face is an axial stop."""
MOST_ROWS = 20
"""Rows of points that represent a whole face; a damper that rolls on them rolls anyway."""
PARALLEL = 1e-3
"""Sine of the angle between two normals below which they do not meet."""


@dataclass(frozen=True)
class FaceInSection:
    """Contact face of a damper in the plane across the axis of rotation; lengths in m.

    Parameters
    ----------
    centre, normal : (2,) float
        Centre, and unit vector toward the damper.
    reach : float
        Distance of the outer rows of contact points from the centre.
    half_length : float
        Half of the length of the whole face along t1.
    rows : int
        Number of rows of contact points along t1.
    friction : float
        Mean friction coefficient.
    """

    centre: NDArray
    normal: NDArray
    reach: float
    half_length: float
    rows: int
    friction: float


def rolling_dampers(problem: Problem) -> tuple[str, ...]:
    """Describe each free damper that rolls because its faces have too few rows of contact points.

    With contact over its full faces it would slide.

    Only dampers with two friction faces and Coulomb friction are examined.
    """
    settings = problem.settings
    turns_about_the_normals = {"TX", "TY", "RZ"} <= set(settings.rigid_modes)
    if not turns_about_the_normals:
        return ()
    interfaces = problem.coupling.model.interfaces
    faces = [interfaces[name] for name in settings.interface_names()]
    doubts = []
    bodies = problem.model.bodies
    for name in settings.free_bodies:
        if bodies[name].kind == "ring":
            continue  # its two sector faces keep it from rolling
        touching = [face for face in faces if name in (face.body_a, face.body_b)]
        across = [face for face in touching if not _axial_stop(face)]
        if len(across) != 2 or not all(_slides(problem, face, name) for face in across):
            continue
        body = problem.coupling.model.bodies[name]
        sections = [_in_section(problem, face) for face in across]
        load, loaded_at = _load(body, sections)
        enough = rows_to_slide(sections, load, loaded_at)
        rows = min(section.rows for section in sections)
        if enough > rows:
            doubts.append(
                f"'{name}' rolls on {counted(rows, 'row')} of contact points; on {enough} it "
                "would slide"
            )
    return tuple(doubts)


def rows_to_slide(faces: list[FaceInSection], load: NDArray, loaded_at: NDArray) -> int:
    """Return the number of rows of points that keep a damper with two faces from rolling.

    The result is 0 if the damper does not roll on its contact points, or would also roll with
    contact over its full faces.  Both directions of rotation are examined.

    Parameters
    ----------
    faces : list of FaceInSection
    load : (2,) float
        Unit vector of the load.
    loaded_at : (2,) float, m
        Point through which the load passes.
    """
    first, second = faces
    sine = _cross(first.normal, second.normal)
    if abs(sine) < PARALLEL:
        return 0
    # the normals meet where centre + distance * normal is the same on both faces
    between = second.centre - first.centre
    # distance along the normal of each face
    distances = np.array([_cross(between, second.normal), _cross(between, first.normal)]) / sine
    meeting = first.centre + distances[0] * first.normal
    moment_of_load = _cross(loaded_at - meeting, load)
    friction = np.array([face.friction for face in faces])
    reach = np.array([face.reach for face in faces])
    half_length = np.array([face.half_length for face in faces])

    enough = 0
    for sense in (1.0, -1.0):
        # a turn about this point moves both faces along themselves
        force_on_first = _force_per_newton(first, distances[0], sense)
        force_on_second = _force_per_newton(second, distances[1], sense)
        # N_1 force_on_first + N_2 force_on_second + load = 0, by Cramer's rule
        determinant = _cross(force_on_first, force_on_second)
        normal_force = np.array([_cross(force_on_second, load), _cross(load, force_on_first)])
        normal_force /= determinant
        # on nearly level faces a damper slips to one side before both reach the limit of friction
        if normal_force.min() <= 0.0:
            continue
        moment_of_friction = -sense * float(normal_force @ (friction * np.abs(distances)))
        moment = abs(moment_of_friction + moment_of_load)
        carried_by_points = float(normal_force @ reach)
        carried_by_whole_faces = float(normal_force @ half_length)
        # n rows carry (n - 1) / n of the moment of the whole faces
        share = moment / carried_by_whole_faces
        rolls_on_points = moment > carried_by_points
        slides_on_faces = share <= (MOST_ROWS - 1) / MOST_ROWS
        if rolls_on_points and slides_on_faces:
            # smallest n with (n - 1) / n >= share
            rows = int(np.ceil(1.0 / (1.0 - share)))
            enough = max(enough, rows)
    return enough


def _cross(a: NDArray, b: NDArray) -> float:
    """Return the component of ``a x b`` along the axis of rotation."""
    return float(a[0] * b[1] - a[1] * b[0])


def _force_per_newton(face: FaceInSection, distance: float, sense: float) -> NDArray:
    """Return the force (2,) of a face per newton of normal force, with friction against a turn.

    The body turns about the point at ``distance`` along the normal, counterclockwise for the sense
    1.
    """
    # from the point of the turn to the face
    lever_x, lever_y = -distance * face.normal
    velocity = sense * np.array([-lever_y, lever_x])
    against_turn = -velocity / abs(distance)
    return face.normal + face.friction * against_turn


def _axial_stop(face: Interface) -> bool:
    """Whether a face acts along the axis of rotation, so that the damper turns freely on it."""
    across = np.linalg.norm(face.frame[:, 2, :2].mean(axis=0))
    return bool(across < ALONG_AXIS)


def _slides(problem: Problem, face: Interface, body: str) -> bool:
    """Whether a face of a body has Coulomb friction and can open, at more than one point."""
    law = problem.settings.law_by_interface().get(face.name)
    return face.body_a == body and face.n_points > 1 and law in (LAW_SEPARABLE, LAW_COUPLED)


def _in_section(problem: Problem, face: Interface) -> FaceInSection:
    """Return a face in the plane across the axis of rotation."""
    rows, rows_along_axis = rows_of_points(face)
    centre = face.points.mean(axis=0)
    # along t1 in the section, along t2 the axis, and n
    from_centre = np.einsum("pij,pj->pi", face.frame, face.points - centre)
    reach, reach_along_axis = np.abs(from_centre[:, :2]).max(axis=0)
    # points lie in the middle of their patches
    if rows > 1:
        half_length = rows / (rows - 1) * reach
    else:
        # one row has a length along the axis alone; the other follows from the area
        length_along_axis = 2.0 * rows_along_axis / max(rows_along_axis - 1, 1) * reach_along_axis
        half_length = 0.5 * face.area.sum() / length_along_axis
    inward = -face.frame[:, 2, :2].mean(axis=0)
    friction = problem.friction[problem.coupling.rows(face.name)]
    return FaceInSection(
        centre=centre[:2],
        normal=inward / np.linalg.norm(inward),
        reach=float(reach),
        half_length=float(half_length),
        rows=rows,
        friction=float(friction.mean()),
    )


def _load(body: Body, faces: list[FaceInSection]) -> tuple[NDArray, NDArray]:
    """Return the direction (2,) of the load on a damper, and its centre of mass."""
    if body.load is not None:
        across = np.asarray(body.load.direction, float)[:2]
    else:
        across = -(faces[0].normal + faces[1].normal)
    assert body.centre is not None
    return across / np.linalg.norm(across), np.asarray(body.centre, float)[:2]
