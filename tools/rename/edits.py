"""Edits by hand after the move: post.py ROOT"""
import pathlib, re, sys
root = pathlib.Path(sys.argv[1]); pkg = root / "src/bdamper"
def sub(path, old, new, n=1):
    p = root / path; s = p.read_text()
    assert old in s, (path, old)
    p.write_text(s.replace(old, new) if n == 0 else s.replace(old, new, n))
HEADS = {
"fem": '''"""Finite element structures reduced to modes and static flexibility, and generated models.

`CyclicSector` and `FreeBody` reduce the matrices of one body to modes and to receptances at contact points, which are means over
patches of the contact faces.  `reduced_bodies` makes the bodies of a model from them (:class:`bdamper.model.structure.Body`), and
`local_basis` the sector-local basis of a mistuned disk.  `bladed_disk` and `blade_to_ground` generate complete models from
dimensions; they need scikit-fem (extra ``bdamper[fe]``), imported at first use.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from bdamper.fem.reduced_bodies import Wanted
from bdamper.fem.sector_local_basis import BladePart, LocalSizes, local_basis

if TYPE_CHECKING:
    from bdamper.fem.blade_to_ground_model import blade_to_ground
    from bdamper.fem.bladed_disk_model import bladed_disk
    from bdamper.fem.geometry import Geometry, Material
    from bdamper.fem.mesh import MeshDensity
    from bdamper.fem.sector_matrices import SectorFE

__all__ = [
    "BladePart", "Geometry", "LocalSizes", "Material", "MeshDensity", "SectorFE", "Wanted", "blade_to_ground", "bladed_disk",
    "local_basis",
]  # fmt: skip

_GENERATORS = {
    "Geometry": "geometry", "Material": "geometry", "MeshDensity": "mesh", "SectorFE": "sector_matrices",
    "blade_to_ground": "blade_to_ground_model", "bladed_disk": "bladed_disk_model",
}  # fmt: skip


def __getattr__(name: str) -> Any:
    if name in _GENERATORS:
        try:
            return getattr(import_module(f"bdamper.fem.{_GENERATORS[name]}"), name)
        except ModuleNotFoundError as error:
            raise ImportError(f"bdamper.fem.{name} needs scikit-fem: install the extra bdamper[fe]") from error
    raise AttributeError(f"module 'bdamper.fem' has no attribute {name!r}")
''',
}

HEADS["util"] = '''"""Input checks, errors, files, tables, text, progress and root finding.

Nothing here depends on structures or vibration.  `validation` and `annotations` check arguments, `errors` and `warn` report,
`storage`, `checkpoint_file` and `versions` write and read HDF5 files, `tables`, `formatting` and `short_repr` print,
`display` finds the plot function of a result, `cost` counts operations and time, `rootfinding` finds a root on an interval.
"""
'''
HEADS["model"] = '''"""The structural model: bodies with their modes, interfaces with contact points, loads, and the model file.

A `Model` holds modal data of its bodies at nodal diameters and the geometry of its interfaces.  `check_model` validates it, and
`Coupling` derives the relative motion at the contact points for every harmonic (Eqs (13), (14), (17), (18) of the paper) with
static flexibilities and loads.  `Excitation` and `Response` define where forces act and where the motion is read.
`load_model` and `save_model` read and write the model file.
"""
'''
HEADS["importers"] = '''"""Models from the files of finite element programs and from matrices, and measured responses.

Each `read_...` function returns an `FEBody` from files of Abaqus, Ansys, CalculiX, Nastran, MATLAB or plain arrays.  `build_model`
checks units, axes and sector faces, places the contact points (`ContactFaces`), reduces the bodies and returns a `BuiltModel`,
which prints its report.  `load_measured` and `read_measurements` read measured responses.
"""
'''
HEADS["contact"] = '''"""Contact laws, contact stiffness, and static contact under preload.

`contact_stiffness` evaluates Eqs (1) to (11) of the paper and other methods, `residual_flexibility` adds residual vectors.
`static_state` is the quasi-static contact analysis of section 3.1 of the paper.  `wedge_friction` bounds the normal forces that
statics and friction leave open.  `PointArrays` holds the parameters of all contact points in the form that the C core takes.
"""
'''
HEADS["harmonic_balance"] = '''"""A study's settings and problem, and the harmonic balance equations that the C core evaluates.

The equations (paper, Eq. (16)) are evaluated in ``csrc/bd_hbm.c``: for the modal amplitudes ``q_l`` of each harmonic,

    r_l = (K - (l omega)^2 M + i l omega C) q_l + G_l^H F_l - E_l,

with the Fourier coefficients ``F_l`` of the contact forces (Eq. (15)) from ``csrc/bd_element.c`` and ``csrc/bd_event.c``.

`Settings` are checked settings, `Problem` derives bases, contact stiffness and static states from them, and
``Problem.system(preload)`` returns the `Equations` that evaluate residual and Jacobian and run Newton corrections.
"""
'''
HEADS["response"] = '''"""Forced response: response curves through folds, resonance peaks, and peaks over the preload.

`response_curve` computes a response curve at one preload: `initial_solution` finds a first point, `continuation` follows the
path from it, and `branches` collects paths until they span the interval.  `peak` finds and refines one resonance peak,
`highest_peak` the highest one, `optimal_curve` the peak over the preload with its minimum, `sensitivity` their derivatives.
`linear_curve` computes the responses with free and with stuck contacts.
"""
'''
HEADS["time_domain"] = '''"""Time integration of the equations of motion, and stability of periodic solutions.

`integration` integrates all sectors with the contact laws of the C core.  `march` and `steady_amplitude` find the steady
amplitude near a resonance, `settling` integrates from one solution, `frequency_sweep` sweeps the excitation frequency slowly.
`floquet` and `wave_exponents` determine the stability of points of a response curve.
"""
'''
HEADS["analyses"] = '''"""Analyses that solve a problem many times: sweeps, uncertainty, accuracy, fits, nonlinear modes, rotor speed.

`sweep` varies settings on any executor, `uncertainty` samples them, `fit` and `loop_fit` identify contact parameters from
measurements.  `harmonic_convergence`, `error_estimates`, `effect_selection` and `accuracy_cost` compare a study with more
detailed ones.  `nonlinear_mode` and `flutter` compute modes and limit cycles, `campbell`, `crossings` and `run_up` responses
over rotor speed, `hysteresis` and `microslip` contact loops.
"""
'''
HEADS["mistuning"] = '''"""Bladed disks whose blades and dampers differ: harmonic balance of all sectors, samples and their statistics.

A `Wheel` solves a problem whose model has a sector-local basis, for one `Mistuning` and `DamperVariation`;
`mistuned_sample` solves many random ones and fits the distribution of the highest blade amplitude.
"""
'''
for name, text in HEADS.items():
    p = pkg / name / "__init__.py"
    old = p.read_text() if p.exists() else ""
    rest = old.split('"""', 2)[2] if name in ("importers", "mistuning") else "\n"
    if name in ("importers",):
        rest = "\n".join(l for l in rest.split("\n") if "model_file" not in l).replace(' "load_model",', "").replace(', "save_model"', "")
    p.write_text(text if name == "fem" else text.rstrip("\n") + rest)
p = pkg / "plot/__init__.py"; s = p.read_text()
i = s.index('"""', 3)
p.write_text('"""Plots of every result, the report, and the interactive explorer; the only package that imports matplotlib.\n\nEach plot function registers itself for a type of result in :mod:`bdamper.util.display`, where ``result.plot()`` finds it, and\ntakes axes ``ax`` (new axes if omitted) and a ``title``.  `new_axes` and `save_figure` start and save a figure with several\nresults, `draw_table` plots one column of a result over another one.  `motion` computes motions and contact states as plain\narrays, `vtu` writes files for ParaView.  `explorer` serves a page with sliders on the loopback interface (extra\n``bdamper[app]``).\n' + s[i:])
# imports that ran both ways
sub("src/bdamper/fem/model_parts.py", "BOUNDS.pictured", "PICTURED_MODES")
s = (root / "src/bdamper/fem/model_parts.py").read_text()
s = re.sub(r"from bdamper.importers.import_tolerances import BOUNDS\n", "", s)
m = re.search(r"\n\n\n(?=(def|class|@|[A-Z]))", s)
s = s[: m.start()] + '\n\nPICTURED_MODES = 10\n"""Number of mode shapes at each nodal diameter that a model stores for plots."""' + s[m.start():]
(root / "src/bdamper/fem/model_parts.py").write_text(s)
sub("src/bdamper/importers/import_tolerances.py", '''    pictured: int = 10
    """Modes at a nodal diameter whose shapes on the surface are kept for pictures."""
''', "")
sub("src/bdamper/importers/prepared_body.py", "BOUNDS.pictured", "PICTURED_MODES")
sub("src/bdamper/fem/model_parts.py", "import skfem\n", "import skfem\n")
# the constant stands where fem and importers both reach it without scikit-fem
s = (root / "src/bdamper/fem/model_parts.py").read_text()
block = '\n\nPICTURED_MODES = 10\n"""Number of mode shapes at each nodal diameter that a model stores for plots."""'
assert block in s
s = s.replace(block, "", 1)
s = s.replace("from bdamper.fem.reduced_bodies import picture_mesh", "from bdamper.fem.reduced_bodies import PICTURED_MODES, picture_mesh")
(root / "src/bdamper/fem/model_parts.py").write_text(s)
p = root / "src/bdamper/fem/reduced_bodies.py"; s = p.read_text()
m = re.search(r"\n\n\n(?=(def |class |@))", s)
p.write_text(s[: m.start()] + block + s[m.start():])
p = root / "src/bdamper/importers/prepared_body.py"; s = p.read_text()
p.write_text(s.replace("from bdamper.importers.import_tolerances import BOUNDS\n", "from bdamper.fem.reduced_bodies import PICTURED_MODES\nfrom bdamper.importers.import_tolerances import BOUNDS\n" if "BOUNDS." in s else "from bdamper.fem.reduced_bodies import PICTURED_MODES\n", 1))
# a bound of compression for every file
p = root / "src/bdamper/importers/reader_registry.py"; s = p.read_text()
b = re.search(r'\nMOST_EXPANDED = .*?"""\n', s, re.S)[0]
p.write_text(s.replace(b, "", 1))
p = root / "src/bdamper/util/storage.py"; s = p.read_text()
p.write_text(s.replace("FilePath = str | os.PathLike[str]\n", "FilePath = str | os.PathLike[str]\n" + b, 1))
sub("src/bdamper/model/hdf5_records.py", "from bdamper.importers.reader_registry import MOST_EXPANDED\n", "from bdamper.util.storage import MOST_EXPANDED\n")
# paths
sub("src/bdamper/fem/reference_models.py", "package = Path(__file__).resolve().parent\n", "package = Path(__file__).resolve().parents[1]\n")
sub("tests/fem/test_shipped.py" if (root / "tests/fem/test_shipped.py").exists() else "tests/importers/test_shipped.py", '"bdamper" / "shipped.py"', '"bdamper" / "fem" / "reference_models.py"')
# a fatigue margin takes a steady amplitude of any origin
sub("src/bdamper/fatigue/margin.py", "from bdamper.response.march_result import Marched\n", "")
p = root / "src/bdamper/fatigue/margin.py"; s = p.read_text()
s = s.replace("kept: Marched | None", "kept: SteadyAmplitude | None").replace('validate.instance("kept", kept, Marched)', 'validate.instance("kept", kept, SteadyAmplitude)').replace("validation.instance(\"kept\", kept, Marched)", "validation.instance(\"kept\", kept, SteadyAmplitude)")
s = s.replace("from typing import Annotated, Any\n", "from typing import Annotated, Any, Protocol, runtime_checkable\n")
s = s.replace("\n\n@brief\n@dataclass(frozen=True)\nclass Margins(", '''

@runtime_checkable
class SteadyAmplitude(Protocol):
    """Steady-state amplitude from time integration (:class:`bdamper.response.march_result.Marched`)."""

    factor: float
    preload: float
    highest: float
    status: str
    text: str


@brief
@dataclass(frozen=True)
class Margins(''', 1)
p.write_text(s)
# the test of the layout
p = root / "tests/test_codebase.py"; s = p.read_text()
s = re.sub(r"ROOMS = \[\n.*?\]  # fmt: skip", '''ROOMS = [
    "__main__", "__init__", "lumped_masses", "study", "plot", "mistuning", "analyses", "time_domain", "response", "fatigue",
    "harmonic_balance", "contact", "importers", "fem", "model", "util",
]  # fmt: skip''', s, flags=re.S)
s = s.replace('("util.plotting", "plot")', '("util.display", "plot")')
p.write_text(s)
sys.path.insert(0, str(pathlib.Path(__file__).parent))
from modules import mapping
M = mapping()
for f in ["src/bdamper/__init__.py", "tests/test_codebase.py", "tests/test_public_names.py", "tools/call_depth.py"]:
    p = root / f; s = p.read_text()
    p.write_text(re.sub(r'"((?:\w+\.)?\w+)"', lambda m: f'"{M[m[1]]}"' if m[1] in M and ("." in m[1] or f.startswith("src") ) else m[0], s))
p = root / "src/bdamper/__init__.py"; s = p.read_text()
s = s.replace("from bdamper.importers import load_model", "from bdamper.model.model_file import load_model").replace("from bdamper.importers import save_model", "from bdamper.model.model_file import save_model")
s = s.replace('"load_model": "io"', '"load_model": "model.model_file"').replace('"save_model": "io"', '"save_model": "model.model_file"')
p.write_text(s)
p = root / "src/bdamper/fatigue/margin.py"; s = p.read_text()
for n, t in (("factor", "float"), ("preload", "float"), ("highest", "float"), ("status", "str"), ("text", "str")):
    s = s.replace(f"\n    {n}: {t}\n", f"\n    @property\n    def {n}(self) -> {t}: ...\n", 1) if False else s
block = "    factor: float\n    preload: float\n    highest: float\n    status: str\n    text: str\n"
assert block in s
s = s.replace(block, "\n".join(f"    @property\n    def {n}(self) -> {t}: ..." for n, t in (("factor", "float"), ("preload", "float"), ("highest", "float"), ("status", "str"), ("text", "str"))) + "\n", 1)
p.write_text(s)
for p in [*root.glob("tests/**/*.py"), *root.glob("docs/*.md"), *root.glob("notebooks/*.ipynb"), *root.glob("examples/**/*.py"), *root.glob("benchmarks/*.py"), *root.glob("tools/*.py"), *root.glob("src/bdamper/**/*.py")]:
    s = p.read_text()
    new = re.sub(r"\b(bd|bdamper)\.importers\.(load_model|save_model)\b", r"\1.\2", s)
    new = re.sub(r"from bdamper\.importers import (load_model|save_model)(, (?:load_model|save_model))?$", r"from bdamper.model.model_file import \1\2", new, flags=re.M)
    if new != s: p.write_text(new)

p = root / "src/bdamper/util/warn.py"; s = p.read_text()
s = re.sub(r'\("bdamper\.cli", "bdamper\.\w+"\)', '("bdamper.__main__", "bdamper.plot.explorer")', s)
p.write_text(s)
