"""Nonlinear modes beside closed forms, an exact solution and an independent program."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import scipy

import bdamper as bd
from bdamper.analyses.nonlinear_mode import _with_more_harmonics, mode_system
from benchmarks import rigs
from tests.analyses import jenkins, wedge
from tests.printed import check

TWO_PI = 2.0 * np.pi
FINE = bd.ContinuationOptions(tolerance=1e-12)


def oscillator(harmonics, **settings):
    contact = bd.Contact(0, kt=1.0, mu=1.0, preload=1.0)
    return bd.lumped(
        1.0, 0.02, 1.0, contacts=[contact], forces={0: 1.0}, harmonics=harmonics, **settings
    )


def test_one_harmonic_is_the_closed_form():
    mode = oscillator(1).nonlinear_mode(0.0, 1, (1e-3, 100.0), options=FINE)
    assert mode.complete and mode.linear_to == pytest.approx(1.0, rel=1e-8)
    assert mode.amplitude[[0, -1]] == pytest.approx([1e-3, 100.0], rel=1e-12)
    omega, zeta = np.transpose([jenkins.closed_form(a) for a in mode.amplitude])
    np.testing.assert_allclose(TWO_PI * mode.frequency, omega, rtol=1e-10)
    np.testing.assert_allclose(mode.damping_ratio, zeta, rtol=1e-10)
    # the curve has a point at the largest damping of the closed form
    top = mode.point_kind.index("maximum")
    a = mode.amplitude[top]
    assert top == np.argmax(mode.damping_ratio)
    assert max(jenkins.closed_form(a * s)[1] for s in (0.999, 1.001)) < mode.damping_ratio[top]


def test_values_at_an_amplitude_are_interpolated_over_its_logarithm():
    mode = oscillator(1).nonlinear_mode(0.0, 1, (1e-3, 100.0))
    i = mode.point_kind.index("maximum")
    f, zeta = mode.frequency[i : i + 2], mode.damping_ratio[i : i + 2]
    (between,) = mode.at(mode.amplitude[i] ** 0.75 * mode.amplitude[i + 1] ** 0.25)
    assert between == pytest.approx(
        (0.75 * f[0] + 0.25 * f[1], 0.75 * zeta[0] + 0.25 * zeta[1]), rel=1e-9
    )
    assert mode.at(200.0) == []


def test_many_harmonics_are_the_exact_solution():
    mode = oscillator(tuple(range(1, 22, 2))).nonlinear_mode(0.0, 1, (1.5, 20.0), options=FINE)
    worst = []
    for i in range(0, len(mode), 6):
        omega, zeta = jenkins.exact(mode.amplitude[i])
        worst.append([TWO_PI * mode.frequency[i] / omega - 1.0, mode.damping_ratio[i] / zeta - 1.0])
    assert len(worst) > 5
    assert np.abs(worst).max() < 1e-5
    one = [jenkins.closed_form(a)[1] / jenkins.exact(a)[1] - 1.0 for a in (3.0, 6.0)]
    assert min(map(abs, one)) > 1e-3  # error of one harmonic


def test_more_harmonics_give_the_error_of_one():
    """As the closed form with one harmonic differs from the exact solution."""
    mode = oscillator(1).nonlinear_mode(0.0, 1, (1.5, 20.0), more_harmonics=20, options=FINE)
    exact = np.array([jenkins.exact(a) for a in mode.amplitude])
    damping = np.abs(mode.damping_ratio - exact[:, 1]).max() / mode.damping_ratio.max()
    frequency = np.abs(TWO_PI * mode.frequency / exact[:, 0] - 1.0).max()
    assert damping > 1e-3
    # the second mode is interpolated linearly between its points
    assert mode.damping_error == pytest.approx(damping, rel=0.1)
    assert mode.frequency_error == pytest.approx(frequency, rel=0.1)
    assert mode.richer == 21
    assert f"differs by {100 * mode.damping_error:.2g} %" in " ".join(str(mode).split())
    assert mode.damping_error < 0.05 and check(mode, "More harmonics").value == "pass"
    assert check(replace(mode, damping_error=0.06), "More harmonics").value == "uncertain"


def test_of_several_motions_with_one_amplitude_the_nearest_in_frequency_is_compared():
    """The second mode folds: one of its motions is 1 % off in frequency and damping, the other 20 %."""
    mode = oscillator(1).nonlinear_mode(0.0, 1, (1.5, 20.0))
    by_amplitude = dict(zip(mode.amplitude, zip(mode.frequency, mode.damping_ratio)))

    def motions(amplitude):
        frequency, damping = by_amplitude[amplitude]
        return [(1.2 * frequency, 1.2 * damping), (1.01 * frequency, 1.01 * damping)]

    found = mode._compared_with(SimpleNamespace(at=motions), 3)
    assert found.frequency_error == pytest.approx(0.01) == found.damping_error


def test_odd_harmonics_stay_odd_and_are_not_compared_unless_asked_for(tmp_path):
    mode = oscillator((1, 3)).nonlinear_mode(0.0, 1, (1e-3, 10.0), more_harmonics=2)
    assert mode.richer == 5 and 0.0 < mode.damping_error < 0.02
    assert list(_with_more_harmonics(oscillator((1, 3)).problem, 2).harmonic_numbers) == [1, 3, 5]
    assert list(_with_more_harmonics(oscillator(3).problem, 2).harmonic_numbers) == [1, 2, 3, 4, 5]
    alone = oscillator((1, 3)).nonlinear_mode(0.0, 1, (1e-3, 10.0))
    assert alone.richer == 0 and np.isnan(alone.damping_error)
    assert "More harmonics" not in str(alone)
    assert mode.cost.evaluations > 1.5 * alone.cost.evaluations
    mode.save(tmp_path / "mode.h5")
    assert bd.load(tmp_path / "mode.h5").damping_error == mode.damping_error


def test_all_losses_are_balanced():
    """The power of the force in proportion to mass is that of friction and of viscous damping."""
    study = wedge.study(0.5, 3)
    mode = study.nonlinear_mode(wedge.LOAD, 3, (1e-6, 1e-3), options=FINE)
    system = study.problem.system(wedge.LOAD)
    l = np.arange(1, 4)
    for i in range(0, len(mode), 10):
        X, F, _ = system.contact(mode.unknowns[i])
        friction = np.pi * (l * (F[..., 1::2] * X[..., 2::2] - F[..., 2::2] * X[..., 1::2])).sum()
        omega, power = TWO_PI * mode.frequency[i], np.zeros(2)
        for k in l:
            basis, a = (
                system.structure.bases[k],
                np.abs(system.layout.amplitudes(mode.unknowns[i], k)) ** 2,
            )
            power += np.pi * k**2 * omega * np.array([a @ basis.mass, a @ basis.damping])
        given = 2.0 * omega * mode.damping_ratio[i] * power[0]
        assert friction + power[1] == pytest.approx(given, rel=1e-9), i


def test_one_curve_serves_all_preloads():
    study = wedge.study(0.5, 3)
    one, other = (study.nonlinear_mode(p, 2, (p * 1e-8, p * 1e-5)) for p in (120.0, 30.0))
    assert one.scales_to == np.inf and one.complete and len(one.folds) == 6
    scaled = one.at_preload(30.0)
    assert len(scaled) == len(other) and scaled.preload == 30.0
    for name in ("amplitude", "frequency", "damping_ratio"):
        np.testing.assert_allclose(
            getattr(scaled, name), getattr(other, name), rtol=1e-6, err_msg=name
        )
    residual = [
        np.abs(
            study.problem.system(30.0).evaluate(u, TWO_PI * f)[0][
                : study.problem.system(30.0).n_mean
            ]
        ).max()
        for u, f in zip(scaled.unknowns, scaled.frequency)
    ]
    assert max(residual) < 1e-6 * 30.0
    # gaps count once they close
    study = bd.Study(
        bd.reference_model("turbine_blade"),
        bd.Excitation("tip", "tangential"),
        engine_order=5,
        friction_coefficient=0.3,
    )
    assert study.problem.static_system(1.0).n0.min() < 0.0
    mode = study.nonlinear_mode(100.0, 1, (2e-5, 3e-5))
    assert 100.0 < mode.scales_to < np.inf
    with pytest.raises(bd.SettingError, match=r"expected at most .* N, because a gap closes above"):
        mode.at_preload(2.0 * mode.scales_to)
    mode = oscillator(1).nonlinear_mode(0.0, 1, (0.5, 2.0))
    assert mode.scales_to == 0.0
    with pytest.raises(bd.SettingError, match="in proportion to the preload, found one without"):
        mode.at_preload(10.0)


@pytest.mark.slow
def test_a_constant_force_keeps_a_mode_at_its_preload():
    """A force that does not grow with the preload changes the static state otherwise."""
    study = wedge.study(0.5, 1)
    name, body = next(iter(study.model.bodies.items()))
    force = 1e-3 * np.arange(1.0, 1.0 + body.bases[0].n_modes)
    model = replace(
        study.model, bodies=study.model.bodies | {name: replace(body, constant_force=force)}
    )
    pushed = study.replace(model=model)
    assert pushed.problem.static_system(1.0).constant_force.any()
    assert study.nonlinear_mode(wedge.LOAD, 2, (1e-7, 1e-6)).scales_to == np.inf
    assert pushed.nonlinear_mode(wedge.LOAD, 2, (1e-7, 1e-6)).scales_to == 0.0


def test_motions_that_damping_ends_at_once_are_named():
    """A damping ratio of 0.6 without friction: no mode vibrates so."""
    mode = bd.lumped(
        1.0,
        1.2,
        1.0,
        contacts=[bd.Contact(0, kt=1.0, mu=1.0, preload=1.0)],
        forces={0: 1.0},
        harmonics=1,
    )
    found = mode.nonlinear_mode(0.0, 1, (2.0, 100.0))
    assert not found.complete and found.damping_ratio.max() > 0.5
    a = found.amplitude[np.argmax(found.damping_ratio > 0.5)]
    assert f"above {a:.6g} m the damping ratio exceeds 0.5" in found.reason
    light = oscillator(1).nonlinear_mode(0.0, 1, (2.0, 100.0))
    assert light.complete and "damping" not in light.reason


def test_the_amplitude_at_which_damping_becomes_too_high():
    """One mass m = k = kt = mu N = 1 with c = 1: friction raises the damping ratio to 0.5, in closed form."""
    study = bd.lumped(
        1.0, 1.0, 1.0, contacts=[bd.Contact(0, kt=1.0, mu=1.0, preload=1.0)], forces={0: 1.0},
        harmonics=1,
    )  # fmt: skip
    found = study.nonlinear_mode(0.0, 1, (0.8, 3.0))

    def damping_ratio(x):
        # elastic and dissipative part of the friction force, per displacement
        theta = np.arccos(1.0 - 2.0 / x)
        elastic = (theta - np.sin(2.0 * theta) / 2.0) / np.pi
        friction = 4.0 / (np.pi * x) * (1.0 - 1.0 / x)
        square = 1.0 + elastic
        return (np.sqrt(square) + friction) / (2.0 * square)

    exact = scipy.optimize.brentq(lambda x: damping_ratio(x) - 0.5, 1.01, 3.0)
    (text,) = re.findall(r"above (\S+) m the damping ratio exceeds 0.5", found.reason)
    assert float(text) == pytest.approx(exact, rel=2e-3)


def own_modes(mu, harmonics, ends):
    """The branch as the program of the tests follows it, and the points of it at an amplitude."""
    program = wedge.Program(mu, harmonics)
    points = program.branch(program.start(*program.stuck(2), ends[0]), ends[1])

    def at(amplitude):
        found, a = [], points[:, -1] - np.log(amplitude)
        for i in np.flatnonzero(a[:-1] * a[1:] <= 0.0):
            for part in (a[i] / (a[i] - a[i + 1]), 0.0, 1.0):  # between both, or from either
                guess = points[i] + part * (points[i + 1] - points[i])
                guess[-1] = np.log(amplitude)
                if (solved := program.newton(guess, np.eye(len(guess))[-1], 20)) is not None:
                    break
            found.append((1e3 * solved[0][-3] / TWO_PI, solved[0][-2]))
        return found

    return at


def polished(study, mode, amplitude):
    """All motions of a mode at an amplitude, by the equations at this amplitude."""
    system, _ = mode_system(study.problem, mode.preload, mode.mode, float(mode.amplitude.min()))
    a, found = np.log(mode.amplitude / amplitude), []
    for i in np.flatnonzero(a[:-1] * a[1:] <= 0.0):
        near = (
            (mode.unknowns[j], TWO_PI * mode.frequency[j], mode.damping_ratio[j])
            for j in (i, i + 1)
        )
        ends = [system.structure.point(*one) for one in near]
        guess = ends[0] + a[i] / (a[i] - a[i + 1]) * (ends[1] - ends[0])
        c = system.correct_at(
            guess[:-1],
            np.log(amplitude / system.structure.reference),
            np.abs(guess) + 1e-9,
            1e-11,
            20,
        )
        assert c.status == 0
        found.append((c.y[-3] / TWO_PI, c.y[-2]))
    return found


@pytest.mark.slow
@pytest.mark.parametrize(("mu", "harmonics"), [(0.3, 1), (0.5, 2), (0.8, 3)])
def test_the_planar_wedge_as_an_independent_program_has_it(mu, harmonics):
    """Through both folds: the same motions, three at one amplitude, and the same frequency and damping of each."""
    study, ends = wedge.study(mu, harmonics), (3e-5, 4e-4)
    at = own_modes(mu, harmonics, ends)
    mode = study.nonlinear_mode(wedge.LOAD, 3, ends)
    assert len(mode.folds) == 2
    for amplitude in (5e-5, 1.3e-4, 2e-4, 2.7e-4, 3.8e-4):
        one, other = at(amplitude), polished(study, mode, amplitude)
        assert len(one) == len(other) and (len(one) == 3 or not 1.2e-4 < amplitude < 2.8e-4), (
            amplitude
        )
        np.testing.assert_allclose(other, one, rtol=1e-6, err_msg=str(amplitude))


def test_the_planar_wedge_begins_to_slip_as_an_independent_program_has_it():
    mode = wedge.study(0.5, 3).nonlinear_mode(wedge.LOAD, 3, (3e-5, 5e-5))
    ((frequency, damping),) = own_modes(0.5, 3, (4.4e-5, 4.5e-5))(4.45e-5)
    ((other, zeta),) = polished(wedge.study(0.5, 3), mode, 4.45e-5)
    assert damping > 0.01
    assert (other, zeta) == pytest.approx((frequency, damping), rel=1e-6)


def test_what_does_not_fit_is_named():
    study = wedge.study(0.5, 1)
    with pytest.raises(bd.SettingError, match="mode: expected"):
        study.nonlinear_mode(wedge.LOAD, 9, (1e-6, 1e-4))
    with pytest.raises(bd.SettingError, match=r"amplitude: expected \(low, high\) in m"):
        study.nonlinear_mode(wedge.LOAD, 1, (1e-4, 1e-6))
    two = bd.lumped(
        [1.0, 1.0],
        0.0,
        [1.0, 4.0],
        contacts=[bd.Contact(0, kt=1, mu=1, preload=1)],
        forces={0: 1.0},
        response=0,
    )
    with pytest.raises(bd.SettingError, match="mode 2 does not move"):
        two.nonlinear_mode(0.0, 2, (0.1, 1.0))


@pytest.mark.slow
def test_a_path_that_leaves_the_symmetric_motion_says_so_and_the_advice_helps():
    """A friction-damped beam: with all harmonics the path takes a branch with even ones, and turns back."""
    mass, stiffness = rigs.beam_matrices()
    contact = bd.Contact(rigs.AT_CONTACT, kt=rigs.CONTACT_STIFFNESS, mu=1.0, preload=106.0)
    study = bd.lumped(
        mass,
        0.0 * mass,
        stiffness,
        contacts=[contact],
        forces={rigs.AT_TIP: 1.0},
        response=rigs.AT_TIP,
        harmonics=15,
    )
    mode = study.nonlinear_mode(0.0, 1, (1e-5, 2e-2))
    assert not mode.complete
    advice = "and the path left it: compute it with harmonics=tuple(range(1, 16, 2)); there is another branch"
    assert advice in mode.reason
    odd = study.replace(harmonics=tuple(range(1, 16, 2))).nonlinear_mode(0.0, 1, (1e-5, 2e-2))
    assert odd.complete
    # the complex eigenvalues of one harmonic have 17.99 %; see also docs/measurements.md
    assert odd.damping_ratio.max() == pytest.approx(0.187, abs=0.0005)
    assert mode.cost.condensed > 0.999 * mode.cost.factorisations > 500.0


@pytest.mark.parametrize("gap_stiffness", [1.0, 20.0])
def test_a_path_turned_by_an_internal_resonance_says_up_to_which_amplitude(gap_stiffness):
    study = bd.lumped(
        np.diag([1.0, 0.3]),
        np.zeros((2, 2)),
        np.array([[4.0, -3.0], [-3.0, 4.0]]),
        contacts=[bd.Contact(normal=0, kn=gap_stiffness, gap=1.0)],
        forces={0: 1.0},
        response=0,
        harmonics=9,
    )
    mode = study.nonlinear_mode(0.0, 1, (0.1, 100.0))
    found = re.search(
        r"a harmonic resonates with another mode: compute it with other harmonics, or with amplitudes "
        r"below ([\d.]+) m",
        mode.reason,
    )
    assert found and not mode.complete
    assert study.nonlinear_mode(0.0, 1, (0.1, 0.999 * float(found[1]))).complete
