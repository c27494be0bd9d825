"""Printed results of the README and the manual.

``python -m tools.manual_results`` runs the Python blocks of the pages below, and writes what they
print today into the pages:

* README.md has the first paragraphs of the optimal curve of docs/index.md, docs/index.md the others.
* docs/accuracy.md shortens its results.  The tool prints them in full, to shorten them by hand.

Names of pages as arguments select some of them.  ``python -m tools.manual_results --show PAGE ...``
prints all results of any pages and notebooks, block by block, and writes nothing.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import os
import re
import tempfile
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt

ROOT = Path(__file__).resolve().parents[1]
README, INDEX = ROOT / "README.md", ROOT / "docs" / "index.md"
ABOVE = 2
"""Paragraphs of the printed optimal curve that the README shows: headline, and rows of values."""
TIMES = re.compile(r"\s\((?:[a-z\s]*[\d.]+ [mk]?s(?:,\s+)?)+\)")
"""Times of the checks of an optimum."""
RESULT = re.compile(r"(?<=^```\n)[^`]*?(?=^```$)", re.M)
"""Content of a block without a language: commands, or a printed result."""


def code_of(page: Path) -> list[str]:
    """Return the Python blocks of a page, or the code cells of a notebook."""
    text = page.read_text(encoding="utf-8")
    if page.suffix == ".ipynb":
        cells = json.loads(text)["cells"]
        code = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
        # commands of the notebook itself are no Python
        return [re.sub(r"^%.*$", "", text, flags=re.M) for text in code]
    return re.findall(r"```python\n(.*?)```", text, re.S)


def printed_by(page: Path) -> list[str]:
    """Run a page in an empty folder, and return what each of its blocks prints."""
    printed = []
    names: dict[str, object] = {"__name__": "__main__", "display": print}
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        for number, code in enumerate(code_of(page), 1):
            output = io.StringIO()
            with contextlib.redirect_stdout(output):
                exec(compile(code, f"{page.name}, block {number}", "exec"), names)
            plt.close("all")
            printed.append(output.getvalue())
    return printed


def split(printed: str) -> tuple[str, str]:
    """Return the paragraphs of an optimal curve that the README shows, and those of the manual."""
    paragraphs = printed.rstrip("\n").split("\n\n")
    return "\n\n".join(paragraphs[:ABOVE]) + "\n", "\n\n".join(paragraphs[ABOVE:]) + "\n"


def write_result(page: Path, words: str, result: str) -> None:
    """Replace the printed result of a page that contains some words."""
    text = page.read_text(encoding="utf-8")
    (shown,) = (block for block in RESULT.findall(text) if words in block)
    page.write_text(text.replace(shown, result), encoding="utf-8")


def index() -> None:
    """Write the optimal curve of the first pages."""
    above, below = split(printed_by(INDEX)[0])
    write_result(README, "Harmonic balance", above)
    # the times of checks are those of this computer
    write_result(INDEX, "checks passed", TIMES.sub("", below))


def show(page: Path) -> None:
    """Print what the blocks of a page print."""
    for number, text in enumerate(printed_by(page), 1):
        print(f"---- {page.relative_to(ROOT)}, block {number}\n{text}", flush=True)


PAGES = {"index": index, "accuracy": lambda: show(ROOT / "docs" / "accuracy.md")}


def main() -> None:
    """Write the pages that are asked for, or show what they print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--show", action="store_true", help="print results, and write nothing")
    parser.add_argument(
        "pages", nargs="*", help=f"out of {', '.join(PAGES)}; with --show any paths"
    )
    arguments = parser.parse_args()
    # generated models are those of the tests
    os.environ.setdefault("BDAMPER_MODELS", str(ROOT / "tests" / "models"))
    if arguments.show:
        for page in arguments.pages:
            show(Path(page).resolve())
        return
    for name in arguments.pages or PAGES:
        PAGES[name]()


if __name__ == "__main__":
    main()
