"""The local basis of a wheel: checks, frequencies of a chain that is known in closed form, and the model of its modes."""

from dataclasses import replace

import numpy as np
import pytest

from bdamper.mistuning.disk_equations import local_model
from bdamper.model.contact_points import unite_contact_points
from bdamper.model.structure import feed_digest
from bdamper.model.validation import check_model
from bdamper.util.errors import ModelError
from tests.each import each
from tests.models import lumped_local, wedge_model

N = 8
OWN, DISK, TIE = 3.0e6, 4.0e6, 1.5e6


def lumped_wheel_model():
    model = wedge_model(0, n_blades=N, engine_order=3, n_points=4)
    local = lumped_local(model, OWN, DISK, TIE)
    blade = model.bodies["blade"]
    blade = replace(
        blade, bases={0: local.nodal_diameter(0), 3: local.nodal_diameter(3)}, local=local
    )
    return replace(model, bodies={**model.bodies, "blade": blade})


def test_tuned_modes_are_those_of_the_two_masses():
    model = local_model(lumped_wheel_model())
    check_model(model)
    for d, basis in model.bodies["blade"].bases.items():
        disk = DISK + 2.0 * TIE * (1.0 - np.cos(2.0 * np.pi * d / N))
        exact = np.linalg.eigvalsh([[OWN, -OWN], [-OWN, OWN + disk]])
        np.testing.assert_allclose(basis.omega2, exact, rtol=1e-12)


def test_damping_is_that_of_the_modes():
    local = lumped_wheel_model().bodies["blade"].local
    omega2, phi = local.modes(2)
    damping = phi.conj().T @ local.damping(2) @ phi
    np.testing.assert_allclose(
        damping, np.diag(2.0 * local.damping_ratio * np.sqrt(omega2)), atol=1e-9
    )
    np.testing.assert_allclose(
        phi.conj().T @ local.damping(2, 0.01) @ phi, np.diag(0.02 * np.sqrt(omega2)), atol=1e-9
    )


def test_the_hash_knows_a_local_basis_only_where_there_is_one():
    model = lumped_wheel_model()
    blade = model.bodies["blade"]
    without = replace(model, bodies={**model.bodies, "blade": replace(blade, local=None)})
    assert without.hash != model.hash
    fed = {name: Recorder() for name in ("with", "without")}
    feed_digest(fed["with"], "bodies", model.bodies)
    feed_digest(fed["without"], "bodies", without.bodies)
    assert b".local" in fed["with"].text
    assert (
        b".local" not in fed["without"].text
    )  # the hash of earlier versions, which did not know a local basis


class Recorder:
    """What a digest is fed."""

    text = b""

    def update(self, part: bytes) -> None:
        self.text += part


def broken(**changes):
    model = lumped_wheel_model()
    blade = model.bodies["blade"]
    local = {key: value(getattr(blade.local, key)) for key, value in changes.items()}
    return replace(
        model, bodies={**model.bodies, "blade": replace(blade, local=replace(blade.local, **local))}
    )


@each(
    ("changes", "words"),
    [
        (
            {"disk_stiffness": lambda k: k + 1j},
            "disk_stiffness at nodal diameter 0: expected a Hermitian",
        ),
        ({"disk_stiffness": lambda k: k[:-1]}, "disk_stiffness: expected shape"),
        (
            {"disk_stiffness": lambda k: k - 4e6},
            "disk_stiffness: expected blade and disk positive definite",
        ),
        ({"disk_mass": lambda m: m - 1.0}, "disk_mass: expected blade and disk positive definite"),
        ({"omega2": lambda w: 1.01 * w}, "blade_stiffness: expected a diagonal block with omega2"),
        (
            {"blade_stiffness": lambda k: k + 1e4 * np.array([[0, 1], [1, 0]])},
            "blade_stiffness: expected a diagonal block",
        ),
        ({"blade_mass": lambda m: m.astype(int)}, "blade_mass: expected real numbers"),
        ({"damping_ratio": lambda z: z[:1]}, "damping_ratio: expected shape"),
        ({"contact_modes": lambda m: m[1:]}, "modes: expected shape"),
        ({"locations": lambda m: {}}, "locations: expected"),
        ({"disk_stiffness": lambda k: 0.5 * k}, "expected frequencies of nd000 or above"),
        (
            {"disk_stiffness": lambda k: 1.5 * k},
            "expected frequencies of nd000 or above, the lowest within",
        ),
    ],
)
def test_a_basis_that_does_not_fit_is_refused(changes, words):
    with pytest.raises(ModelError, match="/bodies/blade/wheel") as error:
        check_model(broken(**changes))
    assert words in str(error.value)


def test_a_model_without_a_local_basis_says_so():
    with pytest.raises(ModelError, match="no body of the model has one"):
        local_model(wedge_model(0, n_blades=N, engine_order=3, n_points=4))


def test_contact_points_of_a_local_basis_are_united_with_those_of_the_modes():
    model = unite_contact_points(lumped_wheel_model(), 1)
    check_model(model)
    body = model.bodies["blade"]
    np.testing.assert_allclose(
        body.local.nodal_diameter(3).contact_modes, body.bases[3].contact_modes, rtol=1e-12
    )
