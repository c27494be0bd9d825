"""Harmonic balance equations of one sector (paper, Eq. (16)) at one preload and excitation, and
their linear limits.

The parameter of the equations is the frequency.  To find a first solution the parameter is a factor
on the excitation (:func:`excitation_ramp`), optionally with a support that fades out
(:func:`supported_by`).

The linear limits are no contact and permanent stick.  With springs ``K_c`` in place of the contact
the first harmonic solves

    Z(omega) q = f,      Z = K + K_c + i omega C - omega^2 M.

Its poles are the resonances of the limits.  :func:`segments` gives the states of one contact point
over the cycle; the transitions between them, such as the slip-to-stick event, are computed in
``csrc/contact/event_driven.c`` and ``csrc/contact/event_slider.c``.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

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

# ---- linear limits ----


UNDAMPED = 1e-9
"""Ratio of half-width to frequency of a resonance without damping."""
NEAREST = 1e-4
"""Smallest distance from an undamped resonance, relative to its frequency, at which the response is
computed."""


@dataclass(frozen=True, eq=False)
class Linear:
    """Structure with linear springs in place of the contact.

    Parameters
    ----------
    bases : sequence of HarmonicBasis
        Modes of each harmonic at the contact points, along the axes of the springs.
    springs : (n_points, 3) float, N/m
        Springs that are part of the bodies.
    layout : Layout
    force : (n_unknowns,) float
        Modal excitation and static load.
    """

    bases: Sequence[HarmonicBasis]
    springs: NDArray | float
    layout: Layout
    force: NDArray

    def matrix(self, omega: float, contact: NDArray | None, harmonic: int = 1) -> NDArray:
        """Return the complex dynamic stiffness of a harmonic with linear springs (n_points, 3) at
        the contact points."""
        basis = self.bases[harmonic]
        n_modes = len(basis.omega2)
        w = harmonic * omega
        of_modes = basis.omega2 - w**2 * basis.mass + 1j * w * basis.damping
        Z = np.diag(of_modes).astype(complex)
        if contact is None and not np.any(self.springs):
            return Z

        # motion of the contact points, (n_points, 3, n_modes)
        G = basis.G.reshape(-1, 3, n_modes)
        springs = self.springs + (0.0 if contact is None else contact)
        # springs of the bodies may be one number: (n_points, 3)
        springs = np.broadcast_to(springs, G.shape[:2])
        # G^H K_c G, with points and directions as rows
        forces = (springs[..., None] * G).reshape(-1, n_modes)
        Z += G.reshape(-1, n_modes).conj().T @ forces
        return Z

    def modes(self, contact: NDArray | None, harmonic: int = 1) -> tuple[NDArray, NDArray]:
        """Return undamped frequencies (rad/s), ascending, and mass-normalised modes with linear
        springs (n_points, 3).

        Massless modal coordinates follow the others statically and add no frequency.
        """
        K = self.matrix(0.0, contact, harmonic)
        M = np.diag(self.bases[harmonic].mass)
        # rigid-body modes have zero stiffness: a shift of omega**2 makes the matrix definite
        shift = max(float(np.abs(np.diag(K)).max()) * 1e-6, 1.0)
        shifted = 0.5 * (K + K.conj().T) + shift * M
        # ascending eigenvalues 1 / (omega**2 + shift); they are zero for massless coordinates
        inverse, vectors = scipy.linalg.eigh(M, shifted)
        largest = inverse[-1]
        has_mass = inverse > 1e-12 * largest
        # ascending in omega, hence reversed
        order = np.flatnonzero(has_mass)[::-1]
        omega2 = np.maximum(1.0 / inverse[order] - shift, 0.0)
        # eigh normalises v^H shifted v = 1, so v^H M v is the eigenvalue
        mass_normalised = vectors[:, order] / np.sqrt(inverse[order])
        return np.sqrt(omega2), mass_normalised

    def response(self, omega: float, contact: NDArray | None, harmonic: int = 1) -> NDArray:
        """Return the complex modal amplitudes of a harmonic with linear contact; unrestrained
        rigid-body modes remain at rest.
        """
        excitation = self.layout.amplitudes(self.force, harmonic)
        Z = self.matrix(omega, contact, harmonic)
        # least norm: the matrix of unrestrained bodies without load may be singular
        solution, *_ = np.linalg.lstsq(Z, excitation, rcond=1e-14)
        return solution

    def resonances(
        self, springs: Sequence[NDArray | None], low: float, high: float
    ) -> list[tuple[float, float, NDArray]]:
        """Return the resonances between ``low`` and ``high`` (rad/s) for several sets of contact
        springs.

        Each resonance has a frequency and a half-width (damping ratio times frequency), both in
        rad/s, and a row (n_modes,) whose product with the modal amplitudes is the coordinate of its
        mode.
        """
        resonances = []
        basis = self.bases[1]
        for contact in springs:
            frequencies, vectors = self.modes(contact)
            for omega, vector in zip(frequencies, vectors.T):
                if not low < omega < high:
                    continue
                # half of the modal damping
                damped_width = 0.5 * float(np.abs(vector) ** 2 @ basis.damping)
                width = max(damped_width, UNDAMPED * float(omega))
                row = vector.conj() * basis.mass
                resonances.append((float(omega), width, row))
        return resonances

    def maximum(
        self, row: NDArray, springs: NDArray | None, omega: float, width: float
    ) -> tuple[float, float]:
        """Return frequency (rad/s) and amplitude (m) of the maximum near a resonance of frequency
        ``omega`` and half-width ``width``.

        ``row`` (n_modes,) gives the response.  Without damping the amplitude is infinite.
        """
        if width <= UNDAMPED * omega:
            return omega, np.inf

        def negative(w: float) -> float:
            return -abs(self.response(w, springs) @ row)

        minimum = scipy.optimize.minimize_scalar(
            negative,
            bounds=(omega - 3.0 * width, omega + 3.0 * width),
            method="bounded",
            options={"xatol": 1e-9 * omega, "maxiter": 200},
        )
        return float(minimum.x), -float(minimum.fun)


def reach(
    free: Sequence[float], stuck: Sequence[float], low: float, high: float
) -> tuple[float, float]:
    """Return the interval in which branches that pass through (low, high) may have folds, in the
    unit of the arguments.

    As the contact slips and opens, the resonance of a mode moves from its stuck towards its free
    frequency, and so do the folds.  An end between the two frequencies of a mode moves just beyond
    the outer one.  Modes are paired in ascending order.

    Parameters
    ----------
    free, stuck : sequence of float
        Resonances without contact (without rigid-body modes) and with stuck contact, ascending.
    low, high : float
    """
    # relative distance beyond the free or stuck resonance at which a branch may turn
    beyond = 0.03
    bottom = low
    top = high
    for pair in zip(free, stuck):
        outer_low = (1.0 - beyond) * min(pair)
        outer_high = (1.0 + beyond) * max(pair)
        if outer_low < low < outer_high:
            bottom = min(bottom, outer_low)
        if outer_low < high < outer_high:
            top = max(top, outer_high)
    return bottom, top


def around(low: float, high: float) -> tuple[float, float]:
    """Widen an interval of frequencies, so that it contains the resonances whose response maximum
    lies in (low, high)."""
    return 0.8 * low, 1.25 * high


# ---- equations of a sector ----


@dataclass(frozen=True, eq=False)
class SectorData:
    """Data of the equations of a sector.

    Parameters
    ----------
    bases : sequence of HarmonicBasis
        Modes of each harmonic 0..n_harmonics.
    points : PointArrays
    force : (n_unknowns,) float
        Modal excitation and static load, in the layout of the unknowns.
    response_rows : sequence of (n_modes,) complex
        For each harmonic, the row of modal amplitudes that gives the response.
    contact_forces : {"event_driven"} or AFT
    force_scale : (2,) float
        Reference modal forces of the mean and of the harmonics, for the relative residual.
    springs : (n_points, 3) float, N/m
        Springs that are part of the bodies, with contact and without.
    spring_bases : sequence of HarmonicBasis, optional
        Modes at the points and along the axes of linear springs; ``bases`` by default.
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
        """Evaluation method and number of samples in the encoding of the core."""
        n_harmonics = len(self.bases) - 1
        return evaluation_code(self.contact_forces, n_harmonics, np.asarray(self.points.law))

    @property
    def exact(self) -> bool:
        """Whether contact forces are event-driven, not sampled."""
        method, _ = self.evaluation_code
        return method == 0

    @cached_property
    def layout(self) -> Layout:
        """Indices of the harmonics in the unknowns."""
        return Layout(np.array([len(b.omega2) for b in self.bases], np.intc))

    @cached_property
    def linear(self) -> Linear:
        """Sector with linear springs in place of the contact."""
        return Linear(tuple(self.spring_bases or self.bases), self.springs, self.layout, self.force)

    @cached_property
    def arrays(self) -> dict[str, NDArray]:
        """Arrays of the core by name."""
        points = self.points
        bases = self.bases
        modes_at_points = [np.ascontiguousarray(b.G, complex).ravel() for b in bases]
        # without a stated load the laws of constant load use the normal load at zero motion
        load = points.n0 if points.load is None else points.load
        return {
            "n_mode": self.layout.n_mode,
            "stiffness": np.concatenate([b.omega2 for b in bases]),
            "mass": np.concatenate([b.mass for b in bases]),
            "damping": np.concatenate([b.damping for b in bases]),
            "G": np.concatenate(modes_at_points),
            "kt": np.ascontiguousarray(points.kt, float),
            "kn": np.ascontiguousarray(points.kn, float),
            "mu": np.ascontiguousarray(points.mu, float),
            "n0": np.ascontiguousarray(points.n0, float),
            "w": np.ascontiguousarray(points.slider, float),
            "law": np.ascontiguousarray(points.law, np.intc),
            "shift": np.ascontiguousarray(points.shift, float),
            "force": np.ascontiguousarray(self.force, float),
            "load": np.ascontiguousarray(load, float),
        }

    @property
    def own(self) -> tuple[tuple[Any, ...] | None, ...] | None:
        """User-defined contact laws in the form of the core, with their static state variables."""
        laws = self.points.own
        memory = self.points.memory
        if laws is None or memory is None:
            return None
        return laws.core(memory)

    def core(self, **over_speed: Any) -> _core.SectorEquations:
        """Create the equations in the C core; ``over_speed`` contains further arrays of a
        sector with speed-dependent data."""
        mode, n_time = self.evaluation_code
        arguments: dict[str, Any] = self.arrays | over_speed | {"own": self.own}
        return _core.SectorEquations(
            **arguments,
            evaluation=mode,
            n_time=n_time,
            row_scale=row_scale(self.layout, self.force_scale),
        )

    @property
    def rows(self) -> Rows:
        """Rows whose products with the unknowns are the first harmonic of the response."""
        real_and_imaginary = self.layout.parts(np.asarray(self.response_rows[1]))
        return Rows(np.array([real_and_imaginary]))

    @property
    def work(self) -> NDArray:
        """Million operations (4,) of an evaluation, a Jacobian, a factorisation and a least-norm
        solution."""
        n = len(self.force)
        n_points = len(self.points.kn)
        # operations of one contact point: by coefficient if exact, otherwise by sample
        if self.exact:
            n_coef = 2 * len(self.bases) - 1
            contact = 28e3 * n_coef
        else:
            _, n_time = self.evaluation_code
            contact = 120e3 + 1.2e3 * n_time
        evaluation = n_points * contact
        jacobian = 6.0 * n_points * n**2
        factorisation = n**3 + 700.0 * n**2 + 1e6
        least_norm = 15.0 * n**3
        return 1e-6 * np.array([evaluation, jacobian, factorisation, least_norm])

    @cached_property
    def _of_thread(self) -> threading.local:
        return threading.local()

    @property
    def equations(self) -> Equations[SectorData]:
        """Equations of the harmonic balance; each thread has its own object, because the core
        counts its evaluations."""
        if not hasattr(self._of_thread, "equations"):
            self._of_thread.equations = Equations(
                core=self.core(),
                structure=self,
                layout=self.layout,
                response_rows=self.response_rows,
                rows=self.rows,
                measure=InFrequency(int(self.layout.n_mode[0])),
                row_scale=row_scale(self.layout, self.force_scale),
                n_points=len(self.points.kn),
                work=self.work,
            )
        equations: Equations[SectorData] = self._of_thread.equations
        return equations


def row_scale(layout: Layout, force_scale: tuple[float, float]) -> NDArray:
    """Return the factors (n_unknowns,) that divide the residual by the reference forces of the mean
    and the harmonics."""
    mean_force, vibration_force = force_scale
    n_mean = layout.n_mode[0]
    scale = np.full(layout.n_unknowns, 1.0 / vibration_force)
    scale[:n_mean] = 1.0 / mean_force
    return scale


def excitation_ramp(
    system: Equations[SectorData], omega: float, support: NDArray | None = None
) -> Equations[SectorData]:
    """Return the equations at fixed omega (rad/s) with a factor on the excitation as the parameter.

    The parameter scales the excitation of the harmonics and fades out the linear force ``support``
    (n_unknowns, n_unknowns).
    """
    assert isinstance(system.core, _core.SectorEquations)
    # the static load keeps its full size
    ramp = np.array(system.structure.force, float)
    ramp[: system.n_mean] = 0.0
    eased = _core.Eased(system.core, float(omega), ramp, support)
    return replace(system, core=eased, supported=support is not None, watched=())


def supported_coordinates(sector: SectorData) -> list[NDArray]:
    """Return masks (n_modes,) of the coordinates that the homotopy supports, for each harmonic:
    free bodies, or all."""
    free = [basis.omega2 == 0.0 for basis in sector.bases]
    if any(mask.any() for mask in free):
        return free
    return [np.ones_like(mask) for mask in free]


def supported_by(
    system: Equations[SectorData], omega: float, drag: float, spring: float
) -> Equations[SectorData]:
    """Return the equations at fixed omega (rad/s) with free bodies on a support that fades out as
    the parameter s approaches 1.

    The support has a viscous ``drag`` on the vibration and a ``spring`` on the mean of coordinates
    without stiffness (all coordinates, if there are none), in units of ``omega`` and ``omega**2``,
    times ``1/s - 1``.  The parameter s also scales the excitation.  At s = 0 bodies without
    preload, whose response is proportional to it, rest on the support.
    """
    support = np.zeros((system.n_unknowns, system.n_unknowns))
    unknowns = np.arange(system.n_unknowns)
    for l, supported in enumerate(supported_coordinates(system.structure)):
        cosine_part, sine_part = system.layout.slices(l)
        cosine = unknowns[cosine_part][supported]
        if l == 0:
            support[cosine, cosine] = spring * omega**2
            continue
        # a viscous force couples the cosine to the sine amplitudes
        sine = unknowns[sine_part][supported]
        support[cosine, sine] = drag * l * omega**2
        support[sine, cosine] = -drag * l * omega**2
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
    """Return the contact states of one point over the cycle, a list of (start, end, state) for each
    tangential direction.

    The end of a slip segment followed by stick is the slip-to-stick event.

    Parameters
    ----------
    x : (3, n_coef) float
        Motion (u1, u2, v) as coefficients, m.
    kt : (2,) float, N/m
        Tangential stiffness.
    kn : float, N/m
        Normal stiffness.
    mu : float
    n0 : float, N
        Normal load at zero motion.
    slider : (2,) float, m
        Slider position in permanent stick.
    law : int
    contact_forces : {"event_driven"} or AFT
        Coupled laws need samples.
    load : float, N, optional
        Normal load of the friction limit under the laws of constant load; ``n0`` by default.

    Returns
    -------
    list of two lists
        States: 0 stick, 1 slip + (or slip of a coupled law), 2 slip -, 3 open.  Angles in radians;
        the last may exceed 2 pi.
    """
    # the core also returns force and derivatives, which are not needed here
    F = np.empty_like(x)
    J = np.empty(x.shape + x.shape)
    # coefficients: mean, then cosine and sine of each harmonic
    n_harmonics = x.shape[1] // 2
    mode, n_time = evaluation_code(contact_forces, n_harmonics, np.array(law))
    _, parts = _core.evaluate_contact(
        np.ascontiguousarray(x),
        kt,
        kn,
        mu,
        n0,
        slider,
        F,
        J,
        law,
        mode,
        n_time,
        n0 if load is None else load,
    )
    return list(parts)


def evaluation_code(contact_forces: str | AFT, harmonics: int, law: NDArray) -> tuple[int, int]:
    """Return method and number of samples in the encoding of the core.

    0 is event-driven, 1 is AFT with interpolated transitions, and 2 is plain AFT.
    """
    needs_samples = np.isin(law, (LAW_COUPLED, LAW_COUPLED_CONSTANT, LAW_USER)).any()
    if contact_forces == "event_driven" and needs_samples:
        raise SettingError(
            'contact_forces: expected AFT(n), since the law has no closed form, found "event_driven"'
        )
    check_evaluation(contact_forces, harmonics)
    if not isinstance(contact_forces, AFT):
        return 0, 0
    method = 1 if contact_forces.interpolate else 2
    return method, contact_forces.n_time
