"""Warnings of implausible settings (:mod:`bdamper.util.plausible_ranges`), and of intervals given in radians per second."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.stiffness import PerArea
from bdamper.harmonic_balance.problem import LoadCase, Problem
from bdamper.harmonic_balance.sector import Sector
from bdamper.util import plausible_ranges, validation
from bdamper.util.errors import warn_implausible
from bdamper.util.progress import one_thread

ALONG = 0.12
"""Smallest plausible cosine between force and modal motion at the excitation location (83 degrees)."""


def check_settings(problem: Problem) -> None:
    """Warn if settings of a problem are outside their plausible ranges, or have no effect."""
    sizes = problem.sizes
    for owner, name, value, item in _given(problem):
        plausible_ranges.check(owner, name, value, sizes, item)
    settings = problem.settings
    user_laws, faces = settings.own_laws(), settings.friction_faces
    default = next(f.default for f in fields(settings) if f.name == "friction_coefficient")
    unused = faces and len(user_laws) == len(faces) and not sizes.lumped
    if unused and settings.friction_coefficient is not default and settings.friction_coefficient != default:
        found = "one that no interface uses: parameters of the law suspected"
        warn_implausible("friction_coefficient", "none, since every friction interface has a ContactLaw", found)
    flow, n = settings.aerodynamic_damping, max(problem.model.n_blades, 1)
    used = sorted({problem.engine_order * harmonic % n for harmonic in settings.harmonic_numbers})
    if isinstance(flow, Mapping) and not set(flow) & set(used):
        warn_implausible(
            "aerodynamic_damping", f"at one of the nodal diameters {used} of the study", f"at {sorted(flow)} alone"
        )


def _given(problem: Problem) -> Iterator[tuple[str, str, Any, str]]:
    """Yield for each setting: owner and name in the table of ranges, value, and name in a warning."""
    settings, sizes = problem.settings, problem.sizes
    of_modes = [b.damping_ratio.max(initial=0.0) for b in problem.modal_bases]
    effective = {
        "friction_coefficient": settings.friction_values(),
        "damping_ratio": max(of_modes, default=0.0) if settings.damping_ratio is None else settings.damping_ratio,
        "gap": {name: problem.point_gaps[problem.coupling.rows(name)] for name in problem.coupling.interfaces},
        "contact_stiffness": None,
    }
    for field in fields(settings):
        yield "Study", field.name, effective.get(field.name, getattr(settings, field.name)), ""
    for force in (settings.excitation, *settings.excitation.beside):
        place = settings.model.locations.get(force.location)
        if place is not None and place.kind is None:
            yield "Excitation", "amplitude", {force.location: force.amplitude}, "excitation amplitude"
    for body in problem.model.bodies.values():
        if body.kind == "free" and body.ports and sizes.volume(body.name) > 0.0:
            yield "Body", f"mass.{body.name}", body.mass or 0.0, ""
    given = settings.contact_stiffness
    rows = problem.friction_points
    if given == "model" or not (given is None or isinstance(given, str) or hasattr(given, "n_vectors")):
        stiffness = problem.point_stiffness[rows]
        item = f"contact_stiffness of {type(given).__name__}" if isinstance(given, PerArea) else ""
        if stiffness.any() and np.isfinite(sizes.body_stiffness):
            yield "Study", "contact_stiffness", float(stiffness.mean()), item


@one_thread
def check_question(problem: Problem, preload: Sequence[float] | NDArray, frequency: tuple[float, float] | None) -> None:
    """Check a frequency interval (Hz) and warn if it is implausible at the largest of the preloads (N).

    Public functions call it once for the whole range of preloads.
    """
    pressed = problem.settings.constant_loads or (problem.point_gaps < 0.0).any()
    if problem.carries_load and not np.any(preload) and not pressed:
        warn_implausible("preload", "above 0 N", "0: no contact has a normal force, as in study.free")
    if frequency is not None:
        frequency = validation.interval("frequency", frequency)
        check_interval(problem.at(float(np.max(preload)) if problem.carries_load else 0.0), frequency)


def check_unloaded(problem: Problem) -> None:
    """Warn if every body whose preload is varied also has a constant load: the optimum then excludes the constant load."""
    settings = problem.settings
    varied = {name for name, share in settings.given_loads("load_per_preload").items() if share}
    held = {name: load for name, load in settings.given_loads("constant_loads").items() if name in varied and np.any(load)}
    if varied and set(held) == varied:
        found = f"{', '.join(f'{float(np.sum(load)):g} N on {name!r}' for name, load in held.items())}, in addition to it"
        warn_implausible("constant_loads", "none on a body whose preload is varied", found)


def check_interval(case: LoadCase, frequency: tuple[float, float]) -> None:
    """Warn if an interval (Hz) contains the free and the stuck resonance of a mode only when read as radians per second.

    An interval that contains resonances as given is accepted, unless the response there is far weaker.
    """
    if not case.static.converged:
        return
    sector, springs = case.sector, (None, case.stuck_springs())
    low, high = frequency
    _check_direction(case.problem, sector, frequency)
    resonances = [(w, k) for k in springs for w in sector.linear.modes(k)[0] if w > 0.0]
    mistaken = [(w, k) for w, k in resonances if low < w < high]
    if len({id(k) for _, k in mistaken}) < 2 and any(low < w / (2.0 * np.pi) < high for w, _ in resonances):
        return

    def strongest(resonances: list[tuple[float, NDArray | None]]) -> float:
        rows = sector.response_rows[1]
        return max((abs(sector.linear.response(w, k) @ rows) for w, k in resonances), default=0.0)

    given = strongest([(w, k) for w, k in resonances if low < w / (2.0 * np.pi) < high])
    # ratio of responses (read as rad/s over as given) above which rad/s is suspected; at least 333 for first modes of
    # blades under a tangential force at the tip
    weaker = 20.0
    if mistaken and strongest(mistaken) > weaker * given:
        near = ", ".join(f"{f:.4g}" for f in sorted({w / (2.0 * np.pi) for w, _ in mistaken})[:3])
        weak = f"with a response {strongest(mistaken) / given:.2g} times weaker" if given else "without a resonance"
        warn_implausible(
            "frequency",
            f"an interval in Hz around resonances of the model, such as {near} Hz",
            f"({low:g}, {high:g}) {weak}; divided by 2 pi it contains them: radians per second suspected",
        )
        return
    far = 2.0  # ratio of a frequency, or of an active harmonic of it, to the nearest resonance; nonlinear ones lie nearer
    times = case.problem.settings.harmonic_numbers[-1]
    cubic = any(face.kind == "cubic" for face in case.problem.model.interfaces.values())
    hertz = sorted({w / (2.0 * np.pi) for w, _ in resonances})
    if hertz and not cubic and not any(low / far < f < far * times * high for f in hertz):
        nearest = min(hertz, key=lambda f: abs(np.log(f / high)))
        warn_implausible(
            "frequency",
            f"an interval in Hz around a resonance, such as {nearest:.4g} Hz",
            f"({low:g}, {high:g}), far from every resonance: kHz or a mistaken digit suspected",
        )


def _check_direction(problem: Problem, sector: Sector, frequency: tuple[float, float]) -> None:
    """Warn of a force perpendicular to the motion of all modes without contact in an interval (Hz)."""
    omega, modes = sector.linear.modes(None)
    hertz, at = omega / (2.0 * np.pi), problem.settings.excitation
    within = (frequency[0] < hertz) & (hertz < frequency[1])
    motion = np.linalg.norm(problem.location_modes(at.location, 1) @ modes[:, within], axis=0)
    along = np.abs(problem.modal_force(1).conj() @ modes[:, within]) / at.amplitude
    if within.any() and (along <= ALONG * motion).all():
        share = np.max(along / np.where(motion > 0.0, motion, 1.0))
        modes_at = ", ".join(f"{f:.4g}" for f in hertz[within][:3])
        warn_implausible(
            "excitation direction",
            f"along the motion of a mode in the interval ({modes_at} Hz)",
            f"{at.direction} at '{at.location}', along which these have {100.0 * share:.2g} % of their motion there",
        )
