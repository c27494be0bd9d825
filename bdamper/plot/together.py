"""Several results on the same axes: designs, studies, measurements."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes

from bdamper.continuation.curve import Curve
from bdamper.design.compare import DesignComparison
from bdamper.effects.hysteresis import Dissipation, Hysteresis
from bdamper.io.measured import Measurement
from bdamper.peaks.optimal_curve import OptimalCurve
from bdamper.plot.axes import MARKERS, STYLES, colours, drawing
from bdamper.plot.curves import PRELOAD, plot_curves, plot_measurement
from bdamper.plot.hysteresis import OF_WHOLE
from bdamper.util import validate
from bdamper.util.plotting import draws

QUANTITIES = {
    "amplitude": "Resonance amplitude (m)",
    "shift": "Frequency shift (%)",
    "damping_ratio": "Equivalent damping ratio (%)",
    "stiffness": "Equivalent contact stiffness (N/m)",
}
OF = {
    Curve: ("amplitude",),
    OptimalCurve: ("amplitude", "shift"),
    Dissipation: ("damping_ratio", "stiffness"),
    Hysteresis: ("loop",),
}
"""What can be drawn of each kind of result."""


def plot_together(
    results: Mapping[str, Curve] | Mapping[str, OptimalCurve] | Mapping[str, Dissipation] | Mapping[str, Hysteresis],
    quantity: str | None = None,
    ax: Axes | None = None,
    *,
    measured: Sequence[Measurement] = (),
    title: str = "",
) -> Axes:
    """Several results of one kind on the same axes.

    Parameters
    ----------
    results : mapping of name to result
        Tracking curves over frequency, optimal curves over preload, dissipation over amplitude, or loops of all contacts
        over the response.
    quantity : str, optional
        "amplitude" or "shift" (of frequency) of optimal curves, "damping_ratio" or "stiffness" of dissipation.
    ax : matplotlib axes, optional
    measured : sequence of Measurement
        Laid over tracking curves.
    title : str

    Returns
    -------
    matplotlib axes
        Stars mark optima, filled where whole tracking curves have verified them; lines end where there is no value.
    """
    validate.that(isinstance(results, Mapping) and results, "results", "a mapping of one or more names to results", results)
    kind = next((kind for kind in OF if all(isinstance(result, kind) for result in results.values())), None)
    if kind is None:
        found = [type(result).__name__ for result in results.values()]
        kinds = "tracking curves, optimal curves, dissipations or hysteresis, all of one kind"
        raise validate.unfit("results", kinds, found)
    quantity = validate.choice("quantity", quantity or OF[kind][0], OF[kind])
    if isinstance(measured, Measurement) or (measured and kind is not Curve):
        raise validate.unfit("measured", "a sequence of Measurement, over tracking curves", measured)
    if kind is Curve:
        ax = plot_curves(list(results.values()), ax, labels=_labels(results), title=title)  # type: ignore[arg-type]
        for one in measured:
            plot_measurement(one, ax)
        return ax
    with drawing(ax, title=title, legend=7.0) as ax:
        for i, ((name, result), colour) in enumerate(zip(results.items(), colours(len(results)))):
            x, y = _values(result, quantity)
            known = np.flatnonzero(np.isfinite(y))
            if kind is Hysteresis:
                ax.plot(x, y, linestyle=STYLES[i % len(STYLES)], color=colour, label=name)
                continue
            ax.plot(x, y, linestyle=STYLES[i % len(STYLES)], color=colour, marker=MARKERS[i % len(MARKERS)], markersize=3.0,
                    markevery=known[:: max(1, len(known) // 8)].tolist(), label=name)  # fmt: skip
            if isinstance(result, OptimalCurve) and quantity == "amplitude" and np.isfinite(result.optimum.preload):
                o = result.optimum
                ax.plot(o.preload, o.amplitude, "*", color=colour, markersize=8.0,
                        markerfacecolor=colour if o.verified else "w")  # fmt: skip
        if kind is Hysteresis:
            ax.set(**OF_WHOLE)
            return ax
        ax.set(xlabel=PRELOAD if kind is OptimalCurve else "Response amplitude (m)", ylabel=QUANTITIES[quantity])
        ax.set(xscale="log", yscale="log" if quantity == "amplitude" else "linear")
        if quantity == "amplitude":
            optima = [result.optimum.verified for result in results.values() if isinstance(result, OptimalCurve)]
            for verified, label in ((True, "optimum"), (False, "least value, not verified")):
                if verified in optima:
                    face = "k" if verified else "w"
                    ax.plot([], [], "*", color="k", markersize=8.0, markerfacecolor=face, label=label)
    return ax


def _labels(results: Mapping[str, object]) -> list[str]:
    """Names of the tracking curves; limits without contact and with all contacts stuck have their own."""
    return [name for name, curve in results.items() if isinstance(curve, Curve) and curve.kind == "tracking"]


def _values(result: object, quantity: str) -> tuple[np.ndarray, np.ndarray]:
    if isinstance(result, Dissipation):
        x, y = result.amplitude, 100.0 * result.damping_ratio if quantity == "damping_ratio" else result.stiffness
        apart = np.flatnonzero(np.diff(result.branch) != 0) + 1  # no line from one branch to another
        return np.insert(x, apart, np.nan), np.insert(y, apart, np.nan)
    if isinstance(result, Hysteresis):
        return result.loop()
    assert isinstance(result, OptimalCurve)
    return result.preload, result.amplitude if quantity == "amplitude" else result.shift_percent


@draws(DesignComparison)
def plot_designs(
    comparison: DesignComparison,
    quantity: str | None = None,
    ax: Axes | None = None,
    *,
    measured: Sequence[Measurement] = (),
    title: str = "",
) -> Axes:
    """All designs of a comparison on the same axes, as :func:`plot_together` draws them."""
    title = title or (f"preload {comparison.curves[0].preload:g} N" if comparison.curves else "")
    return plot_together(comparison.results, quantity, ax, measured=measured, title=title)
