"""From bodies to interfaces: the relative motion at all contact points as a function of modal coordinates.

The motion of every body is a superposition of its modes (paper, Eq. (13)), and the relative motion of the two sides of an
interface is their difference along the contact axes (Eq. (14)).  At harmonic ``l`` of engine order ``EO`` every sector
repeats its neighbour with the phase ``l phi``, ``phi = 2 pi EO/N`` (Eqs (17), (18)).  A side of an interface that lies in
sector ``s`` therefore moves as the port of the reference sector times ``exp(i l phi s)``, in contact axes that turn with
the sector.  The columns of

    G_l = D (P_b Phi_b - P_a Phi_a),     D = diag(1, 1, -1) at each point,

give ``(u1, u2, v)_l = G_l q_l``; the phase is part of ``P``, and ``-G_l^H F_l`` is the modal contact force of Eq. (16).

The wave ``l EO`` has the nodal diameter ``l EO mod N``; its modes are stored for ``d <= N/2`` and conjugated beyond.

Static flexibility transforms with the same ``P``: what the retained modes of a body leave out is

    R_res = D [ sum_bodies P (R - Phi Omega^-2 Phi^H) P^H ] D .
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from bdamper.model.modal_basis import rigid_motions
from bdamper.model.structure import Body, ModalBasis, Model
from bdamper.util import validation
from bdamper.util.errors import ModelError, SettingError, warn
from bdamper.util.formatting import short_repr

RIGID_NAMES = ("TX", "TY", "TZ", "RX", "RY", "RZ")
"""Rigid-body modes of a free body, along and about its own axes: Y along its load, Z along the axis of rotation."""
STATIC = "static shape"
"""First words of the names of coordinates that are none of a mode, but of the static shape of a force or response."""


@dataclass(frozen=True)
class Coordinate:
    """One modal coordinate: mode ``index`` of ``body``, called ``name``."""

    body: str
    index: int
    name: str

    @property
    def is_mode(self) -> bool:
        """Whether it is that of a mode, and of no static shape."""
        return not self.name.startswith(STATIC)


@short_repr
@dataclass(frozen=True)
class HarmonicBasis:
    """All modes that describe one harmonic, over all bodies.

    Parameters
    ----------
    coordinates : tuple of Coordinate
    omega2, damping_ratio : (n_modes,) float
        Modal stiffness (the squared natural frequency of a mass-normalised mode) and damping ratio.
    mass : (n_modes,) float
        Modal mass: 1 for modes of a body; that of the modes left out, which may be 0, for residual modes.
    G : (n_points, 3, n_modes) complex
        Relative motion (u1, u2, v) at the contact points of all interfaces.
    nodal_diameter : int
    drag : (n_modes,) float or 0.0
        Viscous modal damping besides that of the damping ratios.
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
        """(n_modes,) viscous modal damping."""
        return np.asarray(2.0 * self.damping_ratio * np.sqrt(self.omega2 * self.mass) + self.drag)


def body_axes(body: Body) -> NDArray:
    """(3, 3) rows X, Y, Z of the own axes of a free body: Y along its load, Z kept."""
    y = np.array([0.0, 1.0, 0.0]) if body.load is None else np.asarray(body.load.direction, float)
    z = np.array([0.0, 0.0, 1.0])
    x = np.cross(y, z)
    return np.array([x / np.linalg.norm(x), y, z])


def principal_axes(body: Body) -> tuple[NDArray, NDArray]:
    """Principal moments (3,), kg m2, and axes (3, 3) in rows of a free body, in the order of its own X, Y, Z."""
    assert body.inertia is not None
    axes = body_axes(body)
    moments, principal = np.linalg.eigh(body.inertia)
    along = axes @ principal
    order = linear_sum_assignment(-np.abs(along))[1]
    return moments[order], (principal[:, order] * np.sign(along[range(3), order])).T


def standard_rigid_modes(model: Model, body: Body) -> Body:
    """The same free body with its rigid-body modes turned into translations along and rotations about its own axes.

    Rotations are about the principal axes of inertia nearest to X, Y, Z, through the centre of mass, so that the six
    modes stay mass-normalised and orthogonal.
    """
    assert body.mass is not None and body.centre is not None
    moments, turn = principal_axes(body)
    basis = body.bases[0]
    points = np.concatenate([model.interfaces[name].points for name, _ in body.ports])
    frames = np.concatenate([model.interfaces[name].frame for name, _ in body.ports])
    own, turning = body_axes(body) / np.sqrt(body.mass), turn / np.sqrt(moments)[:, None]
    motion = rigid_motions(points, body.centre, own, turning).reshape(-1, 3, 6)
    # two products that round in their own ways, as in earlier versions: folds feel the last digit
    rigid = np.concatenate([frames @ motion[..., :3], np.einsum("pij,pjk->pik", frames, motion[..., 3:])], axis=2)
    # the stored modes span the same space: old @ change = new
    change = np.linalg.lstsq(basis.contact_modes[..., :6].real.reshape(-1, 6), rigid.reshape(-1, 6), rcond=None)[0]
    modes = basis.contact_modes.copy()
    modes[..., :6] = rigid
    locations = {name: np.concatenate([m[:, :6] @ change, m[:, 6:]], axis=1) for name, m in basis.locations.items()}
    load = body.load
    if load is not None:
        generalised = load.generalised.copy()
        generalised[:6] = change.T @ load.generalised[:6]
        load = replace(load, generalised=generalised)
    return replace(body, bases={0: replace(basis, contact_modes=modes, locations=locations)}, load=load)


@short_repr
@dataclass(frozen=True)
class Coupling:
    """A model with a choice of modes and interfaces, ready to give the matrices of any harmonic.

    Parameters
    ----------
    model : Model
    interfaces : tuple of str
        Interfaces that take part, in the order of the stacked contact points.
    modes : mapping of body name to (n,) int
        Retained modes of each body.
    engine_order : int
    fundamental_modes_only : bool
        Use the modes of the fundamental's nodal diameter for every harmonic, as the paper does.
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
        """(n_points,) name of the interface of each contact point."""
        return tuple(name for name in self.interfaces for _ in range(self.model.interfaces[name].n_points))

    def rows(self, interface: str) -> slice:
        """Rows of one interface among the stacked contact points."""
        first = self.interface_of.index(interface)
        return slice(first, first + self.model.interfaces[interface].n_points)

    @property
    def friction_faces(self) -> tuple[str, ...]:
        """The interfaces with friction."""
        return tuple(name for name in self.interfaces if self.model.interfaces[name].kind == "friction")

    @property
    def friction_rows(self) -> NDArray:
        """(n,) int: their points among the stacked ones."""
        numbers = np.arange(self.n_points)
        return np.concatenate([np.zeros(0, int), *(numbers[self.rows(name)] for name in self.friction_faces)])

    @property
    def spring_points(self) -> NDArray:
        """(n_points,) bool: linear springs that are a part of the bodies."""
        faces = [self.model.interfaces[name] for name in self.interfaces]
        return np.repeat([face.kind == "spring" for face in faces], [face.n_points for face in faces])

    def _moving(self, harmonic: int) -> Iterator[tuple[Body, ModalBasis, NDArray]]:
        """Bodies that move, each with its basis of a harmonic and its retained modes."""
        for body in self.model.bodies.values():
            if body.kind != "ground":
                yield body, self._basis(body, harmonic), np.asarray(self.modes[body.name])

    def _nodal_diameter(self, harmonic: int) -> tuple[int, bool]:
        return self.model.folded_nodal_diameter(self.engine_order * (1 if self.fundamental_modes_only else harmonic))

    def _basis(self, body: Body, harmonic: int) -> ModalBasis:
        if body.kind == "free":
            return body.bases[0]
        d, conjugate = self._nodal_diameter(harmonic)
        if d not in body.bases:
            raise SettingError(
                f"body '{body.name}': harmonic {harmonic} of engine order {self.engine_order} needs nodal diameter "
                f"{d}, the model has {sorted(body.bases)}; set engine_order, or use fewer harmonics, or "
                "fundamental_modes_only=True to describe every harmonic by the modes of the first"
            )
        return body.bases[d].conjugate() if conjugate else body.bases[d]

    def placed(self, body: Body, array: NDArray, harmonic: int, sectors: Collection[int] = (-1, 0, 1)) -> NDArray:
        """(n_points, 3, n) relative motion of all contact points by the motion ``array`` of the ports of a body.

        ``sectors`` are those in which the ports lie that count.
        """
        phase = 2.0 * np.pi * self.engine_order * harmonic / self.model.n_blades
        out = np.zeros((self.n_points, 3, array.shape[2]), complex)
        for name, side in body.ports:
            face = self.model.interfaces[name]
            sector, sense = (face.sector_a, -1.0) if side == "a" else (face.sector_b, 1.0)
            if name in self.interfaces and sector in sectors:
                own = array[self.model.port_slice(body.name, (name, side))]
                out[self.rows(name)] += np.exp(1j * phase * sector) * (sense * own)
        out[:, 2] *= -1.0
        return out

    def basis(self, harmonic: int) -> HarmonicBasis:
        """Modes, stiffness and relative motion of one harmonic.

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
            if harmonic == 0:  # the mean is real; with a single basis the real part of the modes describes it
                placed = placed.real.astype(complex)
            G.append(placed)
            omega2.append(basis.omega2[keep])
            damping.append(basis.damping_ratio[keep])
            drag.append(np.zeros(len(keep)) if basis.drag is None else basis.drag[keep])
            coordinates += [Coordinate(body.name, int(i), _mode_name(body, int(i))) for i in keep]
        stiffness = np.concatenate(omega2)
        return HarmonicBasis(
            tuple(coordinates),
            stiffness,
            np.concatenate(damping),
            np.concatenate(G, axis=2),
            diameter,
            np.ones_like(stiffness),
            np.concatenate(drag),
        )

    def no_basis(self) -> HarmonicBasis:
        """Basis without modes, for a harmonic that is left out."""
        empty = np.zeros(0)
        return HarmonicBasis((), empty, empty, np.zeros((self.n_points, 3, 0), complex), 0, empty)

    def location_modes(self, location: str, harmonic: int) -> NDArray:
        """(3, n_modes) motion along X, Y, Z of a named location by the modal coordinates of one harmonic.

        Of a field of forces its rows; of "mode 1" the coordinate of that mode of the constrained body, in the first row.
        """
        if location not in self.model.locations:
            wanted = [(b.kind, f"mode {i + 1}") for b, _, keep in self._moving(harmonic) for i in keep]
            return np.outer([1.0, 0.0, 0.0], [own == ("constrained", location) for own in wanted])
        place = self.model.locations[location]
        columns = [
            basis.locations[location][:, keep] if body.name == place.body else np.zeros((3, len(keep)))
            for body, basis, keep in self._moving(harmonic)
        ]
        return np.concatenate(columns, axis=1)

    def residual_flexibility(self, harmonic: int) -> NDArray:
        """(3 n_points, 3 n_points) Hermitian flexibility that the retained modes leave out, for (u1, u2, v), m/N.

        Raises
        ------
        ModelError
            If no body of the model carries its static flexibility at this nodal diameter.
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
                    "the model does not have; give contact_stiffness as numbers instead"
                )
            keep = keep[basis.omega2[keep] > 0.0]
            modes = basis.contact_modes[..., keep].reshape(basis.flexibility.shape[0], len(keep))
            residual = basis.flexibility - (modes / basis.omega2[keep]) @ modes.conj().T
            m = residual.shape[0] // 3
            half = self.placed(body, residual.reshape(m, 3, 3 * m), harmonic).reshape(n, 3 * m)
            out += self.placed(body, half.conj().T.reshape(m, 3, n), harmonic).reshape(n, n).conj().T
        return 0.5 * (out + out.conj().T)

    def left_out_modes(self, harmonic: int) -> tuple[NDArray, NDArray, NDArray]:
        """Elastic modes that the model has but the coupling does not retain.

        Returns
        -------
        G : (3 n_points, n) complex
            Relative motion.
        omega2, damping_ratio : (n,) float
        """
        G, omega2, ratio = [], [], []
        for body, basis, keep in self._moving(harmonic):
            rest = np.setdiff1d(np.flatnonzero(basis.omega2 > 0.0), keep)
            placed = self.placed(body, basis.contact_modes[..., rest], harmonic)
            G.append(placed.reshape(3 * self.n_points, len(rest)))
            omega2.append(basis.omega2[rest])
            ratio.append(basis.damping_ratio[rest])
        return np.concatenate(G, axis=1), np.concatenate(omega2), np.concatenate(ratio)

    def constant_force(self) -> NDArray:
        """(n_modes,) modal static force that does not scale with the load."""
        forces = [
            np.zeros(len(keep)) if body.constant_force is None else body.constant_force[keep]
            for body, _, keep in self._moving(0)
        ]
        return np.concatenate(forces)

    def load(self, shares: Mapping[str, float] | None = None) -> tuple[NDArray, NDArray]:
        """Modal force (n_modes,) and displacement (n_points, 3) of (u1, u2, v) that the retained elastic modes leave out.

        Parameters
        ----------
        shares : mapping of body name to float, N
            Static load of bodies, none on those without a name here; 1 N on all that carry one by default.
        """
        force = []
        displacement = np.zeros((self.n_points, 3))
        for body, _, keep in self._moving(0):
            share = 1.0 if shares is None else shares.get(body.name, 0.0)
            if body.load is None or share == 0.0:
                force.append(np.zeros(len(keep)))
                continue
            force.append(share * body.load.generalised[keep])
            basis = body.bases[0]
            elastic = keep[basis.omega2[keep] > 0.0]
            rest = body.load.displacement - (
                basis.contact_modes[..., elastic].real @ (body.load.generalised[elastic] / basis.omega2[elastic])
            )
            displacement += share * self.placed(body, rest[..., None], 0)[..., 0].real
        return np.concatenate(force), displacement

    def closing_by_rotation(self) -> NDArray:
        """(n_points, 3) displacement of (u1, u2, v) by rotation (``bdamper.model.rotation.SpinStatic``), per squared
        speed."""
        displacement = np.zeros((self.n_points, 3))
        for body in self.model.bodies.values():
            if body.spin is not None:
                displacement += self.placed(body, body.spin.contact[..., None], 0)[..., 0].real
        return displacement


def centrifugal_arms(model: Model) -> dict[str, float]:
    """Newtons of centrifugal load on each loaded free body per squared rotor speed: mass times radius (kg m).

    Raises
    ------
    SettingError
        If one of them lies on the axis.
    """
    loaded = {b.name: b for b in model.bodies.values() if b.kind == "free" and b.load is not None}
    arms = {name: float(b.mass * np.hypot(*b.centre[:2])) for name, b in loaded.items()}  # type: ignore[index]
    found = ", ".join(f"{arm:.6g} kg m of '{name}'" for name, arm in arms.items())
    validation.check(min(arms.values(), default=1.0) > 0.0, "rotor speed", "loaded free bodies off the axis", found)
    return arms


def centrifugal_load(model: Model) -> float:
    """Newtons on the first loaded free body per squared rotor speed (kg m), which the preload stands for at a speed.

    Raises
    ------
    SettingError
        If no free body carries a load, or one lies on the axis.
    """
    arms = centrifugal_arms(model)
    validation.check(arms, "rotor speed", "a free body off the axis that carries a load", "none")
    return next(iter(arms.values()))


def _mode_name(body: Body, index: int) -> str:
    if body.kind == "free":
        return RIGID_NAMES[index] if index < 6 else f"elastic {index - 5}"
    natural = body.bases[0].n_natural
    return f"mode {index + 1}" if index < natural else f"{STATIC} {index - natural + 1}"


def retained_modes(
    model: Model, blade_modes: int, damper_modes: Mapping[str, int], rigid: Sequence[str] = RIGID_NAMES
) -> dict[str, NDArray]:
    """Indices of the retained modes of each body.

    Parameters
    ----------
    blade_modes : int
        Modes of each constrained body.
    damper_modes : mapping of body name to int
        Elastic modes of each free body, besides its rigid-body modes.
    rigid : sequence of str
        Rigid-body modes of free bodies that take part, from :data:`RIGID_NAMES`.
    """
    unknown = [name for name in rigid if name not in RIGID_NAMES]
    validation.check(not unknown, "rigid-body modes", f"names out of {RIGID_NAMES}", unknown)
    out = {}
    for body in model.bodies.values():
        if body.kind == "constrained":
            have = min(basis.n_natural for basis in body.bases.values())
            validation.check(1 <= blade_modes <= have, "blade_modes", f"1 to {have} (body '{body.name}')", blade_modes)
            out[body.name] = np.arange(blade_modes)
        elif body.kind == "free":
            have, own = body.bases[0].n_modes - 6, damper_modes[body.name]
            validation.check(0 <= own <= have, "damper_modes", f"0 to {have} (body '{body.name}')", own)
            keep = [RIGID_NAMES.index(name) for name in RIGID_NAMES if name in rigid]
            out[body.name] = np.array(keep + list(range(6, 6 + own)), int)
        elif body.kind == "lumped":
            out[body.name] = np.arange(body.bases[0].n_modes)
    return out


def damper_drag(
    model: Model, basis: HarmonicBasis, springs: NDArray, ratio: Mapping[str, float], drag: Mapping[str, float]
) -> dict[Coordinate, float]:
    """Viscous modal damping of the coordinates of free bodies, rad/s.

    Parameters
    ----------
    model : Model
    basis : HarmonicBasis
        Of the mean; coordinates without inertia give way to the springs.
    springs : (n_points, 3) float, N/m
        Stuck contacts against which the bodies move, none where 0.
    ratio : mapping of body name to float
        Damping ratio of each motion by itself.
    drag : mapping of body name to float, N s/m
        On the translation of a body, in proportion to mass on its other motions.
    """
    held = springs.ravel() > 0.0
    G = basis.G.real.reshape(-1, basis.n_modes)[held]
    free = {i: c for i, c in enumerate(basis.coordinates) if c.body in model.bodies and model.bodies[c.body].kind == "free"}
    yielding = [i for i, c in enumerate(basis.coordinates) if c.body not in model.bodies]
    flexibility = np.diag(1.0 / springs.ravel()[held]) + G[:, yielding] / basis.omega2[yielding] @ G[:, yielding].T
    own = G[:, list(free)]
    frequency = np.sqrt((own * np.linalg.solve(flexibility, own)).sum(axis=0) + basis.omega2[list(free)])
    masses = {c: (w, model.bodies[c.body].mass) for c, w in zip(free.values(), frequency)}
    rates = {c: float(2.0 * ratio[c.body] * w + drag[c.body] / m) for c, (w, m) in masses.items() if m is not None}
    omega, rate = float(np.sqrt(basis.omega2[basis.omega2 > 0.0].min(initial=np.inf))), max(rates.values(), default=0.0)
    if rate > omega:
        warn(
            f"damping of the damper: a rate of up to {rate:.3g} 1/s beside omega = {omega:.3g} rad/s of the lowest mode "
            "drags every motion of the damper against the rotor"
        )
    return rates


def in_flow(basis: HarmonicBasis, model: Model, flow: Mapping[int, complex], wave: int) -> HarmonicBasis:
    """Modes of constrained bodies in a flow: stiffness ``2 Re z omega^2`` and damping ``2 Im z omega`` besides their own.

    Parameters
    ----------
    basis : HarmonicBasis
    model : Model
    flow : mapping of wave (0 to n_blades - 1) to complex
        Relative shift of the frequency and damping ratio.
    wave : int
        Nodal diameters of the harmonic, any multiple of the engine order.

    Raises
    ------
    SettingError
        If a mode is left without damping, or without stiffness.
    """
    z: Any = flow.get(wave % model.n_blades, 0.0)
    held = [name for name, body in model.bodies.items() if body.kind == "constrained"]
    z = z * np.array([coordinate.body in held for coordinate in basis.coordinates])
    drag = basis.damping + 2.0 * np.imag(z) * np.sqrt(basis.omega2)
    expected = "modes with damping and stiffness left; study.flutter finds the limit cycles of others"
    good = (drag >= 0.0).all() and (np.real(z) > -0.5).all()
    validation.check(good, f"aerodynamic_damping at nodal diameter {wave % model.n_blades}", expected, "some without")
    none = np.zeros_like(basis.damping_ratio)
    return replace(basis, omega2=basis.omega2 * (1.0 + 2.0 * np.real(z)), damping_ratio=none, drag=drag)
