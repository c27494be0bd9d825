"""Excitation at which closed contacts begin to slip (:mod:`bdamper.harmonic_balance.residual_forces`)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bdamper.contact.laws import (
    refuse,
)
from bdamper.harmonic_balance import residual_forces
from bdamper.harmonic_balance.problem import LoadCase
from bdamper.harmonic_balance.residual_forces import Programme, Residual
from bdamper.response.linear_limits import linear_peak, peak_interval, warn_of_shroud
from bdamper.util import validation
from bdamper.util.display import Summarised
from bdamper.util.errors import SettingError
from bdamper.util.formatting import amount, percent, short_repr
from bdamper.util.statement import Row, Statement


@short_repr
@dataclass(frozen=True)
class FirstSlip(Summarised):
    """Excitation at which the closed contacts of a resonance begin to slip.

    Parameters
    ----------
    preload : float, N
    excitation : float
        Amplitude of the excitation of the study, in ``unit``.
    unit : str
    factor : float
        Excitation of first slip in units of ``excitation``: above it closed points slip or open, or
        open ones touch.  Infinite if no contact force limits it.
    frequency : float, Hz
        Resonance with all closed points stuck.
    amplitude : float, m
        Amplitude of this resonance under ``excitation``, if nothing slips.
    limiting : mapping of interface name to float
        Contribution of each interface to the limit; the sum is 1.
    touching : float
        Excitation, in units of ``excitation``, at which points that are open at rest touch with
        their gap at rest; infinite if none does.  Below first slip other mean forces can hold them
        apart.
    closed : mapping of interface name to (int, int)
        Numbers of closed points at rest and of all points, for partly closed interfaces.
    """

    preload: float
    excitation: float
    unit: str
    factor: float
    frequency: float
    amplitude: float
    limiting: dict[str, float]
    touching: float
    closed: dict[str, tuple[int, int]]

    @property
    def force(self) -> float:
        """Excitation of first slip, in ``unit``."""
        return self.factor * self.excitation

    @property
    def amplitude_at_first_slip(self) -> float:
        """Amplitude (m) of the stuck resonance at first slip."""
        return self.factor * self.amplitude

    @property
    def locked(self) -> bool:
        """Whether nothing needs to slip under the excitation of the study."""
        return self.factor >= 1.0

    _states_all = True

    def _statement(self) -> Statement:
        own = amount(self.excitation, self.unit)
        subject = f"preload {amount(self.preload, 'N')}, stuck resonance {self.frequency:.4g} Hz"
        if np.isinf(self.factor):
            verdict = f"Friction can lock it under any excitation: {subject}"
        elif self.locked:
            verdict = f"Locked below {amount(self.force, self.unit)}: {subject}"
        else:
            verdict = f"Slips above {amount(self.force, self.unit)}: {subject}"
        rows = [
            Row("Locked amplitude", amount(self.amplitude, "m"), f"under {own}, if nothing slips")
        ]
        if np.isfinite(self.factor):
            rows.append(
                Row("Amplitude", amount(self.amplitude_at_first_slip, "m"), "at first slip")
            )
            rows.append(Row("Margin", f"{self.factor:.3g}", f"first slip over excitation ({own})"))
        if self.touching < self.factor:
            touching = amount(self.touching * self.excitation, self.unit)
            rows.append(Row("Touching", touching, "from here on points that are open at rest"))
        for name, (closed, points) in self.closed.items():
            rows.append(Row("Closed", f"{closed} of {points}", f"points of {name} at rest"))
        by_part = sorted(self.limiting.items(), key=lambda item: -item[1])
        for name, part in by_part:
            if part >= 0.01:
                rows.append(Row(f"Limit by {name}", percent(part)))
        remarks = [
            "Other residual forces give less: the limit is necessary, not sufficient, if normal and "
            "tangential motion are coupled; check with study.time_response",
        ]
        return Statement([verdict], rows, remarks=remarks)


def first_slip(
    case: LoadCase, frequency: tuple[float, float] | None = None, mode: int = 1
) -> FirstSlip:
    """See :meth:`bdamper.Study.first_slip`."""
    case = case.rest
    problem = case.problem
    refuse(problem.own_laws, "first slip")
    if not (problem.settings.separation and problem.settings.variable_normal_load):
        raise SettingError(
            "first_slip: expected contacts with separation and variable normal load, found a "
            "study without them"
        )
    interval = peak_interval(case, frequency, mode)
    warn_of_shroud(case, interval)
    peak = linear_peak(case, interval, stuck=True)
    validation.check(
        np.isfinite(peak.amplitude),
        "frequency",
        "an interval with a damped resonance of the stuck structure",
        f"{interval[0]:g} to {interval[1]:g} Hz without one",
    )
    programme = Programme.at(case, peak.frequency)
    limit = programme.solve()
    factor = limit.factor
    weight = limit.weight

    names = np.array(problem.coupling.interface_of)
    total = max(float(weight.sum()), 1e-300)
    limiting = {}
    for name in dict.fromkeys(names.tolist()):
        part = float(weight[names == name].sum()) / total
        if part > 0.0:
            limiting[name] = part
    excitation = problem.settings.excitation
    return FirstSlip(
        preload=case.preload,
        excitation=float(excitation.amplitude),
        unit=problem.settings.unit_of(excitation),
        factor=factor,
        frequency=peak.frequency,
        amplitude=peak.amplitude,
        limiting=limiting,
        touching=programme.touching(),
        closed=programme.partly_closed(),
    )


def residual_state(case: LoadCase, frequency: tuple[float, float]) -> Residual | None:
    """Return the residual forces with which the highest stuck resonance in an interval (Hz) slips last."""
    if not residual_forces.can_have(case.rest):
        return None
    peak = linear_peak(case.rest, frequency, stuck=True)
    if not np.isfinite(peak.amplitude):
        return None
    return residual_forces.at_resonance(case.rest, peak.frequency, peak.amplitude)
