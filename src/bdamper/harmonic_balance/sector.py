"""Harmonic balance equations of one sector under given settings, at one preload and one excitation.

The parameter is the frequency.  With the excitation as the parameter (:func:`excitation_ramp`), and a support that fades
out with it (:func:`supported_by`), they lead to a first solution.

Linear limits of a response: no contact at all, or every closed point stuck.

With springs K_c in place of the contact the first harmonic solves Z(omega) q = f, Z = K + K_c + i omega D - omega^2 M.  Its
poles give the resonances.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from bdamper import _core
from bdamper.contact.laws import (
    AFT,
    LAW_COUPLED,
    LAW_COUPLED_CONSTANT,
    LAW_SEPARABLE,
    LAW_USER,
    PointArrays,
    check_evaluation,
)
from bdamper.harmonic_balance.equations import Equations, InFrequency, Layout, Rows
from bdamper.model.kinematics import HarmonicBasis
from bdamper.util import validation
from bdamper.util.errors import SettingError

# ---- Linear limits of a response ----


UNDAMPED = 1e-9
"""Ratio of half-width to frequency of a resonance without damping."""
NEAREST = 1e-4
"""Distance, relative to its frequency, at which the response beside a resonance without damping is still solved for."""


@dataclass(frozen=True, eq=False)
class Linear:
    """A structure with linear springs in place of the contact.

    Parameters
    ----------
    bases : sequence of HarmonicBasis
        One for each harmonic, with the points and axes to which springs are given.
    springs : (n_points, 3) float
        Those that are a part of the bodies.
    layout : Layout
    force : (n_unknowns,) float
    """

    bases: Sequence[HarmonicBasis]
    springs: NDArray | float
    layout: Layout
    force: NDArray

    def matrix(self, omega: float, contact: NDArray | None, harmonic: int = 1) -> NDArray:
        """Complex dynamic stiffness of one harmonic with linear springs (n_points, 3) at the contact points."""
        b = self.bases[harmonic]
        w = harmonic * omega
        Z = np.diag(b.omega2 - w**2 * b.mass + 1j * w * b.damping).astype(complex)
        if contact is not None or np.any(self.springs):
            G = b.G.reshape(-1, 3, len(b.omega2))
            k = np.broadcast_to(self.springs + (0.0 if contact is None else contact), G.shape[:2])
            Z += G.reshape(-1, len(b.omega2)).conj().T @ (k[..., None] * G).reshape(-1, len(b.omega2))
        return Z

    def modes(self, contact: NDArray | None, harmonic: int = 1) -> tuple[NDArray, NDArray]:
        """Undamped frequencies (rad/s), ascending, and mass-normalised modes under linear springs (n_points, 3).

        Modal coordinates without mass follow the others statically and add no frequency.
        """
        K = self.matrix(0.0, contact, harmonic)
        shift = max(float(np.abs(np.diag(K)).max()) * 1e-6, 1.0)  # free rigid-body modes have no stiffness
        M = np.diag(self.bases[harmonic].mass)
        inverse, vectors = scipy.linalg.eigh(M, 0.5 * (K + K.conj().T) + shift * M)
        keep = np.flatnonzero(inverse > 1e-12 * inverse[-1])[::-1]
        pole = np.maximum(1.0 / inverse[keep] - shift, 0.0)
        return np.sqrt(pole), vectors[:, keep] / np.sqrt(inverse[keep])

    def response(self, omega: float, contact: NDArray | None, harmonic: int = 1) -> NDArray:
        """Complex modal amplitudes of one harmonic under linear contact; rigid modes without any contact stay at rest."""
        e = self.layout.amplitudes(self.force, harmonic)
        return np.linalg.lstsq(self.matrix(omega, contact, harmonic), e, rcond=1e-14)[0]

    def resonances(self, springs: Sequence[NDArray | None], low: float, high: float) -> list[tuple[float, float, NDArray]]:
        """Resonances with some springs (none without contact, those of every closed point where it sticks).

        Frequency and half-width (damping ratio times frequency) in rad/s, and the row that gives the modal coordinate.
        """
        out = []
        basis = self.bases[1]
        for k in springs:
            frequencies, vectors = self.modes(k)
            for omega, vector in zip(frequencies, vectors.T):
                if low < omega < high:
                    width = max(0.5 * float(np.abs(vector) ** 2 @ basis.damping), UNDAMPED * float(omega))
                    out.append((float(omega), width, vector.conj() * basis.mass))
        return out

    def maximum(self, row: NDArray, springs: NDArray | None, omega: float, width: float) -> tuple[float, float]:
        """Frequency (rad/s) and amplitude (m) of the maximum at a resonance of so many rad/s and half-width.

        ``row`` (n_modes,) gives the response.  Without damping the response is unbounded, and the amplitude infinite.
        """
        if width <= UNDAMPED * omega:
            return omega, np.inf

        def negative(w: float) -> float:
            return -abs(self.response(w, springs) @ row)

        ends = (omega - 3.0 * width, omega + 3.0 * width)
        options = {"xatol": 1e-9 * omega, "maxiter": 200}
        found = minimize_scalar(negative, bounds=ends, method="bounded", options=options)
        return float(found.x), -float(found.fun)




def reach(free: Sequence[float], stuck: Sequence[float], low: float, high: float) -> tuple[float, float]:
    """Interval in which branches that pass through (low, high) may turn, in the unit of the arguments.

    As contact slips and opens, the resonance of a mode and its folds shift from the stuck to the free frequency.  An end
    between the two of one mode is moved just beyond the outer one; other ends stay.  Modes are paired in their order.

    Parameters
    ----------
    free, stuck : sequence of float
        Resonances without contact (rigid motions left out) and with stuck contact, ascending.
    low, high : float
    """
    # part of its frequency by which a branch may turn beyond the resonance without contact or with stuck contact
    beyond = 0.03
    spans = [((1.0 - beyond) * min(pair), (1.0 + beyond) * max(pair)) for pair in zip(free, stuck)]
    bottom = min((a for a, b in spans if a < low < b), default=low)
    top = max((b for a, b in spans if a < high < b), default=high)
    return bottom, top


def around(low: float, high: float) -> tuple[float, float]:
    """Interval in which a pole may lie of which the maximum is in (low, high)."""
    return 0.8 * low, 1.25 * high


# ---- Harmonic balance equations of one sector under given settings, at one preload and one exci ----


@dataclass(frozen=True, eq=False)
class Sector:
    """Data of the equations of a sector.

    Parameters
    ----------
    bases : sequence of HarmonicBasis
        One for each harmonic 0..n_harmonics.
    points : PointArrays
    force : (n_unknowns,) float
        Modal excitation and static load, in the layout of the unknowns.
    response_rows : sequence of (n_modes,) complex
        Row of modal amplitudes that gives the response, for each harmonic.
    contact_forces : {"event_driven"} or AFT
    force_scale : (2,) float
        Reference modal forces of the mean and of the harmonics, for the relative residual.
    springs : (n_points, 3) float
        Springs that are a part of the bodies: with contact and without it.
    spring_bases : sequence of HarmonicBasis, optional
        Modes at the points and along the axes to which linear springs are given; ``bases`` by default.
    """

    bases: list[HarmonicBasis]
    points: PointArrays
    force: NDArray
    response_rows: Sequence[NDArray]
    contact_forces: str | AFT = "event_driven"
    force_scale: tuple[float, float] = (1.0, 1.0)
    springs: NDArray | float = 0.0
    spring_bases: list[HarmonicBasis] | None = None

    def __post_init__(self) -> None:
        validation.check(len(self.bases) > 1, "harmonics", "at least 1", "0")

    @cached_property
    def evaluation_code(self) -> tuple[int, int]:
        """Way of evaluation and number of samples, as the core has them."""
        return evaluation_code(self.contact_forces, len(self.bases) - 1, np.asarray(self.points.law))

    @property
    def exact(self) -> bool:
        """Whether contact forces come from events, not from samples."""
        return self.evaluation_code[0] == 0

    @cached_property
    def layout(self) -> Layout:
        """Places of the harmonics among the unknowns."""
        return Layout(np.array([len(b.omega2) for b in self.bases], np.intc))

    @cached_property
    def linear(self) -> Linear:
        """The sector with linear springs in place of the contact."""
        return Linear(tuple(self.spring_bases or self.bases), self.springs, self.layout, self.force)

    @cached_property
    def arrays(self) -> dict[str, NDArray]:
        """Arrays of the core by name."""
        points, bases = self.points, self.bases
        return {
            "n_mode": self.layout.n_mode,
            "stiffness": np.concatenate([b.omega2 for b in bases]),
            "mass": np.concatenate([b.mass for b in bases]),
            "damping": np.concatenate([b.damping for b in bases]),
            "G": np.concatenate([np.ascontiguousarray(b.G, complex).ravel() for b in bases]),
            "kt": np.ascontiguousarray(points.kt, float),
            "kn": np.ascontiguousarray(points.kn, float),
            "mu": np.ascontiguousarray(points.mu, float),
            "n0": np.ascontiguousarray(points.n0, float),
            "w": np.ascontiguousarray(points.slider, float),
            "law": np.ascontiguousarray(points.law, np.intc),
            "shift": np.ascontiguousarray(points.shift, float),
            "force": np.ascontiguousarray(self.force, float),
            "load": np.ascontiguousarray(points.n0 if points.load is None else points.load, float),
        }

    @property
    def own(self) -> tuple[tuple[Any, ...] | None, ...] | None:
        """Contact laws of the user's own as the core takes them, with what points remember from the static state."""
        own, memory = self.points.own, self.points.memory
        return None if own is None or memory is None else own.core(memory)

    def core(self, **over_speed: Any) -> _core.Sector:
        """The core's equations, those of a family if its arguments are given."""
        mode, n_time = self.evaluation_code
        given: dict[str, Any] = self.arrays | over_speed | {"own": self.own}
        return _core.Sector(**given, evaluation=mode, n_time=n_time, row_scale=row_scale(self.layout, self.force_scale))

    @property
    def rows(self) -> Rows:
        """Rows of the first harmonic of the response."""
        return Rows(np.array([self.layout.parts(np.asarray(self.response_rows[1]))]))

    @property
    def work(self) -> NDArray:
        """(4,) million operations of an evaluation, Jacobian, factorisation, solution by least norm."""
        n, points = len(self.force), len(self.points.kn)
        contact = 28e3 * (2 * len(self.bases) - 1) if self.exact else 120e3 + 1.2e3 * self.evaluation_code[1]
        return 1e-6 * np.array([points * contact, 6.0 * points * n**2, n**3 + 700.0 * n**2 + 1e6, 15.0 * n**3])

    @cached_property
    def _of_thread(self) -> threading.local:
        return threading.local()

    @property
    def equations(self) -> Equations[Sector]:
        """The equations at any frequency, made once in each thread: budget and cost are counted by the core."""
        if not hasattr(self._of_thread, "equations"):
            self._of_thread.equations = Equations(
                self.core(), self, self.layout, self.response_rows, self.rows, InFrequency(int(self.layout.n_mode[0])),
                row_scale(self.layout, self.force_scale), len(self.points.kn), self.work,
            )  # fmt: skip
        made: Equations[Sector] = self._of_thread.equations
        return made


def row_scale(layout: Layout, force_scale: tuple[float, float]) -> NDArray:
    """(n_unknowns,) factors on the residual, from reference forces of the mean and of the harmonics."""
    scale = np.full(layout.n_unknowns, 1.0 / force_scale[1])
    scale[: layout.n_mode[0]] = 1.0 / force_scale[0]
    return scale


def excitation_ramp(system: Equations[Sector], omega: float, support: NDArray | None = None) -> Equations[Sector]:
    """The same equations with a factor on the excitation of harmonics as the parameter, at fixed omega.

    The last entry of a point ``y`` is then the factor, which also fades out the linear force ``support``
    (n_unknowns, n_unknowns), if there is one.
    """
    assert isinstance(system.core, _core.Sector)
    ramp = np.array(system.structure.force, float)
    ramp[: system.n_mean] = 0.0
    eased = _core.Eased(system.core, float(omega), ramp, support)
    return replace(system, core=eased, supported=support is not None, watched=())


def supported_coordinates(sector: Sector) -> list[NDArray]:
    """For each harmonic (n_modes,) bool: mask of coordinates that the homotopy supports (free bodies, or all)."""
    free = [basis.omega2 == 0.0 for basis in sector.bases]
    return free if any(f.any() for f in free) else [np.ones_like(f) for f in free]


def supported_by(system: Equations[Sector], omega: float, drag: float, spring: float) -> Equations[Sector]:
    """The same equations at fixed omega with free bodies on a support that fades as the parameter s goes to 1.

    Viscous ``drag`` on the vibration and ``spring`` on the mean of coordinates without stiffness of their own (of all,
    if there are none), in units of ``omega`` and ``omega**2``, times ``1/s - 1``.  The last entry of a point ``y`` is
    then s, which is also the factor on the excitation: bodies without preload, which answer in proportion to it, rest
    on the support at its start.
    """
    support = np.zeros((system.n_unknowns, system.n_unknowns))
    for l, free in enumerate(supported_coordinates(system.structure)):
        c, s = (np.arange(system.n_unknowns)[part] for part in system.layout.slices(l))
        if l == 0:
            support[c[free], c[free]] = spring * omega**2
        else:
            support[c[free], s[free]] = drag * l * omega**2
            support[s[free], c[free]] = -drag * l * omega**2
    return excitation_ramp(system, omega, support)


def segments(
    x: NDArray,
    kt: NDArray,
    kn: float,
    mu: float,
    n0: float,
    slider: NDArray,
    law: int = LAW_SEPARABLE,
    contact_forces: str | AFT = "event_driven",
    load: float | None = None,
) -> list[list[tuple[float, float, int]]]:
    """Parts of the cycle at one contact point: for each tangential direction a list of (start, end, state).

    Parameters
    ----------
    x : (3, n_coef) float
        Motion (u1, u2, v) as coefficients.
    contact_forces : {"event_driven"} or AFT
        Coupled laws need samples.
    load : float, N, optional
        Normal load that limits friction under the laws of constant load; ``n0`` by default.

    Returns
    -------
    list of two lists; states 0 stick, 1 slip + (or slip of a coupled law), 2 slip -, 3 open; angles in radians, the last
    may pass 2 pi.
    """
    F = np.empty_like(x)
    J = np.empty(x.shape + x.shape)
    mode, n_time = evaluation_code(contact_forces, x.shape[1] // 2, np.array(law))
    _, parts = _core.evaluate_contact(
        np.ascontiguousarray(x), kt, kn, mu, n0, slider, F, J, law, mode, n_time, n0 if load is None else load
    )
    return list(parts)


def evaluation_code(contact_forces: str | AFT, harmonics: int, law: NDArray) -> tuple[int, int]:
    if contact_forces == "event_driven" and np.isin(law, (LAW_COUPLED, LAW_COUPLED_CONSTANT, LAW_USER)).any():
        raise SettingError('contact_forces: expected AFT(n) with a law that has no closed form, found "event_driven"')
    check_evaluation(contact_forces, harmonics)
    if isinstance(contact_forces, AFT):
        return (1 if contact_forces.interpolate else 2), contact_forces.n_time
    return 0, 0
