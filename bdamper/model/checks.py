"""Elementary checks of the data of a model: type, shape and size of a value, with one error that names the item."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bdamper.util.errors import mismatch

SINGLE, ROUNDING = 1e-6, 1e-8
"""Tolerances, relative to the size of the numbers compared: for data of single precision where such data are common
(normals, modes), and for the rounding of a large factorisation elsewhere."""

_TYPES = {
    "real": ((np.float64,), "real numbers in double precision"),
    "field": ((np.float64, np.complex128), "real or complex numbers in double precision"),
    "bool": ((np.bool_,), "booleans"),
}


def require(good: object, item: str, expected: str, found: object) -> None:
    if not good:
        raise mismatch(item, expected, found)


def check_name(name: object, item: str) -> None:
    good = isinstance(name, str) and name != "" and name.isprintable() and not set(name) & set("/.")
    require(good, item, "a name of printable characters without '/' and '.'", repr(name))


def check_integer(value: object, item: str) -> None:
    require(isinstance(value, int | np.integer) and not isinstance(value, bool), item, "an integer", repr(value))


def check_one_of(value: object, choices: tuple[str, ...], item: str) -> None:
    require(value in choices, item, f"one of {list(choices)}", repr(value))


def check_type(value: object, expected: type, item: str) -> None:
    require(isinstance(value, expected), item, f"a {expected.__name__}", f"a {type(value).__name__}")


def check_array(array: object, shape: tuple[int | None, ...], item: str, kind: str = "real") -> None:
    """Type, shape (None stands for any size) and finiteness."""
    if not isinstance(array, np.ndarray):
        raise mismatch(item, "a NumPy array", f"a {type(array).__name__}")
    types, words = _TYPES[kind]
    require(array.dtype in types, item, words, f"dtype {array.dtype}")
    require(fits(array.shape, shape), item, f"shape {shape_text(shape)}", array.shape)
    wrong = np.argwhere(~np.isfinite(array))
    if len(wrong):
        at = tuple(int(i) for i in wrong[0])
        raise mismatch(item, "finite numbers", f"{array[at]} at {at} and {len(wrong)} such in all")


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
        raise mismatch(item, expected, f"{array[at]!s} at {at if len(at) > 1 else at[0]}")


def check_hermitian(matrix: NDArray, item: str, word: str = "Hermitian") -> None:
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
