"""Small synthetic models, consistent in themselves, for tests of anything that takes a model.

The geometry is a wedge damper under two platforms: a prism of triangular section, apex outward, faces
inclined by ``alpha`` (left, toward -X) and ``beta`` (right, toward +X) from the radial axis, which is +Y of
the reference sector and passes through the middle of the damper (so the two blades lean by half a sector).
The rigid-body modes of the damper are exact; all elastic modes are smooth random polynomials of the
position, real at nodal diameters 0 and N/2; the flexibility is that of the modes plus a Hermitian positive
definite rest.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.random import default_rng
from numpy.typing import NDArray

from bdamper.model.modal_basis import LocalBasis, SpinStatic
from bdamper.model.structure import (
    Body,
    BodyLoad,
    ContactStiffness,
    Interface,
    Location,
    ModalBasis,
    Model,
    Port,
    StaticContact,
    StressSet,
    SurfaceMesh,
)

RADIUS = 0.30  # radius of the centre of the damper, m
HEIGHT = 0.012  # height of the section of the damper, m
LENGTH = 0.040  # along the axis of rotation, m
DENSITY = 7800.0  # kg/m3
BLADE_OMEGA = 2 * np.pi * np.array([310.0, 690.0, 1240.0, 1850.0, 2570.0, 3400.0, 4300.0, 5300.0])
DAMPER_OMEGA = 2 * np.pi * np.array([9.1e3, 12.7e3, 15.3e3, 18.8e3])
COMPLIANCE = 4e-9  # size of the residual flexibility at a contact point, m/N


def rotation(n_blades: int, sectors: int = 1) -> NDArray:
    """Rotation of sector ``k`` onto sector ``k + sectors``: about Z by ``-2 pi sectors / n_blades``."""
    angle = -2 * np.pi * sectors / n_blades
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def wedge_frames(alpha: float, beta: float) -> dict[str, NDArray]:
    """Rows t1, t2, n of the four planes of a wedge: ``t1 = X_C, t2 = -Z_C, n = Y_C``."""
    sa, ca, sb, cb = np.sin(alpha), np.cos(alpha), np.sin(beta), np.cos(beta)
    planes = {
        "left": [[sa, ca, 0], [-ca, sa, 0], [0, 0, 1]],
        "right": [[sb, -cb, 0], [cb, sb, 0], [0, 0, 1]],
        "front": [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
        "back": [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
    }
    frames = {}
    for name, rows in planes.items():
        x_c, y_c, z_c = np.array(rows, dtype=float)
        frames[name] = np.array([x_c, -z_c, y_c])
    return frames


def wedge_model(
    seed: int = 0,
    n_blades: int = 12,
    engine_order: int = 2,
    n_points: int = 4,
    n_blade_modes: int = 5,
    harmonics: int = 3,
    *,
    alpha: float = np.pi / 4,
    beta: float = np.pi / 4,
    n_damper_modes: int = 2,
) -> Model:
    """A free wedge damper between the blades of sectors 0 and +1, with one-sided axial stops to the ground.

    Bodies "blade", "damper", "ground"; interfaces "left" (blade of sector 0), "right" (blade of sector +1),
    "front", "back" (constraints, 3 points each); location "tip" on the blade.

    Parameters
    ----------
    seed : int
        Of the random mode shapes.
    n_blades, engine_order, harmonics : int
        The blade has bases for nodal diameter 0 and for those excited by the harmonics of the engine order.
    n_points : int
        Contact points on each of the two friction faces.
    n_blade_modes, n_damper_modes : int
        Elastic modes, at most 8 and 4; the damper has six rigid-body modes besides.
    alpha, beta : float, rad
        Inclinations of the left and right face from the radial axis.
    """
    rng = default_rng(seed)
    faces = _wedge_faces(alpha, beta, n_points, ("blade", 0), ("blade", 1))
    tip = Location("tip", "blade", np.array([0.0, RADIUS + 0.15, 0.0]))
    blade = _constrained_body(
        rng,
        "blade",
        n_blades,
        _nodal_diameters(n_blades, engine_order, harmonics),
        (("left", "b"), ("right", "b")),
        faces,
        [tip],
        n_blade_modes,
    )
    damper = _wedge_body(rng, alpha, beta, faces, n_damper_modes)
    bodies = [blade, damper, Body("ground", "ground")]
    return _assemble(n_blades, bodies, faces, [tip], _wedge_mesh(alpha, beta))


def lumped_local(model: Model, own: float, disk: float, tie: float, seed: int = 1) -> LocalBasis:
    """Local basis of the body "blade": unit masses on springs ``own`` (N/m) to unit disk masses, each on a spring ``disk``
    to the ground and on ``tie`` to its neighbours; contact points and "tip" move with the blade's mass.
    """
    n_points = sum(model.interfaces[name].n_points for name, _ in model.bodies["blade"].ports)
    rng = default_rng(seed)
    waves = np.arange(model.n_blades // 2 + 1)
    stiffness = disk + 2.0 * tie * (1.0 - np.cos(2.0 * np.pi * waves / model.n_blades))
    shape = rng.normal(size=(n_points, 3, 1))
    return LocalBasis(
        region="mass",
        omega2=np.array([own]),
        damping_ratio=np.array([1e-3, 2e-3]),
        blade_stiffness=np.diag([own, 0.0]),
        blade_mass=np.ones((2, 2)),
        disk_stiffness=stiffness[:, None, None].astype(complex),
        disk_mass=np.ones((len(waves), 1, 1), complex),
        contact_modes=np.concatenate([shape, shape], axis=2),
        locations={"tip": np.ones((3, 2))},
    )


def ground_model(
    seed: int = 0,
    n_blades: int = 12,
    engine_order: int = 2,
    n_points: int = 4,
    n_blade_modes: int = 5,
    harmonics: int = 3,
) -> Model:
    """A blade that rubs on the ground: bodies "blade", "ground"; interface "pad"; location "tip"."""
    rng = default_rng(seed)
    frame = np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]])
    points = np.array([0.0, RADIUS, 0.0]) + _grid(n_points, 0.02, LENGTH) @ frame[:2]
    faces = [
        _interface(
            "pad", "friction", ("blade", 0), ("ground", 0), points, frame, 0.02 * LENGTH, 0.0
        )
    ]
    tip = Location("tip", "blade", np.array([0.0, RADIUS + 0.15, 0.0]))
    diameters = _nodal_diameters(n_blades, engine_order, harmonics)
    blade = _constrained_body(
        rng, "blade", n_blades, diameters, (("pad", "a"),), faces, [tip], n_blade_modes
    )
    return _assemble(n_blades, [blade, Body("ground", "ground")], faces, [tip])


def shroud_model(
    seed: int = 0,
    n_blades: int = 12,
    engine_order: int = 2,
    n_points: int = 4,
    n_blade_modes: int = 5,
    harmonics: int = 3,
) -> Model:
    """Blades touching their neighbours: "blade" on both sides of interface "shroud"; location "tip"."""
    rng = default_rng(seed)
    half = rotation(2 * n_blades)
    radial, across = half @ [0.0, 1.0, 0.0], half @ [1.0, 0.0, 0.0]
    slant = np.radians(30.0)
    axial = np.array([0.0, 0.0, 1.0])
    normal = np.cos(slant) * across + np.sin(slant) * axial
    frame = np.array([radial, np.cross(normal, radial), normal])
    points = (RADIUS + 0.14) * radial + _grid(n_points, 0.01, LENGTH) @ frame[:2]
    faces = [
        _interface(
            "shroud", "friction", ("blade", 0), ("blade", 1), points, frame, 0.01 * LENGTH, 0.0
        )
    ]
    tip = Location("tip", "blade", np.array([0.0, RADIUS + 0.15, 0.0]))
    diameters = _nodal_diameters(n_blades, engine_order, harmonics)
    ports = (("shroud", "a"), ("shroud", "b"))
    blade = _constrained_body(rng, "blade", n_blades, diameters, ports, faces, [tip], n_blade_modes)
    return _assemble(n_blades, [blade], faces, [tip])


def acyclic_model(
    seed: int = 0,
    n_points: int = 4,
    n_blade_modes: int = 5,
    *,
    alpha: float = np.pi / 4,
    beta: float = np.pi / 4,
    n_damper_modes: int = 2,
) -> Model:
    """A test rig, ``n_blades = 1``: two different blades and a free wedge between them.

    Bodies "left_blade", "right_blade", "damper", "ground"; interfaces "left", "right", "front", "back";
    locations "tip" on the left and "right_tip" on the right blade.
    """
    rng = default_rng(seed)
    faces = _wedge_faces(alpha, beta, n_points, ("left_blade", 0), ("right_blade", 0))
    tips = [
        Location("tip", "left_blade", np.array([-0.04, RADIUS + 0.15, 0.0])),
        Location("right_tip", "right_blade", np.array([0.04, RADIUS + 0.15, 0.0])),
    ]
    blades = [
        _constrained_body(rng, f"{side}_blade", 1, [0], ((side, "b"),), faces, [tip], n_blade_modes)
        for side, tip in zip(("left", "right"), tips)
    ]
    damper = _wedge_body(rng, alpha, beta, faces, n_damper_modes)
    return _assemble(
        1, [*blades, damper, Body("ground", "ground")], faces, tips, _wedge_mesh(alpha, beta)
    )


ALL_MODELS = {
    "wedge": wedge_model,
    "ground": ground_model,
    "shroud": shroud_model,
    "acyclic": acyclic_model,
}


def complete_model() -> Model:
    """A small model in which every optional part is present."""
    small = wedge_model(n_points=1, n_blade_modes=1, harmonics=1, n_damper_modes=1)
    rng = np.random.default_rng(5)
    static = StaticContact(*(rng.standard_normal((1, 3)) for _ in range(3)))
    contact = ContactStiffness(
        np.full((1, 3), 1e7), "cigeroglu2009", np.array([[True, False, True]])
    )
    bases, n_forces = small.bodies["blade"].bases, len(small.bodies["blade"].bases[0].flexibility)
    stress = StressSet(
        name="root",
        body="blade",
        points=rng.standard_normal((2, 3)),
        modes={
            d: rng.standard_normal((2, 6, b.n_modes)) * (1.0 + 1j * (d > 0))
            for d, b in bases.items()
        },
        contact={d: rng.standard_normal((2, 6, n_forces)) for d in bases},
        static=rng.standard_normal((2, 6)),
        spread=np.array([0.1, 0.2]),
        near_contact=np.array([True, False]),
        nodes=np.array([7, 215]),
        source="numbers",
    )
    blade = small.bodies["blade"]
    turning = {
        d: b.with_speed(
            np.diag(3.0 + np.arange(b.n_modes)), 1e-18 * np.eye(n_forces), 50.0 * (d > 0), source="numbers",
            coriolis=np.zeros((b.n_modes, b.n_modes)), checked_at=600.0, error=1e-5,
        )
        for d, b in bases.items()
    }  # fmt: skip
    own = turning[0].speed
    turning[0] = replace(turning[0], speed=replace(own, stiffness0=own.stiffness0 * (1.0 + 1e-12)))
    places = {name: rng.standard_normal(3) for name in bases[0].locations}
    spin = SpinStatic(rng.standard_normal((n_forces // 3, 3)), places, "stiffened", 50.0)
    # on a stiff disk, a little above the frequencies of the modes
    own = 1.08 * bases[0].omega2[0]
    local = lumped_local(small, own, 100.0 * own, own)
    shape = local.contact_modes[..., 0].ravel()
    local = replace(local, flexibility=2.0 / own * np.outer(shape, shape))
    return replace(
        small,
        bodies={**small.bodies, "blade": replace(blade, bases=turning, spin=spin, local=local)},
        stress={"root": stress},
        static={"right": static, "left": static},
        contact={"left": contact},
        provenance={"program": "none", "note": "Fläche\nm² ", "empty": ""},
    )


# -----------------------------------------------------------------------------------------------------------
# Parts


def _assemble(
    n_blades: int,
    bodies: list[Body],
    faces: list[Interface],
    locations: list[Location],
    meshes: dict[str, SurfaceMesh] | None = None,
) -> Model:
    contact = {
        face.name: ContactStiffness(np.tile([2.0e7, 2.0e7, 3.0e7], (face.n_points, 1)), "user")
        for face in faces
    }
    return Model(
        n_blades=n_blades,
        bodies={body.name: body for body in bodies},
        interfaces={face.name: face for face in faces},
        locations={location.name: location for location in locations},
        contact=contact,
        meshes={} if meshes is None else meshes,
        provenance={"source": "synthetic"},
    )


def _nodal_diameters(n_blades: int, engine_order: int, harmonics: int) -> list[int]:
    folded = [(h * engine_order) % n_blades for h in range(harmonics + 1)]
    return sorted({min(d, n_blades - d) for d in folded})


def _grid(n_points: int, width: float, length: float) -> NDArray:
    """Centres of equal rectangles on a face, two rows if their number is even, (n_points, 2)."""
    rows = 2 if n_points % 2 == 0 and n_points > 2 else 1
    columns = n_points // rows
    across = ((np.arange(rows) + 0.5) / rows - 0.5) * width
    along = ((np.arange(columns) + 0.5) / columns - 0.5) * length
    return np.array([[a, b] for a in across for b in along])


def _interface(
    name: str,
    kind: str,
    a: tuple[str, int],
    b: tuple[str, int],
    points: NDArray,
    frame: NDArray,
    area: float,
    gap: float,
) -> Interface:
    n = len(points)
    return Interface(
        name=name,
        kind=kind,  # type: ignore[arg-type]
        body_a=a[0],
        sector_a=a[1],
        body_b=b[0],
        sector_b=b[1],
        points=points,
        area=np.full(n, area / n),
        frame=np.tile(frame, (n, 1, 1)),
        gap=np.full(n, gap),
    )


def _section(alpha: float, beta: float) -> NDArray:
    """Corners of the wedge's section: apex, left, right; centroid at ``(0, RADIUS)``, (3, 2)."""
    corners = np.array(
        [[0.0, HEIGHT], [-HEIGHT * np.tan(alpha), 0.0], [HEIGHT * np.tan(beta), 0.0]]
    )
    return corners - corners.mean(axis=0) + [0.0, RADIUS]


def _wedge_faces(
    alpha: float, beta: float, n_points: int, left: tuple[str, int], right: tuple[str, int]
) -> list[Interface]:
    corners = _section(alpha, beta)
    frames = wedge_frames(alpha, beta)
    faces = []
    for name, corner, blade in (("left", corners[1], left), ("right", corners[2], right)):
        middle = np.append((corners[0] + corner) / 2, 0.0)
        width = float(np.linalg.norm(corner - corners[0]))
        points = middle + _grid(n_points, width, LENGTH) @ frames[name][:2]
        faces.append(
            _interface(
                name, "friction", ("damper", 0), blade, points, frames[name], width * LENGTH, 0.0
            )
        )
    inner = (corners + corners.mean(axis=0)) / 2
    section = _triangle_area(corners)
    for name, z in (("front", LENGTH / 2), ("back", -LENGTH / 2)):
        points = np.column_stack([inner, np.full(3, z)])
        ends = ("damper", 0), ("ground", 0)
        faces.append(_interface(name, "constraint", *ends, points, frames[name], section, 2e-5))
    return faces


def _triangle_area(corners: NDArray) -> float:
    (ax, ay), (bx, by) = corners[1] - corners[0], corners[2] - corners[0]
    return float(abs(ax * by - ay * bx) / 2)


def _wedge_inertia(corners: NDArray) -> tuple[float, NDArray, NDArray]:
    """Mass, centre and inertia about the centre of the prism, exact."""
    area = _triangle_area(corners)
    mass = DENSITY * area * LENGTH
    arms = corners - corners.mean(axis=0)
    second = np.zeros((3, 3))  # integral of x x^T dm
    second[:2, :2] = mass / 12 * arms.T @ arms
    second[2, 2] = mass * LENGTH**2 / 12
    inertia = np.trace(second) * np.eye(3) - second
    return mass, np.append(corners.mean(axis=0), 0.0), inertia


def rigid_modes(mass: float, centre: NDArray, inertia: NDArray, points: NDArray) -> NDArray:
    """Mass-normalised rigid-body modes at points along X, Y, Z: translations, then rotations; (n, 3, 6)."""
    modes = np.empty((len(points), 3, 6))
    modes[:, :, :3] = np.eye(3) / np.sqrt(mass)
    moments, axes = np.linalg.eigh(inertia)
    for k in range(3):
        modes[:, :, 3 + k] = np.cross(axes[:, k], points - centre) / np.sqrt(moments[k])
    return modes


def _polynomial(points: NDArray) -> NDArray:
    """Values at points of 1, x, y, z, yz, zx, xy with lengths in units of 0.1 m, (n, 7)."""
    x, y, z = ((points - [0.0, RADIUS, 0.0]) / 0.1).T
    return np.stack([np.ones_like(x), x, y, z, y * z, z * x, x * y], axis=1)


def _smooth_modes(coefficients: NDArray, points: NDArray) -> NDArray:
    """Modes (n, 3, n_modes) along X, Y, Z from coefficients (7, 3, n_modes)."""
    return np.einsum("pt,tcm->pcm", _polynomial(points), coefficients)


def _random(rng: np.random.Generator, shape: tuple[int, ...], is_complex: bool) -> NDArray:
    values = rng.standard_normal(shape)
    return values + 1j * rng.standard_normal(shape) if is_complex else values


def _stacked(
    n_blades: int, ports: tuple[Port, ...], faces: list[Interface]
) -> tuple[NDArray, NDArray]:
    """Points and frames of all ports, turned back into the sector of the body itself."""
    by_name = {face.name: face for face in faces}
    points, frames = [], []
    for name, side in ports:
        face = by_name[name]
        turn = rotation(n_blades, face.sector_a if side == "a" else face.sector_b)
        points.append(face.points @ turn)  # rows are R^T x
        frames.append(face.frame @ turn)
    return np.concatenate(points), np.concatenate(frames)


def _residual(rng: np.random.Generator, points: NDArray, is_complex: bool) -> NDArray:
    """A Hermitian positive definite compliance that decays with the distance of the points, (3 n, 3 n)."""
    distance = np.linalg.norm(points[:, None] - points[None], axis=2)
    kernel = np.kron(0.3 * np.exp(-distance / 0.01) + 0.7 * np.eye(len(points)), np.eye(3))
    factor = _random(rng, kernel.shape, is_complex)
    return COMPLIANCE * (kernel + 0.1 * factor @ factor.conj().T / len(kernel))


def _flexibility(modes: NDArray, omega2: NDArray, residual: NDArray) -> NDArray:
    shapes = modes.reshape(3 * len(modes), len(omega2))
    total = (shapes / omega2) @ shapes.conj().T + residual
    return (total + total.conj().T) / 2


def _constrained_body(
    rng: np.random.Generator,
    name: str,
    n_blades: int,
    diameters: list[int],
    ports: tuple[Port, ...],
    faces: list[Interface],
    locations: list[Location],
    n_modes: int,
) -> Body:
    points, frames = _stacked(n_blades, ports, faces)
    bases = {}
    for d in diameters:
        is_complex = d not in (0, n_blades / 2)
        coefficients = 0.4 * _random(rng, (7, 3, n_modes), is_complex)
        omega2 = (BLADE_OMEGA[:n_modes] * (1 + 0.03 * d / (1 + d))) ** 2
        modes = frames @ _smooth_modes(coefficients, points)
        bases[d] = ModalBasis(
            omega2=omega2,
            damping_ratio=np.full(n_modes, 1e-3),
            contact_modes=modes,
            locations={
                at.name: _smooth_modes(coefficients, at.position[None])[0] for at in locations
            },
            flexibility=_flexibility(modes, omega2, _residual(rng, points, is_complex)),
        )
    return Body(name, "constrained", ports, bases)


def _wedge_body(
    rng: np.random.Generator, alpha: float, beta: float, faces: list[Interface], n_elastic: int
) -> Body:
    mass, centre, inertia = _wedge_inertia(_section(alpha, beta))
    ports = tuple((face.name, "a") for face in faces)
    points, frames = _stacked(1, ports, faces)
    up = np.array([0.0, 1.0, 0.0])
    omega2 = np.concatenate([np.zeros(6), DAMPER_OMEGA[:n_elastic] ** 2])
    coefficients = rng.standard_normal((7, 3, n_elastic)) / np.sqrt(mass)
    elastic = frames @ _smooth_modes(coefficients, points)
    rigid = frames @ rigid_modes(mass, centre, inertia, points)
    residual = _residual(rng, points, False)
    pull = 0.3 * coefficients[0, 1]  # modal force of a radial body force, per newton
    generalised = np.concatenate([up @ rigid_modes(mass, centre, inertia, centre[None])[0], pull])
    local = residual @ (frames @ up).ravel() / len(points)
    displacement = elastic @ (pull / omega2[6:]) + local.reshape(-1, 3)
    basis = ModalBasis(
        omega2=omega2,
        damping_ratio=np.concatenate([np.zeros(6), np.full(n_elastic, 2e-3)]),
        contact_modes=np.concatenate([rigid, elastic], axis=2),
        flexibility=_flexibility(elastic, omega2[6:], residual),
    )
    load = BodyLoad(up, generalised, displacement)
    return Body("damper", "free", ports, {0: basis}, mass, centre, inertia, load)


def _wedge_mesh(alpha: float, beta: float) -> dict[str, SurfaceMesh]:
    corners = _section(alpha, beta)
    points = np.concatenate(
        [np.column_stack([corners, np.full(3, z)]) for z in (LENGTH / 2, -LENGTH / 2)]
    )
    quads = np.array([[0, 1, 4, 3], [1, 2, 5, 4], [2, 0, 3, 5], [0, 1, 2, 2], [3, 5, 4, 4]])
    return {"damper": SurfaceMesh(points, quads)}
