"""Checks of the data of a model: type, shape and size of a value, with one error that names the item.

What a model consists of stands in the annotated types of its classes alone (:class:`Data`).  :func:`check_record` checks a
record against them, and ``bdamper.model.model_file`` writes and reads it by them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass, fields, is_dataclass
from functools import cache
from typing import Any, Literal, NamedTuple, cast, get_args, get_origin

import numpy as np
from numpy.typing import NDArray

from bdamper.util.errors import mismatch
from bdamper.util.validation import Limits, declarations

SINGLE, ROUNDING = 1e-6, 1e-8
"""Tolerances, relative to the size of the numbers compared: for data of single precision where such data are common
(normals, modes), and for the rounding of a large factorisation elsewhere."""

ANY = Limits()
DAMPING = Limits(least=0.0, below=1.0)
TYPES = {
    "real": ("f", "real numbers"),
    "field": ("fc", "real or complex numbers"),
    "picture": ("fc", "real or complex numbers"),
    "integer": ("iu", "integers"),
    "bool": ("b", "booleans"),
}
"""Letters and words of the types of numbers that :class:`Data` knows."""
Kind = Callable[..., Any]
"""A class of a model."""
Shape = tuple[int | str | None, ...]
Sizes = dict[str, int | None]
"""Sizes by the names that shapes have for them; None is not known and stays so."""


@dataclass(frozen=True)
class Data:
    """Marks a field of a model's class, in its annotated type: how it is stored and what is checked.

    Parameters
    ----------
    units : str
        Of a dataset, as they stand in a file; a number without units is an attribute.
    shape : tuple of int, str or None
        Names of sizes have one value within a record; None stands for any size.
    kind : {"real", "field", "picture", "integer", "bool"}
        Type of the numbers; a field is real or complex, and so is a picture, which files have in single precision.
    file : str
        Place in a file, that of the field's name by default.  A star stands for the key of a mapping ("nd000" of nodal
        diameter 0), or for each port of a body.
    limits : Limits
        Of every number.
    matrix : {"", "symmetric", "Hermitian", "skew-Hermitian"}
    derived : bool
        Whether a file may leave it out, since it follows from other data.
    """

    units: str = ""
    shape: Shape = ()
    kind: Literal["real", "field", "picture", "integer", "bool"] = "real"
    file: str = ""
    limits: Limits = ANY
    matrix: Literal["", "symmetric", "Hermitian", "skew-Hermitian"] = ""
    derived: bool = False


class Item(NamedTuple):
    """A field of a model's class.

    Parameters
    ----------
    name : str
    kind : type
        What the field, or each value of its mapping, is.
    keys : type or None
        Of its mapping.
    optional, required : bool
        Whether it may be None, and whether every file must have it.
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
        """Place in a file."""
        return self.data.file or (f"{self.name}/*" if self.keys else self.name)

    @property
    def is_record(self) -> bool:
        return is_dataclass(self.kind)

    @property
    def is_attribute(self) -> bool:
        """Whether a file has it as an attribute."""
        return not (self.is_record or self.kind is np.ndarray or self.data.units)

    def place(self, key: object = "") -> str:
        """Place in a file of the value of a key, of all ports of a body."""
        return self.file.replace("*", member(key)).rstrip("/")


def member(key: object) -> str:
    """How a file names a key of a mapping: nodal diameter 5 is "nd005"."""
    return f"nd{key:03d}" if isinstance(key, int | np.integer) else str(key)


@cache
def layout(cls: Kind) -> tuple[Item, ...]:
    """The fields of a model's class, except for its name."""
    return tuple(_item(cls, f) for f in fields(cast(Any, cls)) if f.name != "name")


def _item(cls: Kind, own: Any) -> Item:
    kind, optional, _ = found = declarations(cls)[own.name]
    data = found.mark(Data) or Data()
    keys, kind = get_args(kind) if get_origin(kind) is Mapping else (None, kind)
    if np.ndarray is get_origin(kind) or NDArray in (kind, get_origin(kind)):  # the alias has an origin up to Python 3.11
        kind = np.ndarray
    item = Item(own.name, kind, keys, optional, False, data)
    given = own.default is not MISSING or own.default_factory is not MISSING
    return item._replace(required=not (optional or data.derived or (given and not item.is_attribute)))


def by_rank(cls: Kind) -> list[Item]:
    """The fields of a model's class: vectors, which show sizes, before what has a part for each port, and records last."""
    return sorted(layout(cls), key=lambda i: (i.is_record, len(i.data.shape) > 1, i.keys is not None or "*" not in i.file))


# -----------------------------------------------------------------------------------------------------------
# Records


def check_record(record: object, kind: Kind, item: str, sizes: Sizes | None = None) -> None:
    """Check a record against the annotated types of its class, but not the records in it.

    Parameters
    ----------
    record : object
    kind : type
        What it has to be.
    item : str
        What messages call it.
    sizes : dict of str to int, optional
        Sizes that are known.
    """
    check_type(record, cast(type, kind), item)
    known = dict(sizes or {})
    for own in by_rank(kind):
        value = getattr(record, own.name)
        if own.is_record or (value is None and own.optional):
            continue
        if own.is_attribute:
            _check_attribute(value, own, f"{item}/@{own.file}")
            continue
        if own.keys is not None:
            check_type(value, Mapping, f"{item}/{own.place()}")
        for key, part in value.items() if own.keys is not None else (("", value),):
            _check_data(part, own, f"{item}/{own.place(key)}", known)


def _check_attribute(value: object, own: Item, item: str) -> None:
    if own.kind is int:
        check_integer(value, item)
    elif own.kind is float:
        _check_number(value, own.data, item)
    elif own.kind is str:
        check(isinstance(value, str), item, "a text", repr(value))
    elif get_origin(own.kind) is Literal:
        check(value in get_args(own.kind), item, f"one of {list(get_args(own.kind))}", repr(value))


def _check_number(value: object, data: Data, item: str) -> None:
    good = isinstance(value, int | float | np.floating) and np.isfinite(value) and data.limits.hold(float(value))
    check(good, item, f"a finite number {data.limits}", repr(value))


def _check_data(array: object, own: Item, item: str, sizes: Sizes) -> None:
    data = own.data
    if own.kind is float:
        _check_number(array, data, item)
        return
    check_array(array, known_shape(data.shape, sizes), item, data.kind)
    assert isinstance(array, np.ndarray)
    learn(data.shape, array.shape, sizes)
    if str(data.limits):
        check_all(data.limits.hold(array), array, f"numbers {data.limits}", item)
    if data.matrix:
        check_hermitian(1j * array if data.matrix == "skew-Hermitian" else array, item, data.matrix)


def known_shape(shape: Shape, sizes: Sizes) -> tuple[int | None, ...]:
    """A shape with the sizes that are known; None where a size is not."""
    return tuple(sizes.get(n) if isinstance(n, str) else n for n in shape)


def learn(shape: Shape, found: tuple[int, ...], sizes: Sizes) -> None:
    """Add the sizes that an array shows."""
    for name, size in zip(shape, found):
        if isinstance(name, str):
            sizes.setdefault(name, size)


# -----------------------------------------------------------------------------------------------------------
# Values


def check(good: object, item: str, expected: str, found: object) -> None:
    if not good:
        raise mismatch(item, expected, found)


def check_integer(value: object, item: str) -> None:
    check(isinstance(value, int | np.integer) and not isinstance(value, bool), item, "an integer", repr(value))


def check_type(value: object, expected: type, item: str) -> None:
    check(isinstance(value, expected), item, f"a {expected.__name__}", f"a {type(value).__name__}")


def check_array(array: object, shape: tuple[int | None, ...], item: str, kind: str = "real") -> None:
    """Type, shape (None stands for any size) and finiteness."""
    if not isinstance(array, np.ndarray):
        raise mismatch(item, "a NumPy array", f"a {type(array).__name__}")
    letters, words = TYPES[kind]
    double = array.dtype in (np.float64, np.complex128) or "f" not in letters
    expected = f"{words} in double precision" if "f" in letters else words
    check(double and array.dtype.kind in letters, item, expected, f"dtype {array.dtype}")
    check(fits(array.shape, shape), item, f"shape {shape_text(shape)}", array.shape)
    check_all(np.isfinite(array), array, "finite numbers", item)


def fits(found: tuple[int, ...], expected: tuple[int | None, ...]) -> bool:
    """Whether a shape is the one expected; None stands for any size."""
    return len(found) == len(expected) and all(e in (None, f) for e, f in zip(expected, found))


def shape_text(shape: tuple[int | None, ...]) -> str:
    """A shape in words, with "any" for a size that is free."""
    sizes = ", ".join("any" if n is None else str(n) for n in shape)
    return f"({sizes},)" if len(shape) == 1 else f"({sizes})"


def check_all(good: NDArray, array: NDArray, expected: str, item: str) -> None:
    """Every element is good; otherwise name the first that is not."""
    wrong = np.argwhere(~good)
    if len(wrong):
        at = tuple(int(i) for i in wrong[0])
        raise mismatch(item, expected, f"{array[at]!s} at {at if len(at) > 1 else at[0]} and {len(wrong)} such in all")


def check_hermitian(matrix: NDArray, item: str, word: str = "Hermitian") -> None:
    check(matrix.shape[0] == matrix.shape[1], item, f"a {word} matrix", f"shape {matrix.shape}")
    error = np.abs(matrix - matrix.conj().T)
    size = np.abs(matrix).max(initial=0.0)
    if not error.max(initial=0.0) <= ROUNDING * size:
        at = tuple(int(i) for i in np.unravel_index(np.argmax(error), error.shape))
        raise mismatch(item, f"a {word} matrix", f"a difference of {error[at]:.3g} at {at}, size {size:.3g}")


def is_positive_definite(matrix: NDArray) -> bool:
    try:
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        return False
    return True
