"""Plausible ranges of all numbers that a user gives, in SI units: one table.

A value outside of its range is possible, so it is used, with a warning that names the value, the range and the likely
mistake.  A key of the table is the name of a parameter, after the name of its function or class if the range applies there
alone.  A bound can be a function of the sizes of the model (:class:`bdamper.problem.sizes.Sizes`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bdamper.util.warn import implausible

Bound = float | Callable[[Any, Any], float]
"""A number, or a function of the sizes of a model and of the key under which a mapping has the value."""


def each(values: NDArray) -> tuple[float, float]:
    """Return the least and the largest value except 0, which switches a setting off."""
    values = values[values != 0.0]
    return (float(values.min()), float(values.max())) if len(values) else (np.inf, -np.inf)


def some(values: NDArray) -> tuple[float, float]:
    """Return the largest and the least value: a sweep is plausible if one of its values is."""
    return float(values.max()) or np.inf, float(values.min())


def largest(values: NDArray) -> tuple[float, float]:
    """Return the largest size twice, for measured values that pass through 0."""
    size = float(np.abs(values).max())
    return size or np.inf, size


def all_of(values: NDArray) -> tuple[float, float]:
    """Return the least and the largest value."""
    return float(values.min()), float(values.max())


@dataclass(frozen=True)
class Range:
    """A plausible range.

    Parameters
    ----------
    low, high : number or function of sizes and key
    unit : str
    above, below : str
        Likely mistake if a value lies above or below.
    by : str
        Explanation of the bounds.
    compared : callable
        Value compared with ``low`` and value compared with ``high``, of an array.
    """

    low: Bound
    high: Bound
    unit: str = ""
    above: str = "a mistaken unit or digit suspected"
    below: str = "a mistaken unit or digit suspected"
    by: str = ""
    compared: Callable[[NDArray], tuple[float, float]] = each

    def check(self, item: str, values: NDArray, sizes: Any = None, key: Any = None) -> None:
        """Warn of values outside the range; bounds that need sizes are left out without these."""
        if sizes is None and (callable(self.low) or callable(self.high)):
            return
        low, high = (bound(sizes, key) if callable(bound) else bound for bound in (self.low, self.high))
        if low >= 0.0 and self.compared is not largest:
            values = values[values >= 0.0]  # the function itself refuses negative ones
        least, most = self.compared(values) if len(values) else (np.inf, -np.inf)
        if least >= low and most <= high:
            return
        found, mistake = (least, self.below) if least < low else (most, self.above)
        shown = [f"{x:.2g}" if callable(bound) else f"{x:g}" for x, bound in ((low, self.low), (high, self.high))]
        text = f"{shown[0]} to {shown[1]}" if low and np.isfinite([low, high]).all() else f"at most {shown[1]}"
        text = f"{shown[0]} or more" if np.isinf(high) else text
        text = f"{text} {self.unit}".rstrip() + (f", {self.by}" if self.by else "")
        several = self.compared is some and values.min() < values.max()
        shown_as = f"{values.min():g} to {values.max():g}" if several else f"{found:.4g}"
        implausible(item, text, f"{shown_as} {self.unit}".rstrip() + f": {mistake}")


@dataclass(frozen=True)
class Names:
    """Entry of a mapping whose keys are parameters of another function or class.

    Parameters
    ----------
    of : str
        Function or class with the ranges.
    """

    of: str


GRAMS = "grams suspected"
PER_CENT, MILLIMETRES = "per cent suspected", "millimetres or micrometres suspected"
RPM = "revolutions per minute suspected"

# no range: why
COUNT = "a count, which costs time or is limited by the model"
LIMITED = "the limits beyond which it is refused are plausible ones"
FACT = "not a magnitude: a number, direction or place of the user's choice"
EFFECT = "judged by its effect, which has an entry of its own"
UNEXCITED = "any load: the excitation, with which preloads are compared, takes no part or is looked at before"
MEASURED = "measured data, compared with the model or with themselves"

DAMPING = Range(0.0, 0.1, "of critical damping", PER_CENT)
STIFFNESS = Range(1e-3, 1e13, "N/m", "N/mm or GN/m suspected")
PRELOAD = Range(
    lambda s, _: s.amplitude, lambda s, _: 1e6 * s.amplitude or np.inf, "N", "mN suspected, or nothing that slips",
    "kN suspected, or a damper that does not stay in its seat", "1 to 1e+06 times the excitation amplitude", some,
)  # fmt: skip
DEVIATION = Range(-0.5, 0.5, "of the frequency", "per cent or Hz suspected", "per cent or Hz suspected")
FACTOR = "a value with a unit suspected, where a factor is expected"

TABLE: dict[str, Range | Names | tuple[Range, ...] | str] = {
    # settings of a study
    "Study.engine_order": Range(
        lambda s, _: s.least_order, 1000.0, below="a force that does not vary as the wheel turns and excites nothing",
        above="rad/s or Hz suspected", compared=all_of,
    ),
    "Study.friction_coefficient": Range(
        0.05, 1.5, above=PER_CENT, by="or 0",
        below="a mistaken digit suspected; lubricated steel has 0.05, clean metals up to 1.5",
    ),
    "Study.harmonics": COUNT,
    "Study.contact_stiffness": Range(
        lambda s, _: 0.01 * s.body_stiffness, lambda s, _: 100.0 * s.body_stiffness, "N/m",
        "a stiffness per area or of the whole face suspected", "N/mm or a stiffness per area suspected",
        "at a point in the mean, 0.01 to 100 times that of the bodies there",
    ),
    "Study.contact_stiffness_factor": Range(1e-3, 1e3, above=FACTOR, below=FACTOR),
    "Study.blade_modes": COUNT,
    "Study.damper_modes": COUNT,
    "Study.contact_points": COUNT,
    "Study.damping_ratio": DAMPING,
    "Study.damper_damping_ratio": Range(0.0, 0.5, "of critical damping", PER_CENT),
    "Study.damper_drag": Range(
        0.0, lambda s, body: s.critical_drag(body), "N s/m", "kg/s per area or a stiffness suspected",
        by="critical damping of the body at the first natural frequency",
    ),
    "Study.gap": Range(
        lambda s, _: -2e-3 * s.size, lambda s, _: 0.02 * s.size, "m", MILLIMETRES, MILLIMETRES,
        "-0.2 % to 2 % of the extent of the model",
    ),
    "Study.loads": Range(1e-3, 100.0, "newtons per newton of preload", "newtons suspected, where shares are expected",
                         "a load in newtons divided by the preload twice suspected"),
    "Study.fixed_loads": Range(
        lambda s, name: -s.bearable(name), lambda s, name: s.bearable(name), "N", "a stiffness or kN suspected",
        "a distance suspected: a negative load of a point is a gap", "a pressure of 1 GPa on the faces",
    ),
    "Study.load_history": Range(1e-3, 10.0, above="newtons suspected, where factors on the preload are expected"),
    "Study.speed": EFFECT,
    "Study.slip_offset": Range(1e-12, lambda s, _: 1e-3 * s.size, "m", MILLIMETRES, by="0.1 % of the extent"),
    "Study.slip_offset_seed": FACT,
    "Study.aerodynamic_damping": Range(0.0, 0.1, "of critical damping", PER_CENT, compared=largest),
    "Excitation.amplitude": Range(
        1e-6, lambda s, where: s.deflecting(where), "N", "mN or N/m2 suspected", "kN or MN suspected",
        "up to the force that deflects the structure by 10 % of its extent",
    ),
    "Excitation.phase": LIMITED,
    "Excitation.engine_order": EFFECT,
    "Body.mass": Range(
        # per volume of the box around the contact points, 50 to 1e5 kg/m3: steel wedges have 7,600 to 8,900
        lambda s, name: 50.0 * s.volume(name), lambda s, name: 1e5 * s.volume(name), "kg", GRAMS, "tonnes suspected",
        "by the size of its faces",
    ),
    # settings that are varied by name
    "Study.damping_factor": Range(0.02, 50.0, above=FACTOR, below=FACTOR),
    "Study.damper_mass_factor": Range(0.02, 15.0, above=GRAMS, below="kilograms suspected"),
    "Study.damper_mass": Range(0.02, 15.0, above=GRAMS, below="kilograms suspected"),
    "Study.frequency_factor": Range(0.5, 2.0, above="Hz suspected, where a factor is expected", below=FACTOR),
    "Study.gap_factor": Range(1e-3, 1e3, above=FACTOR, below="metres suspected, where a factor is expected"),
    "Study.force_factor": Range(1e-2, 1e2, above="newtons suspected, where a factor is expected", below=FACTOR),
    "Study.excitation": FACT,
    "Study.excitation.amplitude": Range(1e-6, 1e6, "N", "mN suspected", "MN suspected"),
    "Study.excitation.phase": Range(-2.0 * np.pi, 2.0 * np.pi, "rad", "degrees suspected", "degrees suspected"),
    "sweep.over": Names("Study"),
    "uncertain_curve.samples": Names("Study"),
    "robust_optimum.samples": Names("Study"),
    "fit.vary": Names("Study"),
    "compare.studies": Names("Study"),
    "accuracy_cost.vary": COUNT,
    "draw.distributions": EFFECT,
    # questions
    "preload": PRELOAD,
    "preloads": PRELOAD,
    "nonlinear_mode.preload": UNEXCITED,
    "flutter.preload": UNEXCITED,
    "microslip.preload": UNEXCITED,
    "Study.static.preload": UNEXCITED,
    "Study.stuck.preload": UNEXCITED,
    "Study.wedge_friction.preload": UNEXCITED,
    "Wheel.state.preload": UNEXCITED,
    "Wheel.system.preload": UNEXCITED,
    "Wheel.tuned_peak.preload": UNEXCITED,
    "PeakTask.preload": EFFECT,
    "OptimalTask.preload": EFFECT,
    "frequency": EFFECT,
    "mode": COUNT,
    "n": COUNT,
    "seed": FACT,
    "index": COUNT,
    "direction": FACT,
    "tolerance": LIMITED,
    "harmonics": COUNT,
    "damper_modes": COUNT,
    "contact_points": COUNT,
    "blade_modes": COUNT,
    "steps_per_period": COUNT,
    "periods": COUNT,
    "speeds": EFFECT,
    "omega": EFFECT,
    "rpm": EFFECT,
    "engine_orders": LIMITED,
    "modes": COUNT,
    "Study.march.blades": COUNT,
    "Study.march.starts": COUNT,
    "Study.hysteresis.n_theta": COUNT,
    "Study.static.history": LIMITED,
    "Study.sweep_in_time.rate": EFFECT,
    "Study.stress_at.gauge": FACT,
    "Study.compare.other": FACT,
    "crossings.damper_mass": Range(
        0.05, 10.0, "times the mass of the damper", "grams suspected, where factors are expected",
        "kilograms suspected, where factors are expected",
    ),
    "flutter.aerodynamic_damping": Range(0.0, 0.1, "of critical damping", PER_CENT, compared=largest),
    "flutter.amplitude": Range(1e-15, lambda s, _: s.size, "m", MILLIMETRES, by="the extent of the model"),
    "nonlinear_mode.amplitude": Range(1e-15, lambda s, _: s.size, "m", MILLIMETRES, by="the extent of the model"),
    "speed": Range(0.1, 1.2e4, "rad/s", RPM),
    "elastic": (Range(1e8, 2e12, "Pa", below="MPa or GPa suspected"), Range(0.0, 0.5)),
    "microslip.forces": EFFECT,
    "robust_optimum.percentile": Range(50.0, 100.0, "%", below="a share suspected: 95 for 95 %"),
    # conditions over speed
    "friction": Range(0.05, 1.5, above=PER_CENT),
    "temperature": FACT,
    "excitation": Range(1e-6, 1e6, "N", "mN suspected", "MN suspected"),
    # material
    "Material.endurance_limit": Range(1e6, 1e10, "Pa", "where 1 MPa is 1e6 Pa", "where 1 MPa is 1e6 Pa"),
    "Material.ultimate_strength": Range(1e6, 1e10, "Pa", "where 1 MPa is 1e6 Pa", "where 1 MPa is 1e6 Pa"),
    "Material.yield_strength": Range(1e6, 1e10, "Pa", "where 1 MPa is 1e6 Pa", "where 1 MPa is 1e6 Pa"),
    "Material.findley_k": Range(0.05, 1.0, above=PER_CENT),
    # masses
    "lumped.mass": Range(1e-9, 1e7, "kg", GRAMS, "tonnes suspected"),
    "lumped.damping": Range(1e-12, 1e10, "N s/m"),
    "lumped.stiffness": Range(1e-6, 1e13, "N/m", "N/mm or GN/m suspected"),
    "lumped.cubic": Range(1e-9, 1e20, "N/m3", compared=largest),
    "lumped.forces": Range(1e-9, 1e7, "N", "mN suspected", "MN suspected"),
    "lumped.loads": Range(1e-3, 100.0, "newtons per newton of preload", "newtons suspected, where shares are expected"),
    "lumped.locations": FACT,
    "lumped.response": FACT,
    "Contact.tangential": FACT,
    "Contact.tangential2": FACT,
    "Contact.normal": FACT,
    "Contact.kt": STIFFNESS,
    "Contact.kn": STIFFNESS,
    "Contact.mu": EFFECT,
    "Contact.preload": Range(1e-9, 1e7, "N", "mN suspected", "MN suspected"),
    "Contact.gap": Range(1e-12, 100.0, "m", MILLIMETRES),
    # contact laws and stiffness
    "ContactLaw.jenkins.stiffness": STIFFNESS,
    "ContactLaw.jenkins.limit": Range(1e-9, 1e8, "N", "mN suspected"),
    "ContactLaw.jenkins.mu": Range(1e-4, 1.5, above=PER_CENT),
    "ContactLaw.iwan.strength": Range(1e-9, 1e8, "N", "mN suspected"),
    "ContactLaw.iwan.stiffness": STIFFNESS,
    "ContactLaw.iwan.chi": LIMITED,
    "ContactLaw.iwan.beta": Range(1e-6, 100.0),
    "ContactLaw.bouc_wen.stiffness": STIFFNESS,
    "ContactLaw.bouc_wen.alpha": LIMITED,
    "ContactLaw.bouc_wen.beta": FACT,
    "ContactLaw.bouc_wen.gamma": LIMITED,
    "ContactLaw.bouc_wen.n": Range(1.0, 20.0),
    "ContactLaw.of_record.record": FACT,
    "kn": STIFFNESS,
    "PerArea.stiffness": EFFECT,
    "ResidualModes.patterns": COUNT,
    "ResidualModes.share": LIMITED,
    "Sampled.n_time": COUNT,
    "misfit.angle": LIMITED,
    "misfit.axial_angle": LIMITED,
    "misfit.crowning": Range(-2e-3, 2e-3, "m", MILLIMETRES, MILLIMETRES),
    "misfit.axial_crowning": Range(-2e-3, 2e-3, "m", MILLIMETRES, MILLIMETRES),
    "influence_coefficients.given": Range(0.0, 0.3, "of critical damping", PER_CENT, compared=largest),
    # options
    "ContinuationOptions.step": Range(1e-5, 1.0, below="unscaled unknowns suspected"),
    "ContinuationOptions.min_step": Range(1e-14, 0.1),
    "ContinuationOptions.max_step": Range(1e-4, 2.0, above="Hz suspected, where a share of the vibration is expected"),
    "ContinuationOptions.max_turn": LIMITED,
    "ContinuationOptions.max_points": COUNT,
    "ContinuationOptions.patience": COUNT,
    "ContinuationOptions.budget": COUNT,
    "ContinuationOptions.max_iterations": COUNT,
    "ContinuationOptions.locate_tolerance": LIMITED,
    "ContinuationOptions.corner_step": Range(1e-6, 10.0),
    "PeakOptions.tolerance": Range(1e-15, 1e-3, above="the accuracy of the result suspected, where a residual is expected"),
    "PeakOptions.position_tolerance": Range(1e-15, 1e-2),
    "PeakOptions.max_step": Range(1e-4, 2.0, above="Hz suspected, where a share of the vibration is expected"),
    "PeakOptions.max_iterations": COUNT,
    "PeakOptions.max_trials": COUNT,
    "WheelPeakOptions.spacing": LIMITED,
    "WheelPeakOptions.climbs": COUNT,
    "WheelPeakOptions.least": COUNT,
    "WheelPeakOptions.most": COUNT,
    # wheels
    "n_blades": COUNT,
    "n_modes": COUNT,
    "reference": MEASURED,
    "missing": FACT,
    "wheels": COUNT,
    "Wheel.mistuning": DEVIATION,
    "Mistuning.deviation": DEVIATION,
    "Mistuning.seed": FACT,
    "Mistuning.of.given": EFFECT,
    "standard_deviation": Range(1e-6, 0.2, "of the frequency", PER_CENT),
    "mistuned_sample.dampers": Names("DamperVariation.drawn"),
    "mistuned_sample.audit": LIMITED,
    "DamperVariation.mass": Range(0.2, 5.0, "times the mass of the damper", "grams suspected", "kilograms suspected"),
    "DamperVariation.friction_coefficient": Range(0.1, 10.0, "times that of the study", PER_CENT),
    "DamperVariation.contact_stiffness": Range(0.01, 100.0, "times that of the study", "N/m suspected"),
    "DamperVariation.gap": Range(1e-12, 1e-3, "m", MILLIMETRES),
    "DamperVariation.drawn.mass": Range(1e-6, 0.5, above=PER_CENT),
    "DamperVariation.drawn.friction_coefficient": Range(1e-6, 1.0, above=PER_CENT),
    "DamperVariation.drawn.contact_stiffness": Range(1e-6, 2.0, above=PER_CENT),
    "DamperVariation.drawn.gap": Range(1e-12, 1e-3, "m", MILLIMETRES),
    # measurements
    "Test.force": Range(1e-6, 1e6, "N", "mN suspected", "MN suspected"),
    "Test.preload": Range(1e-3, 1e8, "N", "mN suspected", "MN suspected"),
    "fit.noise": Range(1e-6, 0.3, "of the amplitude", PER_CENT),
    "fit_loop.displacement": Range(1e-9, 1e-2, "m", MILLIMETRES, compared=largest),
    "fit_loop.force": Range(1e-3, 1e7, "N", compared=largest),
    "fit_loop.normal": Range(1e-2, 1e7, "N", "mN suspected", "kN suspected"),
    "fit_loop.sliders": COUNT,
    # import
    "Units.length": Range(1e-6, 1.0, "m", "millimetres in a metre suspected: the factor is 1e-3 for millimetres"),
    "Units.mass": Range(1e-9, 1e4, "kg", "grams in a kilogram suspected"),
    "build_model.engine_order": COUNT,
    "build_model.nodal_diameters": COUNT,
    "build_model.n_damper_modes": COUNT,
    "build_model.damping_ratio": DAMPING,
    "build_model.axis": FACT,
    "build_model.radial": FACT,
    "build_model.origin": EFFECT,
    "build_model.expected_frequencies": MEASURED,
    "build_model.elasticity": (Range(1e3, 2e12, "Pa or N/mm2", below="GPa suspected"), Range(0.0, 0.5)),
    "build_model.sector_faces": FACT,
    "build_model.fixed": FACT,
    "build_model.wheel": FACT,
    "build_model.stress": FACT,
    "ContactFaces.faces_a": FACT,
    "ContactFaces.faces_b": FACT,
    "ContactFaces.points": COUNT,
    "ContactFaces.sector_b": LIMITED,
    "ContactFaces.gap": EFFECT,
    "ContactFaces.stiffness": EFFECT,
    "Patches.centre": EFFECT,
    "Patches.frame": FACT,
    "Patches.size": EFFECT,
    "LocalSizes.cantilever": COUNT,
    "LocalSizes.attachment": COUNT,
    "LocalSizes.interface": COUNT,
}  # fmt: skip


def entry(owner: str, name: str) -> Range | Names | tuple[Range, ...] | str | None:
    """Return the entry of a parameter of a function, a method or a class; None if there is none."""
    keys = f"{owner}.{name}", f"{owner.partition('.')[0]}.{name}", name
    return next((TABLE[key] for key in keys if key in TABLE), None)


def check(owner: str, name: str, value: Any, sizes: Any = None, item: str = "") -> None:
    """Warn of a value that is implausible.

    Parameters
    ----------
    owner, name : str
        Function or class, and its parameter.  A dot in the name starts the part of the model that it belongs to.
    value : Any
        Numbers, alone, in sequences or in mappings; other values are not looked at.
    sizes : Sizes, optional
        Sizes of the model.
    item : str
        Name in the warning; the parameter by default.
    """
    head, _, part = name.partition(".")
    known = entry(owner, name)
    if known is None and part:
        known, item = entry(owner, head), item or f"{head} of {part!r}"
    item = item or name
    if isinstance(known, Names) and isinstance(value, Mapping):
        for key, inner in value.items():
            if isinstance(inner, Mapping):  # settings of each of several studies
                check(owner, name, inner, sizes)
            else:
                check(known.of, str(key), inner, sizes)
    ranges = (known,) if isinstance(known, Range) else known if isinstance(known, tuple) else ()
    for key, values in _numbers(value) if ranges else ():
        for own, numbers in zip(ranges, values[:, None] if len(ranges) > 1 else [values]):
            own.check(item if key is None else f"{item} of {key!r}", numbers, sizes, part or key)


def _numbers(value: Any, key: Any = None) -> Iterator[tuple[Any, NDArray]]:
    """Yield arrays of the numbers in a value, with their keys in mappings; complex ones by their size."""
    if isinstance(value, Mapping):
        for own, inner in value.items():
            yield from _numbers(inner, own)
        return
    try:
        array = np.asarray(value)
    except ValueError:
        return
    if array.dtype.kind not in "fiuc" or not array.size or not np.isfinite(array).all():
        return
    if array.ndim == 2 and array.shape[0] == array.shape[1] > 1:  # a matrix: its diagonal has the sizes
        array = np.diagonal(array)
    array = np.abs(array) if array.dtype.kind == "c" else array
    yield key, array.astype(float).ravel()
