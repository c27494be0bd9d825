"""Marks, shipped models that are read once, and clean-up for all tests."""

import sys
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import cache, wraps
from pathlib import Path

import numpy as np
import pytest

import bdamper as bd

ROUNDING = {"anchors", "harmonic_balance", "contact", "continuation", "hard", "peaks", "physics", "problem", "stability"}
"""Folders of tests that ask for computed figures: another BLAS moves them."""




def _read_only(value):
    """Lock all arrays below a value: a test that writes into a model that others share must fail."""
    if isinstance(value, np.ndarray):
        value.setflags(write=False)
    elif is_dataclass(value) or isinstance(value, Mapping):
        for part in value.values() if isinstance(value, Mapping) else (getattr(value, f.name) for f in fields(value)):
            _read_only(part)


def _read_once(read):
    shipped = cache(read)

    @wraps(read)
    def reference_model(name="bladed_disk", contact_points=None):
        model = shipped(name, contact_points)
        _read_only(model)
        return model

    return reference_model


bd.reference_model = _read_once(bd.reference_model)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    for item in items:
        if ROUNDING & set(Path(item.path).parent.parts):
            item.add_marker(pytest.mark.rounding)


@pytest.fixture(autouse=True)
def no_open_figures():
    """Figures stay open in pyplot, which warns of too many where all tests run in one process."""
    yield
    if "matplotlib.pyplot" in sys.modules:
        sys.modules["matplotlib.pyplot"].close("all")
