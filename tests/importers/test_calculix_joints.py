"""Shroud, two dampers and a blade root from decks of CalculiX to an optimum and a curve (docs/joints.md).

The decks are written here, CalculiX stores the matrices, :func:`bdamper.importers.build_model` joins the bodies.
"""

import shutil
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("skfem", reason="scikit-fem is not installed (extra bdamper[fe])")

import bdamper as bd
from bdamper.fem.meshes import ElasticMaterial, discretise, join_blocks
from bdamper.importers import ContactFaces, read_calculix
from examples.calculix.decks import matrix_input, run_job, sector_input
from tests.calculix_runs import free_input, read_frequencies
from tests.imports import build
from tests.printed import said
from tools.shrouded import meshes, modes_alone, shrouded

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX (ccx) is not installed"),
]
N, D = 36, 4


def stuck_frequencies(study):
    """Hz, with springs at all contact points."""
    springs = np.concatenate(
        [study.problem.stiffness[name].stiffness for name in study.problem.coupling.interfaces]
    )
    return study.problem.system(0.0).structure.linear.modes(springs)[0] / (2.0 * np.pi)


# -----------------------------------------------------------------------------------------------------------
# A tip shroud and two strip dampers


@pytest.fixture(scope="module")
def strips(tmp_path_factory):
    folder = tmp_path_factory.mktemp("strips")
    for name, (made, sets) in meshes().items():
        run_job(matrix_input(made, sets, "bore" if name == "blade" else None), folder, name)
    blade, front, rear = (read_calculix(folder / name) for name in ("blade", "front", "rear"))
    return build(
        blade, {"front": front, "rear": rear}, n_blades=N, faces=("LOW", "HIGH"), fixed="BORE",
        contacts=[
            ContactFaces("shroud", "SHROUD_HIGH", "SHROUD_LOW", "blade", "blade", points=(1, 4), sector_b=1),
            ContactFaces("front_left", "LEFT", "UNDER_RIGHT", "front", "blade", points=(2, 2)),
            ContactFaces("front_right", "RIGHT", "UNDER_LEFT", "front", "blade", points=(2, 2)),
            ContactFaces("rear_left", "LEFT", "UNDER_RIGHT", "rear", "blade", points=(2, 2)),
            ContactFaces("rear_right", "RIGHT", "UNDER_LEFT", "rear", "blade", points=(2, 2)),
        ],
        locations={"tip": (0.0, 0.345, 0.0), "middle": (0.0, 0.297, 0.0)},
        engine_order=D, harmonics=1, n_modes=12, n_damper_modes={"front": 8},
    )  # fmt: skip


def study_of(model, place):
    loads = {"load_per_preload": {"front": 1.0, "rear": 0.6}, "constant_loads": {"shroud": 5.0}}
    return bd.Study(
        model,
        bd.Excitation(place, amplitude=1.0),
        engine_order=D,
        harmonics=1,
        blade_modes=6,
        **loads,
    )


def test_decks_give_the_model_of_the_arrays(strips):
    """CalculiX integrates the same elements by itself and rounds what it writes."""
    own = shrouded()
    for d, frequencies in strips.frequencies.items():
        np.testing.assert_allclose(frequencies, own.frequencies[d], rtol=1e-7)
    for name in ("front", "rear"):
        a, b = strips.model.bodies[name], own.model.bodies[name]
        assert a.mass == pytest.approx(b.mass, rel=1e-6)
        np.testing.assert_allclose(a.bases[0].omega2[6:8], b.bases[0].omega2[6:8], rtol=1e-6)
    decks, arrays = (study_of(modes_alone(built.model), "tip") for built in (strips, own))
    # other builds of CalculiX round other digits: 2.4e-7 was seen with bonded faces
    np.testing.assert_allclose(
        stuck_frequencies(decks)[:6], stuck_frequencies(arrays)[:6], rtol=1e-6
    )
    # With this friction 16 of 20 points stick.  Where most points slip, the force on the shroud depends
    # on the way to the static state, by up to 1e-3 of it; with a friction coefficient below 1e-4 rounding
    # decides whether a static state is found.
    found, expected = (
        study.replace(friction_coefficient=1.5).static(100.0).normal_force
        for study in (decks, arrays)
    )
    assert found == pytest.approx(expected, rel=1e-6)


@pytest.mark.nightly
def test_shroud_and_two_strips_have_an_optimum_over_the_load_of_the_strips(strips):
    study = study_of(strips.model, "middle")
    assert study.static(0.0).normal_force["shroud"] == pytest.approx(5.0, rel=1e-7), "as assembled"
    curve = study.optimal_curve([10.0, 30.0, 100.0, 300.0], frequency=(200.0, 3000.0), check=False)
    best = curve.optimum
    # at the lowest load the next resonance is higher at the end of the interval
    assert np.isfinite(curve.amplitude[1:]).all() and best.status == "complete"
    assert np.isfinite(curve.lower_bound[0])
    assert 10.0 < best.preload < 300.0, "between a shroud that does all and strips that stick"
    assert best.amplitude <= np.nanmin(curve.amplitude) < 1e-2 * curve.free.amplitude
    assert "loads per newton: front 1, rear 0.6" in said(curve)
    state = study.static(best.preload).normal_force
    assert state["rear_left"] + state["rear_right"] == pytest.approx(0.6 * best.preload, rel=0.03)
    assert 0.0 < state["shroud"] < 5.0, "the strips bend the platforms"


# -----------------------------------------------------------------------------------------------------------
# A blade held in the slot of its disk by two flanks at 45 degrees

SPEED, SLOPE, LENGTH = 500.0, np.tan(np.pi / N), 0.04
FLOOR, LOW, TOP, NECK, TIP = 0.226, 0.228, 0.234, 0.246, 0.34
LEVELS = np.array([FLOOR, LOW, 0.5 * (LOW + TOP), TOP])
WIDE, THIN = 0.006, 0.002


def flank(y):
    """Half the width of the root at a height."""
    return WIDE + TOP - y


def block(x, y):
    """Nodes (ni, nj, nk, 3) of a prism along Z from x (ni, nj) and heights y (nj,)."""
    z = np.linspace(-0.5 * LENGTH, 0.5 * LENGTH, 5)
    return np.stack(np.broadcast_arrays(x[..., None], y[None, :, None], z), axis=-1)


def disk_blocks():
    s = np.linspace(0.0, 1.0, 4)[:, None]
    lug = (1.0 - s) * flank(LEVELS) + s * SLOPE * LEVELS
    below = np.concatenate([-lug[::-1, 0], np.linspace(-lug[0, 0], lug[0, 0], 7)[1:-1], lug[:, 0]])
    y = np.linspace(0.2, FLOOR, 4)
    return [block(below[:, None] * y / FLOOR, y), block(lug, LEVELS), block(-lug[::-1], LEVELS)]


def blade_blocks():
    across = np.linspace(-1.0, 1.0, 7)[[0, 2, 3, 4, 6], None]
    neck, airfoil = np.linspace(TOP, NECK, 4), np.linspace(NECK, TIP, 9)
    root = block(across * flank(LEVELS[1:]), LEVELS[1:])
    return [
        root,
        block(across * WIDE + 0.0 * neck, neck),
        block(across[1:4] * WIDE + 0.0 * airfoil, airfoil),
    ]


def body(blocks):
    """Mesh, and sets of its nodes."""
    made = discretise(join_blocks(blocks), ElasticMaterial())
    x, y, _ = made.nodes.T
    distances = {
        "BORE": y - 0.2,
        "LOW": x + SLOPE * y,
        "HIGH": x - SLOPE * y,
        "LEFT": x + flank(y),
        "RIGHT": x - flank(y),
    }
    sets = {
        name: np.flatnonzero((np.abs(away) < 1e-9) & (y < TOP + 1e-9))
        for name, away in distances.items()
    }
    return made, {name: nodes for name, nodes in sets.items() if len(nodes)}


@pytest.fixture(scope="module")
def rooted(tmp_path_factory):
    """The model, and frequencies that CalculiX finds: of the sector in one piece, of the disk alone, of the blade alone."""
    folder = tmp_path_factory.mktemp("root")
    disk, on_disk = body(disk_blocks())
    blade, on_blade = body(blade_blocks())
    whole, on_whole = body(disk_blocks() + blade_blocks())
    run_job(matrix_input(disk, on_disk, "BORE"), folder, "disk")
    run_job(matrix_input(blade, on_blade), folder, "blade")
    run_job(free_input(blade, 9), folder, "free")
    for name, made, sets in (("cyclic_disk", disk, on_disk), ("whole", whole, on_whole)):
        faces = SimpleNamespace(independent=sets["LOW"], dependent=sets["HIGH"])
        sector = SimpleNamespace(
            blade=made, clamped=sets["BORE"], faces=faces, geometry=SimpleNamespace(n_blades=N)
        )
        run_job(sector_input(sector, D, 4), folder, name)
    built = build(
        read_calculix(folder / "disk"), {"airfoil": read_calculix(folder / "blade")}, n_blades=N,
        faces=("LOW", "HIGH"), fixed="BORE",
        contacts=[ContactFaces(side, side, side, "airfoil", "blade", points=(3, 4)) for side in ("LEFT", "RIGHT")],
        locations={"tip": ("airfoil", (0.0, TIP, 0.0))}, engine_order=D, harmonics=1, n_modes=12, n_damper_modes=30,
    )  # fmt: skip
    return built, {
        name: read_frequencies(folder / f"{name}.dat") for name in ("whole", "cyclic_disk", "free")
    }


def at_speed(built, **settings):
    """Study of the blade in its slot, at 500 rad/s."""
    given = {
        "excitation": bd.Excitation("tip", amplitude=1.0),
        "friction_coefficient": 0.2,
    } | settings
    study = bd.Study(
        built.model, engine_order=D, harmonics=1, damper_modes=6, blade_modes=12, **given
    )
    return study.at_speed(SPEED)


def test_disk_and_blade_alone_are_those_of_calculix(rooted):
    built, theirs = rooted
    np.testing.assert_allclose(built.frequencies[D][:4], theirs["cyclic_disk"][::2], rtol=1e-4)
    own = np.sqrt(built.model.bodies["airfoil"].bases[0].omega2[6:9]) / (2.0 * np.pi)
    np.testing.assert_allclose(own, theirs["free"][6:], rtol=1e-5)


def test_the_stuck_root_is_a_sector_in_one_piece(rooted):
    """Twelve points a flank give a little: most in the bending along the axis of rotation, the third."""
    built, theirs = rooted
    ours, bonded = stuck_frequencies(at_speed(built))[:4], theirs["whole"][::2]
    np.testing.assert_allclose(ours[[0, 1, 3]], bonded[[0, 1, 3]], rtol=2e-3)
    np.testing.assert_allclose(ours, bonded, rtol=0.02)
    assert np.all(ours < bonded)


@pytest.mark.parametrize("mu", [0.05, 0.2, 0.5])
def test_the_flanks_carry_the_centrifugal_force_of_the_blade(rooted, mu):
    """Mass and radius from the areas of root, neck and airfoil; both flanks slide like wedges of 45 degrees."""
    study = at_speed(rooted[0], friction_coefficient=mu)
    area = np.array(
        [(TOP - LOW) * (flank(LOW) + WIDE), 2.0 * WIDE * (NECK - TOP), 2.0 * THIN * (TIP - NECK)]
    )
    root = LOW + (TOP - LOW) * (flank(LOW) + 2.0 * WIDE) / (flank(LOW) + WIDE) / 3.0
    middle = [root, 0.5 * (TOP + NECK), 0.5 * (NECK + TIP)]
    force = ElasticMaterial().density * LENGTH * (area @ middle) * SPEED**2
    assert study.preload == pytest.approx(force, rel=1e-6)
    state = study.static(force)
    faces = study.model.interfaces.values()
    frames = np.concatenate([np.broadcast_to(face.frame, (face.n_points, 3, 3)) for face in faces])
    on_blade = np.einsum("pij,pi->j", frames, state.force * [1.0, 1.0, -1.0])
    np.testing.assert_allclose(on_blade, [0.0, -force, 0.0], rtol=1e-6, atol=1e-6 * force)
    for load in state.normal_force.values():
        assert load == pytest.approx(force / (np.sqrt(2.0) * (1.0 + mu)), rel=1e-6)


def test_friction_in_the_root_damps_a_large_motion_but_no_small_one(rooted):
    """A small force leaves what is closed stuck, but for points that the static load leaves at their friction limit: which
    ones is not determined, and hangs on rounding (0.968 to 1 of the stuck amplitude).  A large one makes flanks slip."""
    study = at_speed(rooted[0])
    stuck = study.stuck((300.0, 450.0)).peak
    with pytest.warns(bd.PlausibilityWarning, match="preload"):
        small = (
            study.replace(excitation=bd.Excitation("tip", amplitude=1e-3))
            .frequency_response(study.preload, (300.0, 450.0))
            .peak
        )
    assert small.frequency == pytest.approx(stuck.frequency, rel=1e-3)
    assert 0.95 * stuck.amplitude < 1e3 * small.amplitude < 1.001 * stuck.amplitude
    curve = study.replace(excitation=bd.Excitation("tip", amplitude=20.0)).frequency_response(
        study.preload, (300.0, 450.0)
    )
    assert curve.complete and curve.peak.frequency < 0.995 * stuck.frequency
    assert curve.peak.amplitude / 20.0 < 0.1 * stuck.amplitude
    assert rooted[1]["whole"][0] > stuck.frequency, "part of the flanks is open at rest"
