"""What every test leaves behind is cleared: figures stay open in pyplot, which warns of many in a run without workers."""

import sys

import pytest


@pytest.fixture(autouse=True)
def no_open_figures():
    yield
    if "matplotlib.pyplot" in sys.modules:
        sys.modules["matplotlib.pyplot"].close("all")
