"""Nastran's files read beside pyNastran, in an environment with the NumPy that it supports (make nastran)."""

import numpy as np
import pytest
import scipy.sparse as sp

from bdamper.importers import read_bdf, read_op2, read_op4
from tests.each import each
from tests.nastran_files import write_op2, write_op4


@pytest.fixture(autouse=True)
def _pynastran():
    try:
        from pyNastran.bdf.bdf import BDF  # noqa: F401
    except (ImportError, AttributeError) as error:
        pytest.skip(f"pyNastran is not installed or does not work with this NumPy: {error}")


def random_deck(rng):
    """Coordinate systems on each other, grid points in them, all solids, two materials, and a matrix."""
    from pyNastran.bdf.bdf import BDF

    model = BDF(debug=None)
    systems = [0]
    for key in range(1, 7):
        add = rng.choice([model.add_cord2r, model.add_cord2c, model.add_cord2s])
        three = rng.uniform(0.5, 2.0, (3, 3))
        add(key, *three, rid=int(rng.choice(systems)))
        systems.append(key)
    # systems of grid points, which are in basic coordinates
    for grid in range(901, 907):
        model.add_grid(grid, rng.uniform(-1.0, 1.0, 3))
    model.add_cord1r(11, 901, 902, 903)
    model.add_cord1c(12, 904, 905, 906)
    systems += [11, 12]
    grids = rng.choice(800, 60, replace=False) + 1
    plain = [key for key in systems if key in (0, 11, 12) or "S" not in model.coords[key].type]
    for grid in grids.tolist():
        cp, cd = int(rng.choice(systems)), int(rng.choice(plain))
        model.add_grid(grid, rng.uniform(0.2, 3.0, 3), cp=cp, cd=cd)
    model.add_mat1(1, 2.1e11, None, 0.3, rho=7850.0)
    model.add_mat1(2, 7.0e10, 2.6e10, None, rho=2700.0)
    model.add_psolid(1, 1)
    model.add_psolid(2, 2)
    sizes = {model.add_ctetra: (4, 10), model.add_cpenta: (6, 15), model.add_chexa: (8, 20)}
    for number, (add, counts) in enumerate(sizes.items(), 1):
        for k, count in enumerate(counts):
            nodes = rng.choice(grids, count, replace=False).tolist()
            add(10 * number + k, int(rng.integers(1, 3)), nodes)
    model.add_set1(5, grids[:9].tolist())
    return model


@each("seed", range(8))
@each("form", ["small", "large", "double"])
def test_random_decks(seed, form, tmp_path):
    from pyNastran.bdf.bdf import BDF

    model = random_deck(np.random.default_rng([105, seed]))
    path = tmp_path / "a.bdf"
    size, is_double = {"small": (8, False), "large": (16, False), "double": (16, True)}[form]
    model.write_bdf(str(path), size=size, is_double=is_double)
    theirs = BDF(debug=None)
    theirs.read_bdf(str(path), punch=True)
    body = read_bdf(path)
    numbers = sorted(theirs.nodes)
    nodes = [theirs.nodes[number].get_position() for number in numbers]
    np.testing.assert_array_equal(body.numbers, numbers)
    np.testing.assert_allclose(body.nodes, nodes, rtol=1e-12, atol=1e-12)
    expected = {tuple(element.nodes) for element in theirs.elements.values()}
    assert {tuple(row) for group in body.elements for row in group.tolist()} == expected
    moduli = {(m.e, m.nu, m.rho) for m in theirs.materials.values()}
    found = {(k.youngs_modulus, k.poisson_ratio, k.density) for k in body.element_kinds}
    np.testing.assert_allclose(sorted(found), sorted(moduli), rtol=1e-12)
    assert body.node_sets["SET5"].tolist() == sorted(theirs.sets[5].ids)
    n_rectangular = 0
    for number, axes in body.node_axes.items():
        system = theirs.coords[theirs.nodes[number].cd]
        if system.type in ("CORD2R", "CORD1R"):
            np.testing.assert_allclose(axes, system.beta(), atol=1e-12)
            n_rectangular += 1
    assert n_rectangular > 0


@each("kind", [1, 2])
def test_dense_matrices_of_pynastran(kind, tmp_path):
    """Texts only: its binary files lack the lengths behind the records."""
    from pyNastran.op4.op4 import OP4

    rng = np.random.default_rng(105)
    matrix = rng.standard_normal((9, 9)).astype("f4" if kind == 1 else "f8")
    OP4(debug=False).write_op4(str(tmp_path / "a.op4"), {"K": (1, matrix)}, is_binary=False)
    np.testing.assert_array_equal(read_op4(tmp_path / "a.op4")["K"].toarray(), matrix)


@each("binary", [False, True])
@each("form", ["dense", "small", "wide"])
@each("kind", [1, 2])
def test_own_matrices_are_read_alike(binary, form, kind, tmp_path):
    """The files that the tests write are such files for pyNastran, too."""
    from pyNastran.op4.op4 import OP4

    rng = np.random.default_rng(106)
    matrix = sp.random(9, 9, 0.4, random_state=rng) + sp.eye(9)
    path = tmp_path / "a.op4"
    write_op4(path, {"K": matrix}, binary, form, kind)
    found = OP4(debug=False).read_op4(str(path))["K"]
    data = getattr(found, "data", found)
    data = data[1] if isinstance(data, tuple) else data
    theirs = data.toarray() if sp.issparse(data) else np.asarray(data)
    # it keeps single precision
    accuracy = 1e-7 if kind == 1 else 1e-15
    np.testing.assert_allclose(read_op4(path)["K"].toarray(), theirs, rtol=accuracy)


def test_modes_of_pynastran(tmp_path):
    from pyNastran.op2.op2 import OP2
    from pyNastran.op2.tables.oug.oug_eigenvectors import RealEigenvectorArray

    data = np.zeros((2, 4, 6), "float32")
    data[..., :3] = np.random.default_rng(0).standard_normal((2, 4, 3))
    grid = np.column_stack([np.arange(1, 5), np.ones(4, int)]).astype("int32")
    hertz = np.array([50.0, 80.0])
    table = RealEigenvectorArray.add_modal_case(
        "OUGV1", grid, data, 1, np.array([1, 2]), (2 * np.pi * hertz) ** 2, hertz
    )
    table.table_code, table.tCode = 7, 1007  # eigenvectors, not displacements
    table.data_code.update(table_code=7, tCode=1007)
    model = OP2(debug=None)
    model.set_as_msc()
    model.eigenvectors[1] = table
    model.write_op2(str(tmp_path / "m.op2"), post=-1, endian=b"<", nastran_format="msc")
    modes = read_op2(tmp_path / "m.op2")
    np.testing.assert_allclose(modes.frequency, hertz, rtol=1e-6)
    np.testing.assert_array_equal(modes.shapes, np.moveaxis(data[..., :3], 0, 2))


def test_own_modes_are_read_alike(tmp_path):
    from pyNastran.op2.op2 import OP2

    shapes = np.random.default_rng(107).standard_normal((5, 3, 3)).astype("f4")
    path = tmp_path / "m.op2"
    write_op2(path, np.arange(3, 8), shapes, [50.0, 80.0, 120.0], [2.0, 3.0, 4.0])
    theirs = OP2(debug=None)
    theirs.read_op2(str(path), build_dataframe=False, skip_undefined_matrices=True)
    (vectors,) = theirs.eigenvectors.values()
    modes = read_op2(path)
    np.testing.assert_array_equal(np.moveaxis(modes.shapes, 2, 0), vectors.data[..., :3])
    (values,) = theirs.eigenvalues.values()
    np.testing.assert_allclose(modes.modal_mass, values.generalized_mass, rtol=1e-7)
    np.testing.assert_allclose(modes.frequency, values.cycles, rtol=1e-6)
