"""Bodies of most tests of imports: the reference sector and damper with few nodes.  A module may have another ``fe``."""

import pytest


@pytest.fixture(scope="session")
def fe():
    pytest.importorskip("skfem", reason="scikit-fem is not installed (extra bdamper[fe])")
    from bdamper.fem import SectorFE
    from tests.fe_bodies import SPARSE

    return SectorFE(density=SPARSE)


@pytest.fixture(scope="module")
def bodies(fe):
    from tests.fe_bodies import blade_and_damper

    return blade_and_damper(fe)
