"""The first point of a curve: a solution at one frequency, from nothing but the static state.

The chain is, in this order,

1. the static state under the preload (:mod:`bdamper.contact.static`),
2. the stuck linear response on top of it, then plain Newton,
3. Newton with line search (and least norm where the Jacobian is rank-deficient), from guesses, if there are any, from
   there and from the free response; then, in gaps, the harmonics that a guess lacks are let in at once;
4. homotopy: continuation in the level of the excitation from the static state on, around folds,
5. another homotopy: free bodies are held by springs and dampers, which fade (all bodies, if none is free);
6. where paths of that are too long, longer ones; then the highest harmonic is let in from solutions without it
   (:mod:`bdamper.continuation.climb`), if there are any; then one harmonic after the other; each as far as :class:`Aids`
   allow it;

what was tried is kept in the result.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bdamper.balance.system import OK, STATUS_TEXT, HarmonicSystem
from bdamper.contact.static import PreloadState
from bdamper.continuation.climb import HELD, Ladder
from bdamper.continuation.follower import ContinuationOptions, Path, follow
from bdamper.util.cost import CostMeter

RAMP_POINTS = 2000
"""Points of a path on which the excitation is raised, or bodies are let go."""
FEW_POINTS = 300
"""Points that each way of letting go gets before any of them gets all."""
Support = tuple[float, float, bool]
SUPPORTS: tuple[Support, ...] = (
    (10.0, 0.1, False),
    (1.0, 0.1, False),
    (10.0, 1.0, True),
    (10.0, 0.01, True),
    (1.0, 1.0, False),
    (1.0, 0.01, True),
    (0.1, 1.0, False),
    (0.1, 10.0, True),
    (1.0, 10.0, True),
    (0.1, 1.0, True),
)
"""By which free bodies are held: drag, spring, and whether the excitation is raised meanwhile."""
PROMISING = ((10.0, 0.1, False), (1.0, 0.1, False), (10.0, 1.0, True), (1.0, 1.0, False))
"""Those by which long paths arrive most."""
LOOSE_TURN = 1.3
"""Largest angle (rad) between tangents while bodies are let go: any solution at the end will do, whatever its branch."""
COMPLETING = ((0.2, 0.0), (1.0, 1.0))
"""Drag and mass by which harmonics that a guess lacks are held, all at once."""
COMPLETING_POINTS = 50
"""Of each path."""
FROM_FEWER = 10_000
"""Points of all paths from solutions without the highest harmonic."""
WALKS = "leave their seats"
NOT_CLIMBED = "harmonics let in one by one: no solution"
NOT_LET_IN = "highest harmonic let in: no solution"


@dataclass(frozen=True)
class Aids:
    """What the search for a first point may go by besides the static state.

    Parameters
    ----------
    guesses : callable, optional
        Of solutions at a frequency (rad/s), from a simpler study, (n_unknowns,) each.  They come right after plain Newton
        from the stuck response: where that fails, iterations from linear responses mostly fail as well, and take longer.
    fewer : callable, optional
        Solutions without the highest harmonic at a frequency (rad/s), or guesses of them, (n_unknowns,) each; called only
        if they are needed.
    climbing : bool
        Whether harmonics may be let in one by one, which takes long.
    longer : sequence of Support
        By which bodies may be let go along longer paths.
    completing : bool
        Whether the harmonics that a guess lacks may be let in at once: for gaps of a curve.  At its ends the ways from
        nothing are kept, as they may lead to other branches than that of the guess.
    """

    guesses: Callable[[float], list[NDArray]] | None = None
    fewer: Callable[[float], list[NDArray]] | None = None
    climbing: bool = False
    longer: Sequence[Support] = SUPPORTS
    completing: bool = False


NO_AIDS = Aids()


def first_point(
    system: HarmonicSystem,
    state: PreloadState,
    springs: NDArray,
    omega: float,
    options: ContinuationOptions,
    meter: CostMeter,
    aids: Aids = NO_AIDS,
) -> tuple[NDArray | None, list[str], NDArray]:
    """A solution at one frequency.

    Parameters
    ----------
    system : HarmonicSystem
    state : PreloadState
        The static state, converged.
    springs : (n_points, 3) float
        Linear springs of the points that stick.
    omega : float, rad/s
    options : ContinuationOptions
    meter : CostMeter
    aids : Aids

    Returns
    -------
    (n_unknowns + 1,) float or None, what was tried, and where the last Newton iteration ended
    """
    log = [f"static state: converged in {state.iterations} iterations, residual {state.residual:.1e}"]
    mean = state.q[: system.n_mean]
    stuck, free = system.linear_response(omega, springs), system.linear_response(omega, None)
    vibration = max(float(np.linalg.norm(stuck)), 1e-300)
    scale = np.full(system.n_unknowns + 1, vibration)
    scale[: system.n_mean] = max(float(np.linalg.norm(state.q)), vibration)
    scale[-1] = omega
    tries = [
        ("Newton from the stuck response", system.pack(mean, stuck), False, 20),
        ("Newton with line search from the stuck response", system.pack(mean, stuck), True, 60),
        ("Newton with line search from the free response", system.pack(mean, free), True, 60),
    ]
    guesses = [] if aids.guesses is None else aids.guesses(omega)
    tries[1:1] = [("Newton with line search from a guess given", u, True, 25) for u in guesses]
    for name, u, search, iterations in tries:
        c = system.correct_at(u, omega, scale, options.tolerance, iterations, search)
        meter.iterations += c.iterations
        log.append(f"{name}: {STATUS_TEXT[c.status]}, {c.iterations} iterations")
        if c.status == OK:
            return c.y, log, c.y
    found = _complete(system, guesses, omega, options, meter, log) if aids.completing else None
    if found is None:
        found = _raise_excitation(system, mean, stuck, omega, options, meter, log)
    if found is None:
        found, cut_off = _let_go(system, mean, (free, stuck), omega, options, meter, log, SUPPORTS, FEW_POINTS)
        again = [support for support in cut_off if support in aids.longer]
        if found is None and again:
            found, _ = _let_go(system, mean, (free, stuck), omega, options, meter, log, again, RAMP_POINTS)
        if found is None and cut_off and aids.fewer is not None:
            found = _let_in(system, aids.fewer(omega), omega, options, meter, log)
        if found is None and cut_off and aids.climbing:
            found = _climb(system, state, springs, omega, options, meter, log)
    return found, log, c.y


def _complete(
    system: HarmonicSystem,
    guesses: Sequence[NDArray],
    omega: float,
    options: ContinuationOptions,
    meter: CostMeter,
    log: list[str],
) -> NDArray | None:
    """All harmonics that guesses lack let in at once."""
    for u in guesses:
        there = [l for l in range(1, system.n_harmonics + 1) if any(np.any(u[part]) for part in system.slices(l))]
        first = max(there, default=0) + 1
        if first > system.n_harmonics:
            continue
        scale = np.full(len(u) + 1, max(float(np.linalg.norm(u[system.n_mean :])), 1e-300))
        scale[-1] = HELD
        for drag, mass in COMPLETING:
            held = system.letting_in(omega, drag, mass, first)
            c = held.correct_at(u, HELD, scale, options.tolerance, 60, True)
            meter.iterations += c.iterations
            if c.status != OK:
                continue
            few = replace(options, patience=COMPLETING_POINTS, max_turn=LOOSE_TURN)
            path = _homotopy(held, c.y, few, meter, COMPLETING_POINTS)
            if path.status == "complete":
                log.append(f"harmonics that a guess lacks let in at once: {len(path.points)} steps")
                return np.append(path.points[-1].y[:-1], omega)
    if guesses:
        log.append("harmonics that guesses lack let in at once: no solution")
    return None


def _raise_excitation(
    system: HarmonicSystem,
    mean: NDArray,
    stuck: NDArray,
    omega: float,
    options: ContinuationOptions,
    meter: CostMeter,
    log: list[str],
) -> NDArray | None:
    """Excitation raised from almost nothing to its full level, along the curve and around its folds."""
    first = 1e-3
    path = _homotopy(system.excitation_ramp(omega), np.append(system.pack(mean, first * stuck), first), options, meter)
    if path.status == "complete":
        log.append(f"excitation raised from the static state: full after {len(path.points)} steps")
        return np.append(path.points[-1].y[:-1], omega)
    reached = f"{100 * path.points[-1].y[-1]:.3g} %" if path.points else "no excitation"
    why = path.reason if path.status == "walked off" else path.status
    log.append(f"excitation raised from the static state: stopped at {reached} ({why})")
    return None


def _let_go(
    system: HarmonicSystem,
    mean: NDArray,
    linear: tuple[NDArray, NDArray],
    omega: float,
    options: ContinuationOptions,
    meter: CostMeter,
    log: list[str],
    supports: Sequence[Support],
    points: int,
) -> tuple[NDArray | None, list[Support]]:
    """Free bodies (all, if none is free) held by springs and dampers, which fade along the curve and around its folds.

    Held bodies do not bounce or walk, so the first point is found at once; several supports lead to different
    solutions, and some of them past ranges of excitation in which the body walks off.  Which of them gets through soon is
    not known beforehand: each gets few points first, and all it may take only where none arrives with those.  The supports
    that take more points are returned besides the solution.
    """
    first = 1e-2
    held = [np.where(system.held_coordinates[1], 0.0, q) for q in linear]
    walked = 0
    longer: list[Support] = []
    for drag, spring, raising in supports:
        supported = system.letting_go(omega, drag, spring, raising)
        guesses = [system.pack(mean, first * linear[1])] if raising else [system.pack(mean, q) for q in held]
        for u in guesses:
            scale = np.full(len(u) + 1, max(float(np.linalg.norm(u)), 1e-300))
            c = supported.correct_at(u, first, scale, options.tolerance, 60, True)
            meter.iterations += c.iterations
            if c.status == OK:
                break
        else:
            continue
        path = _homotopy(supported, c.y, replace(options, patience=points, max_turn=LOOSE_TURN), meter, points)
        if path.status == "complete":
            log.append(f"bodies held (drag {drag:g}, spring {spring:g}) and let go: {len(path.points)} steps")
            return np.append(path.points[-1].y[:-1], omega), longer
        walked += path.status == "walked off"
        if path.status == "too many points":
            longer.append((drag, spring, raising))
    tried = f"bodies held and let go by {len(supports)} supports: no solution in {points} steps"
    log.append(tried + (f", {WALKS} ({walked} supports)" if walked else ""))
    return None, longer


def _let_in(
    system: HarmonicSystem,
    fewer: list[NDArray],
    omega: float,
    options: ContinuationOptions,
    meter: CostMeter,
    log: list[str],
) -> NDArray | None:
    """From solutions without the highest harmonic to one with it."""
    if not fewer:
        return None
    ladder = Ladder(system, omega, replace(options, max_turn=LOOSE_TURN), meter)
    below = len(ladder.systems) - 2
    for u in fewer:
        ladder.add_near(below, u)
    known = len(ladder.solutions[below])
    found = ladder.climb(FROM_FEWER)
    how = f"{ladder.paths} paths with {ladder.points} points from {known} solutions without it"
    log.append(f"{NOT_LET_IN} ({how})" if found is None else f"highest harmonic let in: {how}")
    return None if found is None else np.append(found, omega)


def _climb(
    system: HarmonicSystem,
    state: PreloadState,
    springs: NDArray,
    omega: float,
    options: ContinuationOptions,
    meter: CostMeter,
    log: list[str],
) -> NDArray | None:
    """From a solution with the first harmonic to one with all."""
    ladder = Ladder(system, omega, replace(options, max_turn=LOOSE_TURN), meter)
    one = ladder.systems[0]
    if one is system:
        return None
    first, _, _ = first_point(one, state, springs, omega, options, meter)
    if first is None:
        log.append(f"{NOT_CLIMBED} with one")
        return None
    ladder.add(0, first[:-1])
    u = ladder.climb()
    how = f"{ladder.paths} paths with {ladder.points} points"
    for few, found in zip(ladder.systems, ladder.solutions):
        how += f", {len(found)} with {few.n_harmonics}" if found else ""
    log.append(f"{NOT_CLIMBED} ({how})" if u is None else f"harmonics let in one by one: {how}")
    return None if u is None else np.append(u, omega)


def _homotopy(
    system: HarmonicSystem, start: NDArray, options: ContinuationOptions, meter: CostMeter, points: int = RAMP_POINTS
) -> Path:
    """Along the last unknown, from where the start has it to 1."""
    one = replace(options, locate=False, max_points=points)
    path = follow(system, start, (0.5 * float(start[-1]), 1.0), options=one)
    meter.iterations += path.iterations
    meter.failed_steps += path.failed_steps
    return path
