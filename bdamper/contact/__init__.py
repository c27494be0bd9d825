"""Contact points: laws, stiffness, static preload, and the range of forces in a wedge.

In: a :class:`bdamper.model.coupling.Coupling` and friction coefficients.  Out: `contact_stiffness` by Eqs (1) to (11) of
the paper and by other methods, with residual modes where they are asked for; `static_state`, the quasi-static contact
analysis of section 3.1; `PointArrays`, the parameters of all points under one of the `LAW_...` numbers as the equations
of motion take them; `wedge_friction`, the range of normal forces that statics leaves open; `ContactMap`, a static state
over the faces.
"""

from bdamper.contact.laws import Sampled
from bdamper.contact.points import PointArrays
from bdamper.contact.preload import PreloadState, StaticSystem, static_state
from bdamper.contact.preload_forces import solve_static_contact, static_contact_problem
from bdamper.contact.residual_modes import ResidualModes
from bdamper.contact.stiffness import PerArea, contact_stiffness
from bdamper.contact.wedge import ContactMap, wedge_friction

__all__ = [
    "ContactMap",
    "PerArea",
    "PointArrays",
    "PreloadState",
    "ResidualModes",
    "Sampled",
    "StaticSystem",
    "contact_stiffness",
    "solve_static_contact",
    "static_contact_problem",
    "static_state",
    "wedge_friction",
]
