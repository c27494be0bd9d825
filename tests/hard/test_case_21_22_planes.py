"""Rows 21 and 22: a damper that flies, and constraint planes with and without clearance."""

from dataclasses import replace

import numpy as np

import bdamper as bd
from bdamper.response.response_curve import why_no_solution
from tests.models import acyclic_model
from tests.plain import plain_study


def with_gap(model, names, gap):
    faces = dict(model.interfaces)
    for name in names:
        faces[name] = replace(faces[name], gap=np.full(faces[name].n_points, gap))
    return replace(model, interfaces=faces)


def study(model, **settings):
    return plain_study(
        model,
        engine_order=0,
        contact_stiffness="model",
        excitation=bd.Excitation("tip", "tangential", 1.0),
        **settings,
    )


def test_case_21_all_points_open_under_a_static_load():
    """Nothing touches and nothing can: the load has no answer."""
    model = acyclic_model(1)
    s = study(with_gap(model, ("left", "right"), 1.0))
    # state in which all is open: the residual is the load, and no mean position changes it
    s.problem.static_states[(100.0, *s.settings.load_history)] = replace(s.static(0.0), load=100.0)
    system = s.problem.system(100.0)
    y = np.append(np.zeros(system.n_unknowns), 2 * np.pi * 300.0)
    text = why_no_solution(system, s.problem.coupling.model, s.problem.bases[0].coordinates, y)
    assert "no periodic solution" in text
    assert "all contacts of damper are open throughout the cycle" in text
    assert "TY of damper" in text or "along TY" in text
    curve = s.frequency_response(100.0, (250.0, 300.0))
    assert curve.status == "not found"
    assert "no periodic solution" in curve.reason
    assert len(curve) == 0


def loaded_planes(s, curve):
    system = s.problem.system(curve.preload)
    out = []
    for u in curve.unknowns:
        _, F, _ = system.contact(u)
        out.append(
            [np.abs(F[s.problem.coupling.rows(name), 2]).max() > 1e-9 for name in ("front", "back")]
        )
    return np.array(out)


def test_case_22_planes_with_clearance_never_load_together():
    s = study(with_gap(acyclic_model(1), ("front", "back"), 2e-5), harmonics=1)
    curve = s.frequency_response(20.0, (250.0, 400.0))
    assert curve.complete, curve.reason
    assert not loaded_planes(s, curve).all(axis=1).any()


def test_case_22_planes_without_clearance_hold_both_ways():
    s = study(with_gap(acyclic_model(1), ("front", "back"), 0.0), harmonics=1)
    curve = s.frequency_response(20.0, (250.0, 400.0))
    assert curve.complete, curve.reason
    assert loaded_planes(s, curve).any(axis=0).all()
    # axial mean motion stays of the size of the vibration
    k = [c.name for c in s.problem.bases[0].coordinates].index("TZ")
    free = study(
        with_gap(acyclic_model(1), ("front", "back"), 1e-3), harmonics=1
    ).frequency_response(20.0, (250.0, 400.0))
    assert np.abs(curve.unknowns[:, k]).max() <= np.abs(free.unknowns[:, k]).max() * 1.001
