"""Stress sets of an import: those of the finite element model, CalculiX' own of modes, loads and rotation, and refusals."""

import shutil
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("skfem", reason="scikit-fem is not installed (extra bdamper[fe])")

from bdamper.fem.element_stress import von_mises_size
from bdamper.fem.generated_models import blade_points, bladed_disk, wedge_patches
from bdamper.importers import read_arrays, read_calculix
from bdamper.importers.abaqus import read_inp
from bdamper.importers.contact_faces import lay_contacts
from bdamper.importers.plausibility import check_material
from bdamper.importers.prepared_body import ImportReport, Placement, PreparedBody
from bdamper.util.errors import BdamperError, ModelError, PlausibilityWarning
from examples.calculix.decks import run_job
from tests.fe_bodies import FIRST_NUMBER, contacts
from tests.imports import build
from tests.own_sector import OUTPUT, OwnSector, deck, of_kind
from tests.printed import said

STEEL = (2.1e11, 0.3)
SETTINGS = {
    "n_blades": 65, "faces": ("LOW", "HIGH"), "fixed": "BORE", "nodal_diameters": (5,), "n_modes": 8,
    "n_damper_modes": 8, "contacts": contacts(4), "elasticity": STEEL,
}  # fmt: skip
needs_ccx = pytest.mark.skipif(
    shutil.which("ccx") is None, reason="CalculiX (ccx) is not installed"
)


@pytest.mark.slow
@needs_ccx
@pytest.mark.parametrize(
    "kind", ["C3D4", "C3D6", "C3D8", "C3D8R", "C3D8I", "C3D10", "C3D15", "C3D20", "C3D20R"]
)
def test_the_material_of_matrices_and_elements_of_calculix_is_the_same(kind, tmp_path):
    """To 0.6 % on a distorted block that is held at one side, of which CalculiX writes no rows."""
    grid = np.arange(4)
    nodes = (
        np.stack(np.meshgrid(grid, grid, grid, indexing="ij"), axis=-1).reshape(-1, 3).astype(float)
    )
    corners = np.array([0, 16, 20, 4, 1, 17, 21, 5])
    hexahedra = np.array(
        [corners + 16 * i + 4 * j + k for i in range(3) for j in range(3) for k in range(3)]
    )
    nodes += np.random.default_rng(1).uniform(-0.15, 0.15, nodes.shape)
    nodes, elements = of_kind(kind, 10.0 * nodes + [0.0, 100.0, 0.0], hexahedra)
    held = np.flatnonzero(nodes[:, 1] < 102.0)
    text = deck(kind, nodes, elements, 2.1e5, 0.3, 7.85e-9, {"HELD": held})
    step = [
        "*BOUNDARY",
        "HELD, 1, 3",
        "*STEP",
        "*FREQUENCY, SOLVER=MATRIXSTORAGE",
        "1",
        "*END STEP",
        "",
    ]
    run_job("\n".join([text, *step]), tmp_path, "block")
    body = PreparedBody(
        "block", read_calculix(tmp_path / "block"), Placement("mm-t-s"), ImportReport(strict=True)
    )
    check_material(body, None)
    assert float(body.report.checks[-1].split()[-2]) == pytest.approx(7850.0, rel=0.006)
    with pytest.raises(ModelError, match=f"of the elements {kind}"):
        check_material(body, (2.2e5, 0.3))


def same(found, expected, tolerance):
    """Within a share of the largest number of the array."""
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=tolerance * np.abs(expected).max())


@pytest.mark.slow
@pytest.mark.parametrize(
    "as_arrays",
    [
        pytest.param(False, id="bodies", marks=pytest.mark.slow),
        pytest.param(True, id="read_arrays"),
    ],
)
def test_it_is_that_of_the_finite_element_model(fe, bodies, as_arrays):
    """Rows of modes, contact forces and rotation to 1e-6, from bare matrices."""
    blade, damper = bodies
    at = blade_points(fe.blade, fe.geometry)
    settings = SETTINGS | {"stress": {"blade": FIRST_NUMBER + at}}
    patches = (wedge_patches(fe.geometry, side, 4) for side in ("left", "right"))
    settings["contacts"] = [
        *(replace(c, patches=p) for c, p in zip(contacts(4), patches)),
        *contacts(4)[2:],
    ]
    if as_arrays:
        blade, damper = (
            read_arrays(
                b.stiffness, b.mass, (b.numbers, b.nodes), elements=b.elements, sets=b.node_sets
            )
            for b in (blade, damper)
        )
    built = build(blade, damper, **settings)
    ours, own = built.model.stress["blade"], built.model.bodies["blade"]
    model = bladed_disk(4, n_modes=8, n_damper_modes=8, nodal_diameters=(5,), fe=fe, stress=True)
    theirs, reference = model.stress["blade"], model.bodies["blade"]
    order = np.argsort(at)  # sets come in the order of the nodes
    np.testing.assert_allclose(ours.points, theirs.points[order], atol=1e-12)
    np.testing.assert_array_equal(ours.nodes, FIRST_NUMBER + np.sort(at))
    assert ours.point_names[1] == f"blade node {FIRST_NUMBER + np.sort(at)[1]}"
    unnumbered = replace(built.model, stress={"blade": replace(ours, nodes=None)})
    assert unnumbered.hash == built.model.hash  # node numbers influence no result
    text = said(built.summary())
    assert "damper origin mass, centre and inertia from the mass matrix" in text
    assert "stiffness and mass matrix of the files, not compared with those of the program" in text
    normal, shear = ours.modes[0][:, :3, 0], ours.modes[0][:, 3:, 0]
    square = 0.5 * np.square(normal - np.roll(normal, 1, axis=1)).sum(axis=1) + 3.0 * np.square(
        shear
    ).sum(axis=1)
    k = int(square.argmax())
    place = ", ".join(f"{x:.6g}" for x in ours.points[k])
    assert (
        f"largest at node {FIRST_NUMBER + np.sort(at)[k]} at ({place}) in the file, lowest mode"
        in text
    )
    for d in (0, 5):
        # the sign of a mode is free
        shapes = [body.bases[d].contact_modes.reshape(-1, 8) for body in (own, reference)]
        sign = np.sign((shapes[0].conj() * shapes[1]).sum(axis=0).real)
        same(ours.modes[d] * sign, theirs.modes[d][order], 1e-6)
        same(ours.contact[d], theirs.contact[d][order], 1e-6)
    same(ours.static, theirs.static[order], 1e-6)
    np.testing.assert_allclose(ours.spread, theirs.spread[order], rtol=1e-5, atol=1e-9)
    np.testing.assert_array_equal(ours.near_contact, theirs.near_contact[order])


def test_points_at_a_contact_face_and_on_the_cut_faces(fe, bodies):
    """The first are known by the geometry, the second left out, which the report says."""
    blade, damper = bodies
    under, low = blade.node_sets["RIGHT_UNDERSIDE"], blade.node_sets["LOW"]
    tip = FIRST_NUMBER + fe.blade.nodes[:, 1].argmax()
    given = np.concatenate([under, low, [tip]])
    built = build(blade, damper, **SETTINGS, stress={"root": given})
    found = built.model.stress["root"]
    inner = np.setdiff1d(given, np.concatenate([low, blade.node_sets["HIGH"]]))
    np.testing.assert_allclose(found.points, fe.blade.nodes[inner - FIRST_NUMBER], atol=1e-12)
    assert found.counted[np.flatnonzero(inner == tip)].all()
    assert found.near_contact[np.isin(inner, under)].all()
    assert (
        f"stress 'root': {len(np.unique(given)) - len(inner)} nodes on the sector faces are omitted"
        in said(built.summary())
    )


@pytest.mark.slow
def test_nodes_inside_the_body_without_its_surface_draw_a_warning(bodies):
    """A section with its surface draws none: bending has its largest stress at the surface."""
    blade, damper = bodies
    (elements,) = blade.elements
    corners = np.searchsorted(blade.numbers, elements)
    inside = inner_corners(corners[:, :8], len(blade.numbers))
    assert len(inside) > 3
    around = np.unique(corners[np.isin(corners, inside[:3]).any(axis=1)])
    cut = np.concatenate([blade.node_sets["LOW"], blade.node_sets["HIGH"]])
    alone, complete = blade.numbers[inside[:3]], np.setdiff1d(blade.numbers[around], cut)
    words = r"stress 'root': plausible the largest stress at a surface node, found node \d+ inside the body; .* add"
    with pytest.warns(PlausibilityWarning, match=words):
        built = build(blade, damper, **SETTINGS, stress={"root": alone})
    assert "the set lacks the surface near it" in said(built.summary())
    built = build(blade, damper, **SETTINGS, stress={"root": complete})
    assert not any("inside the body" in line for line in built.missing)


def inner_corners(hexahedra, n_nodes):
    """Corners of hexahedra of which no face lies on the surface, from the number of elements at each corner."""
    sides = [(0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]
    faces = np.sort(np.concatenate([hexahedra[:, side] for side in sides]), axis=1)
    unique, count = np.unique(faces, axis=0, return_counts=True)
    outer = np.unique(unique[count == 1])
    return np.setdiff1d(np.unique(hexahedra), outer)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"stress": "NOWHERE"}, "stress 'NOWHERE': expected one of the sets"),
        (
            {"stress": "LOW"},
            "stress 'LOW': all nodes lie on the sector faces",
        ),
        (
            {"stress": "RIGHT_UNDERSIDE", "elasticity": None},
            "expected elastic constants in the file, or Sector",
        ),
        (
            {"stress": "RIGHT_UNDERSIDE", "elasticity": (2.1e11, 0.5)},
            "a Poisson's ratio above -1 and below 0.5",
        ),
        ({"stress": "RIGHT_UNDERSIDE", "elasticity": 2.1e11}, "elasticity: expected"),
    ],
)
def test_what_is_refused(bodies, settings, words):
    with pytest.raises(BdamperError) as error:
        build(*bodies, **SETTINGS | settings)
    assert words in str(error.value) and "\n" not in str(error.value)


def test_type_and_material_of_a_deck(tmp_path):
    """By section, with two materials; orthotropic ones are unknown."""
    lines = [
        "*NODE",
        *(
            f"{k}, {x}, {y}, {z}"
            for k, (x, y, z) in enumerate(np.random.default_rng(0).random((8, 3)), 1)
        ),
    ]
    for k, kind in enumerate(("C3D4", "C3D4H", "C3D8RH"), 1):
        lines += [
            f"*ELEMENT, TYPE={kind}, ELSET=E{k}",
            f"{k}, " + ", ".join(map(str, range(1, 9)[: 8 if k == 3 else 4])),
        ]
    lines += [
        "*MATERIAL, NAME=A",
        "*ELASTIC",
        "2.1e5, 0.3, 20.",
        "2.0e5, 0.3, 400.",
        "*MATERIAL, NAME=B",
    ]
    lines += ["*ELASTIC, TYPE=ENGINEERING CONSTANTS", "1., 1., 1., .3, .3, .3, 1., 1.", "1."]
    lines += [*(f"*SOLID SECTION, ELSET=E{k}, MATERIAL={m}" for k, m in enumerate("ABa", 1))]
    (tmp_path / "deck.inp").write_text("\n".join(lines))
    kinds = read_inp(tmp_path / "deck.inp").element_kinds
    assert [(k.name, k.youngs_modulus, k.poisson_ratio) for k in kinds] == [
        ("C3D4", 2.1e5, 0.3), ("C3D4", None, None), ("C3D8R", 2.1e5, 0.3),
    ]  # fmt: skip


# -----------------------------------------------------------------------------------------------------------
# A user's own sector


@pytest.fixture(scope="module", params=["C3D20R", pytest.param("C3D10", marks=pytest.mark.slow)])
def imported(request, tmp_path_factory):
    own, folder = OwnSector(request.param), tmp_path_factory.mktemp(request.param)
    own.write_and_run(folder)
    bodies = own.read(folder)
    built = build(
        *bodies, **own.settings, nodal_diameters=(4,), n_modes=10, stress={"root": "FILLET"}
    )
    return own, folder, bodies, built.model


@pytest.mark.slow
@needs_ccx
def test_modes_have_the_stress_of_calculix(imported):
    """At nodal diameter 4, where either direction and any phase may come."""
    own, folder, _, model = imported
    run_job(own.cyclic(own.steps_of_modes(4, 4)), folder, "nd4")
    ours = model.stress["root"].modes[4]
    for mode in range(4):
        theirs, fits = own.stress_of(folder / "nd4.frd", mode), []
        for mine in (ours[..., mode], ours[..., mode].conj()):
            scale = np.vdot(mine, theirs) / np.vdot(mine, mine)
            fits.append(
                (
                    von_mises_size(theirs - scale * mine).max() / von_mises_size(theirs).max(),
                    abs(scale),
                )
            )
        error, size = min(fits)
        assert error < 1e-3
        assert size == pytest.approx(1000.0**-0.5, rel=1e-4)  # their modal mass is one tonne


@pytest.mark.slow
@needs_ccx
def test_a_unit_contact_force_and_rotation_have_the_stress_of_calculix(imported):
    """Of nodal diameter 0: what modes and the contact vectors carry together, and the centrifugal load."""
    own, folder, bodies, model = imported
    basis, rows = model.bodies["blade"].bases[0], model.stress["root"]
    place = Placement(own.units, own.axis, own.radial)
    prepared = {
        name: PreparedBody(name, body, place) for name, body in zip(("blade", "damper"), bodies)
    }
    laid = lay_contacts(own.settings["contacts"], prepared, own.geometry.n_blades)
    force = np.random.default_rng(0).standard_normal(3 * 12)
    nodal = (laid.rows["blade"].T @ force).reshape(-1, 3) @ own.axes.T
    loads = [
        f"{n + 1}, {i + 1}, {f[i]:.12e}" for n, f in enumerate(nodal) for i in range(3) if f[i]
    ]
    axis = ", ".join(map(str, own.axis))
    steps = ["*STEP", "*STATIC", "*CLOAD", *loads, *OUTPUT]
    steps += [
        "*STEP",
        "*STATIC",
        "*CLOAD, OP=NEW",
        "*DLOAD",
        f"BODY, CENTRIF, 90000., 0., 0., 0., {axis}",
        *OUTPUT,
    ]
    run_job(own.cyclic(steps), folder, "static")
    modal = basis.contact_modes.reshape(-1, basis.n_modes).T @ force / basis.omega2
    ours = rows.modes[0] @ modal + rows.contact[0] @ force
    theirs = own.stress_of(folder / "static.frd")
    assert von_mises_size(ours - theirs).max() < 2e-3 * von_mises_size(theirs).max()
    alone = rows.modes[0] @ modal
    assert von_mises_size(alone - theirs).max() > 0.02 * von_mises_size(theirs).max(), (
        "the modes alone would not do"
    )
    theirs = own.stress_of(folder / "static.frd", 1)
    assert (
        von_mises_size(90000.0 * rows.static - theirs).max() < 2e-3 * von_mises_size(theirs).max()
    )
