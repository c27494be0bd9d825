"""The house: which room may use what, sizes, who may import what, and that the documents run."""

import ast
import os
import re
import runpy
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "bdamper"

# every C file may include its own header and those on lower levels
C_LEVELS = [
    {"bd_types", "bd_lapack", "bd_vector", "bd_clock"},
    {"bd_kernel"},
    {"bd_trig"},
    {"bd_element"},
    {"bd_time", "bd_rate"},
    {"bd_lanes", "bd_slide", "bd_time_loop", "bd_dispatch", "bd_march", "bd_sampled", "bd_disks"},
    {"bd_event", "bd_rest"},
    {"bd_coulomb"},
    {"bd_contact"},
    {"bd_hbm"},
    {"bd_equations", "bd_wheel", "bd_family"},
    {"bd_dense", "bd_solver"},
    {"bd_core"},
    {"bd_core_arguments", "bd_core_equations", "bd_core_sector", "bd_core_contact", "bd_core_time", "bd_core_wheel",
     "bd_coremodule"},
]
# a room may import from itself and from those behind it in this list, never from those before it
ROOMS = [
    "__init__", "masses", "study", "plot", "wheel", "speed", "design", "accuracy", "effects", "peaks", "fatigue",
    "stability", "continuation", "problem", "harmonic_balance", "contact", "shipped", "fe", "io", "reduction", "model",
    "util",
]  # fmt: skip
UPWARD = {("util.plotting", "plot")}
"""The registry of pictures, which bdamper.plot fills, is asked from below: the only arrow that runs upward."""
LONGEST_MODULE, LONGEST_FUNCTION = 600, 80


def c_level(name: str) -> int:
    return next(i for i, names in enumerate(C_LEVELS) if name in names)


@cache
def python_files() -> tuple[Path, ...]:
    return tuple(sorted(PACKAGE.rglob("*.py")))


def module_name(path: Path) -> str:
    """``room.module``, or the room for its ``__init__``."""
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" and len(parts) > 1 else parts)


MODULES = {module_name(path) for path in python_files()} | {"_core"}


@dataclass
class Contents:
    """What a file is asked for here: strings alone, as a tree of every file slows down whatever collects garbage later."""

    docstring: str
    imports: tuple[tuple[str, int], ...]
    """Modules of bdamper, with the line, imported anywhere: at the top, inside functions, for types, or by importlib."""
    libraries: frozenset[str]
    long_functions: tuple[str, ...]
    private_of_others: tuple[str, ...]


@cache
def contents(path: Path) -> Contents:
    """Each file is parsed and walked once."""
    module = ast.parse(path.read_text())
    nodes = tuple(ast.walk(module))
    own = own_names(nodes)
    found, libraries, long, wrong = [], set(), [], []
    for node in nodes:
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
            libraries |= {name.split(".")[0] for name in names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            above = node.module or ""
            libraries.add(above.split(".")[0])
            below = [f"{above}.{alias.name}" for alias in node.names]
            names = [name if name.removeprefix("bdamper.") in MODULES else above for name in below]
            if above.startswith("bdamper"):
                wrong += [f"{path}:{node.lineno} {a.name}" for a in node.names if private(a.name)]
        elif isinstance(node, ast.Call) and last_name(node.func) == "import_module":
            names = [arg.value for arg in node.args if isinstance(arg, ast.Constant) and isinstance(arg.value, str)]
        elif isinstance(node, ast.FunctionDef):
            lines = (node.end_lineno or 0) - node.lineno + 1
            if lines > LONGEST_FUNCTION:
                long.append(f"{path}: {node.name} has {lines} lines")
        elif isinstance(node, ast.Attribute) and private(node.attr) and node.attr not in own:
            wrong += [] if last_name(node.value) in ("self", "cls") else [f"{path}:{node.lineno} {ast.unparse(node)}"]
        found += [
            (name.removeprefix("bdamper").removeprefix(".") or "__init__", node.lineno)
            for name in names
            if name == "bdamper" or name.startswith("bdamper.")
        ]
    return Contents(ast.get_docstring(module) or "", tuple(found), frozenset(libraries), tuple(long), tuple(wrong))


def last_name(node: ast.expr) -> str:
    return node.attr if isinstance(node, ast.Attribute) else getattr(node, "id", "")


def imports(path: Path) -> tuple[tuple[str, int], ...]:
    return contents(path).imports


def room(module: str) -> str:
    return module.split(".")[0]


@pytest.mark.parametrize("path", sorted((ROOT / "csrc").glob("*.[ch]")), ids=lambda p: p.name)
def test_c_includes_run_downward(path):
    text = path.read_text()
    assert ("Python.h" in re.findall(r"#include <([^>]+)>", text)) == (path.name == "bd_core.h")
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


def test_imports_run_downward():
    wrong = []
    for path in python_files():
        own = module_name(path)
        for name, line in imports(path):
            if name == "_core" or room(name) == room(own) or (own, name) in UPWARD:
                continue
            if ROOMS.index(room(name)) < ROOMS.index(room(own)):
                wrong.append(f"{path.relative_to(ROOT)}:{line} imports {name}, which is above it")
    assert not wrong, "\n".join(wrong)


def test_no_circle_of_imports():
    """Within rooms too, and whether or not the import happens when the module is loaded."""
    users = {module_name(p): {name for name, _ in imports(p) if name in MODULES} for p in python_files()}
    users = {own: {n for n in names if n != own and (own, n) not in UPWARD} for own, names in users.items()}
    while ends := {own for own, names in users.items() if not names & users.keys()}:
        users = {own: names for own, names in users.items() if own not in ends}
    assert not users, "these import each other in a circle, or import one that does: " + ", ".join(sorted(users))


def test_the_guard_sees_late_imports_and_those_for_types(tmp_path):
    path = tmp_path / "late.py"
    path.write_text(
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from bdamper.study import Study\n"
        "def f():\n    from bdamper import plot\n    import importlib\n    importlib.import_module('bdamper.peaks')\n"
    )
    assert {name for name, _ in imports(path)} == {"study", "plot", "peaks"}


def test_modules_and_functions_stay_short():
    long = []
    for path in python_files():
        lines = len(path.read_text().splitlines())
        if lines > LONGEST_MODULE:
            long.append(f"{path.relative_to(ROOT)}: {lines} lines")
        long += contents(path).long_functions
    assert not long, "\n".join(long)


def private(name: str) -> bool:
    return name.startswith("_") and not name.startswith("__") and name not in ("_core", "_replace")


def own_names(nodes: tuple[ast.AST, ...]) -> set[str]:
    """Functions, fields and attributes that a module defines itself."""
    out = set()
    for node in nodes:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            out.add(node.name)
        elif isinstance(node, ast.AnnAssign | ast.Assign):
            for target in node.targets if isinstance(node, ast.Assign) else [node.target]:
                out |= {target.id} if isinstance(target, ast.Name) else set()
                if isinstance(target, ast.Attribute) and getattr(target.value, "id", "") == "self":
                    out.add(target.attr)
    return out


def test_nobody_uses_private_names_of_others():
    wrong = [line for path in python_files() for line in contents(path).private_of_others]
    assert not wrong, "\n".join(wrong)


def users_of(*libraries: str) -> set[str]:
    """Rooms that import a library anywhere."""
    return {room(module_name(path)) for path in python_files() if contents(path).libraries & {*libraries}}


def test_only_plot_imports_matplotlib_and_pyvista():
    assert users_of("matplotlib", "pyvista") == {"plot"}


def test_only_the_equations_import_the_core():
    users = {module_name(path) for path in python_files() for name, _ in imports(path) if name == "_core"}
    assert users == {
        "harmonic_balance.family", "harmonic_balance.system", "harmonic_balance.many_points", "stability.time_integration",
    }  # fmt: skip


def test_every_room_says_what_it_does():
    for path in PACKAGE.glob("*/__init__.py"):
        assert len(contents(path).docstring.splitlines()) >= 3, f"{path.relative_to(ROOT)}: expected some five lines"


def test_tests_mirror_the_rooms():
    rooms = {path.parent.name for path in PACKAGE.glob("*/__init__.py")}
    across = {"anchors", "c", "core", "data", "examples", "fuzz", "golden", "hard", "physics", "unit"}
    folders = {path.parent.name for path in (ROOT / "tests").glob("*/test_*.py")}
    assert folders - across <= rooms


@pytest.mark.slow
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
        if os.sep + "_build" + os.sep not in str(path):
            assert not re.search(r"(?<![\w.])/(home|root|work)/", path.read_text()), path


def defines(path: Path, name: str) -> bool:
    """Whether a file of Python or C defines a function or class; ``A.b`` asks for both."""
    text = path.read_text()
    return all(re.search(rf"^(?:\s*(?:def|class) |\w[\w *]*\b){part}\b[(:\[]", text, re.M) for part in name.split("."))


def test_files_and_functions_that_the_documents_name_are_there():
    missing = []
    rooms = "bdamper|csrc|tests|tools|examples|benchmarks"
    for path in [*ROOT.glob("*.md"), *ROOT.glob("docs/*.md")]:
        if path.name != "CHANGELOG.md":
            for name, function in re.findall(rf"`((?:{rooms})/[\w/]+\.\w+)(?:::([\w.]+))?`", path.read_text()):
                if not (ROOT / name).exists() or (function and not defines(ROOT / name, function)):
                    missing.append(f"{path.relative_to(ROOT)}: {name} {function}")
    assert not missing, "\n".join(missing)


def test_modules_that_the_documents_name_are_there():
    import importlib

    for path in [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *ROOT.glob("docs/*.md"), *python_files()]:
        for name in set(re.findall(r"(?<![\w./])bdamper(?:\.[a-z_][a-z_0-9]*)+", path.read_text())):
            parts = name.split(".")
            n = max(n for n in range(1, len(parts) + 1) if ".".join(parts[1:n]) in MODULES | {""})
            found = importlib.import_module(".".join(parts[:n]))
            for part in parts[n:]:
                assert hasattr(found, part), f"{path.relative_to(ROOT)} names {name}, which is not there"
                found = getattr(found, part)
