"""Several results on the same axes: designs, studies, measurements."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, cast

import numpy as np
from matplotlib.axes import Axes

from bdamper.analyses.hysteresis import Hysteresis
from bdamper.analyses.study_comparison import Comparison
from bdamper.importers.measurements import Measurement
from bdamper.plot.axes import LIMITS, NEW, looks, once, picture
from bdamper.plot.column_plot import draw_table
from bdamper.plot.curves import plot_curves, plot_measurement
from bdamper.plot.hysteresis import OF_WHOLE
from bdamper.response.curve import ResponseCurve
from bdamper.response.optimal_curve_result import OptimalCurve
from bdamper.util import validation
from bdamper.util.display import draws

OF: dict[type, tuple[str, dict[str, str]]] = {
    ResponseCurve: ("frequency", {"amplitude": "amplitude"}),
    OptimalCurve: ("preload", {"amplitude": "amplitude", "shift": "shift_percent"}),
    Hysteresis: ("amplitude", {"damping_ratio": "damping_ratio", "stiffness": "stiffness"}),
}
"""Of each kind of result the column that it is drawn over, and what can be drawn, by the name of its quantity."""
OPTIMA = {True: "optimum", False: "least value, not verified"}


@picture()
def plot_together(
    results: Mapping[str, ResponseCurve] | Mapping[str, OptimalCurve] | Mapping[str, Hysteresis],
    quantity: str | None = None, ax: Axes = NEW, *, measured: Sequence[Measurement] = (),
) -> None:  # fmt: skip
    """Several results of one kind on the same axes.

    Stars mark optima, filled where whole response curves have verified them; lines end where there is no value.

    Parameters
    ----------
    results : mapping of name to result
        Response curves over frequency, optimal curves over preload, dissipation over amplitude, or loops of all contacts
        over the response.
    quantity : str, optional
        "amplitude" or "shift" (of frequency) of optimal curves, "damping_ratio" or "stiffness" of dissipation.
    measured : sequence of Measurement
        Laid over response curves.
    """
    validation.that(
        isinstance(results, Mapping) and results, "results", "a mapping of one or more names to results", results
    )
    kind = next((kind for kind in OF if all(isinstance(result, kind) for result in results.values())), None)
    if kind is None:
        found = [type(result).__name__ for result in results.values()]
        kinds = "response curves, optimal curves or hysteresis, all of one kind"
        raise validation.unfit("results", kinds, found)
    x, columns = OF[kind]
    quantity = validation.choice("quantity", quantity or next(iter(columns)), columns)
    if isinstance(measured, Measurement) or (measured and kind is not ResponseCurve):
        raise validation.unfit("measured", "a sequence of Measurement, over response curves", measured)
    if kind is ResponseCurve:
        curves = cast(Mapping[str, ResponseCurve], results)
        plot_curves(list(curves.values()), ax, labels=[name for name, curve in curves.items() if curve.kind not in LIMITS])
        for one in measured:
            plot_measurement(one, ax)
    result: Any
    for (name, result), look in zip(results.items(), looks(len(results))) if kind is not ResponseCurve else ():
        if isinstance(result, Hysteresis) and result.single:
            ax.plot(*result.loop(), **{**look, "marker": ""}, label=name)
            ax.set(**OF_WHOLE)
            continue
        y = columns[quantity]
        known = np.flatnonzero(np.isfinite(getattr(result, y)))
        draw_table(ax, result, x, y, **look, markevery=known[:: max(1, len(known) // 8)].tolist(), label=name)
        ax.set_xscale("log")
        if isinstance(result, OptimalCurve) and quantity == "amplitude":
            ax.set_yscale("log")
            _star(ax, result, look["color"])


def _star(ax: Axes, result: OptimalCurve, colour: Any) -> None:
    """The optimum, if there is one, filled where it is verified, with one name for all in the legend."""
    o = result.optimum
    if np.isfinite(o.preload):
        look = {"color": colour, "markersize": 8.0, "markerfacecolor": colour if o.verified else "w", "linestyle": "none"}
        ax.plot(o.preload, o.amplitude, marker="*", label=once(ax, OPTIMA[o.verified]), **look)


@draws(Comparison)
def plot_comparison(comparison: Comparison, *arguments: Any, **options: Any) -> Axes:
    """All results of a comparison on the same axes, as :func:`plot_together` draws them."""
    return cast(Axes, plot_together(comparison.results, *arguments, **options))
