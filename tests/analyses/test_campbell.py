"""Campbell diagrams: a spinning oscillator in closed form, nodal diameters that orders meet, bad questions."""

from dataclasses import replace

import numpy as np
import pytest

import bdamper as bd
from bdamper.analyses.campbell import line_crossings
from bdamper.contact.static_state import static_state
from bdamper.harmonic_balance import problem
from bdamper.model.modal_basis import SpeedBasis
from bdamper.response.linear_limits import free_and_stuck
from tests.plain import plain_study
from tests.printed import said
from tests.turning import turning_disk


def spinning_oscillator(stiffening):
    """One mass of 2 kg on 8e5 N/m with a contact of 3e5 N/m, whose frequency rises with speed by hand."""
    study = bd.lumped(
        2.0,
        10.0,
        8e5,
        contacts=[bd.Contact(tangential=0, kt=3e5, mu=0.3, preload=100.0)],
        forces={0: 1.0},
    )
    body = study.model.bodies["masses"]
    speed = SpeedBasis(0.0, np.diag(body.bases[0].omega2), np.array([[stiffening]]))
    bases = {0: replace(body.bases[0], speed=speed)}
    return study.replace(
        model=replace(
            study.model, bodies={**study.model.bodies, "masses": replace(body, bases=bases)}
        )
    )


def test_a_spinning_oscillator_in_closed_form():
    """omega^2 = k/m + B Omega^2, stuck k + kt; on the line of an order Omega^2 = (k/m)/(EO^2 - B)."""
    study = spinning_oscillator(3.5)
    speeds = np.linspace(100.0, 500.0, 9)
    found = study.campbell(speeds, [2, 3], modes=1)
    np.testing.assert_allclose(
        2.0 * np.pi * found.free[0, :, 0], np.sqrt(4e5 + 3.5 * speeds**2), rtol=1e-12
    )
    np.testing.assert_allclose(
        2.0 * np.pi * found.stuck[0, :, 0], np.sqrt(5.5e5 + 3.5 * speeds**2), rtol=1e-12
    )
    np.testing.assert_allclose(
        found.met[:, 2], np.sqrt(4e5 / (np.array([4.0, 9.0]) - 3.5))[[1, 1]] * [np.nan, 1.0]
    )
    np.testing.assert_allclose(found.met[1, 3], np.sqrt(5.5e5 / (9.0 - 3.5)), rtol=1e-12)
    assert "3, mode 1 2575 rpm, 128.76 Hz 3020 rpm, 150.99 Hz" in said(found)
    assert "order 2, mode 1  free no crossing, stuck no crossing" in found.summary()


def test_orders_meet_the_modes_of_their_nodal_diameter_alone(tmp_path):
    study = plain_study(turning_disk((0, 5, 10)), bd.Excitation("tip"), 5, friction_coefficient=0.3)
    found = study.campbell((200.0, 500.0, 600.0), [5, 60, 10], modes=2)
    assert [found.met_by(o) for o in (5, 60, 10, 65, 70)] == [5, 5, 10, 0, 5]
    assert found.free.shape == found.stuck.shape == (3, 3, 2)
    assert (found.stuck >= found.free).all()
    for d, k in zip((0, 5, 10), range(3)):
        assert found.row(d) == k
    at = study.at_speed(500.0)
    np.testing.assert_allclose(
        found.free[1, 1],
        np.sqrt(np.sort(at.model.bodies["blade"].bases[5].omega2)[:2]) / (2.0 * np.pi),
        rtol=1e-12,
    )
    found.save(tmp_path / "campbell.h5")
    assert str(bd.load(tmp_path / "campbell.h5")) == str(found)
    assert len(found.columns()["free"].values) == 18
    with pytest.raises(
        bd.SettingError, match="engine_orders: expected orders that excite nodal diameters"
    ):
        study.campbell((200.0, 500.0), [7])
    with pytest.raises(bd.SettingError, match="mode: expected 1 to"):
        study.campbell((200.0, 500.0), [5], modes=41)
    assert found.notes == (), "the damper does not count"


def test_the_static_state_of_a_speed_serves_all_nodal_diameters(monkeypatch):
    """It is the mean, which has none; stuck frequencies are those of the studies of each order."""
    solved = []

    def recorded(system, load, **options):
        solved.append(load)
        return static_state(system, load, **options)

    monkeypatch.setattr(problem, "static_state", recorded)
    study = plain_study(turning_disk((0, 5, 10)), bd.Excitation("tip"), 5, friction_coefficient=0.3)
    found = study.campbell((200.0, 500.0, 600.0), modes=2)
    assert [load for load in solved if load > 0.0] == [1.0] * 3
    for d in (5, 10):
        at = study.replace(engine_order=d).at_speed(500.0)
        own = free_and_stuck(at.problem.at(at.preload), 2)[1]
        np.testing.assert_allclose(found.stuck[found.row(d), 1], own, rtol=1e-12)


def test_nodal_diameters_of_one_speed_are_left_out():
    """Beside others that stiffen with speed they would show the frequencies of standstill."""
    study = plain_study(turning_disk((0, 5, 10)), bd.Excitation("tip"), 5, friction_coefficient=0.3)
    blade = study.model.bodies["blade"]
    bases = {
        d: replace(basis, speed=None if d == 10 else basis.speed)
        for d, basis in blade.bases.items()
    }
    model = replace(
        study.model, bodies={**study.model.bodies, "blade": replace(blade, bases=bases)}
    )
    found = study.replace(model=model).campbell((200.0, 300.0, 400.0), [5], modes=1)
    assert found.nodal_diameter.tolist() == [0, 5]
    assert "nodal diameters 10: modes of one rotor speed" in found.summary()


def test_a_frequency_that_meets_a_line_twice():
    speed = np.array([100.0, 200.0, 300.0, 400.0])
    hertz = np.array([150.0, 150.0, 250.0, 400.0]) / (2.0 * np.pi)
    found = line_crossings(speed, hertz, 1)
    assert found[0] == pytest.approx(150.0) and found[1:] == pytest.approx([400.0])
