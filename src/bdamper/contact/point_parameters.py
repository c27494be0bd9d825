"""Parameters of the contact points, as the equations take them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from numpy.typing import NDArray

from bdamper.contact.user_laws import OwnLaws
from bdamper.util.short_repr import brief


@brief
@dataclass(frozen=True)
class PointArrays:
    """Parameters of all contact points, stacked.

    Parameters
    ----------
    kt : (n_points, 2) float, N/m
    kn : (n_points,) float, N/m
    mu, n0 : (n_points,) float
        Friction coefficient; normal load at zero closing (N), negative for a gap.
    slider : (n_points, 2) float, m
        An infinite slider asks for that end of the interval of admissible ones where a point never slips.
    law : (n_points,) int
        LAW_SEPARABLE, LAW_NORMAL (no friction), LAW_CONSTANT (friction limited by ``load``, two-sided normal spring),
        LAW_COUPLED, LAW_COUPLED_CONSTANT (friction force in a disk), LAW_BONDED (linear springs),
        LAW_CUBIC (``kt u^3`` along both tangential directions, kt in N/m3, and nothing else), LAW_USER (functions in
        ``own``, with kt and kn as springs while nothing slips).
    shift : (n_points, 3) float, m
        Constant part of (u1, u2, v) that the modes do not carry.
    load : (n_points,) float, N, optional
        Normal load that limits friction under the laws of constant load; ``n0`` by default.
    index : (n_points,) int, optional
        Contact point of the structure that each is made of; where two are made of one, the second one's normal force is
        taken off that of the first.
    own : OwnLaws, optional
    memory : (n_points, width) float, optional
        What points with functions of their own remember from the static state.
    """

    kt: NDArray
    kn: NDArray
    mu: NDArray
    n0: NDArray
    slider: NDArray
    law: NDArray
    shift: NDArray
    load: NDArray | None = None
    index: NDArray | None = None
    own: OwnLaws | None = None
    memory: NDArray | None = None

    def taken(self, index: NDArray) -> PointArrays:
        """The points numbered ``index`` (n,), in this order and as often as they are named, without ``load``."""
        names = ("kt", "kn", "mu", "n0", "slider", "law", "shift")
        arrays: dict[str, Any] = {name: getattr(self, name)[index] for name in names}
        return replace(self, **arrays, load=None, index=index)
