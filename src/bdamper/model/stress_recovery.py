"""Stress of a body at chosen points, as rows that turn a solution into stress.

With the modal coordinates ``q_l`` of the body and the contact forces ``F_l`` on it, complex amplitudes of harmonic ``l``,

    sigma(theta) = Omega^2 sigma_1 + S_0 q_0 + A_0 F_0 + sum_(l>=1) Re[(S_l q_l + A_l F_l) exp(i l theta)],

``S = C B Phi`` the stress of the modes and ``A = C B (K^-1 P^H - Phi Omega^-2 Phi^H P^H)`` that of unit contact forces
beyond what the modes carry: without ``A`` ten modes miss a third of the stress at the root of a blade whose damper sticks.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from bdamper.model.fields import Data
from bdamper.util.short_repr import brief

COMPONENTS = ("xx", "yy", "zz", "xy", "yz", "xz")
"""Order of the six components of stress, along the axes of the body."""


@brief
@dataclass(frozen=True)
class StressSet:
    """Stress at some points of a constrained body.

    Parameters
    ----------
    name, body : str
    points : (n, 3) float, m
        Axes of the reference sector.
    modes : mapping of nodal diameter to (n, 6, n_modes) complex or float, Pa m^-1 kg^-1/2
        Stress of each mode of the body at that nodal diameter, components as in :data:`COMPONENTS`.
    contact : mapping of nodal diameter to (n, 6, 3 n_points) complex or float, Pa/N
        Stress of unit forces along t1, t2, n on the body at the contact points of all its ports, in the order of
        ``Body.ports``, beyond what all the modes of ``modes`` carry.  Empty for a body without contact.
    static : (n, 6) float, Pa s2, optional
        Of the centrifugal load, without dampers, per squared speed of rotation in rad/s.
    spread : (n,) float, optional
        Largest difference between the elements that meet at the point over the mean, of the von Mises stress of the first
        mode: a sign of the error of the mesh.
    near_contact : (n,) bool, optional
        Points on a contact face or next to one, where the stress is that of the patches; margins leave them out.
    source : str
    """

    name: str
    body: str
    points: Annotated[NDArray, Data("m", ("n", 3))]
    modes: Annotated[Mapping[int, NDArray], Data("Pa m^-1 kg^-1/2", ("n", 6, None), "field", "*/mode_stress")]
    contact: Annotated[Mapping[int, NDArray], Data("Pa/N", ("n", 6, "n_forces"), "field", "*/contact_stress")] = field(
        default_factory=dict
    )
    static: Annotated[NDArray, Data("Pa s2", ("n", 6), file="static_stress")] | None = None
    spread: Annotated[NDArray, Data("1", ("n",))] | None = None
    near_contact: Annotated[NDArray, Data("1", ("n",), "bool")] | None = None
    source: str = ""

    def __len__(self) -> int:
        return len(self.points)

    @property
    def counted(self) -> NDArray:
        """(n,) bool: points that margins count."""
        return np.ones(len(self), bool) if self.near_contact is None else ~self.near_contact
