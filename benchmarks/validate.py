"""Public problems beside the answers of the package: ``make validate`` or ``python -m benchmarks.validate``.

Computes the problems of ``tests/validated.py`` and writes ``docs/evidence/validated.md``, with a picture of each.
Ends with an error where a number is beyond its tolerance without the page saying why.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

import matplotlib
import matplotlib.pyplot as plt

import bdamper as bd
from bdamper.plot import save_figure
from bdamper.plot.axes import STYLE, fit_units, legend_beside
from tests.validated import NEEDS, PROBLEMS, Problem, available

matplotlib.use("Agg")
DOCS = Path(__file__).parents[1] / "docs"
HEAD = """# Validated against

*Evidence: you do not need this page to use bdamper.*

Which published problems and closed-form solutions does bdamper reproduce? `make validate` computes
them again and writes this page. The values agree within the tolerances of `tests/validated.py`
(1e-10 to 5 %); where one does not, the reason is given.
"""
TAIL = """## Elsewhere

Frequencies at several rotor speeds compared with CalculiX: `tests/anchors`; mistuned bladed disks:
`tests/mistuning`; amplitudes compared with an independent time integration:
[time integration](in-time.md); computing times compared with pyHarm: [comparisons](compared.md).
"""


def slug(name: str) -> str:
    """A name as a part of the name of a file."""
    return re.sub(r"\W+", "-", name.lower()).strip("-")


def section(name: str, problem: Problem) -> str:
    """One problem in Markdown."""
    lines = [f"## {name}\n", f"{problem.measure[0].upper()}{problem.measure[1:]}.\n", f"Source: {problem.source}.\n",
             "| quantity | bdamper | relative error |", "|---|---|---|"]  # fmt: skip
    for row in problem.rows:
        verdict = "" if row.agrees else f", **differs**: {row.differs}"
        lines.append(f"| {row.quantity} | {row.ours:.9g} | {row.error:.1e}{verdict} |")
    return "\n".join([*lines, f"\n![{name}](../images/validated-{slug(name)}.png)\n"])


def picture(name: str, problem: Problem) -> None:
    """The picture of one problem."""
    with plt.rc_context(STYLE):
        n = problem.panels
        size = (5.6, 3.6 if n == 1 else 1.2 + 1.9 * n)
        axes = plt.subplots(n, 1, sharex=True, squeeze=False, figsize=size)[1][:, 0]
        problem.draw(axes[0] if n == 1 else axes)
        legend_beside(axes[0])
        for ax in axes:
            fit_units(ax)
    save_figure(axes, DOCS / "images" / f"validated-{slug(name)}.png")


def main() -> None:
    """Compute, write, and say what is wrong."""
    missing = [name for name in PROBLEMS if not available(name)]
    if missing:
        sys.exit(
            "".join(
                f"validate: {name} cannot be computed here without {NEEDS[name][0]}\n"
                for name in missing
            )
        )
    parts, wrong = [HEAD], []
    for name, compute in PROBLEMS.items():
        problem = compute()
        parts.append(section(name, problem))
        picture(name, problem)
        wrong += [
            f"{name}: {row.quantity}, error {row.error:.1e}"
            for row in problem.rows
            if row.agrees == bool(row.differs)
        ]
        print(
            f"{name}: {sum(row.agrees for row in problem.rows)} of {len(problem.rows)} numbers agree",
            flush=True,
        )
    (DOCS / "evidence" / "validated.md").write_text("\n".join([*parts, TAIL]), encoding="utf-8")
    print(f"bdamper {bd.__version__}: docs/evidence/validated.md")
    if wrong:
        sys.exit("validate: " + "; ".join(wrong))


if __name__ == "__main__":
    main()
