"""Derivatives of peaks with respect to settings, against differences of whole peaks."""

import os

import numpy as np
import pytest

import bdamper as bd
from bdamper.harmonic_balance.equations import Plane
from bdamper.response.peak import find_peak
from bdamper.response.sensitivity import (
    PARAMETERS,
    band,
    sensitivities,
    setting_family,
    setting_value,
)

STEPS = (1e-3, 3e-4, 1e-4, 3e-5, 1e-5, 3e-6)
"""Relative; peaks that differ by them are of one maximum where two of the steps, one after the other, agree."""
SHIPPED = {
    "bladed_disk": ("tip", {"engine_order": 5}, (50.0, 200.0, 1000.0)),
    "paper_disk": ("tip_trailing_edge", {"engine_order": 5, "harmonics": 1}, (50.0, 300.0, 1000.0)),
    "turbine_blade": ("tip", {"engine_order": 5}, (20.0, 100.0, 1000.0)),
    "test_rig": ("tip", {}, (30.0, 100.0, 1000.0)),
    "blade_to_ground": ("tip", {}, (30.0, 100.0, 1000.0)),
}
"""Location of the excitation, further settings, and preloads; of the blade on the ground the prescribed normal load."""
FULL = bool(int(os.environ.get("BDAMPER_HARD", "0")))
CASES = [
    (name, preload)
    for name, (_, _, loads) in SHIPPED.items()
    for preload in loads
    if FULL or name == "paper_disk"
]
"""All with ``make hard``: those with three harmonics take minutes each."""


def shipped(name):
    location, settings, _ = SHIPPED[name]
    model = bd.reference_model(name, 9) if name == "paper_disk" else bd.reference_model(name)
    return bd.Study(model, bd.Excitation(location), friction_coefficient=0.3, **settings)


def guess(study, name, factor, y):
    """The unknowns with those of the free bodies as their modes shrink with their mass: any guess serves the reference."""
    y = y.copy()
    if name == "damper_inertia_factor":
        start = 0
        for l, basis in enumerate(study.problem.bases):
            bodies = [study.model.bodies.get(c.body) for c in basis.coordinates]
            free = np.array([body is not None and body.kind == "free" for body in bodies])
            for _ in range(1 if l == 0 else 2):
                y[start : start + len(free)][free] *= np.sqrt(factor)
                start += len(free)
    return y


def differences(study, name, family, value, peak, steps=STEPS):
    """Derivatives of amplitude and frequency by peaks at both sides, where two steps agree; None where no two do."""
    before = None
    for step in steps:
        try:
            systems = {s: family(value * (1 + s)) for s in (step, -step)}
        except bd.SettingError:  # prescribed loads would be others
            return None
        sides = [
            find_peak(
                system,
                guess(study, name, 1 + s, peak.y),
                tangent=peak.tangent,
                scale=peak.scale,
                curvature=peak.curvature,
            )
            for s, system in systems.items()
        ]
        found = None
        if all(side.ok and not side.corner for side in sides):
            high, low = sides
            found = np.array([high.amplitude - low.amplitude, high.frequency - low.frequency]) / (
                2.0 * step * value
            )
        if (
            found is not None
            and before is not None
            and np.allclose(found, before, rtol=5e-3, atol=0.0)
        ):
            return found
        before = found
    return None


def compare(study, preload, parameters):
    """Names of parameters whose derivatives differ from those of whole peaks, and how many could be compared."""
    peak = study.peak(preload)
    assert peak.ok
    wrong, compared = {}, 0
    for name, found in study.peak_sensitivities(peak, parameters).items():
        family = (
            study.problem.system
            if name == "preload"
            else setting_family(study.problem, name, preload)
        )
        value = preload if name == "preload" else setting_value(study.problem, name)
        expected = differences(study, name, family, value, peak)
        own = np.array([found.amplitude, found.frequency])
        assert np.isnan(own).all() == bool(found.reason)
        if expected is None or found.reason:
            print(name, preload, own, expected, found.reason)
            continue
        compared += 1
        scale = 1e-6 * np.array([peak.amplitude, peak.frequency]) / value
        if not (np.abs(own - expected) <= 0.01 * np.abs(expected) + scale).all():
            wrong[name] = own, expected
    return wrong, compared


def test_derivatives_of_a_sticking_mass_are_its_closed_forms():
    """Peak at omega^2 = k/m - c^2/(2 m^2), with the amplitude F/(c sqrt(k/m - c^2/(4 m^2)))."""
    mass, damping, own, kt, force = 2.0, 0.1, 1.0, 0.6, 0.1
    contact = bd.Contact(tangential=0, kt=kt, mu=0.5, preload=100.0)
    study = bd.lumped([mass], [damping], [own], contacts=[contact], forces={0: force}, harmonics=1)
    peak = study.peak(0.0, (0.01, 0.5))
    found = study.peak_sensitivities(peak, ("damping_factor", "excitation.amplitude"))
    omega = np.sqrt((own + kt) / mass - damping**2 / (2.0 * mass**2))
    damped = np.sqrt((own + kt) / mass - damping**2 / (4.0 * mass**2))
    amplitude = force / (damping * damped)
    assert peak.amplitude == pytest.approx(amplitude, rel=1e-9)
    # with the factor on damping omega^2 falls by twice its last term, and 1/damped rises
    losses = damping**2 / (2.0 * mass**2)
    by_damping = found["damping_factor"]
    change = -1.0 + 0.5 * losses / damped**2
    assert by_damping.amplitude == pytest.approx(change * amplitude, rel=1e-6)
    assert by_damping.frequency == pytest.approx(-losses / omega / (2.0 * np.pi), rel=1e-6)
    by_force = found["excitation.amplitude"]
    assert by_force.amplitude == pytest.approx(amplitude / force, rel=1e-6)
    assert by_force.frequency == pytest.approx(0.0, abs=1e-12)


@pytest.mark.slow
def test_mass_of_the_damper_on_a_flat_peak():
    """The axial place of the damper is far beyond the motion of its contacts: a change of its modes must not move it."""
    # with the vectors of partial contact this peak is not flat
    bonded = bd.ResidualModes(partial_contact=False)
    study = shipped("bladed_disk").replace(contact_stiffness=bonded)
    peak = study.peak(200.0, (330.0, 370.0))  # both ends of the branch
    found = study.peak_sensitivities(peak, ["damper_inertia_factor"])["damper_inertia_factor"]
    family = setting_family(study.problem, "damper_inertia_factor", 200.0)
    amplitude, frequency = differences(
        study, "damper_inertia_factor", family, 1.0, peak, (1e-4, 3e-5)
    )
    assert found.amplitude == pytest.approx(amplitude, rel=1e-3)
    assert found.frequency == pytest.approx(frequency, rel=1e-3) == pytest.approx(-5.942, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(("above", "below"), [(1.0, -1.0), (2.0, 1.0)])
def test_a_kink_has_no_derivative(above, below):
    """Where the equations change at other rates above and below the value, both sides disagree."""
    study = shipped("bladed_disk")
    study = study.replace(harmonics=1)
    peak = study.peak(1000.0, (340.0, 370.0))

    def family(value):
        return study.problem.system(
            1000.0 * (1.0 + (above if value > 1.0 else below) * (value - 1.0))
        )

    found = sensitivities(peak, {"kink": (family, 1.0)})["kink"]
    assert np.isnan([found.amplitude, found.frequency]).all()
    assert "from above and below" in found.reason


@pytest.mark.slow
@pytest.mark.parametrize(("name", "preload"), CASES)
def test_every_default_parameter_of_shipped_models(name, preload):
    study, least = shipped(name), 4
    if name == "blade_to_ground":  # nothing but excitation and damping can be varied
        study, preload, least = (
            study.replace(constant_loads={"platform": np.full(24, preload / 24.0)}),
            0.0,
            2,
        )
    wrong, compared = compare(study, preload, PARAMETERS)
    assert wrong == {}
    assert compared >= least


class TestCurve:
    """Derivatives along a whole curve, against equations solved again beside each value."""

    @pytest.fixture(scope="class")
    def study(self):
        return shipped("bladed_disk").replace(harmonics=1)

    @pytest.fixture(scope="class")
    def curve(self, study):
        curve = study.frequency_response(60.0, (250.0, 400.0))
        assert len(curve.folds) >= 2
        return curve

    @pytest.mark.slow
    @pytest.mark.parametrize("name", PARAMETERS)
    def test_at_fixed_frequencies(self, study, curve, name):
        found = study.curve_sensitivities(curve, [name])[name]
        family = (
            study.problem.system if name == "preload" else setting_family(study.problem, name, 60.0)
        )
        step = 1e-5 * found.value
        beside, compared = (family(found.value + step), family(found.value - step)), []
        for i in range(2, len(curve), 5):
            ends = []
            for system in beside:
                y = np.append(curve.unknowns[i], 2.0 * np.pi * curve.frequency[i])
                scale = system.units(y, 100.0)
                c = system.correct_at(y[:-1], y[-1], scale, 1e-10, 12)
                ends += [system.rows.value(c.y)] if c.status == 0 else []
            if len(ends) == 2:  # near a fold there may be no solution beside
                difference = (ends[0] - ends[1]) / (2.0 * step)
                compared.append(abs(found.at_frequency[i] / difference - 1.0))
        assert (
            len(compared) > 12 and np.median(compared) < 1e-5
        )  # of which solutions to 1e-10 leave the larger part
        assert np.sort(compared)[-3] < 1e-3  # differences of solutions are rough next to folds

    @pytest.fixture(scope="class")
    def across(self, study):
        """A study of unit tractions, so that unknowns stay what they are, its curve, and each point solved in its plane."""
        study = study.replace(contact_stiffness="unit_traction")
        curve = study.frequency_response(200.0, (270.0, 370.0))
        assert len(curve.folds) >= 1
        system, solved = study.problem.system(200.0), {}
        for i in range(1, len(curve) - 1):
            y, before, after = (
                np.append(curve.unknowns[k], 2.0 * np.pi * curve.frequency[k])
                for k in (i, i - 1, i + 1)
            )
            scale = system.units(y, np.pi * np.ptp(curve.frequency))
            chord = (after - before) / scale
            solved[i] = (
                system.solve(y, Plane(chord / np.linalg.norm(chord)), scale, 1e-10, 12),
                scale,
            )
        return study, curve, solved

    @pytest.mark.slow
    @pytest.mark.parametrize(
        "name", ["preload", "friction_coefficient", "contact_stiffness_factor", "damping_factor"]
    )
    def test_across_the_curve_at_every_point(self, across, name):
        """Solutions in the plane across the curve, also at folds."""
        study, curve, solved = across
        found = study.curve_sensitivities(curve, [name])[name]
        family = (
            study.problem.system
            if name == "preload"
            else setting_family(study.problem, name, 200.0)
        )
        system, step = study.problem.system(200.0), 1e-5 * found.value
        high, low = family(found.value + step), family(found.value - step)
        compared = {}
        for i, (c, scale) in solved.items():
            ends = [end.solve(c.y, Plane(c.tangent), scale, 1e-10, 12) for end in (high, low)]
            if all(end.status == 0 for end in ends):
                moved = (ends[0].y - ends[1].y) / (2.0 * step)
                expected = np.array([moved[-1] / (2.0 * np.pi), system.rows.value(moved)])
                error = np.abs(
                    np.array([found.frequency[i], found.response[i]]) - expected
                ) / np.abs(expected)
                compared[i] = error.max()
        assert len(compared) > 0.9 * len(curve) and np.median(list(compared.values())) < 1e-5
        at_folds = [compared[i] for i in curve.folds if i in compared]
        assert at_folds and max(at_folds) < 1e-3

    def test_edges_of_a_band_are_curves(self, study, curve):
        """With one uncertain parameter they are, to second order, the curves two deviations away."""
        found = study.curve_sensitivities(curve, ["friction_coefficient"])
        misses = []
        for spread in (4e-4, 1e-4):
            _, frequency, amplitude = band(curve, found, {"friction_coefficient": spread})
            other = study.replace(friction_coefficient=0.3 + 2.0 * spread)
            system, miss = other.problem.system(60.0), []
            for i in range(2, len(curve), 3):
                edges = []
                for f, a in zip(frequency[i], amplitude[i]):
                    y = np.append(curve.unknowns[i], 2.0 * np.pi * f)
                    c = system.correct_at(y[:-1], y[-1], system.units(y, 100.0), 1e-10, 12)
                    edges.append(
                        abs(abs(system.rows.value(c.y)) / a - 1.0) if c.status == 0 else np.inf
                    )
                miss.append(min(edges))
            misses.append(np.median(miss))
        assert misses[1] < misses[0] / 8.0
