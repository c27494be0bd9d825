"""Modes without matrices: direction, pairing and length of shapes are recomputed, never taken from the file."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("skfem", reason="scikit-fem is not installed (extra bdamper[fe])")

from bdamper.fem.cyclic_symmetry import travelling_waves
from bdamper.fem.sector_faces import match_faces
from bdamper.importers import MassProperties, Modes
from bdamper.model.structure import turn
from bdamper.util.errors import BdamperError, BdamperWarning, ModelError
from tests.fe_bodies import contacts
from tests.imports import build
from tests.printed import said

N, ND, COUNT = 65, 5, 6
SETTINGS = {
    "n_blades": N, "faces": ("LOW", "HIGH"), "nodal_diameters": (ND,), "n_modes": COUNT, "n_damper_modes": 8,
    "contacts": contacts(), "locations": {"tip": 300},
}  # fmt: skip
HELD = SETTINGS | {"fixed": "BORE"}


def bare(body, **others):
    """The body without its matrices."""
    return replace(body, stiffness=None, mass=None, **others)


@pytest.fixture(scope="module")
def built(bodies):
    return build(*bodies, **HELD)


def shapes_of(fe, d, count=COUNT):
    omega2, shapes = fe.cyclic(d).modes(count)
    return np.sqrt(omega2) / (2 * np.pi), shapes.reshape(-1, 3, count)


def file_modes(fe, numbers, kind, scale=1.0):
    """Modes as a file may have them, and their modal masses."""
    out = []
    for d in (0, ND):
        hertz, shapes = shapes_of(fe, d)
        factor = scale * np.exp(np.linspace(-1.0, 1.0, COUNT))  # every mode of another length
        mass = factor**2
        shapes = shapes * factor
        if d and kind == "turned":
            shapes = shapes.conj() * np.exp(0.7j)
        elif d and kind == "mixed":
            shapes = np.where(np.arange(COUNT) % 2 == 0, shapes, shapes.conj())
        elif (
            d and kind == "pairs"
        ):  # real parts of the wave at two instants a quarter period apart, any mixture
            angle = 0.4
            pair = [
                (shapes * np.exp(1j * angle)).real,
                (shapes * np.exp(1j * (angle + np.pi / 2))).real,
            ]
            shapes = np.stack(pair, axis=3).reshape(*shapes.shape[:2], 2 * COUNT)
            hertz, mass = np.repeat(hertz, 2), np.repeat(mass, 2)
        elif d == 0 and kind != "plain":
            shapes = shapes * np.exp(0.3j)
        order = np.arange(len(numbers))[::-1]  # another order of the nodes
        out.append(Modes(d, hertz, numbers[order], shapes[order], mass, f"{kind}.modes"))
    return tuple(out)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["plain", "turned", "mixed", "pairs"])
def test_waves_are_put_in_the_agreed_direction_and_length(fe, bodies, built, kind):
    blade, damper = bodies
    given = bare(blade, modes=file_modes(fe, blade.numbers, kind))
    other = build(given, damper, **SETTINGS)
    for d in (0, ND):
        a, b = (m.model.bodies["blade"].bases[d] for m in (other, built))
        np.testing.assert_allclose(a.omega2, b.omega2[:COUNT], rtol=1e-8)
        # a wave is known up to a factor of modulus 1: compare what does not depend on it
        for mode in range(COUNT):
            u, v = a.contact_modes[..., mode].ravel(), b.contact_modes[..., mode].ravel()
            np.testing.assert_allclose(
                np.outer(u, u.conj()), np.outer(v, v.conj()), atol=1e-7 * np.abs(v).max() ** 2
            )
        assert a.flexibility is None
    text = said(other.summary())
    if kind == "turned":
        assert f"{COUNT} of them travelled the other way and were reversed" in text
    if kind == "pairs":
        assert f"{COUNT} were combined from pairs of real shapes" in text
    assert "static receptances of the blade (no matrices)" in text
    assert "modal mass from the file or the user (not checked)" in text


@pytest.mark.slow
def test_modes_beside_matrices_are_compared(fe, bodies, built):
    blade, damper = bodies
    given = replace(blade, modes=file_modes(fe, blade.numbers, "pairs"))
    other = build(given, damper, **HELD)
    agreed = f"nodal diameter {ND}: frequencies agree with pairs.modes within"
    assert any(agreed in line for line in other.checks)
    radians = tuple(replace(m, frequency=2 * np.pi * m.frequency) for m in given.modes)
    with pytest.raises(
        ModelError, match=r"expected the frequencies of pairs.modes.*1/\(2 pi\): radians per second"
    ):
        build(replace(given, modes=radians), damper, strict=True, **HELD)
    bent = given.modes[1].shapes.copy()
    low = np.flatnonzero(np.isin(given.modes[1].numbers, blade.node_sets["LOW"]))[3]
    bent[low] += 0.1 * np.abs(bent).max()
    wrong = replace(given, modes=(replace(given.modes[1], shapes=bent),))
    with pytest.warns(
        BdamperWarning, match=r"does not satisfy .* in either direction of travel \(off by .* %\)"
    ):
        found = build(wrong, damper, **HELD)
    assert found.model.hash == built.model.hash


def test_wrong_nodal_diameter_is_noticed(fe, bodies):
    blade, damper = bodies
    modes = file_modes(fe, blade.numbers, "plain")
    wrong = (modes[0], replace(modes[1], nodal_diameter=ND + 1))
    given = bare(blade, modes=wrong)
    with pytest.raises(
        ModelError,
        match=r"does not satisfy the phase condition between the two sector faces .* in either direction",
    ):
        build(given, damper, **SETTINGS | {"nodal_diameters": (ND + 1,)})


@pytest.mark.slow
@pytest.mark.parametrize(("factor", "found"), [(1e-4, r"0\.02\d+"), (1e6, r"2\.\d+e\+08")])
def test_frequencies_that_no_machine_has_are_said(fe, bodies, factor, found):
    """Of modes without matrices nothing else shows their unit: the lowest of the sector is some 280 Hz."""
    modes = tuple(
        replace(m, frequency=factor * m.frequency)
        for m in file_modes(fe, bodies[0].numbers, "plain")
    )
    given = bare(bodies[0], modes=modes), bodies[1]
    said = rf"blade .*nodal diameter [05]: expected a lowest frequency of 0\.1 to 5e\+06 Hz, found {found} Hz"
    with pytest.warns(BdamperWarning, match=said):
        built = build(*given, **SETTINGS)
    assert sum("a lowest frequency" in text for text in built.failed) == 2, (
        "at both nodal diameters"
    )
    with pytest.raises(ModelError, match=said):
        build(*given, strict=True, **SETTINGS)
    assert not build(*given, check_units=False, **SETTINGS).failed


@pytest.mark.slow
def test_damper_from_mass_properties(fe, bodies, built):
    """Without matrices: rigid from mass, centre and inertia; contact stiffness of the user goes into the model."""
    blade, damper = bodies
    theirs = built.model.bodies["damper"]
    given = bare(damper, rigid=MassProperties(theirs.mass, theirs.centre, theirs.inertia))
    pairs = [replace(c, stiffness=(1e8, 2e8, 3e8)) for c in contacts()]
    other = build(blade, given, **HELD | {"contacts": pairs})
    body = other.model.bodies["damper"]
    assert body.bases[0].n_modes == 6
    u, v = (b.bases[0].contact_modes[..., :6].reshape(-1, 6) for b in (body, theirs))
    np.testing.assert_allclose(u @ u.T, v @ v.T, atol=1e-8 * (v @ v.T).max())
    np.testing.assert_allclose(body.load.generalised[:6], theirs.load.generalised[:6], atol=1e-9)
    np.testing.assert_array_equal(
        other.model.contact["left"].stiffness, np.tile([1e8, 2e8, 3e8], (9, 1))
    )
    assert "elastic deformation of the damper (no matrices)" in said(other)


@pytest.mark.slow
@pytest.mark.parametrize(
    "centre", [np.zeros(1), np.zeros(2), np.array([0.0, np.nan, 0.0])], ids=["one", "two", "nan"]
)
def test_the_centre_of_a_rigid_damper_has_three_finite_coordinates(fe, bodies, centre):
    blade, damper = bodies
    rigid = bare(damper, rigid=MassProperties(0.05, centre, 1e-6 * np.eye(3)))
    with pytest.raises(BdamperError, match="mass properties: expected a mass > 0, a centre"):
        build(blade, rigid, **HELD)


BAD = [
    (lambda m: replace(m, modal_mass=None), "modal masses .or matrices. to rescale"),
    (lambda m: replace(m, frequency=-m.frequency), "frequencies > 0 of a constrained sector"),
    (
        lambda m: replace(m, nodal_diameter=7),
        "expected modes of nodal diameter 5 once, found modes of",
    ),
    (lambda m: replace(m, numbers=m.numbers + 5000), "expected nodes of this body, found none"),
    (lambda m: replace(m, numbers=m.numbers[:260], shapes=m.shapes[:260]), "values"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("change", "message"), BAD, ids=[m for _, m in BAD])
def test_bad_modes(fe, bodies, change, message):
    blade, damper = bodies
    modes = file_modes(fe, blade.numbers, "plain")
    given = bare(blade, modes=(modes[0], change(modes[1])))
    with pytest.raises(ModelError, match=message):
        build(given, damper, **SETTINGS)


def test_modes_check_themselves():
    good = {
        "nodal_diameter": 1,
        "frequency": np.ones(2),
        "numbers": np.arange(3),
        "shapes": np.ones((3, 3, 2)),
    }
    for change in (
        {"nodal_diameter": -1},
        {"frequency": np.ones(3)},
        {"numbers": np.zeros(3, int)},
        {"shapes": np.full((3, 3, 2), np.nan)},
        {"modal_mass": np.zeros(2)},
    ):
        with pytest.raises(ModelError, match="expected"):
            Modes(**{**good, **change})


def test_one_real_shape_alone_is_no_wave():
    nodes = np.array([[np.sin(a), np.cos(a), 0.0] for a in (-np.pi / 6, np.pi / 6)])
    wave = np.array([1.0, 0.0, 0.0])
    shape = np.concatenate([wave, turn(np.pi / 3) @ wave * np.exp(1j * np.pi / 3)])[:, None]
    assert len(nodes) == 2
    faces = match_faces(nodes, np.array([0]), np.array([1]), 6)
    for u, turned in ((shape, 0), (shape.conj(), 1)):
        found = travelling_waves(np.array([100.0]), u, faces, 1)
        assert found.turned == turned
        np.testing.assert_allclose(found.shapes, shape)
    with pytest.raises(ValueError, match="has no partner of the same frequency"):
        travelling_waves(np.array([100.0]), shape.real, faces, 1)
    both = np.hstack([shape.real, 0.7 * shape.real + 0.7 * shape.imag])
    found = travelling_waves(np.array([100.0, 100.0]), both, faces, 1)
    np.testing.assert_allclose(
        np.abs(np.vdot(found.shapes, shape)), np.linalg.norm(found.shapes) * np.linalg.norm(shape)
    )
    assert found.combined == 1
