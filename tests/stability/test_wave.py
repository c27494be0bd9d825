"""Which points of a curve are judged: verdicts made up, so that the truth is known everywhere."""

import numpy as np

import bdamper as bd
from bdamper.stability.wave import Verdict, judged_along, rests
from tests.models import wedge_model
from tests.plain import plain_study


def judged(growth, counts, moving=None, branch=None, positive=None):
    asked = []
    n = len(growth)

    def judge(i):
        asked.append(i)
        return Verdict(int(counts[i]), float(growth[i]))

    moving = np.ones(n, bool) if moving is None else moving
    branch = np.zeros(n, int) if branch is None else branch
    grows, known = judged_along(judge, lambda i: True if positive is None else bool(positive[i]), moving, branch)
    assert set(asked) == set(np.flatnonzero(known))
    return grows, known


def test_ends_of_an_unstable_stretch_are_found():
    s = np.linspace(0.0, 1.0, 101)
    for low, high in ((0.203, 0.611), (0.33, 0.38)):
        growth = -(s - low) * (s - high)
        counts = 2 * (growth > 0.0)
        grows, known = judged(growth, counts)
        np.testing.assert_array_equal(grows, counts)
        assert known.mean() < 0.6


def test_one_point_of_another_sign_is_found():
    counts, positive = np.zeros(41, int), np.ones(41, bool)
    counts[22], positive[22] = 1, False
    grows, known = judged(np.where(counts, 0.01, -0.01), counts, positive=positive)
    np.testing.assert_array_equal(grows, counts)
    assert known.sum() < 20


def test_what_rests_or_lies_on_another_branch_tells_nothing():
    counts = np.array([0] * 10 + [2] * 10)
    growth = np.where(counts, 0.02, -0.01)
    grows, known = judged(growth, counts, branch=(counts > 0).astype(int))
    np.testing.assert_array_equal(grows, counts)
    assert known[9] and known[10] and known.sum() < 10
    moving = np.arange(20) < 10
    grows, known = judged(growth, counts, moving=moving)
    assert not known[10:].any() and (grows[10:] == 0).all()


def test_unknown_growth_and_failed_counts_are_looked_into():
    counts = np.zeros(30, int)
    grows, known = judged(np.full(30, np.nan), counts)
    assert (np.diff(np.flatnonzero(known)) <= 2).all()
    counts[12] = -1
    grows, known = judged(np.where(counts < 0, np.nan, -0.01), counts)
    assert grows[12] == -1 and known[11:14].all()
    assert (grows[np.arange(30) != 12] == 0).all()


def test_resting_contacts_on_springs_that_only_resist():
    model = wedge_model(0, n_blades=8, engine_order=2, n_points=4, n_blade_modes=2, harmonics=3, n_damper_modes=0)
    study = plain_study(
        model, engine_order=2, contact_stiffness=1e5, friction_coefficient=0.3,
        excitation=bd.Excitation("tip", "tangential", 20.0),
    )  # fmt: skip
    curve = study.track(400.0, (250.0, 400.0))
    system = study.problem.system(400.0)
    still = np.array([rests(system, u) for u in curve.unknowns])
    assert still.any() and not still.all()
    for i, rest in enumerate(still):
        _, _, shares = system.contact(curve.unknowns[i])  # stick and slip of two directions, open
        assert rest == (np.minimum(shares, 1.0 - shares).max() < 1e-12)
    i = int(np.flatnonzero(still)[0])
    system.structure.arrays["damping"] = system.structure.arrays["damping"] - 1.0
    assert not rests(system, curve.unknowns[i])


def test_the_note_says_what_was_counted():
    model = wedge_model(0, n_blades=8, engine_order=2, n_points=4, n_blade_modes=2, harmonics=3, n_damper_modes=0)
    study = plain_study(
        model, engine_order=2, contact_stiffness=1e5, friction_coefficient=0.3,
        excitation=bd.Excitation("tip", "tangential", 20.0),
    )  # fmt: skip
    curve = study.with_stability(study.track(400.0, (250.0, 400.0)))
    words = curve.stability_note.split(f"of {len(curve)} points ")[1].replace(",", "").split()
    assert sum(int(w) for w in words[:5:2]) == len(curve)
