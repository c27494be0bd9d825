"""Where a damper is drawn, which way the rotor turns and along which axis it stands makes no difference to the model."""

import re
import warnings
from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

pytest.importorskip("skfem", reason="scikit-fem is not installed (extra bdamper[fe])")

import bdamper as bd
from bdamper.fem.generated_models import wedge_patches
from bdamper.importers import ContactFaces
from bdamper.importers.prepared_body import Placement
from bdamper.model.structure import turn
from tests.annulus import small_sector
from tests.fe_bodies import SIX_BLADES, contacts
from tests.imports import build

N = 6
SETTINGS = SIX_BLADES | {"nodal_diameters": (0, 1, 2, 3), "n_modes": 6, "contacts": contacts(4)}


@pytest.fixture(scope="module")
def fe():
    return small_sector(N)


@pytest.fixture(scope="module")
def plain(bodies):
    """Both bodies as they were drawn."""
    return build(*bodies, **SETTINGS, locations={"mid": ("damper", bodies[1].nodes[7])})


def turned(body, rotation):
    """The body with its nodes and matrices in other axes, or turned about them."""
    blocks = sp.kron(sp.identity(len(body.numbers)), rotation, format="csr")
    moved = {key: blocks @ getattr(body, key) @ blocks.T for key in ("stiffness", "mass")}
    return replace(
        body,
        nodes=body.nodes @ rotation.T,
        **{k: sp.csr_matrix(0.5 * (m + m.T)) for k, m in moved.items()},
    )


def frequencies_and_modes(model):
    """What must not depend on how the model was drawn."""
    blade, damper = model.bodies["blade"].bases, model.bodies["damper"].bases[0]
    mobility = [
        np.einsum("pik,pjk->pij", b.contact_modes, b.contact_modes.conj())
        for b in (*blade.values(), damper)
    ]
    return (
        [b.omega2 for b in blade.values()],
        mobility,
        [i.points for i in model.interfaces.values()],
    )


def same(found, expected):
    for ours, theirs in zip(frequencies_and_modes(found), frequencies_and_modes(expected)):
        for a, b in zip(ours, theirs):
            np.testing.assert_allclose(a, b, rtol=1e-6, atol=1e-9 * np.abs(b).max())


@pytest.mark.slow
@pytest.mark.parametrize("sectors", [-1, 1, 2])
def test_a_damper_drawn_anywhere_is_moved_between_the_first_two_blades(bodies, plain, sectors):
    """At the other flank, beside the next blade, or further on."""
    blade, damper = bodies
    moved = turned(damper, turn(2.0 * np.pi / N * sectors))
    built = build(blade, moved, **SETTINGS, locations={"mid": ("damper", moved.nodes[7])})
    assert [i.sector_b for i in built.model.interfaces.values()] == [0, 1, 0, 0]
    same(built.model, plain.model)
    np.testing.assert_allclose(
        built.model.locations["mid"].position, plain.model.locations["mid"].position, atol=1e-12
    )
    moved_by = f"damper: {sectors:+d} sectors away in the mesh, moved between blades 0 and 1"
    assert moved_by in built.checks
    assert "sectors away" not in str(plain)


@pytest.mark.slow
def test_what_the_user_says_in_numbers_moves_along(fe, bodies):
    """Patches, and the sector of the other face."""
    blade, damper = bodies
    patches = [wedge_patches(fe.geometry, side, 4) for side in ("left", "right")]
    given = [
        replace(c, patches=p, sector_b=s) for c, p, s in zip(contacts(4), patches, (0, 1))
    ] + contacts(4)[2:]
    rotation = turn(-2.0 * np.pi / N)
    there = [
        replace(c, patches=c.patches.turned(rotation), sector_b=c.sector_b - 1) for c in given[:2]
    ] + given[2:]
    built = build(blade, turned(damper, rotation), **{**SETTINGS, "contacts": there})
    same(built.model, build(blade, damper, **{**SETTINGS, "contacts": given}).model)


@pytest.mark.slow
def test_contacts_may_be_given_from_the_blade(bodies, plain):
    """Which of two faces is named first does not matter where the model has the damper first."""
    swapped = [
        ContactFaces(c.name, c.faces_b, c.faces_a, "blade", "damper", points=4)
        for c in contacts(4)[:2]
    ]
    built = build(*bodies, **{**SETTINGS, "contacts": [*swapped, *contacts(4)[2:]]})
    assert {(i.body_a, i.body_b) for i in built.model.interfaces.values()} == {
        ("damper", "blade"),
        ("damper", "ground"),
    }
    same(built.model, plain.model)


def in_axes(body, axis, radial):
    """The body as a program has it whose rotor stands along ``axis``."""
    return turned(body, Placement(axis=axis, radial=radial).rotation.T)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("axis", "radial", "sense", "flank"),
    [
        *(
            pytest.param((1, 0, 0), (0, 1, 0), *how, marks=pytest.mark.slow)
            for how in ((1, 0), (1, -1), (-1, 0))
        ),
        ((1, 0, 0), (0, 1, 0), -1, -1),
        ((0, 1, 0), (1, 0, 0), -1, -1),
        ((0, 0, 1), (0, 1, 0), 1, -1),
    ],
)
def test_every_import_for_a_wheel_is_one(bodies, axis, radial, sense, flank):
    """Backward: the rotor turns against the axis along which it was drawn, so that the sectors count the other way."""
    wheel = wheel_of(bodies, axis, radial, sense, flank)
    assert wheel.n_blades == N
    assert np.bincount(wheel.structure.sector[:8]).tolist() == [4, 4]


def wheel_of(bodies, axis, radial, sense, flank):
    blade = in_axes(bodies[0], axis, radial)
    damper = in_axes(turned(bodies[1], turn(2.0 * np.pi / N * flank)), axis, radial)
    settings = {
        **SETTINGS,
        "axis": sense * np.array(axis, float),
        "radial": radial,
        "blade_nodes": "BLADE",
    }
    tip = int(bodies[0].numbers[bodies[0].nodes[:, 1].argmax()])
    model = build(blade, damper, **settings, locations={"tip": tip}).model
    return bd.BladedDisk(
        bd.Study(model, bd.Excitation("tip"), engine_order=1, friction_coefficient=0.3, harmonics=1)
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("points", "warned"),
    [((2, 2), True), ((2, 6), True), (10, True), (1, True), ((3, 2), False), (9, False)],
)
def test_two_rows_of_points_let_a_damper_roll(bodies, points, warned):
    """Along t1, on faces with friction; the constraint planes of the settings have two."""
    pairs = [replace(c, points=points) for c in contacts(4)[:2]] + contacts(4)[2:]
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        build(*bodies, **{**SETTINGS, "contacts": pairs})
    found = [str(w.message) for w in caught if "rows of contact points" in str(w.message)]
    assert [text.split(":")[0] for text in found] == ["contact 'left'", "contact 'right'"] * warned
    assert all("plausible at least 3" in text and re.search("found [12]:", text) for text in found)
