"""How far estimated errors can be relied on, and what they cost, on random ordinary scenes.

``python -m benchmarks.estimate_scenes [first last]`` runs the scenes of these numbers (0 to 29 by default) and prints a
line for each source of error and a summary; ``make accuracy`` writes the summary into docs/evidence/measured.md.

A scene is one of :mod:`benchmarks.convergence_scenes` (models, modes, excitation, friction coefficient, preload) with one
or three harmonics, residual modes (two of three scenes) or unit tractions, five or ten blade modes and contact points that
are those of the model or a part of them.  Its number is the seed.

True is what the richer study that an estimate looks at gives on a whole curve of its own, followed from the other end of
the interval: the difference of the highest peaks of both curves.  Where the richer response is highest at an end and that
of the study is not, the interval of the richer curve reaches farther at both ends.  An estimate holds if it is within a
factor of two of the truth, or within 0.2 % of it.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass

import numpy as np

import bdamper as bd
from bdamper.analyses.error_estimates import richer_study
from bdamper.response.highest_peak import highest_of_curve
from bdamper.response.verification import SourceError
from benchmarks import convergence_scenes

SCENES = 30
SOURCES = ("harmonics", "contact points", "modes", "residual flexibility")
NEAR = 0.002
"""Difference from the truth that does not matter."""
BEYOND = 1.3
"""How much farther the interval of a truth reaches whose resonance has left that of the scene."""


@dataclass(frozen=True)
class Outcome:
    """An estimate, the true change (NaN if the richer curve is incomplete), and seconds of both and of the curve itself."""

    estimate: SourceError
    true: float
    seconds: float
    true_seconds: float
    curve_seconds: float

    @property
    def holds(self) -> bool:
        """Whether the estimate is the truth within a factor of two, or differs by nothing that matters."""
        size = self.estimate.size
        return bool(abs(size - self.true) <= NEAR or 0.5 <= size / self.true <= 2.0)


def draw(number: int) -> tuple[bd.Study, float, tuple[float, float], str]:
    """Study, preload (N), interval (Hz) and description of the scene of a number."""
    scene = convergence_scenes.draw(number)
    rng = np.random.default_rng([22, number])
    harmonics, modes = int(rng.choice([1, 3])), int(rng.choice([5, 10]))
    stiffness = str(rng.choice(["residual_modes", "residual_modes", "unit_traction"]))
    points = rng.choice([None, 4, 6])
    study = scene.study.replace(
        harmonics=harmonics,
        blade_modes=modes,
        contact_stiffness=stiffness,
        contact_points=points,
        damper_modes=0,
    )
    text = f"{scene.text.rsplit(',', 1)[0]}, {harmonics} harmonics, {stiffness}, {modes} modes, points {points or 'all'}"
    return study, scene.preload, scene.interval, text


def run(number: int, sources: tuple[str, ...] = SOURCES) -> list[Outcome]:
    """All estimates of a scene beside the truth; none where the scene has no whole curve."""
    study, preload, interval, text = draw(number)
    begin = time.process_time()
    curve = study.frequency_response(preload, interval)
    own = time.process_time() - begin
    print(
        f"{number}: {text}, {own:.2f} s" + ("" if curve.complete else f", {curve.status}"),
        flush=True,
    )
    out: list[Outcome] = []
    for source in sources if curve.complete else ():
        try:
            richer = richer_study(study.problem, source)
        except bd.BdamperError:
            continue
        if richer is None:
            continue
        begin = time.process_time()
        estimate = study.estimate_errors(curve, sources=[source])[source]
        middle = time.process_time()
        rich = study._with_problem(richer[0].replace())
        whole = rich.frequency_response(preload, interval)
        if whole.peak_at_end and not curve.peak_at_end:
            whole = rich.frequency_response(preload, (interval[0] / BEYOND, interval[1] * BEYOND))
        end = time.process_time()
        true = np.nan
        if whole.complete:
            pairs = (study.problem, curve), (richer[0], whole)
            top, highest = (highest_of_curve(p.system(preload), c).peak for p, c in pairs)
            true = max(
                abs(highest.amplitude / top.amplitude - 1.0),
                abs(highest.frequency / top.frequency - 1.0),
            )
        out.append(Outcome(estimate, true, middle - begin, end - middle, own))
        o = out[-1]
        verdict = (
            "not estimated"
            if not estimate.known
            else "no truth"
            if np.isnan(true)
            else "holds"
            if o.holds
            else "WRONG"
        )
        print(
            f"  {source}: {verdict}, estimated {estimate.size:.2g}, true {true:.2g}, {o.seconds:.2f} s and "
            f"{o.true_seconds:.2f} s ({estimate.against})",
            flush=True,
        )
    return out


def table(first: int = 0, last: int = SCENES - 1, sources: tuple[str, ...] = SOURCES) -> str:
    """Runs scenes and returns a summary in Markdown."""
    outcomes = [o for number in range(first, last + 1) for o in run(number, sources)]
    lines = [
        "| source | estimates | not known | checked | hold | time over that of the curve, median | of the richer curve |",
        "|---|---|---|---|---|---|---|",
    ]
    for name in (*SOURCES, "all"):
        own = [o for o in outcomes if name in (o.estimate.source, "all")]
        if not own:
            continue
        known = [o for o in own if o.estimate.known]
        checked = [o for o in known if np.isfinite(o.true)]
        times, whole = (float(np.median([t / o.curve_seconds for o, t in zip(own, ts)])) for ts in (
            [o.seconds for o in own], [o.true_seconds for o in own],
        ))  # fmt: skip
        lines.append(
            f"| {name} | {len(own)} | {len(own) - len(known)} | {len(checked)} | {sum(o.holds for o in checked)} | "
            f"{times:.2g} | {whole:.2g} |"
        )
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "numbers", nargs="*", type=int, default=[0, SCENES - 1], help="first and last scene"
    )
    parser.add_argument(
        "--source",
        choices=SOURCES,
        action="append",
        help="only this one; more than once for several",
    )
    given = parser.parse_args()
    print(table(*given.numbers, sources=tuple(given.source or SOURCES)))


if __name__ == "__main__":
    main()
