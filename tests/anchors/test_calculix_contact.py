"""A wedge between two elastic platforms: CalculiX with penalty contact against the condensed problem."""

import re
import shutil
import subprocess

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.sparse.linalg import splu

pytest.importorskip("skfem", reason="scikit-fem is not installed (extra bdamper[fe])")
if shutil.which("ccx") is None:
    pytest.skip("CalculiX (ccx) is not installed", allow_module_level=True)

from skfem import MeshHex

from bdamper.contact.preload_state import OPEN
from bdamper.contact.static_contact import StaticContactProblem, solve_static_contact
from bdamper.fem.generated_models import averaging_matrix, wedge_patches
from bdamper.fem.meshes import (
    ElasticMaterial,
    Geometry,
    MeshDensity,
    damper_mesh,
    discretise,
    join_blocks,
    turn,
)
from bdamper.fem.reduced_bodies import FreeBody
from examples.calculix.decks import deck_of
from tests.certificate import certify

OVERLAP = 1e-8  # m, holds the damper before the load
LOAD, MU = 1000.0, 0.3
PENALTY = 2e14  # N/m3; the faces give way by some 1e12
# corners of an element that make its faces, as CalculiX names them
CORNERS = ((0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0))
FACES = {f"S{k}": corners for k, corners in enumerate(CORNERS, 1)}


def platform(patches, g, thickness=0.006):
    """A block on a face of the damper, its near side within the damper by the overlap."""
    centre, frame = patches.centre.mean(axis=0), patches.frame[0]
    a = np.linspace(-0.5, 0.5, 4) * g.face_length
    b = np.linspace(-0.5, 0.5, 8) * (g.face_width + 4e-3)
    c = np.linspace(0.0, 1.0, 3) * thickness - OVERLAP
    grid = np.stack(np.meshgrid(a, b, c, indexing="ij"), axis=-1)
    return join_blocks([centre + grid @ frame])


def parts():
    g = Geometry()
    patches = {side: wedge_patches(g, side, (3, 8)) for side in ("left", "right")}
    meshes = [damper_mesh(g, MeshDensity.preset("coarse"))] + [
        platform(p, g) for p in patches.values()
    ]
    return g, patches, meshes


def condensed(g, patches, meshes):
    damper = FreeBody(discretise(meshes[0], ElasticMaterial()), turn(0.5 * g.pitch).T)
    blocks = [averaging_matrix(damper.body, p) for p in patches.values()]
    flexibility = damper.receptance(sp.vstack(blocks, format="csr"))
    rigid = -np.concatenate([b @ damper.rigid for b in blocks])
    radial = turn(0.5 * g.pitch) @ [0.0, 1.0, 0.0]
    force = damper.body.body_force(np.tile(radial, (len(damper.body.nodes), 1))).ravel()
    force /= force.reshape(-1, 3).sum(axis=0) @ radial
    offset = -np.concatenate([b @ damper.elastic_response(force) for b in blocks])
    start = 0
    for mesh, p in zip(meshes[1:], patches.values()):
        body = discretise(mesh, ElasticMaterial())
        depth = (body.nodes - p.centre[0]) @ p.frame[0][2]
        held = np.repeat(depth > 0.006 - 1e-6, 3)
        free = np.flatnonzero(~held)
        shifted = type(p)(p.centre - OVERLAP * p.frame[:, 2], p.frame, p.size)
        B = averaging_matrix(body, shifted)[:, free]
        K = body.stiffness.tocsc()[free][:, free]
        n = B.shape[0]
        flexibility[start : start + n, start : start + n] += B @ splu(K).solve(B.T.toarray())
        start += n
    sense = np.tile([1.0, 1.0, -1.0], len(rigid) // 3)
    n = len(sense) // 3
    # the overlap is pressed out first: per newton of the load that is asked for
    offset = (sense * offset).reshape(-1, 3) + [0.0, 0.0, OVERLAP / LOAD]
    return StaticContactProblem(
        sense[:, None] * flexibility * sense,
        sense[:, None] * rigid,
        damper.rigid.T @ force,
        offset,
        np.full(n, MU),
    ), force


def facets(text, nodes, centre, normal, level):
    """Element faces, as CalculiX names them, in the plane at a level above a point."""
    body = text.split("*ELEMENT")[1].split("\n*")[0]
    rows = np.array([int(v) for v in re.findall(r"\d+", body.split("\n", 1)[1])]).reshape(-1, 21)
    distance = np.abs((nodes - centre) @ normal - level)
    inside = distance < 0.2 * OVERLAP
    return [
        f"{row[0]}, {name}"
        for row in rows
        for name, c in FACES.items()
        if inside[row[1:][list(c)] - 1].all()
    ]


def calculix(g, patches, meshes, force, folder):
    offsets = np.cumsum([0] + [m.p.shape[1] for m in meshes])
    whole = MeshHex(
        np.hstack([m.p for m in meshes]), np.hstack([m.t + o for m, o in zip(meshes, offsets)])
    )
    body = discretise(whole, ElasticMaterial())
    text = deck_of(body)
    lines = [text]
    held = np.zeros(len(body.nodes), bool)
    for side, p in patches.items():
        centre, normal = p.centre.mean(axis=0), p.frame[0][2]
        depth = (body.nodes - centre) @ normal
        near = np.linalg.norm(body.nodes - centre - 0.006 * normal, axis=1) < 0.03
        held |= near & (np.abs(depth - 0.006) < 1e-6)
        for name, level in (("D", 0.0), ("P", -OVERLAP)):
            lines += [f"*SURFACE, NAME={name}{side.upper()}, TYPE=ELEMENT"]
            lines += facets(text, body.nodes, centre, normal, level)
    lines += ["*BOUNDARY"] + [f"{k + 1}, 1, 3" for k in np.flatnonzero(held)]
    lines += [
        "*SURFACE INTERACTION, NAME=FACES",
        "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR",
        f"{PENALTY:.6e}",
        "*FRICTION",
        f"{MU}, {0.5 * PENALTY:.6e}",
    ]
    for side in patches:
        lines += [
            "*CONTACT PAIR, INTERACTION=FACES, TYPE=SURFACE TO SURFACE",
            f"D{side.upper()}, P{side.upper()}",
        ]
    lines += ["*STEP, NLGEOM=NO, INC=200", "*STATIC", "0.1, 1., 1e-5, 0.2", "*CLOAD"]
    damper = discretise(meshes[0], ElasticMaterial())
    place = {tuple(np.round(x / 1e-9).astype(np.int64)): k for k, x in enumerate(body.nodes)}
    for x, f in zip(damper.nodes, LOAD * force.reshape(-1, 3)):
        k = place[tuple(np.round(x / 1e-9).astype(np.int64))] + 1
        lines += [f"{k}, {d + 1}, {v:.9e}" for d, v in enumerate(f) if v]
    for side in patches:
        lines += [
            f"*CONTACT PRINT, SLAVE=D{side.upper()}, MASTER=P{side.upper()}, FREQUENCY=1000",
            "CF",
        ]
    lines += ["*END STEP", ""]
    (folder / "wedge.inp").write_text("\n".join(lines))
    done = subprocess.run(
        ["ccx", "-i", "wedge"], cwd=folder, capture_output=True, text=True, timeout=300, check=False
    )
    data = folder / "wedge.dat"
    return done.stdout, data.read_text() if data.exists() else ""


@pytest.mark.nightly
@pytest.mark.slow
def test_normal_force_and_contact_area(tmp_path):
    """Both programs close the whole face.

    The normal forces differ by 0.7 %: a penalty lets sticking points creep (its tangential stiffness is finite, while
    friction decides how the load splits) and adds its own compliance.
    """
    g, patches, meshes = parts()
    problem, force = condensed(g, patches, meshes)
    ours = solve_static_contact(problem)
    violations = certify(problem, ours.force, ours.motion, ours.rest)
    assert max(violations[name] for name in ("equilibrium", "tension", "friction")) < 1e-10
    assert np.abs(ours.motion).max() < 1e-9 * OVERLAP / LOAD  # all points stick, so nothing moves
    output, data = calculix(g, patches, meshes, force, tmp_path)
    found = re.findall(r"area,\s+normal force.*\n\s*\n\s+(\S+)\s+(\S+)\s+(\S+)", data)
    assert len(found) == 2, output[-1500:]
    half = len(ours.force) // 2
    for k, (area, normal, _) in enumerate(found):
        rows = slice(k * half, (k + 1) * half)
        closed = ours.status[rows, 0] != OPEN
        share = closed.mean() * g.face_length * g.face_width
        assert float(area) == pytest.approx(share, rel=0.01)
        assert -float(normal) == pytest.approx(LOAD * ours.force[rows, 2].sum(), rel=0.015)
