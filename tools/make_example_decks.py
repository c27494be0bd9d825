"""Make the example decks of the package with CalculiX (ccx): six archives in bdamper/data/decks.

    python -m tools.make_example_decks

``calculix`` has a sector and its wedge damper, ``shroud`` a sector with tip shroud and two strip dampers, ``abaqus`` the
sector and wedge damper of ``calculix`` as instances of two parts, with the matrices as *MATRIX OUTPUT writes them.
``ansys`` has this sector of hexahedra, and the damper of wedges, which Ansys stores as hexahedra with repeated nodes.
``ring`` has another sector, of 24, and the sector of a friction ring under the lip of its rim.
``turbine`` has the geometry of the reference model "turbine_blade", in elements C3D8I.
"""

import tempfile
from pathlib import Path
from zipfile import ZIP_LZMA, ZipFile, ZipInfo

import numpy as np

from bdamper.fem import MeshDensity
from bdamper.fem.meshes import local_order
from bdamper.importers import read_calculix
from examples.calculix.decks import run_job
from tests.ansys_files import collapsed, write_cdb, write_full
from tests.own_sector import OwnSector, deck, of_kind
from tools.make_reference_model import TURBINE
from tools.ring_sector import text_of
from tools.shrouded import meshes

DECKS = Path(__file__).resolve().parents[1] / "bdamper" / "data" / "decks"
STEPS = ["*STEP", "*FREQUENCY, SOLVER=MATRIXSTORAGE", "6,", "*END STEP", ""]
MATERIAL = {"EX  ": 210000.0, "PRXY": 0.3, "DENS": 7.85e-9}
STAGE = """*HEADING
Sector and wedge damper of a bladed disk with 36 blades, in mm, t, s
*PART, NAME=Sector
{sector}
*END PART
*PART, NAME=Strip
{damper}
*END PART
*ASSEMBLY, NAME=Assembly
*INSTANCE, NAME=Sector-1, PART=Sector
*END INSTANCE
*INSTANCE, NAME=Strip-1, PART=Strip
{x!r}, {y!r}, {z!r}
{x!r}, {y!r}, {z!r}, {u!r}, {y!r}, {z!r}, {angle!r}
*END INSTANCE
*NSET, NSET=BORE, INSTANCE=Sector-1
{bore}
*END ASSEMBLY
*MATERIAL, NAME=STEEL
*ELASTIC
210000., 0.3
*DENSITY
7.85E-9
*STEP
*MATRIX GENERATE, STIFFNESS, MASS
*MATRIX OUTPUT, STIFFNESS, MASS, FORMAT=MATRIX INPUT
*END STEP
"""


def rounded(path):
    """Write numbers of a CalculiX matrix with ten digits, which compress well.

    Zeros and rounding errors are left out: they are below 1e-12 of the diagonal entries of their
    row and column.
    """
    rows = [line.split() for line in path.read_text().splitlines()]
    diagonal = {i: abs(float(v)) for i, j, v in rows if i == j}
    rows = [
        (i, j, v) for i, j, v in rows if abs(float(v)) > 1e-12 * np.sqrt(diagonal[i] * diagonal[j])
    ]
    path.write_text("".join(f"{i} {j} {float(v):.9e}\n" for i, j, v in rows))


def run(text, folder, name, held):
    """Write a deck and its matrices; held: a set without equations, or ""."""
    run_job(
        "\n".join([text, *(["*BOUNDARY", f"{held}, 1, 3"] if held else []), *STEPS]), folder, name
    )
    for end in (".sti", ".mas"):
        rounded(folder / f"{name}{end}")


def archive(name, folder, *kept):
    DECKS.mkdir(exist_ok=True)
    # half as large as with deflate
    with ZipFile(DECKS / f"{name}.zip", "w", ZIP_LZMA) as out:
        for path in sorted(path for pattern in kept for path in folder.glob(pattern)):
            # no date: the same bytes each time
            out.writestr(ZipInfo(path.name), path.read_bytes(), ZIP_LZMA)
    print(name, (DECKS / f"{name}.zip").stat().st_size)


def calculix(folder):
    own = OwnSector("C3D8")
    run(own.text("sector")[0], folder, "sector", "BORE")
    run(own.text("damper")[0], folder, "damper", "")
    archive(
        "calculix",
        folder,
        *(f"{name}.{end}" for name in ("sector", "damper") for end in ("inp", "sti", "mas", "dof")),
    )


def turbine(folder):
    """A mesh whose stress above the platform differs by less than a tenth between elements."""
    density = MeshDensity(
        centre=2, contact=2, fillet=1, chord=4, disk=1, shank=1, platform=1, airfoil=8,
        damper_face=2, damper_ridge=1, damper_height=1, damper_length=4,
    )  # fmt: skip
    own = OwnSector("C3D8I", geometry=TURBINE, density=density)
    run(own.text("sector")[0], folder, "sector", "BORE")
    run(own.text("damper")[0], folder, "damper", "")
    ends = ("inp", "sti", "mas", "dof")
    archive("turbine", folder, *(f"{name}.{end}" for name in ("sector", "damper") for end in ends))


def shroud(folder):
    for name, (made, sets) in meshes().items():
        corners = made.elements[:, local_order()][:, :8]
        used, compact = np.unique(corners, return_inverse=True)
        nodes, elements = of_kind("C3D8", made.nodes[used], compact.reshape(corners.shape))
        x = nodes[elements[0]]
        if np.linalg.det([x[k] - x[0] for k in (1, 3, 4)]) < 0.0:
            elements = elements[:, [4, 5, 6, 7, 0, 1, 2, 3]]
        members = {key.upper(): np.flatnonzero(np.isin(used, nodes)) for key, nodes in sets.items()}
        text = deck("C3D8", nodes, elements, 2.1e11, 0.3, 7850.0, members)
        run(text, folder, name, "BORE" if name == "blade" else "")
    archive(
        "shroud",
        folder,
        *(f"{name}.{end}" for name in meshes() for end in ("inp", "sti", "mas", "dof")),
    )


def ring(folder):
    run(text_of("sector"), folder, "sector", "BORE")
    # all digits: the soft bending of a slender ring is a small difference of large stiffnesses
    run_job("\n".join([text_of("ring"), *STEPS]), folder, "ring")
    ends = ("inp", "sti", "mas", "dof")
    archive("ring", folder, *(f"{name}.{end}" for name in ("sector", "ring") for end in ends))


def abaqus(folder):
    """The strip is a part about its own origin, turned and moved to its place by its instance."""
    own, place, angle, texts, entries = (
        OwnSector("C3D8"),
        np.array([10.0, 200.0, 30.0]),
        25.0,
        {},
        {"STIF": [], "MASS": []},
    )
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    rotation, first = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]]), 0
    for name in ("sector", "damper"):
        text, _, nodes = own.text(name)
        run(text, folder, name, "")
        body = read_calculix(folder / name)
        head, rest = text.split("*ELEMENT", 1)
        if name == "damper":
            nodes = (nodes - place) @ rotation
            head = "*NODE\n" + "".join(
                f"{k}, {x:.12e}, {y:.12e}, {z:.12e}\n" for k, (x, y, z) in enumerate(nodes, 1)
            )
        mesh, rest = rest.split("*MATERIAL", 1)
        parts = [
            part for part in rest[rest.index("*SOLID") :].split("*NSET") if "NSET=BORE" not in part
        ]
        texts[name] = f"{head}*ELEMENT{mesh}{'*NSET'.join(parts)}".strip()
        for kind, matrix in (("STIF", body.stiffness), ("MASS", body.mass)):
            for i, j, v in zip(
                *map(np.ndarray.tolist, (lambda m: (m.row, m.col, m.data))(matrix.tocoo()))
            ):
                (a, p), (b, q) = body.dofs[i].tolist(), body.dofs[j].tolist()
                if (a, p) <= (b, q):
                    entries[kind].append(f"{a + first},{p}, {b + first},{q}, {v:.9e}")
        first += len(nodes)
    bore = own.text("sector")[1]["BORE"] + 1
    x, y, z = place.tolist()
    lines = ",\n".join(", ".join(map(str, bore[k : k + 16])) for k in range(0, len(bore), 16))
    (folder / "stage.inp").write_text(
        STAGE.format(**texts, bore=lines, x=x, y=y, z=z, u=x + 1.0, angle=angle)
    )
    for kind, rows in entries.items():
        (folder / f"stage_{kind}1.mtx").write_text("\n".join([*rows, ""]))
    archive("abaqus", folder, "stage.inp", "stage_*.mtx")


def ansys(folder):
    for name, kind in (("sector", "C3D8"), ("damper", "C3D6")):
        own = OwnSector(kind)
        text, sets, nodes = own.text(name)
        run_job("\n".join([text, *STEPS]), folder, name)
        body = read_calculix(folder / name)
        order, numbers = (
            np.argsort(3 * body.dofs[:, 0] + body.dofs[:, 1]),
            np.arange(1, len(nodes) + 1),
        )
        matrices = [matrix[order][:, order] for matrix in (body.stiffness, body.mass)]
        held = sets.pop("BORE", np.zeros(0, int))
        write_full(
            folder / f"{name}.full",
            *matrices,
            numbers,
            fixed=(3 * held[:, None] + np.arange(3)).ravel(),
        )
        head = [
            f"MPDATA,R5.0, 1,{key},       1, 1,  {value}    ," for key, value in MATERIAL.items()
        ]
        head += [
            f"D,{n + 1:7d},{c},  0.00000000    ,  0.00000000"
            for n in held
            for c in ("UX", "UY", "UZ")
        ]
        named = {key: members + 1 for key, members in sets.items()}
        write_cdb(
            folder / f"{name}.cdb",
            numbers,
            nodes,
            [collapsed(e.tolist()) for e in body.elements[0]],
            named,
            head,
        )
    archive("ansys", folder, "*.cdb", "*.full")


if __name__ == "__main__":
    for make in (calculix, shroud, ring, turbine, abaqus, ansys):
        with tempfile.TemporaryDirectory() as folder:
            make(Path(folder))
