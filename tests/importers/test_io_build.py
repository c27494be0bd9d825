"""build_model: the reference model again from bare matrices and sets, other units and axes, and what must be refused."""

import pickle
import re
import subprocess
import sys
import warnings
from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.spatial import cKDTree

pytest.importorskip("skfem", reason="scikit-fem is not installed (extra bdamper[fe])")

from bdamper.fem.generated_models import SectorFE, bladed_disk, end_patches, wedge_patches
from bdamper.fem.meshes import (
    ElasticMaterial,
    Geometry,
    MeshDensity,
    damper_mesh,
    discretise,
    local_order,
)
from bdamper.fem.surface import boundary_facets, facets_on_nodes
from bdamper.importers import ContactFaces, FEBody, read_arrays
from bdamper.importers.contact_faces import lay_contacts
from bdamper.importers.plausibility import check_table, wave_speed
from bdamper.importers.prepared_body import Placement, PreparedBody
from bdamper.model.model_file import load_model
from bdamper.util.errors import (
    BdamperError,
    BdamperWarning,
    ModelError,
    PlausibilityWarning,
    SettingError,
)
from examples.calculix.decks import damper_sets
from tests.each import each
from tests.fe_bodies import FIRST_NUMBER, contacts
from tests.imports import build
from tests.printed import said

ND = 5
G = Geometry()
TIP = [G.camber / 3.0, G.ridge_radius + G.platform_edge_thickness + G.airfoil_height, 0.0]
SETTINGS = {
    "n_blades": 65, "faces": ("LOW", "HIGH"), "fixed": "BORE", "nodal_diameters": (ND,), "n_modes": 8, "n_damper_modes": 8,
    "contacts": contacts(), "locations": {"tip": TIP},
}  # fmt: skip


def built_with(*bodies, **changes):
    """The import of bodies with other settings."""
    return build(*bodies, **(SETTINGS | changes))


@pytest.fixture(scope="module")
def reference(fe):
    return bladed_disk(9, n_modes=8, n_damper_modes=8, nodal_diameters=(ND,), fe=fe)


@pytest.fixture(scope="module")
def built(bodies):
    return built_with(*bodies)


def assert_same(model, reference, faces=("left", "right"), tolerance=1e-8):
    """Contact points in another order, everything else equal."""
    order = {}
    for name in faces:
        mine, theirs = model.interfaces[name], reference.interfaces[name]
        distance, index = cKDTree(theirs.points).query(mine.points)
        assert distance.max() < 1e-9
        np.testing.assert_allclose(mine.area, theirs.area[index], rtol=1e-7)
        np.testing.assert_allclose(mine.frame, theirs.frame[index], atol=1e-9)
        assert mine.sector_b == theirs.sector_b
        order[name] = index
    for body in ("blade", "damper"):
        side = "b" if body == "blade" else "a"
        for d, basis in reference.bodies[body].bases.items():
            own = model.bodies[body].bases[d]
            np.testing.assert_allclose(
                own.omega2[: own.n_natural], basis.omega2[: basis.n_natural], rtol=tolerance
            )
            rows, theirs = [], []
            for name in faces:
                start = reference.port_slice(body, (name, side)).start
                theirs.append(start + order[name])
                rows.append(
                    np.arange(model.interfaces[name].n_points)
                    + model.port_slice(body, (name, side)).start
                )
            rows, theirs = np.concatenate(rows), np.concatenate(theirs)
            a, b = (
                own.contact_modes[rows][..., : own.n_natural],
                basis.contact_modes[theirs][..., : basis.n_natural],
            )
            # The sign of a mode of a symmetric body depends on the order of its nodes.
            overlap = np.einsum("pcm,pcm->m", a.conj(), b)
            np.testing.assert_allclose(
                a * (overlap / np.abs(overlap)), b, atol=1e-5 * np.abs(b).max()
            )
            a, b = ((3 * k[:, None] + np.arange(3)).ravel() for k in (rows, theirs))
            scale = np.abs(basis.flexibility).max()
            error = own.flexibility[np.ix_(a, a)] - basis.flexibility[np.ix_(b, b)]
            assert np.abs(error).max() < 10 * tolerance * scale


@pytest.mark.slow
def test_gives_the_reference_model(built, reference):
    assert_same(built.model, reference)
    np.testing.assert_allclose(
        built.model.bodies["blade"]
        .bases[ND]
        .locations["tip"][:, : reference.bodies["blade"].bases[ND].n_modes],
        reference.bodies["blade"].bases[ND].locations["tip"],
        atol=1e-6,
    )
    ours, theirs = built.model.bodies["damper"], reference.bodies["damper"]
    assert ours.mass == pytest.approx(theirs.mass, rel=1e-12)
    np.testing.assert_allclose(ours.centre, theirs.centre, atol=1e-14)
    np.testing.assert_allclose(ours.inertia, theirs.inertia, atol=1e-16)
    np.testing.assert_allclose(ours.load.direction, theirs.load.direction, atol=1e-12)
    np.testing.assert_allclose(ours.load.generalised[:6], theirs.load.generalised[:6], atol=1e-9)


@pytest.mark.slow
def test_given_rectangles_are_those_of_the_reference(bodies, reference, fe):
    g = fe.geometry
    pairs = [
        replace(
            c,
            patches=wedge_patches(g, c.name, 9) if c.kind == "friction" else end_patches(g, c.name),
        )
        for c in contacts()
    ]
    model = built_with(*bodies, contacts=pairs).model
    for name, face in reference.interfaces.items():
        np.testing.assert_allclose(model.interfaces[name].points, face.points, atol=1e-12)
    assert_same(model, reference, ("left", "right"))


@pytest.mark.slow
def test_swapped_sector_faces_are_noticed(bodies, built):
    other = built_with(*bodies, faces=("HIGH", "LOW"))
    assert "the sets were exchanged" in said(other.summary())
    assert "the first set lies toward -X" in said(built.summary())
    a, b = (m.model.bodies["blade"].bases[ND] for m in (built, other))
    np.testing.assert_allclose(a.contact_modes, b.contact_modes, atol=1e-12)


def turned_and_scaled(body: FEBody, length: float, mass: float) -> FEBody:
    """The body in other axes (axis of rotation along X, blade along -Z) and units."""
    q = np.array(
        [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]
    ).T  # rows: new axes in the old ones
    q = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    assert np.linalg.det(q) == pytest.approx(1.0)
    block = sp.kron(sp.identity(len(body.nodes)), sp.csr_matrix(q), format="csr")
    return replace(
        body,
        nodes=body.nodes @ q.T / length,
        stiffness=block @ body.stiffness @ block.T / mass,
        mass=block @ body.mass @ block.T / mass,
    )


def test_other_axes_and_units(bodies, built):
    moved = [turned_and_scaled(b, 1e-3, 1e3) for b in bodies]
    # the former +Y is now -Z, the former Z is now X
    place = {"axis": (1.0, 0.0, 0.0), "radial": (0.0, 0.0, -1.0), "units": "mm-t-s"}
    tip_there = 1e3 * np.array([TIP[2], -TIP[0], -TIP[1]])
    other = built_with(*moved, locations={"tip": tip_there}, **place)
    assert_same(other.model, built.model, ("left", "right", "front", "back")[:2], tolerance=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize("given", ["quads", "corners only", "renumbered"])
def test_faces_in_other_forms(bodies, built, given):
    blade, damper = bodies
    if given == "renumbered":  # node order and numbers carry no meaning
        order = np.random.default_rng(1).permutation(len(damper.nodes))
        dofs = np.stack(
            [np.repeat(damper.numbers, 3), np.tile([1, 2, 3], len(damper.nodes))], axis=1
        )
        rows = np.random.default_rng(2).permutation(len(dofs))
        damper = replace(
            damper,
            nodes=damper.nodes[order],
            numbers=damper.numbers[order],
            dofs=dofs[rows],
            stiffness=damper.stiffness[rows][:, rows],
            mass=damper.mass[rows][:, rows],
        )
        pairs = contacts()
    else:
        facets = boundary_facets(tuple(e - FIRST_NUMBER for e in damper.elements), damper.nodes)
        pairs = []
        for c in contacts():
            found = facets_on_nodes(facets, damper.node_sets[c.faces_a] - FIRST_NUMBER).groups[0]
            pairs.append(
                replace(c, faces_a=FIRST_NUMBER + found[:, : 4 if given == "corners only" else 8])
            )
    model = built_with(blade, damper, contacts=pairs).model
    if given == "corners only":  # another interpolation on the damper's side, the same place
        np.testing.assert_allclose(
            model.interfaces["left"].points, built.model.interfaces["left"].points, atol=1e-12
        )
    else:
        assert_same(model, built.model)


@pytest.mark.slow
def test_meshes_need_not_match(fe, bodies):
    """A damper of another mesh gives the same points and areas; the matrices on both sides average the same field."""
    density = MeshDensity(2, 2, 1, 4, 2, 2, 1, 6, 5, 1, 2, 7)
    body = discretise(damper_mesh(fe.geometry, density), ElasticMaterial())
    other = SectorFE.__new__(SectorFE)
    other.geometry, other.damper = fe.geometry, type("Holder", (), {"body": body})
    numbers = 1 + np.arange(len(body.nodes))
    damper = FEBody(
        numbers,
        body.nodes,
        body.stiffness,
        body.mass,
        elements=(numbers[body.elements[:, local_order()]],),
        node_sets={k: numbers[v] for k, v in damper_sets(other).items()},
    )
    model = built_with(bodies[0], damper, contacts=contacts(24)).model
    reference = built_with(*bodies, contacts=contacts(24)).model
    for name in ("left", "right"):
        np.testing.assert_allclose(
            model.interfaces[name].points, reference.interfaces[name].points, atol=1e-12
        )
        np.testing.assert_allclose(
            model.interfaces[name].area, reference.interfaces[name].area, rtol=1e-9
        )
    blade, theirs = (m.bodies["blade"].bases[ND] for m in (model, reference))
    scale = np.abs(theirs.contact_modes).max()
    assert np.abs(blade.contact_modes - theirs.contact_modes).max() < 1e-9 * scale
    # Two meshes of one damper: elastic frequencies differ by discretisation only.
    a, b = (np.sqrt(m.bodies["damper"].bases[0].omega2[6:]) for m in (model, reference))
    assert 1e-6 < np.abs(a / b - 1.0).max() < 0.03


def test_fixed_nodes_may_be_missing_from_the_matrices(bodies, built, fe):
    blade, damper = bodies
    keep = np.setdiff1d(
        np.arange(3 * len(blade.nodes)), (3 * fe.clamped[:, None] + np.arange(3)).ravel()
    )
    dofs = np.stack([blade.numbers[keep // 3], keep % 3 + 1], axis=1)
    held = replace(
        blade, stiffness=blade.stiffness[keep][:, keep], mass=blade.mass[keep][:, keep], dofs=dofs
    )
    model = built_with(held, damper, fixed=None).model
    assert_same(model, built.model)


@pytest.mark.slow
def test_own_axes_of_nodes(bodies, built):
    """Displacements of some nodes in axes of their own."""
    blade, damper = bodies
    rng = np.random.default_rng(5)
    chosen = rng.choice(len(blade.nodes), 40, replace=False)
    blocks = np.broadcast_to(np.eye(3), (len(blade.nodes), 3, 3)).copy()
    for k in chosen:
        blocks[k] = np.linalg.qr(rng.standard_normal((3, 3)))[0]
        blocks[k] *= np.sign(np.linalg.det(blocks[k]))
    turned = sp.block_diag(list(blocks), format="csr")
    axes = {int(blade.numbers[k]): blocks[k] for k in chosen}
    given = replace(
        blade,
        stiffness=turned @ blade.stiffness @ turned.T,
        mass=turned @ blade.mass @ turned.T,
        node_axes=axes,
    )
    model = built_with(given, damper).model
    assert_same(model, built.model, tolerance=1e-7)


@pytest.mark.slow
def test_sector_faces_are_found_from_the_geometry(bodies, built):
    """Without their sets and without the number of blades, which the rotation tells."""
    found = built_with(*bodies, n_blades=None, faces=None)
    assert found.model.hash == built.model.hash
    assert any("sector faces: found from the geometry, 65 sectors" in line for line in found.checks)
    named = built_with(*bodies, n_blades=None, faces=("HIGH", "LOW"))
    assert named.model.n_blades == 65 and "65 sectors, from the 5.538 degrees between" in "".join(
        named.checks
    )


def test_blade_alone_against_the_ground(bodies):
    """An acyclic structure that rubs on the ground; the gap is the one given."""
    pair = ContactFaces(
        "rub", "RIGHT_UNDERSIDE", body_a="blade", body_b="ground", points=4, gap=1e-4
    )
    model = build(
        bodies[0], n_blades=1, contacts=[pair], fixed="BORE", n_modes=5, locations={"tip": TIP}
    ).model
    assert set(model.bodies) == {"blade", "ground"}
    np.testing.assert_array_equal(model.interfaces["rub"].gap, 1e-4)


def test_measured_gap(bodies):
    blade, damper = bodies
    outward = np.array([0.0, 1.0, 0.0]) @ np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    lowered = replace(damper, nodes=damper.nodes - 2e-5 * outward)
    pairs = [replace(c, gap="measured") if c.kind == "friction" else c for c in contacts()]
    model = built_with(blade, lowered, contacts=pairs).model
    for name in ("left", "right"):
        face = model.interfaces[name]
        np.testing.assert_allclose(face.gap, 2e-5 * face.frame[:, 2, 1], rtol=1e-6)


@pytest.mark.slow
def test_needs_no_finite_element_library(bodies, tmp_path):
    """Matrices from anywhere are enough: the same in an interpreter in which scikit-fem cannot be imported."""
    with open(tmp_path / "bodies.pickle", "wb") as file:
        pickle.dump(bodies, file)
    code = f"""
import pickle, sys
sys.modules["skfem"] = None
from bdamper.importers import ContactFaces, Reduction, Sector, build_model
blade, damper = pickle.load(open("bodies.pickle", "rb"))
pair = ContactFaces("left", "LEFT", "RIGHT_UNDERSIDE", points=4)
built = build_model(blade, damper, contacts=[pair], sector=Sector(65, ("LOW", "HIGH"), "BORE"),
                    reduction=Reduction(nodal_diameters=(0,), n_modes=3), locations=dict(tip={list(map(float, TIP))}))
print(built.frequencies[0][0])
"""
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert 250.0 < float(done.stdout.split()[-1]) < 300.0


def test_report_and_file(built, tmp_path):
    text = said(built.summary())
    for words in ("Lowest frequencies of the sector", "0.0689984 kg mass", "100 % of face a"):
        assert words in text
    lowest = built.frequencies[ND]
    assert len(lowest) > 6
    assert "  ".join(f"{hertz:.6g}" for hertz in lowest[:6]) in str(built)
    assert f"{lowest[6]:.6g}" not in str(built)
    assert len(str(built).splitlines()) <= 70  # one page
    assert built.plot().axes[0].has_data()
    built.save(tmp_path / "model.h5")
    loaded = load_model(tmp_path / "model.h5")
    assert loaded.hash == built.model.hash
    # shapes for pictures are those of the modes
    mesh, tip = loaded.meshes["blade"], loaded.locations["tip"]
    node = np.argmin(np.linalg.norm(mesh.points - tip.position, axis=1))
    modes = loaded.bodies["blade"].bases[ND].locations["tip"]
    np.testing.assert_allclose(
        mesh.modes[ND][node], modes[:, : mesh.modes[ND].shape[2]], atol=1e-6 * np.abs(modes).max()
    )
    assert loaded.provenance["report"] == built.summary()


# -----------------------------------------------------------------------------------------------------------
# What must be refused, with one line that names the thing


def unsymmetric(body):
    k = body.stiffness.tolil()
    k[3, 4] = 1.3 * k[3, 4] + 1e8
    return replace(body, stiffness=k.tocsr())


def indefinite(body):
    n = 3 * 300
    k = body.stiffness - sp.csr_matrix(
        ([20 * body.stiffness[n, n]], ([n], [n])), shape=body.stiffness.shape
    )
    return replace(body, stiffness=k.tocsr())


def soft(body):
    """One pair of entries beside the diagonal larger than the diagonal allows: one negative eigenvalue."""
    i = 3 * int(body.node_sets["RIGHT_UNDERSIDE"][0] - FIRST_NUMBER)
    j = i + 1
    more = 1.5 * np.sqrt(body.stiffness[i, i] * body.stiffness[j, j])
    k = body.stiffness + sp.csr_matrix(([more, more], ([i, j], [j, i])), shape=body.stiffness.shape)
    return replace(body, stiffness=k.tocsr())


def repeated(body):
    return replace(
        body, nodes=np.where(np.arange(len(body.nodes))[:, None] == 7, body.nodes[8], body.nodes)
    )


def same_number(body):
    numbers = body.numbers.copy()
    numbers[4] = numbers[5]
    return replace(body, numbers=numbers)


def without(name):
    return lambda body: replace(
        body, node_sets={k: v for k, v in body.node_sets.items() if k != name}
    )


def shorter(name):
    return lambda body: replace(body, node_sets={**body.node_sets, name: body.node_sets[name][:5]})


def dofs_of(body):
    """The table that holds without one: node by node."""
    return np.stack([np.repeat(body.numbers, 3), np.tile([1, 2, 3], len(body.nodes))], axis=1)


def row_5(value):
    """A body whose table has another row 5."""
    return lambda body: replace(
        body, dofs=np.concatenate([dofs_of(body)[:5], [value], dofs_of(body)[6:]])
    )


BAD_BLADES = [
    (
        unsymmetric,
        r"blade \(sector arrays\): stiffness matrix: expected a symmetric matrix .* row 4, column 5",
    ),
    (indefinite, "stiffness matrix: expected a diagonal without negative numbers"),
    (
        soft,
        "stiffness matrix, nodal diameter 0: expected a positive definite matrix, found 1 negative",
    ),
    (repeated, "nodes: expected each position once, found nodes 10[89] and 10[89]"),
    (same_number, "nodes: expected each node number once, found 106 2 times"),
    (without("LOW"), r"sector faces: expected one of the sets .*found 'LOW'"),
    (
        without("RIGHT_UNDERSIDE"),
        "contact 'left': expected one of the sets .*, found 'RIGHT_UNDERSIDE'",
    ),
    (
        shorter("HIGH"),
        r"sector faces: expected two sets of nodes that coincide after a rotation of one by 2 pi/65.* no element face",
    ),
    (
        row_5([9_000, 1]),
        "table of nodes and components: expected numbers of existing nodes, found 9000",
    ),
    (row_5([101, 4]), "displacements only .*, found component 4 of node 101"),
    (row_5([101, 1]), "each pair once, found node 101, component 1 repeated"),
    (
        lambda b: replace(b, mass=b.mass[:-3, :-3]),
        r"mass matrix: expected shape \(1641, 1641\), found \(1638, 1638\)",
    ),
    (
        lambda b: replace(b, mass=-b.mass),
        "mass matrix: expected a diagonal without negative numbers",
    ),
    (
        lambda b: replace(b, stiffness=b.stiffness[:-3, :-3]),
        "expected 1641 rows for 547 nodes, or a table",
    ),
    (lambda b: replace(b, nodes=np.full_like(b.nodes, np.inf)), "nodes: expected finite positions"),
    (lambda b: replace(b, nodes=b.nodes[:-1]), "nodes: expected numbers .n,. and positions"),
    (lambda b: replace(b, mass=None), "expected a stiffness and a mass|modes of nodal diameter 0"),
    (
        lambda b: replace(b, elements=(b.elements[0][:, :19],)),
        "elements: expected solid elements, found .*not 19",
    ),
    (
        lambda b: replace(b, elements=()),
        "contact 'left': expected faces, or a set of nodes of a body with elements",
    ),
]


@pytest.mark.slow
@each(("change", "message"), BAD_BLADES, ids=[m[:40] for _, m in BAD_BLADES])
def test_bad_blade(bodies, change, message):
    with pytest.raises(BdamperError, match=message) as caught:
        built_with(change(bodies[0]), bodies[1])
    assert "\n" not in str(caught.value)


def with_rows(body, rows):
    """Matrices with these rows, and the table that says so."""
    matrices = {key: getattr(body, key)[rows][:, rows] for key in ("stiffness", "mass")}
    return replace(body, dofs=dofs_of(body)[rows], **matrices)


def by_component(body):
    """Matrices with the rows of all x, then all y, then all z, and the table that says so."""
    return with_rows(body, np.argsort(dofs_of(body)[:, 1], kind="stable"))


def without_clamped(body):
    return with_rows(
        body, np.flatnonzero(~np.isin(np.repeat(body.numbers, 3), body.node_sets["BORE"]))
    )


def test_a_bare_array_of_elements_is_refused(bodies):
    with pytest.raises(
        ModelError, match=r"elements: expected arrays \(n, nodes of an element\) in a tuple"
    ):
        replace(bodies[1], elements=bodies[1].elements[0])


@pytest.mark.parametrize("elements", [True, False], ids=["with elements", "without"])
@pytest.mark.parametrize("which", ["blade", "damper", "held blade"])
def test_rows_stand_in_the_order_of_the_table(bodies, which, elements):
    """Node by node and component by component alike, if the table says so; another order is refused."""
    body = (
        bodies[which == "damper"] if elements else replace(bodies[which == "damper"], elements=())
    )
    body = without_clamped(body) if which == "held blade" else body
    prepared = PreparedBody("blade", body, Placement())
    check_table(prepared)
    assert "rigid-body motion causes" in prepared.report.checks[0]
    if which == "held blade":
        mistaken = replace(body, dofs=body.dofs[np.argsort(body.dofs[:, 1], kind="stable")])
    else:
        check_table(PreparedBody("blade", by_component(body), Placement()))
        mistaken = replace(by_component(body), dofs=None)
    expected = r"expected rows in the order of the table .*, found forces on .*rows in an order different from the table"
    with pytest.raises(ModelError, match=expected) as caught:
        check_table(PreparedBody("blade", mistaken, Placement()))
    assert "\n" not in str(caught.value)


def test_positions_of_other_nodes_are_noticed(bodies):
    moved = replace(bodies[0], nodes=np.roll(bodies[0].nodes, 3, axis=0))
    with pytest.raises(
        ModelError, match=r"forces on [91].* % of the nodes .*positions of other nodes"
    ):
        check_table(PreparedBody("blade", moved, Placement()))


def grounded(body):
    k = body.stiffness + sp.diags(np.where(np.arange(body.stiffness.shape[0]) < 9, 1e9, 0.0))
    return replace(body, stiffness=k.tocsr())


BAD_DAMPERS = [
    (grounded, "stiffness matrix: expected a free body .*, found .* translation along .*springs to the ground"),
    (
        lambda b: with_rows(b, np.arange(3, 3 * len(b.nodes))),
        "matrices: expected rows for all three components of every node.*, found rows missing at 1 nodes, such as node 101",
    ),
    (lambda b: replace(b, nodes=b.nodes * [1.0, 1.0, 1.0 + 1e-2]), "expected a free body.*rotation about .*positions"),
    (lambda b: replace(b, mass=b.mass * 1e-12), "density of 200 to 30000 kg/m3, found 7.85e-09 .*mm-t-s|mass matrix"),
    (lambda b: replace(b, nodes=b.nodes + [0.0, 0.1, 0.0]), "lie on each other|no area in common|normals"),
    (lambda b: replace(b, nodes=b.nodes + [0.0, 0.0, 0.5]), "no area in common"),
]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(("change", "message"), BAD_DAMPERS, ids=[m[:40] for _, m in BAD_DAMPERS])
def test_bad_damper(bodies, change, message):
    with pytest.raises(BdamperError, match=message):
        built_with(bodies[0], change(bodies[1]))


BAD_SETTINGS = [
    ({"n_blades": 0}, "n_blades: expected a whole number >= 1"),
    (
        {"n_blades": 64},
        "sector faces: expected two sets of nodes that coincide after a rotation of one by 2 pi/64",
    ),
    ({"units": "furlong"}, r"units \(or Units\(...\)\): expected one of"),
    ({"axis": (0, 0, 0)}, "axis and radial"),
    ({"nodal_diameters": (40,)}, "nodal_diameters: expected a whole number from 0 to 32, found 40"),
    ({"nodal_diameters": None}, "expected engine_order or nodal_diameters"),
    (
        {"faces": None, "n_blades": 64},
        "sector faces: expected the two faces of the sector, found no rotation that maps element faces",
    ),
    ({"fixed": None}, "found neither, and a rigid-body motion without force"),
    ({"locations": {"tip": 7}}, "location 'tip': expected numbers of existing nodes, found 7"),
    ({"locations": {"tip": [1.0, 1.0, 1.0]}}, "location 'tip': expected a position on the body"),
    (
        {"locations": {"tip": ("vane", 101)}},
        r"location 'tip': expected a body out of \['blade', 'damper'\]",
    ),
    (
        {"contacts": [ContactFaces("left", "LEFT", "BORE")]},
        "normals that point at each other|no area",
    ),
    ({"contacts": [ContactFaces("left", "LEFT", None)]}, "contact 'left': give faces_b"),
    (
        {"contacts": [ContactFaces("left", np.array([101, 102]), "BORE")]},
        "at least one element face",
    ),
    (
        {"contacts": [ContactFaces("left", "LEFT", "RIGHT_UNDERSIDE", gap=0.2)]},
        "gap: expected much less than the width",
    ),
    ({"contacts": ["left"]}, "contacts: expected a ContactFaces, found 'left'"),
    ({"contacts": None}, "contacts: expected a sequence of ContactFaces, found None"),
    ({"axis": "z"}, "axis: expected 3 finite numbers, found 'z'"),
    ({"origin": (0, 0)}, "origin: expected 3 finite numbers"),
    (
        {"radial": (1, 0, 0)},
        r"radial: .*, 1, .*\) in the axes of the file, .*, found \(1, 0, 0\), (89|9\d).*degrees off",
    ),
    ({"locations": [344]}, r"locations: expected a mapping, found \[344\]"),
    (
        {"expected_frequencies": {5: 285.0}},
        "expected_frequencies at nodal diameter 5: expected a sequence",
    ),
    ({"faces": ("LOW", "HIGH", "BORE")}, "faces: expected two sets of nodes"),
    (
        {"damping_ratio": "0.2%"},
        "damping_ratio: expected a finite number >= 0 and < 1, found '0.2%'",
    ),
    ({"nodal_diameters": "5"}, "nodal_diameters: expected a sequence of whole numbers, found '5'"),
    (
        {"nodal_diameters": None, "engine_order": 5, "harmonics": 2.5},
        "harmonics: expected a whole number .*, found 2.5",
    ),
    ({"n_modes": 10**5}, "n_modes: expected a whole number from 1 to 1000, found 100000"),
    ({"check_units": "no"}, "check_units: expected True or False"),
    (
        {"contacts": [ContactFaces("left", "LEFT", "RIGHT_UNDERSIDE", stiffness=(1e8, -1.0, 0))]},
        "stiffness",
    ),
    (
        {"contacts": [ContactFaces("left", "LEFT", "RIGHT_UNDERSIDE", sector_b=1)]},
        "normals|no area|lie on each other",
    ),
    ({"contacts": 2 * [ContactFaces("left", "LEFT", "RIGHT_UNDERSIDE")]}, "each name once"),
]


@pytest.mark.slow
@each(("change", "message"), BAD_SETTINGS, ids=[m[:40] for _, m in BAD_SETTINGS])
def test_bad_settings(bodies, change, message):
    with pytest.raises((ModelError, SettingError), match=message):
        built_with(*bodies, **change)


@each(
    ("setting", "message"),
    [
        ({"gap": np.nan}, "contact 'left': gap: expected a finite number, found nan"),
        (
            {"gap": "wide"},
            "contact 'left': gap: expected a distance in the units of the files, or 'measured'",
        ),
        (
            {"points": 500},
            "contact 'left': points: expected a whole number from 1 to 400, found 500",
        ),
        ({"points": (30, 30)}, "contact 'left': points: expected at most 400 contact points"),
        ({"kind": "glue"}, "contact 'left': kind: expected one of"),
        (
            {"sector_b": 2},
            "contact 'left': sector_b: expected a whole number from -1 to 1, found 2",
        ),
    ],
)
def test_bad_contact_faces_are_refused_at_once(setting, message):
    with pytest.raises(SettingError, match=message):
        ContactFaces("left", "LEFT", "RIGHT_UNDERSIDE", **setting)


# -----------------------------------------------------------------------------------------------------------
# Units


def softer(body, factor):
    return replace(body, stiffness=factor * body.stiffness)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda b: (softer(b[0], 1e-6), b[1]), "blade .*: expected a material .*, found 6.001 m/s"),
        (
            lambda b: (b[0], softer(b[1], 1e-4)),
            r"damper .*: expected a material .*, found \d\d\.?\d* m/s",
        ),
        (
            lambda b: (b[0], softer(b[1], 1e3)),
            r"damper .*: expected a material .*, found 1\.\d+e\+05 m/s",
        ),
        (
            lambda b: (b[0], scaled(b[1], 1e-3, 1.0)),
            r"damper .*: expected an extent of .*, found 3\d.* m .*millim",
        ),
    ],
)
def test_materials_and_sizes_that_no_machine_has_are_named(bodies, change, message):
    with pytest.raises(ModelError, match=message):
        built_with(*change(bodies))


def test_waves_travel_as_in_the_material(bodies, fe, built):
    """Speed of longitudinal waves sqrt((lambda + 2 mu)/rho), from matrices alone."""
    steel = fe.material
    e, nu, rho = steel.youngs_modulus, steel.poisson_ratio, steel.density
    exact = np.sqrt(e * (1 - nu) / ((1 + nu) * (1 - 2 * nu)) / rho)
    for body in bodies:
        prepared = PreparedBody("body", body, Placement())
        assert wave_speed(prepared) == pytest.approx(exact, rel=1e-6)
    assert re.search(r"damper pass longitudinal waves travel at \d{4} m/s", said(built.summary()))


@pytest.mark.parametrize("which", [0, 1])
def test_swapped_matrices_are_named(bodies, which):
    given = list(bodies)
    given[which] = replace(given[which], stiffness=given[which].mass, mass=given[which].stiffness)
    with pytest.raises(
        ModelError, match=r"expected a stiffness matrix, then a mass matrix, found .* swapped"
    ):
        built_with(*given)


def test_a_number_that_is_none_is_named_with_its_matrix_and_row(bodies):
    bad = bodies[0].mass.tocoo(copy=True)
    bad.data[7] = np.nan
    found = rf"nan in row {bad.row[7] + 1}, column {bad.col[7] + 1}, one of 1 wrong values"
    with pytest.raises(
        ModelError,
        match=rf"blade \(sector arrays\): mass matrix: expected finite numbers, found {found}",
    ):
        built_with(replace(bodies[0], mass=bad), bodies[1])
    numbers, nodes = bodies[0].numbers, bodies[0].nodes
    with pytest.raises(
        ModelError, match=rf"sector: mass matrix: expected finite numbers, found {found}"
    ):
        read_arrays(bodies[0].stiffness, bad, (numbers, nodes), source="sector")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (2 * np.pi, "2 pi"),
        pytest.param(0.5 / np.pi, r"1/\(2 pi\)", marks=pytest.mark.slow),
        pytest.param(10.0, "10\\^1:", marks=pytest.mark.slow),
        (10**1.5, r"10\^\(3/2\)"),
        pytest.param(1e-3, r"10\^-3", marks=pytest.mark.slow),
        (1.31, "ratios"),
    ],
)
def test_frequencies_off_by_a_factor_are_named(bodies, built, factor, words):
    expected = {ND: built.frequencies[ND][:4] / factor}
    with pytest.raises(
        ModelError,
        match=f"blade, nodal diameter {ND}: expected the frequencies of expected_f.*{words}",
    ):
        built_with(*bodies, expected_frequencies=expected, strict=True)


@pytest.mark.slow
def test_a_comparison_that_fails_warns_and_keeps_the_model(bodies, built):
    expected = {ND: built.frequencies[ND][:4] / 1.31}
    message = r"blade, nodal diameter 5: .* ratios 1.31 to 1.31 \(checks=Checks\(strict=True\) makes this an error\)"
    with pytest.warns(BdamperWarning, match=message):
        other = built_with(*bodies, expected_frequencies=expected)
    assert other.model.hash == built.model.hash
    assert len(other.failed) == 1 and said(other).startswith(
        f"Not confirmed by the other program: {other.failed[0]}"
    )
    with pytest.raises(
        ModelError, match=r"expected_frequencies: expected nodal diameters out of .* found 7"
    ):
        built_with(*bodies, expected_frequencies={7: [1.0]})


@pytest.mark.slow
def test_expected_frequencies_that_agree(bodies, built):
    expected = {ND: built.frequencies[ND][:4] * 1.002}
    other = built_with(*bodies, expected_frequencies=expected)
    assert "frequencies agree with expected_frequencies within 0.2 %" in said(other.summary())


def scaled(body, length, mass):
    return replace(
        body, nodes=body.nodes / length, stiffness=body.stiffness / mass, mass=body.mass / mass
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("length", "mass", "message"),
    [
        (1e-3, 1e3, "extent of 0.001 to 30 m, found 319.4 m .*possibly given in millimetres"),
        (1.0, 1e3, r"density of 200 to 30000 kg/m3, found 7.[78]\d* kg/m3"),
    ],
)
def test_units_of_the_file_are_suspected(bodies, length, mass, message):
    given = [scaled(b, length, mass) for b in bodies]
    place = [t / length for t in TIP]
    with pytest.raises(ModelError, match=message):
        built_with(*given, locations={"tip": place})
    built_with(*given, locations={"tip": place}, check_units=False)


@pytest.mark.parametrize(
    ("shift", "text"),
    [((0.0, 1e-3, 0.0), "of overlap"), ((0.0, -1e-3, 0.0), "farther apart"), (None, None)],
    ids=["outward", "inward", "in place"],
)
def test_a_damper_off_its_place_by_a_millimetre_is_noticed(bodies, shift, text):
    place = Placement()
    moved = (
        bodies[1] if shift is None else replace(bodies[1], nodes=bodies[1].nodes + np.array(shift))
    )
    prepared = {
        "blade": PreparedBody("blade", bodies[0], place),
        "damper": PreparedBody("damper", moved, place),
    }
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        lay_contacts(contacts(), prepared, 65)
    found = [str(w.message) for w in caught if w.category is PlausibilityWarning]
    assert len(found) == (0 if text is None else 2)  # left and right
    assert all(re.search(text, line) and "plausible meshes within" in line for line in found)
