"""Structure of the code: direction of imports, who may use what, and names in the documents."""

import ast
import gc
import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pytest

from tests.each import each

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "bdamper"

# every C file may include its own header and those on lower levels
C_LEVELS = [
    {"util/conventions", "util/cost", "util/lapack", "util/storage", "util/vector_types", "util/clock"},
    {"util/kernels", "contact/user_law", "solver/equations"},
    {"util/matrix_products", "util/kernel_choice", "util/trig_polynomial", "contact/shipped_laws", "solver/dense",
     "solver/newton"},
    {"contact/element"},
    {"contact/force_derivative", "time/integration"},
    {"time/contact_law", "time/modal_motion"},
    {"time/contact_newton"},
    {"time/generalised_alpha", "contact/aft", "contact/aft_kernel", "contact/coupled_kernel", "contact/event_slider",
     "contact/friction_disks"},
    {"contact/event_driven", "contact/sticking_slider", "contact/user_law_aft"},
    {"contact/coupled_friction"},
    {"contact/evaluator"},
    {"balance/harmonic_balance"},
    {"balance/condensation"},
    {"balance/sector", "balance/speed_family", "bladed_disk/cyclic_elimination"},
    {"balance/nonlinear_mode", "bladed_disk/wheel_equations"},
    {"bladed_disk/bordered_solution"},
    {"binding/binding"},
    {f"binding/{name}" for name in (
        "arguments", "contact_functions", "equations_type", "integration_type", "module", "sector_types", "wheel_type",
    )},
]  # fmt: skip
# a room may import from itself and from those behind it in this list, never from those before it
ROOMS = [
    "__main__", "__init__", "plot", "lumped_masses", "study", "mistuning", "analyses", "time_domain", "response", "fatigue",
    "harmonic_balance", "importers", "contact", "fem", "model", "util",
]  # fmt: skip


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
    """What a file is asked for here."""

    docstring: str
    imports: tuple[tuple[str, int], ...]
    """Modules of bdamper, with the line, imported anywhere: at the top, inside functions, for types, or by importlib."""
    libraries: frozenset[str]
    private_of_others: tuple[str, ...]


@cache
def tree(path: Path) -> ast.Module:
    """Each file is parsed once; its tree is kept out of the garbage collector's sight, which it would slow down."""
    module = ast.parse(path.read_text())
    gc.freeze()
    return module


@cache
def nodes_of(path: Path) -> tuple[ast.AST, ...]:
    """Each file is walked once."""
    nodes = tuple(ast.walk(tree(path)))
    gc.freeze()
    return nodes


@cache
def contents(path: Path) -> Contents:
    module, nodes = tree(path), nodes_of(path)
    own = own_names(nodes)
    found, libraries, wrong = [], set(), []
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
            names = [
                arg.value
                for arg in node.args
                if isinstance(arg, ast.Constant) and isinstance(arg.value, str)
            ]
        elif isinstance(node, ast.Attribute) and private(node.attr) and node.attr not in own:
            wrong += (
                []
                if last_name(node.value) in ("self", "cls")
                else [f"{path}:{node.lineno} {ast.unparse(node)}"]
            )
        found += [
            (name.removeprefix("bdamper").removeprefix(".") or "__init__", node.lineno)
            for name in names
            if name == "bdamper" or name.startswith("bdamper.")
        ]
    return Contents(
        ast.get_docstring(module) or "", tuple(found), frozenset(libraries), tuple(wrong)
    )


def last_name(node: ast.expr) -> str:
    return node.attr if isinstance(node, ast.Attribute) else getattr(node, "id", "")


def imports(path: Path) -> tuple[tuple[str, int], ...]:
    return contents(path).imports


def room(module: str) -> str:
    return module.split(".")[0]


@each("path", sorted((ROOT / "csrc").glob("*/*.[ch]")), ids=lambda p: p.name)
def test_c_includes_run_downward(path):
    text = path.read_text()
    assert ("Python.h" in re.findall(r"#include <([^>]+)>", text)) == (path.name == "binding.h")
    name = f"{path.parent.name}/{path.stem}"
    headers = re.findall(r'#include "([^"]+)\.h"', text)
    wrong = [header for header in headers if header != name and c_level(header) >= c_level(name)]
    assert not wrong, f"{name} includes {wrong}"


@each("path", sorted((ROOT / "csrc").glob("*/*.c")), ids=lambda p: p.name)
def test_allocation_only_where_things_are_made(path):
    """malloc and calloc stand only in functions called *_create; the binding uses Python's allocator."""
    function = ""
    for line in path.read_text().splitlines():
        match = re.match(r"^[a-z].*?\b(\w+)\(", line)
        if match:
            function = match.group(1)
        if re.search(r"\b(malloc|calloc|realloc)\(", line):
            assert function.endswith("_create"), f"{path.name}: allocation in {function}"


@pytest.mark.slow
def test_imports_run_downward():
    wrong = []
    for path in python_files():
        own = module_name(path)
        for name, line in imports(path):
            if name == "_core" or room(name) == room(own):
                continue
            if ROOMS.index(room(name)) < ROOMS.index(room(own)):
                wrong.append(f"{path.relative_to(ROOT)}:{line} imports {name}, which is above it")
    assert not wrong, "\n".join(wrong)


@pytest.mark.slow
def test_no_circle_of_imports():
    """Within rooms too, and whether or not the import happens when the module is loaded."""
    users = {
        module_name(p): {name for name, _ in imports(p) if name in MODULES} for p in python_files()
    }
    users = {own: {n for n in names if n != own} for own, names in users.items()}
    while ends := {own for own, names in users.items() if not names & users.keys()}:
        users = {own: names for own, names in users.items() if own not in ends}
    assert not users, "these import each other in a circle, or import one that does: " + ", ".join(
        sorted(users)
    )


OF_RESULTS = ("_headline", "_facts", "_summary_fields", "_facts_of_field", "_with_problem")
"""What results and studies offer to the modules of the package but not to users."""


def private(name: str) -> bool:
    return (
        name.startswith("_")
        and not name.startswith("__")
        and name not in ("_core", "_replace", *OF_RESULTS)
    )


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
    return {
        room(module_name(path))
        for path in python_files()
        if contents(path).libraries & {*libraries}
    }


def test_only_plot_imports_matplotlib():
    assert users_of("matplotlib") == {"plot"}


def test_only_the_equations_import_the_core():
    users = {
        module_name(path) for path in python_files() for name, _ in imports(path) if name == "_core"
    }
    assert users == {
        "contact.laws", "harmonic_balance.equations", "harmonic_balance.rotor_speed",
        "analyses.nonlinear_mode", "harmonic_balance.sector", "time_domain.integration",
    }  # fmt: skip


def test_every_room_says_what_it_does():
    for path in PACKAGE.glob("*/__init__.py"):
        assert len(contents(path).docstring.splitlines()) >= 3, (
            f"{path.relative_to(ROOT)}: expected some five lines"
        )


def test_tests_mirror_the_rooms():
    rooms = {path.parent.name for path in PACKAGE.glob("*/__init__.py")}
    across = {
        "anchors",
        "c",
        "core",
        "data",
        "examples",
        "fuzz",
        "golden",
        "hard",
        "others",
        "physics",
        "unit",
    }
    folders = {path.parent.name for path in (ROOT / "tests").glob("*/test_*.py")}
    assert folders - across <= rooms


# ---- what stands in one place ----


def is_string(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


def is_text(node: ast.AST) -> bool:
    return isinstance(node, ast.Expr) and is_string(node.value)


def constants(path: Path) -> list[tuple[str, str]]:
    """Names in capitals that a module assigns, with what each is given."""
    found = []
    for node in tree(path).body:
        if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None:
            target = node.targets[0] if isinstance(node, ast.Assign) else node.target
            names = target.elts if isinstance(target, ast.Tuple) else [target]
            several = isinstance(node.value, ast.Tuple) and len(names) > 1
            values = node.value.elts if several else [node.value] * len(names)
            for name, value in zip(names, values):
                if isinstance(name, ast.Name) and name.id.isupper():
                    found.append((name.id, ast.unparse(value if several else node.value)))
    return found


def test_a_name_has_one_value_in_its_room():
    """A public name in capitals is assigned once in a room; another room may mean something else by it."""
    where: dict[tuple[str, str], set[str]] = {}
    for path in python_files():
        for name, _ in constants(path):
            if not name.startswith("_") and len(name) > 1:  # type variables have one letter
                where.setdefault((room(module_name(path)), name), set()).add(module_name(path))
    found = {key: modules for key, modules in where.items() if len(modules) > 1}
    assert not found, found


def spelled(node: ast.expr) -> str:
    """``a.b.c`` as it is written; :func:`ast.unparse`, which takes ten times as long, for all else."""
    names, inner = [], node
    while isinstance(inner, ast.Attribute):
        names.append(inner.attr)
        inner = inner.value
    return (
        ".".join([inner.id, *reversed(names)]) if isinstance(inner, ast.Name) else ast.unparse(node)
    )


@cache
def calls(path: Path) -> set[str]:
    """What a file calls: as it is written, and with the module that a name was imported from or stands for."""
    nodes, full = nodes_of(path), {}
    for node in nodes:
        if isinstance(node, ast.ImportFrom):
            full |= {
                alias.asname or alias.name: f"{node.module}.{alias.name}" for alias in node.names
            }
        elif isinstance(node, ast.Import):
            full |= {alias.asname: alias.name for alias in node.names if alias.asname}
    written = {spelled(node.func) for node in nodes if isinstance(node, ast.Call)}
    heads = {call: call.split(".")[0] for call in written}
    return written | {
        full.get(head, head) + call.removeprefix(head) for call, head in heads.items()
    }


def callers(pattern: str) -> set[str]:
    return {
        module_name(p) for p in python_files() if any(re.search(pattern, call) for call in calls(p))
    }


ONE_OF_EACH = {
    # linear equations outside the core: statics, fits, reductions, and what still has a Newton method of its own
    r"linalg\.(solve\w*|lstsq|inv|pinv|lu_\w+|cho_\w+|get_lapack_funcs|spsolve\w*|splu|spilu|factorized)$": {
        # the step of a static state along its friction cones, and its complementarity problem
        "contact.friction_step", "contact.complementarity",
        "contact.static_state", "contact.static_contact", "contact.residual_flexibility", "contact.stiffness",
        "analyses.fit", "harmonic_balance.problem", "analyses.loop_fit", "analyses.error_estimates",
        "harmonic_balance.rotor_speed", "harmonic_balance.sector", "importers.abaqus", "importers.bodies",
        "model.kinematics", "model.modal_basis", "model.validation", "fem.element_stress", "fem.factorisation",
        "fem.reduced_bodies", "fem.sector_inside",
        "fem.local_basis", "fem.contact_patches", "time_domain.integration",
        "mistuning.peak_search",
        "response.richer_peak",
    },
    # the Newton method of the core, and the elimination of a wheel
    r"\bcore\.(correct|peak|solve)$": {"harmonic_balance.equations"},
    # a corrected point: the follower, its starts and events, what verifies a solution; and wheels
    r"system\.(correct|correct_at|solve)$|^correct$": {
        "response.branches", "response.events", "response.continuation",
        "analyses.response_residuals", "response.sensitivity",
        "analyses.error_estimates", "analyses.flutter", "analyses.nonlinear_mode",
        "response.highest_peak", "response.peak",
        "analyses.engine_order_line", "mistuning.peak_search", "mistuning.disk_problem", "mistuning.bladed_disk",
        "response.richer_peak",
    },
    # HDF5
    r"create_dataset$|create_group$": {"util.records"},
}  # fmt: skip
"""Calls, and the modules that may make them; the lists shall become shorter."""


@pytest.mark.parametrize("pattern", list(ONE_OF_EACH))
def test_one_of_each(pattern):
    found = callers(pattern)
    assert found, "the pattern finds nothing"
    assert found <= ONE_OF_EACH[pattern], f"use what there is: {found - ONE_OF_EACH[pattern]}"


# ---- objects that are made stay as they are ----

WRITES: dict[str, int] = {}
"""Writes to ``__dict__`` and ``__class__`` that are left."""


# ---- words ----

ANY = {
    "analyses": 4, "contact": 1, "fatigue": 2, "harmonic_balance": 2, "lumped_masses": 6, "model": 1, "plot": 3,
    "response": 2,
    "util": 17,
}  # fmt: skip
"""Public parameters whose type is left open, by room: they shall become fewer."""


def open_parameters(module: ast.Module) -> list[str]:
    """Parameters of public functions and methods that are annotated with ``Any`` alone."""
    found = []
    bodies = [module.body, *(node.body for node in module.body if isinstance(node, ast.ClassDef))]
    for node in (node for body in bodies for node in body):
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
            given = node.args.posonlyargs + node.args.args + node.args.kwonlyargs
            found += [
                f"{node.name}({a.arg})"
                for a in given
                if a.annotation and ast.unparse(a.annotation) == "Any"
            ]
    return found


def above(limits: dict[str, int], find: Callable[[Path], list[str]]) -> dict[str, list[str]]:
    """Return what is found in rooms that have more of it than their limit."""
    found: dict[str, list[str]] = {}
    for path in python_files():
        found.setdefault(room(module_name(path)), []).extend(find(path))
    return {name: items for name, items in found.items() if len(items) > limits.get(name, 0)}


def test_public_functions_say_what_they_take():
    assert not above(ANY, lambda path: open_parameters(tree(path)))


@cache
def docstrings(path: Path) -> list[tuple[str, str]]:
    """Names and texts: docstrings, and texts under a constant or a field."""
    found = []
    for node in nodes_of(path):
        for child in (
            getattr(node, "body", []) if isinstance(getattr(node, "body", None), list) else []
        ):
            if is_text(child):
                found.append((getattr(node, "name", ""), child.value.value))
    return found


def test_the_stub_of_the_core_names_all_of_it():
    from bdamper import _core

    stub = ast.parse((PACKAGE / "_core.pyi").read_text())
    classes = {node.name: node for node in stub.body if isinstance(node, ast.ClassDef)}
    functions = {node.name for node in stub.body if isinstance(node, ast.FunctionDef)}
    values = {
        node.target.id
        for node in stub.body
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name)
    }
    public = {name for name in functions | values | set(classes) if not name.startswith("_")}
    assert public == {name for name in dir(_core) if not name.startswith("__")}
    for name, node in classes.items():
        kind = getattr(_core, name, None)
        if kind is None:  # shared by all classes of the stub
            continue
        body = [
            *node.body,
            *(
                n
                for base in node.bases
                if (above := classes.get(last_name(base)))
                for n in above.body
            ),
        ]
        members = {n.name for n in body if isinstance(n, ast.FunctionDef)}
        members |= {n.target.id for n in body if isinstance(n, ast.AnnAssign)}
        skipped = {"n_fields", "n_sequence_fields", "n_unnamed_fields", "count", "index"}
        there = {n for n in vars(kind) if not n.startswith("_")} - (
            skipped if issubclass(kind, tuple) else set()
        )
        assert {n for n in members if not n.startswith("__")} == there, name


def test_no_machine_paths_in_texts():
    for path in [
        *ROOT.glob("*.md"),
        *ROOT.glob("docs/**/*.md"),
        *python_files(),
        *ROOT.glob("csrc/*/*.[ch]"),
    ]:
        if os.sep + "_build" + os.sep not in str(path):
            assert not re.search(r"(?<![\w.])/(home|root|work)/", path.read_text()), path


def defines(path: Path, name: str) -> bool:
    """Whether a file of Python or C defines a function or class; ``A.b`` asks for both."""
    text = path.read_text()
    return all(
        re.search(rf"^(?:\s*(?:def|class) |\w[\w *]*\b){part}\b[(:\[]", text, re.M)
        for part in name.split(".")
    )


def pages() -> list[Path]:
    """Pages of the manual, its evidence and the specification."""
    return [
        *ROOT.glob("docs/*.md"),
        *ROOT.glob("docs/evidence/*.md"),
        *ROOT.glob("docs/specification/*.md"),
    ]


def test_files_and_functions_that_the_documents_name_are_there():
    missing = []
    rooms = "bdamper|csrc|tests|tools|examples|benchmarks"
    for path in [*ROOT.glob("*.md"), *pages()]:
        if path.name != "CHANGELOG.md":
            for name, function in re.findall(
                rf"`((?:{rooms})/[\w/]+\.\w+)(?:::([\w.]+))?`", path.read_text()
            ):
                if not (ROOT / name).exists() or (function and not defines(ROOT / name, function)):
                    missing.append(f"{path.relative_to(ROOT)}: {name} {function}")
    assert not missing, "\n".join(missing)


def test_the_code_index_and_the_page_of_equations_name_existing_files():
    """The index may name paths relative to bdamper."""
    contributing = (ROOT / "CONTRIBUTING.md").read_text()
    _, found, rest = contributing.partition("\n## Where to find\n")
    assert found, "no section 'Where to find'"
    index = rest.partition("\n## ")[0]
    equations = (ROOT / "docs/evidence/equations.md").read_text()
    missing = []
    for text, folders in ((index, (ROOT, PACKAGE)), (equations, (ROOT,))):
        for name in re.findall(r"`([\w./-]+\.(?:py|pyi|c|h|md))(?:::[\w.]+)?`", text):
            if not any((folder / name).is_file() for folder in folders):
                missing.append(name)
        # functions that the index names before their file
        for function, name in re.findall(
            r"`(\w+)`(?: \([^)]*\))? in `([\w./-]+\.(?:py|c|h))`", text
        ):
            paths = [folder / name for folder in folders if (folder / name).is_file()]
            if paths and not re.search(rf"\b{function}\b", paths[0].read_text()):
                missing.append(f"{function} in {name}")
    assert not missing, "\n".join(missing)


def test_tests_that_the_scripts_run_are_there():
    for path in [ROOT / "Makefile", ROOT / ".ci" / "run", *ROOT.glob("tools/*.sh")]:
        for name in (
            re.findall(r"(?<![\w./])tests/[\w/]+(?:\.py|\b)", path.read_text())
            if path.exists()
            else []
        ):
            assert any(ROOT.glob(f"{name}*")), f"{path.name}: {name}"


def test_modules_that_the_documents_name_are_there():
    import importlib

    for path in [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *pages(), *python_files()]:
        for name in set(re.findall(r"(?<![\w./])bdamper(?:\.[a-z_][a-z_0-9]*)+", path.read_text())):
            parts = name.split(".")
            n = max(n for n in range(1, len(parts) + 1) if ".".join(parts[1:n]) in MODULES | {""})
            found = importlib.import_module(".".join(parts[:n]))
            for part in parts[n:]:
                assert hasattr(found, part), (
                    f"{path.relative_to(ROOT)} names {name}, which is not there"
                )
                found = getattr(found, part)
