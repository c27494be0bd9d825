"""Optimal damper of a turbine blade: the preload with the lowest resonance, its checks, and
figures.

The script prints the study, its optimal curve and the response at the optimum, and writes
``optimum.png`` and ``response.png``, the figures of the README and of the first page (``python
examples/demo.py --figures docs/images``).
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

import bdamper as bd
from bdamper.plot import new_axes, plot_curves, plot_optimal, save_figure
from bdamper.response.optimal_curve_result import OptimalCurve
from bdamper.response.response_curve_result import ResponseCurve

BAND = (610.0, 710.0)
FACTORS = (0.6, 1.0, 2.0, 5.0)
"""Preloads of the response curves, relative to the optimum."""


def random(optimal: OptimalCurve, curves: list[ResponseCurve]) -> str:
    """Return the values shown in the figures with four digits, as a text that is stored with them
    and shows their age.
    """
    o = optimal.optimum
    numbers = {
        "optimum": [o.preload, o.amplitude, o.frequency], "free": optimal.free.amplitude,
        "amplitude": optimal.amplitude[optimal.requested].tolist(),
        "peaks": [[c.preload, c.peak.frequency, c.peak.amplitude] for c in curves],
    }  # fmt: skip
    return json.dumps(
        json.loads(json.dumps(numbers), parse_float=lambda text: float(f"{float(text):.4g}")),
        indent=1,
    )


def main(
    figures: Path = Path("figures"),
    preload: tuple[float, float] = (30.0, 1000.0),
    n: int = 12,
    check: str | bool = "time",
) -> tuple[OptimalCurve, list[ResponseCurve]]:
    """Run the demonstration, and return the optimal curve and the response curves, the limits
    first.
    """
    figures.mkdir(parents=True, exist_ok=True)
    started = time.perf_counter()
    study = bd.Study(
        bd.reference_model("turbine_blade"),
        engine_order=5,
        friction_coefficient=0.3,
        excitation=bd.Excitation("tip", direction="tangential", amplitude=1.0),
    )
    optimal = study.optimal_curve(preload, n, check=check)
    print(optimal, end="\n\n")
    loads = [float(f"{factor * optimal.optimum.preload:.2g}") for factor in FACTORS]
    curves = [
        study.free(BAND),
        study.stuck(BAND),
        *(study.frequency_response(load, BAND) for load in loads),
    ]
    print(curves[3], end="\n\n")
    gain = optimal.free.amplitude / optimal.optimum.amplitude
    title = f"The right preload: {gain:.2g} times less vibration (excitation 1 N on each blade)"
    save_figure(plot_optimal(optimal, new_axes(4.4, 3.2), title=title), figures / "optimum.png")
    save_figure(plot_curves(curves), figures / "response.png")
    (figures / "optimum.json").write_text(random(optimal, curves) + "\n")
    print(
        f"wrote optimum.png and response.png in {figures}; {time.perf_counter() - started:.0f} s in all"
    )
    return optimal, curves


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--figures", type=Path, default=Path("figures"), help="where to write figures"
    )
    main(parser.parse_args().figures)
