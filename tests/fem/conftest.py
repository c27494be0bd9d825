"""The reference sector and damper on the coarse mesh; a module with another sector has its own ``fe``."""

import pytest


@pytest.fixture(scope="session")
def fe():
    pytest.importorskip("skfem", reason="scikit-fem is not installed (extra bdamper[fe])")
    from bdamper.fem import SectorFE

    return SectorFE()
