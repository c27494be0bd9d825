"""The dual-weighted indicator, the embedding it rests on, and the results that carry it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import bdamper as bd
from bdamper.effects.advice import fullest, judged
from bdamper.effects.indicator import Estimate, embed, estimate_change, highest_peaks
from bdamper.effects.rivals import Place, Rival, excited, point_between, rivals, summits, superharmonics
from bdamper.peaks.newton import coarse_options, find_peak
from tests import models

INTERVAL = (720.0, 880.0)


@pytest.fixture(scope="module")
def full():
    model = models.wedge_model(1, n_points=6, harmonics=5)
    return bd.Study(
        model, bd.Excitation("tip"), engine_order=2, friction_coefficient=0.4, harmonics=3, damper_modes=1, blade_modes=4
    )


def peak_of(study, preload):
    curve = study.track(preload, INTERVAL, options=coarse_options())
    return highest_peaks(study.system(preload), curve)[0]


@pytest.fixture(scope="module")
def peak(full):
    return peak_of(full, 40.0)


def test_estimate_is_the_derivative_of_the_peak(full, peak):
    """A small force in addition: the estimated peak differs from the true one by the square of it."""
    rng = np.random.default_rng(0)
    system = full.system(40.0)
    direction = rng.standard_normal(system.n_unknowns) * np.abs(system.force).max()
    direction[: system.n_mean] = 0.0
    error, defect = [], []
    for size in (4e-4, 2e-4, 1e-4):
        other = system.with_force(system.force + size * direction)
        e = estimate_change(other, peak.y)
        true = find_peak(other, peak.y)
        assert true.converged
        change = true.amplitude / peak.amplitude - 1.0
        assert abs(change) > 1e-5
        error.append(abs(e.amplitude - change))
        defect.append(e.defect)
        assert e.amplitude == pytest.approx(change, rel=0.1)
    assert error[0] / error[1] > 3.0 and error[1] / error[2] > 3.0
    # the second residual tells a good part of what is missing; the rest is the phase that the peak need not keep
    assert all(0.1 < d / m < 10.0 for d, m in zip(defect, error)), (defect, error)


def test_a_solution_of_the_system_itself_has_no_change(full, peak):
    e = estimate_change(full.system(40.0), peak.y)
    assert e.size < 1e-7 and e.reliability(0.01) == "small"


def test_shares_of_the_harmonics_make_up_the_estimate(full):
    cheap = full.with_effects(replace(bd.Effects.of(full), harmonics=1))
    p = peak_of(cheap, 40.0)
    e = estimate_change(full.system(40.0), embed(cheap, full, 40.0, p.y))
    assert abs(e.amplitude) > 1e-3
    assert e.shares.sum() == pytest.approx(e.amplitude, rel=1e-6)
    # the equations of the cheap system are solved: only those of the new harmonics contribute
    assert np.abs(e.shares[:2]).max() < 1e-6 and np.abs(e.shares[2:]).max() > 1e-4


@pytest.mark.parametrize(
    "changes",
    [
        {"harmonics": 1}, {"rotation": ("X", "Z")}, {"damper_modes": 0}, {"blade_modes": 2}, {"bias": False},
        {"contact_points": 3},
    ],
    ids=str,
)
def test_embedding_keeps_what_both_have(full, changes):
    cheap = full.with_effects(replace(bd.Effects.of(full), **changes))
    a, b = cheap.system(40.0), full.system(40.0)
    rng = np.random.default_rng(1)
    y = np.append(1e-6 * rng.standard_normal(a.n_unknowns), 5000.0)
    z = embed(cheap, full, 40.0, y)
    assert z[-1] == 5000.0
    for l in range(1, a.n_harmonics + 1):
        old = dict(zip(a.bases[l].coordinates, a.amplitudes(y[:-1], l)))
        new = dict(zip(b.bases[l].coordinates, b.amplitudes(z[:-1], l)))
        assert {c: new[c] for c in old} == old
        assert all(value == 0.0 for c, value in new.items() if c not in old)
    mean = z[: b.n_mean] - full.static(40.0).q
    if a.n_mean:
        moved = dict(zip(a.bases[0].coordinates, y[: a.n_mean] - cheap.static(40.0).q))
        np.testing.assert_allclose(mean, [moved.get(c, 0.0) for c in b.bases[0].coordinates], atol=1e-18)
    else:
        np.testing.assert_array_equal(mean, 0.0)


@pytest.mark.parametrize(
    ("amplitude", "defect", "expected"),
    [
        (0.002, 0.001, "small"),
        (0.002, 0.009, "must be on"),
        (0.05, 0.01, "significant"),
        (0.05, 0.03, "must be on"),
        (0.2, 0.0, "must be on"),
        (np.nan, 0.0, "must be on"),
    ],
)
def test_reliability(amplitude, defect, expected):
    assert Estimate(amplitude, 0.0, defect, *np.zeros((3, 1))).reliability(0.01) == expected


def synthetic(full, amplitude, branch=None, kind=None, frequency=None):
    """A curve of the study with given amplitudes."""
    n = len(amplitude)
    curve = full.track(1e3, INTERVAL)
    at = np.arange(n)
    harmonics = np.zeros((n, 2), complex)
    harmonics[:, 1] = amplitude
    return replace(
        curve,
        harmonics=harmonics,
        frequency=np.linspace(*INTERVAL, n) if frequency is None else np.array(frequency, float),
        unknowns=np.tile(at[:, None] * 1.0, (1, 3)),
        branch=np.zeros(n, int) if branch is None else np.array(branch),
        point_kind=("regular",) * n if kind is None else kind,
        shares=np.tile([1.0, 0.0, 0.0], (n, 1)),
    )


NOTHING = (0.0, 0.0, 0.0)


def rivals_of(full, amplitude, changes, maxima):
    """Rivals on a synthetic curve; estimates by index, those of maxima too."""
    curve = synthetic(full, amplitude)

    def ask(y):
        return Estimate(*changes.get(int(y[0]), NOTHING), y, *np.zeros((2, 2)))

    def place(i):
        y = np.append(curve.unknowns[i], 2.0 * np.pi * curve.frequency[i])
        return Place(y, float(curve.frequency[i]), amplitude[i], ask(y))

    peaks = [find_peak_like(place(i)) for i in maxima]
    out = rivals(curve, peaks, ask, place(maxima[0]), 0.01)
    return [(int(r.place.y[0]), round(r.may_miss, 3), round(r.misses, 3)) for r in out]


def find_peak_like(place):
    return SimpleNamespace(y=place.y, frequency=place.frequency, amplitude=place.amplitude)


def test_superharmonic_resonances_have_the_frequency_width_and_height_of_the_linear_response(full):
    """Half of the power at the half-width, at fractions of the frequency, for harmonics that the cheap system lacks."""
    cheap = full.with_effects(replace(bd.Effects.of(full), harmonics=1))
    rich = full.system(40.0)
    springs = full.stuck_springs(full.static(40.0))
    found = list(superharmonics(cheap.system(40.0), rich, (springs,), 100.0, 1e5))
    assert {r.harmonic for r in found} == {2, 3} and not list(superharmonics(rich, rich, (springs,), 100.0, 1e5))
    for l, omega, half_width, mode in found:

        def height(w, l=l, mode=mode):
            return np.linalg.norm(np.linalg.solve(rich.linear_matrix(w, springs, l), rich.bases[l].mass * mode))

        top = height(omega)
        assert height(omega - half_width) == pytest.approx(top / np.sqrt(2.0), rel=0.05)
        assert height(omega + half_width) == pytest.approx(top / np.sqrt(2.0), rel=0.05)
    r = found[0]
    y = np.zeros(rich.n_unknowns + 1)
    y[: rich.n_mean], y[-1] = full.static(40.0).q, r.omega
    y[rich.slices(1)[0]] = 1e-9  # all sticks: nothing excites the second harmonic but what is put there
    assert excited(rich, y, r) < 1e-6
    force = np.zeros(rich.n_unknowns)
    force[rich.slices(r.harmonic)[0]] = rich.bases[r.harmonic].mass * r.mode.real
    force[rich.slices(r.harmonic)[1]] = -rich.bases[r.harmonic].mass * r.mode.imag
    q = np.linalg.solve(rich.linear_matrix(r.omega, springs, r.harmonic), rich.bases[r.harmonic].mass * r.mode)
    expected = np.abs(rich.bases[r.harmonic].G @ q).max() / np.abs(rich.bases[1].G @ rich.amplitudes(y[:-1], 1)).max()
    assert excited(rich.with_force(rich.force + force), y, r) == pytest.approx(expected, rel=0.05)


def test_a_curve_is_interpolated_on_its_highest_part(full):
    curve = synthetic(full, [0.5, 1.0, 0.6, 0.9, 0.4], branch=[0, 0, 0, 1, 1])
    f = 2.0 * np.pi * curve.frequency
    y = point_between(curve, 0.25 * f[0] + 0.75 * f[1])
    assert y == pytest.approx(np.append(0.25 * curve.unknowns[0] + 0.75 * curve.unknowns[1], 0.25 * f[0] + 0.75 * f[1]))
    assert point_between(curve, 0.5 * (f[2] + f[3])) is None  # no part of a branch passes
    assert point_between(curve, 2.0 * f[-1]) is None


def test_another_maximum_may_overtake_by_the_most_it_can_have(full):
    two = [0.5, 1.0, 0.5, 0.5, 0.95, 0.5]
    assert rivals_of(full, two, {}, [1, 4]) == []
    assert rivals_of(full, two, {4: (0.04, 0.0, 0.0)}, [1, 4]) == []
    found = rivals_of(full, two, {4: (0.04, 0.0, 0.02)}, [1, 4])
    # the peak moves from 752 to 848 Hz
    assert found == [(4, round(848.0 / 752.0 - 1.0, 3), round(848.0 / 752.0 - 1.0, 3))]
    assert rivals_of(full, two, {1: (-0.03, 0.0, 0.03)}, [1, 4])[0][0] == 4  # the least of the peak counts
    assert np.isinf(rivals_of(full, two, {4: (np.nan, np.nan, np.inf)}, [1, 4])[0][1])
    assert rivals_of(full, [0.5, 1.0, 0.5, 0.5, 0.65, 0.5], {4: (np.nan, np.nan, np.inf)}, [1, 4]) == []  # not near the top


def test_points_near_the_top_may_overtake_beyond_the_tolerance(full):
    hill = [0.5, 0.98, 1.0, 0.98, 0.5]
    assert rivals_of(full, hill, {1: (0.025, 0.0, 0.0)}, [2]) == []
    found = rivals_of(full, hill, {1: (0.05, 0.0, 0.0)}, [2])
    assert [f[0] for f in found] == [1] and found[0][1] == found[0][2] > 0.029
    # an estimate that cannot be relied on tells how much may be missed, not how much is
    ((where, may, does),) = rivals_of(full, hill, {1: (0.05, 0.0, 0.04)}, [2])
    assert where == 1 and may > 0.067 and does == 0.0
    raised = dict.fromkeys(range(5), (0.05, 0.0, 0.0))
    assert rivals_of(full, hill, raised, [2]) == []  # all by the same: the estimate of the peak says it


def test_a_rise_beyond_the_peak_may_become_a_maximum_if_its_order_may_change(full):
    rising = [0.5, 1.0, 0.8, 0.9, 1.1, 1.2]
    assert rivals_of(full, rising, {}, [1]) == []
    assert rivals_of(full, rising, {4: (0.05, 0.0, 0.0), 5: (0.05, 0.0, 0.0)}, [1]) == []
    assert [f[0] for f in rivals_of(full, rising, {5: (0.0, 0.0, 0.1)}, [1])] == [4]
    falling = [1.2, 1.1, 0.9, 0.8, 1.0, 0.5]
    assert [f[0] for f in rivals_of(full, falling, {0: (0.0, 0.0, 0.1)}, [4])] == [1]
    # a summit that was no maximum, since the mean position walks there
    summit = [0.5, 1.0, 0.8, 1.2, 1.2, 0.9]
    assert rivals_of(full, summit, {}, [1]) == []
    assert 3 in [f[0] for f in rivals_of(full, summit, {3: (0.001, 0.0, 0.0)}, [1])]


@pytest.mark.parametrize(
    ("estimate", "others", "expected"),
    [
        ((0.002, 0.0, 0.001), [], (0.001, "small", "")),
        ((0.002, 0.0, 0.001), [(0.005, 0.005)], (0.005, "small", "may be higher at 740 Hz")),
        ((0.002, 0.0, 0.001), [(0.02, 0.0), (0.003, 0.0)], (0.02, "must be on", "may be higher at 740 Hz")),
        ((0.05, 0.0, 0.01), [(0.3, 0.0)], (0.3, "significant", "may be higher at 740 Hz")),
        ((0.05, 0.0, 0.01), [(0.3, 0.2)], (0.3, "must be on", "may be higher at 740 Hz")),
        ((0.05, 0.0, 0.01), [(0.3, 0.0), (np.inf, np.inf)], (np.inf, "must be on", "may be higher at 741 Hz")),
        ((0.05, 0.0, 0.01), [(0.005, 0.005)], (0.01, "significant", "")),
    ],
)
def test_a_change_is_small_only_if_no_other_place_may_make_it_larger(estimate, others, expected):
    places = [Place(np.zeros(1), 740.0 + i, 1.0, Estimate(*estimate, *np.zeros((3, 1)))) for i in range(len(others))]
    rivals_found = [Rival(place, *misses) for place, misses in zip(places, others)]
    assert judged(Estimate(*estimate, *np.zeros((3, 1))), rivals_found, 0.01) == expected


def test_advice_prints_plots_and_saves(full, tmp_path):
    cheap = full.with_effects(replace(bd.Effects.of(full), harmonics=1, blade_modes=3))
    advice = cheap.advise(40.0, INTERVAL, against=bd.Effects.of(full))
    assert {e.name for e in advice.effects} == {"harmonics", "blade modes"}
    text = str(advice)
    assert "harmonics" in text and "may miss" in text and advice["harmonics"].reliability in text
    richer = full.with_effects(replace(bd.Effects.of(full), blade_modes=3)).system(40.0)
    assert (advice["harmonics"].unknowns, advice["harmonics"].points) == (richer.n_unknowns, richer.n_points)
    assert set(advice.called_for) <= {"harmonics", "blade modes"}
    with pytest.raises(KeyError, match="no advice on 'separation'"):
        advice["separation"]
    advice.save(tmp_path / "advice.h5")
    assert bd.load(tmp_path / "advice.h5") == advice
    ax = advice.plot()
    assert [t.get_text() for t in ax.get_yticklabels()] == [e.name for e in advice.effects[::-1]]


def test_fullest_asks_for_what_the_model_has(full):
    rich = fullest(full)
    assert rich.harmonics == 5 and rich.damper_modes == 2 and rich.blade_modes == 5
    assert bd.Effects.of(full).missing(rich).keys() == {
        "harmonics", "damper modes", "blade modes", "coupled friction",
    }


def test_summits_are_where_a_branch_falls_to_both_sides(full):

    def at(*amplitudes, branch=None):
        return summits(synthetic(full, amplitudes, branch))

    assert at(1.0, 2.0, 1.0) == [1]
    assert at(1.0, 2.0, 2.0, 2.0, 1.0) == [1]  # the mean walks while the vibration stands still
    assert at(3.0, 2.0, 1.0, 2.0) == [] and at(1.0, 2.0, 2.0) == []
    assert at(1.0, 2.0, 1.0, 3.0, 2.0, branch=[0, 0, 1, 1, 1]) == [3]
