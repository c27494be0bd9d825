"""Forces and responses of imported models off resonance, beside direct solutions of the full matrices.

Modes alone leave out the static residual of a location; the control of each test shows what that is worth.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse.linalg import splu

pytest.importorskip("skfem", reason="scikit-fem is not installed (extra bdamper[fe])")

import bdamper as bd
from bdamper.fem import LocalSizes
from bdamper.importers import over_speed
from bdamper.model.model_file import load_model, save_model
from bdamper.response.linear_limits import resonance_interval
from tests.annulus import Annulus, small_sector, wheel_matrices
from tests.fe_bodies import FIRST_NUMBER, SIX_BLADES, blade_and_damper, contacts
from tests.imports import build

N, MODES, TOP = 6, 10, 900.0
RATIOS = (0.2, 0.5, 0.8, 1.15, 1.3)
"""Frequencies over the lowest one."""
PAIRS = [("tip", "tip"), ("side", "side"), ("tip", "side")]
SETTINGS = SIX_BLADES | {"nodal_diameters": (0, 1, 2, 3), "n_modes": 16, "contacts": contacts(4)}
X, Z = "tangential", "axial"


@pytest.fixture(scope="module")
def fe():
    return small_sector(N, disk=0.3)


@pytest.fixture(scope="module")
def nodes(fe):
    """A corner of the tip, and a node of the airfoil on one side of it."""
    blade = fe.blade.nodes
    tip = np.flatnonzero(blade[:, 1] > blade[:, 1].max() - 1e-9)
    middle = fe.blade_part().nodes[np.argsort(blade[fe.blade_part().nodes, 1])[-40]]
    return {"tip": int(tip[np.argmin(blade[tip, 0])]), "side": int(middle)}


@pytest.fixture(scope="module")
def built(fe, nodes):
    places = {name: node + FIRST_NUMBER for name, node in nodes.items()}
    settings = {**SETTINGS, "blade_nodes": "BLADE", "local_sizes": LocalSizes(12, 4, 16)}
    return build(*blade_and_damper(fe), **settings, locations=places)


def study(model, pair, engine_order, **settings):
    force, read = pair
    own = {
        "blade_modes": MODES,
        "damping_ratio": 0.0,
        "contact_stiffness": 1e7,
        "friction_coefficient": 0.3,
    }
    own |= {"response": bd.Response(read, direction=X), "harmonics": 1, **settings}
    return bd.Study(model, bd.Excitation(force, direction=Z), engine_order, **own)


def without(model):
    """The model with its modes alone."""

    def cut(basis):
        n = basis.n_natural
        places = {name: rows[:, :n] for name, rows in basis.locations.items()}
        modes = {
            "omega2": basis.omega2[:n],
            "damping_ratio": basis.damping_ratio[:n],
            "locations": places,
        }
        return replace(
            basis,
            **modes,
            contact_modes=basis.contact_modes[..., :n],
            static_shapes=None,
            speed=None,
        )

    blade = model.bodies["blade"]
    bases = {d: cut(basis) for d, basis in blade.bases.items()}
    return replace(model, bodies={**model.bodies, "blade": replace(blade, bases=bases, local=None)})


def direct(sector, nodes, omega):
    """(len(PAIRS), n) response of the full matrices of a sector along X by 1 N along Z."""
    T = sector.transformation.toarray()
    forces = np.array([T[3 * nodes[force] + 2].conj() for force, _ in PAIRS]).T
    rows = np.array([T[3 * nodes[read]] for _, read in PAIRS])
    out = []
    for w in omega:
        factor = splu((sector.stiffness - w**2 * sector.mass).tocsc(), permc_spec="MMD_AT_PLUS_A")
        out.append(np.einsum("ki,ik->k", rows, factor.solve(forces)))
    return np.array(out).T


def found(asked, omega):
    """(n,) response without contact."""
    problem = asked.problem
    linear, row = problem.system(0.0).structure.linear, problem.response_rows[1]
    return np.array([linear.response(w, None) @ row for w in omega])


def errors(response, exact):
    return np.abs(response / exact - 1.0)


@pytest.mark.slow
@pytest.mark.parametrize("d", [0, 2, 3])
def test_a_sector(fe, built, nodes, d):
    omega = np.sqrt(fe.cyclic(d).modes(1)[0][0]) * np.array(RATIOS)
    exact = direct(fe.cyclic(d), nodes, omega)
    for pair, response in zip(PAIRS, exact):
        assert errors(found(study(built.model, pair, d or N), omega), response).max() < 1e-5
    alone = errors(found(study(without(built.model), PAIRS[0], d or N), omega), exact[0])
    assert alone.max() > 0.05 and alone.min() > 0.01


@pytest.mark.slow
def test_a_study_counts_modes_and_residual_vectors_apart(built):
    """Two places, each with a vector; the static shapes of the model are no modes."""
    asked = study(built.model, PAIRS[0], 2)
    n_vectors = sum(len(kept) for kept in asked.problem.coupling.modes.values()) - MODES - 6
    n_natural = built.model.bodies["blade"].bases[2].n_natural
    assert n_vectors > 0 and built.model.bodies["blade"].bases[2].n_modes > n_natural
    vectors = f"{n_vectors} residual vector{'s' if n_vectors > 1 else ''}"
    assert f"(blade {MODES} of {n_natural} modes and {vectors}, damper 6 of " in str(asked)


@pytest.mark.slow
def test_at_speed(fe, nodes):
    """Stiffness linear in the squared speed; full matrices at a speed between those given."""
    blade, damper = blade_and_damper(fe)
    rotation, (d, omega_rotor) = fe.rotation(), (2, 0.6 * TOP)
    fast = replace(blade, stiffness=blade.stiffness + TOP**2 * rotation.per_squared_speed)
    settings = {**SETTINGS, "nodal_diameters": (0, d)}
    places = {name: node + FIRST_NUMBER for name, node in nodes.items()}
    model = build(over_speed({0.0: blade, TOP: fast}), damper, **settings, locations=places).model
    sector = rotation.at_speed(fe.cyclic(d), omega_rotor)
    omega = np.sqrt(sector.modes(1)[0][0]) * np.array(RATIOS)
    assert omega[0] / np.sqrt(fe.cyclic(d).modes(1)[0][0]) / RATIOS[0] > 1.02  # the speed matters
    exact, running = direct(sector, nodes, omega), model.at_speed(omega_rotor)
    for pair, response in zip(PAIRS, exact):
        assert errors(found(study(running, pair, d), omega), response).max() < 1e-3
    assert errors(found(study(without(running), PAIRS[0], d), omega), exact[0]).max() > 0.05


@pytest.mark.slow
@pytest.mark.parametrize("deviation", [pytest.param(0.0, marks=pytest.mark.slow), 0.03])
def test_a_wheel(fe, built, nodes, deviation):
    """Equal and unequal blades in a wheel beside the matrices of all sectors, put together in one global frame.

    That the equations of a wheel are those of its local basis show the tests of `bdamper.mistuning`.
    """
    annulus, own = Annulus(fe), deviation * np.random.default_rng(5).normal(size=N)
    full, local = annulus.matrices(own), built.model.bodies["blade"].local
    assert local.n_attachment == 4 + 6
    reduced, wave = wheel_matrices(local, N, own), np.exp(2j * np.pi * 2 * np.arange(N) / N)
    rows = np.array([o[3 * nodes["tip"] + 2].toarray()[0, annulus.moving] for o in annulus.own])
    own_rows = np.kron(np.eye(N), local.locations["tip"][2])
    modes, alone = np.tile(~np.isin(np.arange(local.n), np.arange(16, 22)), N), []
    for omega in np.sqrt(fe.cyclic(2).modes(1)[0][0]) * np.array(RATIOS):
        k, m = full
        factor = splu((k - omega**2 * m).tocsc(), permc_spec="MMD_AT_PLUS_A")
        exact = rows @ factor.solve(rows.T) @ wave
        Z = reduced[0] - omega**2 * reduced[1]
        assert errors(own_rows @ np.linalg.solve(Z, wave @ own_rows), exact).max() < 0.01
        fewer = own_rows[:, modes] @ np.linalg.solve(
            Z[np.ix_(modes, modes)], (wave @ own_rows)[modes]
        )
        alone.append(errors(fewer, exact).max())
    assert min(alone) > 0.03


@pytest.mark.slow
def test_they_are_no_modes(built, tmp_path):
    """Counts, ranges and names of modes; a file keeps them, and one without them reads as before."""
    model, asked = built.model, study(built.model, PAIRS[2], 2, blade_modes=1)
    basis = asked.problem.bases[1]
    assert [c.name for c in basis.coordinates if c.body == "blade"] == [
        "mode 1",
        "static shape 1",
        "static shape 2",
    ]
    assert asked.settings.most_modes("constrained") == 16
    with pytest.raises(bd.SettingError, match="mode: expected 1 to 1"):
        resonance_interval(asked.problem.at(1.0), 2)
    assert len(built.frequencies[2]) == 16 and "16 modes at nodal diameters 0, 1, 2, 3" in str(
        model
    )
    same = study(built.model, PAIRS[0], 2, response=None)
    assert (
        same.problem.bases[1].n_modes
        - study(without(model), PAIRS[0], 2, response=None).problem.bases[1].n_modes
        == 1
    )
    save_model(model, tmp_path / "own.h5")
    assert load_model(tmp_path / "own.h5").hash == model.hash
    plain = without(model)
    save_model(plain, tmp_path / "plain.h5")
    back = load_model(tmp_path / "plain.h5")
    assert back.hash == plain.hash and back.bodies["blade"].bases[2].static_shapes is None
