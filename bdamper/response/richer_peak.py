"""Peaks of a richer study, reached by Newton's method from the peaks of a study.

A *richer* study has further unknowns: more harmonics, more residual modes, more modes.  Its peak
near a known peak tells how much they matter, usually for a tenth of the price of its response
curve.

:func:`embed` writes the known peak in the unknowns of the richer study.  New harmonics begin at
zero.  The displacements that the known contact forces would cause in them are a bad start: contact
stiffnesses exceed modal stiffnesses by a factor of 100 to 1,000, so that a face that sticks half of
the time cannot follow.  Residual modes with other force vectors begin with unchanged motion of the
contact faces (:func:`with_motion_of_faces`).

Newton's method then continues in the plane normal to the known response curve.  The amplitude is
stationary along the curve at its peak, so that a point of the richer curve near the peak is almost
as high as the richer peak, which ``find_peak`` locates afterwards.
:data:`ATTEMPTS` lists the three attempts.  The sign of det J has to be that of the known peak,
because it changes at every fold.

The equations are not smooth.  Where contacts change between stick, slip and separation, the
iteration may alternate between two contact states near the solution.  Its point with the smallest
residual is then read, as long as the residual is below :data:`READ` of the excitation.  16 of 18
such readings were within 15 % of the true change of the amplitude. Readings above this limit were
wrong.

A lower maximum of the known curve may be the highest in the richer study.  Therefore all maxima
above :data:`NEARLY_HIGHEST` are continued.  Peaks of other branches are not covered.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.residual_flexibility import RESIDUAL, ResidualModes, ResidualSet
from bdamper.harmonic_balance.effects import MAX_HARMONIC, harmonic_numbers
from bdamper.harmonic_balance.equations import OK, Condition, Fixed, Plane, norm2
from bdamper.harmonic_balance.problem import Problem
from bdamper.model.kinematics import Coordinate
from bdamper.response.peak import (
    Peak,
    amplitude_at,
    find_peak,
    phase_row,
    sign_of_jacobian,
    with_tangent,
)
from bdamper.response.peak_error import HARMONICS, VECTORS, HarmonicPeak, SourceError
from bdamper.util.errors import BdamperError
from bdamper.util.formatting import counted, percent
from bdamper.util.progress import CostMeter

# ---- richer studies ----


def nodal_diameter(problem: Problem, harmonic: int) -> int:
    """Return the nodal diameter of the modes of a harmonic."""
    order = problem.engine_order
    if not problem.settings.fundamental_modes_only:
        order = order * harmonic
    diameter, _ = problem.model.folded_nodal_diameter(order)
    return diameter


def missing_harmonics(problem: Problem, top: int) -> list[int]:
    """Return the harmonics up to ``top`` for which the model has no modes."""
    bases = [body.bases for body in problem.model.bodies.values() if body.kind == "constrained"]
    missing = []
    for l in range(2, top + 1):
        diameter = nodal_diameter(problem, l)
        if any(diameter not in by_diameter for by_diameter in bases):
            missing.append(l)
    return missing


def with_stand_ins(problem: Problem, harmonics: int | tuple[int, ...]) -> Problem:
    """Return the study with more harmonics.

    Modes of the fundamental replace modes that the model lacks.
    """
    missing = missing_harmonics(problem, harmonic_numbers(harmonics)[-1])
    if not missing:
        return problem.replace(harmonics=harmonics)
    model = problem.model
    fundamental = nodal_diameter(problem, 1)
    diameters = [nodal_diameter(problem, l) for l in missing]
    bodies = {}
    for name, body in model.bodies.items():
        bases = dict(body.bases)
        if body.kind == "constrained":
            for diameter in diameters:
                bases.setdefault(diameter, body.bases[fundamental])
        bodies[name] = replace(body, bases=bases)
    return problem.replace(model=replace(model, bodies=bodies), harmonics=harmonics)


def with_more_harmonics(problem: Problem, n_more: int = 2) -> Problem:
    """Return the study with all harmonics up to ``n_more`` above its highest one.

    Even harmonics are not added if they vanish.  Modes of the fundamental replace modes that the
    model lacks.

    Raises
    ------
    BdamperError
        If the study has the largest number of harmonics.
    """
    present = problem.harmonic_numbers
    highest = min(present[-1] + n_more, MAX_HARMONIC)
    if highest == present[-1]:
        raise BdamperError(f"bdamper supports no more than {MAX_HARMONIC} harmonics")
    # a constant normal load excites no even harmonics
    adds_even = problem.settings.variable_normal_load
    numbers = list(present)
    for l in range(present[-1] + 1, highest + 1):
        if adds_even or l % 2 == 1:
            numbers.append(l)
    has_no_gap = len(numbers) == numbers[-1]
    return with_stand_ins(problem, len(numbers) if has_no_gap else tuple(numbers))


SOFT_VECTORS = 6
"""Number of soft force vectors that a study with residual modes lacks by default.

They describe contact at the edges of faces.  All vectors, up to 72, cost 0.6 to 3.5 times the
response curve; these cost 1 to 5 % of it.
"""


def with_soft_vectors(problem: Problem) -> Problem | None:
    """Return the study with six more residual modes, or with all if fewer are left.

    None without residual modes, or if the study has all of them.
    """
    method = problem.stiffness_method
    if isinstance(method, str) and method == "residual_modes":
        method = ResidualModes()
    if not isinstance(method, ResidualModes) or method.n_vectors == "all":
        return None
    residual = problem.contact.residual
    assert residual is not None
    n_forces = int(residual.active.sum())
    n_soft = method.n_soft + SOFT_VECTORS
    if method.n_vectors + n_soft >= n_forces:
        richer = replace(method, n_vectors="all", n_soft=0)
    else:
        richer = replace(method, n_soft=n_soft)
    return problem.replace(contact_stiffness=richer)


# ---- a known point in the unknowns of a richer study ----


def embed(old: Problem, new: Problem, preload: float, y: NDArray) -> NDArray:
    """Embed a point of one study in a study with different settings.

    Modes and harmonics of both studies retain their amplitudes, others are zero. The mean retains
    its distance from the state from which the vibration starts.

    Parameters
    ----------
    old, new : Problem
    preload : float, N
    y : (n_unknowns + 1,) float
        Unknowns and angular frequency (rad/s) of the old study.

    Returns
    -------
    (n_unknowns + 1,) float
        Unknowns and angular frequency of the new study.
    """
    from_static = np.array(y, float)
    n_old_mean = old.system(preload).n_mean
    if n_old_mean:
        from_static[:n_old_mean] -= old.at(preload).static.q
    embedded = embed_direction(old, new, preload, from_static)
    n_new_mean = new.system(preload).n_mean
    if n_new_mean:
        embedded[:n_new_mean] += new.at(preload).static.q
    return embedded


def embed_direction(old: Problem, new: Problem, preload: float, step: NDArray) -> NDArray:
    """Embed a difference of two points (n_unknowns + 1,) of one study in another study.

    Modes and harmonics of both studies retain their components, others are zero.
    """
    old_system = old.system(preload)
    new_system = new.system(preload)
    old_bases = old_system.structure.bases
    new_bases = new_system.structure.bases
    embedded = np.zeros(new_system.n_unknowns + 1)
    # the angular frequency
    embedded[-1] = step[-1]
    if old_system.n_mean and new_system.n_mean:
        source, target = _common(old_bases[0].coordinates, new_bases[0].coordinates)
        embedded[target] = step[source]
    for l in range(1, min(old_system.n_harmonics, new_system.n_harmonics) + 1):
        source, target = _common(old_bases[l].coordinates, new_bases[l].coordinates)
        # cosine and sine amplitudes
        for old_part, new_part in zip(old_system.layout.slices(l), new_system.layout.slices(l)):
            embedded[new_part.start + target] = step[old_part.start + source]
    return embedded


@lru_cache(maxsize=256)
def _common(
    source: tuple[Coordinate, ...], target: tuple[Coordinate, ...]
) -> tuple[NDArray, NDArray]:
    """Return the indices of the coordinates that both have, in the first and in the second."""
    index_in_target = {coordinate: j for j, coordinate in enumerate(target)}
    in_source = [i for i, coordinate in enumerate(source) if coordinate in index_in_target]
    in_target = [index_in_target[source[i]] for i in in_source]
    return np.array(in_source, int), np.array(in_target, int)


def with_motion_of_faces(old: Problem, new: Problem, preload: float, y: NDArray) -> NDArray:
    """Embed a point in a study with other residual modes; the contact faces move as before.

    A residual coordinate has another force vector in the other study, and the diagonal flexibility
    of the contact points differs as well.  Least squares for the
    motion of the faces therefore give all residual coordinates.  The faces move as the contact
    elements, and by the diagonal flexibility times the contact force.

    For the parameters see :func:`embed`.
    """
    old_residual = old.contact.residual
    new_residual = new.contact.residual
    embedded = embed(old, new, preload, y)
    if old_residual is None or new_residual is None:
        return embedded
    if old_residual.flexibility.shape != new_residual.flexibility.shape:
        return embedded
    old_system = old.system(preload)
    new_system = new.system(preload)
    added_flexibility = (new_residual.flexibility - old_residual.flexibility)[:, :, None]

    def motion_of_elements(u: NDArray) -> NDArray:
        """Return the motion (n_coef, 3 n_points) that the elements of the new study need."""
        motion, force, _ = old_system.contact(u)
        wanted = motion + added_flexibility * force
        return wanted.reshape(-1, wanted.shape[2]).T

    wanted = motion_of_elements(y[:-1])
    layout = new_system.layout
    for l in range(min(old_system.n_harmonics, new_system.n_harmonics) + 1):
        basis = new_system.structure.bases[l]
        is_residual = np.array([c.body == RESIDUAL for c in basis.coordinates], bool)
        n_mean = new_system.n_mean
        if not is_residual.any() or (l == 0 and n_mean == 0):
            continue
        own = np.flatnonzero(is_residual)
        # motion of the points (3 n_points, n_coordinates)
        motion_of = basis.G.reshape(-1, len(basis.omega2))
        cosine, sine = layout.slices(l)
        if l == 0:
            # changes from the static states of both studies
            at_rest = np.zeros(old_system.n_unknowns)
            at_rest[: old_system.n_mean] = old.at(preload).static.q
            wanted_change = wanted[0] - motion_of_elements(at_rest)[0]
            static = new.at(preload).static.q
            others = embedded[:n_mean] - static
            others[own] = 0.0
            left = wanted_change - (motion_of @ others).real
            embedded[own] = static[own] + _least_squares(motion_of[:, own].real, left)
            continue
        amplitudes = layout.amplitudes(embedded[:-1], l)
        amplitudes[own] = 0.0
        complex_wanted = wanted[2 * l - 1] - 1j * wanted[2 * l]
        residual_amplitudes = _least_squares(
            motion_of[:, own], complex_wanted - motion_of @ amplitudes
        )
        embedded[cosine.start + own] = residual_amplitudes.real
        embedded[sine.start + own] = -residual_amplitudes.imag
    return embedded


def _least_squares(matrix: NDArray, right: NDArray) -> NDArray:
    """Return the shortest least-squares solution without badly determined components."""
    solution, *_ = np.linalg.lstsq(matrix, right, rcond=1e-10)
    return np.asarray(solution)


def starting_point(old: Problem, new: Problem, preload: float, y: NDArray) -> NDArray:
    """Write a point of a study in the unknowns of a richer study, as a start for Newton's method.

    For the parameters see :func:`embed`.
    """
    same_vectors = old.stiffness_method == new.stiffness_method
    same_modes = _modes(old) == _modes(new)
    if isinstance(new.contact.residual, ResidualSet) and not (same_vectors and same_modes):
        return with_motion_of_faces(old, new, preload, y)
    return embed(old, new, preload, y)


def _modes(problem: Problem) -> tuple[Any, ...]:
    """Return the numbers of modes of all bodies, which determine the residual flexibility."""
    settings = problem.settings
    return settings.blade_modes, tuple(sorted(settings.by_body("damper_modes").items()))


# ---- Newton's method in the richer study ----

NEARLY_HIGHEST = 0.7
"""Relative height from which lower maxima are followed along with the highest one.

On a disk (engine order 5) six more residual modes lower the highest peak by 5.8 %, and raise a
maximum of 0.76 times its height to almost the same amplitude: the highest peak changes by 0.3 %.
"""
READ = 0.5
"""Residual, relative to the excitation, below which a point without convergence is read."""
STALLED = 0.1
"""Residual at which an iteration is so close to the solution that another attempt does not help."""
HOPELESS = 1e3
"""Residual after the first attempt from which the peak is not near the start."""
READING_ERROR = 0.2
"""Relative uncertainty of a change that was read."""


class Attempt(NamedTuple):
    """Attempt of Newton's method: at the frequency of the start, or in a plane through it.

    ``line_search`` is explained in :meth:`~bdamper.harmonic_balance.equations.Equations.solve`.
    """

    fixed_frequency: bool
    line_search: int
    max_iterations: int


ATTEMPTS = (
    Attempt(fixed_frequency=False, line_search=2, max_iterations=20),
    Attempt(fixed_frequency=False, line_search=1, max_iterations=20),
    Attempt(fixed_frequency=True, line_search=2, max_iterations=40),
)
"""Attempts in this order.

The second one, in which every step has to reduce the residual, converges where the first one
alternates between two contact states.  At the old frequency the last one has no turn of the curve
to follow.
"""


class Change(NamedTuple):
    """Relative change of a peak from one study to another.

    Parameters
    ----------
    amplitude, frequency : float
        Relative changes; NaN if unknown.
    uncertainty : float
        Possible error of the change: 0 for a computed change, the defect for an estimate, infinite
        if unknown.
    how : str
        Method, or the reason why the change is unknown.
    """

    amplitude: float = np.nan
    frequency: float = np.nan
    uncertainty: float = np.inf
    how: str = ""

    @classmethod
    def between(cls, before: Peak, after: Any, how: str = "") -> Change:
        """Return the change from one computed peak to another with amplitude and frequency."""
        # computed, not estimated: the change itself has no uncertainty
        return cls(
            amplitude=after.amplitude / before.amplitude - 1.0,
            frequency=after.frequency / before.frequency - 1.0,
            uncertainty=0.0,
            how=how,
        )

    @property
    def known(self) -> bool:
        """Whether the change is known."""
        return bool(np.isfinite(self.amplitude))

    @property
    def size(self) -> float:
        """Largest relative change plus its uncertainty; infinite if unknown."""
        size = max(abs(self.amplitude), abs(self.frequency)) + self.uncertainty
        return float(size) if np.isfinite(size) else np.inf


class Reached(NamedTuple):
    """Point of a richer study that Newton's method reached from a peak.

    Parameters
    ----------
    peak : Peak or None
        Peak of the richer study; None without convergence.
    amplitude, frequency : float, m, Hz
        Values at the peak, or at the point with the smallest residual; NaN if this residual is too
        large.
    residual : float
        Smallest residual relative to the excitation; 0 for a peak.
    iterations : int
    """

    peak: Peak | None
    amplitude: float
    frequency: float
    residual: float
    iterations: int = 0

    @property
    def known(self) -> bool:
        """Whether there is a peak or a reading."""
        return bool(np.isfinite(self.amplitude))


class RicherPeaks(NamedTuple):
    """Change of the highest peak in a richer study, and the peaks found there.

    Parameters
    ----------
    change : Change
        Its uncertainty is 0 if Newton's method converged.
    peaks : tuple of Peak
        Converged peaks of the richer study in descending order; empty if the change is unknown or
        was read.
    iterations : int
    """

    change: Change
    peaks: tuple[Peak, ...] = ()
    iterations: int = 0


def richer_peaks(
    problem: Problem, richer: Problem, preload: float, peaks: Sequence[Peak]
) -> RicherPeaks:
    """Find the highest peak of a richer study by Newton's method from the peaks of a study.

    Parameters
    ----------
    problem, richer : Problem
    preload : float, N
    peaks : sequence of Peak
        Maxima of the study at this preload in descending order.

    Returns
    -------
    RicherPeaks
        The change is unknown if the highest peak is not found again.  Lower maxima, which get the
        first attempt only, count if they are found.
    """
    state = richer.static(preload)
    if not state.ok:
        return RicherPeaks(Change(how=f"no static state: {state.reason}"))
    from_rest = [study.at(preload).residual is None for study in (problem, richer)]
    if from_rest[0] != from_rest[1]:
        return RicherPeaks(Change(how="the vibration starts from other friction forces"))
    highest, *lower = peaks
    reached = [reach(problem, richer, preload, highest)]
    if not reached[0].known:
        unknown = Change(how="no peak near this one by Newton's method")
        return RicherPeaks(unknown, iterations=reached[0].iterations)
    for peak in lower:
        reached.append(reach(problem, richer, preload, peak, ATTEMPTS[:1]))
    iterations = sum(item.iterations for item in reached)
    best = max((item for item in reached if item.known), key=lambda item: item.amplitude)
    if best.peak is None:
        amplitude_change = best.amplitude / highest.amplitude - 1.0
        change = Change(
            amplitude=amplitude_change,
            frequency=best.frequency / highest.frequency - 1.0,
            uncertainty=READING_ERROR * abs(amplitude_change),
            how=f"Newton's method stalls at {percent(best.residual)} of the excitation",
        )
        return RicherPeaks(change, iterations=iterations)
    found = [item.peak for item in reached if item.peak is not None]
    descending = sorted(found, key=lambda peak: -peak.amplitude)
    change = Change.between(highest, best.peak, "Newton's method from this peak")
    return RicherPeaks(change, tuple(descending), iterations)


def reach(
    problem: Problem,
    richer: Problem,
    preload: float,
    peak: Peak,
    attempts: Sequence[Attempt] = ATTEMPTS,
) -> Reached:
    """Continue Newton's method from a peak in a richer study.

    The attempts end with the first peak, or if the iteration stalls near a solution.
    """
    own_system = problem.system(preload)
    system = richer.system(preload)
    sign = sign_of_jacobian(own_system, peak.y)
    refined = with_tangent(own_system, peak)
    # a point of a search without a maximum is no start
    if refined.ok:
        peak = refined
    start = starting_point(problem, richer, preload, peak.y)
    _, scale = phase_row(system, start)
    plane = _plane(problem, richer, preload, peak, scale)
    least_residual = np.inf
    nearest = start
    iterations = 0
    for attempt in attempts:
        condition: Condition = Fixed()
        if not attempt.fixed_frequency:
            # a corner has no tangent
            if plane is None:
                continue
            condition = plane
        solution = system.solve(
            start,
            condition,
            scale,
            tolerance=1e-8,
            max_iterations=attempt.max_iterations,
            line_search=attempt.line_search,
        )
        iterations += solution.iterations
        if solution.status == OK:
            richer_peak = find_peak(system, solution.y, tangent=solution.tangent, parameter=preload)
            iterations += richer_peak.iterations
            # another sign belongs to another part of the curve, beyond a fold
            if richer_peak.ok and sign_of_jacobian(system, richer_peak.y) == sign:
                amplitude = richer_peak.amplitude
                return Reached(richer_peak, amplitude, richer_peak.frequency, 0.0, iterations)
        elif solution.residual < least_residual and np.isfinite(solution.y).all():
            least_residual = solution.residual
            nearest = solution.y
        if least_residual < STALLED or (least_residual > HOPELESS and attempt is ATTEMPTS[0]):
            break
    if least_residual >= READ:
        return Reached(None, np.nan, np.nan, least_residual, iterations)
    amplitude = amplitude_at(system, nearest)
    frequency = float(nearest[-1] / (2.0 * np.pi))
    return Reached(None, amplitude, frequency, least_residual, iterations)


def _plane(
    problem: Problem, richer: Problem, preload: float, peak: Peak, scale: NDArray
) -> Plane | None:
    """Return the condition of the plane normal to the known curve; None without its tangent.

    ``scale`` (n_unknowns + 1,) has the units of the unknowns of the richer study.
    """
    direction = peak.tangent * peak.scale
    normal = embed_direction(problem, richer, preload, direction) / scale
    length = norm2(normal)
    if not length > 0.0:
        return None
    return Plane(normal / length)


# ---- errors of a peak ----

LARGE_CHANGE, SMALL_CHANGE = 0.05, 0.02
"""Relative change by two more harmonics from which still more are tried, and up to which no more
are."""
MOST_STEPS = 3
"""Largest number of steps of two harmonics each."""
LEAST_HARMONICS = 3
"""Harmonics from which residual modes are compared.

Only the diagonal flexibility represents contact forces above the highest harmonic, and more vectors
make it smaller.  With one harmonic this change exceeds that by the vectors.
"""

_richer_studies: WeakKeyDictionary[Problem, dict[str, Problem | None]] = WeakKeyDictionary()
"""Richer studies of each problem by source, because all preloads use the same ones."""


def richer_by(problem: Problem, source: str) -> Problem | None:
    """Return the study that is richer in one source of error, made once; None if it has no such
    study.

    Raises
    ------
    BdamperError
        If the study has the largest number of harmonics.
    """
    made = _richer_studies.setdefault(problem, {})
    if source not in made:
        made[source] = (
            with_more_harmonics(problem) if source == HARMONICS else with_soft_vectors(problem)
        )
    return made[source]


class PeakErrors(NamedTuple):
    """Errors of a peak by harmonics and by residual modes.

    Parameters
    ----------
    errors : tuple of SourceError
    harmonic_peaks : tuple of HarmonicPeak
        Peaks with more harmonics, as long as they change; without the peak of the study.
    """

    errors: tuple[SourceError, ...]
    harmonic_peaks: tuple[HarmonicPeak, ...] = ()


def peak_errors(
    problem: Problem,
    preload: float,
    peaks: Sequence[Peak],
    meter: CostMeter,
    most_steps: int = 1,
) -> PeakErrors:
    """Estimate the errors of the highest peak by harmonics and by residual modes.

    Parameters
    ----------
    problem : Problem
    preload : float, N
    peaks : sequence of Peak
        Maxima at this preload above :data:`NEARLY_HIGHEST` in descending order.
    meter : CostMeter
        Counts the work.
    most_steps : int
        Largest number of steps of two harmonics each after a large change.

    Returns
    -------
    PeakErrors
        The error by harmonics is the largest change of all steps.  Residual modes are added to the
        study with two more harmonics, if its peak is known, so that both changes add up to the
        change by both.  With the harmonics of the study they may change another amount: on the
        disk at its optimum (engine order 5) -0.3 instead of +6.6 %.
    """
    ladder = _Ladder(problem, preload, tuple(peaks), meter)
    ladder.step()
    base, base_peaks = problem, tuple(peaks)
    too_few_harmonics = problem.harmonic_numbers[-1] < LEAST_HARMONICS
    if ladder.peaks or too_few_harmonics:
        base, base_peaks = ladder.problem, ladder.peaks
    while ladder.goes_on(most_steps):
        ladder.step()
    errors = [ladder.error]
    vectors = _vector_error(base, preload, base_peaks, meter)
    if vectors is not None and base is not problem and base_peaks:
        number = base.harmonic_numbers[-1]
        vectors = _relative_to(peaks[0], base_peaks[0], number, vectors)
    if vectors is not None:
        errors.append(vectors)
    return PeakErrors(tuple(errors), tuple(ladder.steps))


@dataclass
class _Ladder:
    """Peaks with two more harmonics at each step, which starts from the peak of the previous step.

    Parameters
    ----------
    problem, peaks : Problem, tuple of Peak
        Study and peaks of the last step; no peaks after a step without convergence.
    """

    problem: Problem
    preload: float
    peaks: tuple[Peak, ...]
    meter: CostMeter
    steps: list[HarmonicPeak] = field(default_factory=list)
    error: SourceError = field(init=False)

    def __post_init__(self) -> None:
        self.own = self.peaks[0]
        self.error = SourceError(HARMONICS, np.nan, np.nan, np.inf, "")

    def goes_on(self, most_steps: int) -> bool:
        """Return whether another step is useful."""
        if not self.steps:
            return not self.error.against
        if not self.peaks or len(self.steps) >= most_steps:
            return False
        before = self.own.amplitude if len(self.steps) == 1 else self.steps[-2].amplitude
        change = abs(self.steps[-1].amplitude / before - 1.0)
        return change > (LARGE_CHANGE if len(self.steps) == 1 else SMALL_CHANGE)

    def step(self) -> None:
        """Find the peak with two more harmonics."""
        start = time.thread_time()
        try:
            richer = richer_by(self.problem, HARMONICS)
        except BdamperError as reason:
            self.peaks = ()
            if not self.steps:
                self.error = SourceError(HARMONICS, np.nan, np.nan, np.inf, str(reason))
            return
        assert richer is not None
        number = richer.harmonic_numbers[-1]
        found = _watched(self.problem, richer, self.preload, self.peaks, self.meter)
        seconds = time.thread_time() - start
        self.peaks = found.peaks
        self.problem = richer
        text = counted(number, "harmonic")
        if not found.change.known:
            if not self.steps:
                self.error = _unknown(HARMONICS, found.change, text, seconds)
            return
        # relative to the peak of the study, not to the step before
        before = self.steps[-1] if self.steps else self.own
        amplitude = (1.0 + found.change.amplitude) * before.amplitude
        frequency = (1.0 + found.change.frequency) * before.frequency
        self.steps.append(HarmonicPeak(number, amplitude, frequency, seconds))
        error = SourceError(
            HARMONICS,
            amplitude=amplitude / self.own.amplitude - 1.0,
            frequency=frequency / self.own.frequency - 1.0,
            uncertainty=found.change.uncertainty,
            against=_against(text, found.change, f"search with harmonics={number}"),
            seconds=seconds + (self.error.seconds if self.steps[1:] else 0.0),
        )
        if len(self.steps) == 1 or abs(error.amplitude) > abs(self.error.amplitude):
            self.error = error
        else:
            self.error = replace(self.error, seconds=error.seconds)


def _vector_error(
    problem: Problem, preload: float, peaks: Sequence[Peak], meter: CostMeter
) -> SourceError | None:
    """Return the error by residual modes; None if the study has none or has all of them."""
    start = time.thread_time()
    richer = richer_by(problem, VECTORS)
    if richer is None:
        return None
    text = f"{SOFT_VECTORS} more residual modes"
    if not peaks:
        why = Change(how=f"unknown with {LEAST_HARMONICS} harmonics")
        return _unknown(VECTORS, why, text, 0.0)
    change = _watched(problem, richer, preload, peaks, meter).change
    seconds = time.thread_time() - start
    if not change.known:
        return _unknown(VECTORS, change, text, seconds)
    return SourceError(
        VECTORS,
        amplitude=change.amplitude,
        frequency=change.frequency,
        uncertainty=change.uncertainty,
        against=_against(text, change, "study.estimate_errors(peak)"),
        seconds=seconds,
    )


def _relative_to(own: Peak, base: Peak, number: int, error: SourceError) -> SourceError:
    """Return the error of a peak with more harmonics relative to the peak of the study.

    ``number`` is the highest harmonic of the former.
    """
    if not error.known:
        return error
    height = base.amplitude / own.amplitude
    return replace(
        error,
        amplitude=height * error.amplitude,
        frequency=base.frequency / own.frequency * error.frequency,
        uncertainty=height * error.uncertainty,
        against=f"{counted(number, 'harmonic')} and {error.against}",
    )


def _watched(
    problem: Problem, richer: Problem, preload: float, peaks: Sequence[Peak], meter: CostMeter
) -> RicherPeaks:
    """Find the peaks of a richer study, and count the work."""
    if richer.static(preload).ok:
        meter.watch(richer.system(preload))
    return richer_peaks(problem, richer, preload, peaks)


def _unknown(source: str, change: Change, text: str, seconds: float) -> SourceError:
    """Return an error without a value, with the next step."""
    against = f"{change.how} with {text}: study.estimate_errors(peak)"
    return SourceError(source, np.nan, np.nan, np.inf, against, seconds)


def _against(text: str, change: Change, remedy: str) -> str:
    """Return the richer setting; with the residual and a remedy for a reading."""
    if change.uncertainty == 0.0:
        return text
    return f"{text}; {change.how}: {remedy}"
