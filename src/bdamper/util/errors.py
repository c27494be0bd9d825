"""Errors that a user can cause and can mend: messages name the item, what was expected, what was found."""

from __future__ import annotations

import importlib
from typing import Any

from bdamper.util.formatting import cut


class BdamperError(Exception):
    """Base class of all errors raised on purpose by this package."""


class ModelError(BdamperError, ValueError):
    """A model, or a model file, contradicts itself or the conventions."""


class SettingError(BdamperError, ValueError):
    """A setting of a study is out of range or does not fit the model."""


class StaticError(BdamperError):
    """No static state was found under a load, so there is nothing to vibrate about."""


def mismatch(item: str, expected: str, found: object) -> ModelError:
    """An error of one line: the item, what was expected of it and what was found instead."""
    return ModelError(f"{item}: expected {' '.join(expected.split())}, found {shortened(found)}")  # arrays may wrap


def shortened(found: object) -> str:
    """Text of a value in one line of at most 300 characters."""
    return cut(" ".join(str(found).split()), 300)


def needed(module: str, asked: str, extra: str) -> Any:
    """A module of an extra, or the error that names it."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise BdamperError(f"{asked} needs {module.partition('.')[0]}: install the extra bdamper[{extra}]") from error
