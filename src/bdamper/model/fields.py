"""Checks of the type, shape and size of the data of a model; an error names the item.

The annotated types of the classes of a model define its data (:class:`bdamper.util.records.Data`).  :func:`check_record`
checks a record by them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, cast, get_args, get_origin

import numpy as np
from numpy.typing import NDArray

from bdamper.util.errors import check as check
from bdamper.util.errors import mismatch
from bdamper.util.records import TYPES, Data, Item, Kind, layout
from bdamper.util.validation import Limits

SINGLE, ROUNDING = 1e-6, 1e-8
"""Relative tolerances: for data that are often in single precision (normals, modes), and for the rounding of a large
factorisation.
"""

DAMPING = Limits(least=0.0, below=1.0)
Sizes = dict[str, int | None]
"""Sizes by name; None if unknown."""


# ---- Records ----


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
    for field in sorted(layout(kind), key=lambda field: (len(field.data.shape) > 1, field.keys is not None)):
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
        good = isinstance(value, int | float | np.floating) and np.isfinite(value) and limits.hold(float(value))
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
    fits = len(shape) == array.ndim and all(n in (None, found) for n, found in zip(shape, array.shape))
    text = ", ".join("any" if n is None else str(n) for n in shape)
    check(fits, item, f"shape ({text},)" if len(shape) == 1 else f"shape ({text})", array.shape)
    for name, size in zip(data.shape, array.shape):
        sizes.setdefault(str(name), size)
    check_all(np.isfinite(array), array, "finite numbers", item)
    if str(data.limits):
        check_all(data.limits.hold(array), array, f"numbers {data.limits}", item)
    if data.matrix:
        check_hermitian(1j * array if data.matrix == "skew-Hermitian" else array, item, data.matrix)


# ---- Values ----


def check_integer(value: object, item: str) -> None:
    check(isinstance(value, int | np.integer) and not isinstance(value, bool), item, "an integer", repr(value))


def check_type(value: object, expected: type, item: str) -> None:
    check(isinstance(value, expected), item, f"a {expected.__name__}", f"a {type(value).__name__}")


def check_all(good: NDArray, array: NDArray, expected: str, item: str) -> None:
    """Raise an error that shows the first element of ``array`` with a False entry in ``good``."""
    wrong = np.argwhere(~good)
    if len(wrong):
        at = tuple(int(i) for i in wrong[0])
        raise mismatch(item, expected, f"{array[at]!s} at {at if len(at) > 1 else at[0]}, one of {len(wrong)} wrong values")


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
