"""Records in HDF5: dataclasses described by the annotated types of their fields.

A :class:`Record` is a group.  Numbers and texts are attributes, arrays are datasets, mappings and
nested records are groups, and all other values are texts in JSON, also the objects in an array with
named fields.  A field that is None is omitted.  :class:`Data` sets units, type and path.

:func:`read_record` rejects unknown names, because a misspelt optional dataset would have no effect.
It also rejects links to other places, external storage and virtual datasets, because a file must
contain all its data.  It ignores other attributes.

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

from bdamper.util.errors import ModelError, check, check_sentence, mismatch, separated
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
"""Relative tolerances: for data that are often in single precision (normals, modes), and for the
rounding of a large factorisation.
"""
_SINGLE = {"f": np.float32, "c": np.complex64}
_NATIVE = {"f": np.float64, "c": np.complex128, "i": np.int64, "u": np.int64, "b": np.bool_}
_DIAMETER = re.compile(r"nd(\d{3,9})", re.ASCII)

# ---- Description of the fields ----


class Record:
    """Mixin of dataclasses that are stored as a group."""

    def check_rows(self) -> None:
        """Raise ValueError if fields of one dimension differ in length, as in a damaged file."""


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
        Type of the numbers.  "field" and "picture" are real or complex; a file contains a picture
        in single precision.
    file : str
        Path in a file, by default the name of the field.  A star is replaced by the key of a
        mapping, "nd000" for the number 0.
    limits : Limits
        Limits of all numbers.
    matrix : {"", "symmetric", "Hermitian", "skew-Hermitian"}
    derived : bool
        Whether a file may omit it, because it follows from other data.
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

Reason = Annotated[str, Data(derived=True)]
"""Reason for a status.  Files of version 0.10 have it in the status
(:func:`with_separate_reasons`)."""


class Item(NamedTuple):
    """Field of a record.

    Parameters
    ----------
    name : str
    kind : type
        Type of the field.  For a mapping or a tuple of records, type of each value.
    keys : type or None
        For a mapping, type of the keys.  ``tuple`` for a tuple of records, otherwise None.
    optional : bool
        Whether the field may be None.
    required : bool
        Whether every file must contain the field.
    data : Data
        Units, shape and limits of the field.
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
        """Path in a file; "nd000" is any nodal diameter, "@" a group of attributes."""
        star = "*"
        if self.keys is int:
            star = "nd000"
        elif self.is_attribute:
            star = "@"
        return self.file.replace("*", star)

    @property
    def is_record(self) -> bool:
        return isinstance(self.kind, type) and issubclass(self.kind, Record)

    @property
    def is_attribute(self) -> bool:
        """Whether it is an attribute in a file: a number, a text, or names with dots."""
        if self.data.units:
            return False
        is_plain = self.kind in (int, float, str, tuple[tuple[str, str], ...])
        return is_plain or get_origin(self.kind) is Literal

    def place(self, key: object = "") -> str:
        """Return the path of the value of a key in a file."""
        key_name = str(key)
        if self.keys is int and key != "":
            key_name = f"nd{key:03d}"
        return self.file.replace("*", key_name).rstrip("/")


@cache
def layout(cls: Kind) -> tuple[Item, ...]:
    """Return the fields of a record, without the name of its group."""
    items = (_item(cls, field) for field in fields(cast(Any, cls)))
    return tuple(item for item in items if item.file != ".")


def is_array(hint: object) -> bool:
    """Return whether a type hint is an array.

    The alias of NumPy has an origin only in some versions.
    """
    return np.ndarray is get_origin(hint) or NDArray in (hint, get_origin(hint))


def _item(cls: Kind, field: Any) -> Item:
    """Return the description of a field of a dataclass from its type hint and default.

    A mapping of known types has the type of its keys, a tuple of records has the keys ``tuple``,
    and any other field has none.
    """
    declared = declarations(cls)[field.name]
    data = declared.mark(Data) or Data()
    kind = declared.kind
    keys = None
    origin = get_origin(kind)
    arguments = get_args(kind)
    if origin in (Mapping, dict):
        key_type, value_type = arguments
        if value_type is not Any:
            keys = key_type
            kind = value_type
    elif origin is tuple:
        item_type = arguments[0]
        if isinstance(item_type, type) and issubclass(item_type, Record):
            keys = tuple
            kind = item_type
    if is_array(kind):
        kind = np.ndarray
    optional = declared.optional or kind is Any
    has_default = field.default is not MISSING or field.default_factory is not MISSING
    # an empty mapping has no group in a file
    may_be_missing = optional or data.derived or (has_default and bool(keys))
    return Item(
        name=field.name,
        kind=kind,
        keys=keys,
        optional=optional,
        required=not may_be_missing,
        data=data,
    )


# ---- Writing ----


def write_record(group: h5py.Group, record: object) -> None:
    """Write the fields of a record into a group."""
    for item in layout(cast(Kind, type(record))):
        value = getattr(record, item.name)
        if value is None:
            continue
        if not item.keys:
            _write(group, item.place(), value, item)
            continue
        # the path of the field has a star for the key; an empty mapping leaves an empty group
        before_key, _, _ = item.file.rpartition("*")
        new_group(group, before_key)
        parts = enumerate(value) if item.keys is tuple else value.items()
        for key, part in parts:
            _write(group, item.place(key), part, item)


def _write(group: h5py.Group, path: str, value: Any, item: Item) -> None:
    """Write one value of a field at a path below a group.

    Records become groups, arrays and numbers with units datasets, other numbers and texts
    attributes, and all other values texts in JSON.
    """
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
        # a text, or tuples of names, each written with dots
        text = value if isinstance(value, str) else [".".join(names) for names in value]
        write_text(owner, name, text)
    else:
        owner[name] = json.dumps(_plain(value), default=to_json)


def _plain(value: Any) -> Any:
    """Return a dataclass, also one in a tuple, as a mapping; in mappings it becomes its text."""
    if isinstance(value, tuple):
        return [_mapping_of(part) for part in value]
    return _mapping_of(value)


def _mapping_of(value: Any) -> Any:
    return asdict(value) if is_dataclass(value) else value  # type: ignore[arg-type]


def new_group(group: h5py.Group, path: str) -> h5py.Group:
    """Return a group with the path, which stores the order of its members.

    Create it if there is none.
    """
    for name in filter(None, path.split("/")):
        if name in group:
            group = group[name]
        else:
            group = group.create_group(name, track_order=True)
    return group


def _write_array(group: h5py.Group, name: str, array: NDArray, data: Data) -> None:
    if data.kind == "picture":
        array = array.astype(_SINGLE[array.dtype.kind])
    if array.dtype.kind == "V":
        array = _texts_of_objects(array)
    compression: dict[str, Any] = {}
    if array.nbytes > COMPRESS_FROM:
        compression = {"compression": "gzip", "compression_opts": 4, "shuffle": True}
    dataset = group.create_dataset(name, data=array, **compression)
    if data.units:
        write_text(dataset, "units", data.units)


def write_text(owner: h5py.Group | h5py.Dataset, name: str, text: str | list[str]) -> None:
    """Write one text or several texts as an attribute of fixed length.

    C, Fortran and MATLAB read fixed lengths easily.  HDF5 stores texts of variable length in a
    heap; with a damaged byte reading it may not terminate.
    """
    if isinstance(text, str):
        encoded = np.array(text.encode(), dtype="S")
    else:
        encoded = np.array([part.encode() for part in text], dtype="S")
    length = encoded.dtype.itemsize or 1
    owner.attrs.create(name, encoded, dtype=h5py.string_dtype(length=length))


# ---- Reading ----


def place(parent: h5py.Group | h5py.Dataset, name: str = "") -> str:
    """Return the path of an object for messages, ``file: /path/in/the/file``."""
    path = f"{parent.name.rstrip('/')}/{name}" if name else parent.name
    return f"{parent.file.filename}: {path}"


def read_record(group: h5py.Group, kind: Kind) -> Any:
    """Read a record written by :func:`write_record`.

    Fields that are missing and follow from other data are None.
    """
    items = layout(kind)
    _check_names(group, [item.pattern for item in items if item.keys or not item.is_attribute])
    values = {}
    if "name" in declarations(kind):
        values["name"] = group.name.rsplit("/", 1)[-1]
    for item in items:
        value = _read_members(group, item) if item.keys else _read(group, item.file, item)
        if value is None and item.required:
            _fail_missing(group, item)
        # an array that follows from other data has no default
        is_derived_array = item.kind is np.ndarray and item.data.derived
        if value is not None or is_derived_array:
            values[item.name] = value
    record = kind(**with_separate_reasons(values, [item.name for item in items]))
    record.check_rows()
    return record


def with_separate_reasons(values: dict[str, Any], names: Iterable[str]) -> dict[str, Any]:
    """Return the stored values of the fields ``names``, with each status apart from its reason.

    In files of version 0.10 some statuses, or all those of the rows of a table, are followed by their
    reason: "incomplete: the reason".
    """
    separate = dict(values)
    for name in names:
        status_name = f"{name.removesuffix('reason')}status"
        text = values.get(status_name)
        if not name.endswith("reason") or not isinstance(text, str | tuple):
            continue
        status: Any
        reason: Any
        if isinstance(text, str):
            status, reason = separated(text)
        else:
            pairs = [separated(of_row) for of_row in text]
            status = tuple(of_row for of_row, _ in pairs)
            reason = tuple(of_row for _, of_row in pairs)
        separate[status_name] = status
        # a motion from time integration had a reason for its verdict as well
        separate[name] = values.get(name) or reason
    return separate


def _fail_missing(group: h5py.Group, item: Item) -> None:
    if item.is_attribute:
        raise ModelError(f"{place(group, f'@{item.place()}')}: the attribute is missing")
    raise ModelError(f"{place(group, item.place())}: the group or dataset is missing")


def _read_members(group: h5py.Group, item: Item) -> Any:
    """Return the mapping or tuple of a field, or None if its group is missing."""
    head, _, tail = item.file.partition("*")
    parent = group
    if head:
        group_name = head.removesuffix("/")
        if group_name not in group:
            return None
        parent = subgroup(group, group_name)
    members = parent.attrs if item.is_attribute else parent
    name_of_key: dict[Any, str] = {name: name for name in members}
    if item.keys is int:
        # other members of the group do not belong to the field
        matches = [_DIAMETER.fullmatch(name) for name in members]
        name_of_key = {int(match[1]): match[0] for match in matches if match}
    elif item.keys is tuple:
        # in the order of the numbers, 2 before 10
        name_of_key = dict(sorted((int(name), name) for name in members))
    parts = {}
    for key, name in name_of_key.items():
        value = _read(parent, name + tail, item)
        if value is not None:
            parts[key] = value
    return tuple(parts.values()) if item.keys is tuple else parts


def _read(group: h5py.Group, path: str, item: Item) -> Any:
    """Return a value, or None if it is missing."""
    head, _, name = path.rpartition("/")
    owner = subgroup(group, head) if head else group
    if item.is_attribute and name in owner.attrs:
        return read_attribute(owner, name, item.kind)
    if name not in owner:
        return None
    if item.is_record:
        return read_record(subgroup(owner, name), item.kind)
    return _read_dataset(owner, name, item)


def _check_names(group: h5py.Group, paths: Iterable[str]) -> None:
    """Check that a group contains no unknown names and no links to other places."""
    # first name of each path, and the rest of the path below it
    known: list[tuple[str, str]] = []
    for path in paths:
        head, _, rest = path.partition("/")
        known.append((head, rest))
    names = list(dict.fromkeys(head for head, _ in known))
    for name in group:
        check_link(group, name)
        below = [rest for head, rest in known if _allows(head, name)]
        hint = f"this one{suggest_name(name, names)}"
        check(below, place(group, name), f"no other names than {names}", hint)
        if any(below):
            _check_names(subgroup(group, name), below)


def _allows(pattern: str, name: str) -> bool:
    """Return whether a name of a group matches a name of :attr:`Item.pattern`."""
    if pattern == "nd000" and _DIAMETER.fullmatch(name):
        return True
    return pattern in (name, "*")


def check_link(group: h5py.Group, name: str) -> None:
    link = group.get(name, getlink=True)
    good = isinstance(link, h5py.HardLink)
    check(good, place(group, name), "a group or dataset in this place", f"a {type(link).__name__}")


def subgroup(group: h5py.Group, name: str) -> h5py.Group:
    check_link(group, name)
    member = group[name]
    kind = type(member).__name__.lower()
    check(isinstance(member, h5py.Group), place(group, name), "a group", f"a {kind}")
    return member


def _read_dataset(group: h5py.Group, name: str, item: Item) -> Any:
    """Read an array (double precision, int64 or bool), a number with units, or a value in JSON."""
    dataset = group[name]
    path = place(group, name)
    kind = type(dataset).__name__.lower()
    check(isinstance(dataset, h5py.Dataset), path, "a dataset", f"a {kind}")
    _check_storage(dataset, path)
    units = item.data.units
    if not units:
        return _read_plain_dataset(dataset, item.kind)
    letters, words = TYPES[item.data.kind]
    check(dataset.dtype.kind in letters, path, words, f"data of type {dataset.dtype}")
    check_text(dataset, "units", units, "; convert the numbers")
    array = np.asarray(dataset[()])
    array = array.astype(_NATIVE[array.dtype.kind], copy=False)
    if item.kind is not float:
        return array
    check(array.shape == (), path, "shape ()", f"{array.shape}")
    return float(array)


def _read_plain_dataset(dataset: h5py.Dataset, kind: Any) -> Any:
    """Read an array without units, or a value in JSON."""
    if dataset.dtype.kind == "V":
        return _objects_of_texts(dataset[()])
    is_text = h5py.check_string_dtype(dataset.dtype) is not None
    return from_json(kind, json.loads(dataset[()])) if is_text else dataset[()]


def _check_storage(dataset: h5py.Dataset, item: str) -> None:
    """Check that the numbers are stored in this file, and that it has enough bytes for them."""
    elsewhere = dataset.is_virtual or dataset.external is not None
    check(not elsewhere, item, "numbers stored in this file", "a reference to other files")
    check(dataset.shape is not None, item, "numbers", "an empty dataset")
    stored = dataset.id.get_storage_size()
    expanded = dataset.size * dataset.dtype.itemsize
    expected = f"{expanded} bytes for shape {dataset.shape}"
    check(expanded <= MOST_EXPANDED * stored, item, expected, f"{stored} bytes in the file")


def check_text(owner: h5py.Group | h5py.Dataset, name: str, expected: str, cure: str = "") -> None:
    found = read_attribute(owner, name)
    check(found == expected, place(owner, f"@{name}"), f"'{expected}'", f"'{found}'{cure}")


def read_attribute(owner: h5py.Group | h5py.Dataset, name: str, kind: object = str) -> Any:
    """Read one text (by default), one number, or names with dots as tuples of texts."""
    path = place(owner, f"@{name}")
    check_sentence(name in owner.attrs, path, "the attribute is missing")
    value = owner.attrs[name]
    if kind is int:
        return _one_number(value, path, "iu", "one integer").item()
    if kind is float:
        return float(_one_number(value, path, "fiu", "one number").item())
    if get_origin(kind) is tuple:
        texts = [_text(part, path) for part in np.atleast_1d(value).ravel()]
        return tuple(tuple(text.rsplit(".", 1)) for text in texts)
    return _text(value, path)


def _one_number(value: Any, item: str, letters: str, expected: str) -> NDArray:
    """Return an array with a single number; ``letters`` are the allowed types of NumPy."""
    number = np.asarray(value)
    check(number.dtype.kind in letters and number.size == 1, item, expected, repr(value))
    return number


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
    """Return an array (n,) with a field for each column.

    A field has the type float, int or bool if all values of the column have it, otherwise objects.
    None, a missing value, is NaN in a field of floats.
    """
    arrays = {name: _narrowed(column) for name, column in columns.items()}
    out = np.zeros(n, [(name, array.dtype) for name, array in arrays.items()])
    for name, array in arrays.items():
        out[name] = array
    return out


def _narrowed(column: Sequence[Any] | NDArray) -> NDArray:
    """Return a column as an array of the type of all its values, or of objects."""
    if isinstance(column, np.ndarray) and column.dtype != object:
        return column
    values = list(column)
    kinds = {type(value) for value in values}
    if kinds in ({float}, {float, NoneType}):
        return np.array(values, float)
    if kinds in ({int}, {bool}):
        return np.array(values)
    return np.fromiter(values, object, len(values))


def names_of(rows: NDArray) -> tuple[str, ...]:
    """Return the names of the fields of an array."""
    return rows.dtype.names or ()


def row_of(rows: NDArray, i: int) -> dict[str, Any]:
    """Return the values of a row by the names of the fields."""
    return dict(zip(names_of(rows), rows[i].item()))


def numbers_of(rows: NDArray, name: str) -> NDArray:
    """Return a field as (n,) float; NaN if there is no such field or no value."""
    if name not in names_of(rows):
        return np.full(len(rows), np.nan)
    return rows[name].astype(float)


def _texts_of_objects(rows: NDArray) -> NDArray:
    """Return an array with texts in JSON in place of its fields of objects."""
    columns: dict[str, Any] = {}
    kinds: list[tuple[str, Any]] = []
    for name in names_of(rows):
        if rows.dtype[name].hasobject:
            columns[name] = [json.dumps(value, default=to_json) for value in rows[name]]
            kinds.append((name, h5py.string_dtype()))
        else:
            columns[name] = rows[name]
            kinds.append((name, rows.dtype[name]))
    # without fields, an array of one byte for each row
    out = np.zeros(len(rows), kinds or "V1")
    for name, column in columns.items():
        out[name] = column
    return out


def _objects_of_texts(stored: NDArray) -> NDArray:
    """Return the array that :func:`_texts_of_objects` has converted."""
    columns: dict[str, Any] = {name: stored[name] for name in names_of(stored)}
    for name, column in columns.items():
        if column.dtype == object:
            # equal values share their memory
            by_text = {text: json.loads(text) for text in set(column)}
            columns[name] = [by_text[text] for text in column]
    return named_fields(columns, len(stored))


# ---- JSON ----


def from_json(hint: object, value: object) -> Any:
    """Convert a value read from JSON to the annotated type of its field."""
    return _converted(hint, value)


def _converted(hint: Any, value: Any) -> Any:
    """Convert a value read from JSON to the type of a hint, and the values in it."""
    origin = get_origin(hint)
    if value is None or hint is Any or origin in (dict, Mapping):
        return value
    if is_array(hint):
        return _array_from_json(value)
    if origin is tuple:
        return _tuple_from_json(get_args(hint), value)
    if origin in (Union, UnionType):
        return _alternative_from_json(get_args(hint), value)
    if isinstance(hint, InitVar):
        return _converted(hint.type, value)
    if is_dataclass(hint):
        return _dataclass_from_json(hint, value)
    is_named_tuple = isinstance(hint, type) and issubclass(hint, tuple)
    if is_named_tuple:
        return hint(*value)
    # a number, a text or a truth value
    return hint(value)


def _array_from_json(value: Any) -> NDArray:
    """Return an array from its list, or from the lists of its real and imaginary parts."""
    if isinstance(value, Mapping):
        return value["real"] + 1j * np.array(value["imag"])
    return np.array(value)


def _tuple_from_json(kinds: tuple[Any, ...], values: Sequence[Any]) -> tuple[Any, ...]:
    """Return a tuple with the annotated ``kinds`` of its items."""
    # tuple[float, ...] has any number of items of one kind
    if kinds[-1] is ...:
        kinds = kinds[:1] * len(values)
    return tuple(_converted(kind, item) for kind, item in zip(kinds, values))


def _alternative_from_json(alternatives: tuple[Any, ...], value: Any) -> Any:
    """Convert a value to one of several types, for example ``float | None``."""
    kinds = [kind for kind in alternatives if kind is not NoneType]
    if len(kinds) == 1:
        return _converted(kinds[0], value)
    # among several, such as int | tuple[int, ...], only a tuple differs from its form in JSON
    return tuple(value) if isinstance(value, list) else value


def _dataclass_from_json(kind: Any, value: Mapping[str, Any]) -> Any:
    """Return a dataclass from the values of its fields."""
    hints = get_type_hints(kind)
    arguments = {}
    for name, item in value.items():
        # a file of another version may have further fields
        if name in hints:
            arguments[name] = _converted(hints[name], item)
    return kind(**with_separate_reasons(arguments, hints))


def to_json(value: Any) -> Any:
    """Convert arrays and numbers of NumPy, mappings and small dataclasses for JSON."""
    if isinstance(value, np.ndarray):
        if np.iscomplexobj(value):
            return {"real": value.real.tolist(), "imag": value.imag.tolist()}
        return value.tolist()
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, Mapping):
        return dict(value)
    if is_dataclass(value) and not isinstance(value, type):
        return repr(value)
    raise TypeError(f"expected a number, a text, a list or a mapping, found {type(value).__name__}")


# ---- Check of a record ----


def check_record(record: object, kind: Kind, item: str, sizes: Sizes | None = None) -> None:
    """Check the fields of a record against the annotated types of its class.

    Nested records are not checked.

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
    known_sizes = dict(sizes or {})

    # vectors come before matrices because they show the named sizes
    def matrices_and_mappings_last(field: Item) -> tuple[bool, bool]:
        """Return a key for sorting, in which False comes before True."""
        is_matrix = len(field.data.shape) > 1
        is_mapping = field.keys is not None
        return is_matrix, is_mapping

    for field in sorted(layout(kind), key=matrices_and_mappings_last):
        value = getattr(record, field.name)
        if field.is_record or (value is None and field.optional):
            continue
        sign = "@" if field.is_attribute else ""
        if field.keys is None:
            _check_value(value, field, f"{item}/{sign}{field.place()}", known_sizes)
            continue
        check_type(value, Mapping, f"{item}/{field.place()}")
        for key, part in value.items():
            _check_value(part, field, f"{item}/{sign}{field.place(key)}", known_sizes)


def _check_value(value: Any, field: Item, item: str, sizes: Sizes) -> None:
    """Check one value of a field by its type; values of other types are not checked.

    Named sizes of an array are added to ``sizes``.
    """
    kind = field.kind
    limits = field.data.limits
    if kind is np.ndarray:
        _check_array(value, field.data, item, sizes)
    elif kind is int:
        check_integer(value, item)
    elif kind is float:
        is_number = isinstance(value, int | float | np.floating) and np.isfinite(value)
        within = is_number and limits.hold(float(value))
        check(within, item, f"a finite number {limits}", repr(value))
    elif kind is str:
        check(isinstance(value, str), item, "a text", repr(value))
    elif get_origin(kind) is Literal:
        check(value in get_args(kind), item, f"one of {list(get_args(kind))}", repr(value))


def _check_array(array: Any, data: Data, item: str, sizes: Sizes) -> None:
    """Check type, shape, finiteness, limits and symmetry.

    Add the named sizes of the array to ``sizes``.
    """
    check(isinstance(array, np.ndarray), item, "a NumPy array", f"a {type(array).__name__}")
    _check_number_type(array, data.kind, item)
    _check_shape(array, data.shape, item, sizes)
    for name, size in zip(data.shape, array.shape):
        sizes.setdefault(str(name), size)
    check_all(np.isfinite(array), array, "finite numbers", item)
    if str(data.limits):
        check_all(data.limits.hold(array), array, f"numbers {data.limits}", item)
    if data.matrix:
        # a skew-Hermitian matrix times i is Hermitian
        hermitian = 1j * array if data.matrix == "skew-Hermitian" else array
        check_hermitian(hermitian, item, data.matrix)


def _check_number_type(array: NDArray, kind: str, item: str) -> None:
    """Check the type of the numbers of an array; real and complex numbers have double precision."""
    letters, words = TYPES[kind]
    if "f" in letters:
        words = f"{words} in double precision"
        is_precise = array.dtype in (np.float64, np.complex128)
    else:
        is_precise = True
    check(is_precise and array.dtype.kind in letters, item, words, f"dtype {array.dtype}")


def _check_shape(array: NDArray, expected: Shape, item: str, sizes: Sizes) -> None:
    """Check the shape of an array; a name that ``sizes`` does not contain permits any size."""
    # None for any size
    shape = [sizes.get(size) if isinstance(size, str) else size for size in expected]
    fits = len(shape) == array.ndim
    for size, found in zip(shape, array.shape):
        if size is not None and size != found:
            fits = False
    text = ", ".join("any" if size is None else str(size) for size in shape)
    # Python writes a tuple of one number with a comma
    if len(shape) == 1:
        text += ","
    check(fits, item, f"shape ({text})", array.shape)


# ---- Checks of values ----


def check_integer(value: object, item: str) -> None:
    is_integer = isinstance(value, int | np.integer) and not isinstance(value, bool)
    check(is_integer, item, "an integer", repr(value))


def check_type(value: object, expected: type, item: str) -> None:
    check(isinstance(value, expected), item, f"a {expected.__name__}", f"a {type(value).__name__}")


def check_all(good: NDArray, array: NDArray, expected: str, item: str) -> None:
    """Raise an error that shows the first element of ``array`` with a False entry in ``good``."""
    wrong = np.argwhere(~good)
    if not len(wrong):
        return
    index = tuple(int(i) for i in wrong[0])
    shown_index = index if len(index) > 1 else index[0]
    found = f"{array[index]!s} at {shown_index}, one of {len(wrong)} wrong values"
    raise mismatch(item, expected, found)


def check_hermitian(matrix: NDArray, item: str, word: str = "Hermitian") -> None:
    """Raise ModelError unless a matrix is square and Hermitian except for rounding.

    ``word`` is the kind of matrix in the message, which gives the largest difference.
    """
    check(matrix.shape[0] == matrix.shape[1], item, f"a {word} matrix", f"shape {matrix.shape}")
    error = np.abs(matrix - matrix.conj().T)
    size = np.abs(matrix).max(initial=0.0)
    if error.max(initial=0.0) <= ROUNDING * size:
        return
    row, column = divmod(int(np.argmax(error)), error.shape[1])
    largest = error[row, column]
    found = f"a difference of {largest:.3g} at {(row, column)}, size {size:.3g}"
    raise mismatch(item, f"a {word} matrix", found)


def is_positive_definite(matrix: NDArray) -> bool:
    try:
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        return False
    return True
