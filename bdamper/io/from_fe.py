"""A model from the full matrices of finite element bodies in one call."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from bdamper.io.build import BuiltModel, build_model
from bdamper.io.contact_faces import ContactFaces
from bdamper.io.fe_body import FEBody
from bdamper.io.matrices import read_arrays
from bdamper.util import validate
from bdamper.util.errors import SettingError

_PARTS = ("dofs", "sets", "elements")


def from_fe(
    stiffness: Any,
    mass: Any,
    nodes: Any,
    *,
    contacts: Sequence[ContactFaces],
    elements: Any = (),
    dofs: Any = None,
    sets: Mapping[str, Any] | None = None,
    damper: Mapping[str, Any] | None = None,
    n_blades: int = 1,
    **settings: Any,
) -> BuiltModel:
    """A model from the full matrices of a blade (with its sector) and of a damper, checked, reduced and reported.

    Parameters
    ----------
    stiffness, mass : (n_eq, n_eq) array, sparse matrix or file
        Of one sector, or of the whole structure (``n_blades=1``).
    nodes : (n_nodes, 3) float, (numbers, positions) or file
        Positions alone are numbered from 0.
    contacts : sequence of :class:`bdamper.io.ContactFaces`
    elements : (n, 4 | 6 | 8 | 10 | 15 | 20) int, tuple of these or file, optional
        Node numbers of solid elements, by which faces are found from sets of nodes.  Hexahedra: four corners in turn around
        one face, then the four opposite ones in the same turn (corner 5 is joined to corner 1), then the nodes between
        corners in any order; wedges alike with three.  Another order is refused.
    dofs : (n_eq, 2) int or file, optional
        Node number and component (1, 2, 3) of each row; three rows a node by default.  Missing components are fixed.
    sets : mapping of name to node numbers (n,), faces (n, 3 | 4 | 6 | 8) or file, optional
    damper : mapping, optional
        "stiffness", "mass", "nodes" and, if need be, "elements", "dofs", "sets" of a free body.
    n_blades : int
    **settings
        Of :func:`bdamper.io.build_model`: ``sector_faces``, ``fixed``, ``locations``, ``engine_order``, ``units`` ...

    Returns
    -------
    BuiltModel
        ``model``, and ``report``, which it prints.

    Raises
    ------
    ModelError, SettingError
        At the first thing that is wrong, naming it, what was expected and what was found.
    """
    blade = _body(stiffness, mass, nodes, elements=elements, dofs=dofs, sets=sets)
    other = None
    if damper is not None:
        given = dict(validate.mapping("damper", damper, ("stiffness", "mass", "nodes", *_PARTS), "parts"))
        missing = [name for name in ("stiffness", "mass", "nodes") if name not in given]
        if missing:
            raise SettingError(f"damper: expected stiffness, mass and nodes, found no {missing[0]}")
        other = _body(**given)
    return build_model(blade, other, n_blades=n_blades, contacts=contacts, **settings)


def _body(stiffness: Any, mass: Any, nodes: Any, **parts: Any) -> FEBody:
    if isinstance(nodes, np.ndarray) and nodes.ndim == 2:
        nodes = (np.arange(len(nodes)), nodes)
    if isinstance(parts.get("elements"), np.ndarray):
        parts["elements"] = (parts["elements"],)
    return read_arrays(stiffness, mass, nodes, **parts)
