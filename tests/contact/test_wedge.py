"""How the damper sits: load history, maps, misfit, and what statics leaves open."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

import bdamper as bd
from bdamper.contact.static_contact import solve_static_contact, static_contact_problem
from bdamper.contact.stiffness import METHODS, contact_stiffness, paper_contact
from bdamper.model.structure import StaticContact
from bdamper.response.response_curve import self_locking
from bdamper.util.errors import BdamperWarning, ModelError, PlausibilityWarning, SettingError
from bdamper.util.formatting import amount
from tests.models import acyclic_model, wedge_model
from tests.plain import plain_study
from tests.printed import said


def study(**settings):
    settings = {"contact_stiffness": "residual_modes", "engine_order": 5} | settings
    return plain_study(bd.reference_model("bladed_disk", 9), bd.Excitation("tip"), **settings)


@pytest.mark.parametrize("alpha", [0.5, 0.9])
@pytest.mark.parametrize("mu", [0.0, 0.1, 0.2])
def test_interval_of_a_symmetric_wedge(alpha, mu):
    """The four ways in which both faces can slide: N_R = P cos(a + r1) cos(r)/sin(2 a + r1 + r2), r1, r2 = ±atan(mu)."""
    s = plain_study(
        wedge_model(n_points=6, alpha=alpha, beta=alpha),
        bd.Excitation("tip"),
        2,
        friction_coefficient=mu,
        contact_stiffness=1e7,
    )
    found = s.wedge_friction(3.0)
    np.testing.assert_allclose(found.angle, alpha, rtol=1e-9)
    r = np.arctan(mu)
    force = [
        3.0 * np.cos(alpha + a * r) * np.cos(r) / np.sin(2 * alpha + (a + b) * r)
        for a in (-1, 1)
        for b in (-1, 1)
    ]
    np.testing.assert_allclose(found.lowest, min(force), rtol=1e-7)
    np.testing.assert_allclose(found.highest, max(force), rtol=1e-7)
    assert not found.self_locking


def test_self_locking_is_named():
    model = wedge_model(n_points=6, alpha=0.4, beta=0.4)
    made = [
        plain_study(
            model, bd.Excitation("tip"), 2, friction_coefficient=mu, contact_stiffness=1e7
        ).wedge_friction()
        for mu in (0.99 * np.tan(0.4), 1.01 * np.tan(0.4))
    ]
    assert [m.self_locking for m in made] == [False, True]
    assert [str(wedge).startswith("Self-locking") for wedge in made] == [False, True]
    assert str(made[0]).startswith("Not self-locking")
    assert np.isinf(made[1].highest).all()
    assert "inf" not in str(made[1])
    assert f"{1e3 * made[1].lowest[0]:.3g} mN or more" in str(made[1])
    assert "or more" not in str(made[0])


def test_static_state_lies_in_the_interval():
    s = study()
    bounds, found = s.wedge_friction(1000.0), s.static(1000.0).normal_force
    for name, low, high in zip(bounds.interfaces, bounds.lowest, bounds.highest):
        assert low < found[name] < high


def test_a_history_under_one_newton_is_not_the_scaled_state():
    """Problem keeps a state under 1 N, from which it scales others: it is no state of a load history."""
    s = study(friction_coefficient=0.5)
    s.static(400.0)
    unloaded = s.static(1.0, history=(1.0, 0.0))
    assert unloaded.load == 0.0


def test_history_of_loads():
    s = study(friction_coefficient=0.5)
    up, down = s.static(400.0), s.static(1000.0, history=(0.2, 1.0, 0.4))
    assert down.load == pytest.approx(400.0)
    assert down.ok
    assert down.residual < 1e-9
    assert np.abs(down.force - up.force).max() > 1e-3 * up.force.max()
    # from rest the state is proportional to the load, whatever the steps
    again = s.static(1000.0, history=(0.1, 0.4))
    np.testing.assert_allclose(again.force, up.force, atol=1e-7 * up.force.max())
    # an overload changes what a response curve starts from
    seated = study(friction_coefficient=0.5, load_history=(2.5, 1.0))
    np.testing.assert_allclose(seated.static(400.0).force, down.force, atol=2e-2 * up.force.max())
    assert seated.frequency_response(400.0, (280.0, 320.0)).complete


@pytest.mark.parametrize(("mu", "locks"), [(0.1, False), (0.3, True)])
def test_unloading_to_nothing(mu, locks):
    """A steep wedge that slid in under load and locks itself keeps its normal force, one that does not lets go."""
    model = wedge_model(n_points=6, alpha=0.25, beta=0.25)
    s = plain_study(
        model,
        bd.Excitation("tip"),
        2,
        friction_coefficient=mu,
        contact_stiffness=1e7,
        constraint_planes=False,
    )
    assert s.wedge_friction().self_locking == locks
    found = s.static(1000.0, history=(1.0, 0.0))
    assert found.ok
    assert found.load == 0.0
    assert (found.force[:, 2].sum() > 10.0) == locks


def test_reduced_state_agrees_with_the_certified_one():
    """Static contact with residual modes against the condensed problem on the whole flexibility."""
    for patterns, tolerance in ((12, 2e-3), ("all", 1e-8)):
        s = study(contact_stiffness=bd.ResidualModes(patterns), constraint_planes=False)
        problem = static_contact_problem(s.problem.coupling, s.problem.friction)
        certified = 1000.0 * solve_static_contact(problem).force
        found = s.static(1000.0)
        assert np.abs(found.force - certified).max() < tolerance * certified.max()


@pytest.mark.slow
def test_map_of_the_contact(tmp_path):
    s = study()
    contact = s.static(1000.0)
    assert sum(contact.normal_force.values()) == pytest.approx(contact.force[:, 2].sum())
    np.testing.assert_allclose(contact.pressure * contact.area, contact.force[:, 2])
    assert 0.0 < contact.contact_area["left"] <= s.model.interfaces["left"].area.sum()
    area = {fact.name: fact.value for fact in contact._facts()}
    assert area == {f"contact area {name}": value for name, value in contact.contact_area.items()}
    assert "pressure (kPa)" in contact.summary() or "pressure (MPa)" in contact.summary()
    contact.save(tmp_path / "map.h5")
    again = bd.load(tmp_path / "map.h5")
    np.testing.assert_array_equal(again.force, contact.force)
    assert again.interface == contact.interface
    np.testing.assert_array_equal(again.frame, contact.frame)
    for quantity in ("pressure", "gap", "friction"):
        assert all(ax.has_data() for ax in again.plot(quantity=quantity).axes)
    with pytest.raises(bd.BdamperError, match="this static state has no contact faces"):
        replace(again, points=None).plot()


def test_misfit_of_a_face():
    face = bd.reference_model("bladed_disk", 9).interfaces["left"]
    gap = bd.face_gap(face, angle=1e-3)
    along = np.einsum("ij,ij->i", face.points, face.frame[:, 0])
    np.testing.assert_allclose(np.ptp(gap), np.tan(1e-3) * np.ptp(along), rtol=1e-12)
    assert gap.min() == 0.0
    crowned = bd.face_gap(face, crowning=1e-6, axial_crowning=2e-6)
    assert crowned.max() == pytest.approx(3e-6)
    assert crowned[4] == pytest.approx(0.0, abs=1e-18)
    with pytest.raises(SettingError, match=r"angle: expected .* <= 0\.1 rad"):
        bd.face_gap(face, angle=1.0)


def test_a_misfit_shrinks_the_contact_and_closes_under_load():
    model = bd.reference_model("bladed_disk", 9)
    gap = {"left": bd.face_gap(model.interfaces["left"], angle=2e-4)}
    fit, bad = study(), study(gap=gap)
    for load in (20.0, 2e5):
        assert bad.static(load).ok
    area = [s.static(20.0).contact_area["left"] for s in (fit, bad)]
    assert area[1] < area[0]
    assert bad.static(2e5).contact_area["left"] > area[1]


@pytest.mark.slow
@pytest.mark.parametrize("ask", [
    lambda s: s.peak(1000.0), lambda s: s.frequency_response(1000.0, (300.0, 330.0)),
    lambda s: s.optimal_curve((1000.0, 2000.0), 2, check=False),
])  # fmt: skip
def test_answers_warn_of_edge_contact(ask, monkeypatch):
    """Every face counts as one that touches at an edge."""
    monkeypatch.setattr("bdamper.contact.preload_state.EDGE", 1.1)
    s = plain_study(
        bd.reference_model("bladed_disk", 9), bd.Excitation("tip"), 5, friction_coefficient=0.4
    )
    with pytest.warns(
        PlausibilityWarning,
        match="faces that touch over most of their area, found 'left' touches with",
    ):
        ask(s)


def test_a_state_that_has_not_converged_is_warned_of(monkeypatch):
    s = study()
    lost = replace(s.static(20.0), ok=False, reason="found no equilibrium")
    monkeypatch.setattr(type(s.problem), "static", lambda *_: lost)
    with pytest.warns(
        BdamperWarning, match="found no equilibrium; the result is the last state that was found"
    ) as caught:
        s.static(20.0)
    assert caught[0].filename == __file__


def test_edge_contact_is_named_with_its_pressure_once(recwarn):
    """A face with two of nine points that stand out; without the gap it touches on five."""
    model = bd.reference_model("bladed_disk", 9)
    s = study(gap={"left": np.where(np.isin(np.arange(9), (1, 7)), 0.0, 1e-3)})
    state = s.static(20.0)
    part = state.contact_area["left"] / model.interfaces["left"].area.sum()
    pressure = state.normal_force["left"] / state.contact_area["left"]
    words = f"'left' touches with {100.0 * part:.2g} % of its area, where the mean pressure is {amount(pressure, 'Pa')}"
    assert 0.0 < part < 0.3 and state.edges == words and f"Edge contact: {words}" in said(state)
    assert not replace(state, ok=False).edges, "a state at a smaller load"
    assert not replace(state, friction=0.0 * state.friction).edges, (
        "an axial stop may touch at one point"
    )
    assert not study().static(20.0).edges and "Edge" not in str(study().static(20.0))
    recwarn.clear()
    for load in (20.0, 21.0):
        s.problem.sizes.check_faces(load)
    told = [str(w.message) for w in recwarn]
    assert told == [
        f"contact at rest: plausible faces that touch over most of their area, found {words} under 20 N"
    ]


@pytest.mark.parametrize(
    "kind", [{"crowning": 1e-5}, {"crowning": 1e-5, "axial_crowning": 1e-5}, {"angle": 2e-4}]
)
def test_line_contact_of_the_reduced_model(kind):
    """Both faces crowned: the damper can turn about the line on which it sits until others touch."""
    faces = bd.reference_model("bladed_disk", 9).interfaces
    s = study(
        gap={name: bd.face_gap(faces[name], **kind) for name in ("left", "right")},
        constraint_planes=False,
    )
    for history in ((1.0,), (0.1, 1.0, 0.2, 1.5)):
        found = s.static(1000.0, history=history)
        assert found.ok
        assert found.residual < 1e-9
        friction = 0.3 * found.force[:, 2:]
        assert np.all(np.abs(found.force[:, :2]) <= friction + 1e-9 * found.force.max())


def test_methods_differ_where_the_equations_of_the_paper_fail():
    """Eqs (4), (10) taken literally are negative at closed points, which fall back; bonded frequencies differ."""
    found = {method: study(contact_stiffness=method).problem for method in METHODS}
    problem = found["cigeroglu2009"]
    force, left_out = paper_contact(problem.coupling, problem.friction)
    rows = problem.coupling.rows("left")
    negative = (force * left_out < 0.0)[rows] & (force[rows][:, 2:] > 0.0)
    assert negative.any() and problem.stiffness["left"].fallback[negative].all()
    modes = []
    for method in ("residual_modes", "unit_traction"):
        bonded = found[method].point_stiffness * found[method].friction_points[:, None]
        modes.append(found[method].at(0.0).sector.linear.modes(bonded)[0][:5])
    assert np.abs(modes[0] / modes[1] - 1.0).max() > 0.02


class TestForcesOfTheUser:
    """A static solution made from the condensed problem and written into the model, as from another program."""

    @pytest.fixture
    def parts(self):
        s = study(constraint_planes=False)
        problem = static_contact_problem(s.problem.coupling, s.problem.friction)
        solution = solve_static_contact(problem)
        turn = np.array([1.0, 1.0, -1.0])
        static = {}
        for name in s.problem.coupling.interfaces:
            rows = s.problem.coupling.rows(name)
            static[name] = StaticContact(
                solution.force[rows] * turn, np.zeros((9, 3)), solution.motion[rows] * turn
            )
        return s, solution, static

    @pytest.mark.slow
    def test_gives_what_the_condensed_problem_gives(self, parts):
        s, solution, static = parts
        model = replace(s.model, static=static)
        given = plain_study(
            model,
            bd.Excitation("tip"),
            5,
            constraint_planes=False,
            contact_stiffness="cigeroglu2009",
        )
        left_out = (
            s.problem.coupling.residual_flexibility(0).real @ solution.force.ravel()
        ).reshape(-1, 3)
        for name, contact in given.problem.stiffness.items():
            rows = given.problem.coupling.rows(name)
            sure = ~contact.fallback
            assert sure.any()
            expected = solution.force[rows][sure] / left_out[rows][sure]
            np.testing.assert_allclose(contact.stiffness[sure], expected, rtol=1e-6)

    @pytest.mark.slow
    def test_out_of_balance_is_refused(self, parts):
        s, _, static = parts
        bad = {name: replace(c, force=1.1 * c.force) for name, c in static.items()}
        with pytest.raises(ModelError, match=r"found a difference of 0\.1 times"):
            plain_study(
                replace(s.model, static=bad),
                bd.Excitation("tip"),
                5,
                constraint_planes=False,
                contact_stiffness="cigeroglu2009",
            ).static(1.0)

    def test_displacements_of_another_model_are_refused(self, parts):
        s, _, static = parts
        bad = {
            name: replace(c, displacement_b=-4.0 * c.displacement_b) for name, c in static.items()
        }
        with pytest.raises(ModelError, match="displacements of the model"):
            plain_study(
                replace(s.model, static=bad),
                bd.Excitation("tip"),
                5,
                constraint_planes=False,
                contact_stiffness="cigeroglu2009",
            ).static(1.0)


def test_stiffness_per_area():
    s = study(contact_stiffness=bd.PerArea((1e12, 2e12, 3e12)))
    face = s.model.interfaces["left"]
    np.testing.assert_allclose(
        s.problem.stiffness["left"].stiffness, face.area[:, None] * [1e12, 2e12, 3e12]
    )
    given = {n: bd.PerArea(1e12) for n in s.problem.coupling.interfaces}
    same = contact_stiffness(s.problem.coupling, given, s.problem.friction)
    np.testing.assert_allclose(
        same.stiffness["right"].stiffness[:, 2], 1e12 * s.model.interfaces["right"].area
    )


@pytest.mark.slow
@pytest.mark.parametrize(("angle", "locks"), [(20.0, False), (15.0, True)])
def test_every_answer_about_a_self_locking_wedge_says_so(angle, locks):
    """By tan(alpha) <= mu with mu = 0.3."""
    study = plain_study(
        acyclic_model(1, alpha=np.radians(angle), beta=np.radians(angle), n_damper_modes=0), engine_order=0,
        contact_stiffness="model", friction_coefficient=0.3, excitation=bd.Excitation("tip", "tangential", 1.0),
    )  # fmt: skip
    assert (np.tan(np.radians(angle)) <= 0.3) == locks
    peak = study.peak(200.0)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        optimum = study.optimal_curve([150.0, 200.0, 250.0], check=False)
    told = [str(warning.message) for warning in caught if "self-locking" in str(warning.message)]
    assert len(told) == locks
    assert peak.ok
    assert np.isfinite(optimum.optimum.preload)
    curve = study.frequency_response(200.0, tuple(peak.settings["frequency"]))
    incomplete = study.peak(200.0, (250.0, 300.0))
    assert not incomplete.ok
    for answer in (curve, peak, optimum, incomplete):
        assert ("is self-locking" in answer.summary()) == locks


def lumped_wedge(angle: float, blades: int) -> bd.Study:
    """Half a wedge at a blade, or a wedge between two blades; masses without springs of their own."""
    s, c = np.sin(np.radians(angle)), np.cos(np.radians(angle))
    if blades == 1:
        faces = [({0: -s, 1: c}, {0: c, 1: s})]
    else:
        faces = [
            ({0: -s, 2: s, 3: c}, {0: c, 2: -c, 3: s}),
            ({1: s, 2: -s, 3: c}, {1: -c, 2: c, 3: s}),
        ]
    contacts = [bd.Contact(*motions, kt=2.0, kn=2.0, mu=0.3) for motions in faces]
    mass = [*[1.0] * blades, *[0.02] * blades]
    damping = [*[0.01] * blades, *[0.0] * blades]
    stiffness = [*[1.0] * blades, *[0.0] * blades]
    loaded = len(mass) - 1
    return bd.lumped(
        mass, damping, stiffness, contacts=contacts, forces={0: 0.1}, load_per_preload={loaded: 1.0}
    )


@pytest.mark.parametrize("blades", [1, 2])
@pytest.mark.parametrize(("angle", "locks"), [(45.0, False), (17.0, False), (16.0, True)])
def test_a_lumped_wedge_says_whether_it_is_self_locking(blades, angle, locks):
    """Equilibrium along the load, n (N sin a + T cos a) = P with abs(T) <= mu N; tan 16.7 deg = 0.3."""
    study, load = lumped_wedge(angle, blades), 0.5
    found = study.wedge_friction(load)
    s, c = np.sin(np.radians(angle)), np.cos(np.radians(angle))
    assert found.self_locking == locks
    lowest = load / blades / (s + 0.3 * c)
    highest = np.inf if locks else load / blades / (s - 0.3 * c)
    assert np.degrees(found.angle) == pytest.approx(angle)
    if blades == 1:
        assert (found.lowest, found.highest) == (pytest.approx(lowest), pytest.approx(highest))
    names = ["contact 1", "contact 1 and contact 2"][blades - 1]
    locked = (f"the mass at {names}",) if locks else ()
    assert self_locking(study.problem) == locked
    curve = study.frequency_response(load, (0.15, 0.2))
    assert (f"The mass at {names} is self-locking" in said(curve)) == locks


def test_a_face_that_springs_press_is_no_wedge():
    """The masses have springs of their own, so that statics determine the normal force."""
    contact = bd.Contact({0: 1.0}, {1: 1.0}, kt=1.0, kn=1.0, mu=0.5, preload=1.0)
    study = bd.lumped([1.0, 1.0], [0.01, 0.01], [1.0, 1.0], contacts=[contact], forces={0: 0.1},
                      load_per_preload={1: 1.0})  # fmt: skip
    with pytest.raises(bd.SettingError, match="a face that presses on a free body"):
        study.wedge_friction(1.0)
    assert self_locking(study.problem) == ()
