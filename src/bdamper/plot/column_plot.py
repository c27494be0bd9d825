"""Columns of a result over another column, with labels and units by their annotated types (:mod:`bdamper.util.tables`)."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes

from bdamper.util.tables import FEW_ROWS, Tabular, label, quantities

LOGARITHMIC = ("N", "m", "J")
"""Units of which axes are logarithmic where the values are positive and the largest is more than five times the least."""


def draw_table(ax: Axes, table: Tabular, x: str, y: str, *, rows: Any = slice(None), **style: Any) -> None:
    """Draw a field or property of a result over another one.

    Axes that have labels keep them.  No line leads from one branch to another, and a value between two that are not known
    is a point.  A ratio is shown in per cent.

    Parameters
    ----------
    ax : matplotlib axes
    table : Tabular
    x, y : str
    rows : index
        Of those that are drawn.
    style
        Of the line, as matplotlib's ``plot`` takes it.
    """
    values = {name: (100.0 if name.endswith("ratio") else 1.0) * np.array(getattr(table, name), float) for name in (x, y)}
    branch = np.broadcast_to(getattr(table, "branch", 0), values[x].shape)[rows]
    apart = np.flatnonzero(np.diff(branch)) + 1
    across, up = (np.insert(column[rows], apart, np.nan) for column in values.values())
    look = {"color": "0.1", "marker": "o" if len(across) <= FEW_ROWS else "", "markersize": 3.5, **style}
    ax.plot(across, up, **look)
    known = np.isfinite(across + up)
    beside = np.concatenate([[False], known, [False]])
    alone = known & ~beside[:-2] & ~beside[2:]
    if alone.any() and not look["marker"]:
        ax.plot(across[alone], up[alone], ".", color=look["color"])
    kind: Any = type(table)
    for name, axis, scale in ((x, ax.xaxis, ax.set_xscale), (y, ax.yaxis, ax.set_yscale)):
        if not axis.get_label_text():
            axis.set_label_text(label(kind, name, "%" if name.endswith("ratio") else ""))
        mark = quantities(kind).get(name)
        least, most = np.nanmin(values[name], initial=np.inf), np.nanmax(values[name], initial=0.0)
        if mark is not None and mark.unit in LOGARITHMIC and most > 5.0 * least > 0.0:
            scale("log")
