"""What a study carries with an effect switched off: unknowns, points, kernels, and what remains of the equations."""

import pickle
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import bdamper as bd
from bdamper.contact.laws import LAW_CONSTANT
from bdamper.contact.preload_state import OPEN
from bdamper.harmonic_balance.effects import ASSUMED
from bdamper.harmonic_balance.equations import OK, Correction
from bdamper.model.contact_points import group_patches, unite_contact_points
from bdamper.response.response_curve import notes, why_no_solution
from tests import models
from tests.each import each
from tests.plain import plain_study
from tests.printed import said

PRELOAD = 300.0


@pytest.fixture(scope="module")
def model():
    return models.wedge_model(1, n_points=6, harmonics=5)


@pytest.fixture(scope="module")
def full(model):
    return plain_study(
        model,
        bd.Excitation("tip"),
        engine_order=2,
        friction_coefficient=0.4,
        harmonics=3,
        damper_modes=1,
        blade_modes=4,
    )


# n modes: 4 of the blade, 6 + 1 of the damper; points: 2 faces of 6 with friction, 2 planes of 3
COUNTS = [
    ({}, 11 * 7, 18),
    ({"harmonics": 1}, 11 * 3, 18),
    ({"harmonics": (1, 3)}, 11 * 5, 18),
    ({"bias": False}, 11 * 6, 18),
    ({"rigid_modes": bd.RIGID_NAMES[:3]}, 8 * 7, 18),
    ({"rigid_modes": ("TX", "TY", "TZ", "RX", "RY")}, 10 * 7, 18),
    ({"rigid_modes": ("TX", "TY", "RX", "RY", "RZ")}, 10 * 7, 18),
    ({"damper_modes": 0}, 10 * 7, 18),
    ({"blade_modes": 2}, 9 * 7, 18),
    ({"constraint_planes": False}, 11 * 7, 12),
    ({"contact_points": 2}, 11 * 7, 10),
    ({"fundamental_modes_only": True}, 11 * 7, 18),
    (
        {
            "harmonics": 1,
            "bias": False,
            "rigid_modes": bd.RIGID_NAMES[:3],
            "damper_modes": 0,
            "constraint_planes": False,
        },
        14,
        12,
    ),
]


@each(("changes", "unknowns", "points"), COUNTS, ids=lambda v: str(v))
def test_unknowns_and_points_of_an_effect_that_is_off_are_gone(full, changes, unknowns, points):
    system = full.replace(**changes).problem.system(PRELOAD)
    assert (system.n_unknowns, system.n_points) == (unknowns, points)


def test_every_evaluation_of_a_curve_is_counted(full):
    """Contact laws are evaluated once for each point of the system and each evaluation of the residual."""
    cheap = full.replace(harmonics=1, damper_modes=0)
    for study in (full, cheap):
        curve = study.frequency_response(5000.0, (780.0, 880.0))
        assert curve.complete
        # one Jacobian for each corrector iteration, and one for the tangent of each point
        assert curve.cost.evaluations >= curve.cost.jacobians >= curve.cost.iterations + len(curve)
        assert curve.unknowns.shape[1] == study.problem.system(5000.0).n_unknowns


def state_of(study, rng, size=3e-6):
    system = study.problem.system(PRELOAD)
    u = size * rng.standard_normal(system.n_unknowns)
    if study.settings.bias:
        u[: system.n_mean] = study.static(PRELOAD).q
    return system, u


def embedded(cheap, rich, u, study):
    """Unknowns of the richer system: those of the cheap one where there are any, else rest."""
    out = np.zeros(rich.n_unknowns)
    out[: rich.n_mean] = study.static(PRELOAD).q
    for l in range(cheap.n_harmonics + 1):
        for a, b in zip(cheap.layout.slices(l), rich.layout.slices(l)):
            if a.stop > a.start:
                out[b] = u[a]
    return out


@pytest.mark.parametrize(
    "changes", [{"harmonics": (1, 3)}, {"harmonics": 2}, {"bias": False}], ids=str
)
def test_equations_that_remain_are_those_of_the_full_system(full, changes):
    rng = np.random.default_rng(1)
    study = full.replace(**changes)
    cheap, u = state_of(study, rng)
    rich = full.problem.system(PRELOAD)
    r, J, d = cheap.evaluate(u, 2000.0)
    R, K, D = rich.evaluate(embedded(cheap, rich, u, study), 2000.0)
    index = np.flatnonzero(embedded(cheap, rich, np.ones(len(u)), study) == 1.0)
    assert len(index) == len(u)
    scale = np.abs(R).max()
    np.testing.assert_allclose(r, R[index], atol=1e-11 * scale)
    np.testing.assert_allclose(J, K[np.ix_(index, index)], rtol=1e-9, atol=1e-9 * np.abs(K).max())
    np.testing.assert_allclose(d, D[index], rtol=1e-12, atol=1e-14)


@pytest.mark.slow
def test_without_separation_the_normal_spring_is_two_sided(full):
    rng = np.random.default_rng(2)
    gap = np.linspace(0.0, 1e-7, 6)
    study = full.replace(separation=False).replace(gap={"left": gap, "right": gap})
    closed = ~(study.static(PRELOAD).status == OPEN).any(axis=1)
    friction = np.arange(18) < 12
    system, u = state_of(study, rng, 3e-5)
    X, F, share = system.contact(u)
    n = int((closed | ~friction).sum())
    held = np.flatnonzero(closed & friction)
    assert system.n_points == n + len(held)
    both = F[: len(held), 2] - F[n:, 2]
    assert (study.problem.point_gaps[held] > 0.0).any(), (
        "no closed point has a gap: the test saw nothing"
    )
    expected = study.problem.point_stiffness[held, 2, None] * X[: len(held), 2]
    expected[:, 0] -= study.problem.point_stiffness[held, 2] * study.problem.point_gaps[held]
    np.testing.assert_allclose(both, expected, atol=1e-9 * np.abs(expected).max())
    assert np.abs(F[n:]).max() > 1e-3 * np.abs(F).max(), "no point was pulled: the test saw nothing"
    assert (share[: len(held), 4] > 0.0).any()


def test_constant_normal_load_limits_friction_by_its_static_value(full):
    rng = np.random.default_rng(3)
    study = full.replace(variable_normal_load=False)
    assert not bd.Effects.of(study)["separation"]
    state = study.static(PRELOAD)
    system, u = state_of(study, rng, 3e-5)
    X, F, share = system.contact(u)
    held = np.flatnonzero(~(state.status[:12] == OPEN).any(axis=1))
    friction = slice(0, len(held))
    assert (system.structure.points.law[friction] == LAW_CONSTANT).all()
    np.testing.assert_array_equal(share[friction, 4], 0.0)
    assert share[friction, 1].max() > 0.1
    # with harmonics up to H the sum of the series overshoots the limit; the mean square cannot
    power = F[friction, :2, 0] ** 2 + 0.5 * (F[friction, :2, 1:] ** 2).sum(axis=2)
    limit = 0.4 * state.force[held, 2]
    assert (power <= limit[:, None] ** 2 * (1 + 1e-12)).all()
    expected = study.problem.point_stiffness[held, 2, None] * X[friction, 2]  # two-sided
    np.testing.assert_allclose(F[friction, 2], expected, atol=1e-9 * np.abs(expected).max())


# ---- contact points ----


@pytest.mark.slow
@pytest.mark.parametrize("side", ["left", "right"])
@each(
    ("points", "most", "grid"),
    [
        (24, 12, (3, 4)), (24, 9, (3, 3)), (24, 10, (3, 3)), (48, 24, (4, 6)), (48, 16, (4, 4)), (48, 9, (3, 3)),
        (48, 8, (4, 2)), (48, 6, (3, 2)),
    ],
)  # fmt: skip
def test_groups_of_patches_are_a_symmetric_grid_with_three_rows(side, points, most, grid):
    """Rows of 3 x 8 and 4 x 12 patches; four rows in three groups are one, two and one."""
    face = bd.reference_model("bladed_disk", points).interfaces[side]
    label = group_patches(face, most)
    count = np.bincount(label)
    assert len(count) == grid[0] * grid[1]
    place = np.einsum("pij,pj->pi", face.frame, face.points - face.points.mean(axis=0))[:, :2]
    centre = np.array([place[label == k].mean(axis=0) for k in range(len(count))])
    for axis in (0, 1):
        assert len(np.unique(centre[:, axis].round(9))) == grid[axis]
    turned = [int(np.abs(centre + c).sum(axis=1).argmin()) for c in centre]
    np.testing.assert_allclose(centre[turned], -centre, atol=1e-12)
    np.testing.assert_array_equal(count[turned], count)


@pytest.mark.parametrize(
    "inside", [lambda x, y: x + y < 1.0, lambda x, y: (2 * x - 1) ** 2 + (2 * y - 1) ** 2 < 1.0]
)
def test_groups_on_a_face_without_rows(inside):
    """Centres and areas of a grid of 4 by 12 patches that a triangle and an ellipse clip, in any order of the points."""
    x, y = (np.arange(80.0).reshape(-1, 1) + 0.5) / 80.0, (np.arange(240.0) + 0.5) / 240.0
    cells = [(k // 12, k % 12) for k in range(48)]
    parts = [np.s_[20 * i : 20 * i + 20, 20 * j : 20 * j + 20] for i, j in cells]
    covered = [inside(x, y)[part] for part in parts]
    kept = [k for k in range(48) if covered[k].sum() > 8]
    area = np.array([covered[k].mean() for k in kept])
    centre = [[12.0 * (x + 0.0 * y)[parts[k]][covered[k]].mean(), 36.0 * (y + 0.0 * x)[parts[k]][covered[k]].mean(), 0.0]
              for k in kept]  # fmt: skip
    whole = bd.reference_model("bladed_disk", 9).interfaces["left"]
    frame, order = (
        np.broadcast_to(np.eye(3), (len(kept), 3, 3)),
        np.random.default_rng(5).permutation(len(kept)),
    )
    face = replace(
        whole, points=np.array(centre), area=9.0 * area, frame=frame, gap=np.zeros(len(kept))
    )
    mixed = replace(face, points=face.points[order], area=face.area[order])
    for most in (4, 6, 9, 12, 16, 24):
        label = group_patches(face, most)
        sums = np.bincount(label, face.area)
        assert 0.6 * most < len(sums) <= most
        assert sums.max() < 2.5 * sums.mean(), "no group has several times its share"
        np.testing.assert_array_equal(group_patches(mixed, most), label[order])


@each(("points", "most"), [(24, 1), (24, 4), (24, 23), (48, 2), (48, 31)])
def test_any_number_of_groups_is_possible(points, most):
    face = bd.reference_model("bladed_disk", points).interfaces["left"]
    label = group_patches(face, most)
    assert (
        sorted(np.unique(label)) == list(range(label.max() + 1))
        and 0.7 * most < label.max() + 1 <= most
    )


@cache
def peak_of_disk(points, most=None):
    """The peak of the bladed disk whose model has so many points, of which a study keeps at most so many."""
    model = bd.reference_model("bladed_disk", points)
    study = bd.Study(
        model,
        bd.Excitation("tip"),
        engine_order=5,
        friction_coefficient=0.3,
        harmonics=1,
        contact_points=most,
        # with one harmonic the share of the flexibility at the points decides, which parts of 9 and 24 groups change
        contact_stiffness=bd.ResidualModes(partial_contact=False),
    )
    return study.peak(34.0)


@pytest.mark.slow
@each(("points", "most"), [(48, 24), (48, 12), (48, 9), (24, 12), (24, 9)])
def test_united_points_have_the_peak_of_a_model_with_as_many(points, most):
    """Two rows of groups along t1 let the damper roll: 0.84 to 1.1 mm where models of 9, 24 and 48 points have 16 um."""
    peak, other = peak_of_disk(points, most), peak_of_disk(9)
    assert peak.status == other.status == "complete"
    assert peak.amplitude == pytest.approx(other.amplitude, rel=0.07)


def test_united_points_keep_rigid_motion_area_and_energy(model):
    rng = np.random.default_rng(4)
    small = unite_contact_points(model, 2)
    for name in ("left", "right"):
        old, new = model.interfaces[name], small.interfaces[name]
        assert new.area.sum() == pytest.approx(old.area.sum())
        body = small.bodies["damper"]
        rows = small.port_slice("damper", (name, "a"))
        rigid = models.rigid_modes(body.mass, body.centre, body.inertia, new.points)
        turned = np.einsum("pij,pjk->pik", new.frame, rigid)
        np.testing.assert_allclose(body.bases[0].contact_modes[rows, :, :6], turned, atol=1e-12)
    # a force on the groups does the same work on both
    blade, united = model.bodies["blade"].bases[2], small.bodies["blade"].bases[2]
    f = rng.standard_normal(united.flexibility.shape[0])
    assert (f @ united.flexibility @ f).real > 0.0
    residual = united.flexibility - (
        united.contact_modes.reshape(len(f), -1)
        / blade.omega2
        @ united.contact_modes.reshape(len(f), -1).conj().T
    )
    assert np.linalg.eigvalsh(residual).min() > -1e-12 * np.abs(united.flexibility).max()


def test_given_stiffness_is_that_of_the_points_of_the_model(full):
    whole = full.replace(contact_stiffness=2e7)
    united = whole.replace(contact_points=2)
    np.testing.assert_allclose(united.problem.point_stiffness[:2], 6e7)
    total = whole.problem.point_stiffness[:12].sum(axis=0)
    np.testing.assert_allclose(united.problem.point_stiffness[:4].sum(axis=0), total)
    by_name = united.replace(
        contact_stiffness={n: np.array([1e7, 2e7, 3e7]) for n in whole.problem.coupling.interfaces}
    )
    np.testing.assert_allclose(by_name.problem.point_stiffness[0], [3e7, 6e7, 9e7])


def test_given_gap_is_that_of_the_points_of_the_model(full):
    gap = np.linspace(0.0, 5e-6, 6)
    united = full.replace(contact_points=2, gap={"left": gap})
    np.testing.assert_allclose(np.sort(united.problem.point_gaps[:2]).mean(), gap.mean())
    assert united.problem.point_gaps[:2].min() > 0.0
    np.testing.assert_array_equal(united.problem.point_gaps[2:4], 0.0)


# ---- the interface ----


def test_every_effect_has_an_assumption(full):
    effects = bd.Effects.of(full.replace(harmonics=(1, 3)))
    assert all(text in str(effects) for text in ASSUMED.values())
    assert "variable normal load excites them" in str(effects)
    assert "excites them" not in str(effects.without("variable normal load"))
    assert bd.Effects.of(full.replace(**effects)) == effects


@each(
    ("name", "changed"),
    [
        ("bias", {"bias": False}),
        ("variable normal load", {"variable_normal_load": False, "separation": False}),
        ("separation", {"separation": False}),
        ("harmonic nodal diameters", {"fundamental_modes_only": True}),
        ("constraint planes", {"constraint_planes": False}),
        ("rotation X", {"rigid_modes": ("TX", "TY", "TZ", "RY", "RZ")}),
        ("translation Z", {"rigid_modes": ("TX", "TY", "RX", "RY", "RZ")}),
        ("harmonics beyond 3", {"harmonics": 3}),
        ("harmonics beyond 1", {"harmonics": 1}),
        ("damper modes beyond 0", {"damper_modes": 0}),
        ("blade modes beyond 2", {"blade_modes": 2}),
        ("contact points beyond 4", {"contact_points": 4}),
    ],
)
def test_a_set_without_one_effect(full, name, changed):
    whole = bd.Effects.of(full.replace(harmonics=5, damper_modes=2))
    assert whole.without(name) == whole | changed
    assert whole.without(name).without(name) == whole.without(name)


def test_what_is_off_or_fewer_already_remains(full):
    whole = bd.Effects.of(full)
    for harmonics in ((1, 3), (1, 3, 5)):
        assert bd.Effects(whole | {"harmonics": harmonics}).without("harmonics beyond 3")[
            "harmonics"
        ] == (1, 3)
    assert (
        bd.Effects(whole | {"contact_points": 3}).without("contact points beyond 4")[
            "contact_points"
        ]
        == 3
    )
    for name in (
        "gravity",
        "rotation",
        "rotation W",
        "harmonics beyond",
        "harmonics beyond all",
        "stability",
    ):
        with pytest.raises(bd.SettingError, match=r"effect: expected .* found"):
            whole.without(name)


def test_stability_is_judged_only_where_it_is_on(full):
    assert full.frequency_response(1000.0, (838.0, 842.0)).unstable is None
    judged = full.replace(**(bd.Effects.of(full) | {"stability": True}))
    curve = judged.frequency_response(1000.0, (838.0, 842.0))
    assert curve.unstable is not None and curve.unstable.shape == (len(curve),)


def test_coupled_friction_brings_a_sampled_evaluation(full):
    assert full.settings.contact_forces == "event_driven"
    assert isinstance(full.replace(friction_law="coupled").settings.contact_forces, bd.AFT)
    coupled = full.replace(friction_law="coupled")
    assert (
        isinstance(coupled.settings.contact_forces, bd.AFT)
        and coupled.settings.friction_law == "coupled"
    )
    kept = full.replace(contact_forces=bd.AFT(256), friction_law="coupled")
    assert kept.settings.contact_forces == bd.AFT(256)


# ---- settings together ----


@pytest.mark.parametrize(
    "changes", [{"separation": False}, {"variable_normal_load": False}], ids=str
)
def test_bonded_points_do_not_know_of_separation(full, changes):
    """They pull as well as they push (and have no gaps, which would be refused)."""
    bonded = full.replace(friction_law="bonded", constraint_planes=False)
    plain, other = bonded.problem.system(PRELOAD), bonded.replace(**changes).problem.system(PRELOAD)
    u = np.random.default_rng(5).normal(size=plain.n_unknowns)
    for a, b in zip(plain.evaluate(u, 2000.0), other.evaluate(u, 2000.0)):
        np.testing.assert_allclose(b, a, rtol=1e-9, atol=1e-9 * np.abs(a).max())


def test_modes_of_a_system_are_those_of_its_points(full):
    """Whatever reads the equations of a system finds the motion of its points in its modes."""
    system = full.replace(separation=False).problem.system(PRELOAD)
    u = np.random.default_rng(6).normal(size=system.n_unknowns)
    X, _, _ = system.contact(u)
    for l in range(1, 4):
        motion = np.einsum("pim,m->pi", system.structure.bases[l].G, system.layout.amplitudes(u, l))
        np.testing.assert_allclose(
            X[..., 2 * l - 1] - 1j * X[..., 2 * l], motion, rtol=1e-9, atol=1e-12
        )


def test_studies_can_be_keys_and_be_sent_elsewhere(full):
    again = pickle.loads(pickle.dumps(full))
    assert len({full, full, full._with_problem(full.problem.replace()), again}) == 3
    assert again.model.hash == full.model.hash
    # to rounding, which depends on where arrays lie in memory
    np.testing.assert_allclose(
        again.static(PRELOAD).force, full.static(PRELOAD).force, rtol=0.0, atol=1e-12 * PRELOAD
    )


def test_a_curve_of_other_settings_is_refused(full):
    curve = full.frequency_response(PRELOAD, (1090.0, 1110.0))
    assert len(curve)
    assert full.with_stability(curve).unstable is not None
    with pytest.raises(bd.SettingError, match="or a result computed with different settings"):
        full.replace(friction_coefficient=0.1).with_stability(curve)


def test_residual_modes_are_no_bodies_that_walk(full):
    """What is said of mean positions leaves coordinates alone that belong to no body."""
    study = full.replace(contact_stiffness="residual_modes")
    system, coordinates = study.problem.system(0.0), study.problem.bases[0].coordinates
    assert any(c.body not in study.model.bodies for c in coordinates)
    model = study.problem.coupling.model
    y = np.append(np.zeros(system.n_unknowns), 3000.0)
    assert why_no_solution(system, model, coordinates, y) == ""
    moved = y.copy()
    moved[next(k for k, c in enumerate(coordinates) if c.body not in model.bodies)] = 1.0
    points = [
        Correction(OK, p, np.zeros_like(p), np.ones_like(p), 1, 0.0, 0, kind=kind)
        for p, kind in ((y, "regular"), (moved, "drift"))
    ]
    assert "kg^1/2 m" in notes(system, model, coordinates, points)[0]


def test_a_peak_says_how_its_curve_ended(full):
    peak = full.peak(1000.0, (820.0, 860.0))
    assert peak.search_status == "complete"
    assert "higher peak" not in peak.summary()
    assert "There may be a higher peak: incomplete: why" in said(
        replace(peak, search_status="incomplete", search_reason="why")
    )
