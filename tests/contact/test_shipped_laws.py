"""Shipped contact laws against closed forms over their whole range, and counts and ranges that are refused."""

import json
import pickle
import warnings

import h5py
import numpy as np
import pytest

import bdamper as bd
from bdamper import _core
from bdamper.contact.laws import OwnLaws
from bdamper.util.errors import BdamperWarning
from tests.each import each


def along(law, path):
    """(n, 3) forces along motions (n, 3), from rest."""
    own, memory, out = (
        OwnLaws(law.of_points(1, "joint"), np.zeros(1)),
        np.zeros((1, 3 + law.n_state)),
        [],
    )
    for x in path:
        F, _, memory = own.step(x[None], memory)
        out.append(F[0])
    return np.array(out)


def tangential(u, v=0.0):
    return np.column_stack([u, np.zeros_like(u), np.full_like(u, v)])


def loss(law, u, corners):
    """Energy of a settled cycle between -u and u; forces are straight between corners (n,), distances from a turn."""
    way = np.unique(np.concatenate([[0.0], corners[corners < 2.0 * u], [2.0 * u]]))
    x = np.concatenate([[u], u - way[1:], -u + way[1:]])
    T = along(law, tangential(x))[:, 0]
    return float(np.sum(0.5 * (T[1:] + T[:-1]) * np.diff(x)))


class TestJenkins:
    @each("ratio", [0.5, 1.0 + 1e-3, 1.5, 10.0, 1e6])
    @each("kn", [0.0, 3.0])
    def test_loss(self, ratio, kn):
        """4 f (u - f/k) a cycle, none below the limit f = 0.7 + 0.2 N."""
        k, v = 2.0, 0.4
        f = 0.7 + 0.2 * kn * v
        law, u = bd.ContactLaw.jenkins([k], [0.7], 0.2, kn=kn), ratio * f / k
        at = np.array([2.0 * f / k, 2.0 * u]) if ratio > 1.0 else np.array([2.0 * u])
        path = tangential(np.concatenate([[u], u - at, -u + at]), v)
        F = along(law, path)
        found = np.sum(0.5 * (F[1:, 0] + F[:-1, 0]) * np.diff(path[:, 0]))
        assert found == pytest.approx(4.0 * f * max(u - f / k, 0.0), rel=1e-9, abs=1e-9 * f * f / k)
        np.testing.assert_allclose(F[:, 2], kn * v, rtol=1e-14)


class TestIwan:
    @pytest.mark.parametrize("chi", [-0.95, -0.5, 0.0])
    @pytest.mark.parametrize("beta", [0.0, 0.5])
    def test_power_law_over_six_decades(self, chi, beta):
        """Segalman (2005): D = 4 R u^(chi + 3)/((chi + 3)(chi + 2))."""
        F, K = 2.0, 5.0
        law = bd.ContactLaw.iwan(F, K, chi, beta, decades=6.0)
        k, f, _ = law.parameters[2:].reshape(-1, 3).T
        last = F * (1 + beta) / (K * (beta + (chi + 1) / (chi + 2)))
        assert law.resolution == pytest.approx(1e-6 * last)
        R = K * (chi + 1) / (1 + beta) / last ** (chi + 1)
        u = last * np.geomspace(1e-6, 0.999, 25)
        found = [loss(law, x, 2.0 * f / k) for x in u]
        np.testing.assert_allclose(
            found, 4 * R * u ** (chi + 3) / ((chi + 3) * (chi + 2)), rtol=0.02
        )

    def test_default_spans_three_decades(self):
        law = bd.ContactLaw.iwan(1.0, 1.0, -0.5, 0.0)
        k, f, _ = law.parameters[2:].reshape(-1, 3).T
        last = 3.0  # (chi + 2)/(chi + 1) F/K
        R = 0.5 / last**0.5
        u = last * np.geomspace(1e-3, 0.999, 37)
        found = [loss(law, x, 2.0 * f / k) for x in u]
        np.testing.assert_allclose(found, 4 * R * u**2.5 / (2.5 * 1.5), rtol=0.02)

    def test_its_name(self, tmp_path):
        law = bd.ContactLaw.iwan(1.0, 1.0, -0.5, 0.2, decades=4.0)
        assert str(law).startswith("iwan (")
        again = pickle.loads(pickle.dumps(law))
        assert (
            again.record() == law.record()
            and again.name == "iwan"
            and again.resolution == law.resolution
        )

    @pytest.mark.parametrize("chi", [-1.0, -1.5, 1e-9, 0.5])
    def test_exponents_that_are_refused(self, chi):
        with pytest.raises(bd.SettingError, match="chi: expected"):
            bd.ContactLaw.iwan(1.0, 1.0, chi, 0.2)

    @pytest.mark.slow
    def test_amplitudes_below_the_first_elements_are_told(self):
        """A force of 1e-5 moves the joint by about 1e-4 of macroslip in resonance."""

        def tracked(decades):
            law = bd.ContactLaw.iwan(1.0, 1.0, -0.5, 0.2, decades=decades)
            contact = bd.Contact(0, kt=1.0, mu=1.0, preload=1.0)
            study = bd.lumped(
                1.0, 0.02, 1.0, contacts=[contact], forces={0: 1e-5}, harmonics=1, friction_law=law
            )
            return study.frequency_response(0.0, (0.2, 0.25))

        with pytest.warns(
            BdamperWarning, match="law 'iwan' of interface 'contact 1' moves by at most .* resolves"
        ):
            tracked(3.0)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            assert tracked(6.0).complete


GAMMA = (-1.0, -0.6, 0.0, 0.6, 1.0)
"""Of beta, over the whole range."""


def loaded(c, n, u):
    """z after a motion u from z = 0, where dz/du = 1 - c z^n."""
    if c == 0.0:
        return u
    return (1.0 - np.exp(-c * u)) / c if n == 1 else np.tanh(np.sqrt(c) * u) / np.sqrt(c)


def unloaded(c, n, z):
    """Motion that brings z to 0, where dz/du = 1 + c z^n backwards."""
    if c == 0.0:
        return z
    return np.log1p(c * z) / c if n == 1 else np.arctan(np.sqrt(c) * z) / np.sqrt(c)


class TestBoucWen:
    @pytest.mark.slow
    @each("n", [1, 2])
    @each("gamma", GAMMA)
    @each("u", [1e-6, 0.3, 3.0])
    def test_closed_form(self, n, gamma, u):
        """Loading has the rate 1 - (beta + gamma) z^n, unloading 1 + (beta - gamma) z^n, so that z vanishes at u - s."""
        k, alpha, beta = 2.0, 0.1, 1.0
        law, steps = bd.ContactLaw.bouc_wen(k, alpha, beta, gamma, n), 400
        there = np.linspace(0.0, u, steps + 1)[1:]
        z = loaded(beta + gamma, n, there)
        back = unloaded(beta - gamma, n, z[-1])
        path = np.concatenate([there, u - back * np.linspace(0.0, 1.0, steps + 1)[1:]])
        T = along(law, tangential(path))[:, 0]
        z_found = (T - alpha * k * path) / ((1 - alpha) * k)
        np.testing.assert_allclose(z_found[:steps], z, rtol=1e-5)
        assert abs(z_found[-1]) < 1e-5 * z[-1]

    @pytest.mark.slow
    @each("n", [1.0, 1.7, 3.0])
    @each("gamma", GAMMA)
    def test_no_energy_is_gained(self, n, gamma):
        """With the energy k (alpha u^2 + (1 - alpha) z^2)/2 of its springs, on a random path of short steps."""
        k, alpha = 2.0, 0.1
        law = bd.ContactLaw.bouc_wen(k, alpha, 1.0, gamma, n)
        turns = np.random.default_rng(3).normal(size=12)
        u = np.concatenate(
            [np.linspace(a, b, 200)[1:] for a, b in zip(np.append(0.0, turns), turns)]
        )
        T = along(law, tangential(u))[:, 0]
        u, T = np.append(0.0, u), np.append(0.0, T)
        z = (T - alpha * k * u) / ((1 - alpha) * k)
        stored = 0.5 * k * (alpha * u**2 + (1 - alpha) * z**2)
        lost = 0.5 * (T[1:] + T[:-1]) * np.diff(u) - np.diff(stored)
        assert lost.min() > -1e-6 * np.abs(lost).sum()
        assert lost.sum() > 0.1

    @pytest.mark.parametrize("gamma", [1.001, -1.001, 5.0, -5.0])
    def test_a_law_that_gains_energy_is_refused(self, gamma):
        with pytest.raises(bd.SettingError, match="gamma: expected"):
            bd.ContactLaw.bouc_wen(1.0, 0.1, 1.0, gamma)
        p = [0.0, 1.0, 0.1, 1.0, gamma, 1.0]
        with pytest.raises(bd.SettingError, match="gamma from -beta to beta"):
            bd.ContactLaw(_core.bouc_wen, 2, p, [1.0, 1.0, 0.0])
        with pytest.raises(bd.SettingError, match="gamma from -beta to beta"):
            bd.ContactLaw.of_record(
                bd.ContactLaw.bouc_wen(1.0, 0.1, 1.0, 0.5).record() | {"parameters": p}
            )
        with pytest.raises(ValueError, match="gamma from -beta to beta"):
            _core.check_laws(((_core.bouc_wen, np.array(p), np.zeros(5)),))


WRONG = [
    ("jenkins", {"parameters": [n, 0.0, 1.0, 0.5, 0.0]}) for n in (5000.0, -1.0, 3.0, 50.0, 0.5, 1e300)
] + [
    ("jenkins", {"n_state": 0}), ("jenkins", {"n_state": 3}), ("jenkins", {"parameters": [1.0]}),
    ("jenkins", {"parameters": []}),
    ("jenkins", {"parameters": [[1.0, 0.0, 1.0, 0.5, 0.0], [2.0, 0.0, 1.0, 0.5, 0.0]]}),
    ("jenkins", {"parameters": [1.0, 0.0, -1.0, 0.5, 0.0]}),
    ("bouc_wen", {"parameters": [1.0, 2.0]}), ("bouc_wen", {"n_state": 0}), ("bouc_wen", {"n_state": 1}),
    ("bouc_wen", {"parameters": [0.0, 1.0, 0.1, 1.0, 0.5, 0.9]}), ("bouc_wen", {"contact_law": "jenkins"}),
]  # fmt: skip


class Pickled:
    def __init__(self, record):
        self.record = record

    def __reduce__(self):
        return bd.ContactLaw.of_record, (self.record,)


@pytest.mark.parametrize(("name", "change"), WRONG)
class TestCountsOfOthers:
    """Counts that come with the numbers are those of the function, or nothing is read or written."""

    def record(self, name, change):
        law = (
            bd.ContactLaw.jenkins([1.0], [0.5])
            if name == "jenkins"
            else bd.ContactLaw.bouc_wen(1.0, 0.1, 2.0, 0.5)
        )
        return law.record() | change

    @pytest.mark.slow
    def test_files_and_pickles(self, name, change, tmp_path):
        record = self.record(name, change)
        contact = bd.Contact(0, kt=1.0, mu=1.0, preload=1.0)
        law = bd.ContactLaw.jenkins([1.0], [0.5])
        study = bd.lumped(
            1.0, 0.02, 1.0, contacts=[contact], forces={0: 0.4}, harmonics=1, friction_law=law
        )
        study.save(tmp_path / "study.h5")
        with h5py.File(tmp_path / "study.h5", "r+") as f:
            settings = json.loads(f["settings"][()]) | {"friction_law": record}
            del f["settings"]
            f["settings"] = json.dumps(settings)
        with pytest.raises(
            bd.SettingError, match=f"{record['contact_law']}: expected the parameters"
        ):
            bd.load_study(tmp_path / "study.h5")
        with pytest.raises(bd.SettingError, match="expected the parameters"):
            pickle.loads(pickle.dumps(Pickled(record)))

    def test_calls(self, name, change):
        record = self.record(name, change)
        function = {"jenkins": _core.jenkins, "bouc_wen": _core.bouc_wen}[record["contact_law"]]
        with pytest.raises(bd.SettingError, match="expected the parameters"):
            bd.ContactLaw(function, record["n_state"], record["parameters"], [1.0, 1.0, 0.0])
        p, memory = np.atleast_2d(record["parameters"])[-1], np.zeros((1, 3 + record["n_state"]))
        laws = ((function, np.array(p, float), memory[0].copy()),)
        with pytest.raises(ValueError, match="expected the parameters"):
            _core.step_laws(
                laws, np.ones((1, 3)), memory, memory.copy(), np.zeros((1, 3)), np.zeros((1, 3, 3))
            )
        with pytest.raises(ValueError, match="expected the parameters"):
            _core.evaluate_contact(
                np.zeros((3, 3)), np.zeros(2), 0.0, 0.0, 0.0, np.zeros(2), np.empty((3, 3)), np.empty((3, 3, 3, 3)), 7, 1,
                16, own=laws,
            )  # fmt: skip


def test_names_of_shipped_laws_are_theirs():
    """A file would bring back another function."""
    for name in ("jenkins", "iwan"):
        with pytest.raises(bd.SettingError, match="is the name of a built-in law"):
            bd.ContactLaw(_core.bouc_wen, 2, [0.0, 1.0, 0.1, 2.0, 0.5, 1.0], [1.0, 1.0, 0.0], name)
