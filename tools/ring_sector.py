"""A bladed disk of 24 sectors with a friction ring under the lip of its rim: meshes and decks in mm, t, s.

The ring has a rectangular section.  Every node of its outer face has the place of a node of the lip.
The elements have incompatible modes (C3D8I): plain linear ones (C3D8) are too stiff in bending, 982 instead
of 583 Hz for the ring at nodal diameter 4.
"""

from functools import cache

import numpy as np

from bdamper.fem.meshes import join_blocks, local_order
from tests.own_sector import deck
from tools.shrouded import block, on

N = 24
HALF = np.pi / N
THETA = np.linspace(-HALF, HALF, 6)
DISK, SEAT, LIP = (-4.0, 4.0), (6.0, 16.0), (4.0, 6.0, 16.0, 18.0)
"""Axial positions of the disk, of the ring, and of the layers of the lip."""
BORE, INSIDE, TOP, TIP = 100.0, 156.0, 160.0, 230.0
"""Radii: bore, outer face of the ring in the lip, root and tip of the blade."""
INNER = 152.0
"""Inner radius of the ring."""
KIND = "C3D8I"
STEEL = (210000.0, 0.3, 7.85e-9)


@cache
def meshes():
    """Nodes, hexahedra and sets of node indices of both bodies."""
    radii = np.array([BORE, 115.0, 132.0, 148.0, INSIDE, TOP])
    disk = block(THETA, radii, np.array(DISK))
    lip = block(THETA, np.array([INSIDE, TOP]), np.array(LIP))
    blade = block(THETA[2:4], np.linspace(TOP, TIP, 6), np.array(DISK))
    ring = block(THETA, np.array([INNER, INSIDE]), np.array(SEAT))
    made = {}
    for name, blocks in (("sector", [disk, lip, blade]), ("ring", [ring])):
        mesh = join_blocks([1e-3 * part for part in blocks])
        nodes = 1e3 * mesh.p.T
        elements = mesh.t.T[:, _upright(nodes, mesh.t.T)]
        theta = np.arctan2(nodes[:, 0], nodes[:, 1])
        radius = np.hypot(nodes[:, 0], nodes[:, 1])
        low_lip = on(radius, INSIDE) & (nodes[:, 2] > DISK[1] - 1e-6)
        sets = {"LOW": on(theta, -HALF), "HIGH": on(theta, HALF), "SEAT": low_lip}
        if name == "sector":
            sets["BORE"] = on(radius, BORE)
        members = {key: np.flatnonzero(mask) for key, mask in sets.items()}
        made[name] = (nodes, elements, members)
    return made


def _upright(nodes, elements):
    """Order of the corners of scikit-fem's hexahedra in other programs, right-handed."""
    order = local_order()[:8]
    corner = nodes[elements[0, order]]
    if np.linalg.det([corner[1] - corner[0], corner[3] - corner[0], corner[4] - corner[0]]) < 0.0:
        order = order[[4, 5, 6, 7, 0, 1, 2, 3]]
    return order


def text_of(name, kind=KIND):
    """Deck of a body without steps."""
    nodes, elements, sets = meshes()[name]
    return deck(kind, nodes, elements, *STEEL, sets)


def joined():
    """Deck of sector and ring with common nodes on the face between them, and its sets."""
    parts = meshes()
    nodes = np.concatenate([part[0] for part in parts.values()])
    n_sector = len(parts["sector"][0])
    elements = np.concatenate([parts["sector"][1], parts["ring"][1] + n_sector])
    rounded = np.round(nodes / 1e-6).astype(np.int64)
    _, first, number = np.unique(rounded, axis=0, return_index=True, return_inverse=True)
    number = number.reshape(-1)
    sets = {}
    for key in ("LOW", "HIGH", "BORE"):
        members = [parts["sector"][2][key]]
        if key in parts["ring"][2]:
            members.append(parts["ring"][2][key] + n_sector)
        sets[key] = np.unique(number[np.concatenate(members)])
    return deck(KIND, nodes[first], number[elements], *STEEL, sets), sets
