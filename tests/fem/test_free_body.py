"""The free damper: exact rigid modes, inertia relief, elastic modes, centrifugal load."""

import shutil
from itertools import combinations

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp
from scipy.integrate import trapezoid

pytest.importorskip("skfem", reason="scikit-fem is not installed (extra bdamper[fe])")

from bdamper.fem.generated_models import averaging_matrix, wedge_patches
from bdamper.fem.meshes import ElasticMaterial, Geometry, MeshDensity, damper_mesh, discretise, turn
from bdamper.fem.reduced_bodies import FreeBody, isostatic_dofs
from bdamper.fem.surface import Structure
from bdamper.importers import read_calculix
from bdamper.model.modal_basis import rigid_motions
from examples.calculix.decks import run_job
from tests.own_sector import deck

G = Geometry()
AXES = turn(0.5 * G.pitch).T


def damper(face=3, ridge=1, height=2, length=6, **options):
    density = MeshDensity(2, 1, 1, 2, 1, 1, 1, 1, face, ridge, height, length)
    return FreeBody(discretise(damper_mesh(G, density), ElasticMaterial()), AXES, **options)


@pytest.fixture(scope="module")
def free():
    return damper()


def test_rigid_modes_are_exact(free):
    mass, stiffness = free.body.mass, free.body.stiffness
    np.testing.assert_allclose(free.rigid.T @ (mass @ free.rigid), np.eye(6), atol=1e-13)
    assert (
        np.abs(stiffness @ free.rigid).max()
        < 1e-12 * np.abs(stiffness).max() * np.abs(free.rigid).max()
    )
    # They span the rigid motions, in the order of the axes: the first is a pure translation along the first
    # axis.
    exact = rigid_motions(free.body.nodes, free.centre, AXES)
    np.testing.assert_allclose(
        free.rigid[:, 0], exact[:, 0] / np.sqrt(free.total_mass), rtol=0, atol=1e-10
    )
    np.testing.assert_allclose(free.remove_rigid(exact), 0.0, atol=1e-13)


def test_mass_centre_and_inertia(free):
    """Against the prism: rectangle, trapezoid roof, and the axial parallel-axis sums."""
    s, c = np.sin(G.face_angle) * G.face_length, np.cos(G.face_angle) * G.face_length
    width = G.ridge_width + 2 * s
    y = np.linspace(-G.damper_body_height, c, 200001)
    w = np.where(y < 0, width, width - 2 * s * np.maximum(y, 0) / c)
    area = trapezoid(w, y)
    mean = trapezoid(w * y, y) / area
    i_zz = trapezoid(w**3 / 12 + w * (y - mean) ** 2, y) / area
    mass = 7850.0 * area * G.face_width
    assert free.total_mass == pytest.approx(mass, rel=1e-8)
    assert free.total_mass == pytest.approx(0.069, rel=1e-3)
    centre = turn(0.5 * G.pitch) @ [0.0, G.ridge_radius - c + mean, 0.0]
    np.testing.assert_allclose(free.centre, centre, atol=1e-9)
    assert free.inertia[2, 2] == pytest.approx(mass * i_zz, rel=1e-6)


def test_mass_centre_and_inertia_of_point_masses():
    """Sums of m, of m r over m, and of m (r.r - r r) about the centre, on a tetrahedron of bars."""
    nodes = np.array([[0.1, 0.3, 0.2], [0.4, 0.5, -0.1], [-0.2, 0.6, 0.3], [0.2, 0.9, 0.7]])
    m = np.array([1.0, 2.0, 4.0, 0.5])
    stiffness = np.zeros((12, 12))
    for a, b in combinations(range(4), 2):
        bar = np.zeros(12)
        bar[3 * a : 3 * a + 3] = (nodes[b] - nodes[a]) / np.linalg.norm(nodes[b] - nodes[a])
        bar[3 * b : 3 * b + 3] = -bar[3 * a : 3 * a + 3]
        stiffness += np.outer(bar, bar)
    mass = sp.diags(np.repeat(m, 3), format="csr")
    found = FreeBody(Structure(nodes, sp.csr_matrix(stiffness), mass), np.eye(3))
    assert found.total_mass == pytest.approx(7.5, rel=1e-12)
    centre = m @ nodes / 7.5
    np.testing.assert_allclose(found.centre, centre, rtol=1e-12)
    r = nodes - centre
    inertia = (m * (r**2).sum(axis=1)).sum() * np.eye(3) - (m * r.T) @ r
    np.testing.assert_allclose(found.inertia, inertia, atol=1e-12)
    # rotation about Z with a unit resultant along the second axis: m (x, y, 0) over its sum
    force = found.centrifugal_load(np.array([0.0, 1.0, 0.0])).reshape(-1, 3)
    expected = m[:, None] * nodes * [1.0, 1.0, 0.0] / (7.5 * centre[1])
    np.testing.assert_allclose(force, expected, atol=1e-12)


def test_receptance_does_not_depend_on_the_constraints(free):
    contact = averaging_matrix(free.body, wedge_patches(G, "left", 9))
    reference = free.receptance(contact)
    choices = [isostatic_dofs(free.body.nodes, corner) for corner in (0, 17, 200)]
    assert len({tuple(c) for c in choices}) == 3
    for choice in choices:
        other = FreeBody(free.body, AXES, constrained=choice)
        np.testing.assert_allclose(
            other.receptance(contact), reference, atol=1e-10 * np.abs(reference).max()
        )


def test_sum_over_all_modes_is_the_receptance():
    small = damper(1, 1, 1, 2)
    contact = averaging_matrix(small.body, wedge_patches(G, "right", 4))
    omega2, modes = scipy.linalg.eigh(small.body.stiffness.toarray(), small.body.mass.toarray())
    assert np.sum(omega2 < 1e-6 * omega2[6]) == 6
    phi = contact @ modes[:, 6:]
    exact = small.receptance(contact)
    np.testing.assert_allclose((phi / omega2[6:]) @ phi.T, exact, atol=1e-8 * np.abs(exact).max())
    # Truncated sums approach it from below.
    rest = [
        np.linalg.eigvalsh(exact - (phi[:, :n] / omega2[6 : 6 + n]) @ phi[:, :n].T)
        for n in (5, 20, 80)
    ]
    assert all(r[0] > -1e-10 * np.abs(exact).max() for r in rest)
    assert rest[0][-1] > rest[1][-1] > rest[2][-1]


@pytest.mark.slow
def test_elastic_modes(free):
    omega2, modes = free.modes(12)
    assert np.all(omega2[:6] == 0.0)
    assert np.all(np.diff(omega2[5:]) > 0.0)
    np.testing.assert_allclose(modes.T @ (free.body.mass @ modes), np.eye(12), atol=1e-9)
    residual = free.body.stiffness @ modes[:, 6:] - free.body.mass @ modes[:, 6:] * omega2[6:]
    assert np.abs(residual).max() < 1e-6 * np.abs(free.body.stiffness @ modes[:, 6:]).max()
    with pytest.raises(ValueError, match="at least six, the rigid modes"):
        free.modes(5)


def test_centrifugal_load(free):
    radial = turn(0.5 * G.pitch) @ [0.0, 1.0, 0.0]
    force = free.centrifugal_load(radial).reshape(-1, 3)
    np.testing.assert_allclose(force.sum(axis=0), radial, atol=1e-12)
    # The resultant of rho (x, y, 0) passes through the axis and the centre of gravity: no moment.
    np.testing.assert_allclose(
        np.cross(free.body.nodes - free.centre, force).sum(axis=0), 0.0, atol=1e-13
    )
    # Its generalised force on the rigid modes: only the radial translation, 1/sqrt(m).
    generalised = free.rigid.T @ force.ravel()
    np.testing.assert_allclose(generalised, [0, free.total_mass**-0.5, 0, 0, 0, 0], atol=1e-10)


def test_condensed_degrees_of_freedom_do_not_move_the_centre_of_mass(free):
    """Internal motion S u without rigid part, as of incompatible modes, adds S'A + A'S + S'DS to the mass matrix."""
    body = free.body
    rng = np.random.default_rng(8)
    rigid, _ = np.linalg.qr(rigid_motions(body.nodes, np.zeros(3), np.eye(3)))
    internal = rng.standard_normal((12, body.n_dof))
    internal -= (internal @ rigid) @ rigid.T
    coupling = rng.standard_normal((12, body.n_dof))
    added = internal.T @ coupling
    added = added + added.T + 12.0 * internal.T @ internal
    diagonal = body.mass.diagonal().min()
    mass = body.mass + sp.csr_matrix(1e-4 * diagonal * added / np.abs(added).max())
    other = FreeBody(Structure(body.nodes, body.stiffness, mass), AXES)
    assert other.total_mass == pytest.approx(free.total_mass, rel=1e-9)
    np.testing.assert_allclose(other.centre, free.centre, atol=1e-10)
    np.testing.assert_allclose(other.inertia, free.inertia, atol=1e-8 * np.abs(free.inertia).max())
    rotation = other.rigid.T @ (mass @ other.rigid)
    np.testing.assert_allclose(rotation, np.eye(6), atol=1e-9)
    # neither a side force nor a moment, although the products of the condensed matrix have both
    radial = AXES[1]
    force = other.centrifugal_load(radial).reshape(-1, 3)
    np.testing.assert_allclose(force.sum(axis=0), radial, atol=1e-10)
    moment = np.cross(body.nodes - free.centre, force).sum(axis=0)
    np.testing.assert_allclose(moment, 0.0, atol=1e-12)


def wedge_of_unequal_angles():
    """Nodes (mm), hexahedra, and corners of the section of a prism with faces at 60.2 and 58.4 degrees."""
    height, top, left, right = 9.0, 2.0, np.tan(np.radians(60.2)), np.tan(np.radians(58.4))
    corners = np.array(
        [[-left * height, 0.0], [top + right * height, 0.0], [top, height], [0.0, height]]
    )
    s, t, z = np.meshgrid(
        np.linspace(0, 1, 4), np.linspace(0, 1, 3), np.linspace(0, 30, 4), indexing="ij"
    )
    weights = (1 - s) * (1 - t), s * (1 - t), s * t, (1 - s) * t
    section = sum(weight[..., None] * corner for weight, corner in zip(weights, corners))
    section[..., 1] += 240.0
    nodes = np.concatenate([section, z[..., None]], axis=-1).reshape(-1, 3)
    number = np.arange(len(nodes)).reshape(s.shape)
    ends = [(a, b, c) for c in (0, 1) for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))]
    elements = np.stack([number[a : a + 3, b : b + 2, c : c + 3].ravel() for a, b, c in ends], 1)
    return nodes, elements, corners + [0.0, 240.0]


@pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX (ccx) is not installed")
def test_centre_of_a_damper_with_incompatible_modes_and_unequal_angles(tmp_path):
    """Against the area and the centroid of the section, a polygon."""
    nodes, elements, section = wedge_of_unequal_angles()
    step = ["*STEP", "*FREQUENCY, SOLVER=MATRIXSTORAGE", "6,", "*END STEP", ""]
    run_job("\n".join([deck("C3D8I", nodes, elements, 2.1e5, 0.3, 7.8e-9), *step]), tmp_path, "job")
    body = read_calculix(tmp_path / "job")
    rows = np.argsort(3 * (body.dofs[:, 0] - 1) + body.dofs[:, 1] - 1)
    mass = body.mass[rows][:, rows]
    free = FreeBody(Structure(nodes, body.stiffness[rows][:, rows], mass), np.eye(3))

    following = np.roll(section, -1, axis=0)
    cross = section[:, 0] * following[:, 1] - section[:, 1] * following[:, 0]
    area = 0.5 * cross.sum()
    centroid = (cross[:, None] * (section + following)).sum(axis=0) / (6.0 * area)
    assert free.total_mass == pytest.approx(7.8e-9 * area * 30.0, rel=1e-7)
    np.testing.assert_allclose(free.centre, [*centroid, 15.0], rtol=1e-6)
    # translations and rotations about this centre are independent
    centre = np.array([*centroid, 15.0])
    motions = rigid_motions(nodes, centre, np.eye(3))
    momentum = motions[:, :3].T @ (mass @ motions[:, 3:])
    np.testing.assert_allclose(momentum, 0.0, atol=1e-7 * free.total_mass * np.abs(centre).max())
    force = free.centrifugal_load(np.array([0.0, 1.0, 0.0])).reshape(-1, 3).sum(axis=0)
    np.testing.assert_allclose(force, [centroid[0] / centroid[1], 1.0, 0.0], atol=1e-8)


@pytest.mark.slow
def test_patch_receptance_converges_while_a_node_does_not():
    patch, node = [], []
    for n in (1, 2, 4):
        body = damper(n, n, n, 2 * n)
        contact = averaging_matrix(body.body, wedge_patches(G, "left", 9))
        patch.append(body.receptance(contact))
        position = G.face_points([0.5 * G.face_length])[0]
        unit = np.zeros(body.body.n_dof)
        unit[3 * body.body.nearest_node(turn(0.5 * G.pitch) @ [*position, 0.0]) + 1] = 1.0
        node.append(unit @ body.elastic_response(unit))
    coarse, fine = (
        np.linalg.norm(patch[k + 1] - patch[k], 2) / np.linalg.norm(patch[2], 2) for k in (0, 1)
    )
    assert fine < 0.5 * coarse
    assert fine < 0.05  # four elements across the face
    assert np.all(np.diff([np.trace(p) for p in patch]) > 0.0)
    assert np.diff(node)[1] > np.diff(node)[0] > 0.0
