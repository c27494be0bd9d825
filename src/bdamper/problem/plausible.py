"""Values that are possible but that nothing built has: one warning each, with the plausible range and what was found."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.stiffness import PerArea
from bdamper.harmonic_balance.system import Sector
from bdamper.model.model import Model
from bdamper.problem.problem import Problem, stuck_springs
from bdamper.util import validate
from bdamper.util.blas import one_thread
from bdamper.util.errors import ModelError
from bdamper.util.warn import implausible

DAMPING = 0.1
"""Largest damping ratio of a mode: metals have 1e-4 to 1e-3, joints and the air add up to some 0.02."""
ALONG = 0.12
"""Part of a mode's motion at the place of the excitation that should lie along the force: 83 degrees between them."""


def check_settings(problem: Problem) -> None:
    """Warn of implausible settings of a problem."""
    friction = (0.05, 1.5)  # friction coefficient, if there is friction: lubricated steel to clean metals at rest
    for mu in problem.settings.friction_values():
        if not friction[0] <= mu <= friction[1]:
            implausible("friction_coefficient", f"{friction[0]:g} to {friction[1]:g}, or 0", f"{mu:g}")
    if problem.engine_order == 0 and problem.model.n_blades > 1:
        implausible("engine_order", "1 or more", "0, a force that does not vary as the wheel turns and excites nothing")
    of_modes = [b.damping_ratio.max(initial=0.0) for b in problem.modal_bases]
    damping = max(of_modes, default=0.0) if problem.settings.damping_ratio is None else problem.settings.damping_ratio
    if damping > DAMPING:
        implausible("damping_ratio", f"at most {DAMPING:g} of critical damping", f"{damping:g}")
    _check_masses(problem.model)
    given = problem.settings.contact_stiffness
    if given == "model" or not (given is None or isinstance(given, str) or hasattr(given, "patterns")):
        _check_stiffness(problem, "of " + type(given).__name__ if isinstance(given, PerArea) else "")


def _check_masses(model: Model) -> None:
    """Warn if the mass of a damper is implausible for its size."""
    # mass of a free body over the volume of a box around its contact points, kg/m3: steel wedges have 7,600 to 8,900. A
    # thousand times as much is a mass in grams
    density = (50.0, 1e5)
    for body in (b for b in model.bodies.values() if b.kind == "free" and b.ports):
        size = np.ptp(np.concatenate([model.interfaces[name].points for name, _ in body.ports]), axis=0)
        volume = float(np.prod(np.maximum(size, 0.1 * size.max())))
        if volume > 0.0 and not density[0] * volume <= (body.mass or 0.0) <= density[1] * volume:
            unit = "grams" if body.mass and body.mass > density[1] * volume else "tonnes"
            expected = f"{density[0] * volume:.2g} to {density[1] * volume:.2g} kg by the size of its faces"
            implausible(f"mass of '{body.name}'", expected, f"{body.mass:.4g} kg: {unit} suspected")


def _check_stiffness(problem: Problem, kind: str) -> None:
    """Compare the stiffness of the user, summed over the friction faces, with that of the bodies at their points."""
    try:
        flexibility = problem.coupling.residual_flexibility(1).diagonal().real.reshape(-1, 3)
    except ModelError:  # the model has none to compare with
        return
    rows = problem.friction_points
    if not rows.any() or not flexibility[rows].min() > 0.0:
        return
    own, given = float(np.sum(1.0 / flexibility[rows])), float(problem.point_stiffness[rows].sum())
    # contact stiffness over that of the bodies at the contact points. By the methods of the package 0.4 to 3 on the
    # shipped models; 1e4 N/m gives 2e-5, 1e12 N/m gives 2e3
    stiffness = (0.01, 100.0)
    if given > 0.0 and not stiffness[0] <= given / own <= stiffness[1]:
        n = 3 * int(rows.sum())
        implausible(
            f"contact_stiffness {kind}".strip(),
            f"{stiffness[0] * own / n:.2g} to {stiffness[1] * own / n:.2g} N/m at a point, {stiffness[0]:g} to "
            f"{stiffness[1]:g} times that of the bodies there",
            f"{given / n:.2g} N/m in the mean",
        )


@one_thread
def check_question(
    problem: Problem, preload: Sequence[float] | NDArray, frequency: tuple[float, float] | None = None
) -> None:
    """Warn of preloads (N), valid ones, and of an interval (Hz, optional), not checked yet, as a user asks for them.

    Functions that users call do this once, for the whole range; those that others call a thousand times, in threads and
    processes, do not.
    """
    if frequency is not None:
        frequency = validate.interval("frequency", frequency)
    if problem.carries_load:
        check_load(problem, float(np.min(preload)), float(np.max(preload)))
    if frequency is not None:
        check_interval(problem, frequency, float(np.max(preload)) if problem.carries_load else 0.0)


def check_load(problem: Problem, low: float, high: float) -> None:
    """Warn of an excitation that is extreme for preloads from ``low`` to ``high`` (N)."""
    amplitude = problem.settings.excitation.amplitude if problem.settings.acts_at_location else 0.0
    # amplitude of the excitation over the preload: below, nothing slips; above, the damper does not stay in its seat
    excitation = (1e-6, 1.0)
    if amplitude > 0.0 and high > 0.0 and (amplitude > excitation[1] * high or amplitude < excitation[0] * low):
        found = f"{low:g} N" if low == high else f"{low:g} to {high:g} N"
        least, most = 1.0 / excitation[1], 1.0 / excitation[0]
        implausible("preload", f"{least:g} to {most:g} times the excitation amplitude of {amplitude:g} N", found)


def check_interval(problem: Problem, frequency: tuple[float, float], preload: float) -> None:
    """Warn of an interval (Hz) that holds the free and the stuck resonance of a mode if it is taken for radians per second.

    An interval that holds resonances as it is given is taken so, unless the structure answers them far less.
    """
    state = problem.static(preload)
    if not state.converged:
        return
    sector, springs = problem.sector(preload), (None, stuck_springs(problem, state))
    low, high = frequency
    _check_direction(problem, sector, frequency)
    found = [(w, k) for k in springs for w in sector.linear.modes(k)[0] if w > 0.0]
    mistaken = [(w, k) for w, k in found if low < w < high]
    if len({id(k) for _, k in mistaken}) < 2 and any(low < w / (2.0 * np.pi) < high for w, _ in found):
        return

    def answer(resonances: list[tuple[float, NDArray | None]]) -> float:
        rows = sector.response_rows[1]
        return max((abs(sector.linear.response(w, k) @ rows) for w, k in resonances), default=0.0)

    given = answer([(w, k) for w, k in found if low < w / (2.0 * np.pi) < high])
    # how many times more than in an interval in Hz the structure must answer where it is taken for rad/s, for that to
    # be meant; 333 and more for first modes of blades under a tangential force at the tip
    weaker = 20.0
    if mistaken and answer(mistaken) > weaker * given:
        near = ", ".join(f"{f:.4g}" for f in sorted({w / (2.0 * np.pi) for w, _ in mistaken})[:3])
        weak = f"where it answers {answer(mistaken) / given:.2g} times less" if given else "without one"
        implausible(
            "frequency",
            f"an interval in Hz around resonances of the model, such as {near} Hz",
            f"({low:g}, {high:g}) {weak}, 2 pi times an interval that has them: radians per second suspected",
        )


def _check_direction(problem: Problem, sector: Sector, frequency: tuple[float, float]) -> None:
    """Warn of a force across the motion that all modes without contact in an interval (Hz) have at its place."""
    omega, modes = sector.linear.modes(None)
    hertz, at = omega / (2.0 * np.pi), problem.settings.excitation
    within = (frequency[0] < hertz) & (hertz < frequency[1])
    motion = np.linalg.norm(problem.location_modes(at.location, 1) @ modes[:, within], axis=0)
    along = np.abs(problem.modal_force(1).conj() @ modes[:, within]) / at.amplitude
    if within.any() and (along <= ALONG * motion).all():
        share = np.max(along / np.where(motion > 0.0, motion, 1.0))
        modes_at = ", ".join(f"{f:.4g}" for f in hertz[within][:3])
        implausible(
            "excitation direction",
            f"along the motion of a mode in the interval ({modes_at} Hz)",
            f"{at.direction} at '{at.location}', along which these have {100.0 * share:.2g} % of their motion there",
        )
