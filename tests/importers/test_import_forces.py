"""Fields of nodal forces: the sum of the same forces at each of their nodes, at waves of both senses."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

pytest.importorskip("skfem", reason="scikit-fem is not installed (extra bdamper[fe])")

import bdamper as bd
from bdamper.fem import SectorFE
from bdamper.importers.arrays import number_rows
from bdamper.model.model_file import load_model
from bdamper.util.errors import BdamperError
from tests.fe_bodies import FIRST_NUMBER, SPARSE, contacts, sector_and_damper
from tests.imports import build

RANDOM = np.random.default_rng(3)
FORCES = RANDOM.normal(size=(3, 3)) + 1j * RANDOM.normal(size=(3, 3))


@pytest.fixture(scope="module")
def given():
    fe = SectorFE(density=SPARSE)
    blade, damper = sector_and_damper(fe)
    high = np.argsort(fe.blade.nodes[:, 1])[-9::4]
    return blade, damper, FIRST_NUMBER + high


def built(given, forces, **other):
    blade, damper, numbers = given
    settings = {
        "n_blades": 65, "faces": ("LOW", "HIGH"), "fixed": "BORE", "nodal_diameters": (5,), "n_modes": 8,
        "contacts": contacts(4), "locations": {f"at_{k}": int(n) for k, n in enumerate(numbers)},
    }  # fmt: skip
    return build(blade, damper, forces=forces, **(settings | other)).model


@pytest.fixture(scope="module")
def model(given, tmp_path_factory):
    path = tmp_path_factory.mktemp("field") / "gust.csv"
    parts = np.stack([FORCES.real, FORCES.imag], axis=-1).reshape(3, 6)
    np.savetxt(
        path,
        np.column_stack([given[2], parts]),
        delimiter=",",
        header="node, Re x, Im x, ...",
        fmt="%.17g",
    )
    return built(given, {"gust": (given[2], FORCES), "file": str(path)})


def force(model, excitation, engine_order):
    settings = {
        "harmonics": 1,
        "contact_stiffness": "unit_traction",
        "fundamental_modes_only": True,
    }
    study = bd.Study(model, excitation, engine_order, response=bd.Response("at_0"), **settings)
    return study.problem.modal_force(1)[
        :8
    ]  # on the modes; each excitation has residual vectors of its own behind them


@pytest.mark.slow
@pytest.mark.parametrize("engine_order", [5, 60], ids=["forward", "backward"])
def test_a_field_is_the_sum_of_its_forces(model, engine_order):
    axes = ("tangential", "radial", "axial")
    points = [
        bd.Excitation(f"at_{k}", axis, abs(f), np.angle(f))
        for k in range(3)
        for axis, f in zip(axes, FORCES[k])
    ]
    summed = force(model, sum(points[1:], points[0]), engine_order)
    for name in ("gust", "file"):
        found = force(model, bd.Excitation(name), engine_order)
        np.testing.assert_allclose(found, summed, rtol=0.0, atol=1e-12 * np.abs(summed).max())
    scaled = force(model, bd.Excitation("gust", amplitude=2.0, phase=0.5), engine_order)
    np.testing.assert_allclose(
        scaled, 2.0 * np.exp(0.5j) * summed, rtol=0.0, atol=1e-12 * np.abs(summed).max()
    )


@pytest.mark.slow
def test_it_follows_units_and_axes_of_the_file(given):
    """The same forces in millimetres and tonnes about another axis."""
    blade, damper, numbers = given
    turn = np.array(
        [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]
    )  # axes of the file to those of the model
    other = []
    for body in (blade, damper):
        matrices = {
            name: 1e-3 * turned(getattr(body, name), turn) for name in ("stiffness", "mass")
        }
        other.append(replace(body, nodes=1e3 * body.nodes @ turn, **matrices))
    units = {"units": "mm-t-s", "axis": turn[2], "radial": turn[1], "contacts": contacts(4, 0.2)}
    plain = built(given, {"gust": (numbers, FORCES)})
    changed = built((*other, numbers), {"gust": (numbers, FORCES @ turn)}, **units)
    ways = [m.bodies["blade"].bases[5].locations["gust"] for m in (plain, changed)]
    mine, its = (np.abs(w[0] + 1j * w[1]) for w in ways)
    np.testing.assert_allclose(its, mine, rtol=1e-5, atol=1e-6 * mine.max())


def turned(matrix, turn):
    block = sp.kron(sp.eye_array(matrix.shape[0] // 3), turn)
    return sp.csr_matrix(block.T @ matrix @ block)


def test_it_is_kept_in_the_file_of_the_model(model, tmp_path):
    bd.save_model(model, tmp_path / "model.h5")
    again = load_model(tmp_path / "model.h5")
    assert (
        again.hash == model.hash
        and again.locations["gust"].kind == "forces"
        and again.locations["at_0"].kind is None
    )


def test_a_field_is_no_place_for_a_response(model):
    with pytest.raises(bd.SettingError, match="response: give a Response"):
        bd.Study(model, bd.Excitation("gust"), 5, harmonics=1)
    with pytest.raises(bd.SettingError, match="response location: expected one of"):
        bd.Study(model, bd.Excitation("gust"), 5, harmonics=1, response=bd.Response("gust"))


def test_a_bad_first_line_is_no_line_of_names(tmp_path):
    path = tmp_path / "field.csv"
    path.write_text("node, x, x, y, y, z, z\n1, 0, 0, 1, 0, 0, 0  # tip\n")
    assert number_rows(path, 7) == [[1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]]
    path.write_text("1, 0, 0, 1, 0, 0, O\n2, 0, 0, 1, 0, 0, 0\n")
    with pytest.raises(BdamperError, match="line 1: expected numbers"):
        number_rows(path, 7)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("field", "message"),
    [
        ("no/such/file.csv", "No such file|not found"),
        (((1, 2), np.ones((3, 3))), r"forces 'gust': expected \(node numbers"),
        (
            ((FIRST_NUMBER,), np.zeros((1, 3))),
            "forces 'gust': expected forces other than 0, found zeros only",
        ),
        (((5,), np.ones((1, 3))), "forces 'gust': expected numbers of existing nodes, found 5"),
    ],
)
def test_refusals(given, field, message):
    with pytest.raises((BdamperError, OSError), match=message):
        built(given, {"gust": field})
    with pytest.raises(
        bd.SettingError, match="location 'at_0': expected a name that forces do not have"
    ):
        built(given, {"at_0": (given[2], FORCES)})
