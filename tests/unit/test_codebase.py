"""The house: which file may use what, and that the documents run."""

import ast
import re
import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "bdamper"

# every C file may include its own header and those on lower levels
C_LEVELS = [
    {"bd_types", "bd_lapack", "bd_vector"},
    {"bd_kernel"},
    {"bd_trig"},
    {"bd_element"},
    {"bd_lanes", "bd_slide", "bd_dispatch", "bd_event", "bd_sampled", "bd_disks"},
    {"bd_coulomb"},
    {"bd_contact"},
    {"bd_hbm"},
    {"bd_newton"},
    {"bd_coremodule"},
]
# every Python module may import from lower levels and its own
PYTHON_LEVELS = [
    {"errors", "brief", "expect", "model", "_core", "resultfile", "threads"},
    {"excitation"},
    {"checks", "wedge", "fe", "reduction", "aggregation"},
    {"io"},
    {"reference", "coupling"},
    {"stiffness", "staticcontact", "residual", "seating", "preload", "system", "misfit"}
    | {"reduced_contact", "friction_axes"},
    {"continuation", "branches", "branchsearch", "meanposition", "climb", "start", "progress", "disturbances"}
    | {"wavestability", "stability", "timedomain"},
    {"estimates", "settling"},
    {"response", "linear", "tracking"},
    {"peaksearch"},
    {"peaksensitivity"},
    {"peakbranch"},
    {"leastpeak"},
    {"peaks", "laws", "optimalcurve"},
    {"peakscan"},
    {"peakset"},
    {"leastenvelope"},
    {"optimal", "study", "vary", "sweep", "uncertainty", "effects", "indicator", "rivals", "advice", "carryover",
     "adaptive",
     "adaptive_curves", "accuracy", "results", "estimation", "tolerance"},
    {"prescribed", "microslip", "motion", "measured", "vtu"},
    {"plotting"},
]


def c_level(name: str) -> int:
    return next(i for i, names in enumerate(C_LEVELS) if name in names)


def imported(path: Path) -> set[str]:
    """Names of bdamper modules imported at the top level of a file."""
    out = set()
    for node in ast.parse(path.read_text()).body:
        if isinstance(node, ast.ImportFrom) and node.module:
            parts = node.module.split(".")
            if parts[0] == "bdamper":
                out |= {parts[1]} if len(parts) > 1 else {alias.name for alias in node.names}
        elif isinstance(node, ast.Import):
            out |= {a.name.split(".")[1] for a in node.names if a.name.startswith("bdamper.")}
    return out


@pytest.mark.parametrize("path", sorted((ROOT / "csrc").glob("*.[ch]")), ids=lambda p: p.name)
def test_c_includes_run_downward(path):
    text = path.read_text()
    assert ("Python.h" in re.findall(r"#include <([^>]+)>", text)) == (path.name == "bd_coremodule.c")
    for header in re.findall(r'#include "(bd_\w+)\.h"', text):
        assert header == path.stem or c_level(header) < c_level(path.stem), f"{path.name} includes {header}.h"


@pytest.mark.parametrize("path", sorted((ROOT / "csrc").glob("*.c")), ids=lambda p: p.name)
def test_allocation_only_where_things_are_made(path):
    """malloc and calloc stand only in functions called *_create; the binding uses Python's allocator."""
    function = ""
    for line in path.read_text().splitlines():
        match = re.match(r"^[a-z].*?\b(\w+)\(", line)
        if match:
            function = match.group(1)
        if re.search(r"\b(malloc|calloc|realloc)\(", line):
            assert function.endswith("_create"), f"{path.name}: allocation in {function}"


def python_files() -> list[Path]:
    return sorted(p for p in PACKAGE.rglob("*.py") if p.name != "__init__.py")


def module_name(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


@pytest.mark.parametrize("path", python_files(), ids=lambda p: str(p.relative_to(PACKAGE)))
def test_python_imports_run_downward(path):
    levels = {name: i for i, names in enumerate(PYTHON_LEVELS) for name in names}
    own = module_name(path)
    assert own in levels, f"{own} has no level in this test"
    for name in imported(path) - {own}:
        assert levels.get(name, -1) <= levels[own], f"{own} imports {name}, which is above it"


def test_only_the_room_of_pictures_imports_matplotlib_and_pyvista():
    """Types included: results say nothing of axes and figures."""
    pattern = re.compile(r"^\s*(import|from) (matplotlib|mpl_toolkits|pyvista)\b", re.M)
    assert {module_name(p) for p in python_files() if pattern.search(p.read_text())} == {"plot"}


def test_the_only_upward_reach_is_the_registry_of_pictures():
    """No other module of the package is imported by its name."""
    named = {
        str(path.relative_to(PACKAGE)): argument
        for path in python_files()
        for argument in re.findall(r"(?:import_module|__import__)\((.*?)\)", path.read_text())
    }
    assert named == {"util/plotting.py": '"bdamper.plot"', "io/nastran.py": "module"}  # the latter are pyNastran's


def test_only_system_imports_the_core():
    users = {p.name for p in python_files() if re.search(r"import _core|from bdamper\._core", p.read_text())}
    assert users == {"system.py"}


def test_importing_bdamper_does_not_load_matplotlib(tmp_path):
    import subprocess
    import sys

    code = "import sys, bdamper; sys.exit('matplotlib' in sys.modules or 'skfem' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=False).returncode == 0


def test_readme_code_runs(tmp_path, monkeypatch, capsys):
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.S)
    assert blocks, "the README shows no code"
    script = tmp_path / "readme.py"
    script.write_text("\n".join(blocks))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    runpy.run_path(str(script))
    assert "peak" in capsys.readouterr().out


def test_no_machine_paths_in_texts():
    for path in [*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *python_files(), *ROOT.glob("csrc/*")]:
        assert not re.search(r"(?<![\w.])/(home|root|work)/", path.read_text()), path
