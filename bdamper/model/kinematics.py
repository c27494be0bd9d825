r"""Kinematics: motion of the bodies and relative motion at the contact points by modal coordinates (paper, Eqs 12 to 14).

The equations of motion :math:`M \ddot X + C \dot X + K X = F_e(t) + F_n(X)` (12) are solved by modal superposition.  At
harmonic :math:`l` the motion of a body is (13)

.. math:: u = \mathrm{Re} \sum_l \Phi\, q_l\, e^{i l \theta},

with elastic and, for free bodies, six rigid-body modes :math:`\Phi`.  Harmonic 0 is the mean position.  The relative motion
of the two sides of an interface along the contact axes is their difference (14).  At harmonic :math:`l` of engine order
:math:`EO` each sector follows its neighbour with the phase :math:`l\varphi`, :math:`\varphi = 2\pi EO/N` (17, 18).  A side
in sector :math:`s` thus moves as in the reference sector times :math:`e^{i l \varphi s}`, along axes that turn with the
sector:

.. math:: (u_1, u_2, v)_l = G_l q_l, \qquad G_l = D (P_b \Phi_b - P_a \Phi_a), \qquad D = \mathrm{diag}(1, 1, -1).

:math:`P` selects the contact points with this phase, and :math:`v` is positive if the surfaces approach.  The modal contact
force of Eq. (16) is :math:`-G_l^H F_l`.  :meth:`Coupling.basis` returns :math:`G_l`.

The wave :math:`l\,EO` has the nodal diameter :math:`d = l\,EO \bmod N`.  The model contains :math:`d \le N/2`; other modes
are complex conjugates of these.

The residual flexibility of the omitted modes (for :mod:`bdamper.contact.stiffness`) uses the same :math:`P`,

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

from bdamper.model.modal_basis import rigid_motions
from bdamper.model.structure import Body, ModalBasis, Model
from bdamper.util import validation
from bdamper.util.errors import ModelError, SettingError, warn
from bdamper.util.formatting import short_repr

RIGID_NAMES = ("TX", "TY", "TZ", "RX", "RY", "RZ")
"""Rigid-body modes of a free body, along and about its axes: Y along its load, Z along the axis of rotation."""
STATIC = "static shape"
"""Beginning of the names of coordinates of static shapes."""


# ---- Modal coordinates ----


@dataclass(frozen=True)
class Coordinate:
    """Modal coordinate: mode ``index`` of ``body``, with the name ``name``."""

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
    """Return the body axes X, Y, Z of a free body as rows (3, 3): Y along its load, Z along the axis of rotation."""
    y = np.array([0.0, 1.0, 0.0]) if body.load is None else np.asarray(body.load.direction, float)
    z = np.array([0.0, 0.0, 1.0])
    x = np.cross(y, z)
    return np.array([x / np.linalg.norm(x), y, z])


def principal_axes(body: Body) -> tuple[NDArray, NDArray]:
    """Return principal moments (3,), kg m2, and axes as rows (3, 3) of a free body, in the order of its body axes."""
    assert body.inertia is not None
    axes = body_axes(body)
    moments, principal = np.linalg.eigh(body.inertia)
    along = axes @ principal
    order = scipy.optimize.linear_sum_assignment(-np.abs(along))[1]
    return moments[order], (principal[:, order] * np.sign(along[range(3), order])).T


def standard_rigid_modes(model: Model, body: Body) -> Body:
    """Replace the rigid-body modes of a free body by translations along and rotations about its body axes.

    The rotations are about the principal axes of inertia closest to X, Y, Z, through the centre of mass, so that the modes
    remain mass-normalised and orthogonal.
    """
    assert body.mass is not None and body.centre is not None
    moments, turn = principal_axes(body)
    basis = body.bases[0]
    points = np.concatenate([model.interfaces[name].points for name, _ in body.ports])
    frames = np.concatenate([model.interfaces[name].frame for name, _ in body.ports])
    translation, rotation = body_axes(body) / np.sqrt(body.mass), turn / np.sqrt(moments)[:, None]
    motion = rigid_motions(points, body.centre, translation, rotation).reshape(-1, 3, 6)
    # two kinds of products keep the rounding of earlier versions, to which folds are sensitive
    rigid = np.concatenate(
        [frames @ motion[..., :3], np.einsum("pij,pjk->pik", frames, motion[..., 3:])], axis=2
    )
    # both sets of modes span the same space: stored @ change = new
    change = np.linalg.lstsq(
        basis.contact_modes[..., :6].real.reshape(-1, 6), rigid.reshape(-1, 6), rcond=None
    )[0]
    modes = basis.contact_modes.copy()
    modes[..., :6] = rigid
    locations = {
        name: np.concatenate([m[:, :6] @ change, m[:, 6:]], axis=1)
        for name, m in basis.locations.items()
    }
    load = body.load
    if load is not None:
        generalised = load.generalised.copy()
        generalised[:6] = change.T @ load.generalised[:6]
        load = replace(load, generalised=generalised)
    return replace(
        body, bases={0: replace(basis, contact_modes=modes, locations=locations)}, load=load
    )


def _mode_name(body: Body, index: int) -> str:
    if body.kind == "free":
        return RIGID_NAMES[index] if index < 6 else f"elastic {index - 5}"
    natural = body.bases[0].n_natural
    return f"mode {index + 1}" if index < natural else f"{STATIC} {index - natural + 1}"


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
        Number of elastic modes of each free body.
    rigid : sequence of str
        Rigid-body modes of free bodies, from :data:`RIGID_NAMES`.

    Raises
    ------
    SettingError
        If a name is unknown or the model has fewer modes.
    """
    unknown = [name for name in rigid if name not in RIGID_NAMES]
    validation.check(not unknown, "rigid-body modes", f"names out of {RIGID_NAMES}", unknown)
    out = {}
    for body in model.bodies.values():
        if body.kind == "constrained":
            have = min(basis.n_natural for basis in body.bases.values())
            validation.check(
                1 <= blade_modes <= have,
                "blade_modes",
                f"1 to {have} (body '{body.name}')",
                blade_modes,
            )
            out[body.name] = np.arange(blade_modes)
        elif body.kind == "free":
            have, elastic = body.bases[0].n_modes - 6, damper_modes[body.name]
            validation.check(
                0 <= elastic <= have, "damper_modes", f"0 to {have} (body '{body.name}')", elastic
            )
            indices = [RIGID_NAMES.index(name) for name in RIGID_NAMES if name in rigid]
            out[body.name] = np.array(indices + list(range(6, 6 + elastic)), int)
        elif body.kind == "lumped":
            out[body.name] = np.arange(body.bases[0].n_modes)
    return out


# ---- Relative motion at the contact points (Eqs 13 and 14) ----


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
        Use the modes of the nodal diameter of the fundamental for every harmonic, as the paper does.
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
        return tuple(
            name for name in self.interfaces for _ in range(self.model.interfaces[name].n_points)
        )

    def rows(self, interface: str) -> slice:
        """Return the rows of one interface among the stacked contact points."""
        first = self.interface_of.index(interface)
        return slice(first, first + self.model.interfaces[interface].n_points)

    @property
    def friction_faces(self) -> tuple[str, ...]:
        """Interfaces with friction."""
        return tuple(
            name for name in self.interfaces if self.model.interfaces[name].kind == "friction"
        )

    @property
    def friction_rows(self) -> NDArray:
        """Rows (n,) of all friction interfaces among the stacked contact points."""
        numbers = np.arange(self.n_points)
        return np.concatenate(
            [np.zeros(0, int), *(numbers[self.rows(name)] for name in self.friction_faces)]
        )

    @property
    def spring_points(self) -> NDArray:
        """Whether each point belongs to linear springs that are part of the bodies, (n_points,) bool."""
        faces = [self.model.interfaces[name] for name in self.interfaces]
        return np.repeat(
            [face.kind == "spring" for face in faces], [face.n_points for face in faces]
        )

    def _moving(self, harmonic: int) -> Iterator[tuple[Body, ModalBasis, NDArray]]:
        """Iterate over the bodies except the ground, with basis and retained modes at a harmonic."""
        for body in self.model.bodies.values():
            if body.kind != "ground":
                yield body, self._basis(body, harmonic), np.asarray(self.modes[body.name])

    def _nodal_diameter(self, harmonic: int) -> tuple[int, bool]:
        return self.model.folded_nodal_diameter(
            self.engine_order * (1 if self.fundamental_modes_only else harmonic)
        )

    def _basis(self, body: Body, harmonic: int) -> ModalBasis:
        if body.kind == "free":
            return body.bases[0]
        d, conjugate = self._nodal_diameter(harmonic)
        if d not in body.bases:
            raise SettingError(
                f"body '{body.name}': harmonic {harmonic} of engine order {self.engine_order} needs nodal diameter "
                f"{d}, the model has {sorted(body.bases)}; set engine_order, or use fewer harmonics, or "
                "fundamental_modes_only=True to use the modes of the first harmonic for all"
            )
        return body.bases[d].conjugate() if conjugate else body.bases[d]

    def placed(
        self, body: Body, array: NDArray, harmonic: int, sectors: Collection[int] = (-1, 0, 1)
    ) -> NDArray:
        """Return the relative motion at all contact points that a motion at the ports of one body causes, Eq. (14).

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
        out = np.zeros((self.n_points, 3, array.shape[2]), complex)
        for name, side in body.ports:
            face = self.model.interfaces[name]
            sector, sense = (face.sector_a, -1.0) if side == "a" else (face.sector_b, 1.0)
            if name in self.interfaces and sector in sectors:
                port = array[self.model.port_slice(body.name, (name, side))]
                out[self.rows(name)] += np.exp(1j * phase * sector) * (sense * port)
        out[:, 2] *= -1.0
        return out

    def basis(self, harmonic: int) -> HarmonicBasis:
        """Return modes, modal stiffness and relative motion G of one harmonic, Eqs (13) and (14).

        Raises
        ------
        SettingError
            If the model lacks the nodal diameter that this harmonic excites.
        """
        coordinates: list[Coordinate] = []
        omega2, damping, drag, G = [], [], [], []
        diameter = 0
        for body, basis, keep in self._moving(harmonic):
            if body.kind == "constrained":
                diameter, _ = self._nodal_diameter(harmonic)
            placed = self.placed(body, basis.contact_modes[..., keep], harmonic)
            if harmonic == 0:  # the mean position is real, also with the modes of the fundamental
                placed = placed.real.astype(complex)
            G.append(placed)
            omega2.append(basis.omega2[keep])
            damping.append(basis.damping_ratio[keep])
            drag.append(_picked(basis.drag, keep))
            coordinates += [Coordinate(body.name, int(i), _mode_name(body, int(i))) for i in keep]
        stiffness = np.concatenate(omega2)
        relative, mass = np.concatenate(G, axis=2), np.ones_like(stiffness)
        ratio, rate = np.concatenate(damping), np.concatenate(drag)
        return HarmonicBasis(tuple(coordinates), stiffness, ratio, relative, diameter, mass, rate)

    def no_basis(self) -> HarmonicBasis:
        """Return a basis without modes, for a harmonic without motion."""
        empty = np.zeros(0)
        return HarmonicBasis((), empty, empty, np.zeros((self.n_points, 3, 0), complex), 0, empty)

    def location_modes(self, location: str, harmonic: int) -> NDArray:
        """Return the motion along X, Y, Z of a location for unit modal coordinates of one harmonic, (3, n_modes).

        For a field of forces these are its rows.  For "mode 1" the first row selects the coordinate of this mode of the
        constrained body.
        """
        if location not in self.model.locations:
            modes = [
                (b.kind, f"mode {i + 1}")
                for b, _, retained in self._moving(harmonic)
                for i in retained
            ]
            return np.outer([1.0, 0.0, 0.0], [mode == ("constrained", location) for mode in modes])
        moving = self.model.locations[location].body
        columns = [
            _picked(basis.locations[location] if body.name == moving else None, retained, (3,))
            for body, basis, retained in self._moving(harmonic)
        ]
        return np.concatenate(columns, axis=1)

    def residual_flexibility(self, harmonic: int) -> NDArray:
        """Return the flexibility of the omitted modes for (u1, u2, v), Hermitian (3 n_points, 3 n_points), m/N.

        Raises
        ------
        ModelError
            If the model lacks a static flexibility at this nodal diameter.
        """
        n = 3 * self.n_points
        out = np.zeros((n, n), complex)
        for body, basis, keep in self._moving(harmonic):
            if not body.ports:
                continue
            if basis.flexibility is None:
                d = 0 if body.kind == "free" else self._nodal_diameter(harmonic)[0]
                raise ModelError(
                    f"body '{body.name}': contact stiffness needs its static flexibility at nodal diameter {d}, which "
                    "the model lacks; set contact_stiffness to numbers"
                )
            keep = keep[basis.omega2[keep] > 0.0]
            modes = basis.contact_modes[..., keep].reshape(basis.flexibility.shape[0], len(keep))
            residual = basis.flexibility - (modes / basis.omega2[keep]) @ modes.conj().T
            m = residual.shape[0] // 3
            half = self.placed(body, residual.reshape(m, 3, 3 * m), harmonic).reshape(n, 3 * m)
            out += (
                self.placed(body, half.conj().T.reshape(m, 3, n), harmonic).reshape(n, n).conj().T
            )
        return 0.5 * (out + out.conj().T)

    def left_out_modes(self, harmonic: int) -> tuple[NDArray, NDArray, NDArray]:
        """Return the elastic modes in the model that are not retained.

        Returns
        -------
        G : (3 n_points, n) complex
            Relative motion.
        omega2, damping_ratio : (n,) float
        """
        G, omega2, ratio = [], [], []
        for body, basis, keep in self._moving(harmonic):
            omitted = np.setdiff1d(np.flatnonzero(basis.omega2 > 0.0), keep)
            placed = self.placed(body, basis.contact_modes[..., omitted], harmonic)
            G.append(placed.reshape(3 * self.n_points, len(omitted)))
            omega2.append(basis.omega2[omitted])
            ratio.append(basis.damping_ratio[omitted])
        return np.concatenate(G, axis=1), np.concatenate(omega2), np.concatenate(ratio)

    def constant_force(self) -> NDArray:
        """Return the modal static force (n_modes,) independent of the load."""
        return np.concatenate(
            [_picked(body.constant_force, keep) for body, _, keep in self._moving(0)]
        )

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
                force.append(_picked(None, keep))
                continue
            force.append(share * body.load.generalised[keep])
            basis = body.bases[0]
            elastic = keep[basis.omega2[keep] > 0.0]
            omitted = body.load.displacement - (
                basis.contact_modes[..., elastic].real
                @ (body.load.generalised[elastic] / basis.omega2[elastic])
            )
            displacement += share * self.placed(body, omitted[..., None], 0)[..., 0].real
        return np.concatenate(force), displacement

    def closing_by_rotation(self) -> NDArray:
        """Return the displacement of (u1, u2, v) due to rotation per squared speed, (n_points, 3).

        See ``bdamper.model.modal_basis.SpinStatic``.
        """
        displacement = np.zeros((self.n_points, 3))
        for body in self.model.bodies.values():
            if body.spin is not None:
                displacement += self.placed(body, body.spin.contact[..., None], 0)[..., 0].real
        return displacement


def _picked(array: NDArray | None, keep: NDArray, before: tuple[int, ...] = ()) -> NDArray:
    """Return the columns ``keep`` of an array; zeros of shape (*before, len(keep)) for None."""
    return np.zeros((*before, len(keep))) if array is None else array[..., keep]


# ---- Centrifugal load, damping and flow ----


def centrifugal_arms(model: Model) -> dict[str, float]:
    """Return mass times radius (kg m) of each loaded free body: its centrifugal load per squared rotor speed.

    Raises
    ------
    SettingError
        If the centre of mass of one of them lies on the axis.
    """
    loaded = {b.name: b for b in model.bodies.values() if b.kind == "free" and b.load is not None}
    arms = {name: float(b.mass * np.hypot(*b.centre[:2])) for name, b in loaded.items()}  # type: ignore[index]
    found = ", ".join(f"{arm:.6g} kg m of '{name}'" for name, arm in arms.items())
    validation.check(
        min(arms.values(), default=1.0) > 0.0,
        "rotor speed",
        "loaded free bodies off the axis",
        found,
    )
    return arms


def centrifugal_load(model: Model) -> float:
    """Return the centrifugal load of the first loaded free body per squared rotor speed (kg m): its preload at a speed.

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
    """Return the viscous modal damping of the coordinates of free bodies, rad/s.

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
    closed = springs.ravel() > 0.0
    G = basis.G.real.reshape(-1, basis.n_modes)[closed]
    free = {
        i: c
        for i, c in enumerate(basis.coordinates)
        if c.body in model.bodies and model.bodies[c.body].kind == "free"
    }
    residual = [i for i, c in enumerate(basis.coordinates) if c.body not in model.bodies]
    flexibility = (
        np.diag(1.0 / springs.ravel()[closed])
        + G[:, residual] / basis.omega2[residual] @ G[:, residual].T
    )
    motion = G[:, list(free)]
    frequency = np.sqrt(
        (motion * np.linalg.solve(flexibility, motion)).sum(axis=0) + basis.omega2[list(free)]
    )
    masses = {c: (w, model.bodies[c.body].mass) for c, w in zip(free.values(), frequency)}
    rates = {
        c: float(2.0 * ratio[c.body] * w + drag[c.body] / m)
        for c, (w, m) in masses.items()
        if m is not None
    }
    omega, rate = (
        float(np.sqrt(basis.omega2[basis.omega2 > 0.0].min(initial=np.inf))),
        max(rates.values(), default=0.0),
    )
    if rate > omega:
        warn(
            f"damping of the damper: a rate of up to {rate:.3g} 1/s exceeds omega = {omega:.3g} rad/s of the lowest mode; "
            "the damper cannot move freely relative to the rotor"
        )
    return rates


def in_flow(
    basis: HarmonicBasis, model: Model, flow: Mapping[int, complex], wave: int
) -> HarmonicBasis:
    """Add aerodynamic stiffness ``2 Re z omega^2`` and damping ``2 Im z omega`` to the modes of constrained bodies.

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
    z: Any = flow.get(wave % model.n_blades, 0.0)
    blades = [name for name, body in model.bodies.items() if body.kind == "constrained"]
    z = z * np.array([coordinate.body in blades for coordinate in basis.coordinates])
    drag = basis.damping + 2.0 * np.imag(z) * np.sqrt(basis.omega2)
    expected = (
        "modes with positive damping and stiffness; study.flutter finds the limit cycles of others"
    )
    good = (drag >= 0.0).all() and (np.real(z) > -0.5).all()
    validation.check(
        good,
        f"aerodynamic_damping at nodal diameter {wave % model.n_blades}",
        expected,
        "some without",
    )
    none = np.zeros_like(basis.damping_ratio)
    return replace(
        basis, omega2=basis.omega2 * (1.0 + 2.0 * np.real(z)), damping_ratio=none, drag=drag
    )
