"""The reference sector and damper as another program would hand them over: numbers, sets and bare matrices."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from bdamper.fem.generated_models import SectorFE
from bdamper.fem.meshes import MeshDensity, local_order
from bdamper.importers import ContactFaces, FEBody
from examples.calculix.decks import blade_sets, damper_sets
from tools.shrouded import modes_alone as modes_alone

FIRST_NUMBER = 101
"""Node numbers start here, so that an index taken for a number shows."""
SIX_BLADES = {
    "n_blades": 6,
    "faces": ("LOW", "HIGH"),
    "fixed": "BORE",
    "n_damper_modes": 6,
    "check_units": False,
}
"""Settings of an import of a sector of six blades."""
SPARSE = MeshDensity(2, 1, 1, 2, 1, 1, 1, 3, 2, 1, 1, 4)
"""547 nodes in place of 1461: enough wherever two ways to the same model are compared."""


def sector_and_damper(fe: SectorFE) -> tuple[FEBody, FEBody]:
    """Both bodies with the sets that a user would define."""
    bodies = []
    for disc, sets, name in (
        (fe.blade, blade_sets(fe), "sector arrays"),
        (fe.damper.body, damper_sets(fe), "damper arrays"),
    ):
        numbers = FIRST_NUMBER + np.arange(len(disc.nodes))
        bodies.append(
            FEBody(
                numbers=numbers,
                nodes=disc.nodes.copy(),
                stiffness=sp.csr_matrix(disc.stiffness),
                mass=sp.csr_matrix(disc.mass),
                elements=(numbers[disc.elements[:, local_order()]],),
                node_sets={key: numbers[nodes] for key, nodes in sets.items()},
                source=name,
            )
        )
    return bodies[0], bodies[1]


def blade_and_damper(fe: SectorFE) -> tuple[FEBody, FEBody]:
    """Both bodies, the nodes of the blade above its disk in a set of their own, as a wheel asks for."""
    blade, damper = sector_and_damper(fe)
    sets = {**blade.node_sets, "BLADE": FIRST_NUMBER + fe.blade_part().nodes}
    return replace(blade, node_sets=sets), damper


def contacts(points: int = 9, end_gap: float = 2e-4) -> list[ContactFaces]:
    """The interfaces of the reference model, found from sets."""
    return [
        ContactFaces("left", "LEFT", "RIGHT_UNDERSIDE", points=points),
        ContactFaces("right", "RIGHT", "LEFT_UNDERSIDE", points=points),
        ContactFaces(
            "front", "FRONT", body_b="ground", points=(2, 2), kind="constraint", gap=end_gap
        ),
        ContactFaces(
            "back", "BACK", body_b="ground", points=(2, 2), kind="constraint", gap=end_gap
        ),
    ]
