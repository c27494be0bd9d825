r"""Check of a compiled contact law on short random paths, before an analysis uses it.

The solvers rely on three properties of a law :math:`s_k = g(x_k, x_{k-1}, s_{k-1})`, :math:`F_k = f(x_k, s_k)`: forces and
states are finite, a step without motion leaves the state unchanged, and the four matrices are the derivatives.  The total
derivative of the last force with respect to the motions of a path contains all four,

.. math:: \frac{dF_m}{dx_j} = f_x \delta_{jm} + f_s \frac{ds_m}{dx_j}, \qquad
    \frac{ds_k}{dx_j} = g_s \frac{ds_{k-1}}{dx_j} + g_x \delta_{jk} + g_{x'} \delta_{j,k-1}.

Each derivative is compared with a forward and a backward difference; one must agree, since the law may have a corner.
"""

from __future__ import annotations

import ctypes

import numpy as np
from numpy.typing import NDArray
from scipy import LowLevelCallable

from bdamper.util.validation import check

LENGTHS = (1.0, 30.0, 1000.0)
"""Lengths of the test paths relative to the motion under the excitation without resonance."""
STEPS = 4
REST = 1e-7
"""Largest change of the state in a step without motion, relative to the state."""
SHORT = 1e-6
"""Step of the finite differences relative to the length of the path."""
SLOPE = 1e-3
"""Largest error of a derivative relative to the largest derivative."""


def check_law(
    where: str, function: LowLevelCallable, parameters: NDArray, n_state: int, length: float
) -> None:
    r"""Check on short random paths that a compiled law has the properties on which the solvers rely.

    Parameters
    ----------
    where : str
        Beginning of the error message.
    function : LowLevelCallable
    parameters : (n,) float
    n_state : int
    length : float, m
        Length of the shortest path; on longer paths a law need not be finite.

    Raises
    ------
    SettingError
        If a force, state or derivative is not finite, if a step without motion changes the state, or if a derivative
        disagrees with finite differences.
    """
    law, rng = _Law(function, parameters, n_state), np.random.default_rng(0)
    for size in length * np.array(LENGTHS):
        path = size * rng.uniform([-1.0, -1.0, -0.3], 1.0, (STEPS, 3))
        F, D, states = law.follow(path)
        finite = all(np.isfinite(a).all() for a in (F, D, states))
        if not finite and size > length:
            return
        check(
            finite,
            where,
            "finite forces, states and derivatives",
            f"others at motions of {size:.3g} m",
        )
        for x, s in zip(path, states):
            change = np.abs(law.step(x, x, s)[0] - s)
            if not (change <= REST * np.abs(s)).all():
                i = int(np.argmax(change))
                found = f"that state {i} changes by {change[i]:.3g} from {s[i]:.6g} in such a step"
                check(False, where, "a state that a step without motion leaves as it is", found)
        _check_slopes(where, law, path, F, D, SHORT * size)


def _check_slopes(where: str, law: _Law, path: NDArray, F: NDArray, D: NDArray, h: float) -> None:
    rounding = 1e3 * np.finfo(float).eps * np.abs(F).max() / h
    for j, shift in enumerate(h * np.eye(path.size).reshape(-1, *path.shape)):
        slopes = [(law.follow(path + sign * shift)[0] - F) / (sign * h) for sign in (1.0, -1.0)]
        slope = min(slopes, key=lambda slope: np.abs(slope - D[:, j]).max())
        error = np.abs(slope - D[:, j])
        if not error.max() <= SLOPE * max(np.abs(D).max(), np.abs(slope).max()) + rounding:
            i = int(np.argmax(error))
            by = f"of force {i + 1} by motion {j % 3 + 1}, {STEPS - 1 - j // 3} steps before"
            expected = f"derivatives that agree with finite differences, {slope[i]:.6g} {by}"
            check(False, where, expected, f"{D[i, j]:.6g}")


class _Law:
    """Compiled law, callable from Python."""

    def __init__(self, function: LowLevelCallable, parameters: NDArray, n_state: int) -> None:
        capsule, api = tuple.__getitem__(function, 0), ctypes.pythonapi
        name = ctypes.PYFUNCTYPE(ctypes.c_void_p, ctypes.py_object)(("PyCapsule_GetName", api))(
            capsule
        )
        of_capsule = ctypes.PYFUNCTYPE(ctypes.c_void_p, ctypes.py_object, ctypes.c_void_p)
        address = of_capsule(("PyCapsule_GetPointer", api))(capsule, name)
        self._data = ctypes.PYFUNCTYPE(ctypes.c_void_p, ctypes.py_object)(
            ("PyCapsule_GetContext", api)
        )(capsule)
        self._call = ctypes.CFUNCTYPE(None, *11 * [ctypes.c_void_p])(address)
        self._parameters, self._n = np.ascontiguousarray(parameters, float), n_state

    def step(self, x: NDArray, before: NDArray, s: NDArray) -> list[NDArray]:
        """Advance the law from motion ``before`` (3,) and state ``s`` (n,) to motion ``x`` (3,).

        Returns
        -------
        list
            State (n,), force (3,), and derivatives: of the force with respect to x (3, 3) and to the new state (3, n), of
            the new state with respect to x and before (n, 6) and to s (n, n).
        """
        n = self._n
        out = [np.zeros(shape) for shape in (n, 3, (3, 3), (3, n), (n, 6), (n, n))]
        self._call(*(a.ctypes.data for a in (x, before, self._parameters, s, *out)), self._data)
        return out

    def follow(self, path: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Follow a path (m, 3) from rest.

        Return the force (3,) at its end, the derivative (3, 3 m) of this force with respect to the path, and the states
        (m, n).
        """
        n, m = self._n, len(path)
        before, s, by, states = np.zeros(3), np.zeros(n), np.zeros((n, 3 * m + 3)), []
        for k, x in enumerate(path):
            s, F, Fx, Fs, sx, ss = self.step(x, before, s)
            by = ss @ by
            by[:, 3 * k : 3 * k + 6] += sx[
                :, [3, 4, 5, 0, 1, 2]
            ]  # the first three columns belong to the start
            before = x
            states.append(s)
        D = Fs @ by[:, 3:]
        D[:, -3:] += Fx
        return F, D, np.array(states)
