"""No example, page or notebook studies a damper that rolls on its contact points.

The check is the first one of every optimal curve.  Here each study is examined as soon as an example makes it, and no
analysis runs.  Statements that need the result of an analysis are left out.
"""

import ast
import json
import re
import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import pytest

import bdamper as bd
import bdamper.importers
import bdamper.plot
from bdamper.harmonic_balance.rolling import rolling_dampers
from bdamper.harmonic_balance.study_boundary import problem_of

ROOT = Path(__file__).resolve().parents[2]
MAKES_STUDIES = {"replace", "at_speed", "model", "excitation", "preload", "stiffness_report"}
"""Public names of a study that run no analysis."""
MAKES_MODELS = {"reference_model", "lumped", "joint", "sample", "load_model"}
"""Functions of the package that run no analysis."""


class LeftOutError(Exception):
    """An analysis that does not run here."""


def leave_out(*args, **kwargs):
    raise LeftOutError


def examples():
    """Scripts, pages and notebooks, except for figures of the paper, whose friction coefficient is 0.46,
    and for scripts that read or build finite element models.
    """
    builds = ("contact_point_convergence.py", "make_converged.py", "own_sector.py")
    scripts = [
        path
        for path in sorted((ROOT / "examples").glob("*.py"))
        if not path.name.startswith("fig") and path.name not in builds
    ]
    pages = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
    pages += sorted((ROOT / "docs" / "evidence").glob("*.md"))
    notebooks = sorted((ROOT / "notebooks").glob("*.ipynb"))
    return [*scripts, *(page for page in pages if "```py" in page.read_text()), *notebooks]


def code_of(path):
    """Python of a script, of the blocks of a page, or of the cells of a notebook."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".py":
        return text
    if path.suffix == ".ipynb":
        cells = json.loads(text)["cells"]
        code = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
        told = "\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] != "code")
        # the code of other files stands in the text
        text = "\n".join([*code, *re.findall(r"```python\n(.*?)```", told, re.S)])
    else:
        text = "\n".join(re.findall(r"```py(?:thon)?\n(.*?)```", text, re.S))
    return re.sub(r"^%.*$", "", text, flags=re.M)


@pytest.fixture
def studies(monkeypatch):
    """Studies that are made, in their order; analyses raise an error."""
    made = []
    create, derive = bd.Study.__init__, bd.Study._with_problem

    def created(self, *args, **kwargs):
        create(self, *args, **kwargs)
        made.append(self)

    def derived(self, problem):
        made.append(derive(self, problem))
        return made[-1]

    monkeypatch.setattr(bd.Study, "__init__", created)
    monkeypatch.setattr(bd.Study, "_with_problem", derived)
    for name in vars(bd.Study):
        if not name.startswith("_") and name not in MAKES_STUDIES:
            monkeypatch.setattr(bd.Study, name, leave_out)
    for name in bd.__all__:
        analysis = name.islower() and callable(getattr(bd, name)) and name not in MAKES_MODELS
        if analysis or name == "BladedDisk":
            monkeypatch.setattr(bd, name, leave_out)
    for name in ("build_model", "read_calculix", "example_decks"):
        monkeypatch.setattr(bdamper.importers, name, leave_out)
    return made


def run_without_analyses(path):
    """Run the statements of an example, except for those that need a result."""
    names = {"__name__": "__main__", "__file__": str(path)}
    ran, left_out = 0, 0
    for statement in ast.parse(code_of(path)).body:
        try:
            exec(compile(ast.Module([statement], []), path.name, "exec"), names)
            ran += 1
        except Exception:
            # an analysis, or a statement that needs its result
            left_out += 1
            if left_out == 1:
                # a page may go on with the names of another one
                with pytest.raises((LeftOutError, NameError)):
                    raise
    return ran


@pytest.mark.slow
@pytest.mark.parametrize("path", examples(), ids=lambda path: path.name)
def test_dampers_of_examples_do_not_roll(path, studies, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [str(path)])
    monkeypatch.syspath_prepend(str(ROOT / "examples"))
    assert run_without_analyses(path) > 0
    rolling = {}
    for study in studies:
        problem = problem_of(study)
        doubts = rolling_dampers(problem) if problem.model.interfaces else ()
        if doubts:
            rolling[str(problem.settings.friction_coefficient)] = doubts
    assert not rolling
