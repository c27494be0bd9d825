"""A sector with a tip shroud and two strip dampers under its platforms, from structured blocks."""

from dataclasses import replace
from functools import cache

import numpy as np

from bdamper.fem.meshes import ElasticMaterial, discretise, join_blocks, local_order
from bdamper.importers import ContactFaces, Reduction, Sector, build_model, read_arrays

N = 36
HALF = np.pi / N
SHANK, AIRFOIL, EDGE = 0.25 * HALF, 0.12 * HALF, 0.97 * HALF
Z = np.linspace(-0.02, 0.02, 5)
STRIPS = {
    "front": (0.55 * HALF, Z[0] + 1e-3, Z[2] - 1e-3, 2.0e-3),
    "rear": (0.45 * HALF, Z[2] + 2e-3, Z[4] - 1e-3, 1.5e-3),
}


def block(theta, r, z):
    """Nodes of a box in cylindrical coordinates; angles from +Y toward +X."""
    t, r, z = np.meshgrid(theta, r, z, indexing="ij")
    return np.stack([r * np.sin(t), r * np.cos(t), z], axis=-1)


def on(values, at):
    return np.abs(values - at) < 1e-7


def mirrored(*angles):
    return np.array([*[-a for a in angles[::-1]], 0.0, *angles])


def body(blocks):
    made = discretise(join_blocks(blocks), ElasticMaterial())
    nodes = made.nodes
    theta, r, z = (
        np.arctan2(nodes[:, 0], nodes[:, 1]),
        np.hypot(nodes[:, 0], nodes[:, 1]),
        nodes[:, 2],
    )
    return made, theta, r, z


def meshes():
    """The sector and both strips with their sets of nodes, by name."""
    thin, shank = mirrored(AIRFOIL), mirrored(AIRFOIL, SHANK)
    disk = block(mirrored(AIRFOIL, SHANK, HALF), np.linspace(0.20, 0.225, 3), Z)
    neck = block(shank, np.linspace(0.225, 0.25, 3), Z)
    platform = block(mirrored(AIRFOIL, SHANK, 0.6 * HALF, EDGE), np.array([0.25, 0.254]), Z)
    airfoil = block(thin, np.linspace(0.254, 0.34, 7), Z)
    shroud = block(mirrored(AIRFOIL, 0.55 * HALF, HALF), np.array([0.34, 0.345]), Z)
    made, theta, r, _ = body([disk, neck, platform, airfoil, shroud])
    sets = {
        "low": on(theta, -HALF) & (r < 0.23), "high": on(theta, HALF) & (r < 0.23), "bore": on(r, 0.20),
        "shroud_low": on(theta, -HALF) & (r > 0.3), "shroud_high": on(theta, HALF) & (r > 0.3),
        "under_right": on(r, 0.25) & (theta > 0.5 * HALF), "under_left": on(r, 0.25) & (theta < -0.5 * HALF),
    }  # fmt: skip
    bodies = {"blade": (made, sets)}
    for name, (wide, low, high, thick) in STRIPS.items():
        angles = HALF + mirrored(0.06 * HALF, wide)
        made, theta, r, _ = body(
            [block(angles, np.array([0.25 - thick, 0.25]), np.linspace(low, high, 3))]
        )
        top = on(r, 0.25)
        sets = {"left": top & (theta < 0.95 * HALF), "right": top & (theta > 1.05 * HALF)}
        bodies[name] = made, sets
    return {
        name: (made, {key: np.flatnonzero(on) for key, on in sets.items()})
        for name, (made, sets) in bodies.items()
    }


def given(made, members):
    """A mesh with its sets as the body of an import."""
    numbers = np.arange(len(made.nodes))
    return read_arrays(
        made.stiffness,
        made.mass,
        (numbers, made.nodes),
        sets=members,
        elements=(made.elements[:, local_order()],),
    )


@cache
def shrouded(names=("front", "rear")):
    """The model, with these of the dampers, and its report."""
    bodies = {name: given(*mesh) for name, mesh in meshes().items()}
    contacts = [
        ContactFaces(
            "shroud", "shroud_high", "shroud_low", "blade", "blade", points=(1, 4), sector_b=1
        )
    ]
    for name in names:
        contacts.append(
            ContactFaces(f"{name}_left", "left", "under_right", name, "blade", points=(2, 2))
        )
        contacts.append(
            ContactFaces(f"{name}_right", "right", "under_left", name, "blade", points=(2, 2))
        )
    return build_model(
        bodies["blade"], {name: bodies[name] for name in names}, sector=Sector(N, ("low", "high"), fixed="bore"),
        reduction=Reduction(engine_order=4, n_modes=12, n_damper_modes={"front": 8}), contacts=contacts,
        locations={"tip": (0.0, 0.345, 0.0)},
    )  # fmt: skip


def modes_alone(model):
    """The model without the static shapes of locations on its blade, which modes from a file and shipped models lack."""
    blade = model.bodies["blade"]
    bases = {
        d: replace(
            b, omega2=b.omega2[: b.n_natural], damping_ratio=b.damping_ratio[: b.n_natural],
            contact_modes=b.contact_modes[..., : b.n_natural],
            locations={name: rows[:, : b.n_natural] for name, rows in b.locations.items()}, static_shapes=None,
        )
        for d, b in blade.bases.items()
    }  # fmt: skip
    stress = {
        name: replace(rows, modes={d: m[..., : blade.bases[d].n_natural] for d, m in rows.modes.items()})
        for name, rows in model.stress.items()
    }  # fmt: skip
    return replace(
        model, bodies={**model.bodies, "blade": replace(blade, bases=bases)}, stress=stress
    )
