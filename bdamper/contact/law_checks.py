r"""Check of a compiled contact law on short random paths, before an analysis uses it.

The solvers rely on three properties of a law :math:`s_k = g(x_k, x_{k-1}, s_{k-1})`,
:math:`F_k = f(x_k, s_k)`: forces and states are finite, a step without motion leaves the state
unchanged, and the four matrices are the derivatives.  The total derivative of the last force with
respect to the motions of a path contains all four,

.. math:: \frac{dF_m}{dx_j} = f_x \delta_{jm} + f_s \frac{ds_m}{dx_j}, \qquad
    \frac{ds_k}{dx_j} = g_s \frac{ds_{k-1}}{dx_j} + g_x \delta_{jk} + g_{x'} \delta_{j,k-1}.

Each derivative is compared with a forward and a backward difference; one must agree, because the
law may have a corner.
"""

from __future__ import annotations

import ctypes
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import LowLevelCallable

from bdamper.util.errors import SettingError
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
    r"""Check that a compiled law has the properties on which the solvers rely.

    The law follows short random paths.

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
        If a force, state or derivative is not finite, if a step without motion changes the state,
        or if a derivative disagrees with finite differences.
    """
    law = _Law(function, parameters, n_state)
    rng = np.random.default_rng(0)
    for size in length * np.array(LENGTHS):
        # mostly closed: the normal motion is positive if the surfaces approach
        path = size * rng.uniform([-1.0, -1.0, -0.3], 1.0, (STEPS, 3))
        F, D, states = law.follow(path)
        finite = np.isfinite(F).all() and np.isfinite(D).all() and np.isfinite(states).all()
        # only the shortest path has to be finite
        if not finite and size > length:
            return
        expected = "finite forces, states and derivatives"
        check(finite, where, expected, f"infinite or NaN values for displacements of {size:.3g} m")
        for x, s in zip(path, states):
            _check_rest(where, law, x, s)
        _check_slopes(where, law, path, F, D, SHORT * size)


def _check_rest(where: str, law: _Law, x: NDArray, s: NDArray) -> None:
    """Check that a step without motion leaves the state ``s`` (n,) at the motion ``x`` (3,)."""
    change = np.abs(law.step(x, x, s).state - s)
    if (change <= REST * np.abs(s)).all():
        return
    i = int(np.argmax(change))
    expected = "a state that does not change in a step without motion"
    found = f"a change of state {i} from {s[i]:.6g} by {change[i]:.3g}"
    raise SettingError(f"{where}: expected {expected}, found {found}")


def _check_slopes(where: str, law: _Law, path: NDArray, F: NDArray, D: NDArray, h: float) -> None:
    """Check the derivative ``D`` of the last force ``F`` by finite differences with the step h.

    Each motion of the path is displaced along each direction.
    """
    rounding = 1e3 * np.finfo(float).eps * np.abs(F).max() / h
    # column j of D: direction j % 3 of the motion in step j // 3
    for j in range(path.size):
        step, direction = divmod(j, 3)
        displacement = np.zeros_like(path)
        displacement[step, direction] = h
        F_forward, _, _ = law.follow(path + displacement)
        F_backward, _, _ = law.follow(path - displacement)
        forward = (F_forward - F) / h
        backward = (F_backward - F) / -h
        # the law may have a corner here: one side must agree
        slope = forward
        if np.abs(backward - D[:, j]).max() < np.abs(forward - D[:, j]).max():
            slope = backward

        error = np.abs(slope - D[:, j])
        largest = max(np.abs(D).max(), np.abs(slope).max())
        if error.max() <= SLOPE * largest + rounding:
            continue
        i = int(np.argmax(error))
        steps_before = STEPS - 1 - step
        entry = (
            f"for force {i + 1} with respect to motion {direction + 1}, {steps_before} steps "
            "earlier"
        )
        raise SettingError(
            f"{where}: expected derivatives that agree with finite differences, "
            f"{slope[i]:.6g} {entry}, found {D[i, j]:.6g}"
        )


class _Step(NamedTuple):
    """Answer of a law of n states after one step.

    Parameters
    ----------
    state : (n,) float
    force : (3,) float
    force_by_x : (3, 3) float
        Derivative of the force with respect to the motion.
    force_by_state : (3, n) float
        The same with respect to the new state.
    state_by_motions : (n, 6) float
        Derivative of the new state with respect to the motion and the motion before.
    state_by_state : (n, n) float
        The same with respect to the state before.
    """

    state: NDArray
    force: NDArray
    force_by_x: NDArray
    force_by_state: NDArray
    state_by_motions: NDArray
    state_by_state: NDArray


class _Law:
    """Compiled law, callable from Python."""

    def __init__(self, function: LowLevelCallable, parameters: NDArray, n_state: int) -> None:
        # a LowLevelCallable is a tuple that hides its first entry, the capsule with the address
        capsule = tuple.__getitem__(function, 0)
        name = _of_capsule("PyCapsule_GetName")(capsule)
        address = _of_capsule("PyCapsule_GetPointer", ctypes.c_void_p)(capsule, name)
        self._user_data = _of_capsule("PyCapsule_GetContext")(capsule)
        self._call = ctypes.CFUNCTYPE(None, *11 * [ctypes.c_void_p])(address)
        self._parameters = np.ascontiguousarray(parameters, float)
        self._n = n_state

    def step(self, x: NDArray, before: NDArray, s: NDArray) -> _Step:
        """Advance the law from motion ``before`` (3,) and state ``s`` (n,) to motion ``x`` (3,)."""
        n = self._n
        after = _Step(
            state=np.zeros(n),
            force=np.zeros(3),
            force_by_x=np.zeros((3, 3)),
            force_by_state=np.zeros((3, n)),
            state_by_motions=np.zeros((n, 6)),
            state_by_state=np.zeros((n, n)),
        )
        arrays = (x, before, self._parameters, s, *after)
        addresses = [array.ctypes.data for array in arrays]
        self._call(*addresses, self._user_data)
        return after

    def follow(self, path: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Follow a path (m, 3) from rest.

        Return the force (3,) at its end, the derivative (3, 3 m) of this force with respect to the
        path, and the states (m, n).
        """
        n = self._n
        m = len(path)
        before = np.zeros(3)
        s = np.zeros(n)
        # derivative of the state with respect to the motions; the first three columns belong to the
        # start
        by_motions = np.zeros((n, 3 * m + 3))
        states = []
        for k, x in enumerate(path):
            after = self.step(x, before, s)
            by_motions = after.state_by_state @ by_motions
            # columns of the motion before and of x; the law has x first
            before_and_x = slice(3 * k, 3 * k + 6)
            by_motions[:, before_and_x] += after.state_by_motions[:, [3, 4, 5, 0, 1, 2]]
            before = x
            s = after.state
            states.append(s)
        D = after.force_by_state @ by_motions[:, 3:]
        # the force also depends on the last motion directly
        D[:, -3:] += after.force_by_x
        return after.force, D, np.array(states)


def _of_capsule(name: str, *more: type) -> Any:
    """Return a function of the C interface of Python that takes a capsule and returns a pointer."""
    prototype = ctypes.PYFUNCTYPE(ctypes.c_void_p, ctypes.py_object, *more)
    return prototype((name, ctypes.pythonapi))
