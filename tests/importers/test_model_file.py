"""The model file: exact round trip, and one clear error for anything else."""

from __future__ import annotations

import hashlib
import random
import re
import shutil
from collections.abc import Callable
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

import bdamper.model.model_file as model_file
from bdamper.model.modal_basis import LocalBasis, ModalBasis, SpeedBasis, SpinStatic
from bdamper.model.model_file import load_model, save_model
from bdamper.model.structure import (
    Body,
    BodyLoad,
    ContactStiffness,
    Interface,
    Location,
    Model,
    StaticContact,
    StressSet,
    SurfaceMesh,
    feed_digest,
)
from bdamper.util.errors import BdamperError, ModelError
from bdamper.util.records import layout
from tests.each import each
from tests.models import ALL_MODELS, complete_model, shroud_model, wedge_model


def assert_same(a: Any, b: Any, path: str = "model") -> None:
    """Equality to the last bit, with types and the order of mappings."""
    if is_dataclass(a):
        assert type(a) is type(b), path
        for f in fields(a):
            assert_same(getattr(a, f.name), getattr(b, f.name), f"{path}.{f.name}")
    elif isinstance(a, dict):
        assert list(a) == list(b), path
        for key in a:
            assert_same(a[key], b[key], f"{path}[{key!r}]")
    elif isinstance(a, np.ndarray):
        assert a.dtype == b.dtype, path
        assert a.shape == b.shape, path
        assert a.tobytes() == b.tobytes(), path
    else:
        assert a == b, path


@pytest.fixture(scope="module")
def saved(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("model") / "complete.h5"
    save_model(complete_model(), path)
    return path


@pytest.fixture
def copy(saved, tmp_path) -> Path:
    return Path(shutil.copy(saved, tmp_path / "copy.h5"))


# -----------------------------------------------------------------------------------------------------------
# Round trip


@pytest.mark.parametrize("name", ALL_MODELS)
def test_round_trip_is_exact(name, tmp_path):
    model = ALL_MODELS[name]()
    save_model(model, tmp_path / "model.h5")
    again = load_model(tmp_path / "model.h5")
    assert again.hash == model.hash
    if name in ("wedge", "acyclic"):
        assert_same(model, again)
    else:
        assert_same(replace(model, provenance={}), replace(again, provenance={}))


def test_round_trip_of_every_optional_part(tmp_path):
    model = complete_model()
    save_model(model, tmp_path / "model.h5")
    again = load_model(str(tmp_path / "model.h5"))
    assert dict(again.provenance) == model.provenance
    assert_same(replace(model, provenance={}), replace(again, provenance={}))


def test_a_model_without_stress_keeps_its_fingerprint():
    model = complete_model()
    digest = hashlib.sha256()
    for name in ("n_blades", "bodies", "interfaces", "locations", "contact", "static"):
        feed_digest(digest, name, getattr(model, name))
    assert replace(model, stress={}).hash == digest.hexdigest()[:16] != model.hash


def test_real_stays_real_and_complex_complex(tmp_path):
    save_model(wedge_model(), tmp_path / "model.h5")
    blade = load_model(tmp_path / "model.h5").bodies["blade"]
    assert [basis.contact_modes.dtype.kind for basis in blade.bases.values()] == [
        "f",
        "c",
        "c",
        "f",
    ]
    assert [basis.flexibility.dtype.kind for basis in blade.bases.values()] == ["f", "c", "c", "f"]


def test_every_dataset_has_units_and_large_ones_are_compressed(tmp_path):
    save_model(wedge_model(n_points=9), tmp_path / "model.h5")
    seen = []

    def visit(name: str, item: h5py.Group | h5py.Dataset) -> None:
        if isinstance(item, h5py.Dataset):
            seen.append(name)
            assert item.attrs["units"], name
            large = item.nbytes > 4096
            assert (item.compression == "gzip") is large, name
            assert item.shuffle is large, name

    with h5py.File(tmp_path / "model.h5") as file:
        file.visititems(visit)
    assert len(seen) > 30


# -----------------------------------------------------------------------------------------------------------
# Writing


def test_an_invalid_model_is_not_written(copy):
    before = copy.read_bytes()
    with pytest.raises(ModelError, match="/@n_blades: expected at least 1, found 0"):
        save_model(replace(shroud_model(), n_blades=0), copy)
    assert copy.read_bytes() == before


def test_a_failure_while_writing_leaves_the_old_file(copy, monkeypatch):
    before = copy.read_bytes()

    def fail(*_: Any) -> None:
        raise OSError("no space left")

    monkeypatch.setattr("os.replace", fail)
    with pytest.raises(
        BdamperError, match="expected a file that can be written, found no space left"
    ):
        save_model(shroud_model(), copy)
    assert copy.read_bytes() == before
    assert [path.name for path in copy.parent.iterdir()] == ["copy.h5"]


def test_a_text_too_long_for_an_attribute_is_refused(tmp_path):
    model = replace(shroud_model(), provenance={"log": "x" * 70000})
    with pytest.raises(
        ModelError, match="/provenance: expected texts of at most 60000 bytes, found 70000"
    ):
        save_model(model, tmp_path / "model.h5")
    save_model(
        replace(model, provenance={"log": "x" * 59000, "more": "y" * 59000}), tmp_path / "model.h5"
    )
    assert len(load_model(tmp_path / "model.h5").provenance["more"]) == 59000


# -----------------------------------------------------------------------------------------------------------
# What other programs may write


def rewrite(file: h5py.File, path: str, values: Any, **options: Any) -> None:
    """Replace the values of a dataset, keeping its attributes."""
    attributes = dict(file[path].attrs)
    del file[path]
    file.create_dataset(path, data=values, **options)
    file[path].attrs.update(attributes)


def test_other_precisions_and_byte_orders_are_read_in_double_precision(copy):
    model = load_model(copy)
    with h5py.File(copy, "r+") as file:
        for path, kind in (
            ("bodies/blade/nd002/modes", "complex64"),
            ("bodies/blade/nd002/omega2", ">f8"),
            ("bodies/damper/load/displacement", "f4"),
            ("mesh/damper/quads", ">u2"),
        ):
            rewrite(file, path, file[path][()].astype(kind))
    again = load_model(copy)
    assert again.bodies["blade"].bases[2].omega2.dtype == np.dtype("float64")
    assert again.bodies["blade"].bases[2].contact_modes.dtype == np.dtype("complex128")
    assert np.array_equal(
        again.bodies["blade"].bases[2].omega2, model.bodies["blade"].bases[2].omega2
    )
    assert np.array_equal(again.meshes["damper"].quads, model.meshes["damper"].quads)


def test_texts_may_have_variable_length_and_numbers_one_element(copy):
    model = load_model(copy)
    with h5py.File(copy, "r+") as file:
        file.attrs["format"] = "bdamper-model"
        file.attrs["n_blades"] = np.array([12], dtype="i4")
        file["bodies/blade"].attrs["kind"] = np.array(["constrained"], dtype=object)
        file["bodies/blade"].attrs["ports"] = ["left.b", "right.b"]
        file["interfaces/left/area"].attrs["units"] = "m2"
        file["bodies/damper"].attrs["comment"] = "other attributes are left alone"
    assert_same(model, load_model(copy))


def test_a_file_without_creation_order_is_read_alphabetically(copy, tmp_path):
    with h5py.File(copy) as old, h5py.File(tmp_path / "plain.h5", "w") as new:
        new.attrs.update(old.attrs)
        for name in old:
            group = new.create_group(name)
            group.attrs.update(old[name].attrs)
            for member in old[name]:
                old.copy(f"{name}/{member}", group)
    model = load_model(tmp_path / "plain.h5")
    assert list(model.interfaces) == ["back", "front", "left", "right"]
    assert model.hash == load_model(copy).hash


def test_the_example_in_the_documentation_works(tmp_path, monkeypatch):
    text = (Path(__file__).parents[2] / "docs" / "specification" / "model-file.md").read_text(
        encoding="utf-8"
    )
    blocks = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    assert len(blocks) == 2
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    for block in blocks:
        exec(block, names)
    model = names["model"]
    assert model.bodies["beam"].ports == (("pad", "a"),)
    assert model.bodies["beam"].bases[0].locations["tip"][0, 0] == 2.1


RECORDS = [
    Body,
    BodyLoad,
    ContactStiffness,
    Interface,
    LocalBasis,
    Location,
    ModalBasis,
    SpeedBasis,
    SpinStatic,
]
RECORDS += [StaticContact, StressSet, SurfaceMesh]


def test_the_documentation_names_every_dataset_and_unit():
    text = (Path(__file__).parents[2] / "docs" / "specification" / "model-file.md").read_text(
        encoding="utf-8"
    )
    text = text[text.index("## Layout") : text.index("## What each body needs")]
    for item in (
        item
        for kind in RECORDS
        for item in layout(kind)
        if not item.is_attribute and not item.is_record
    ):
        assert item.data.units, item.name
        name = item.file.replace("*/", "").partition("/")[0]
        assert re.search(
            rf"^ +{name}\b.*\s{re.escape(item.data.units)}(\s|$)", text, re.MULTILINE
        ), name
    for convention in (model_file.TIME_CONVENTION, model_file.PHASE_CONVENTION):
        assert convention in text


# -----------------------------------------------------------------------------------------------------------
# One broken thing in a file


GROUP = object()
"""Value of a path at which a group is put."""


def put(path: str, value: Any) -> Callable[[h5py.File], None]:
    """Replace a group, dataset or attribute (``group@name``) by a value, by a function of its values, or by nothing."""
    place, _, name = path.partition("@")

    def change(file: h5py.File) -> None:
        if callable(value):
            rewrite(file, path, value(file[path][()]))
            return
        parent, key = (file[place or "/"].attrs, name) if name else (file, path)
        if key in parent:
            del parent[key]
        if value is GROUP:
            file.create_group(path)
        elif value is not None:
            parent[key] = value

    return change


def huge(file: h5py.File) -> None:
    rewrite(file, "bodies/blade/nd000/omega2", None, shape=(10**8,), dtype="f8", chunks=(10**6,))


def outside(file: h5py.File) -> None:
    name = "interfaces/left/gap"
    rewrite(file, name, None, shape=(1,), dtype="f8", external=[("/dev/zero", 0, 8)])


BROKEN: list[tuple[str, Any, str]] = [
    ("@format", "other", "'bdamper-model', found 'other'"),
    ("@format", 3, "a text, found "),
    ("@version", 1, "2, found 1"),
    ("@version", 1.0, "one integer, found "),
    ("@n_blades", None, "the attribute is missing"),
    ("@n_blades", [1, 2], "one integer, found "),
    ("@axis", [1.0, 0.0, 0.0], "[0.0, 0.0, 1.0], found [1.0, 0.0, 0.0]"),
    ("@time_convention", "exp(-i omega t)", "'exp(+i omega t)', found 'exp(-i omega t)'"),
    ("@phase_convention", "?", "'u(k+1) = "),
    ("bodies", None, "the group or dataset is missing"),
    ("bodies", 1.0, "a group, found a dataset"),
    ("bodies/blade@kind", "solid", "one of"),
    ("bodies/blade@ports", ["left", "right.b"], "pairs (interface, 'a' or 'b'), found ('left',)"),
    ("bodies/blade/wheel/disk_stiffness", lambda x: x[1:], "shape (7, any, any), found (6, 1, 1)"),
    ("bodies/blade/wheel/disk_stiffness", lambda x: -x, "blade and disk positive definite, found not at nodal diameter 0"),
    ("bodies/damper/inertia", None, "the inertia of a free body is missing"),
    ("interfaces/left/area", GROUP, "a dataset, found a group"),
    ("interfaces/left/gap", lambda _: ["0.0"], "real numbers, found data of type object"),
    ("interfaces/left/gap", lambda _: h5py.Empty("f8"), "numbers, found an empty"),
    ("interfaces/left/area", lambda x: x[0], "shape (any,), found ()"),
    ("interfaces/left/gap@units", None, "the attribute is missing"),
    ("interfaces/left/gap@units", "mm", "'m', found 'mm'"),
    ("locations/tip@body", "x", "a body of"),
    ("stress/root@body", "damper", "a constrained body of ['blade'], found 'damper'"),
    ("stress/root/nd000/mode_stress", lambda x: np.concatenate([x, x], axis=2), "shape (2, 6, 1), found (2, 6, 2)"),
    ("provenance@date", 2024, "a text, found"),
    ("interfaces/left/gap", h5py.SoftLink("/interfaces/right/gap"), "a group or dataset in this place, found a SoftLink"),
    (
        "bodies/blade", h5py.ExternalLink("other.h5", "/bodies/blade"),
        "a group or dataset in this place, found a ExternalLink",
    ),
    ("interfaces/left/gap", np.dtype("f8"), "a dataset, found a datatype"),
]  # fmt: skip
"""Path, its new value, and what the message expects there."""

CONTRADICTIONS: list[tuple[Callable[[h5py.File], None], str]] = [
    (
        lambda file: file.create_group("excitation"),
        "/excitation: expected no other names than ['bodies', 'interfaces', 'locations', 'contact', "
        "'static', 'mesh', 'provenance', 'stress', 'partial_contact'], found this one",
    ),
    (
        lambda file: file.move("bodies/blade/nd000/flexibility", "bodies/blade/nd000/flexability"),
        "/bodies/blade/nd000/flexability: expected no other names than ['omega2'",
    ),
    (
        lambda file: file.move("bodies/blade/nd002", "bodies/blade/nd2"),
        "/bodies/blade/nd2: expected no other names than ['nd000', 'mass'",
    ),
    (
        put("bodies/blade@ports", ["up.b", "right.b"]),
        "that name this body, [('left', 'b'), ('right', 'b')], found [('up', 'b'), ('right', 'b')]",
    ),
    (
        put("bodies/blade@ports", None),
        "/bodies/blade/@ports: expected the sides of interfaces that name this body, [('left', 'b'), ",
    ),
    (
        put("bodies/blade/wheel/damping_ratio", lambda x: np.append(x, x)),
        "/wheel/damping_ratio: expected shape (2,), found (4,)",
    ),
    (
        put("bodies/blade/wheel/disk_stiffness", lambda x: x * (1.0 + 0.1j)),
        "/wheel/disk_stiffness at nodal diameter 0: expected a Hermitian matrix",
    ),
    (put("bodies/blade/wheel/disk_stiffness", lambda x: 0.02 * x), "/wheel: expected frequencies of nd000 or above"),
    (put("bodies/blade/nd002/locations/tip", None), "nd002/locations: expected ['tip'], found []"),
    (put("stress/root/nd000", None), "/stress/root (nodal diameters): expected nodal diameter 0 and others of"),
    (huge, "nd000/omega2: expected 800000000 bytes for shape (100000000,), found 0 bytes in the file"),
    (outside, "/interfaces/left/gap: expected numbers stored in this file, found a reference to other"),
]  # fmt: skip
"""Change of a file, and the message, which names another place."""


def named(path: str, value: Any, expected: str) -> tuple[Callable[[h5py.File], None], str]:
    place = f"/{path}".replace("@", "/@").replace("//", "/")
    if expected.endswith("is missing"):
        return put(path, value), f"{place}: {expected}"
    return put(path, value), f"{place}: expected {expected}"


CASES = [*(named(*case) for case in BROKEN), *CONTRADICTIONS]


@pytest.mark.slow
@each(("change", "message"), CASES, ids=[message for _, message in CASES])
def test_one_broken_thing_is_named(saved, tmp_path, change, message):
    copy = shutil.copy(saved, tmp_path)
    with h5py.File(copy, "r+") as file:
        change(file)
    with pytest.raises(ModelError, match=re.escape(message)) as caught:
        load_model(copy)
    assert str(caught.value).startswith(f"{copy}: ")
    assert len(str(caught.value).splitlines()) == 1


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"there is no model file '.*nothing\.h5'"):
        load_model(tmp_path / "nothing.h5")


@pytest.mark.parametrize("content", [b"", b"no HDF5 file\n" * 50, b"\x89HDF\r\n\x1a\n"])
def test_other_files_are_refused(tmp_path, content):
    path = tmp_path / "other.h5"
    path.write_bytes(content)
    with pytest.raises(ModelError, match="expected a readable HDF5 file, found "):
        load_model(path)


def test_a_directory_is_refused(tmp_path):
    with pytest.raises(ModelError, match="expected a model file, found a folder"):
        load_model(tmp_path)


# -----------------------------------------------------------------------------------------------------------
# Damage at random: a ModelError or a valid model, and nothing else


def loads_or_says_why(path: Path) -> bool:
    try:
        model = load_model(path)
    except ModelError as error:
        said = str(error)
    else:
        assert isinstance(model, Model)
        return True
    assert len(said.splitlines()) == 1
    return False


ODD_VALUES: list[Any] = [
    0, -1, 3, 2.5, np.nan, "x", "", b"\xff\xfe", True, 1j, [], [1.0, 2.0], ["a", "b"], np.zeros((2, 2, 2, 2)),
    np.zeros((0, 3)), h5py.Empty("f8"), h5py.Empty("S5"), np.float32(1e30), np.uint64(2**64 - 1),
    np.array([(1, 2.0)], dtype=[("p", "i4"), ("q", "f8")]), h5py.SoftLink("/bodies"),
]  # fmt: skip


def numbers_changed(values: np.ndarray, rng: random.Random) -> np.ndarray:
    changed = np.array(values)
    if changed.dtype.kind not in "fciu" or changed.size == 0:
        return changed
    where = np.unravel_index(rng.randrange(changed.size), changed.shape)
    odd = (
        [0, -1, 7]
        if changed.dtype.kind in "iu"
        else [0, -1, 1e-30, 1e300, -1e300, np.nan, np.inf, 5e-324]
    )
    changed[where] = rng.choice(odd)
    return changed


def shape_changed(values: np.ndarray, rng: random.Random) -> np.ndarray:
    ways: list[Callable[[np.ndarray], np.ndarray]] = [
        np.ravel,
        np.transpose,
        lambda x: x[None],
        lambda x: x[..., None],
        lambda x: np.concatenate([np.atleast_1d(x)] * 2),
        lambda x: np.atleast_1d(x)[1:],
        lambda x: np.atleast_1d(x)[..., :-1],
    ]
    return rng.choice(ways)(values)


def type_changed(values: np.ndarray, rng: random.Random) -> np.ndarray:
    values = np.asarray(values)  # an earlier change may have left a text
    if values.dtype.kind not in "fciub":
        return values
    values = values.real if values.dtype.kind == "c" else values
    with np.errstate(all="ignore"):
        return values.astype(rng.choice(["f2", "f4", ">f8", "i4", "u1", "S8", "c8", "c16", "?"]))


def mutate(file: h5py.File, rng: random.Random) -> str:
    """Change one thing at random in the structure of a file; says what."""
    paths: list[str] = ["/"]
    file.visit(paths.append)
    path = rng.choice(paths)
    item = file[path]
    if path == "/" or rng.random() < 0.3:
        return mutate_attribute(item, path, rng)
    ways = ["delete", "replace", "rename", "move"]
    if isinstance(item, h5py.Dataset):
        ways += ["numbers", "shape", "type"] * 3
    way = rng.choice(ways)
    if way == "delete":
        del file[path]
    elif way == "replace":
        del file[path]
        if rng.random() < 0.2:
            file.create_group(path)
        else:
            file[path] = rng.choice(ODD_VALUES)
    elif way == "rename":
        file.move(path, path + rng.choice(["x", "0", ".a", " ", "é"]))
    elif way == "move":
        other = rng.choice([p for p in paths if p != "/" and not p.startswith(path)] or ["away"])
        file.move(path, other + "_moved")
    else:
        changed = {"numbers": numbers_changed, "shape": shape_changed, "type": type_changed}[way]
        rewrite(file, path, changed(item[()], rng))
    return f"{way} {path}"


def mutate_attribute(item: h5py.Group | h5py.Dataset, path: str, rng: random.Random) -> str:
    names = list(item.attrs)
    if not names:
        return "nothing"
    name = rng.choice(names)
    if rng.random() < 0.3:
        del item.attrs[name]
        return f"delete {path}@{name}"
    item.attrs[name] = rng.choice(ODD_VALUES[:-1])
    return f"replace {path}@{name}"


@pytest.mark.slow
@pytest.mark.parametrize(
    "part", [pytest.param(i, marks=[pytest.mark.slow] if i > 0 else []) for i in range(10)]
)
def test_structural_damage(saved, tmp_path, part):
    """250 cases in ten parts."""
    path = tmp_path / "damaged.h5"
    refused = 0
    for seed in range(25 * part, 25 * part + 25):
        rng = random.Random(seed)
        shutil.copy(saved, path)
        with h5py.File(path, "r+") as file:
            done = [mutate(file, rng) for _ in range(rng.choice([1, 1, 1, 2, 3]))]
        try:
            refused += not loads_or_says_why(path)
        except Exception as error:
            error.add_note(f"seed {seed}: {done}")
            raise
    assert refused > 12


def test_a_ground_body_needs_no_ports(copy):
    with h5py.File(copy, "r+") as file:
        del file["bodies/ground"].attrs["ports"]
    assert load_model(copy).bodies["ground"] == Body("ground", "ground")
