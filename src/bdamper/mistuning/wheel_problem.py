"""The equations of a wheel: a study of all blades and dampers at once, before any analysis of them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.study_dispatch import Asking, like, problem_of
from bdamper.mistuning.loaded_wheel import Loaded, loaded, wheel_system
from bdamper.mistuning.mistuning import DamperVariation, Mistuning
from bdamper.mistuning.structure import Structure
from bdamper.mistuning.wheel_equations import WheelSystem
from bdamper.response.highest_peak import highest_peak
from bdamper.response.peak import Peak
from bdamper.util import validation
from bdamper.util.errors import SettingError
from bdamper.util.short_repr import brief
from bdamper.util.threading import one_thread


@brief
@dataclass(frozen=True, eq=False)
class WheelProblem:
    """A wheel with its equations at a preload; parameters are those of :class:`~bdamper.mistuning.wheel.BladedDisk`."""

    study: Asking | Problem
    mistuning: Mistuning | ArrayLike | None = None
    dampers: DamperVariation | None = None
    _tuned_peaks: dict[float, Peak] = field(default_factory=dict, repr=False)
    _states: dict[float, Loaded] = field(default_factory=dict, init=False, repr=False)
    _structure: Structure | None = field(default=None, repr=False)
    """Of nominal blades and dampers."""
    structure: Structure = field(init=False, repr=False)
    """Matrices of the wheel."""

    def __post_init__(self) -> None:
        problem = problem_of(self.study)
        n = self.study.model.n_blades
        mistuning, mass = Mistuning.of(n, self.mistuning), np.ones(n)
        if self.dampers is not None:
            validation.instance("dampers", self.dampers, DamperVariation)
            if self.dampers.n_blades != n:
                raise SettingError(f"dampers: expected {n} dampers, found {self.dampers.n_blades}")
            mass = self.dampers.mass
        nominal = Structure.of(problem) if self._structure is None else self._structure
        object.__setattr__(self, "mistuning", mistuning)
        object.__setattr__(self, "_structure", nominal)
        object.__setattr__(self, "structure", nominal.varied(mistuning, mass))

    def replace(self, **changes: Any) -> Self:
        """The same wheel with another ``mistuning`` or other ``dampers``; what does not change is shared."""
        for name in changes:
            validation.choice("settings of a wheel", name, ("mistuning", "dampers"))
        return replace(self, **changes)

    @property
    def n_blades(self) -> int:
        return self.study.model.n_blades

    @property
    def deviation(self) -> NDArray:
        """(n_blades, n_modes) float: frequency deviations of the blades."""
        return Mistuning.of(self.n_blades, self.mistuning).deviation.reshape(self.n_blades, -1)

    def tuned(self) -> Asking | Problem:
        """The study of one sector that spans the same space as this wheel, with the same contact stiffness."""
        return like(self.study, self.structure.tuned)

    @cached_property
    def excitation(self) -> NDArray:
        """(n_blades, n_sector) complex forces on the coordinates, first harmonic."""
        s, tuned = self.structure, self.structure.tuned
        e = tuned.settings.excitation
        plain = tuned.settings.acts_at_location and not e.beside
        validation.that(plain, "excitation of a wheel", "one force at a location", e)
        row = s.location_rows(e.location, e.direction, "excitation")
        n = np.arange(self.n_blades)
        turned = (int(tuned.engine_order) * n) % self.n_blades / self.n_blades
        wave = e.amplitude * np.exp(1j * e.phase + 2j * np.pi * turned)
        out = np.zeros((self.n_blades, s.n_sector), complex)
        out[:, : s.n] = np.outer(wave, row)
        if not out.any():
            raise SettingError(f"excitation: expected a force on the blades, found {e.amplitude:g} N at '{e.location}'")
        return out

    @cached_property
    def response_row(self) -> NDArray:
        """(n,) blade coordinates to the response."""
        place = self.structure.tuned.settings.response_location
        return self.structure.location_rows(place.location, place.direction, "response")

    def state(self, preload: float) -> Loaded:
        """The static state under a preload (N)."""
        preload = self.structure.tuned.check_preload(preload)
        if preload not in self._states:
            self._states[preload] = loaded(self.structure, preload, self.dampers)
        return self._states[preload]

    def system(self, preload: float) -> WheelSystem:
        """Equations at a preload (N), with counts of their own."""
        return wheel_system(self.structure, self.state(preload), self.excitation, self.response_row)

    @one_thread
    def tuned_peak(self, preload: float) -> Peak:
        """Highest peak of the tuned wheel at a preload, by its one sector; its amplitude is NaN where there is none."""
        if preload not in self._tuned_peaks:
            peak = highest_peak(self.structure.tuned, preload)
            self._tuned_peaks[preload] = peak if peak.converged else replace(peak, amplitude=np.nan)
        return self._tuned_peaks[preload]

    def record(self) -> dict[str, Any]:
        """Record of the wheel for all results."""
        own = {"mistuning": str(self.mistuning), "dampers": str(self.dampers), "deviation": self.deviation.tolist()}
        return {"settings": self.structure.tuned.record() | own, "model_hash": self.study.model.hash}

    def __str__(self) -> str:
        s = self.structure
        lines = [
            f"wheel of {self.n_blades} blades, {s.n} coordinates each, {s.n_damper} of each damper",
            f"  {self.mistuning}",
            f"  {self.dampers or 'dampers all alike'}",
            *(f"  {line}" for line in str(s.tuned).split("\n")),
        ]
        return "\n".join(lines)
