"""Structure: bodies, their modes, and the interfaces with contact (paper, section 2.1).

A *body* is constrained (a blade with its disk sector), free (a damper: six rigid-body modes, then
elastic modes), a ring (one sector of a free body that runs around the axis), lumped (masses with
all their modes) or the ground (rigid).  Its motion is a modal superposition with one modal basis
for each nodal diameter ``d``.  Free bodies and acyclic structures (``n_blades = 1``) have ``d = 0``
only.  A ring has rigid-body modes at ``d = 0`` (along and about the axis) and ``d = 1`` (across the
axis, and tilting).  A split ring also has a radial rigid-body mode at ``d = 0``, because its gap
leaves no hoop force.

An *interface* is a set of contact points between ``body_a`` and ``body_b``.  The side of a body at
an interface is a *port*, the pair ``(interface name, side)`` with side ``"a"`` or ``"b"``.  A body
in contact with the same body of the neighbouring sector (a shroud) has both ports.  The axes at a
contact point are the rows ``t1, t2, n`` of ``frame``, right-handed, ``n`` the outward normal of
``body_a``.

Conventions (SI units, radians):

* Time factor ``exp(+i omega t)``.  Sectors are numbered toward +X, the blade points along +Y, the
  axis of rotation is Z.
* Travelling wave of nodal diameter ``d``: ``u(k+1) = R u(k) exp(+2 pi i d/N)``.  ``R`` rotates
  sector ``k`` onto sector ``k+1``, about Z by ``-2 pi/N`` (from +Y toward +X).
* Modes are mass-normalised over one sector, ``u^H M u = 1``.  Components at a port are along the
  contact axes, rotated into the sector of the body.  They contain no phase;
  :mod:`bdamper.model.kinematics` adds the phase of the neighbour.

Stress at chosen points is linear in the modal coordinates ``q_l`` and the contact forces ``F_l``,
complex amplitudes of harmonic ``l``,

    sigma(theta) = Omega^2 sigma_1 + S_0 q_0 + A_0 F_0
                   + sum_(l>=1) Re[(S_l q_l + A_l F_l) exp(i l theta)],

with the modal stress ``S = C B Phi`` and the stress ``A = C B (K^-1 P^H - Phi Omega^-2 Phi^H P^H)``
of unit contact forces without the contribution of the modes.  Without ``A``, ten modes
underestimate the stress at the root of a blade with a stuck damper by a third.
"""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import Annotated, Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from bdamper.model.modal_basis import LocalBasis, SpeedBasis, SpinStatic
from bdamper.model.modal_basis import ModalBasis as ModalBasis
from bdamper.util import validation
from bdamper.util.display import Plottable, draw
from bdamper.util.formatting import counted, short_repr
from bdamper.util.records import Data, GroupName, Record
from bdamper.util.storage import FilePath

# ---- Stress ----

COMPONENTS = ("xx", "yy", "zz", "xy", "yz", "xz")
"""Order of the stress components, along the axes of the body."""


@short_repr
@dataclass(frozen=True)
class StressSet(Record):
    """Stress at some points of a constrained body.

    Parameters
    ----------
    name, body : str
    points : (n, 3) float, m
        Positions in the axes of the reference sector.
    modes : mapping of nodal diameter to (n, 6, n_modes) complex or float, Pa m^-1 kg^-1/2
        Stress of each mode of the body, components in the order of :data:`COMPONENTS`.
    contact : mapping of nodal diameter to (n, 6, 3 n_points) complex or float, Pa/N
        Stress under unit forces along t1, t2, n on the body at all its contact points, in the order
        of ``Body.ports``, without the contribution of the modes.  Empty for a body without contact.
    static : (n, 6) float, Pa s2, optional
        Stress under the centrifugal load without dampers, per squared speed of rotation in rad/s.
    spread : (n,) float, optional
        Discretisation error indicator: von Mises stress of the first mode, largest difference
        between adjacent elements relative to their mean.
    near_contact : (n,) bool, optional
        Points on or next to a contact face.  Their stress depends on the patches, so margins
        exclude them.
    nodes : (n,) int, optional
        Node numbers of the points in the finite element model.
    source : str
    """

    name: GroupName
    body: str
    points: Annotated[NDArray, Data("m", ("n", 3))]
    modes: Annotated[
        Mapping[int, NDArray], Data("Pa m^-1 kg^-1/2", ("n", 6, None), "field", "*/mode_stress")
    ]
    contact: Annotated[
        Mapping[int, NDArray], Data("Pa/N", ("n", 6, "n_forces"), "field", "*/contact_stress")
    ] = field(default_factory=dict)
    static: Annotated[NDArray, Data("Pa s2", ("n", 6), file="static_stress")] | None = None
    spread: Annotated[NDArray, Data("1", ("n",))] | None = None
    near_contact: Annotated[NDArray, Data("1", ("n",), "bool")] | None = None
    nodes: Annotated[NDArray, Data("1", ("n",), "integer")] | None = None
    source: str = ""

    def __len__(self) -> int:
        return len(self.points)

    @property
    def point_names(self) -> tuple[str, ...]:
        """Name of each point: the set with the node number, or without nodes with the position."""
        if self.nodes is None:
            return tuple(f"{self.name} point {position}" for position in range(1, len(self) + 1))
        return tuple(f"{self.name} node {node}" for node in self.nodes)

    @property
    def counted(self) -> NDArray:
        """Whether margins include each point, (n,) bool; points near contact faces are excluded."""
        if self.near_contact is None:
            return np.ones(len(self), bool)
        return ~self.near_contact


# ---- Bodies and interfaces ----

Port = tuple[str, str]
"""Side of a body at an interface: ``(interface name, "a" | "b")``."""


def turn(angle: float) -> NDArray:
    """Return the rotation matrix (3, 3) about Z from +Y toward +X by ``angle`` (rad).

    ``2 pi/N`` gives R of one pitch.
    """
    c = np.cos(angle)
    s = np.sin(angle)
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


@short_repr
@dataclass(frozen=True)
class BodyLoad(Record):
    """Static load proportional to one number, the radial (centrifugal) load in newtons.

    Parameters
    ----------
    direction : (3,) float
        Unit vector of the resultant.
    generalised : (n_modes,) float, kg^-1/2
        Modal force per newton of the resultant, rigid-body modes first.
    displacement : (n_points, 3) float, m/N
        Elastic displacement of the contact points per newton along t1, t2, n (inertia relief,
        without contact).
    """

    direction: Annotated[NDArray, Data("1", (3,))]
    generalised: Annotated[NDArray, Data("kg^-1/2", ("n_static",))]
    displacement: Annotated[NDArray, Data("m/N", ("n_points", 3))]


@short_repr
@dataclass(frozen=True)
class Body(Record):
    """Structure with modes, or the ground.

    Parameters
    ----------
    name : str
    kind : {"constrained", "free", "ring", "lumped", "ground"}
    ports : tuple of Port
        Order of the contact points in every array of this body.
    bases : mapping of nodal diameter to ModalBasis
        Nodal diameters from 0 to ``n_blades // 2``; empty for the ground.
    mass, centre, inertia : float, (3,) float, (3, 3) float; kg, m, kg m2, optional
        Mass, centre of mass, and inertia about the centre of mass, of a free body or of one sector
        of a ring.
    load : BodyLoad, optional
    constant_force : (n_modes,) float, N kg^-1/2, optional
        Modal static force independent of the load, for a body without static flexibility.
    local : LocalBasis, optional
        Blade and disk matrices of a constrained body, for mistuned bladed disks.
    spin : SpinStatic, optional
        Static displacement due to the rotation of the body.
    """

    name: GroupName
    kind: Literal["constrained", "free", "ring", "lumped", "ground"]
    ports: Annotated[tuple[Port, ...], Data(derived=True)] = ()
    bases: Annotated[Mapping[int, ModalBasis], Data(file="*")] = field(default_factory=dict)
    mass: Annotated[float, Data("kg", limits=validation.Limits(above=0.0))] | None = None
    centre: Annotated[NDArray, Data("m", (3,))] | None = None
    inertia: Annotated[NDArray, Data("kg m2", (3, 3), matrix="symmetric")] | None = None
    load: BodyLoad | None = None
    constant_force: Annotated[NDArray, Data("N kg^-1/2", ("n_static",))] | None = None
    local: Annotated[LocalBasis, Data(file="wheel")] | None = None
    spin: SpinStatic | None = None

    @property
    def n_rigid(self) -> int:
        """Number of rigid-body modes at nodal diameter 0, which come first."""
        if self.kind == "ring":
            return int((self.bases[0].omega2 == 0.0).sum())
        return 6 if self.kind == "free" else 0

    @property
    def n_elastic(self) -> int:
        """Largest value of ``damper_modes`` for a free body or a ring: number of modes minus six."""
        return min(basis.n_natural for basis in self.bases.values()) - 6

    @property
    def is_free(self) -> bool:
        """Whether contacts alone hold the body: a damper or a ring."""
        return self.kind in ("free", "ring")

    @property
    def damping_text(self) -> str:
        """Modal damping ratio of the elastic modes at all nodal diameters, or its range.

        The text is empty without such modes.
        """
        natural = [np.empty(0)]
        has_drag = False
        for basis in self.bases.values():
            natural.append(basis.damping_ratio[self.n_rigid : basis.n_natural])
            has_drag |= basis.drag is not None and bool(np.any(basis.drag))
        ratio = np.concatenate(natural)
        if has_drag and not ratio.any():
            return "damping matrix"
        if not len(ratio):
            return ""
        low = f"{ratio.min():.3g}"
        high = f"{ratio.max():.3g}"
        text = low if low == high else f"{low} to {high}"
        return f"{text} and damping matrix" if has_drag else text

    @property
    def radius(self) -> float:
        """Distance (m) of the centre of mass from the axis of rotation; NaN if unknown."""
        if self.centre is None:
            return np.nan
        return float(np.hypot(*self.centre[:2]))


@short_repr
@dataclass(frozen=True)
class Interface(Record):
    """Contact points between two bodies.

    Parameters
    ----------
    name : str
    kind : {"friction", "constraint", "cubic", "spring"}
        A constraint is frictionless and transmits compression only.  A cubic interface has springs
        ``k u^3`` along t1 and t2.  A spring is linear in all directions and part of the bodies,
        also without contact.
    body_a, body_b : str
    sector_a, sector_b : int
        Sector of each side relative to the reference sector: 0 or ±1.
    points : (n_points, 3) float, m
        Positions in the axes of the reference sector.
    area : (n_points,) float, m2
    frame : (n_points, 3, 3) float
        Rows t1, t2, n, right-handed; n is the outward normal of ``body_a``.
    gap : (n_points,) float, m
        Initial normal distance of the surfaces, 0 at contact without pressure.
    """

    name: GroupName
    kind: Literal["friction", "constraint", "cubic", "spring"]
    body_a: str
    sector_a: int
    body_b: str
    sector_b: int
    points: Annotated[NDArray, Data("m", ("n_points", 3))]
    area: Annotated[NDArray, Data("m2", ("n_points",), limits=validation.Limits(above=0.0))]
    frame: Annotated[NDArray, Data("1", ("n_points", 3, 3))]
    gap: Annotated[NDArray, Data("m", ("n_points",))]

    @property
    def n_points(self) -> int:
        return len(self.area)


@dataclass(frozen=True)
class Location(Record):
    """Named position on a body for forces and responses.

    Parameters
    ----------
    name, body : str
    position : (3,) float, m
    kind : {"forces", "base"}, optional
        "forces" is a field of nodal forces.  The rows of its real and imaginary part replace the
        motion along X and Y, zeros the motion along Z.  The position is the mean of the nodes,
        weighted by the size of their forces.  "base" is the rigid translation of all fixed nodes.
        Its rows are the modal inertia forces under unit accelerations along X, Y and Z, in the
        motion relative to these nodes.
    """

    name: GroupName
    body: str
    position: Annotated[NDArray, Data("m", (3,))]
    kind: Literal["forces", "base"] | None = None


@short_repr
@dataclass(frozen=True)
class ContactStiffness(Record):
    """Stiffness at the contact points of one interface.

    Parameters
    ----------
    stiffness : (n_points, 3) float, N/m
        Along t1, t2, n.
    source : str
        Method: "cigeroglu2009", "unit_traction", "residual_modes" or "user".
    fallback : (n_points, 3) bool, optional
        Points and directions with a fallback value, because the method did not apply.
    """

    stiffness: Annotated[NDArray, Data("N/m", ("n_points", 3), limits=validation.Limits(least=0.0))]
    source: Literal["cigeroglu2009", "unit_traction", "residual_modes", "user"]
    fallback: Annotated[NDArray, Data("1", ("n_points", 3), "bool")] | None = None


@short_repr
@dataclass(frozen=True)
class StaticContact(Record):
    """Static contact solution of the full finite element model at one interface.

    It serves Eqs. (4) and (10) of the paper.

    Parameters
    ----------
    force : (n_points, 3) float, N
        Contact force on ``body_a`` per unit total load, along t1, t2, n.
    displacement_a, displacement_b : (n_points, 3) float, m
        Displacement of each side per unit total load, along t1, t2, n.
    """

    force: Annotated[NDArray, Data("N", ("n_points", 3))]
    displacement_a: Annotated[NDArray, Data("m", ("n_points", 3))]
    displacement_b: Annotated[NDArray, Data("m", ("n_points", 3))]


@short_repr
@dataclass(frozen=True)
class SurfaceMesh(Record):
    """Surface of a body for plots.

    Parameters
    ----------
    points : (n_nodes, 3) float, m
    quads : (n_faces, 4) int
    modes : mapping of nodal diameter to (n_nodes, 3, n_modes) complex or float, kg^-1/2
        First modes of the body at these nodes along X, Y, Z.
    """

    points: Annotated[NDArray, Data("m", ("n_nodes", 3))]
    quads: Annotated[NDArray, Data("1", (None, 4), "integer")]
    modes: Annotated[Mapping[int, NDArray], Data("kg^-1/2", ("n_nodes", 3, None), "picture")] = (
        field(default_factory=dict)
    )


@short_repr
@dataclass(frozen=True)
class Model(Plottable, Record):
    """Structure with all the data that an analysis needs, except loads and settings.

    ``bdamper.model.structure`` describes the conventions.  ``plot`` draws bodies and contact points
    in 3-D (:func:`bdamper.plot.plot_model`).

    Parameters
    ----------
    n_blades : int
        Number of sectors; 1 for an acyclic structure.
    bodies : mapping of name to Body
    interfaces : mapping of name to Interface
    locations : mapping of name to Location
    contact : mapping of interface name to ContactStiffness
    static : mapping of interface name to StaticContact
    meshes : mapping of body name to SurfaceMesh
    provenance : mapping of str to str
    stress : mapping of name to StressSet
    slip_resolution : float, m, optional
        Amplitude of the contact motion below which the friction of a joint is inaccurate, because
        its sliders do not resolve smaller slip.
    partial_contact : bool, optional
        Whether the default contact stiffness includes the force vectors of faces that touch at one
        end.  An import sets it if the vectors of bonded faces alone are too stiff for them.
    """

    n_blades: int
    bodies: Mapping[str, Body]
    interfaces: Mapping[str, Interface]
    locations: Mapping[str, Location] = field(default_factory=dict)
    contact: Mapping[str, ContactStiffness] = field(default_factory=dict)
    static: Mapping[str, StaticContact] = field(default_factory=dict)
    meshes: Annotated[Mapping[str, SurfaceMesh], Data(file="mesh/*")] = field(default_factory=dict)
    provenance: Mapping[str, str] = field(default_factory=dict)
    stress: Mapping[str, StressSet] = field(default_factory=dict)
    slip_resolution: Annotated[float | None, Data(limits=validation.Limits(above=0.0))] = None
    partial_contact: bool | None = None

    def __str__(self) -> str:
        sectors = f"{self.n_blades} sectors" if self.n_blades > 1 else "no sectors"
        lines = [
            f"model with {sectors}, hash {self.hash}, locations {', '.join(self.locations) or 'none'}"
        ]
        for body in self.bodies.values():
            text = f"  {body.name}: {body.kind}"
            if body.bases:
                text += f", {min(basis.n_natural for basis in body.bases.values())} modes"
            if body.kind in ("constrained", "ring"):
                text += f" at nodal diameters {', '.join(map(str, sorted(body.bases)))}"
            if body.mass is not None:
                text += f", {self.mass_text(body.name)}"
            if body.damping_text:
                text += f", modal damping ratio {body.damping_text}"
            lines.append(text)
        for face in self.interfaces.values():
            text = f"  {face.name}: {face.kind}, {face.body_a} on {face.body_b}, "
            text += counted(face.n_points, "contact point")
            if np.any(face.gap > 0.0):
                text += f", gap up to {1e6 * face.gap.max():.3g} µm"
            lines.append(text)
        if self.partial_contact:
            lines.append("  default contact stiffness: ResidualModes(partial_contact=True)")
        return "\n".join(lines)

    def mass_text(self, name: str) -> str:
        """Return the mass of a free body, with the radius of its centre of mass if it rotates."""
        body = self.bodies[name]
        text = f"{body.mass:.4g} kg"
        if body.kind == "ring":
            text += " per sector"
        if self.n_blades > 1 and np.isfinite(body.radius):
            text += f" at a radius of {body.radius:.4g} m"
        return text

    @property
    def masses_text(self) -> str:
        """Mass and radius of each free body, preceded by its name if there are several."""
        texts = {}
        for name, body in self.bodies.items():
            if body.is_free and body.mass is not None:
                texts[name] = self.mass_text(name)
        if len(texts) == 1:
            return next(iter(texts.values()))
        return ", ".join(f"{name} {text}" for name, text in texts.items())

    def port_slice(self, body: str, port: Port) -> slice:
        """Return the rows of ``port`` among the stacked contact points of ``body``."""
        ports = self.bodies[body].ports
        start = 0
        for interface, side in ports:
            n = self.interfaces[interface].n_points
            if (interface, side) == port:
                return slice(start, start + n)
            start += n
        raise KeyError(f"body '{body}' has no port {port}; it has {list(ports)}")

    def plot_mode(self, mode: int = 1, path: FilePath | None = None, **options: Any) -> Any:
        """Draw a mode of a blade in 3-D, numbered from 1 (:func:`bdamper.plot.plot_mode`)."""
        return draw(self, "figure", "plot_mode", path, mode, **options)

    def folded_nodal_diameter(self, harmonic_order: int) -> tuple[int, bool]:
        """Return the nodal diameter of a wave, and whether its basis is the complex conjugate.

        The waves ``d`` and ``N - d`` are complex conjugates of each other, so the model contains
        ``d <= N/2`` only.
        """
        d = harmonic_order % self.n_blades
        if 2 * d > self.n_blades:
            return self.n_blades - d, True
        return d, False

    def at_speed(self, omega: float) -> Model:
        """Return the structure with the modes and the flexibility at a rotor speed (rad/s).

        Each mode keeps the position, phase and damping ratio of the mode of this model with the
        highest correlation.  The stress of modes changes with them.  Bases without speed-dependent
        data do not change (see :meth:`neglected_over_speed`); surface meshes, contact stiffness and
        static solutions never change.  The local basis of a mistuned bladed disk is valid at one
        speed and is removed.  ``at_speed`` of the returned model is possible.

        Raises
        ------
        SettingError
            If the speed is negative, or the structure is unstable at this speed.
        """
        omega = validation.number("rotor speed", omega, least=0.0, unit="rad/s")
        bodies = {}
        stress = dict(self.stress)
        for name, body in self.bodies.items():
            bases = {}
            shapes = {}
            for d, basis in body.bases.items():
                bases[d], shapes[d] = basis.at_speed(omega)
            force = body.constant_force
            if force is not None:
                force = np.real(shapes[0].conj().T @ force)
            unchanged = all(bases[d] is basis for d, basis in body.bases.items())
            bodies[name] = replace(
                body,
                bases=bases,
                constant_force=force,
                local=body.local if unchanged else None,
            )
            for key, points in stress.items():
                if points.body == name:
                    modes = {d: of_modes @ shapes[d] for d, of_modes in points.modes.items()}
                    stress[key] = replace(points, modes=modes)
        provenance = {**self.provenance, "rotor speed": f"{omega:.9g} rad/s"}
        return replace(self, bodies=bodies, stress=stress, provenance=provenance)

    def neglected_over_speed(self, diameters: Collection[int] | None = None) -> tuple[str, ...]:
        """Return the effects of rotor speed that the model neglects, one sentence for each body.

        Free bodies neglect nothing, because their rigid-body modes do not depend on speed.

        Parameters
        ----------
        diameters : collection of int, optional
            Relevant nodal diameters, all by default.
        """
        sentences = []
        for body in self.bodies.values():
            if body.kind == "free":
                continue
            without = []
            for d, basis in body.bases.items():
                relevant = diameters is None or d in diameters
                if relevant and basis.speed is None:
                    without.append(str(d))
            if without:
                sentences.append(
                    f"{body.name}, nodal diameters {', '.join(without)}: modes of one rotor speed; "
                    "centrifugal stiffening and spin softening are neglected, "
                    "frequencies and flexibility do not change with speed"
                )
        return tuple(sentences)

    @property
    def hash(self) -> str:
        """Hash of all data that influence results; meshes and provenance are excluded."""
        digest = hashlib.sha256()
        for name in ("n_blades", "bodies", "interfaces", "locations", "contact", "static"):
            feed_digest(digest, name, getattr(self, name))
        if self.stress:  # without stress the fingerprint is the same as in earlier versions
            feed_digest(digest, "stress", self.stress)
        if self.partial_contact:  # likewise
            feed_digest(digest, "partial_contact", self.partial_contact)
        return digest.hexdigest()[:16]


class Digest(Protocol):
    """Object with the ``update`` method of a hash."""

    def update(self, data: bytes, /) -> None: ...


LATER_FIELDS = ("constant_force", "drag", "kind", "local", "speed", "spin", "static_shapes")
"""Fields that do not change a fingerprint if they are None, as in earlier versions."""


def feed_digest(digest: Digest, key: str, value: object) -> None:
    """Add a value of a model and its path ``key`` to a digest.

    ``residual0`` is excluded if there is a flexibility: it follows by a matrix product with
    processor-dependent rounding.
    """
    if isinstance(value, np.ndarray):
        digest.update(f"{key}:{value.dtype.str}{value.shape}".encode())
        digest.update(np.ascontiguousarray(value).tobytes())
    elif isinstance(value, Mapping):
        for name in sorted(value):
            feed_digest(digest, f"{key}/{name}", value[name])
    elif is_dataclass(value) and not isinstance(value, type):
        for item in fields(value):
            part = getattr(value, item.name)
            if isinstance(value, StressSet) and item.name == "nodes":
                continue  # only names of points
            if part is None and item.name in LATER_FIELDS:
                continue
            derivable = isinstance(value, ModalBasis) and value.flexibility is not None
            if derivable and isinstance(part, SpeedBasis):
                part = replace(part, residual0=None)
            feed_digest(digest, f"{key}.{item.name}", part)
    else:
        digest.update(f"{key}={value!r};".encode())
