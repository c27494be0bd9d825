"""Models that other programs wrote and other packages carry: where they are, and how CalculiX runs its own decks.

Nothing of them is copied here.  The decks of CalculiX come with the Debian package ``calculix-ccx-test``; those of Ansys
with the wheels of ``ansys-mapdl-reader`` and ``mapdl-archive``, which ``make others`` unpacks into ``.venv-others`` (or
``BDAMPER_OTHERS``), and with two public repositories, which it copies there if a network reaches them.
"""

import gzip
import os
import re
import shutil
from pathlib import Path

import numpy as np

import bdamper as bd
from bdamper.importers import ContactFaces, FEBody, read_calculix
from examples.calculix.decks import run_job
from tests.imports import build

DECKS = Path("/usr/share/doc/calculix-ccx-test/examples/test")
UNPACKED = Path(os.environ.get("BDAMPER_OTHERS") or Path(__file__).parents[1] / ".venv-others")
ANSYS = UNPACKED / "ansys" / "mapdl" / "reader" / "examples"
READER = UNPACKED / "mapdl_archive"
REPOSITORIES = (UNPACKED / "example-data", UNPACKED / "pymapdl-reader")
AXES = {
    "axis": (1, 0, 0),
    "radial": (0, np.cos(np.pi / 12), np.sin(np.pi / 12)),
    "units": "mm-t-s",
    "check_units": False,
}
"""Of the sector of 12 in all these decks, a disk of a millimetre."""


def archives() -> list[Path]:
    """Archives of Ansys in the wheels and repositories."""
    return sorted(path for path in UNPACKED.rglob("*.cdb") if path.is_file())


def has_decks() -> bool:
    """Whether CalculiX and its decks are installed."""
    return shutil.which("ccx") is not None and (DECKS / "segdyn.inp.gz").is_file()


def deck(name: str) -> str:
    """What a deck says before its first step, unchanged."""
    text = gzip.decompress((DECKS / f"{name}.inp.gz").read_bytes()).decode(errors="replace")
    return text[: re.search(r"(?im)^\*STEP", text).start()]


def numbers_in(text: str, name: str) -> list[int]:
    """The members of a set of nodes."""
    block = re.search(rf"(?ims)^\*NSET, *NSET={name}\s*\n(.*?)^\*", text).group(1)
    return [int(word) for word in block.replace(",", " ").split()]


def held(text: str) -> str:
    """Lines that hold the bore, or the rim of a disk without one, but for the dependent face, which CalculiX wants free."""
    rows = re.search(r"(?ims)^\*NODE[^\n]*\n(.*?)^\*", text).group(1).splitlines()
    nodes = np.array([[float(word) for word in row.split(",")[:4]] for row in rows if row.strip()])
    radius, dependent = np.hypot(nodes[:, 2], nodes[:, 3]), set(numbers_in(text, "Nleft"))
    on = radius < 1.002 * radius.min() if radius.min() > 1e-3 else radius > 0.998 * radius.max()
    numbers = [number for number in nodes[on, 0].astype(int).tolist() if number not in dependent]
    return "\n".join(
        ["*NSET, NSET=NHELD", *(f"{number}," for number in numbers), "*BOUNDARY", "NHELD, 1, 3", ""]
    )


def sector(text: str, folder: Path) -> FEBody:
    """The body of a deck: CalculiX stores its matrices with the cyclic tie inactive."""
    run_job(
        f"{text}*STEP\n*FREQUENCY, SOLVER=MATRIXSTORAGE, CYCMPC=INACTIVE\n1\n*END STEP\n",
        folder,
        "matrices",
    )
    return read_calculix(folder / "matrices")


def cyclic_frequencies(
    text: str, folder: Path, highest: int, n_modes: int = 10
) -> dict[int, np.ndarray]:
    """Frequencies (Hz) of CalculiX' own cyclic run for nodal diameters 0 to ``highest``, one of each pair."""
    steps = ""
    for low, high in (
        (0, 0),
        (1, 1),
        (2, highest),
    ):  # in steps of their own, where nodes stand on the axis
        steps += f"*STEP\n*FREQUENCY\n{n_modes}\n*SELECT CYCLIC SYMMETRY MODES, NMIN={low}, NMAX={high}\n*END STEP\n"
    run_job(text + steps, folder, "cyclic")
    found: dict[int, list[float]] = {}
    for line in (folder / "cyclic.dat").read_text().splitlines():
        words = line.split()
        if len(words) == 6 and words[0].isdigit() and words[1].isdigit():
            found.setdefault(int(words[0]), []).append(float(words[4]))
    return {d: np.array(values[::2]) for d, values in found.items()}


def shrouded(body: FEBody, points: tuple[int, int] = (4, 4)) -> bd.Model:
    """The sector of ``segdyn`` as a wheel whose outer 0.3 mm are shrouds: its faces touch there, and are joined inside."""
    radius, faces = np.hypot(body.nodes[:, 1], body.nodes[:, 2]), ("NLEFT", "NRIGHT")
    on = [np.isin(body.numbers, body.node_sets[name]) for name in faces]
    disk, shroud = (
        [body.numbers[face & part] for face in on] for part in (radius < 0.71, radius > 0.69)
    )
    touching = ContactFaces("shroud", *shroud, "blade", "blade", points=points)
    tip = {"tip": int(body.numbers[radius.argmax()])}
    settings = {"engine_order": 3, "harmonics": 1, "n_modes": 20, "locations": tip, **AXES}
    return build(body, n_blades=12, faces=tuple(disk), contacts=[touching], **settings).model


def stuck_frequency(model: bd.Model) -> float:
    """Lowest frequency (Hz) of a model for engine order 3 with all contact points bonded."""
    force = bd.Excitation("tip", direction="axial")
    problem = bd.Study(model, force, engine_order=3, friction_coefficient=0.3, harmonics=1).problem
    springs = np.concatenate(
        [problem.stiffness[name].stiffness for name in problem.coupling.interfaces]
    )
    return float(problem.system(0.0).structure.linear.modes(springs)[0][0] / (2.0 * np.pi))


def front(body: FEBody) -> np.ndarray:
    """Numbers of the moving nodes of the face of a sector at its largest x, outside the middle radius."""
    x, radius = body.nodes[:, 0], np.hypot(body.nodes[:, 1], body.nodes[:, 2])
    moving = (x > x.max() - 1e-6) & np.isin(body.numbers, body.dofs[:, 0])
    return body.numbers[moving & (radius > 0.55)]
