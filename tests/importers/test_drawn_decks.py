"""Twelve decks drawn at random, two of them with a constraint, each written in two dialects.

Ten build to the same frequencies, two are refused by keyword and line.  The matrices are those of CalculiX.  The first
dialect is that of Abaqus, flat or in parts, with ways to write nodes and sets that are drawn.
"""

import shutil
from dataclasses import replace
from functools import cache

import h5py
import numpy as np
import pytest
import scipy.sparse as sp

pytest.importorskip("skfem", reason="scikit-fem is not installed (extra bdamper[fe])")

from bdamper.importers import read_ansys, read_arrays, read_calculix
from bdamper.util.errors import ModelError
from tests.ansys_files import collapsed, write_cdb, write_full
from tests.importers.test_abaqus_parts import (
    CASES,
    Case,
    elements_of,
    from_arrays,
    settings,
    stored_matrices,
    write,
    write_flat,
)
from tests.imports import build
from tests.own_sector import OwnSector

SEED, N_DECKS = 69, 12
BODIES = "sector", "damper"
KINDS = "C3D4", "C3D6", "C3D8"
DIALECTS = "flat", "parts", "calculix", "ansys", "matlab"
HEADS = "plain", "*SYSTEM", "*SYSTEM of two points", "*NODE, SYSTEM=C", "continued lines"
WAYS = "generate", "by_elements", "moved", "assembly_sets", "independent", "labels", "swapped"
TIES = (
    ("*TIE, NAME=T",),
    ("*EQUATION", "2", "1, 1, 1., 2, 1, -1."),
    ("*MPC", "BEAM, 1, 2"),
    ("*COUPLING, REF NODE=1",),
)
TIES_OF_ANSYS = (
    ("CE,R5.0,DEFI,       2,       1,  0.00000000",),
    ("CP,R5.0,DEFI,       2,       1,UX  ",),
)


def drawn():
    """Type of the elements, how the deck is written, its constraint in Ansys, and two dialects, of each deck."""
    rng, decks = np.random.default_rng(SEED), []
    constrained = rng.choice(N_DECKS, 2, replace=False)
    for k in range(N_DECKS):
        case = replace(CASES[rng.choice(HEADS)], **{way: bool(rng.random() < 0.3) for way in WAYS})
        tied = k in constrained
        case = replace(case, constraint=TIES[rng.integers(len(TIES))] if tied else ())
        first = DIALECTS[rng.integers(2)]
        others = [
            name for name in DIALECTS if name not in (first, "matlab" if tied else "")
        ]  # arrays have no ties
        dialects = [first, str(rng.choice(others))]
        decks.append(
            (str(rng.choice(KINDS)), case, TIES_OF_ANSYS[rng.integers(2)] if tied else (), dialects)
        )
    return decks


def written(dialect, folder, own, case, tie, matrices):
    """Write both bodies and read them."""
    if dialect in ("flat", "parts"):
        return write(folder, case, dialect == "parts", matrices, own)
    if dialect == "calculix":
        write_flat(folder, Case(generate=case.generate, constraint=case.constraint), own)
    for name in BODIES:
        _, sets, nodes = own.text(name)
        stiffness, mass = matrices[name]
        numbers, elements = np.arange(1, len(nodes) + 1), elements_of(name, own)
        if dialect == "calculix":
            (folder / f"{name}.dof").write_text(
                "".join(f"{n}.{c}\n" for n in numbers for c in (1, 2, 3))
            )
            for end, m in (("sti", sp.triu(stiffness).tocoo()), ("mas", sp.triu(mass).tocoo())):
                np.savetxt(
                    folder / f"{name}.{end}",
                    np.column_stack([m.row + 1, m.col + 1, m.data]),
                    fmt="%d %d %.17e",
                )
        elif dialect == "ansys":
            write_full(folder / f"{name}.full", stiffness, mass, 10 * numbers)
            stored = [collapsed((10 * e).tolist()) for e in elements]
            components = {key: 10 * (members + 1) for key, members in sets.items()}
            write_cdb(folder / f"{name}.cdb", 10 * numbers, nodes, stored, components, tie)
        else:
            for key, m in (("K", sp.csc_matrix(stiffness)), ("M", sp.csc_matrix(mass))):
                with h5py.File(folder / f"{name}_{key}.mat", "w", userblock_size=512) as file:
                    group = file.create_group(key)
                    group.attrs["MATLAB_sparse"] = m.shape[0]
                    group["data"], group["ir"], group["jc"] = m.data, m.indices, m.indptr
                with (folder / f"{name}_{key}.mat").open("r+b") as file:
                    file.write(b"MATLAB 7.3 MAT-file")
            np.savetxt(
                folder / f"{name}.csv",
                np.column_stack([numbers, nodes]),
                delimiter=",",
                fmt="%.17g",
            )
    if dialect == "calculix":
        return tuple(read_calculix(folder / name) for name in BODIES)
    if dialect == "ansys":
        return tuple(read_ansys(folder / f"{name}.full", folder / f"{name}.cdb") for name in BODIES)
    return tuple(
        read_arrays(
            folder / f"{name}_K.mat", folder / f"{name}_M.mat", folder / f"{name}.csv", elements=elements_of(name, own),
            sets={key: members + 1 for key, members in own.text(name)[1].items()},
        )
        for name in BODIES
    )  # fmt: skip


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    """Meshes, matrices and the model of plain arrays, by type of the elements."""

    @cache
    def made(kind):
        own = OwnSector(kind)
        matrices = stored_matrices(tmp_path_factory.mktemp("ccx"), own)
        return own, matrices, build(*from_arrays(matrices, own), **settings(Case()))

    return made


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX (ccx) is not installed")
@pytest.mark.parametrize("k", range(N_DECKS))
def test_each_drawn_deck_builds_to_the_same_frequencies_or_is_refused_by_keyword_and_line(
    k, reference, tmp_path
):
    kind, case, tie, dialects = drawn()[k]
    own, matrices, expected = reference(kind)
    for dialect in dialects:
        folder = tmp_path / dialect
        folder.mkdir()
        if case.constraint:
            with pytest.raises(ModelError) as caught:
                written(dialect, folder, own, case, tie, matrices)
            first, message = (tie if dialect == "ansys" else case.constraint)[0], str(caught.value)
            (lines,) = [
                file.read_text().splitlines() for file in folder.iterdir() if f"{file}: " in message
            ]
            assert first.split(",")[0] in message and "\n" not in message
            assert f"line {lines.index(first) + 1}: expected" in message
            continue
        built = build(*written(dialect, folder, own, case, tie, matrices), **settings(Case()))
        for d, frequency in expected.frequencies.items():
            np.testing.assert_allclose(built.frequencies[d], frequency, rtol=1e-6)
        ours, theirs = (
            model.bodies["damper"].bases[0].omega2[6:] for model in (built.model, expected.model)
        )
        np.testing.assert_allclose(ours, theirs, rtol=2e-6)
        areas, others = (
            [i.area.sum() for i in model.interfaces.values()]
            for model in (built.model, expected.model)
        )
        np.testing.assert_allclose(areas, others, rtol=1e-6)


def test_every_dialect_and_type_of_element_is_drawn():
    decks = drawn()
    assert sum(not case.constraint for _, case, _, _ in decks) == 10
    assert {dialect for *_, dialects in decks for dialect in dialects} == set(DIALECTS)
    assert {kind for kind, *_ in decks} == set(KINDS)
