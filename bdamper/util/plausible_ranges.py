"""Plausible ranges of all numerical arguments, in SI units.

A value outside its range is used, with a warning that gives the value, the range and the likely
mistake.  A key of the table is the name of a parameter.  The name of a function or class before it
limits the range to that function or class.  A bound can depend on characteristic sizes of the model
(:class:`bdamper.harmonic_balance.model_sizes.Sizes`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from bdamper.util.errors import warn_implausible

Bound = float | Callable[[Any, Any], float]
"""Number, or function of the characteristic sizes of a model and of the key in a mapping."""


def each(values: NDArray) -> tuple[float, float]:
    """Return the smallest and the largest value except 0, which switches a setting off."""
    values = values[values != 0.0]
    if not len(values):
        return np.inf, -np.inf
    return float(values.min()), float(values.max())


def some(values: NDArray) -> tuple[float, float]:
    """Return the largest and the smallest value as limits, so that the check passes if any value is
    plausible.

    The largest value is compared with the lower bound, and the smallest with the upper bound.
    """
    return float(values.max()) or np.inf, float(values.min())


def largest(values: NDArray) -> tuple[float, float]:
    """Return the largest magnitude as both limits, for measured values that may be close to 0."""
    size = float(np.abs(values).max())
    return size or np.inf, size


def all_of(values: NDArray) -> tuple[float, float]:
    """Return the smallest and the largest value."""
    return float(values.min()), float(values.max())


@dataclass(frozen=True)
class Range:
    """Plausible range of a parameter.

    Parameters
    ----------
    low, high : float or callable
        Bounds, or functions that compute them from the characteristic sizes of a model and the
        key of the value in a mapping.
    unit : str
    above, below : str
        Likely mistake if a value lies above or below the range.
    by : str
        Explanation of the bounds.
    compared : callable
        Function of an array that returns the values to compare with ``low`` and ``high``.
    """

    low: Bound
    high: Bound
    unit: str = ""
    above: str = "possibly a wrong unit or digit"
    below: str = "possibly a wrong unit or digit"
    by: str = ""
    compared: Callable[[NDArray], tuple[float, float]] = each

    def check(self, item: str, values: NDArray, sizes: object = None, key: object = None) -> None:
        """Warn about values outside the range.

        Nothing is checked if the bounds need sizes and ``sizes`` is None.
        """
        if sizes is None and (callable(self.low) or callable(self.high)):
            return
        low = self.low(sizes, key) if callable(self.low) else self.low
        high = self.high(sizes, key) if callable(self.high) else self.high
        if low >= 0.0 and self.compared is not largest:
            # the function of the user's call rejects negative values itself, with an error
            values = values[values >= 0.0]
        if not len(values):
            return
        least, most = self.compared(values)
        if least >= low and most <= high:
            return
        if least < low:
            value = least
            mistake = self.below
        else:
            value = most
            mistake = self.above
        found = f"{value:.4g}"
        if self.compared is some and values.min() < values.max():
            found = f"{values.min():g} to {values.max():g}"
        found = f"{found} {self.unit}".rstrip()
        warn_implausible(item, self._text(low, high), f"{found}; {mistake}")

    def _text(self, low: float, high: float) -> str:
        """Return the range with its unit and explanation."""
        # bounds from the sizes of a model are not round
        low_text = f"{low:.2g}" if callable(self.low) else f"{low:g}"
        high_text = f"{high:.2g}" if callable(self.high) else f"{high:g}"
        if np.isinf(high):
            text = f"{low_text} or more"
        elif low and np.isfinite(low):
            text = f"{low_text} to {high_text}"
        else:
            text = f"at most {high_text}"
        text = f"{text} {self.unit}".rstrip()
        return f"{text}, {self.by}" if self.by else text


class Rotating(Protocol):
    """Sizes of a model that can rotate (:class:`bdamper.harmonic_balance.model_sizes.Sizes`)."""

    def check_preload(self, preload: NDArray) -> bool: ...


@dataclass(frozen=True)
class Names:
    """Entry for a mapping whose keys are parameters of another function or class.

    Parameters
    ----------
    of : str
        Function or class that has the ranges.
    leading : int, optional
        Number of values of each parameter that are compared, beginning with the first.  For example,
        1 omits the standard deviation in a pair of mean and standard deviation.
    """

    of: str
    leading: int | None = None


GRAMS = "possibly given in grams"
PER_CENT, MILLIMETRES = "possibly given in per cent", "possibly given in millimetres or micrometres"
RPM = "possibly given in revolutions per minute"

UNEXCITED = (
    "any load: the excitation, with which preloads are compared, has no effect or is checked "
    "earlier"
)
BY_EFFECT = "checked by its effect, which has a range of its own"
UNUSED = "any number: the preload has no effect"
NOT_A_NUMBER = "a description, whose parts have ranges"
"""Reasons why a parameter has no range although another one of its name has."""

DAMPING = Range(0.0, 0.1, "of critical damping", PER_CENT)
STIFFNESS = Range(0.0, 1e13, "N/m", "possibly given in N/mm or GN/m")
STRENGTH = Range(
    1e6,
    1e10,
    "Pa",
    "possibly converted from MPa to Pa twice",
    "possibly given in MPa; 1 MPa is 1e6 Pa",
)
TEMPERATURE = Range(
    -200.0, 1500.0, "°C", "possibly given in K", "possibly °C labelled as K", compared=all_of
)
PRELOAD = Range(
    lambda s, _: s.amplitude,
    lambda s, _: 1e6 * s.amplitude or np.inf,
    "N",
    "possibly given in mN, or nothing slips",
    "possibly given in kN, or the damper leaves its seat",
    "1 to 1e+06 times the excitation amplitude",
    some,
)
ACCELERATION = Range(
    1e-4, 1e3, "m/s2", "possibly given in mm/s2", "possibly given in km/s2 or as a displacement"
)
LOAD_HISTORY = Range(
    1e-3, 10.0, above="possibly given in newtons; factors on the preload are expected"
)
DEVIATION = Range(
    -0.5,
    0.5,
    "of the frequency",
    "possibly given in per cent or Hz",
    "possibly given in per cent or Hz",
)

WITHOUT_RANGE = {
    "Study.excitation": NOT_A_NUMBER,
    "Study.speed": BY_EFFECT,
    "PeakTask.preload": BY_EFFECT,
    "OptimalTask.preload": BY_EFFECT,
    "stuck.preload": UNUSED,
    "nonlinear_mode.preload": UNEXCITED,
    "flutter.preload": UNEXCITED,
    "microslip.preload": UNEXCITED,
    "static.preload": UNEXCITED,
    "wedge_friction.preload": UNEXCITED,
    "first_slip.preload": UNEXCITED,
    "BladedDisk.state.preload": UNEXCITED,
    "BladedDisk.system.preload": UNEXCITED,
    "BladedDisk.tuned_peak.preload": UNEXCITED,
}
"""Exceptions from the ranges that apply to a name in every function.  Other parameters without a
range need no entry.
"""

TABLE: dict[str, Range | Names | tuple[Range, ...] | str] = {
    # settings of a study
    "Study.engine_order": Range(
        lambda s, _: s.least_order,
        lambda s, _: s.largest_order,
        compared=all_of,
        below="a force that does not vary as the wheel turns and excites nothing",
        above="possibly given in rad/s or Hz, or a number of vanes, which excites a different nodal diameter",
    ),
    "Study.friction_coefficient": Range(
        0.05,
        1.5,
        above=PER_CENT,
        by="or 0",
        below="possibly a wrong digit; lubricated steel has 0.05, clean metals up to 1.5",
    ),
    "Study.contact_stiffness": Range(
        lambda s, _: 0.01 * s.body_stiffness,
        lambda s, _: 100.0 * s.body_stiffness,
        "N/m",
        "possibly a stiffness per area or of the whole face",
        "possibly given in N/mm or per area",
        "mean of the contact points, 0.01 to 100 times the stiffness of the bodies there",
    ),
    "Study.contact_stiffness_factor": Range(
        1e-3,
        1e3,
        above="possibly given in N/m; a factor is expected",
        below="possibly a flexibility in m/N; a factor on the stiffness is expected",
    ),
    "Study.damping_ratio": DAMPING,
    "Study.damper_damping_ratio": Range(0.0, 0.5, "of critical damping", PER_CENT),
    "Study.damper_drag": Range(
        0.0,
        lambda s, body: s.critical_drag(body),
        "N s/m",
        "possibly given per area, or a stiffness",
        by="critical damping of the body at the first natural frequency",
    ),
    "Study.gap": Range(
        # slender blades take up an interference of millimetres by their twist
        lambda s, _: -0.02 * s.size,
        lambda s, _: 0.02 * s.size,
        "m",
        MILLIMETRES,
        MILLIMETRES,
        "-2 % to 2 % of the extent of the model",
    ),
    "Study.load_per_preload": Range(
        1e-3,
        100.0,
        "newtons per newton of preload",
        "possibly given in newtons; fractions are expected",
        "possibly a load in newtons divided twice by the preload",
    ),
    "Study.constant_loads": Range(
        lambda s, name: -s.bearable(name),
        lambda s, name: s.bearable(name),
        "N",
        "possibly a stiffness, or given in kN",
        "possibly a distance; a negative load of a point is a gap",
        "a pressure of 1 GPa on the faces",
    ),
    "Study.load_history": LOAD_HISTORY,
    "Study.residual_slip_std": Range(
        1e-12, lambda s, _: 1e-3 * s.size, "m", MILLIMETRES, by="0.1 % of the extent"
    ),
    "Study.aerodynamic_damping": Range(0.0, 0.1, "of critical damping", PER_CENT, compared=largest),
    "Excitation.amplitude": Range(
        lambda s, _: s.least_force,
        lambda s, where: s.deflecting(where),
        "N",
        "possibly given in mN or N/m2",
        "possibly given in kN or MN",
        "up to the force that deflects the structure by 10 % of its extent",
    ),
    "Body.mass": Range(
        # per volume of the box around the contact points, 50 to 1e5 kg/m3 (steel wedges: 7,600 to
        # 8,900)
        lambda s, name: 50.0 * s.volume(name),
        lambda s, name: 1e5 * s.volume(name),
        "kg",
        GRAMS,
        "possibly given in tonnes",
        "by the size of its faces",
    ),
    # settings that a study varies by name
    "Study.friction_factor": Range(
        0.1,
        10.0,
        above="possibly given in per cent; a factor is expected",
        below="possibly a friction coefficient; a factor on it is expected",
    ),
    "Study.damping_factor": Range(
        0.02,
        50.0,
        above="possibly given in N s/m; a factor is expected",
        below="possibly a damping ratio; a factor on it is expected",
    ),
    "Study.damper_inertia_factor": Range(
        0.02, 15.0, above=GRAMS, below="possibly given in kilograms"
    ),
    "Study.damper_mass_factor": Range(0.02, 15.0, above=GRAMS, below="possibly given in kilograms"),
    "Study.frequency_factor": Range(
        0.5,
        2.0,
        above="possibly given in Hz; a factor is expected",
        below="possibly given in kHz; a factor is expected",
    ),
    "Study.gap_factor": Range(
        1e-3,
        1e3,
        above="possibly given in micrometres; a factor is expected",
        below="possibly given in metres; a factor is expected",
    ),
    "Study.force_factor": Range(
        1e-2,
        1e2,
        above="possibly given in newtons; a factor is expected",
        below="possibly given in kN; a factor is expected",
    ),
    "Study.excitation.amplitude": Range(
        1e-6, 1e6, "N", "possibly given in mN", "possibly given in MN"
    ),
    "Study.excitation.phase": Range(
        -2.0 * np.pi, 2.0 * np.pi, "rad", "possibly given in degrees", "possibly given in degrees"
    ),
    "sweep.over": Names("Study"),
    "optimal_curve_uncertainty.samples": Names("Study"),
    "robust_optimum.samples": Names("Study"),
    "fit.vary": Names("Study"),
    "fit.priors": Names("Study", leading=1),
    "compare.studies": Names("Study"),
    # arguments of analyses
    "preload": PRELOAD,
    "preloads": PRELOAD,
    "static.history": LOAD_HISTORY,
    "resonance_crossings.damper_mass_factor": Range(
        0.05,
        10.0,
        "times the mass of the damper",
        "possibly given in grams; factors are expected",
        "possibly given in kilograms; factors are expected",
    ),
    "flutter.aerodynamic_damping": Range(
        0.0, 0.1, "of critical damping", PER_CENT, compared=largest
    ),
    "flutter.amplitude": Range(
        1e-15, lambda s, _: s.size, "m", MILLIMETRES, by="the extent of the model"
    ),
    "nonlinear_mode.amplitude": Range(
        1e-15, lambda s, _: s.size, "m", MILLIMETRES, by="the extent of the model"
    ),
    "speed": Range(0.1, 1.2e4, "rad/s", RPM),
    "elastic": (Range(1e8, 2e12, "Pa", below="possibly given in MPa or GPa"), Range(0.0, 0.5)),
    "robust_optimum.percentile": Range(
        50.0, 100.0, "%", below="possibly a fraction; write 95 for 95 %"
    ),
    # conditions as functions of rotor speed
    "friction": Range(0.05, 1.5, above=PER_CENT),
    "excitation": Range(1e-6, 1e6, "N", "possibly given in mN", "possibly given in MN"),
    # material
    "Material.endurance_limit": STRENGTH,
    "Material.ultimate_strength": STRENGTH,
    "Material.yield_strength": STRENGTH,
    "HaighTable.amplitude": STRENGTH,
    "HaighTable.mean": replace(STRENGTH, compared=largest),
    "HaighTable.probability": Range(
        0.05, 1.0, above=PER_CENT, below="possibly the probability of failure"
    ),
    "HaighTable.temperature": TEMPERATURE,
    "LeastMargin.temperature": TEMPERATURE,
    "margin.temperature": TEMPERATURE,
    "best_margin.temperature": TEMPERATURE,
    "Material.findley_k": Range(0.05, 1.0, above=PER_CENT),
    "ElasticMaterial.youngs_modulus": Range(1e8, 2e12, "Pa", below="possibly given in MPa or GPa"),
    "ElasticMaterial.density": Range(500.0, 3e4, "kg/m3", below="possibly given in g/cm3 or t/mm3"),
    # lumped masses
    "lumped.mass": Range(1e-9, 1e7, "kg", GRAMS, "possibly given in tonnes"),
    "lumped.damping": Range(1e-12, 1e10, "N s/m"),
    "lumped.stiffness": Range(1e-6, 1e13, "N/m", "possibly given in N/mm or GN/m"),
    "lumped.cubic": Range(1e-9, 1e20, "N/m3", compared=largest),
    "lumped.forces": Range(1e-9, 1e7, "N", "possibly given in mN", "possibly given in MN"),
    "lumped.base": Range(1e-9, 1e6, "m/s2", "possibly given in mm/s2"),
    "lumped.load_per_preload": Range(
        1e-3,
        100.0,
        "newtons per newton of preload",
        "possibly given in newtons; fractions are expected",
    ),
    "joint.damping_ratio": DAMPING,
    "joint.stiffness": STIFFNESS,
    "joint.friction": Range(1e-9, 1e8, "N", "possibly given in mN"),
    "joint.exponent": Range(0.0, 20.0),
    "joint.mass": Range(1e-9, 1e7, "kg", GRAMS, "possibly given in tonnes"),
    "Contact.kt": STIFFNESS,
    "Contact.kn": STIFFNESS,
    "Contact.mu": Range(1e-4, 5.0, above=PER_CENT),
    "Contact.preload": Range(1e-9, 1e7, "N", "possibly given in mN", "possibly given in MN"),
    "Contact.gap": Range(1e-12, 1e4, "m", MILLIMETRES),
    # contact laws and stiffness
    "ContactLaw.jenkins.stiffness": STIFFNESS,
    "ContactLaw.jenkins.limit": Range(1e-9, 1e8, "N", "possibly given in mN"),
    "ContactLaw.jenkins.mu": Range(1e-4, 1.5, above=PER_CENT),
    "ContactLaw.iwan.strength": Range(1e-9, 1e8, "N", "possibly given in mN"),
    "ContactLaw.iwan.stiffness": STIFFNESS,
    "ContactLaw.iwan.beta": Range(1e-6, 100.0),
    "ContactLaw.bouc_wen.stiffness": STIFFNESS,
    "ContactLaw.bouc_wen.n": Range(1.0, 20.0),
    "kn": STIFFNESS,
    "face_gap.crowning": Range(-2e-3, 2e-3, "m", MILLIMETRES, MILLIMETRES),
    "face_gap.axial_crowning": Range(-2e-3, 2e-3, "m", MILLIMETRES, MILLIMETRES),
    "influence_coefficients.given": Range(
        0.0, 0.3, "of critical damping", PER_CENT, compared=largest
    ),
    # options
    "ContinuationOptions.step": Range(1e-5, 1.0, below="possibly unscaled unknowns"),
    "ContinuationOptions.min_step": Range(1e-14, 0.1),
    "ContinuationOptions.max_step": Range(
        1e-4, 2.0, above="possibly given in Hz; a fraction of the vibration is expected"
    ),
    "ContinuationOptions.corner_step": Range(1e-6, 10.0),
    "PeakOptions.tolerance": Range(
        1e-15, 1e-3, above="possibly the accuracy of the result; a residual is expected"
    ),
    "PeakOptions.position_tolerance": Range(1e-15, 1e-2),
    "PeakOptions.max_step": Range(
        1e-4, 2.0, above="possibly given in Hz; a fraction of the vibration is expected"
    ),
    # mistuned bladed disks
    "BladedDisk.mistuning": DEVIATION,
    "Mistuning.deviation": DEVIATION,
    "standard_deviation": Range(1e-6, 0.2, "of the frequency", PER_CENT),
    "mistuned_sample.dampers": Names("DamperVariation.random"),
    "DamperVariation.mass": Range(
        0.2,
        5.0,
        "times the mass of the damper",
        "possibly given in grams",
        "possibly given in kilograms",
    ),
    "DamperVariation.friction_coefficient": Range(0.1, 10.0, "times that of the study", PER_CENT),
    "DamperVariation.contact_stiffness": Range(
        0.01, 100.0, "times that of the study", "possibly given in N/m"
    ),
    "DamperVariation.gap": Range(1e-12, 1e-3, "m", MILLIMETRES),
    "DamperVariation.random.mass": Range(1e-6, 0.5, "of the mean", PER_CENT),
    "DamperVariation.random.friction_coefficient": Range(1e-6, 1.0, "of the mean", PER_CENT),
    "DamperVariation.random.contact_stiffness": Range(1e-6, 2.0, "of the mean", PER_CENT),
    "DamperVariation.random.gap": Range(1e-12, 1e-3, "m", MILLIMETRES),
    # measurements
    "MeasuredResponse.force": Range(1e-6, 1e6, "N", "possibly given in mN", "possibly given in MN"),
    "MeasuredResponse.base_acceleration": ACCELERATION,
    "MeasuredResponse.preload": Range(
        1e-3, 1e8, "N", "possibly given in mN", "possibly given in MN"
    ),
    "fit.noise": Range(1e-6, 0.3, "of the amplitude", PER_CENT),
    "fit_loop.displacement": Range(1e-9, 1e-2, "m", MILLIMETRES, compared=largest),
    "fit_loop.force": Range(1e-3, 1e7, "N", compared=largest),
    "fit_loop.normal": Range(1e-2, 1e7, "N", "possibly given in mN", "possibly given in kN"),
    # import
    "Units.length": Range(
        1e-6, 1.0, "m", "possibly the inverse; the factor is 1e-3 for millimetres"
    ),
    "Units.mass": Range(1e-9, 1e4, "kg", "possibly the inverse; the factor is 1e-3 for grams"),
    "Reduction.damping_ratio": DAMPING,
    "Reduction.n_modes": Range(
        3, 1000, below="too few: modes above the resonance and their flexibility are missing"
    ),
    "Sector.elasticity": (
        Range(1e3, 2e12, "Pa or N/mm2", below="possibly given in GPa"),
        Range(0.0, 0.5),
    ),
}
DIMENSIONS = """
    bore_radius rim_radius axial_length shank_width face_length face_width ridge_radius ridge_width
    damper_body_height platform_clearance platform_edge_thickness airfoil_height root_chord
    tip_chord root_thickness tip_thickness camber end_gap
"""
TABLE |= {f"Geometry.{name}": Range(1e-6, 5.0, "m", MILLIMETRES) for name in DIMENSIONS.split()}
TABLE |= WITHOUT_RANGE


def entry(owner: str, name: str) -> Range | Names | tuple[Range, ...] | str | None:
    """Return the entry of a parameter of a function, method or class; None if there is none."""
    class_name = owner.partition(".")[0]
    for key in (f"{owner}.{name}", f"{class_name}.{name}", name):
        if key in TABLE:
            return TABLE[key]
    return None


def check(
    owner: str,
    name: str,
    value: object,
    sizes: Rotating | None = None,
    item: str = "",
    function: str | None = None,
) -> None:
    """Warn about an implausible value.

    Parameters
    ----------
    owner, name : str
        Function or class, and its parameter.  A dot in the name separates the part of the model.
    value : Any
        Number, or numbers in sequences or mappings; other values are ignored.
    sizes : Sizes, optional
        Sizes of the model.
    item : str
        Name in the warning; the parameter by default.
    function : str, optional
        Function that receives the values of a mapping in place of a study.  Ranges of its
        parameters apply; a function of the user has none, and an empty name.
    """
    parameter, _, part = name.partition(".")
    known = entry(owner, name)
    if known is None and part:
        known = entry(owner, parameter)
        item = item or f"{parameter} of {part!r}"
    item = item or name
    if isinstance(known, Names) and isinstance(value, Mapping):
        _check_settings(owner, name, known, value, sizes, function)
    if isinstance(known, Range):
        for key, numbers in _numbers(value):
            known.check(_item_of(item, key), numbers, sizes, part or key)
    elif isinstance(known, tuple):
        # a range for each place, for example of a lowest and a highest value
        for key, numbers in _numbers(value):
            for limits, number in zip(known, numbers):
                limits.check(_item_of(item, key), np.array([number]), sizes, part or key)
    if sizes is not None and (known is PRELOAD or known == UNEXCITED):
        for _, numbers in _numbers(value):
            sizes.check_preload(numbers)


def _check_settings(
    owner: str,
    name: str,
    names: Names,
    settings: Mapping[Any, Any],
    sizes: Rotating | None,
    function: str | None,
) -> None:
    """Check a mapping of settings, or of settings for each of several studies.

    The settings are parameters of ``names.of``, or of ``function`` if it is given.
    """
    for key, value in settings.items():
        # the settings of one of the studies
        if isinstance(value, Mapping):
            check(owner, name, value, sizes, function=function)
        elif function is None:
            check(names.of, str(key), _leading(value, names.leading), sizes)
        elif f"{function}.{key}" in TABLE:
            check(function, str(key), _leading(value, names.leading), sizes)


def _item_of(item: str, key: object) -> str:
    """Return the name of a value in a mapping, for example "gap of 'left'" or "friction at 300"."""
    if key is None:
        return item
    return f"{item} at {key:g}" if isinstance(key, int | float) else f"{item} of {key!r}"


def _leading(values: object, count: int | None) -> object:
    """Return the first ``count`` values of a sequence, or all values if ``count`` is None."""
    is_sequence = isinstance(values, Sequence | np.ndarray)
    return values[:count] if is_sequence else values  # type: ignore[index]


def _numbers(value: object, key: object = None) -> Iterator[tuple[object, NDArray]]:
    """Yield the numbers in a value as pairs of key and array (n,).

    The key belongs to the innermost mapping; without a mapping it is ``key``.  Complex numbers are
    replaced by their magnitudes.  Texts, and arrays with infinite or unknown numbers, are skipped.
    """
    if isinstance(value, Mapping):
        for name, inner in value.items():
            yield from _numbers(inner, name)
        return
    try:
        array = np.asarray(value)
    except ValueError:
        return
    if array.dtype.kind not in "fiuc" or not array.size or not np.isfinite(array).all():
        return
    # off its diagonal, a matrix may have small or negative entries
    if array.ndim == 2 and array.shape[0] == array.shape[1] > 1:
        array = np.diagonal(array)
    if array.dtype.kind == "c":
        array = np.abs(array)
    yield key, array.astype(float).ravel()
