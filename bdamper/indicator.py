"""What an effect that is left out would change, without simulating it.

A converged solution ``y = (u, omega)`` of a cheap system is embedded in a richer one: further harmonics, modes and
motions at rest, the mean displaced as far from the static state as before.  There the richer residual ``R`` is not zero.
At a peak of the response the amplitude ``A`` is stationary along the curve, so it does not matter at which point of the
richer curve it is compared; the phase of the response is held, which follows a resonance that moves:

    B = [ J  R_omega ; grad(phase)  0 ],      B^T lambda = (grad A, 0),      B^T mu = (0, 1),
    dA = -lambda . R,                          domega = -mu . R.

One Jacobian of the richer system and one factorisation give both, whatever the number of quantities.  ``R`` a second time,
at ``y - B^-1 R``, tells how far the linear estimate can be trusted: what the same weights make of it is the *defect*, the
part of the change that the estimate has missed.

An effect is *small* if estimate and defect stay below the tolerance; if the estimate is beyond 15 %, or misses more than
half of itself, or the richer equations are singular there, its size is not to be trusted: it *must be on*.  In between it
is *significant*.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import get_lapack_funcs

from bdamper.effects import Effects
from bdamper.errors import BdamperError, SettingError
from bdamper.peaks import Peak, PeakOptions, coarse_options, find_peak, same_peak
from bdamper.response import uninterrupted
from bdamper.resultfile import reading
from bdamper.system import OK, HarmonicSystem

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from bdamper.response import Curve
    from bdamper.study import Study

TRUSTED = 0.15
"""Relative change up to which the size of an estimate can be relied on."""


@dataclass(frozen=True)
class Estimate:
    """Change that a richer system makes to a peak.

    Parameters
    ----------
    amplitude, frequency : float
        Relative change of the peak; NaN where the richer equations are singular.
    defect : float
        Relative change of amplitude or frequency that the estimate misses, as far as a second residual tells.
    y : (n_unknowns + 1,) float
        The embedded point after one Newton step: a guess for the richer solution.
    shares, frequency_shares : (n_harmonics + 1,) float
        Parts of the relative change of amplitude and of frequency that come from the equations of each harmonic, the mean
        first.
    """

    amplitude: float
    frequency: float
    defect: float
    y: NDArray
    shares: NDArray
    frequency_shares: NDArray

    @property
    def size(self) -> float:
        """Largest relative change, the defect included."""
        size = max(abs(self.amplitude), abs(self.frequency)) + self.defect
        return size if np.isfinite(size) else np.inf

    def reliability(self, tolerance: float) -> str:
        """ "small", "significant" or "must be on"."""
        change = max(abs(self.amplitude), abs(self.frequency))
        if not np.isfinite(self.size):
            return "must be on"
        if self.size <= tolerance:
            return "small"
        return "must be on" if change > TRUSTED or self.defect > 0.5 * change else "significant"


def embed(cheap: Study, rich: Study, preload: float, y: NDArray) -> NDArray:
    """A point of one study as a point of a study with other effects.

    Modes that both have keep their amplitudes, others are at rest; the mean keeps its distance from the static state.

    Parameters
    ----------
    cheap, rich : Study
    preload : float, N
    y : (n_unknowns + 1,) float
        Of the cheap study.

    Returns
    -------
    (n_unknowns + 1,) float
    """
    a, b = cheap.system(preload), rich.system(preload)
    return embed_between(cheap, rich, a, b, preload, y)


def embed_between(
    cheap: Study, rich: Study, a: HarmonicSystem, b: HarmonicSystem, preload: float, y: NDArray
) -> NDArray:
    """The same for systems that exist already."""
    out = np.zeros(b.n_unknowns + 1)
    out[-1] = y[-1]
    if b.n_mean:
        old, new = cheap.static(preload).q, rich.static(preload).q
        out[: b.n_mean] = new
        if a.n_mean:
            at, to = _common(a.bases[0].coordinates, b.bases[0].coordinates)
            out[to] += y[at] - old[at]
    for l in range(1, min(a.n_harmonics, b.n_harmonics) + 1):
        at, to = _common(a.bases[l].coordinates, b.bases[l].coordinates)
        for from_part, to_part in zip(a.slices(l), b.slices(l)):
            out[to_part.start + to] = y[from_part.start + at]
    return out


def _common(a: tuple[Any, ...], b: tuple[Any, ...]) -> tuple[NDArray, NDArray]:
    place = {c: i for i, c in enumerate(b)}
    pairs = [(i, place[c]) for i, c in enumerate(a) if c in place]
    return np.array([i for i, _ in pairs], int), np.array([j for _, j in pairs], int)


def estimate_change(system: HarmonicSystem, y: NDArray, residual: NDArray | None = None) -> Estimate:
    """Change of the peak from the point ``y`` to the solutions of a system that ``y`` does not solve.

    Parameters
    ----------
    system : HarmonicSystem
    y : (n_unknowns + 1,) float
        A peak of a simpler system, embedded.
    residual : (n_unknowns,) float, optional
        Of equations that differ from those of the system a little, at ``y``; the system's own by default.
    """
    n = system.n_unknowns
    r, J, r_omega = system.evaluate(y[:-1], y[-1])
    r = r if residual is None else residual
    grow, turn, amplitude = amplitude_and_phase(system, y[:-1])
    B = np.zeros((n + 1, n + 1))
    B[:n, :n], B[:n, n], B[n, :n] = J, r_omega, turn
    columns = np.ones(n + 1)
    columns[:n] = max(float(np.linalg.norm(y[system.n_mean : -1])), 1e-300)
    columns[n] = y[-1]
    B *= columns
    rows = 1.0 / np.maximum(np.abs(B).max(axis=1), 1e-300)
    B *= rows[:, None]
    weights = np.zeros((n + 1, 2))
    weights[:n, 0] = grow / max(amplitude, 1e-300) * columns[:n]
    weights[n, 1] = 1.0
    right = np.append(r, 0.0) * rows
    getrf, getrs, gecon = get_lapack_funcs(("getrf", "getrs", "gecon"), (B,))
    factors, pivots, info = getrf(B)
    if info == 0 and gecon(factors, np.abs(B).sum(axis=0).max())[0] > 1e-14:
        dual = getrs(factors, pivots, weights, trans=1)[0]
        step = getrs(factors, pivots, -right)[0]
    else:  # a mean position that nothing holds stays where it is
        dual = np.linalg.lstsq(B.T, weights, rcond=1e-13)[0]
        step = np.linalg.lstsq(B, -right, rcond=1e-13)[0]
    change = -(right @ dual)
    new = y + step * columns
    again = np.empty(n)
    if not new[-1] > 0.0 or system.core.evaluate(np.ascontiguousarray(new[:-1]), float(new[-1]), again) != OK:
        unknown = np.full(system.n_harmonics + 1, np.nan)
        return Estimate(np.nan, np.nan, np.inf, y, unknown, unknown)
    missed = (np.append(again, 0.0) * rows) @ dual
    parts = -right[:, None] * dual
    shares = np.array([sum(parts[p].sum(axis=0) for p in system.slices(l)) for l in range(system.n_harmonics + 1)])
    return Estimate(float(change[0]), float(change[1]), float(np.abs(missed).max()), new, shares[:, 0], shares[:, 1])


def amplitude_and_phase(system: HarmonicSystem, u: NDArray) -> tuple[NDArray, NDArray, float]:
    """Gradients (n_unknowns,) of the amplitude and of amplitude times phase of the response, and the amplitude."""
    row = system.response_rows[1]
    x = system.amplitudes(u, 1) @ row
    amplitude = float(abs(x))
    z = np.conj(x) * row / max(amplitude, 1e-300)
    c, s = system.slices(1)
    grow, turn = np.zeros(len(u)), np.zeros(len(u))
    grow[c], grow[s] = z.real, z.imag
    turn[c], turn[s] = z.imag, -z.real
    return grow, turn, amplitude


# ---- peaks of a curve ----


def highest_peaks(
    system: HarmonicSystem, curve: Curve, share: float = 0.6, options: PeakOptions | None = None
) -> list[Peak]:
    """Refined maxima of a curve that come near the highest, the highest first.

    Parameters
    ----------
    system : HarmonicSystem
        The one that the curve was followed with.
    curve : Curve
    share : float
        Of the highest: lower maxima are left out.
    options : PeakOptions
    """
    a = curve.amplitude
    peaks: list[Peak] = []
    for i in range(1, len(curve) - 1):
        same_branch = curve.branch[i - 1] == curve.branch[i] == curve.branch[i + 1]
        if not (same_branch and a[i] > a[i - 1] and a[i] >= a[i + 1] and a[i] >= share * a.max()):
            continue
        y = np.append(curve.unknowns[i], 2.0 * np.pi * curve.frequency[i])
        peak = find_peak(system, y, options=options)
        if not peak.converged and curve.point_kind[i] == "maximum":  # located on the curve, if not to the last digit
            peak = replace(
                peak, y=y, frequency=float(curve.frequency[i]), amplitude=float(a[i]), residual=float(curve.residual[i]),
                status="converged",
            )  # fmt: skip
        if peak.converged and not any(same_peak(peak, p, 1e-3) for p in peaks):
            peaks.append(peak)
    return sorted(peaks, key=lambda p: -p.amplitude)


# ---- advice ----


@dataclass(frozen=True)
class EffectAdvice:
    """What one effect would change.

    Parameters
    ----------
    name : str
    amplitude_change, frequency_change : float
        Estimated relative change of the peak; NaN if the indicator could not tell.
    defect : float
        Relative change that the estimate may miss.
    reliability : {"small", "significant", "must be on"}
    unknowns, points : int
        Unknowns and contact elements with the effect on.
    cost : float
        Time of a Newton iteration with the effect on, relative to that without.
    """

    name: str
    amplitude_change: float
    frequency_change: float
    defect: float
    reliability: str
    unknowns: int
    points: int
    cost: float


@dataclass(frozen=True)
class Advice:
    """Estimated changes of a peak by all effects that are off.

    Parameters
    ----------
    preload : float, N
    frequency, amplitude : float, Hz, m
        The converged peak of the study as it is.
    tolerance : float
    unknowns, points : int
        Of the study as it is.
    effects : tuple of EffectAdvice
        The largest change first.
    seconds : float
        For the estimates alone.
    """

    preload: float
    frequency: float
    amplitude: float
    tolerance: float
    unknowns: int
    points: int
    effects: tuple[EffectAdvice, ...]
    seconds: float = field(default=0.0, compare=False)

    def __getitem__(self, name: str) -> EffectAdvice:
        for item in self.effects:
            if item.name == name:
                return item
        raise KeyError(f"no advice on '{name}'; there is some on {[e.name for e in self.effects]}")

    @property
    def called_for(self) -> tuple[str, ...]:
        """Effects that are not small."""
        return tuple(e.name for e in self.effects if e.reliability != "small")

    def __str__(self) -> str:
        lines = [
            f"peak {self.amplitude:.6g} m at {self.frequency:.6g} Hz, preload {self.preload:g} N; tolerance "
            f"{100 * self.tolerance:g} %; {self.unknowns} unknowns, {self.points} contact elements",
            f"{'effect switched on':<26}{'amplitude':>11}{'frequency':>11}{'may miss':>11}  {'reliability':<12}"
            f"{'unknowns':>9}{'points':>7}{'cost':>7}",
        ]
        for e in self.effects:
            lines.append(
                f"{e.name:<26}{_percent(e.amplitude_change):>11}{_percent(e.frequency_change):>11}"
                f"{_percent(e.defect, sign=False):>11}  {e.reliability:<12}{e.unknowns:>9}{e.points:>7}{e.cost:>6.1f}x"
            )
        return "\n".join(lines)

    def plot(self, ax: Axes | None = None, **style: Any) -> Axes:
        """Bars of the estimated changes; see :func:`bdamper.plotting.plot_advice`."""
        from bdamper.plotting import plot_advice

        return plot_advice(self, ax=ax, **style)

    def save(self, path: str | FilePath) -> None:
        """Write the advice to an HDF5 file."""
        with h5py.File(path, "w") as file:
            file.attrs["format"] = "bdamper-advice"
            file.attrs["version"] = 1
            for name in _SCALARS:
                file.attrs[name] = getattr(self, name)
            for name in _COLUMNS:
                values = [getattr(e, name) for e in self.effects]
                text = name in ("name", "reliability")
                file.create_dataset(name, data=values, dtype=h5py.string_dtype() if text else None)


_SCALARS = ("preload", "frequency", "amplitude", "tolerance", "unknowns", "points", "seconds")
_COLUMNS = (
    "name", "amplitude_change", "frequency_change", "defect", "reliability", "unknowns", "points", "cost",
)  # fmt: skip


def load_advice(path: str | FilePath) -> Advice:
    """Read what :meth:`Advice.save` wrote.

    Raises
    ------
    BdamperError
        If the file is not such a file.
    """
    with reading(path, "bdamper-advice", "advice written by Advice.save") as file:
        columns = {
            name: file[name].asstr()[()] if name in ("name", "reliability") else file[name][()] for name in _COLUMNS
        }
        n = len(columns["name"])
        rows = [{name: _plain(columns[name][i]) for name in _COLUMNS} for i in range(n)]
        scalars = {name: _plain(file.attrs[name]) for name in _SCALARS}
        return Advice(effects=tuple(EffectAdvice(**row) for row in rows), **scalars)


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else value


def _percent(value: float, sign: bool = True) -> str:
    if not np.isfinite(value):
        return "unknown"
    return f"{100 * value:+.2f} %" if sign else f"{100 * value:.2f} %"


def advise(
    study: Study,
    preload: float,
    frequency: tuple[float, float],
    *,
    against: Effects | None = None,
    tolerance: float = 0.01,
    peak: Peak | None = None,
) -> Advice:
    """Which of the effects that a study leaves out would change its highest peak.

    Parameters
    ----------
    study : Study
        As cheap as one likes.
    preload : float, N
    frequency : (low, high), Hz
        Interval in which the peak is looked for.
    against : Effects, optional
        The effects to ask about: those that are on there and off in the study.  By default all that the model allows, with
        five harmonics, two elastic damper modes and coupled friction.
    tolerance : float
        Relative change of amplitude or frequency that counts as small.
    peak : Peak, optional
        Of the study at this preload, if it is known already.

    Returns
    -------
    Advice

    Raises
    ------
    BdamperError
        If the study has no peak there.
    """
    if not 0.0 < tolerance < 1.0:
        raise SettingError(f"tolerance: expected between 0 and 1, found {tolerance}")
    own = Effects.of(study)
    rich = against or fullest(study)
    system = study.system(preload)
    if peak is None:
        curve = uninterrupted(study.track(preload, frequency, options=coarse_options()))
        peaks = highest_peaks(system, curve)
        if not peaks:
            raise BdamperError(f"no peak between {frequency[0]:g} and {frequency[1]:g} Hz at {preload:g} N: {curve.reason}")
        peak = peaks[0]
    begin = time.perf_counter()
    own_time = _iteration_time(system, peak.y)
    items = []
    for name, effects in own.missing(rich).items():
        richer = study.with_effects(effects)
        items.append(_advice_on(name, study, richer, system, preload, peak, tolerance, own_time))
    items.sort(key=lambda e: -max(abs(np.nan_to_num(e.amplitude_change, nan=9.0)), abs(e.frequency_change)))
    return Advice(
        float(preload), peak.frequency, peak.amplitude, tolerance, system.n_unknowns, system.n_points, tuple(items),
        time.perf_counter() - begin,
    )  # fmt: skip


def _advice_on(
    name: str,
    study: Study,
    richer: Study,
    system: HarmonicSystem,
    preload: float,
    peak: Peak,
    tolerance: float,
    own_time: float,
) -> EffectAdvice:
    state = richer.static(preload)
    rich = richer.system(preload)
    if not state.converged:
        return EffectAdvice(name, np.nan, np.nan, np.inf, "must be on", rich.n_unknowns, rich.n_points, np.nan)
    y = embed_between(study, richer, system, rich, preload, peak.y)
    try:
        e = estimate_change(rich, y)
    except FloatingPointError:
        nothing = np.zeros(rich.n_harmonics + 1)
        e = Estimate(np.nan, np.nan, np.inf, y, nothing, nothing)
    cost = _iteration_time(rich, y) / own_time
    return EffectAdvice(
        name, e.amplitude, e.frequency, e.defect, e.reliability(tolerance), rich.n_unknowns, rich.n_points, cost
    )


def _iteration_time(system: HarmonicSystem, y: NDArray) -> float:
    """Seconds of a residual with Jacobian and a factorisation, the shorter of two."""
    best = np.inf
    for _ in range(2):
        begin = time.perf_counter()
        _, J, _ = system.evaluate(y[:-1], y[-1])
        get_lapack_funcs("getrf", (J,))(J)
        best = min(best, time.perf_counter() - begin)
    return best


def fullest(study: Study) -> Effects:
    """All effects that a study could simulate: five harmonics where the model has their nodal diameters."""
    own = Effects.of(study)
    most = 1
    for l in range(2, 6):
        try:
            study.coupling.basis(l)
        except SettingError:
            break
        most = l
    bodies = study.model.bodies.values()
    blade = [min(b.n_modes for b in body.bases.values()) for body in bodies if body.kind == "constrained"]
    damper = [body.bases[0].n_modes - 6 for body in bodies if body.kind == "free"]
    plain = own.friction_law == "separable" and own.residual_traction == "static"
    harmonics = sorted({*own.harmonic_numbers, *range(1, most + 1)})
    return replace(
        own,
        harmonics=len(harmonics) if harmonics[-1] == len(harmonics) else tuple(harmonics),
        bias=True,
        variable_normal_load=True,
        separation=True,
        friction_law="coupled" if plain else own.friction_law,
        rotation=("X", "Y", "Z"),
        translation=("X", "Y", "Z"),
        damper_modes=max(own.damper_modes, min([2, *damper])) if damper else own.damper_modes,
        harmonic_nodal_diameters=True,
        constraints=True,
        contact_points=None,
        blade_modes=max(own.blade_modes, min([20, 2 * own.blade_modes, *blade])),
    )
