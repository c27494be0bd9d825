from dataclasses import replace

import numpy as np
import pytest

from bdamper.wheel import Mistuning, Wheel
from bdamper.wheel import peak as module
from bdamper.wheel.newton import TOLERANCE, correct
from bdamper.wheel.solution import solution
from bdamper.wheel.system import Ease
from tests.wheel.test_symmetry import PATTERN, N, study


def at_rest(system, mean):
    X = np.zeros(system.shape)
    X[:, 0] = mean
    X[system.still] = 0.0
    return X


def test_derivatives_of_eased_equations():
    system, mean = Wheel(study(harmonics=2), PATTERN).system(300.0)
    rng, ease, omega = np.random.default_rng(3), Ease(0.2, 0.3), 2.0 * np.pi * 180.0
    X = at_rest(system, mean) + np.where(system.still, 0.0, 1e-6 * rng.normal(size=system.shape))
    direction = np.where(system.still, 0.0, 1e-11 * rng.normal(size=system.shape))
    at = system.linearised(X, omega, ease)
    np.testing.assert_array_equal(at.residual, system.residual(X, omega, ease))
    difference = 0.5 * (system.residual(X + direction, omega, ease) - system.residual(X - direction, omega, ease))
    exact = at.product(direction)
    for part in (slice(0, 1), slice(1, None)):
        assert np.abs(difference - exact)[:, part].max() < 1e-6 * np.abs(exact[:, part]).max()
    difference = (system.residual(X, omega + 1e-3, ease) - system.residual(X, omega - 1e-3, ease)) / 2e-3
    assert np.abs(difference - at.by_omega).max() < 1e-7 * np.abs(at.by_omega).max()


def test_solutions_where_newton_from_rest_finds_none():
    system, mean = Wheel(study(), PATTERN).system(300.0)
    X, plain, eased = at_rest(system, mean), 0, 0
    for omega in 2.0 * np.pi * np.linspace(260.0, 340.0, 9):
        plain += correct(system, X, omega, tolerance=1e-9, most=40, line_search=True).converged
        found = solution(system, X, omega, Ease(springs=1.0), 1e-9)
        if found is not None:
            assert system.size(system.residual(found.X, omega, Ease(springs=1.0))) <= 1e-9
            eased += 1
    assert eased == 9 and plain < 9, (eased, plain)


def test_a_held_peak_solves_the_equations_with_its_springs():
    wheel = Wheel(study(), PATTERN)
    top = wheel.peak(300.0, options=module.WheelPeakOptions(least=12, most=12, climbs=2))
    assert top.status == "held" and top.found and not top.converged and top.springs > 0.0
    system, _ = wheel.system(300.0)
    omega = 2.0 * np.pi * top.frequency
    assert system.size(system.residual(top.unknowns, omega, Ease(springs=top.springs))) <= TOLERANCE
    assert system.size(system.residual(top.unknowns, omega)) > 1e-6


def test_held_peaks_have_facts_and_pictures():
    wheel, options = Wheel(study(), PATTERN), module.WheelPeakOptions(least=12, most=12, climbs=2)
    top = wheel.peak(300.0, options=options)
    assert {"highest amplitude", "error by dampers held"} <= {fact.name for fact in top.facts()}
    top.plot()
    curve = wheel.optimal_curve([300.0, 2000.0], options=options)
    assert curve.status == ("held", "complete") and list(curve.error > 0.0) == [True, False]
    assert "dampers held, with error" in [text.get_text() for text in curve.plot().get_legend().get_texts()]


@pytest.mark.parametrize("name", ["correct", "_tangent"])
def test_a_climb_that_never_steps_is_no_peak(monkeypatch, name):
    own = module.correct

    def lost(*arguments, **options):
        found = own(*arguments, **options)
        return replace(found, converged=False) if len(arguments) > 3 else found

    monkeypatch.setattr(module, name, lost if name == "correct" else lambda *arguments: None)
    top = Wheel(study(), Mistuning.drawn(N, 0.03, seed=0)).peak(2000.0)
    assert top.status == "not found"


@pytest.mark.parametrize(("seed", "preload"), [(9, 300.0), (6, 1000.0)])
def test_the_peak_is_that_of_its_highest_blade(seed, preload):
    wheel = Wheel(study(), Mistuning.drawn(N, 0.03, seed=seed))
    top = wheel.peak(preload)
    system, _ = wheel.system(preload)
    width, ease = 2.0 * np.pi * module.band(wheel, preload)[2], Ease(springs=top.springs)
    again, _ = module.climb(wheel, system, top.unknowns, 2.0 * np.pi * top.frequency, top.blade, width, ease, module.EXACT)
    assert np.abs(wheel.response(again.X)[:, 1]).max() == pytest.approx(top.amplitude, rel=1e-5)
    low = int(np.argmin(np.abs(top.response[:, 1])))
    left, _ = module.climb(wheel, system, top.unknowns, again.omega, low, width, ease)
    heights = np.abs(wheel.response(left.X)[:, 1])  # of a blade that stays below another the top is not looked for
    assert (left.residual <= TOLERANCE) == (heights[low] > 0.98 * heights.max())
    for aside in (-2e-4 * width, 2e-4 * width):  # on either side that blade is lower
        found = correct(system, top.unknowns, again.omega + aside, ease=ease, tolerance=1e-12, most=30, line_search=True)
        assert found.converged and np.abs(wheel.response(found.X)[top.blade, 1]) < (1.0 + 1e-9) * top.amplitude


def test_a_peak_at_which_a_contact_changes_its_state_is_found():
    wheel = Wheel(study(), Mistuning.drawn(N, 0.03, seed=1))
    top = wheel.peak(2000.0, options=module.WheelPeakOptions(least=12, most=12, climbs=1))
    system, _ = wheel.system(2000.0)
    width, fall = 2.0 * np.pi * module.band(wheel, 2000.0)[2], []
    for aside in (-1e-4, -5e-5, 5e-5, 1e-4):
        at = correct(system, top.unknowns, 2.0 * np.pi * top.frequency + aside * width, tolerance=1e-12, line_search=True)
        fall.append(1.0 - np.abs(wheel.response(at.X)[top.blade, 1]) / top.amplitude)
    assert top.converged and min(fall) > 0.0
    assert fall[3] < 2.2 * fall[2] or fall[0] < 2.2 * fall[1]  # a corner: on one side the amplitude falls at once


@pytest.mark.parametrize(
    ("heights", "order"),
    [  # freeing has changed another by two thirds, which does not lift the last one to the top; or has changed none yet
        ({0: (7.0, 8.0), 1: (10.0, 6.0), 2: (8.0, 9.5), 3: (3.0, 20.0)}, [1, 2, 0]),
        ({0: (9.5, 10.5), 1: (10.0, 10.0), 2: (9.3, 20.0)}, [1, 0]),
    ],
)
def test_the_peak_that_may_be_the_highest_is_freed_next(monkeypatch, heights, order):
    asked = []

    def weakened(_, peak):
        asked.append(peak.blade)
        return module._Climbed(None, None, peak.blade, (1.0, 0.0), heights[peak.blade])

    monkeypatch.setattr(module._Climbs, "_weakened", weakened)
    held = [module._Climbed(None, None, blade, (1.0,), height[:1]) for blade, height in heights.items()]
    freed = module._Climbs(None, None, 0.0, (0.0, 0.0)).freed(held)
    assert asked == order
    assert [peak.height for peak in freed] == [height[blade in order] for blade, height in heights.items()]


def test_the_error_of_held_peaks_covers_what_freeing_changes(monkeypatch):
    seen, own = [], module._Climbs.freed

    def freed(self, peaks):
        seen.extend(own(self, peaks))
        return seen

    monkeypatch.setattr(module._Climbs, "freed", freed)
    options = module.WheelPeakOptions(least=12, most=12, climbs=2)
    top = Wheel(study(), Mistuning.drawn(N, 0.03, seed=0)).peak(500.0, options=options)
    highest = max(seen, key=lambda peak: peak.height)
    assert top.converged and top.error == 0.0 and top.held_amplitude == max(peak.heights[0] for peak in seen)
    assert highest.heights[1] > 1.1 * top.amplitude  # springs of a tenth
    for n in range(2, len(highest.heights)):
        part = replace(highest, springs=highest.springs[:n], heights=highest.heights[:n])
        assert abs(top.amplitude / part.height - 1.0) <= part.error < 0.6


def test_a_peak_carries_the_error_of_a_rival_that_could_not_be_freed(monkeypatch):
    own = module._Climbs.held

    def freed(self, peaks):
        free = replace(peaks[0], springs=(1.0, 0.0), heights=2 * peaks[0].heights)
        return [free, replace(peaks[0], heights=(0.99 * free.height,), last=True)]

    monkeypatch.setattr(module._Climbs, "held", lambda self, candidates: 2 * own(self, candidates)[:1])
    monkeypatch.setattr(module._Climbs, "freed", freed)
    top = Wheel(study(), PATTERN).peak(300.0, options=module.WheelPeakOptions(least=12, most=12, climbs=1))
    assert top.status == "complete" and abs(top.error - (0.99 * 1.2 - 1.0)) < 1e-12
