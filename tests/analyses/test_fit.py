"""Parameters from synthetic measurements: recovered where the model is right, bracketed where it is not."""

import re
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.linalg

import bdamper as bd
from bdamper.analyses import response_residuals
from bdamper.analyses.fit import (
    UNLOADED,
    Objective,
    _predictions,
    _profile,
    _Stage,
    _stage,
    covariance,
    fit,
    left_out,
    repetitions,
)
from bdamper.analyses.response_residuals import Separation, Variations, _Swept
from bdamper.harmonic_balance.parameters import vary
from bdamper.importers.measured_modes import MeasuredMode
from bdamper.importers.measurements import Measured
from bdamper.response.response_curve import sweep_of
from bdamper.util.errors import StaticError
from benchmarks.rigs import (
    AT_CONTACT,
    AT_TIP,
    CONTACT_STIFFNESS,
    FRICTION_LIMIT,
    beam_matrices,
    fitted_to,
    friction_damped_beam,
    rows_of,
)
from tests.printed import said

RANGES = {"friction_coefficient": (0.1, 0.9), "contact_stiffness_factor": (0.2, 5.0)}
TRUE = {"friction_coefficient": 0.4, "contact_stiffness_factor": 1.3}
LOADS = 0.5, 2.0, 6.0  # slips through, slips, mostly sticks under 1 N


@pytest.fixture(scope="module")
def jenkins():
    """One mass with an elastic friction element, whose normal load is that of a second mass."""
    contact = bd.Contact(tangential=0, normal=1, kt=1.0, kn=20.0, mu=0.5)
    return bd.lumped(
        [1.0, 1.0],
        [0.02, 0.02],
        [2.0, 1.0],
        contacts=[contact],
        forces={0: 1.0},
        load_per_preload={1: 1.0},
        harmonics=1,
    )


def measured(study, test, noise=0.0, seed=0):
    """A test with the response of a study at its frequencies, found by the equations alone, and noise."""
    f = test.data.frequency
    swept = _Swept(
        Variations(lambda _: study.problem, {}), test, (f[0] * (1.0 - 1e-6), f[-1] * (1.0 + 1e-6))
    )
    noise_of = np.random.default_rng(seed).standard_normal((2, len(f))) * noise
    exact = np.array([swept.response(swept.at(at, factor)) for at, factor in zip(f, test.factors)])
    response = exact * np.exp(noise_of[0] + 1j * noise_of[1])
    response = response if test.data.response.imag.any() else np.abs(response) + 0j
    return replace(test, data=replace(test.data, response=response))


def blank(preload, band, n=20, phase=True, **how):
    unit = np.ones(n) * (1j if phase else 1.0)
    return bd.MeasuredResponse(
        bd.importers.Measurement(f"{preload:g} N", np.linspace(*band, n), unit), preload, **how
    )


@pytest.fixture(scope="module")
def tests(jenkins):
    truth = vary(jenkins, TRUE)
    return [measured(truth, blank(load, (0.2, 0.32), phase=load != 2.0)) for load in LOADS]


@pytest.mark.slow
def test_a_jenkins_oscillator_is_recovered_without_noise(jenkins, tests):
    found = fit(jenkins, tests, RANGES)
    assert found.values == pytest.approx(list(TRUE.values()), rel=1e-6)
    assert found.misfit < 1e-6 and found.status == "complete"
    assert found.information.sum(axis=1) == pytest.approx([1.0, 1.0])
    assert (
        found.information[0].argmax() == 1 and found.information[1].argmax() == 2
    )  # slip tells friction, stick stiffness


@pytest.mark.slow
def test_derivatives_of_residuals(jenkins, tests):
    objective = Objective(
        jenkins, tests, RANGES | {"damping_factor": (0.1, 10.0), "force_factor": (0.5, 2.0)}, 0.02
    )
    x = np.log([0.45, 1.1, 1.2, 1.1])
    exact, step = objective.jacobian(x), 1e-5
    for j, away in enumerate(step * np.eye(4)):
        difference = (objective.residual(x + away) - objective.residual(x - away)) / (2.0 * step)
        assert np.abs(exact[:, j] - difference).max() < 1e-5 * np.abs(difference).max()


def test_derivatives_of_distances_at_a_jump():
    """Points around a fold are compared with the whole curve, with finite derivatives on either side."""
    study = bd.lumped(1.0, 0.04, 1.0, cubic={0: 0.05}, forces={0: 0.12}, harmonics=1)
    curve = study.frequency_response(0.0, (0.12, 0.28))
    (jump,) = sweep_of(curve, "up").jumps
    test = measured(study, blank(0.0, (0.97 * jump.frequency, 1.03 * jump.frequency), 25))
    objective = Objective(
        study, [test], {"force_factor": (0.5, 2.0), "damping_factor": (0.5, 2.0)}, 0.02
    )
    assert np.abs(objective.residual(np.zeros(2))).max() < 1e-5
    x, step = np.log([1.01, 0.99]), 1e-6
    exact = objective.jacobian(x)
    near = np.abs(np.log(test.data.frequency / jump.frequency)) < 0.01
    assert np.isfinite(exact).all() and np.abs(exact.reshape(-1, 2, 2)[near]).max() > 0.0
    for j, away in enumerate(step * np.eye(2)):
        difference = np.abs(objective.residual(x + away)) - np.abs(objective.residual(x - away))
        signed = exact[:, j] * np.sign(objective.residual(x))
        assert np.allclose(
            signed, difference / (2.0 * step), rtol=1e-3, atol=1e-3 * np.abs(exact[:, j]).max()
        )


@pytest.mark.slow
def test_stages_and_resonances():
    """Damping, frequency and force gain from the response without damper; friction from resonances over load."""
    study = bd.Study(bd.reference_model("turbine_blade"), bd.Excitation("tip"), 5, harmonics=1)
    truth = vary(
        study, {"friction_coefficient": 0.4, "damping_factor": 1.3, "frequency_factor": 1.01}
    )
    limit = truth.free((500.0, 700.0)).peak
    width = 0.01 * limit.frequency
    plan = blank(0.0, (limit.frequency - width, limit.frequency + width), 20, force=1.05)
    free = bd.MeasuredResponse(measured(truth, plan).data, 0.0)  # the cell has shown 1 N of 1.05 N
    loads = np.array([0.0, 20.0, 60.0, 200.0])
    peaks = [limit, *(truth.peak(load) for load in loads[1:])]
    data = Measured(
        loads,
        np.array([p.amplitude for p in peaks]),
        np.array([p.frequency for p in peaks]),
        "resonances",
    )
    found = fit(study, data, {"friction_coefficient": (0.2, 0.8)}, free=free)
    assert found.names == (
        "damping_factor",
        "frequency_factor",
        "force_factor",
        "friction_coefficient",
    )
    assert found.values[:3] == pytest.approx([1.3, 1.01, 1.05], rel=1e-4)
    assert np.isfinite(found.low).all() and (found.low <= found.values).all()
    resonances = (
        found.test == 1
    )  # in Hz and m, as the swept response is, so that one picture shows both
    assert found.place[resonances] == pytest.approx(data.frequency[1:], rel=1e-4)
    assert np.abs(found.measured[resonances]) == pytest.approx(
        data.amplitude[1:] * found["force_factor"], rel=1e-3
    )
    assert found.apply(study).settings.friction_coefficient == found["friction_coefficient"]


def test_intervals_beside_a_richer_fit(jenkins, tests):
    """They hold both fits and the interval of the richer one."""
    found = fit(jenkins, tests[1], {"friction_coefficient": (0.1, 0.9)})
    for factor in (0.8, 1.3):
        richer = replace(
            found,
            values=factor * found.values,
            low=0.98 * factor * found.low,
            high=1.02 * factor * found.high,
        )
        both = found.widen(richer)
        assert both.low[0] <= min(found.low[0] / max(factor, 1 / factor), richer.low[0]) * (
            1.0 + 1e-12
        )
        assert both.high[0] >= max(found.high[0] * max(factor, 1 / factor), richer.high[0]) * (
            1.0 - 1e-12
        )
        assert both.values == found.values
        assert both.notes[-1].startswith(
            "intervals include a fit with 1 harmonic, 10 blade modes, "
        )
    with pytest.raises(bd.SettingError, match="richer: expected a fit of"):
        found.widen(replace(found, names=("damping_factor",)))


def oscillator(frequency=0.2, stiffness=0.5, friction=1.0, exponent=0.8):
    return bd.joint(frequency, 0.01, stiffness, friction, exponent, sliders=4)


@pytest.mark.slow
def test_a_joint_is_recovered_from_forces_that_differ_between_points():
    """The stuck frequency, stiffness and friction limits of a function, without noise and from other initial values."""
    true = {"frequency": 0.204, "stiffness": 0.4, "friction": 1.3}
    runs = []
    for k, level in enumerate((0.02, 0.06, 0.2)):
        plan = blank(0.0, (0.17, 0.23), 12)
        force = level * (1.0 + 0.4 * np.sin(np.arange(12.0) + k))
        runs.append(
            measured(oscillator(**true), replace(plan, data=replace(plan.data, force=force)))
        )
    ranges = {"frequency": (0.15, 0.25), "stiffness": (0.1, 1.0), "friction": (0.1, 1.5)}
    found = fit(oscillator, runs, ranges)
    assert found.values == pytest.approx(list(true.values()), rel=1e-5) and found.misfit < 1e-3
    assert (
        found.apply(oscillator).problem.model.hash
        == oscillator(**dict(zip(found.names, found.values))).model.hash
    )
    at, factor = runs[0].data.frequency[3], runs[0].factors[3]
    alone = measured(
        oscillator(**true), blank(0.0, (0.17, 0.23), 12, force=factor * runs[0].nominal)
    )
    assert (
        runs[0].data.response[3] == pytest.approx(alone.data.response[3], rel=1e-8)
        and at == alone.data.frequency[3]
    )


JOINT = {"frequency": 0.204, "stiffness": 0.4, "friction": 1.3}
WIDE = {"frequency": (0.15, 0.25), "stiffness": (0.1, 1.0), "friction": (0.1, 5.0)}


def controlled(control, frequency, response, force):
    data = bd.importers.Measurement(
        control, np.array(frequency), np.array(response) + 0j, force=np.array(force)
    )
    return bd.MeasuredResponse(data, control=control)


def by_differences(objective, x, step=1e-5):
    """Largest relative error of the derivatives with respect to each parameter."""
    exact = objective.jacobian(x)
    ways = (objective.residual(x + d) - objective.residual(x - d) for d in step * np.eye(len(x)))
    return [
        np.abs(exact[:, j] - way / (2.0 * step)).max() / np.abs(exact[:, j]).max()
        for j, way in enumerate(ways)
    ]


@pytest.mark.slow
def test_a_joint_is_recovered_from_its_nonlinear_mode():
    """Amplitude, frequency and damping of free vibration, some of them not measured; force and damping ratio balance."""
    mode = oscillator(**JOINT).nonlinear_mode(0.0, 1, (0.1, 3.0))
    rows = np.arange(0, len(mode), len(mode) // 8)
    data = MeasuredMode(
        mode.amplitude[rows], mode.frequency[rows].copy(), mode.damping_ratio[rows].copy()
    )
    data.frequency[1], data.damping_ratio[2] = np.nan, np.nan
    objective = Objective(oscillator, [data], WIDE, 0.02)
    assert np.abs(objective.residual(np.log(list(JOINT.values())))).max() < 1e-4
    assert max(by_differences(objective, np.log([0.201, 0.45, 1.1]))) < 1e-5
    found = fit(oscillator, data, WIDE, intervals="linear")
    assert (
        found.values == pytest.approx(list(JOINT.values()), rel=1e-5) and found.status == "complete"
    )
    wrong = MeasuredMode(data.amplitude, 1.01 * data.frequency, data.damping_ratio, noise=0.01)
    residual = (
        Objective(oscillator, [wrong], WIDE, 0.02).parts(np.log(list(JOINT.values())))[0].residual
    )
    assert (
        residual[0] == pytest.approx([0.0, -np.log(1.01) / 0.01], abs=1e-4)
        and residual[1, 1] == residual[2, 0] == 0.0
    )


@pytest.mark.slow
def test_response_control_has_one_force_where_the_curve_has_three_responses():
    """Force of a Duffing oscillator at constant amplitude, in closed form, across the overhang of its curves."""

    def duffing(damping=0.03, cubic=0.07):
        return bd.lumped(1.0, damping, 1.0, cubic={0: cubic}, forces={0: 0.12}, harmonics=1)

    f, size = np.linspace(0.15, 0.2, 11), 1.5
    stiffness = 1.0 + 0.75 * 0.05 * size**2 - (2.0 * np.pi * f) ** 2 + 0.04j * 2.0 * np.pi * f
    ranges = {"damping": (0.01, 0.1), "cubic": (0.01, 0.2), "force_factor": (0.5, 2.0)}
    for phase in (0.0, 1.0):  # without phases, and with them
        response = size * np.exp(-1j * phase * np.angle(stiffness))
        test = controlled("response", f, response, size * np.abs(stiffness))
        objective = Objective(duffing, [test], ranges, 0.02)
        assert np.abs(objective.residual(np.log([0.04, 0.05, 1.0]))).max() < 1e-9
        assert max(by_differences(objective, np.log([0.03, 0.06, 1.1]))) < 1e-6
    found = fit(
        duffing, test, {name: ranges[name] for name in ("damping", "cubic")}, intervals="linear"
    )
    assert found.values == pytest.approx([0.04, 0.05], rel=1e-6)


@pytest.mark.slow
def test_phase_control_of_a_joint():
    """Force and frequency at phase resonance and given amplitude: for one mode those of the nonlinear mode."""
    mode = oscillator(**JOINT).nonlinear_mode(0.0, 1, (0.1, 3.0))
    rows = np.arange(0, len(mode), len(mode) // 6)
    f, size = mode.frequency[rows], mode.amplitude[rows]
    force = 2.0 * mode.damping_ratio[rows] * (2.0 * np.pi * f) ** 2 * size
    test = controlled("phase", f, size, force)
    objective = Objective(oscillator, [test], WIDE | {"force_factor": (0.5, 2.0)}, 0.02)
    assert np.abs(objective.residual(np.log([*JOINT.values(), 1.0]))).max() < 1e-4
    assert max(by_differences(objective, np.log([0.202, 0.45, 1.1, 1.05]))) < 1e-6
    assert objective.residual(np.log([*JOINT.values(), 1.1]))[::2] == pytest.approx(
        np.full(len(f), np.log(1.1) / 0.02)
    )
    found = fit(oscillator, test, WIDE, intervals="linear")
    assert found.values == pytest.approx(list(JOINT.values()), rel=1e-5)


@pytest.mark.slow
def test_repeated_tests_give_the_noise_and_are_left_out_together(jenkins):
    truth = vary(jenkins, TRUE)
    plans = [blank(load, (0.2, 0.32), 40, phase=False) for load in (0.5, 2.0, 2.0, 2.0)]
    runs = [measured(truth, plan, 0.03, i) for i, plan in enumerate(plans)]
    groups, scatter = repetitions(runs)
    logs = np.log([np.abs(run.data.response) for run in runs[1:]])
    assert groups == [0, 1, 1, 1] and scatter == pytest.approx(
        np.sqrt(logs.var(axis=0, ddof=1).mean()), rel=1e-9
    )
    assert scatter == pytest.approx(0.03, rel=0.2)
    found = fit(jenkins, runs, {"friction_coefficient": (0.1, 0.9)})
    assert found.noise == scatter and "the scatter of repeated tests" in found.notes[0]
    alone = fit(jenkins, runs[:1], {"friction_coefficient": (0.1, 0.9)}, noise=scatter)
    new = Objective(jenkins, runs, {"friction_coefficient": (0.1, 0.9)}, scatter).parts(
        np.log(alone.values)
    )
    expected = [np.sqrt((part.residual[:, 0] ** 2).mean()) for part in new]
    assert found.predictions[1:] == pytest.approx(expected[1:], rel=2e-3)
    objective = Objective(jenkins, runs, {"friction_coefficient": (0.1, 0.9)}, scatter)
    x, half = np.log(found.values), 2 * len(runs[0].data.frequency)
    r, J = objective.residual(x), objective.jacobian(x)
    assert found.left_out == pytest.approx(
        left_out(r, J, [slice(half), slice(half, None)]), rel=1e-6
    )
    assert fit(jenkins, runs[0], {"friction_coefficient": (0.1, 0.9)}).noise == 0.02
    apart = [
        replace(runs[1], preload=3.0),
        replace(runs[1], sweep="down"),
        replace(runs[1], force=2.0),
        runs[1],
    ]
    assert repetitions(apart) == ([0, 1, 2, 3], 0.0)
    parts = [
        measured(truth, blank(2.0, band, 10, phase=False), 0.0, 0)
        for band in ((0.2, 0.25), (0.26, 0.32))
    ]
    assert repetitions(parts) == ([0, 1], 0.0), "two parts of one test have no frequency in common"


def test_predictions_are_those_of_fits_without_a_test(jenkins):
    tests = drawn_tests(np.random.default_rng(6), 4, 6, 3.0)
    found = _stage(linear(jenkins, tests)).result
    for i, (A, b) in enumerate(tests):
        rest = [test for j, test in enumerate(tests) if j != i]
        x = np.linalg.lstsq(
            np.concatenate([A for A, _ in rest]), np.concatenate([b for _, b in rest]), rcond=None
        )[0]
        assert found.predictions[i] == pytest.approx(np.sqrt(((A @ x - b) ** 2).mean()), rel=1e-6)
    assert "a fit without one test predicts this test with an error of" in said(found)
    only = _stage(linear(jenkins, tests[:1])).result
    assert np.isnan(only.predictions).all() and "fit without one test" not in said(only)


def test_priors_are_measurements_of_the_parameters(jenkins):
    """Linear residuals with a narrow prior: the prior holds one parameter, the other is fitted beside it."""
    tests = drawn_tests(np.random.default_rng(7), 2, 8, 0.5)
    objective = linear(jenkins, tests)
    objective.priors = {"friction_coefficient": (1.2, 1e-5)}
    found = _stage(objective).result
    A, b = np.concatenate([A for A, _ in tests]), np.concatenate([b for _, b in tests])
    other = A[:, 1] @ (b - A[:, 0] * np.log(1.2)) / (A[:, 1] @ A[:, 1])
    assert found.values == pytest.approx([1.2, np.exp(other)], rel=1e-4)
    assert (
        found.deviation[0] == pytest.approx(1e-5 / 1.2, rel=1e-2)
        and found.information[0].sum() < 1e-6
    )
    x = np.array([0.1, 0.2])
    assert objective.residual(x)[-1] == pytest.approx((np.exp(0.1) - 1.2) / 1e-5)
    assert max(by_differences(objective, x)) < 1e-6


def test_priors_that_the_data_contradict_are_named(jenkins):
    """Linear residuals: the data alone give a value and its deviation, and a narrow prior lies some of them away."""
    tests = drawn_tests(np.random.default_rng(8), 2, 8, 0.5)
    objective = linear(jenkins, tests)
    A, b = np.concatenate([A for A, _ in tests]), np.concatenate([b for _, b in tests])
    alone, deviation = (
        np.linalg.lstsq(A, b, rcond=None)[0][0],
        np.sqrt(np.linalg.inv(A.T @ A)[0, 0]),
    )
    for away in (-48.0, 5.0, 2.0):
        mean = float(np.exp(alone + away * deviation))
        objective.priors = {"friction_coefficient": (mean, 1e-6)}
        objective.ranges = dict.fromkeys(objective.ranges, (1e-9, 1e9))
        reason = _stage(objective).result.reason
        prior, distance = (
            f"the prior of friction coefficient ({mean:g} with 1e-06)",
            f"{abs(away):.2g} standard deviations",
        )
        assert (f"{prior} is {distance} from the data" in reason) == (abs(away) > 3.0)


@pytest.mark.slow
@pytest.mark.parametrize("times", [3.0, 10.0, 100.0, 0.1])
@pytest.mark.parametrize("control", ["response", "phase"])
def test_a_force_of_wrong_gain_is_a_residual_of_its_logarithm(control, times):
    """The motion that 1 N causes is recorded with another force: the ratio of forces is the misfit at every point."""
    motion = measured(oscillator(), blank(0.0, (0.16, 0.24), 7)).data
    data = controlled(control, motion.frequency, motion.response, np.full(7, times))
    objective = Objective(oscillator, [data], {"friction": (0.1, 10.0)}, 0.02)
    (part,) = objective.parts(np.log([1.0]))
    assert not part.lost.any()
    assert part.residual[:, 0] == pytest.approx(np.full(7, np.log(times) / 0.02), rel=1e-6)
    assert np.abs(part.residual[:, 1]).max() < 1e-4


@pytest.mark.slow
def test_a_fit_to_a_force_of_wrong_gain_says_that_the_model_is_wrong():
    """Far from the right friction limit, some points have no solution with a force near the nominal one."""
    curve = oscillator().frequency_response(0.0, (0.15, 0.25))
    rows = np.linspace(1, len(curve) - 2, 15).astype(int)
    for times in (3.0, 10.0):
        data = controlled(
            "response", curve.frequency[rows], curve.amplitude[rows], np.full(15, times)
        )
        found = fit(oscillator, data, {"friction": (0.1, 10.0)}, noise=0.02, intervals="linear")
        assert found.status_text.startswith("incomplete: the model does not describe these data")


@pytest.mark.slow
def test_a_preload_without_response_curve_is_refused_in_one_line():
    blade = bd.reference_model("turbine_blade")
    study = bd.Study(
        blade,
        bd.Excitation("tip", amplitude=1.0),
        engine_order=5,
        friction_coefficient=0.3,
        harmonics=1,
    )
    data = controlled("response", [650.0, 660.0, 670.0], np.full(3, 1e-5), np.ones(3))
    with pytest.raises(
        bd.BdamperError, match=r"no response could be computed .* does not keep the damper"
    ) as caught:
        fit(study, replace(data, preload=1e-6), {"friction_coefficient": (0.1, 1.0)})
    assert "\n" not in str(caught.value)


BEAM = (
    Path(__file__).resolve().parents[3]
    / "shared"
    / "fixtures"
    / "measured"
    / "brb_force_controlled.csv"
)


@pytest.mark.slow
@pytest.mark.skipif(not BEAM.exists(), reason="the measurements are not part of the project")
def test_a_measured_joint_is_fitted_and_predicts_the_damping_of_a_sweep_left_out():
    def beam(frequency=80.4, damping_ratio=1.5e-3, stiffness=2e4, friction=5.0, exponent=1.0):
        return bd.joint(frequency, damping_ratio, stiffness, friction, exponent, mass=1.9505)

    runs = [
        bd.MeasuredResponse(each)
        for each in bd.importers.read_responses(BEAM, "level", phase_of="none")
    ]
    ranges = {"frequency": (79.0, 82.0), "damping_ratio": (1e-4, 1e-2), "stiffness": (1e3, 4e5)}
    ranges |= {"friction": (0.1, 500.0), "exponent": (0.1, 4.0)}
    for left in (None, 0, 2):
        kept = [run for k, run in enumerate(runs) if k != left]
        found = fit(beam, kept, ranges, noise=0.05, intervals="linear")
        if left is None:
            assert np.sqrt((np.log(np.abs(found.model / found.measured)) ** 2).mean()) < 0.125
            continue
        data = runs[left].data
        k, amplitude = int(data.amplitude.argmax()), np.abs(data.displacement)
        mode = found.apply(beam).nonlinear_mode(
            0.0, 1, (0.5 * amplitude.min(), 1.3 * amplitude.max())
        )
        assert mode.at(amplitude[k])[0][1] == pytest.approx(
            data.force[k] / (2.0 * 1.9505 * data.amplitude[k]), rel=0.2
        )


def test_the_friction_damped_beam_is_that_of_complex_eigenvalues():
    """All degrees of freedom, one harmonic: (K + k(x) r r^T) u = omega^2 (1 + 2 i zeta) M u.

    The element slips between the amplitudes x and x_0 = F / k.  With theta = arccos(1 - 2 x_0 / x)
    its harmonic stiffness k(x) is k (theta - sin(2 theta) / 2) / pi + 4 i F (1 - x_0 / x) / (pi x).
    """
    mass, stiffness = beam_matrices()
    k, slip = CONTACT_STIFFNESS, FRICTION_LIMIT / CONTACT_STIFFNESS
    damping, tip = [], []
    for ratio in np.geomspace(1.5, 200.0, 400):
        x = ratio * slip
        theta = np.arccos(1.0 - 2.0 * slip / x)
        elastic = k / np.pi * (theta - 0.5 * np.sin(2.0 * theta))
        lost = 4.0 * FRICTION_LIMIT * (1.0 - slip / x) / (np.pi * x)
        at_slip = stiffness.astype(complex)
        at_slip[AT_CONTACT, AT_CONTACT] += elastic + 1j * lost
        values, vectors = scipy.linalg.eig(at_slip, mass)
        first = int(np.argmin(values.real))
        damping.append(values[first].imag / (2.0 * values[first].real))
        tip.append(x * abs(vectors[AT_TIP, first] / vectors[AT_CONTACT, first]))
    mode = friction_damped_beam(1).nonlinear_mode(0.0, 1, (1e-5, 1e-3))
    found = np.interp(tip, mode.amplitude, mode.damping_ratio)
    known = (np.array(tip) > 1.2e-5) & (np.array(tip) < 9e-4)
    assert known.sum() > 200
    np.testing.assert_allclose(found[known], np.array(damping)[known], rtol=0.01)
    assert mode.damping_ratio.max() == pytest.approx(max(damping), rel=3e-3)


HAMMER = BEAM.parents[1] / "field" / "brb_hammer_mode.csv"


@pytest.mark.slow
@pytest.mark.skipif(not HAMMER.exists(), reason="the measurements are not part of the project")
def test_sweeps_of_a_joint_predict_the_hammer_test_and_the_page_says_by_how_much(tmp_path):
    for file in (BEAM, HAMMER):
        (tmp_path / file.name).write_bytes(file.read_bytes())
    page = (Path(__file__).parents[2] / "docs" / "measurements.md").read_text()
    computed = fitted_to(tmp_path)
    of_hammer, f_hammer, *_ = computed["sweeps"]
    assert np.abs(of_hammer).max() < 0.15 and np.abs(f_hammer).max() < 0.002
    for row in rows_of(computed):
        numbers = [float(x) for x in re.findall(r"[+-][\d.]+", row)]
        (stated,) = [
            [float(x) for x in re.findall(r"[+-][\d.]+", line)]
            for line in page.splitlines()
            if line.startswith(row[: row.index("|", 2)])
        ]
        assert numbers == pytest.approx(stated, abs=1.1)


class Linear(Objective):
    """Residuals A x - b of several tests; x are the logarithms of the parameters, so statistics are closed forms."""

    def parts(self, x):
        out = []
        for A, b in self.held["tests"]:
            residual = np.column_stack([A @ x - b, np.zeros(len(b))])
            slopes = np.stack([A, 0.0 * A], axis=1) / np.exp(x)
            empty = np.ones(len(b))
            out.append(
                Separation(
                    empty,
                    empty + 0j,
                    empty + 0j,
                    residual,
                    lambda slopes=slopes: slopes,
                    empty < 0.0,
                )
            )
        return out


def linear(jenkins, tests):
    ranges = {name: (np.exp(-20.0), np.exp(20.0)) for name in RANGES}
    data = [Measured(np.zeros(1), np.ones(1), np.ones(1), f"test {i}") for i in range(len(tests))]
    return Linear(jenkins, data, ranges, 0.02, {"tests": tests})


def drawn_tests(rng, n_tests, size, spread=1.0):
    """Draw tests whose best parameters are near 0."""
    return [
        (rng.standard_normal((size, 2)), spread * rng.standard_normal(size)) for _ in range(n_tests)
    ]


@pytest.mark.parametrize("spread", [0.5, 5.0])
def test_deviations_and_intervals_count_a_misfit_beyond_the_noise(jenkins, spread):
    """Compare the covariance with that of linear regression; residuals below the noise do not reduce it."""
    tests = drawn_tests(np.random.default_rng(4), 3, 8, spread)
    A, b = np.concatenate([A for A, _ in tests]), np.concatenate([b for _, b in tests])
    best, (square,), _, _ = np.linalg.lstsq(A, b, rcond=None)
    expected = np.sqrt(max(square / (len(b) - 2), 1.0) * np.diag(np.linalg.inv(A.T @ A)))
    stage = _stage(linear(jenkins, tests))
    found, C = stage.result, stage.covariance
    assert np.log(found.values) == pytest.approx(best, abs=1e-6)
    assert found.deviation == pytest.approx(expected, rel=1e-6) and np.sqrt(
        np.diag(C)
    ) == pytest.approx(expected, rel=1e-6)
    half = np.log(found.high / found.low) / 2.0
    if spread < 1.0:
        assert half == pytest.approx(
            2.0739 * expected, rel=0.06
        )  # t distribution, 22 degrees of freedom
    else:
        assert (
            half > 2.0 * 2.0739 * expected
        ).all()  # the sum of squares rises by three times its excess


def test_tests_left_out_are_those_of_a_jackknife_by_new_fits(jenkins):
    tests = drawn_tests(np.random.default_rng(5), 4, 6, 3.0)
    kept = [[test for j, test in enumerate(tests) if j != i] for i in range(4)]
    ways = [
        (np.concatenate([A for A, _ in some]), np.concatenate([b for _, b in some]))
        for some in kept
    ]
    each = np.array([np.linalg.lstsq(A, b, rcond=None)[0] for A, b in ways])
    found = _stage(linear(jenkins, tests)).result
    assert found.left_out == pytest.approx(np.sqrt(3.0 * each.var(axis=0)), rel=1e-5)
    assert (
        np.log(found.high / found.low) / 2.0 >= 3.18 * found.left_out
    ).all()  # t distribution, 3 degrees of freedom


def test_a_profile_follows_a_curved_valley(jenkins):
    """Residuals x0 and 100 (x1 - x0^2): with x1 fitted again the sum of squares is x0^2, otherwise it rises at once."""

    class Valley(Objective):
        def residual(self, x):
            return np.array([x[0], 100.0 * (x[1] - x[0] ** 2)])

        def jacobian(self, x):
            return np.array([[1.0, 0.0], [-200.0 * x[0], 100.0]])

    valley = Valley(jenkins, [], {name: (np.exp(-20.0), np.exp(20.0)) for name in RANGES}, 0.02)
    for start in (0.5, 2.0, 30.0):
        assert _profile(valley, np.zeros(2), 0, 4.0, start) == pytest.approx([2.0, 2.0], rel=0.06)


def test_covariance_of_a_parameter_without_effect_is_large():
    J = np.array([[1.0, 0.0], [2.0, 0.0]])
    assert covariance(J)[0, 0] == pytest.approx(0.2) and covariance(J)[1, 1] > 1e12


@pytest.mark.slow
def test_coverage_of_linear_fits(jenkins):
    """Of 200 drawn linear fits with the right noise (seed 65) 90 to 99 % of the intervals contain the truth."""
    rng, inside = np.random.default_rng(65), []
    for _ in range(200):
        stage = _stage(
            linear(jenkins, drawn_tests(rng, int(rng.integers(1, 4)), int(rng.integers(8, 17))))
        )
        found = stage.result
        inside.append((found.low <= 1.0) & (found.high >= 1.0))
    print(np.mean(inside))
    assert 0.9 <= np.mean(inside) <= 0.99


@pytest.mark.slow
def test_errors_of_held_parameters_move_the_others(jenkins, tests):
    """Compare with new fits at other values of the held parameters, by differences."""
    ranges, step = {"friction_coefficient": (0.1, 0.9)}, 1e-3
    first = _stage(Objective(jenkins, tests[1:2], ranges, 0.02))
    alone, own = first.result, first.covariance
    held = replace(alone, names=tuple(UNLOADED), values=np.ones(3))
    spread = np.diag([0.02, 0.001, 0.03]) ** 2
    stage = _stage(Objective(jenkins, tests[1:2], ranges, 0.02), _Stage(held, spread))
    found, C = stage.result, stage.covariance
    moves = []
    for name in UNLOADED:
        objective = Objective(jenkins, tests[1:2], ranges, 0.02, {name: np.exp(step)})
        moves.append(objective.least(np.log(alone.values), np.ones(1, bool))[0] / step)
    moves = np.array(moves) - np.log(alone.values[0]) / step
    assert C[0, 0] - own[0, 0] == pytest.approx(moves @ spread @ moves, rel=0.05)
    widths = np.log([found.high[0] / found.low[0], alone.high[0] / alone.low[0]])
    quantile = 2.0930  # t distribution, 19 degrees of freedom: 20 amplitudes less one parameter
    assert widths[0] == pytest.approx(
        np.hypot(widths[1], 2.0 * quantile * np.sqrt(moves @ spread @ moves)), rel=0.05
    )


def drawn_fit(jenkins, seed):
    """Fit drawn synthetic tests, every fourth time with a drawn response without load; return the result and the truth."""
    rng = np.random.default_rng(seed)
    unloaded = seed % 4 == 0
    true = {
        "friction_coefficient": rng.uniform(0.25, 0.7),
        "contact_stiffness_factor": np.exp(rng.uniform(-0.5, 0.7)),
    }
    rig = (
        {"damping_factor": rng.uniform(0.7, 1.5), "frequency_factor": rng.uniform(0.98, 1.02)}
        if unloaded
        else {}
    )
    gain = rng.uniform(0.9, 1.1) if unloaded else 1.0
    truth = vary(jenkins, true | rig | {"excitation.amplitude": gain})
    noise = np.exp(rng.uniform(*np.log([0.005, 0.05])))

    def run(load, n, phase):
        top = truth.peak(load).frequency if load else 0.225 * rig["frequency_factor"]
        band = (top * (1.0 - rng.uniform(0.05, 0.15)), top * (1.0 + rng.uniform(0.05, 0.15)))
        return measured(truth, blank(load, band, n, phase=phase), noise, int(rng.integers(2**31)))

    loads = np.exp(rng.uniform(*np.log([0.4, 6.0]), int(rng.integers(1, 4))))
    runs = [run(load, int(rng.integers(8, 16)), bool(rng.integers(2))) for load in loads]
    free = run(0.0, 12, bool(rng.integers(2))) if unloaded else None
    ranges = {"friction_coefficient": (0.1, 1.0), "contact_stiffness_factor": (0.3, 4.0)}
    return fit(jenkins, runs, ranges, free=free, noise=noise), true | rig | {"force_factor": gain}


class TestMistakes:
    @pytest.mark.slow
    def test_constants_are_not_carried_to_other_settings(self, jenkins, tests, tmp_path):
        found = fit(jenkins, tests[1], {"friction_coefficient": (0.1, 0.9)})
        found.save(tmp_path / "fit.h5")
        again = bd.load(tmp_path / "fit.h5")
        assert again.values == pytest.approx(found.values)
        settings = (
            "1 harmonic, 10 blade modes, all contact points and the contact stiffness of this fit"
        )
        message = rf"study for constants that were fitted with {settings}: .* found harmonics = \[1\] instead"
        with pytest.raises(bd.SettingError, match=message):
            again.apply(jenkins.replace(harmonics=3))
        assert f"with {settings}" in said(found)

    def test_what_the_data_cannot_tell_apart(self, jenkins, tests):
        with pytest.raises(bd.SettingError, match="a test without load"):
            fit(jenkins, tests, RANGES | {"frequency_factor": (0.9, 1.1)})
        with pytest.raises(bd.SettingError, match="did you mean friction_coefficient"):
            fit(jenkins, tests, {"friction": (0.1, 0.5)})
        with pytest.raises(bd.SettingError, match="range of friction_coefficient"):
            fit(jenkins, tests, {"friction_coefficient": (0.5, 0.1)})
        with pytest.raises(bd.SettingError, match="data: expected one test or more"):
            fit(jenkins, [], RANGES, free=tests[0])
        with pytest.raises(
            bd.SettingError, match="a measured force at each point under response control"
        ):
            replace(tests[0], control="response")
        with pytest.raises(bd.BdamperError, match="amplitudes above 0, found 0"):
            bd.MeasuredResponse(
                bd.importers.Measurement(
                    "rig", np.array([1.0, 2.0, 3.0]), np.array([1.0, 0.0, 1.0])
                ),
                1.0,
            )

    def test_mistakes_of_the_settings_are_raised(self, tests):
        """The model carries no load, so its preload is 0; formerly each point counted as lost and friction was "0.5"."""
        contact = bd.Contact(tangential=0, normal=1, kt=1.0, kn=20.0, mu=0.5)
        study = bd.lumped(
            [1.0, 1.0], [0.02, 0.02], [2.0, 1.0], contacts=[contact], forces={0: 1.0}, harmonics=1
        )
        with pytest.raises(bd.SettingError, match=r"preload: expected 0.*found 0.5 N"):
            fit(study, tests[0], {"friction_coefficient": (0.1, 0.9)})

    @pytest.mark.slow
    def test_a_parameter_without_effect_is_not_determined(self, jenkins, tests):
        """Friction has no effect without a preload, nor has it alongside a parameter that has one."""
        plan = blank(0.0, (0.2, 0.25))
        free = measured(vary(jenkins, {"damping_factor": 1.2}), plan, 0.02)
        ranges = {"friction_coefficient": (0.1, 0.9), "damping_factor": (0.5, 2.0)}
        found = fit(jenkins, free, ranges)
        assert [found.low[0], found.high[0]] == pytest.approx([0.1, 0.9]) and np.isinf(
            found.deviation[0]
        )
        assert (
            "Friction coefficient not determined by these data 95 % confidence interval: 0.1 to 0.9"
            in said(found)
        )
        assert "friction coefficient not determined by these data" in found.reason
        assert 1.1 < found.low[1] < 1.2 < found.high[1] < 1.3  # damping is known

    @pytest.mark.slow
    def test_failures_of_the_solver_are_counted(self, jenkins, tests, monkeypatch):
        frequency_response = response_residuals.frequency_response

        def fails(problem, preload, band):
            if preload == LOADS[0]:
                raise StaticError("no static state")
            return frequency_response(problem, preload, band)

        monkeypatch.setattr(response_residuals, "frequency_response", fails)
        found = fit(jenkins, tests[:2], {"friction_coefficient": (0.1, 0.9)})
        assert found["friction_coefficient"] == pytest.approx(0.4, rel=0.2)
        assert (
            "no response was found at 20 points of 0.5 N (0.5 N, up) (no static state)"
            in found.reason
        )
        with pytest.raises(
            bd.BdamperError, match=r"no response could be computed .*no static state"
        ):
            fit(jenkins, tests[0], {"friction_coefficient": (0.1, 0.9)})

    @pytest.mark.slow
    @pytest.mark.parametrize("factor", [1e3, 1e-6])
    def test_wrong_units_are_named_first(self, jenkins, tests, factor):
        data = bd.importers.Measurement(
            "rig", tests[1].data.frequency, factor * tests[1].data.response
        )
        found = fit(jenkins, bd.MeasuredResponse(data, 2.0), {"friction_coefficient": (0.1, 0.9)})
        line = found._headline()
        assert line.startswith("Not for design: the model does not describe these data (misfit ")
        assert f"amplitudes are about {factor:g} times those of the model: check the units" in line
        assert "the model does not describe these data" in found.reason

    @pytest.mark.slow
    def test_what_the_free_response_tells_is_not_asked_of_the_others(self, jenkins, tests):
        """Which is refused once the free response was fitted."""
        with pytest.raises(bd.SettingError, match="that the free response does not determine"):
            fit(jenkins, tests, {"damping_factor": (0.5, 2.0)}, free=tests[0])

    @pytest.mark.slow
    def test_an_end_of_a_range_is_told(self, jenkins, tests):
        found = fit(jenkins, tests[1], {"friction_coefficient": (0.45, 0.9)})
        assert "friction coefficient is at an end of its range" in found.reason

    def test_probabilities(self, jenkins, tests):
        objective = Objective(jenkins, tests[:1], RANGES, 0.02)
        best, worse = objective.log_probability([0.4, 1.3]), objective.log_probability([0.41, 1.3])
        assert best == pytest.approx(0.0, abs=1e-9) and worse < best
        assert objective.log_probability([0.95, 1.3]) == -np.inf


@pytest.mark.nightly
@pytest.mark.slow
def test_a_rich_truth_fitted_with_a_coarse_model():
    """24 contact points, ten modes and five harmonics, fitted with nine points, four modes and one harmonic.

    Three loads are fitted, the test without damper first; three others are predicted.
    """
    rig, whole = bd.reference_model("test_rig"), {"contact_stiffness": "unit_traction"}
    rich = bd.Study(
        rig, bd.Excitation("tip"), friction_coefficient=0.45, harmonics=5, blade_modes=10, **whole
    )
    constants = {"contact_stiffness_factor": 0.6, "frequency_factor": 1.01, "damping_ratio": 0.003}
    truth = vary(rich, constants)
    loaded = vary(truth, {"excitation.amplitude": 1.05})  # the load cell has shown 1 N
    top = truth.free((240.0, 320.0)).peak.frequency
    peaks = {load: loaded.peak(load) for load in (60.0, 120.0, 250.0, 500.0, 2000.0, 4000.0)}
    plans = [blank(0.0, (0.976 * top, 1.024 * top), 40)]
    plans += [
        blank(p, (0.93 * peaks[p].frequency, 1.07 * peaks[p].frequency), 40)
        for p in (60.0, 500.0, 4000.0)
    ]
    runs = [measured(loaded, plan, 0.02, seed) for seed, plan in enumerate(plans)]
    coarse = bd.Study(
        rig, bd.Excitation("tip"), harmonics=1, blade_modes=4, contact_points=9, damping_ratio=0.005, **whole
    )  # fmt: skip
    ranges = {"friction_coefficient": (0.1, 0.9), "contact_stiffness_factor": (0.1, 10.0)}
    found = fit(coarse, runs[1:], ranges, free=runs[0])
    print(found.values, found.low, found.high, found.left_out, found.misfits)
    assert found["damping_factor"] == pytest.approx(0.6, rel=0.02)
    assert found["frequency_factor"] == pytest.approx(1.01, rel=1e-4)
    assert found["force_factor"] == pytest.approx(1.05, rel=0.02)
    j = found.names.index("friction_coefficient")
    assert found.low[j] < 0.45 < found.high[j]
    assert found.misfit > 3.0 and "the model deviates from the tests by" in found._headline()
    assert "the intervals above may be too narrow" in said(found)
    stiffness = found.names.index("contact_stiffness_factor")
    assert found.low[stiffness] > 0.6, "the true value lies outside"
    assert "9 contact points" in said(found)
    with pytest.raises(bd.SettingError, match="9 contact points"):
        found.apply(rich)
    best = vary(found.apply(coarse), {"excitation.amplitude": found["force_factor"]})
    misses = {
        load: best.peak(load).amplitude / peaks[load].amplitude - 1.0
        for load in (120.0, 250.0, 2000.0)
    }
    true = vary(
        vary(coarse, {"friction_coefficient": 0.45, **constants}), {"excitation.amplitude": 1.05}
    )
    others = {load: true.peak(load).amplitude / peaks[load].amplitude - 1.0 for load in misses}
    print(misses, others)
    assert max(map(abs, misses.values())) < max(map(abs, others.values())), (
        "better than the true constants"
    )
    assert max(abs(misses[load]) for load in (120.0, 250.0)) < 0.15, misses


def test_a_fit_to_a_part_leads_out_of_a_local_minimum():
    """One parameter, two tests: a line through 2, and a bump at 0 on the way from -1.5."""
    valley = SimpleNamespace(bounds=np.array([[-3.0], [3.0]]))
    valley.residual = lambda x: np.array(
        [0.3 * (x[0] - 2.0), 0.0, 3.0 * np.exp(-4.0 * x[0] ** 2), 0.0]
    )
    valley.jacobian = lambda x: np.array(
        [[0.3], [0.0], [-24.0 * x[0] * np.exp(-4.0 * x[0] ** 2)], [0.0]]
    )
    valley.least = partial(Objective.least, valley)
    group, every = np.array([0, 0, 1, 1]), np.ones(1, bool)
    low = valley.least(np.array([-1.5]), every)
    assert -1.2 < low[0] < -0.6, "a local minimum"
    prediction, other = _predictions(valley, low, group)
    assert other[0] > 1.5 and prediction[1, 0] == pytest.approx(valley.residual(other)[2])
    lowest = valley.least(other, every)
    assert (
        lowest == pytest.approx([2.0], abs=1e-4) and _predictions(valley, lowest, group)[1] is None
    )


def several(sliders, spread, harmonics):
    """The oscillator with sliders side by side that share its normal load unequally."""
    share = np.exp(spread * np.linspace(-1.0, 1.0, sliders))
    contacts = [
        bd.Contact(tangential=0, normal=1, kt=1.0 / sliders, kn=20.0 * s / share.sum(), mu=0.5)
        for s in share
    ]
    forced = {"forces": {0: 1.0}, "load_per_preload": {1: 1.0}}
    return bd.lumped(
        [1.0, 1.0], [0.02, 0.02], [2.0, 1.0], contacts=contacts, harmonics=harmonics, **forced
    )
