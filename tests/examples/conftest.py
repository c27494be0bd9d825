"""Pages, examples and notebooks teach no implausible values: a PlausibilityWarning is an error in all of them."""

from pathlib import Path

import pytest

HERE = Path(__file__).parent
STARTUP = HERE.parents[1] / "docs" / "plausible_values.py"
"""What a kernel of a notebook runs first, also in ``make docs``."""


def pytest_collection_modifyitems(items):
    for item in items:
        if HERE in item.path.parents:
            item.add_marker(pytest.mark.filterwarnings("error::bdamper.PlausibilityWarning"))


@pytest.fixture(autouse=True)
def _kernels_start_alike(tmp_path_factory, monkeypatch):
    """Kernels of notebooks have the same filter."""
    home = tmp_path_factory.mktemp("ipython")
    startup = home / "profile_default" / "startup"
    startup.mkdir(parents=True)
    (startup / STARTUP.name).write_text(STARTUP.read_text())
    monkeypatch.setenv("IPYTHONDIR", str(home))
