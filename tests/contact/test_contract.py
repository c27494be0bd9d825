"""Laws of users that break the contract: the error names law, interface and what is wrong, at the first use."""

import ctypes
import shutil
import subprocess

import numpy as np
import pytest
from scipy import LowLevelCallable

import bdamper as bd
from bdamper.contact.laws import OwnLaws
from tests.core.test_core_laws import CALL, pointer

CONTACT = bd.Contact(0, kt=1.0, mu=1.0, preload=1.0)
AT = "law 'mine' of interface 'contact 1'"


def joint(function, parameters=(0.0,)):
    law = bd.ContactLaw(function, 2, parameters, [1.0, 1.0, 0.0], "mine")
    return bd.lumped(
        1.0, 0.02, 1.0, contacts=[CONTACT], forces={0: 0.4}, harmonics=1, friction_law=law
    )


def slider(change=lambda x, out: None, fades=0.0):
    """A Jenkins element of unit stiffness and limit, of which ``change`` spoils what it gives."""

    def law(x, before, s0):
        start, out = (1.0 - fades) * s0, {}
        out["s1"] = np.clip(start, x[:2] - 1.0, x[:2] + 1.0)
        rests = out["s1"] == start
        out["F"] = np.append(x[:2] - out["s1"], 0.0)
        out["Fx"], out["Fs"], out["sx"] = (
            np.diag([1.0, 1.0, 0.0]),
            -np.eye(3)[:, :2],
            np.zeros((2, 6)),
        )
        out["sx"][[0, 1], [0, 1]] = ~rests
        out["ss"] = np.diag((1.0 - fades) * rests)
        change(x, out)
        return tuple(out.values())

    return pointer(law, 2)


def spoils(name, value):
    def change(x, out):
        out[name] = out[name] + value

    return change


ANALYSES = [lambda s: s.static(0.0), lambda s: s.frequency_response(0.0, (0.1, 0.3)), lambda s: s.peak(0.0, (0.1, 0.3)),
            lambda s: s.frequency_sweep(0.0, (0.15, 0.16))]  # fmt: skip


@pytest.mark.parametrize("analysis", ANALYSES)
def test_what_is_not_finite(analysis):
    with pytest.raises(
        bd.SettingError, match=f"friction_law: {AT}: expected finite forces, states and derivatives"
    ):
        analysis(joint(slider(spoils("F", np.nan))))


@pytest.mark.parametrize("analysis", ANALYSES)
@pytest.mark.parametrize("fades", [1e-3, 1e-6])
def test_a_state_that_changes_at_rest(analysis, fades):
    with pytest.raises(
        bd.SettingError,
        match=f"{AT}: expected a state that does not change in a step without motion, found a change of ",
    ):
        analysis(joint(slider(fades=fades)))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("Fx", np.diag([0.3, 0.0, 0.0])), ("Fs", np.eye(3)[:, :2] * 0.01), ("ss", np.eye(2) * 0.1),
        ("sx", np.eye(2, 6) * 0.05), ("sx", np.eye(2, 6, 3) * 0.05), ("Fx", np.full((3, 3), np.nan)),
    ],
)  # fmt: skip
def test_derivatives(name, value):
    with pytest.raises(bd.SettingError, match=f"{AT}: expected .*derivatives"):
        joint(slider(spoils(name, value))).static(0.0)


def test_every_row_of_parameters_is_tested():
    def springs(x, before, p, s0, s1, F, Fx, Fs, sx, ss, data):
        for d in range(3):
            F[d] = p[0] * x[d]
            if Fx:
                Fx[4 * d] = min(p[0], 1.0)

    function = LowLevelCallable(CALL(springs))

    def static(stiffness):
        law = bd.ContactLaw(function, 0, [[k] for k in stiffness], [1.0, 1.0, 1.0], "mine")
        own = OwnLaws.of([(slice(0, len(stiffness)), "left", law)], np.ones(3), np.zeros(3), 1.0)
        return own.step(np.ones((3, 3)), np.zeros((3, 3)))[0][:, 0]

    np.testing.assert_array_equal(static([1.0, 0.5, 0.2]), [1.0, 0.5, 0.2])
    with pytest.raises(
        bd.SettingError, match=r"law 'mine' of interface 'left': expected derivatives .*, found 1"
    ):
        static([1.0, 0.5, 2.0])


def test_a_law_that_keeps_the_contract():
    assert joint(slider()).static(0.0).ok


ENDS = """
#include <math.h>
void ends(const double *x, const double *before, const double *p, const double *s0, double *s1, double *F, double *Fx,
          double *Fs, double *sx, double *ss, void *data) {
    F[0] = fabs(x[0]) > p[0] ? NAN : x[0];
    F[1] = x[1], F[2] = 0.0;
    if (Fx) Fx[0] = Fx[4] = 1.0;
}
"""


def test_values_that_end_at_larger_motions(tmp_path):
    """The curve ends where they end, and its reason names the law; a step there is an error."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        pytest.skip("no C compiler")
    (tmp_path / "ends.c").write_text(ENDS)
    command = [
        compiler,
        "-shared",
        "-fPIC",
        str(tmp_path / "ends.c"),
        "-o",
        str(tmp_path / "ends.so"),
        "-lm",
    ]
    subprocess.run(command, check=True, timeout=60)
    function = ctypes.CDLL(str(tmp_path / "ends.so")).ends
    function.restype, function.argtypes = (
        None,
        [ctypes.POINTER(ctypes.c_double)] * 10 + [ctypes.c_void_p],
    )
    law = bd.ContactLaw(LowLevelCallable(function), 0, [1.2], [1.0, 1.0, 0.0], "mine")
    study = bd.lumped(
        1.0, 0.02, 1.0, contacts=[CONTACT], forces={0: 0.4}, harmonics=1, friction_law=law
    )
    curve = study.frequency_response(0.0, (0.14, 0.25))
    assert curve.status == "incomplete"
    assert f"forces of {AT} may not be finite there" in curve.reason
    with pytest.raises(
        bd.SettingError,
        match=rf"{AT}: expected finite .*, found NaN or infinite ones for the displacement \[1.3",
    ):
        study.problem.own_laws.step(np.array([[1.3, 0.0, 0.0]]), np.zeros((1, 3)))


def test_memory_of_another_law_is_refused():
    law = bd.ContactLaw.jenkins([1.0, 2.0], [0.5, 0.5])
    own = OwnLaws(law.of_points(1, "joint"), np.zeros(1))
    with pytest.raises(ValueError, match="reshape"):
        own.step(np.zeros((1, 3)), np.zeros((1, 5)))
