"""Checks of the settings of a problem, checks that a result belongs to it, and the response of a
result elsewhere.

Settings outside their plausible ranges (:mod:`bdamper.util.plausible_ranges`) and intervals in
radians per second cause warnings.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import fields, replace
from functools import wraps
from typing import Any, Concatenate, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.stiffness import PerArea
from bdamper.harmonic_balance.equations import Equations
from bdamper.harmonic_balance.problem import LoadCase, Problem
from bdamper.harmonic_balance.sector import SectorData
from bdamper.harmonic_balance.settings import FRICTION
from bdamper.harmonic_balance.study_boundary import A, P, R, problem_of
from bdamper.model.loads import Response
from bdamper.util import plausible_ranges, validation
from bdamper.util.errors import SettingError, warn, warn_implausible
from bdamper.util.formatting import amount
from bdamper.util.progress import one_thread

ALONG = 0.12
"""Smallest plausible cosine between force and modal motion at the excitation location (83 degrees).
"""

# ---- results and their problem ----


class SomeResult(Protocol):
    """Result with the settings and the model hash of its problem."""

    @property
    def settings(self) -> dict[str, Any]: ...
    @property
    def model_hash(self) -> str: ...


def check_result(problem: Problem, result: SomeResult, name: str = "result") -> None:
    """Raise an error if a result has another model, another rotor speed or other settings.

    Parameters
    ----------
    problem : Problem
    result : SomeResult
        It may lack settings that were added in a later version.
    name : str
        Name in error messages.

    Raises
    ------
    SettingError
        If the result belongs to another problem.
    """
    recorded = dict(result.settings)
    current = problem.record()
    # versions up to 0.10 also recorded the coefficients of interfaces with a ContactLaw
    friction = recorded.get("friction_coefficient")
    if isinstance(friction, Mapping):
        used = current["friction_coefficient"]
        user_laws = problem.settings.own_laws()
        without_user_laws = {}
        for face, mu in friction.items():
            if face in used or face not in user_laws:
                without_user_laws[face] = mu
        recorded["friction_coefficient"] = without_user_laws
    different = []
    for key in current:
        # a stability analysis does not change the solutions
        if key == "stability" or key not in recorded:
            continue
        if recorded[key] != current[key]:
            different.append(key)

    if "speed" in different:
        speed_of_study = _speed_text(current["speed"])
        speed_of_result = _speed_text(recorded["speed"])
        raise SettingError(
            f"{name}: expected a result at the rotor speed of this study, {speed_of_study}, "
            f"found {speed_of_result}"
        )
    # stress may be added later
    without_stress = replace(problem.model, stress={})
    if result.model_hash not in (problem.model.hash, without_stress.hash):
        found = "a result of another model" if recorded else "a result without a model"
        raise SettingError(f"{name}: expected a result of this study's model, found {found}")
    found = ", ".join(f"{key} = {recorded[key]} instead of {current[key]}" for key in different)
    validation.check(not different, name, "a result of this study", found)


def _speed_text(speed: float | None) -> str:
    return "none" if speed is None else f"{speed:.9g} rad/s"


def check_solution(
    problem: Problem, preload: float, y: NDArray, residual: float, name: str
) -> None:
    """Raise SettingError unless a point solves the equations at a preload (N).

    The point (n_unknowns + 1,) must solve them with the accuracy given by its ``residual``.
    """
    # the last entry is the frequency
    n = len(y) - 1
    validation.check(
        n == problem.n_unknowns,
        name,
        f"a result of this study with {problem.n_unknowns} unknowns",
        n,
    )
    error = problem.system(preload).error(y)
    found = (
        "a free or stuck response, or a result computed with different settings "
        f"(residual {error:.2g})"
    )
    validation.check(error <= max(1e-6, 100.0 * residual), name, "a result of this study", found)


def unknowns_of(problem: Problem, result: SomeResult) -> NDArray:
    """Return the solutions (n, n_unknowns) of a peak or a curve, NaN at points of a curve without a
    solution.

    Parameters
    ----------
    problem : Problem
    result : ResponseCurve or Peak

    Raises
    ------
    SettingError
        If there are no solutions, or they belong to another problem.
    """
    given: Any = result
    is_peak = hasattr(given, "y")
    if is_peak:
        if not given.ok:
            raise SettingError(
                f"result: expected a converged peak, found status {given.status_text!r}"
            )
        # one solution, without its frequency
        unknowns = np.asarray(given.y)[None, :-1]
    elif hasattr(given, "unknowns"):
        unknowns = np.asarray(given.unknowns)
    else:
        expected = "a peak or a curve with its solutions, such as study.peak(preload)"
        raise SettingError(f"result: expected {expected}, found {type(result).__name__}")
    if not len(unknowns) or unknowns.shape[1] != problem.n_unknowns:
        n = unknowns.shape[1] if len(unknowns) else 0
        expected = f"a result of this study, with {problem.n_unknowns} unknowns"
        raise SettingError(f"result: expected {expected}, found {n} unknowns")
    if hasattr(given, "settings"):
        check_result(problem, result)
    return unknowns


class Solutions(NamedTuple):
    """Solutions of a peak or a curve.

    Parameters
    ----------
    unknowns : (m, n) float
    frequency, preload : (m,) float, Hz and N
    kind : (m,) str
        "response", "free", "stuck" ...
    """

    unknowns: NDArray
    frequency: NDArray
    preload: NDArray
    kind: NDArray


def solutions_of(problem: Problem, result: SomeResult) -> Solutions:
    """Return the solutions of a peak or a curve with their preloads.

    Raises
    ------
    SettingError
        See :func:`unknowns_of`, and if a peak does not solve the equations, such as the peak of a
        free or stuck limit.
    """
    given: Any = result
    unknowns = unknowns_of(problem, result)
    is_peak = hasattr(given, "y")
    preload = np.asarray(given.parameter if is_peak else given.preload, float)
    known = np.isfinite(preload).all()
    validation.check_sentence(known, "result", "its preload is unknown")
    if is_peak:
        check_solution(problem, float(preload), given.y, given.residual, "result")
    n = len(unknowns)
    frequency = np.asarray(given.frequency, float)
    kind = np.asarray(getattr(given, "kind", "response"))
    return Solutions(
        unknowns,
        frequency=np.broadcast_to(frequency, n),
        preload=np.broadcast_to(preload, n),
        kind=np.broadcast_to(kind, n),
    )


def response_at(problem: Problem, result: SomeResult, place: Response) -> NDArray:
    """See :meth:`bdamper.Study.response_at`."""
    locations = problem.model.locations
    # other kinds are force fields, and the base
    places = sorted(name for name, at in locations.items() if at.kind is None)
    validation.choice("location", place.location, places)
    possible = problem.settings.response_location.absolute or not place.absolute
    expected = "a study whose response is absolute, bd.Response(..., absolute=True)"
    validation.check(possible, "absolute", expected, "a relative one")
    rows = problem.rows_at(place)
    unknowns = unknowns_of(problem, result)
    by_harmonic = []
    for harmonic, row in enumerate(rows):
        # (n, n_modes) @ (n_modes,)
        by_harmonic.append(problem.layout.amplitudes(unknowns, harmonic) @ row)
    return np.stack(by_harmonic, axis=-1)


def warn_of_small_slip(problem: Problem, system: Equations[Any], unknowns: NDArray) -> None:
    """Warn about joints whose motion in a solution is smaller than their sliders resolve."""
    resolution = problem.model.slip_resolution
    if problem.own_laws is None and resolution is None:
        return
    motion, _, _ = system.contact(unknowns)
    if problem.own_laws is not None:
        problem.own_laws.warn_below(motion)
    if resolution is None:
        return
    # bound of the tangential motion: sum of the coefficients without the mean
    tangential = motion[:, :2, 1:]
    largest = float(np.abs(tangential).sum(axis=2).max())
    if largest < resolution:
        warn(
            f"the joint moves by {largest:.3g} m, less than the {resolution:.3g} m that its "
            "sliders resolve: its damping is wrong there; increase its decades"
        )


# ---- plausible settings ----


def check_settings(problem: Problem) -> None:
    """Warn if settings of a problem are outside their plausible ranges, or have no effect."""
    sizes = problem.sizes
    for setting in _effective_settings(problem):
        plausible_ranges.check(setting.owner, setting.name, setting.value, sizes, setting.item)
    settings = problem.settings
    # a lumped model has the coefficients of its contacts; Problem.replace warns of others
    if not sizes.lumped and settings.friction_coefficient != FRICTION:
        settings.warn_of_unused_friction(settings.friction_coefficient)
    flow = settings.aerodynamic_damping
    if isinstance(flow, Mapping):
        n = max(problem.model.n_blades, 1)
        orders = [problem.engine_order * harmonic for harmonic in settings.harmonic_numbers]
        used = {order % n for order in orders}
        in_common = set(flow) & used
        if not in_common:
            warn_implausible(
                "aerodynamic_damping",
                f"values at the nodal diameters of the study, {sorted(used)}",
                f"values at {sorted(flow)} only",
            )


class _Setting(NamedTuple):
    """Value of a setting with owner and name in the table of ranges, and its name in a warning.

    Without ``item`` the table has the name in a warning.
    """

    owner: str
    name: str
    value: Any
    item: str = ""


def _effective_settings(problem: Problem) -> Iterator[_Setting]:
    """Yield the settings of a problem, with the values that take effect.

    Masses of free bodies and the mean contact stiffness are also compared with plausible ranges.
    """
    settings = problem.settings
    sizes = problem.sizes
    for field in fields(settings):
        yield _Setting("Study", field.name, _effective(problem, field.name))
    for force in (settings.excitation, *settings.excitation.beside):
        place = settings.model.locations.get(force.location)
        # others are force fields and modal forces
        if place is not None and place.kind is None:
            amplitude = {force.location: force.amplitude}
            yield _Setting("Excitation", "amplitude", amplitude, item="excitation amplitude")
    for body in problem.model.bodies.values():
        if body.is_free and body.ports and sizes.volume(body.name) > 0.0:
            yield _Setting("Body", f"mass.{body.name}", body.mass or 0.0)

    # a stiffness that bdamper computes needs no check; residual modes have n_vectors
    method = settings.contact_stiffness
    computed = method is None or isinstance(method, str) or hasattr(method, "n_vectors")
    if method == "model" or not computed:
        stiffness = problem.point_stiffness[problem.friction_points]
        if stiffness.any() and np.isfinite(sizes.body_stiffness):
            mean = float(stiffness.mean())
            # the value that is compared is not the value that the user has given
            item = ""
            if isinstance(method, PerArea):
                item = f"contact_stiffness of {type(method).__name__}"
            yield _Setting("Study", "contact_stiffness", mean, item)


def _effective(problem: Problem, name: str) -> Any:
    """Return the value of a setting that takes effect; None if it is checked apart."""
    settings = problem.settings
    if name == "friction_coefficient":
        if not isinstance(settings.friction_coefficient, Mapping):
            return settings.friction_values()
        return settings.friction_values_by_interface()
    if name == "damping_ratio" and settings.damping_ratio is None:
        of_modes = [basis.damping_ratio.max(initial=0.0) for basis in problem.modal_bases]
        return max(of_modes, default=0.0)
    if name == "gap":
        coupling = problem.coupling
        return {face: problem.point_gaps[coupling.rows(face)] for face in coupling.interfaces}
    if name == "contact_stiffness":
        return None
    return getattr(settings, name)


def check_contacts(problem: Problem, name: str) -> None:
    """Raise SettingError if the model has no contacts, which the analysis ``name`` needs."""
    found = "none; use free, campbell, run_up, peak(0.0), frequency_response(0.0) or a BladedDisk"
    validation.check(bool(problem.coupling.interfaces), name, "a model with contacts", found)


def needs_contacts(method: Callable[Concatenate[A, P], R]) -> Callable[Concatenate[A, P], R]:
    """Decorate a method of a study, so that it refuses a model without contacts."""

    @wraps(method)
    def of_contacts(study: A, /, *given: P.args, **named: P.kwargs) -> R:
        check_contacts(problem_of(study), method.__name__)
        return method(study, *given, **named)

    return of_contacts


@one_thread
def check_question(
    problem: Problem, preload: Sequence[float] | NDArray, frequency: tuple[float, float] | None
) -> None:
    """Check a frequency interval (Hz) and warn if it is implausible at the largest of the preloads
    (N).

    Public functions call it once for the whole range of preloads.
    """
    pressed = problem.settings.constant_loads or (problem.point_gaps < 0.0).any()
    if problem.carries_load and not np.any(preload) and not pressed:
        warn_implausible(
            "preload", "above 0 N", "0: no contact has a normal force, as in study.free"
        )
    if frequency is not None:
        frequency = validation.interval("frequency", frequency)
        largest = float(np.max(preload)) if problem.carries_load else 0.0
        check_interval(problem.at(largest), frequency)


def check_unloaded(problem: Problem) -> None:
    """Warn if every body whose preload is varied also has a constant load.

    The optimum then excludes the constant load.
    """
    settings = problem.settings
    shares = settings.given_loads("load_per_preload")
    varied = {name for name, share in shares.items() if share}
    # constant loads on bodies or faces with a preload
    constant = {}
    for name, load in settings.given_loads("constant_loads").items():
        if name in varied and np.any(load):
            constant[name] = load
    all_constant = set(constant) == varied
    if varied and all_constant:
        loads = ", ".join(
            f"{float(np.sum(load)):g} N on {name!r}" for name, load in constant.items()
        )
        warn_implausible(
            "constant_loads",
            "none on a body that carries the preload",
            f"{loads}; the optimal preload is in addition to it",
        )


class _Resonance(NamedTuple):
    """Linear resonance with angular frequency (rad/s) and springs (n_points, 3).

    Without contact the springs are None.
    """

    omega: float
    springs: NDArray | None

    @property
    def frequency(self) -> float:
        """Frequency, Hz."""
        return self.omega / (2.0 * np.pi)


def check_interval(
    case: LoadCase, frequency: tuple[float, float], *, with_stuck: bool = True
) -> None:
    """Warn if an interval (Hz) was probably given in radians per second.

    The interval is compared with the free and stuck resonances of the modes.  If it contains none,
    it causes a warning if it contains any when read in rad/s instead.  If it contains some, it
    causes a warning only if it is shorter than an octave, and contains free and stuck resonances
    with a far larger response to the excitation when read in rad/s instead: a longer interval
    contains resonances in either unit.  An interval far from every resonance in both units causes
    another warning.  Without contact only the free resonances count (``with_stuck``).
    """
    if not case.static.ok:
        return
    sector = case.sector
    _check_direction(case.problem, sector, frequency)
    resonances = []
    states = (None, case.stuck_springs()) if with_stuck else (None,)
    for springs in states:
        omegas, _ = sector.linear.modes(springs)
        resonances += [_Resonance(omega, springs) for omega in omegas if omega > 0.0]
    low, high = frequency
    contained = [resonance for resonance in resonances if low < resonance.frequency < high]
    as_radians = [resonance for resonance in resonances if low < resonance.omega < high]
    # free resonances have one springs object (None), stuck ones another
    states_as_radians = {id(resonance.springs) for resonance in as_radians}
    all_states = len(states_as_radians) == len(states)
    if contained and (high > 2.0 * low or not all_states):
        return

    response = _strongest(sector, contained)
    response_as_radians = _strongest(sector, as_radians)
    # ratio of responses (read as rad/s over as given) above which rad/s is suspected: at least 333
    # for first modes of blades under a tangential force at the tip.  The second bending mode of a
    # cantilever lies at 6.27 times the first, nearly 2 pi, and its response is 39 times weaker
    weaker = 200.0
    if as_radians and response_as_radians > weaker * response:
        nearest = sorted({resonance.frequency for resonance in as_radians})[:3]
        near = ", ".join(f"{hertz:.5g}" for hertz in nearest)
        weak = "without a resonance"
        if response:
            weak = f"with a response {response_as_radians / response:.2g} times weaker"
        warn_implausible(
            "frequency",
            f"an interval in Hz around resonances of the model, such as {near} Hz",
            f"({low:g}, {high:g}) {weak}; divided by 2 pi, it contains resonances: possibly "
            "given in radians per second",
        )
        return
    _check_far(case.problem, resonances, frequency)


def _strongest(sector: SectorData, resonances: Sequence[_Resonance]) -> float:
    """Return the largest linear response at resonances, 0 if there are none."""
    row = sector.response_rows[1]
    responses = [
        abs(sector.linear.response(resonance.omega, resonance.springs) @ row)
        for resonance in resonances
    ]
    return max(responses, default=0.0)


def _check_far(
    problem: Problem, resonances: Sequence[_Resonance], frequency: tuple[float, float]
) -> None:
    """Warn about an interval (Hz) far from every resonance."""
    # a cubic spring moves resonances far away
    if not resonances or any(face.kind == "cubic" for face in problem.model.interfaces.values()):
        return
    low, high = frequency
    # ratio of a frequency, or of an active harmonic of it, to the nearest resonance; nonlinear
    # resonances lie nearer
    far = 2.0
    highest_harmonic = problem.settings.harmonic_numbers[-1]
    hertz = sorted({resonance.frequency for resonance in resonances})
    if any(low / far < f < far * highest_harmonic * high for f in hertz):
        return
    nearest = min(hertz, key=lambda f: abs(np.log(f / high)))
    warn_implausible(
        "frequency",
        f"an interval in Hz around a resonance, such as {amount(nearest, 'Hz')}",
        f"({low:g}, {high:g}), far from every resonance; possibly given in kHz, or a wrong digit",
    )


def _check_direction(problem: Problem, sector: SectorData, frequency: tuple[float, float]) -> None:
    """Warn about a force perpendicular to the motion of all modes in an interval (Hz).

    The modes are those without contact.
    """
    omega, modes = sector.linear.modes(contact=None)
    hertz = omega / (2.0 * np.pi)
    low, high = frequency
    within = (low < hertz) & (hertz < high)
    if not within.any():
        return
    excitation = problem.settings.excitation
    # motion (3, n) of the location in each mode, its size, and its part along the force
    at_location = problem.location_modes(excitation.location, harmonic=1) @ modes[:, within]
    motion = np.linalg.norm(at_location, axis=0)
    force = problem.modal_force(1)
    along = np.abs(force.conj() @ modes[:, within]) / excitation.amplitude
    all_across = (along <= ALONG * motion).all()
    if not all_across:
        return
    share = np.max(along / np.where(motion > 0.0, motion, 1.0))
    modes_at = ", ".join(f"{f:.5g}" for f in hertz[within][:3])
    warn_implausible(
        "excitation direction",
        f"along the motion of a mode in the interval ({modes_at} Hz)",
        f"{excitation.direction} at '{excitation.location}', with at most {100.0 * share:.2g} % of "
        "the motion of these modes",
    )
