"""Marks, time limits, shipped models that are read once, interruptions, and clean-up for all tests."""

import gc
import os
import signal
import sys
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import cache, wraps
from pathlib import Path

import numpy as np
import pytest

# before the import of the package, for processes of the tests as well: an installed package does not know its checkout
os.environ.setdefault("BDAMPER_MODELS", str(Path(__file__).parent / "models"))

import bdamper as bd

ROUNDING = {"anchors", "contact", "hard", "harmonic_balance", "physics", "response", "time_domain"}
"""Folders of tests on computed figures, which depend on the rounding of the BLAS."""

LONGEST = 3600 + 10 * int(os.environ.get("BDAMPER_HARD", "0"))
"""Time limit of slow tests and of hard cases, s; those of the others stand in pyproject.toml."""


def _read_only(value):
    """Lock all arrays below a value: a test that writes into a model that others share must fail."""
    if isinstance(value, np.ndarray):
        value.setflags(write=False)
    elif is_dataclass(value) or isinstance(value, Mapping):
        for part in (
            value.values()
            if isinstance(value, Mapping)
            else (getattr(value, f.name) for f in fields(value))
        ):
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
        folders = Path(item.path).parent.parts
        if ROUNDING & set(folders):
            item.add_marker(pytest.mark.rounding)
        # a limit by a signal ends one test; within those of Hypothesis it would be a failure that is searched for again
        limit = {"timeout": LONGEST} if "hard" in folders or item.get_closest_marker("slow") else {}
        limit |= {"method": "thread"} if getattr(item.obj, "is_hypothesis_test", False) else {}
        if limit:
            item.add_marker(pytest.mark.timeout(**limit))


def pytest_collection_finish():
    """Modules and collected tests stay to the end: the garbage collector need not look through them again and again."""
    gc.freeze()


@pytest.fixture
def interruptible():
    """SIGINT interrupts this process and its children, also where the shell that began the tests ignores it (``&``)."""
    try:
        before = signal.signal(signal.SIGINT, signal.default_int_handler)
    except ValueError:
        pytest.skip("SIGINT interrupts the main thread alone, and this test runs in another one")
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture(autouse=True)
def no_open_figures():
    """Figures stay open in pyplot, which warns of too many where all tests run in one process."""
    yield
    if "matplotlib.pyplot" in sys.modules:
        sys.modules["matplotlib.pyplot"].close("all")
