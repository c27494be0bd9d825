"""Which points of a travelling wave rest, and what the note on stability counts."""

import numpy as np

import bdamper as bd
from bdamper.time_domain.wave_exponents import rests
from tests.models import wedge_model
from tests.plain import plain_study


def test_resting_contacts_on_springs_that_only_resist():
    model = wedge_model(0, n_blades=8, engine_order=2, n_points=4, n_blade_modes=2, harmonics=3, n_damper_modes=0)
    study = plain_study(
        model, engine_order=2, contact_stiffness=1e5, friction_coefficient=0.3,
        excitation=bd.Excitation("tip", "tangential", 20.0),
    )  # fmt: skip
    curve = study.frequency_response(400.0, (250.0, 400.0))
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
    curve = study.with_stability(study.frequency_response(400.0, (250.0, 400.0)))
    system = study.problem.system(400.0)
    moving = sum(not rests(system, u) for u in curve.unknowns)
    assert f"; {moving} of {len(curve)} points counted, the others rest" in curve.stability_note
