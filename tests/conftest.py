"""Marks and clean-up for all tests."""

import sys
from pathlib import Path

import pytest

ROUNDING = {"anchors", "harmonic_balance", "contact", "continuation", "hard", "peaks", "physics", "problem", "stability"}
"""Folders of tests that ask for computed figures: another BLAS moves them."""


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
