"""Records in HDF5: dataclasses described by the annotated types of their fields.

A :class:`Record` is a group.  Numbers and texts are attributes, arrays are datasets, mappings and nested records are
groups, and all other values are texts in JSON, also the objects in an array with named fields.  A field that is None is
omitted.  :class:`Data` sets units, type and path.

:func:`read_record` rejects unknown names, since a misspelt optional dataset would have no effect.  It also rejects links to
other places, external storage and virtual datasets, since a file must contain all its data.  It ignores other attributes.

:func:`check_record` checks type, shape and size of all data of a record; an error names the item.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import MISSING, InitVar, asdict, dataclass, fields, is_dataclass
from functools import cache
from types import NoneType, UnionType
from typing import (
    Annotated,
    Any,
    Literal,
    NamedTuple,
    Union,
    cast,
    get_args,
    get_origin,
    get_type_hints,
)

import h5py
import numpy as np
from numpy.typing import NDArray

from bdamper.util.errors import check, mismatch
from bdamper.util.validation import Limits, declarations, suggest_name

MOST_EXPANDED = 1100
"""Largest possible ratio of compression: deflate reaches 1032, a larger ratio indicates damage."""
COMPRESS_FROM = 4096
"""Size in bytes from which datasets are compressed."""
TYPES = {
    "real": ("f", "real numbers"),
    "field": ("fc", "real or complex numbers"),
    "picture": ("fc", "real or complex numbers"),
    "integer": ("iu", "integers"),
    "bool": ("b", "booleans"),
}
"""Type letters of NumPy and description of each ``kind`` of :class:`Data`."""
Kind = Callable[..., Any]
"""Class of a record."""
Shape = tuple[int | str | None, ...]
Sizes = dict[str, int | None]
"""Sizes by name; None if unknown."""
ANY = Limits()
SINGLE, ROUNDING = 1e-6, 1e-8
"""Relative tolerances: for data that are often in single precision (normals, modes), and for the rounding of a large
factorisation.
"""
_SINGLE = {"f": np.float32, "c": np.complex64}
_NATIVE = {"f": np.float64, "c": np.complex128, "i": np.int64, "u": np.int64, "b": np.bool_}
_DIAMETER = re.compile(r"nd(\d{3,9})", re.ASCII)

# ---- Description of the fields ----


class Record:
    """Mixin of dataclasses that are stored as a group."""

    def check_rows(self) -> None:
        """Raise ValueError if fields of the same dimension differ in length, as in a damaged file."""


@dataclass(frozen=True)
class Data:
    """Mark of a field in its annotated type: storage in a file, and checks.

    Parameters
    ----------
    units : str
        Units of a dataset in a file.  A number without units is an attribute.
    shape : tuple of int, str or None
        A named size has one value within a record; None is any size.
    kind : {"real", "field", "picture", "integer", "bool"}
        Type of the numbers.  "field" and "picture" are real or complex; a file contains a picture in single precision.
    file : str
        Path in a file, by default the name of the field.  A star is replaced by the key of a mapping, "nd000" for the
        number 0.
    limits : Limits
        Limits of all numbers.
    matrix : {"", "symmetric", "Hermitian", "skew-Hermitian"}
    derived : bool
        Whether a file may omit it, since it follows from other data.
    """

    units: str = ""
    shape: Shape = ()
    kind: Literal["real", "field", "picture", "integer", "bool"] = "real"
    file: str = ""
    limits: Limits = ANY
    matrix: Literal["", "symmetric", "Hermitian", "skew-Hermitian"] = ""
    derived: bool = False


GroupName = Annotated[str, Data(file=".")]
"""Name of a record, which is the name of its group."""


class Item(NamedTuple):
    """Field of a record.

    Parameters
    ----------
    name : str
    kind : type
        Type of the field, or of the values of its mapping or tuple of records.
    keys : type or None
        Type of the keys of a mapping; tuple for a tuple of records.
    optional, required : bool
        Whether it may be None, and whether every file must contain it.
    data : Data
    """

    name: str
    kind: Any
    keys: type | None
    optional: bool
    required: bool
    data: Data

    @property
    def file(self) -> str:
        """Path in a file."""
        return self.data.file or (f"{self.name}/*" if self.keys else self.name)

    @property
    def pattern(self) -> str:
        """Path in a file, with "nd000" for any nodal diameter, and "@" for a group of attributes."""
        return self.file.replace(
            "*", "nd000" if self.keys is int else "@" if self.is_attribute else "*"
        )

    @property
    def is_record(self) -> bool:
        return isinstance(self.kind, type) and issubclass(self.kind, Record)

    @property
    def is_attribute(self) -> bool:
        """Whether it is an attribute in a file: a number, a text, or names with dots."""
        plain = (
            self.kind in (int, float, str, tuple[tuple[str, str], ...])
            or get_origin(self.kind) is Literal
        )
        return plain and not self.data.units

    def place(self, key: object = "") -> str:
        """Return the path of the value of a key in a file."""
        name = f"nd{key:03d}" if self.keys is int and key != "" else str(key)
        return self.file.replace("*", name).rstrip("/")


@cache
def layout(cls: Kind) -> tuple[Item, ...]:
    """Return the fields of a record, without the name of its group."""
    items = (_item(cls, field) for field in fields(cast(Any, cls)))
    return tuple(item for item in items if item.file != ".")


def is_array(hint: object) -> bool:
    """Return whether a type hint is an array; the alias of NumPy has an origin only in some versions."""
    return np.ndarray is get_origin(hint) or NDArray in (hint, get_origin(hint))


def _item(cls: Kind, field: Any) -> Item:
    kind, optional, _ = declared = declarations(cls)[field.name]
    keys, inner = None, get_args(kind)
    if get_origin(kind) in (Mapping, dict) and inner[1] is not Any:
        keys, kind = inner
    elif get_origin(kind) is tuple and isinstance(inner[0], type) and issubclass(inner[0], Record):
        keys, kind = tuple, inner[0]
    kind = np.ndarray if is_array(kind) else kind
    data = declared.mark(Data) or Data()
    optional = optional or kind is Any
    default = field.default is not MISSING or field.default_factory is not MISSING
    return Item(
        field.name, kind, keys, optional, not (optional or data.derived or (default and keys)), data
    )


# ---- Writing ----


def write_record(group: h5py.Group, record: object) -> None:
    """Write the fields of a record into a group."""
    for item in layout(cast(Kind, type(record))):
        value = getattr(record, item.name)
        if value is None:
            continue
        if item.keys:
            new_group(group, item.file.rpartition("*")[0])
        parts = (
            enumerate(value)
            if item.keys is tuple
            else value.items()
            if item.keys
            else [("", value)]
        )
        for key, part in parts:
            _write(group, item.place(key), part, item)


def _write(group: h5py.Group, path: str, value: Any, item: Item) -> None:
    if item.is_record:
        write_record(new_group(group, path), value)
        return
    head, _, name = path.rpartition("/")
    owner = new_group(group, head)
    if isinstance(value, np.ndarray) or item.kind is np.ndarray or item.data.units:
        _write_array(owner, name, np.asarray(value), item.data)
    elif item.kind in (int, float):
        owner.attrs[name] = item.kind(value)
    elif item.is_attribute:
        write_text(
            owner, name, value if isinstance(value, str) else [".".join(names) for names in value]
        )
    else:
        plain: Any = asdict  # also of a dataclass in a tuple; in mappings it becomes its text
        if isinstance(value, tuple):
            value = [plain(part) if is_dataclass(part) else part for part in value]
        owner[name] = json.dumps(plain(value) if is_dataclass(value) else value, default=to_json)


def new_group(group: h5py.Group, path: str) -> h5py.Group:
    """Return a group with the path, which stores the order of its members; create it if there is none."""
    for name in filter(None, path.split("/")):
        group = group[name] if name in group else group.create_group(name, track_order=True)
    return group


def _write_array(group: h5py.Group, name: str, array: NDArray, data: Data) -> None:
    array = array.astype(_SINGLE[array.dtype.kind]) if data.kind == "picture" else array
    array = _texts_of_objects(array) if array.dtype.kind == "V" else array
    large = {"compression": "gzip", "compression_opts": 4, "shuffle": True}
    dataset = group.create_dataset(
        name, data=array, **large if array.nbytes > COMPRESS_FROM else {}
    )
    if data.units:
        write_text(dataset, "units", data.units)


def write_text(owner: h5py.Group | h5py.Dataset, name: str, text: str | list[str]) -> None:
    """Write one text or several texts as an attribute of fixed length.

    C, Fortran and MATLAB read fixed lengths easily.  HDF5 stores texts of variable length in a heap; with a damaged byte
    reading it may not terminate.
    """
    encoded = np.array(
        text.encode() if isinstance(text, str) else [part.encode() for part in text], dtype="S"
    )
    owner.attrs.create(name, encoded, dtype=h5py.string_dtype(length=encoded.dtype.itemsize or 1))


# ---- Reading ----


def place(parent: h5py.Group | h5py.Dataset, name: str = "") -> str:
    """Return the path of an object for messages, ``file: /path/in/the/file``."""
    path = f"{parent.name.rstrip('/')}/{name}" if name else parent.name
    return f"{parent.file.filename}: {path}"


def read_record(group: h5py.Group, kind: Kind) -> Any:
    """Read a record written by :func:`write_record`; fields that are missing and follow from other data are None."""
    items = layout(kind)
    _check_names(group, [item.pattern for item in items if item.keys or not item.is_attribute])
    values = {"name": group.name.rsplit("/", 1)[-1]} if "name" in declarations(kind) else {}
    for item in items:
        value = _read_members(group, item) if item.keys else _read(group, item.file, item)
        if value is None and item.required:
            _fail_missing(group, item)
        if value is not None or (item.kind is np.ndarray and item.data.derived):
            values[item.name] = value
    record = kind(**values)
    record.check_rows()
    return record


def _fail_missing(group: h5py.Group, item: Item) -> None:
    sign, expected = ("@", "this attribute") if item.is_attribute else ("", "this group or dataset")
    check(False, place(group, sign + item.place()), expected, "nothing")


def _read_members(group: h5py.Group, item: Item) -> Any:
    """Return the mapping or tuple of a field, or None if its group is missing."""
    head, _, tail = item.file.partition("*")
    if head and head[:-1] not in group:
        return None
    parent = subgroup(group, head[:-1]) if head else group
    names: dict[Any, str] = {name: name for name in (parent.attrs if item.is_attribute else parent)}
    if item.keys is int:
        names = {int(found[1]): name for name in names if (found := _DIAMETER.fullmatch(name))}
    elif item.keys is tuple:
        names = dict(sorted((int(name), name) for name in names))
    parts = {key: _read(parent, name + tail, item) for key, name in names.items()}
    parts = {key: value for key, value in parts.items() if value is not None}
    return tuple(parts.values()) if item.keys is tuple else parts


def _read(group: h5py.Group, path: str, item: Item) -> Any:
    """Return a value, or None if it is missing."""
    head, _, name = path.rpartition("/")
    owner = subgroup(group, head) if head else group
    if item.is_attribute and name in owner.attrs:
        return read_attribute(owner, name, item.kind)
    if name not in owner:
        return None
    return (
        read_record(subgroup(owner, name), item.kind)
        if item.is_record
        else _read_dataset(owner, name, item)
    )


def _check_names(group: h5py.Group, paths: Iterable[str]) -> None:
    """Check that a group contains no unknown names and no links to other places."""
    known = [path.partition("/")[::2] for path in paths]
    for name in group:
        check_link(group, name)
        below = [
            rest
            for head, rest in known
            if head in (name, "*") or (head == "nd000" and _DIAMETER.fullmatch(name))
        ]
        names = list(dict.fromkeys(head for head, _ in known))
        check(
            below,
            place(group, name),
            f"no other names than {names}",
            f"this one{suggest_name(name, names)}",
        )
        if any(below):
            _check_names(subgroup(group, name), below)


def check_link(group: h5py.Group, name: str) -> None:
    link = group.get(name, getlink=True)
    good = isinstance(link, h5py.HardLink)
    check(good, place(group, name), "a group or dataset in this place", f"a {type(link).__name__}")


def subgroup(group: h5py.Group, name: str) -> h5py.Group:
    check_link(group, name)
    member = group[name]
    check(
        isinstance(member, h5py.Group),
        place(group, name),
        "a group",
        f"a {type(member).__name__.lower()}",
    )
    return member


def _read_dataset(group: h5py.Group, name: str, item: Item) -> Any:
    """Read an array in double precision (or int64, bool), a number with units, or a value in JSON."""
    dataset, at, data = group[name], place(group, name), item.data
    check(isinstance(dataset, h5py.Dataset), at, "a dataset", f"a {type(dataset).__name__.lower()}")
    _check_storage(dataset, at)
    if not data.units:
        if dataset.dtype.kind == "V":
            return _objects_of_texts(dataset[()])
        text = h5py.check_string_dtype(dataset.dtype) is not None
        return from_json(item.kind, json.loads(dataset[()])) if text else dataset[()]
    letters, words = TYPES[data.kind]
    check(dataset.dtype.kind in letters, at, words, f"data of type {dataset.dtype}")
    check_text(dataset, "units", data.units, "; convert the numbers")
    array = np.asarray(dataset[()])
    array = array.astype(_NATIVE[array.dtype.kind], copy=False)
    check(item.kind is not float or array.shape == (), at, "shape ()", f"{array.shape}")
    return float(array) if item.kind is float else array


def _check_storage(dataset: h5py.Dataset, item: str) -> None:
    """Check that the numbers are stored in this file, and that it has enough bytes for them."""
    elsewhere = dataset.is_virtual or dataset.external is not None
    check(not elsewhere, item, "numbers stored in this file", "a reference to other files")
    check(dataset.shape is not None, item, "numbers", "an empty dataset")
    stored = dataset.id.get_storage_size()
    wanted = dataset.size * dataset.dtype.itemsize
    within = wanted <= MOST_EXPANDED * stored
    check(within, item, f"{wanted} bytes for shape {dataset.shape}", f"{stored} bytes in the file")


def check_text(owner: h5py.Group | h5py.Dataset, name: str, expected: str, cure: str = "") -> None:
    found = read_attribute(owner, name)
    check(found == expected, place(owner, f"@{name}"), f"'{expected}'", f"'{found}'{cure}")


def read_attribute(owner: h5py.Group | h5py.Dataset, name: str, kind: object = str) -> Any:
    """Read one text (by default), one number, or names with dots as tuples of texts."""
    at = place(owner, f"@{name}")
    check(name in owner.attrs, at, "this attribute", "nothing")
    value = owner.attrs[name]
    if kind in (int, float):
        letters, expected = ("iu", "one integer") if kind is int else ("fiu", "one number")
        number = np.asarray(value)
        check(number.dtype.kind in letters and number.size == 1, at, expected, repr(value))
        return number.item() if kind is int else float(number.item())
    if get_origin(kind) is tuple:
        return tuple(tuple(_text(part, at).rsplit(".", 1)) for part in np.atleast_1d(value).ravel())
    return _text(value, at)


def _text(value: Any, item: str) -> str:
    """Convert an attribute to a text, also from fixed length or from an array of one element."""
    if isinstance(value, np.ndarray) and value.size == 1:
        value = value.reshape(-1)[0]
    if isinstance(value, bytes):
        value = value.decode("utf-8", errors="replace")
    check(isinstance(value, str), item, "a text", repr(value))
    return str(value)


# ---- Arrays with named fields ----


def named_fields(columns: Mapping[str, Sequence[Any] | NDArray], n: int) -> NDArray:
    """Return an array (n,) with a field for each column: float, int or bool if all its values are, otherwise objects.

    None, a missing value, is NaN in a field of floats.
    """
    arrays = {name: _narrowed(column) for name, column in columns.items()}
    out = np.zeros(n, [(name, array.dtype) for name, array in arrays.items()])
    for name, array in arrays.items():
        out[name] = array
    return out


def _narrowed(column: Sequence[Any] | NDArray) -> NDArray:
    if isinstance(column, np.ndarray) and column.dtype != object:
        return column
    values, kinds = list(column), {*map(type, column)}
    narrow = kinds in ({int}, {bool}, {float}, {float, NoneType})
    return (
        np.array(values, float if float in kinds else None)
        if narrow
        else np.fromiter(values, object, len(values))
    )


def names_of(rows: NDArray) -> tuple[str, ...]:
    """Return the names of the fields of an array."""
    return rows.dtype.names or ()


def row_of(rows: NDArray, i: int) -> dict[str, Any]:
    """Return the values of a row by the names of the fields."""
    return dict(zip(names_of(rows), rows[i].item()))


def numbers_of(rows: NDArray, name: str) -> NDArray:
    """Return a field as (n,) float; NaN if there is no such field or no value."""
    return rows[name].astype(float) if name in names_of(rows) else np.full(len(rows), np.nan)


def _texts_of_objects(rows: NDArray) -> NDArray:
    objects = {name: rows.dtype[name].hasobject for name in names_of(rows)}
    kinds = [(name, h5py.string_dtype() if objects[name] else rows.dtype[name]) for name in objects]
    out = np.zeros(len(rows), kinds or "V1")
    for name in objects:
        out[name] = (
            [json.dumps(v, default=to_json) for v in rows[name]] if objects[name] else rows[name]
        )
    return out


def _objects_of_texts(stored: NDArray) -> NDArray:
    columns: dict[str, Any] = {name: stored[name] for name in names_of(stored)}
    for name, column in columns.items():
        if column.dtype == object:
            known = {
                text: json.loads(text) for text in set(column)
            }  # equal values share their memory
            columns[name] = [known[text] for text in column]
    return named_fields(columns, len(stored))


# ---- JSON ----


def from_json(hint: object, value: object) -> Any:
    """Convert a value read from JSON to the annotated type of its field."""
    return _from_json(hint, value)


def _from_json(hint: Any, value: Any) -> Any:
    origin, inner = get_origin(hint), get_args(hint)
    if value is None or hint is Any or origin in (dict, Mapping):
        return value
    if is_array(hint):
        return (
            value["real"] + 1j * np.array(value["imag"])
            if isinstance(value, Mapping)
            else np.array(value)
        )
    if origin is tuple:
        kinds = inner[:1] * len(value) if inner[-1] is ... else inner
        return tuple(_from_json(kind, item) for kind, item in zip(kinds, value))
    if isinstance(hint, InitVar):
        return _from_json(hint.type, value)
    if origin in (Union, UnionType):
        given = [kind for kind in inner if kind is not NoneType]
        if len(given) == 1:
            return _from_json(given[0], value)
        return tuple(value) if isinstance(value, list) else value  # such as int | tuple[int, ...]
    if is_dataclass(hint):
        hints = get_type_hints(hint)
        known = {
            name: _from_json(hints[name], item) for name, item in value.items() if name in hints
        }
        return hint(**known)  # type: ignore[operator]
    if isinstance(hint, type) and issubclass(hint, tuple):  # named tuple
        return hint(*value)
    return hint(value)


def to_json(value: Any) -> Any:
    """Convert arrays and numbers of NumPy, mappings and small dataclasses for JSON."""
    if isinstance(value, np.ndarray):
        return (
            {"real": value.real.tolist(), "imag": value.imag.tolist()}
            if np.iscomplexobj(value)
            else value.tolist()
        )
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, Mapping):
        return dict(value)
    if is_dataclass(value) and not isinstance(value, type):
        return repr(value)
    raise TypeError(f"expected a number, a text, a list or a mapping, found {type(value).__name__}")


# ---- Check of a record ----


def check_record(record: object, kind: Kind, item: str, sizes: Sizes | None = None) -> None:
    """Check the fields of a record against the annotated types of its class; nested records are not checked.

    Parameters
    ----------
    record : object
    kind : type
        Required type.
    item : str
        Name in messages.
    sizes : dict of str to int, optional
        Known sizes.
    """
    check_type(record, cast(type, kind), item)
    known = dict(sizes or {})
    # vectors show the named sizes
    for field in sorted(
        layout(kind), key=lambda field: (len(field.data.shape) > 1, field.keys is not None)
    ):
        value = getattr(record, field.name)
        if field.is_record or (value is None and field.optional):
            continue
        if field.keys is not None:
            check_type(value, Mapping, f"{item}/{field.place()}")
        sign = "@" if field.is_attribute else ""
        for key, part in value.items() if field.keys is not None else (("", value),):
            _check_value(part, field, f"{item}/{sign}{field.place(key)}", known)


def _check_value(value: Any, field: Item, item: str, sizes: Sizes) -> None:
    kind, limits = field.kind, field.data.limits
    if kind is np.ndarray:
        _check_array(value, field.data, item, sizes)
    elif kind is int:
        check_integer(value, item)
    elif kind is float:
        good = (
            isinstance(value, int | float | np.floating)
            and np.isfinite(value)
            and limits.hold(float(value))
        )
        check(good, item, f"a finite number {limits}", repr(value))
    elif kind is str:
        check(isinstance(value, str), item, "a text", repr(value))
    elif get_origin(kind) is Literal:
        check(value in get_args(kind), item, f"one of {list(get_args(kind))}", repr(value))


def _check_array(array: Any, data: Data, item: str, sizes: Sizes) -> None:
    """Check type, shape, finiteness, limits and symmetry; add the named sizes of the array to ``sizes``."""
    check(isinstance(array, np.ndarray), item, "a NumPy array", f"a {type(array).__name__}")
    letters, words = TYPES[data.kind]
    double = array.dtype in (np.float64, np.complex128) or "f" not in letters
    expected = f"{words} in double precision" if "f" in letters else words
    check(double and array.dtype.kind in letters, item, expected, f"dtype {array.dtype}")
    shape = [sizes.get(n) if isinstance(n, str) else n for n in data.shape]  # None is any size
    fits = len(shape) == array.ndim and all(
        n in (None, found) for n, found in zip(shape, array.shape)
    )
    text = ", ".join("any" if n is None else str(n) for n in shape)
    check(fits, item, f"shape ({text},)" if len(shape) == 1 else f"shape ({text})", array.shape)
    for name, size in zip(data.shape, array.shape):
        sizes.setdefault(str(name), size)
    check_all(np.isfinite(array), array, "finite numbers", item)
    if str(data.limits):
        check_all(data.limits.hold(array), array, f"numbers {data.limits}", item)
    if data.matrix:
        check_hermitian(1j * array if data.matrix == "skew-Hermitian" else array, item, data.matrix)


# ---- Checks of values ----


def check_integer(value: object, item: str) -> None:
    check(
        isinstance(value, int | np.integer) and not isinstance(value, bool),
        item,
        "an integer",
        repr(value),
    )


def check_type(value: object, expected: type, item: str) -> None:
    check(isinstance(value, expected), item, f"a {expected.__name__}", f"a {type(value).__name__}")


def check_all(good: NDArray, array: NDArray, expected: str, item: str) -> None:
    """Raise an error that shows the first element of ``array`` with a False entry in ``good``."""
    wrong = np.argwhere(~good)
    if len(wrong):
        at = tuple(int(i) for i in wrong[0])
        raise mismatch(
            item,
            expected,
            f"{array[at]!s} at {at if len(at) > 1 else at[0]}, one of {len(wrong)} wrong values",
        )


def check_hermitian(matrix: NDArray, item: str, word: str = "Hermitian") -> None:
    check(matrix.shape[0] == matrix.shape[1], item, f"a {word} matrix", f"shape {matrix.shape}")
    error = np.abs(matrix - matrix.conj().T)
    size = np.abs(matrix).max(initial=0.0)
    if not error.max(initial=0.0) <= ROUNDING * size:
        at = tuple(int(i) for i in np.unravel_index(np.argmax(error), error.shape))
        raise mismatch(
            item, f"a {word} matrix", f"a difference of {error[at]:.3g} at {at}, size {size:.3g}"
        )


def is_positive_definite(matrix: NDArray) -> bool:
    try:
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        return False
    return True
