"""A nonlinear mode as a result."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from bdamper.util import validation
from bdamper.util.cost import Cost
from bdamper.util.differences import Comparable
from bdamper.util.display import Plottable
from bdamper.util.errors import SettingError
from bdamper.util.formatting import amount, height
from bdamper.util.short_repr import brief
from bdamper.util.storage import Recorded, Storable
from bdamper.util.tables import ROW, Followed, Hertz, Kinds, Numbers, PerRow, Quantity, Shares, Tabular


@brief
@dataclass(frozen=True)
class NonlinearMode(Plottable, Comparable, Followed, Tabular, Recorded, Storable, kind="bdamper-nonlinear-mode"):
    """Free vibration of a structure with friction: frequency and damping over its amplitude.

    Every point is a converged periodic motion.  ``plot`` draws both over the amplitude
    (:func:`bdamper.plot.plot_nonlinear_mode`).

    Parameters
    ----------
    frequency, damping_ratio : (n,) float, Hz and 1
        The latter of the force in proportion to mass times velocity that would keep the motion up.
    harmonics : (n, n_harmonics + 1) complex, m
        Of the response; the first column is the mean.
    unknowns : (n, n_unknowns) float
        Modal coordinates (kg^1/2 m): mean, then cosine and sine amplitudes of each harmonic.
    correlation : (n,) float
        MAC of the first harmonic with the mode of stuck contact.
    shares : (n, 3) float
        Stick, slip and open, mean over the friction points and the cycle.
    residual, branch : (n,) float and int
    point_kind : tuple of str
        "regular", "fold" (the amplitude turns), "maximum" (of the damping), "end" or "drift".
    linear_to : float, m
        Amplitude up to which nothing slips or opens; NaN where something does at the lowest one.
    preload, mode : float (N) and int
    scales_to : float, N
        Highest preload that the same curve serves (:meth:`at_preload`); 0 if it serves no other one.
    status, reason, cost, settings, model_hash
        As of a response curve.
    """

    frequency: Hertz
    damping_ratio: Annotated[NDArray, Quantity("", "Modal damping ratio")]
    harmonics: Annotated[NDArray, Quantity("m", dims=(ROW, "harmonic"))]
    unknowns: PerRow
    correlation: Numbers
    shares: Shares
    residual: Numbers
    branch: Numbers
    point_kind: Kinds
    linear_to: float
    preload: float
    mode: int
    scales_to: float
    status: str
    reason: str
    cost: Cost
    _summary_fields = ("mode", "preload", "status", "folds", "linear_to", "scales_to")

    @property
    def folds(self) -> NDArray:
        """(k,) int: points at which the amplitude turns."""
        return np.array([i for i, kind in enumerate(self.point_kind) if kind == "fold"], int)

    def at(self, amplitude: float) -> list[tuple[float, float]]:
        """Frequency (Hz) and damping ratio of all motions with an amplitude (m), in the order of the branch.

        Between points they are interpolated along the logarithm of the amplitude.
        """
        a = np.log(self.amplitude / validation.number("amplitude", amplitude, above=0.0, unit="m"))
        i = np.flatnonzero((a[:-1] * a[1:] <= 0.0) & (a[1:] != 0.0) & (self.branch[:-1] == self.branch[1:]))
        part = a[i] / (a[i] - a[i + 1])
        f, zeta = (x[i] + part * (x[i + 1] - x[i]) for x in (self.frequency, self.damping_ratio))
        return list(zip(f.tolist(), zeta.tolist()))

    def at_preload(self, preload: float) -> NonlinearMode:
        """The same mode at another preload, with which all displacements and forces grow in proportion.

        Raises
        ------
        SettingError
            If gaps that close, interference, cubic springs or forces that do not grow with the preload take part.
        """
        preload = validation.number("preload", preload, above=0.0, unit="N")
        if preload > self.scales_to:
            found = f"one that scales to {self.scales_to:.6g} N" if self.scales_to else "one that does not scale"
            raise SettingError(
                f"preload: expected a mode that scales to {preload:.6g} N, without interference, cubic springs, constant "
                f"forces and gaps that close, found {found}; compute it there"
            )
        s = preload / self.preload
        return replace(
            self, preload=preload, harmonics=s * self.harmonics, unknowns=s * self.unknowns, linear_to=s * self.linear_to
        )

    def _headline(self) -> str:
        if not len(self):
            return f"No motion of mode {self.mode} was found: {self.reason}."
        top, where = int(np.argmax(self.damping_ratio)), f"under a preload of {amount(self.preload, 'N')}"
        edge = ", an end of the range" if top in (0, len(self) - 1) else ""
        return (
            f"Damping of mode {self.mode} {where}: at most {amount(100.0 * self.damping_ratio[top], '%')}, with "
            f"{height(self.amplitude[top], self.frequency[top])}{edge}; the frequency lies between "
            f"{amount(self.frequency.min(), 'Hz')} and {amount(self.frequency.max(), 'Hz')}."
            + ("" if self.complete else f" The mode is {self.status}: {self.reason}.")
        )
