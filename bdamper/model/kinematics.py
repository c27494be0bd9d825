r"""Kinematics: motion of the bodies and relative motion at the contact points.

It follows Eqs. (12) to (14) of the paper.  The equations of motion
:math:`M \ddot X + C \dot X + K X = F_e(t) + F_n(X)` (12) are solved by modal superposition.  At
harmonic :math:`l` the motion of a body is (13)

.. math:: u = \mathrm{Re} \sum_l \Phi\, q_l\, e^{i l \theta},

with elastic and, for free bodies, six rigid-body modes :math:`\Phi`.  Harmonic 0 is the mean
position.  The relative motion of the two sides of an interface along the contact axes is their
difference (14).  At harmonic :math:`l` of engine order :math:`EO` each sector follows its neighbour
with the phase :math:`l\varphi`, :math:`\varphi = 2\pi EO/N` (17, 18).  A side in sector :math:`s`
thus moves as in the reference sector times :math:`e^{i l \varphi s}`, along axes that rotate with
the sector:

.. math:: (u_1, u_2, v)_l = G_l q_l, \qquad G_l = D (P_b \Phi_b - P_a \Phi_a), \qquad
    D = \mathrm{diag}(1, 1, -1).

:math:`P` selects the contact points with this phase, and :math:`v` is positive if the surfaces
approach.  The modal contact force of Eq. (16) is :math:`-G_l^H F_l`.  :meth:`Coupling.basis`
returns :math:`G_l`.

The wave :math:`l\,EO` has the nodal diameter :math:`d = l\,EO \bmod N`.  The model contains
:math:`d \le N/2`; other modes are complex conjugates of these.

The residual flexibility of the omitted modes (for :mod:`bdamper.contact.stiffness`) uses the same
:math:`P`,

.. math:: R_{res} = D \Big[ \sum P\,(R - \Phi \Omega^{-2} \Phi^H)\,P^H \Big] D .
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from bdamper.model.gauges import GAUGE, gauge_point, gauge_weights
from bdamper.model.loads import Response
from bdamper.model.modal_basis import rigid_motions
from bdamper.model.structure import Body, ModalBasis, Model
from bdamper.util import validation
from bdamper.util.errors import ModelError, SettingError, warn
from bdamper.util.formatting import short_repr

RIGID_NAMES = ("TX", "TY", "TZ", "RX", "RY", "RZ")
"""Rigid-body modes of a free body, along and about its axes: Y along its load, Z along the axis of
rotation.
"""
N_RIGID = len(RIGID_NAMES)
"""Modes of a free body beside which ``damper_modes`` counts; a ring keeps as many of its lowest
modes at each nodal diameter.
"""
STATIC = "static shape"
"""Beginning of the names of coordinates of static shapes."""


# ---- Modal coordinates ----


@dataclass(frozen=True)
class Coordinate:
    """Modal coordinate ``name``, the mode ``index`` of ``body``."""

    body: str
    index: int
    name: str

    @property
    def is_mode(self) -> bool:
        """Whether the coordinate belongs to a mode and not to a static shape."""
        return not self.name.startswith(STATIC)


@short_repr
@dataclass(frozen=True)
class HarmonicBasis:
    """Modes of all bodies for one harmonic.

    Parameters
    ----------
    coordinates : tuple of Coordinate
    omega2, damping_ratio : (n_modes,) float
        Modal stiffness (squared natural frequency for modal mass 1) and damping ratio.
    mass : (n_modes,) float
        Modal mass: 1 for modes of a body, 0 or more for residual modes.
    G : (n_points, 3, n_modes) complex
        Relative motion (u1, u2, v) at the contact points of all interfaces for unit coordinates.
    nodal_diameter : int
    drag : (n_modes,) float or 0.0
        Viscous modal damping in addition to the damping ratios.
    """

    coordinates: tuple[Coordinate, ...]
    omega2: NDArray
    damping_ratio: NDArray
    G: NDArray
    nodal_diameter: int
    mass: NDArray
    drag: NDArray | float = 0.0

    @property
    def n_modes(self) -> int:
        return len(self.omega2)

    @property
    def damping(self) -> NDArray:
        """Viscous modal damping (n_modes,)."""
        return np.asarray(2.0 * self.damping_ratio * np.sqrt(self.omega2 * self.mass) + self.drag)


# ---- Rigid-body modes of free bodies, and retained modes ----


def body_axes(body: Body) -> NDArray:
    """Return the body axes X, Y, Z of a free body as rows (3, 3).

    Y is along its load, Z along the axis of rotation.
    """
    y = np.array([0.0, 1.0, 0.0])
    if body.load is not None:
        y = np.asarray(body.load.direction, float)
    z = np.array([0.0, 0.0, 1.0])
    x = np.cross(y, z)
    return np.array([x / np.linalg.norm(x), y, z])


def principal_axes(body: Body) -> tuple[NDArray, NDArray]:
    """Return principal moments (3,), kg m2, and axes as rows (3, 3) of a free body.

    They are ordered and oriented to match the closest body axes.
    """
    assert body.inertia is not None
    axes = body_axes(body)
    # the columns of principal are the axes
    moments, principal = np.linalg.eigh(body.inertia)
    cosine = axes @ principal
    # one principal axis for each body axis, so that the sum of |cosine| is largest
    _, order = scipy.optimize.linear_sum_assignment(-np.abs(cosine))
    sense = np.sign(cosine[range(3), order])
    columns = principal[:, order] * sense
    return moments[order], columns.T


def standard_rigid_modes(model: Model, body: Body) -> Body:
    """Replace the rigid-body modes of a free body by motions along and about its body axes.

    The rotations are about the principal axes of inertia closest to X, Y, Z, through the centre of
    mass, so that the modes remain mass-normalised and orthogonal.
    """
    assert body.mass is not None and body.centre is not None
    moments, rotation_axes = principal_axes(body)
    basis = body.bases[0]
    faces = [model.interfaces[name] for name, _ in body.ports]
    points = np.concatenate([face.points for face in faces])
    frames = np.concatenate([face.frame for face in faces])
    translation = body_axes(body) / np.sqrt(body.mass)
    rotation = rotation_axes / np.sqrt(moments)[:, None]
    # motion along X, Y, Z, (n_points, 3, 6): three translations, then three rotations
    motion = rigid_motions(points, body.centre, translation, rotation).reshape(-1, 3, N_RIGID)

    # along t1, t2, n of each point; two kinds of products keep the rounding of earlier versions,
    # to which folds are sensitive
    translations = frames @ motion[..., :3]
    rotations = np.einsum("pij,pjk->pik", frames, motion[..., 3:])
    rigid = np.concatenate([translations, rotations], axis=2)
    modes = basis.contact_modes.copy()
    modes[..., :N_RIGID] = rigid

    # both sets of modes span the same space: stored @ change = rigid
    stored = basis.contact_modes[..., :N_RIGID].real
    change = np.linalg.lstsq(stored.reshape(-1, N_RIGID), rigid.reshape(-1, N_RIGID), rcond=None)[0]
    locations = {}
    for name, at_location in basis.locations.items():
        changed = at_location[:, :N_RIGID] @ change
        elastic = at_location[:, N_RIGID:]
        locations[name] = np.concatenate([changed, elastic], axis=1)
    load = body.load
    if load is not None:
        generalised = load.generalised.copy()
        generalised[:N_RIGID] = change.T @ load.generalised[:N_RIGID]
        load = replace(load, generalised=generalised)
    new_basis = replace(basis, contact_modes=modes, locations=locations)
    return replace(body, bases={0: new_basis}, load=load)


def _mode_name(body: Body, index: int) -> str:
    if body.kind == "free":
        return RIGID_NAMES[index] if index < N_RIGID else f"elastic {index - N_RIGID + 1}"
    n_natural = body.bases[0].n_natural
    if index < n_natural:
        return f"mode {index + 1}"
    return f"{STATIC} {index - n_natural + 1}"


def retained_modes(
    model: Model,
    blade_modes: int,
    damper_modes: Mapping[str, int],
    rigid: Sequence[str] = RIGID_NAMES,
) -> dict[str, NDArray]:
    """Return the indices of the retained modes of each body.

    Parameters
    ----------
    blade_modes : int
        Number of modes of each constrained body.
    damper_modes : mapping of body name to int
        Number of elastic modes of each free body.  For a ring, number of modes in addition to its
        six lowest modes.
    rigid : sequence of str
        Rigid-body modes of free bodies, from :data:`RIGID_NAMES`.  They do not apply to a ring,
        whose six lowest modes are always retained.

    Raises
    ------
    SettingError
        If a name is unknown or the model has fewer modes.
    """
    unknown = [name for name in rigid if name not in RIGID_NAMES]
    validation.check(not unknown, "rigid-body modes", f"names out of {RIGID_NAMES}", unknown)
    rigid_indices = [RIGID_NAMES.index(name) for name in RIGID_NAMES if name in rigid]
    retained = {}
    for body in model.bodies.values():
        if body.kind == "constrained":
            available = min(basis.n_natural for basis in body.bases.values())
            validation.check(
                1 <= blade_modes <= available,
                "blade_modes",
                f"1 to {available} (body '{body.name}')",
                blade_modes,
            )
            retained[body.name] = np.arange(blade_modes)
        elif body.is_free:
            available = body.n_elastic
            elastic = damper_modes[body.name]
            validation.check(
                0 <= elastic <= available,
                "damper_modes",
                f"0 to {available} (body '{body.name}')",
                elastic,
            )
            lowest = list(range(N_RIGID)) if body.kind == "ring" else rigid_indices
            elastic_indices = list(range(N_RIGID, N_RIGID + elastic))
            retained[body.name] = np.array(lowest + elastic_indices, int)
        elif body.kind == "lumped":
            retained[body.name] = np.arange(body.bases[0].n_modes)
    return retained


# ---- Relative motion at the contact points (Eqs. (13) and (14)) ----


@short_repr
@dataclass(frozen=True)
class Coupling:
    """Selection of modes and interfaces of a model, with the matrices of each harmonic.

    Parameters
    ----------
    model : Model
    interfaces : tuple of str
        Active interfaces in the order of the stacked contact points.
    modes : mapping of body name to (n,) int
        Retained modes of each body.
    engine_order : int
    fundamental_modes_only : bool
        Use the modes of the nodal diameter of the fundamental for every harmonic, as the paper
        does.
    """

    model: Model
    interfaces: tuple[str, ...]
    modes: Mapping[str, NDArray]
    engine_order: int
    fundamental_modes_only: bool = False

    @cached_property
    def n_points(self) -> int:
        return sum(self.model.interfaces[name].n_points for name in self.interfaces)

    @cached_property
    def interface_of(self) -> tuple[str, ...]:
        """Interface name of each contact point, (n_points,)."""
        names: list[str] = []
        for name in self.interfaces:
            names += [name] * self.model.interfaces[name].n_points
        return tuple(names)

    def rows(self, interface: str) -> slice:
        """Return the rows of one interface among the stacked contact points."""
        first = self.interface_of.index(interface)
        return slice(first, first + self.model.interfaces[interface].n_points)

    @property
    def friction_faces(self) -> tuple[str, ...]:
        """Interfaces with friction."""
        interfaces = self.model.interfaces
        return tuple(name for name in self.interfaces if interfaces[name].kind == "friction")

    @property
    def friction_rows(self) -> NDArray:
        """Rows (n,) of all friction interfaces among the stacked contact points."""
        numbers = np.arange(self.n_points)
        rows = [numbers[self.rows(name)] for name in self.friction_faces]
        return np.concatenate([np.zeros(0, int), *rows])

    @property
    def spring_points(self) -> NDArray:
        """Whether each point is a linear spring that is part of the bodies, (n_points,) bool."""
        faces = [self.model.interfaces[name] for name in self.interfaces]
        is_spring = np.array([face.kind == "spring" for face in faces], bool)
        return np.repeat(is_spring, [face.n_points for face in faces])

    def _moving(self, harmonic: int) -> Iterator[tuple[Body, ModalBasis, NDArray]]:
        """Iterate over bodies except the ground, with basis and retained modes at a harmonic."""
        diameter, _ = self._nodal_diameter(harmonic)
        for body in self.model.bodies.values():
            if body.kind == "ground":
                continue
            keep = np.asarray(self.modes[body.name])
            if body.kind == "ring" and diameter == 0:
                keep = self._held_along_axis(body, keep)
            yield body, self._basis(body, harmonic), keep

    def _held_along_axis(self, body: Body, keep: NDArray) -> NDArray:
        """Return the retained modes of a ring at nodal diameter 0, without motions along and about
        the axis unless the engine order excites these.

        A slipping contact leaves the mean position of the ring undetermined; in hardware a groove
        or a pin holds it.
        """
        if self.engine_order % self.model.n_blades == 0:
            return keep
        # the last two rigid-body modes; a split ring also has a radial one, which is first
        along_and_about = [body.n_rigid - 2, body.n_rigid - 1]
        return np.setdiff1d(keep, along_and_about)

    def _nodal_diameter(self, harmonic: int) -> tuple[int, bool]:
        """Return the nodal diameter of the modes of a harmonic, and whether they are conjugates."""
        if self.fundamental_modes_only:
            harmonic = 1
        return self.model.folded_nodal_diameter(self.engine_order * harmonic)

    def _basis(self, body: Body, harmonic: int) -> ModalBasis:
        if body.kind == "free":
            return body.bases[0]
        d, conjugate = self._nodal_diameter(harmonic)
        if d not in body.bases:
            raise SettingError(
                f"body '{body.name}': harmonic {harmonic} of engine order {self.engine_order} "
                f"needs nodal diameter {d}, the model has {sorted(body.bases)}; "
                "set engine_order, or use fewer harmonics, or fundamental_modes_only=True "
                "to use the modes of the first harmonic for all"
            )
        return body.bases[d].conjugate() if conjugate else body.bases[d]

    def placed(
        self, body: Body, array: NDArray, harmonic: int, sectors: Collection[int] = (-1, 0, 1)
    ) -> NDArray:
        """Return the relative motion at all contact points due to the motion of one body, Eq. (14).

        Parameters
        ----------
        body : Body
        array : (n_points of the body, 3, n) complex or float
            Motion at the contact points of the body.
        harmonic : int
        sectors : collection of int
            Only ports in these sectors contribute.

        Returns
        -------
        (n_points, 3, n) complex
        """
        phase = 2.0 * np.pi * self.engine_order * harmonic / self.model.n_blades
        relative = np.zeros((self.n_points, 3, array.shape[2]), complex)
        for name, side in body.ports:
            face = self.model.interfaces[name]
            if side == "a":
                sector = face.sector_a
                sense = -1.0
            else:
                sector = face.sector_b
                sense = 1.0
            if name in self.interfaces and sector in sectors:
                port = array[self.model.port_slice(body.name, (name, side))]
                # one body may be on both sides of an interface
                relative[self.rows(name)] += np.exp(1j * phase * sector) * (sense * port)
        # v is positive if the surfaces approach
        relative[:, 2] *= -1.0
        return relative

    def basis(self, harmonic: int) -> HarmonicBasis:
        """Return modes, modal stiffness and relative motion G of one harmonic, Eqs. (13) and (14).

        Raises
        ------
        SettingError
            If the model lacks the nodal diameter that this harmonic excites.
        """
        coordinates: list[Coordinate] = []
        omega2 = []
        damping_ratio = []
        drag = []
        G = []
        diameter = 0
        for body, basis, keep in self._moving(harmonic):
            if body.kind == "constrained":
                diameter, _ = self._nodal_diameter(harmonic)
            relative = self.placed(body, basis.contact_modes[..., keep], harmonic)
            # the mean position is real, also with the modes of the fundamental
            if harmonic == 0:
                relative = relative.real.astype(complex)
            G.append(relative)
            omega2.append(basis.omega2[keep])
            damping_ratio.append(basis.damping_ratio[keep])
            drag.append(_picked(basis.drag, keep))
            for mode in keep.tolist():
                coordinates.append(Coordinate(body.name, mode, _mode_name(body, mode)))
        stiffness = np.concatenate(omega2)
        return HarmonicBasis(
            coordinates=tuple(coordinates),
            omega2=stiffness,
            damping_ratio=np.concatenate(damping_ratio),
            G=np.concatenate(G, axis=2),
            nodal_diameter=diameter,
            mass=np.ones_like(stiffness),
            drag=np.concatenate(drag),
        )

    def no_basis(self) -> HarmonicBasis:
        """Return a basis without modes, for a harmonic without motion."""
        empty = np.zeros(0)
        no_motion = np.zeros((self.n_points, 3, 0), complex)
        return HarmonicBasis(
            coordinates=(),
            omega2=empty,
            damping_ratio=empty,
            G=no_motion,
            nodal_diameter=0,
            mass=empty,
        )

    def location_modes(self, location: str, harmonic: int) -> NDArray:
        """Return the motion of a location for unit modal coordinates, (3, n_modes).

        The rows are along X, Y, Z.  For a field of forces these are its rows, and for the base the
        inertia forces under its unit accelerations.  For "mode 1" the first row selects the
        coordinate of this mode of the constrained body.
        """
        # one array (3, n) for the modes of each body
        columns = []
        if location not in self.model.locations:
            for body, _, keep in self._moving(harmonic):
                selected = np.zeros((3, len(keep)))
                if body.kind == "constrained":
                    selected[0] = [location == f"mode {i + 1}" for i in keep]
                columns.append(selected)
            return np.concatenate(columns, axis=1)
        place = self.model.locations[location]
        for body, basis, keep in self._moving(harmonic):
            # None if the body does not move the location
            modes = None
            if body.name == place.body:
                if location not in basis.locations:
                    d, _ = self._nodal_diameter(harmonic)
                    raise SettingError(
                        f"{location}: the stress set lacks nodal diameter {d} of harmonic {harmonic}"
                    )
                modes = basis.locations[location]
            elif place.kind == "base" and body.kind == "free":
                modes = inertia_of_free_body(body)
            columns.append(_picked(modes, keep, (3,)))
        return np.concatenate(columns, axis=1)

    def strain_by_contact(self, place: Response, harmonic: int) -> NDArray:
        """Return the row ``s`` (3 n_points,) for which contact forces F cause a strain ``-s^H F``.

        It is the static strain at a gauge that the retained modes do not contain.  It consists of
        the strain of the omitted modes and of the local deformation, which no mode represents.
        """
        stress_set, index = gauge_point(self.model.stress, place.location)
        weights = gauge_weights(place.direction, place.elastic)
        d, conjugate = self._nodal_diameter(harmonic)
        for body, basis, keep in self._moving(harmonic):
            if body.name != stress_set.body or not body.ports:
                continue
            omitted = np.setdiff1d(np.flatnonzero(basis.omega2 > 0.0), keep)
            # strain at the gauge for unit modal forces on the omitted modes
            row = basis.locations[GAUGE][0, omitted] / basis.omega2[omitted]
            # per contact point of the body and direction, (n_points of the body, 3)
            at_ports = basis.contact_modes[..., omitted] @ row.conj()
            if stress_set.contact:
                # strain for unit forces at the contact points, (3 n_points of the body,)
                local = weights @ stress_set.contact[d][index]
                # the stress set has no conjugate, unlike the modes
                local = local if conjugate else local.conj()
                at_ports = at_ports + local.reshape(-1, 3)
            return self.placed(body, at_ports[..., None], harmonic).reshape(-1)
        return np.zeros(3 * self.n_points)

    def carried_by_base(self, location: str, base: str) -> NDArray:
        """Return the motion (3, 3) of a location along X, Y, Z for unit translations of the base.

        The degrees of freedom of a lumped model are not along X, Y, Z: their motion follows from
        the inertia forces, because its modes are complete and mass-normalised.
        """
        body = self.model.bodies[self.model.locations[location].body]
        if location == base or body.kind != "lumped":
            return np.eye(3)
        rows = body.bases[0].locations
        return np.asarray(-rows[location] @ rows[base].T)

    def residual_flexibility(self, harmonic: int) -> NDArray:
        """Return the flexibility of the omitted modes for (u1, u2, v), m/N.

        It is Hermitian, (3 n_points, 3 n_points).

        Raises
        ------
        ModelError
            If the model lacks a static flexibility at this nodal diameter.
        """
        n = 3 * self.n_points
        total = np.zeros((n, n), complex)
        for body, basis, keep in self._moving(harmonic):
            if not body.ports:
                continue
            if basis.flexibility is None:
                d = 0 if body.kind == "free" else self._nodal_diameter(harmonic)[0]
                raise ModelError(
                    f"body '{body.name}': contact stiffness needs its static flexibility at nodal "
                    f"diameter {d}, which the model lacks; set contact_stiffness to numbers"
                )
            elastic = keep[basis.omega2[keep] > 0.0]
            n_forces = len(basis.flexibility)
            modes = basis.contact_modes[..., elastic].reshape(n_forces, len(elastic))
            R = basis.flexibility - (modes / basis.omega2[elastic]) @ modes.conj().T

            # `placed` applies P to the first two axes, (point of the body, direction):
            # first P R, (n, n_forces), then P (P R)^H = (P R P^H)^H, (n, n)
            n_body = n_forces // 3
            PR = self.placed(body, R.reshape(n_body, 3, n_forces), harmonic).reshape(n, n_forces)
            PR_H = PR.conj().T
            PRP_H = self.placed(body, PR_H.reshape(n_body, 3, n), harmonic).reshape(n, n)
            total += PRP_H.conj().T
        # R is Hermitian up to rounding
        return 0.5 * (total + total.conj().T)

    def left_out_modes(self, harmonic: int) -> tuple[NDArray, NDArray, NDArray]:
        """Return the elastic modes in the model that are not retained.

        Returns
        -------
        G : (3 n_points, n) complex
            Relative motion.
        omega2, damping_ratio : (n,) float
        """
        G = []
        omega2 = []
        ratio = []
        for body, basis, keep in self._moving(harmonic):
            omitted = np.setdiff1d(np.flatnonzero(basis.omega2 > 0.0), keep)
            placed = self.placed(body, basis.contact_modes[..., omitted], harmonic)
            G.append(placed.reshape(3 * self.n_points, len(omitted)))
            omega2.append(basis.omega2[omitted])
            ratio.append(basis.damping_ratio[omitted])
        return np.concatenate(G, axis=1), np.concatenate(omega2), np.concatenate(ratio)

    def constant_force(self) -> NDArray:
        """Return the modal static force (n_modes,) independent of the load."""
        forces = [_picked(body.constant_force, keep) for body, _, keep in self._moving(0)]
        return np.concatenate(forces)

    def load(self, shares: Mapping[str, float] | None = None) -> tuple[NDArray, NDArray]:
        """Return the static load of the free bodies.

        Parameters
        ----------
        shares : mapping of body name to float, N
            Load on each body; 0 N for missing names.  By default 1 N on every loaded body.

        Returns
        -------
        force : (n_modes,) float
            Modal force.
        displacement : (n_points, 3) float, m
            Part of (u1, u2, v) that the retained elastic modes do not represent.
        """
        force = []
        displacement = np.zeros((self.n_points, 3))
        for body, _, keep in self._moving(0):
            share = 1.0 if shares is None else shares.get(body.name, 0.0)
            if body.load is None or share == 0.0:
                force.append(np.zeros(len(keep)))
                continue
            generalised = body.load.generalised
            force.append(share * generalised[keep])
            # the elastic displacement without that of the retained modes
            basis = body.bases[0]
            elastic = keep[basis.omega2[keep] > 0.0]
            coordinates = generalised[elastic] / basis.omega2[elastic]
            represented = basis.contact_modes[..., elastic].real @ coordinates
            omitted = body.load.displacement - represented
            # one displacement field, (n_points, 3, 1)
            placed = self.placed(body, omitted[..., None], harmonic=0)
            displacement += share * placed[..., 0].real
        return np.concatenate(force), displacement

    def closing_by_rotation(self) -> NDArray:
        """Return the displacement of (u1, u2, v) due to rotation per squared speed, (n_points, 3).

        See ``bdamper.model.modal_basis.SpinStatic``.
        """
        displacement = np.zeros((self.n_points, 3))
        for body in self.model.bodies.values():
            if body.spin is not None:
                # one displacement field, (n_points, 3, 1)
                placed = self.placed(body, body.spin.contact[..., None], harmonic=0)
                displacement += placed[..., 0].real
        return displacement


def inertia_of_free_body(body: Body) -> NDArray:
    """Return the modal inertia forces (3, n_modes) of a free body under unit accelerations of the
    base along X, Y, Z.

    Its elastic modes are orthogonal to a translation in the mass matrix.
    """
    assert body.mass is not None
    rows = np.zeros((3, body.bases[0].n_modes))
    # the first three modes are translations along the body axes, divided by sqrt(mass)
    rows[:, :3] = -np.sqrt(body.mass) * body_axes(body).T
    return rows


def _picked(array: NDArray | None, keep: NDArray, before: tuple[int, ...] = ()) -> NDArray:
    """Return the columns ``keep`` of an array (*before, n_modes), or zeros for None."""
    if array is None:
        return np.zeros((*before, len(keep)))
    return array[..., keep]


# ---- Centrifugal load, damping and flow ----


def centrifugal_arms(model: Model) -> dict[str, float]:
    """Return mass times radius (kg m) of each loaded free body.

    This is its centrifugal load per squared rotor speed.

    Raises
    ------
    SettingError
        If the centre of mass of one of them lies on the axis.
    """
    arms = {}
    for body in model.bodies.values():
        if body.is_free and body.load is not None:
            assert body.mass is not None and body.centre is not None
            arms[body.name] = float(body.mass * np.hypot(*body.centre[:2]))
    all_off_axis = all(arm > 0.0 for arm in arms.values())
    found = ", ".join(f"{arm:.6g} kg m of '{name}'" for name, arm in arms.items())
    validation.check(all_off_axis, "rotor speed", "loaded free bodies off the axis", found)
    return arms


def centrifugal_load(model: Model) -> float:
    """Return the centrifugal load of the first loaded free body per squared rotor speed (kg m).

    It gives the preload at a speed.

    Raises
    ------
    SettingError
        If no free body carries a load, or if the centre of mass of one lies on the axis.
    """
    arms = centrifugal_arms(model)
    validation.check(arms, "rotor speed", "a free body off the axis that carries a load", "none")
    return next(iter(arms.values()))


def damper_drag(
    model: Model,
    basis: HarmonicBasis,
    springs: NDArray,
    ratio: Mapping[str, float],
    drag: Mapping[str, float],
) -> dict[Coordinate, float]:
    """Return the viscous modal damping of the coordinates of free bodies other than rings, rad/s.

    Parameters
    ----------
    model : Model
    basis : HarmonicBasis
        Basis of harmonic 0; coordinates without inertia act as springs in series.
    springs : (n_points, 3) float, N/m
        Contact stiffness in stick; 0 at open contacts.
    ratio : mapping of body name to float
        Damping ratio of each rigid-body motion on the contact springs alone.
    drag : mapping of body name to float, N s/m
        Viscous damper on the translation of a body, proportional to mass for its other motions.
    """
    free: list[int] = []
    residual: list[int] = []
    for i, coordinate in enumerate(basis.coordinates):
        # residual modes belong to contacts, not to a body
        if coordinate.body not in model.bodies:
            residual.append(i)
        elif model.bodies[coordinate.body].kind == "free":
            free.append(i)

    # rows of G for contact springs: three directions of all points, where a spring acts
    k = springs.ravel()
    acts = k > 0.0
    G = basis.G.real.reshape(-1, basis.n_modes)[acts]

    # contact stiffness of each motion alone, on the springs in series with the residual modes
    G_residual = G[:, residual]
    residual_flexibility = G_residual / basis.omega2[residual] @ G_residual.T
    flexibility = np.diag(1.0 / k[acts]) + residual_flexibility
    G_free = G[:, free]
    spring_forces = np.linalg.solve(flexibility, G_free)
    contact_stiffness = (G_free * spring_forces).sum(axis=0)
    omega = np.sqrt(contact_stiffness + basis.omega2[free])

    rates = {}
    for i, omega_alone in zip(free, omega):
        coordinate = basis.coordinates[i]
        name = coordinate.body
        mass = model.bodies[name].mass
        if mass is not None:
            rates[coordinate] = float(2.0 * ratio[name] * omega_alone + drag[name] / mass)

    largest_rate = max(rates.values(), default=0.0)
    elastic = basis.omega2 > 0.0
    lowest_omega = float(np.sqrt(basis.omega2[elastic].min(initial=np.inf)))
    if largest_rate > lowest_omega:
        warn(
            f"damping of the damper: a rate of up to {largest_rate:.3g} 1/s exceeds "
            f"omega = {lowest_omega:.3g} rad/s of the lowest mode; "
            "the damper cannot move freely relative to the rotor; reduce damper_damping_ratio or "
            "damper_drag"
        )
    return rates


def in_flow(
    basis: HarmonicBasis, model: Model, flow: Mapping[int, complex], wave: int
) -> HarmonicBasis:
    """Add aerodynamic stiffness and damping to the modes of constrained bodies.

    They are ``2 Re z omega^2`` and ``2 Im z omega``.

    Parameters
    ----------
    basis : HarmonicBasis
    model : Model
    flow : mapping of wave (0 to n_blades - 1) to complex
        Values z: the real part is a relative frequency shift, the imaginary part a damping ratio.
    wave : int
        Number of nodal diameters of the harmonic, a multiple of the engine order.

    Raises
    ------
    SettingError
        If a mode has negative damping or stiffness.
    """
    diameter = wave % model.n_blades
    value: Any = flow.get(diameter, 0.0)
    blades = [name for name, body in model.bodies.items() if body.kind == "constrained"]
    of_blade = np.array([coordinate.body in blades for coordinate in basis.coordinates])
    # one value for each mode, 0 for modes of dampers
    z = value * of_blade
    drag = basis.damping + 2.0 * np.imag(z) * np.sqrt(basis.omega2)
    stiffness_factor = 1.0 + 2.0 * np.real(z)
    validation.check_sentence(
        (drag >= 0.0).all() and (np.real(z) > -0.5).all(),
        f"aerodynamic_damping at nodal diameter {diameter}",
        "some modes have negative damping or stiffness; use study.flutter for their limit cycles",
    )
    # the drag includes the damping of the damping ratios
    return replace(
        basis,
        omega2=basis.omega2 * stiffness_factor,
        damping_ratio=np.zeros_like(basis.damping_ratio),
        drag=drag,
    )
