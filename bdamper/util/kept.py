"""What a blade keeps: the highest motion that the march in time stays at, as a result carries it."""

from __future__ import annotations

from dataclasses import dataclass, field

from bdamper.util.cost import Cost
from bdamper.util.hdf5 import Recorded, Storable
from bdamper.util.plotting import Fact, Summarised, draw
from bdamper.util.repr import brief
from bdamper.util.status import COMPLETE
from bdamper.util.text import amount


@brief
@dataclass(frozen=True)
class Kept(Summarised, Recorded, Storable, kind="bdamper-kept"):
    """The highest amplitude that a blade keeps at one preload, by a march in time toward the tip of the response.

    Parameters
    ----------
    mean, lowest, highest : float, m
        Amplitude of the harmonic of the excitation: mean over the last periods, and of single periods among them.
    frequency, preload : float, Hz, N
    balance : float, m
        Highest peak of the harmonic balance, from beside which the march came.
    fall : float, Hz
        Where the motion fell to another level; NaN where it did not.
    direction : {"down", "up", ""}
        Way of the frequency; empty where nothing had to be marched.
    periods : int
        Marched in all.
    diameters : tuple of int
        Nodal diameters that took part.
    status : str
        "complete", "interrupted", or "incomplete: " and "not found: " with the reason.
    cost : Cost
    settings : mapping
    model_hash : str
    """

    mean: float
    lowest: float
    highest: float
    frequency: float
    preload: float
    balance: float
    fall: float = float("nan")
    direction: str = ""
    periods: int = 0
    diameters: tuple[int, ...] = ()
    status: str = COMPLETE
    cost: Cost = field(default_factory=Cost)

    @property
    def marched(self) -> bool:
        """Whether anything had to be marched."""
        return self.periods > 0

    @property
    def factor(self) -> float:
        """Highest period over the amplitude of the balance, by which stress of the balance is scaled."""
        return self.highest / self.balance

    @property
    def text(self) -> str:
        """Mean and range: "55 µm (53 to 58)"; the status where there is none."""
        if self.mean != self.mean:
            return self.status
        mean = amount(self.mean, "m")
        scale = float(mean.split()[0]) / self.mean
        return f"{mean} ({scale * self.lowest:.3g} to {scale * self.highest:.3g})"

    def mark(self, ax: object) -> object:
        """Draw mean and range as one point with a bar over response curves (:func:`bdamper.plot.mark_kept`)."""
        return draw(self, "mark", ax)

    def facts(self) -> tuple[Fact, ...]:
        """Amplitude with its range, and where the motion falls."""
        metres = (Fact(name, getattr(self, name), "m") for name in ("mean", "lowest", "highest", "balance"))
        others = Fact("frequency", self.frequency, "Hz"), Fact("fall", self.fall, "Hz"), Fact("preload", self.preload, "N")
        return (*metres, *others, Fact("nodal diameters", ", ".join(map(str, self.diameters))), Fact("status", self.status))

    def bottom_line(self) -> str:
        at = f"At {amount(self.preload, 'N')}"
        if self.mean != self.mean:
            why = self.status.partition(": ")[2] or self.status
            return f"{at} it is not known what a blade keeps, so nothing confirms the peak of the harmonic balance: {why}."
        peak = f"the peak of the harmonic balance is {amount(self.balance, 'm')}"
        doubt = f" ({self.status})" if self.status != COMPLETE else ""
        head = f"{at} a blade keeps {self.text} at {amount(self.frequency, 'Hz', 6)}; {peak}{doubt}."
        if not self.marched:
            return f"{head} Contacts stay closed and no fold is near, so it is kept."
        return head if self.fall != self.fall else f"{head} The motion falls at {amount(self.fall, 'Hz', 6)}."
