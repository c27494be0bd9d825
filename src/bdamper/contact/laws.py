r"""Contact laws by number, and how contact forces are found over a cycle.

The laws themselves are evaluated by the C core (``csrc/bd_element.c``, ``bd_event.c``, ``bd_sampled.c``, ``bd_coulomb.c``;
LAW_USER is a function that is supplied by the user, see :mod:`bdamper.contact.laws`).

Parameters of the contact points, as the equations take them.

Contact laws as compiled functions: those that a user brings, and Jenkins elements, Iwan and Bouc-Wen.

A law leads from one instant to the next.  Its state :math:`s` follows from the motion :math:`x = (u_1, u_2, v)`, the motion
one instant earlier and the state there; the forces :math:`F = (T_1, T_2, N)` follow from the motion and the new state:

.. math:: s_k = g(x_k, x_{k-1}, s_{k-1}), \qquad F_k = f(x_k, s_k).

The function has the signature ``bd_user_law`` of ``csrc/bd_law.h``.  The core calls it without the interpreter, in harmonic
balance (``csrc/bd_user.c``), in the static analysis and in the march in time.

The four parameters of Segalman (J. Appl. Mech. 72, 2005, 752-760) are a strength :math:`F_S`, a stiffness :math:`K_T`, an
exponent :math:`\chi` and a ratio :math:`\beta`.  They stand for Jenkins elements of unit stiffness density that slip at
displacements :math:`\phi`, with

.. math::
    \rho(\phi) = R \phi^\chi \text{ for } \phi < \phi_m, \quad S \text{ of them at } \phi_m, \quad
    \phi_m = \frac{F_S (1 + \beta)}{K_T \left(\beta + \frac{\chi + 1}{\chi + 2}\right)}, \quad
    R \phi_m^{\chi + 1} = \frac{K_T (\chi + 1)}{1 + \beta}, \quad S = \frac{K_T \beta}{1 + \beta}.

Below macroslip the loss of a cycle of amplitude :math:`u` is :math:`4 R u^{\chi + 3}/((\chi + 3)(\chi + 2))`.

Tests of a user's contact law at a few states, before an analysis relies on it.

The solvers rely on three properties of a law :math:`s_k = g(x_k, x_{k-1}, s_{k-1})`, :math:`F_k = f(x_k, s_k)`: forces and
states are finite, a step without motion leaves the state as it is, and the matrices are the derivatives.  The law is called
along short random paths of several lengths.  The total derivative of the last force by all motions of a path,

.. math:: \frac{dF_m}{dx_j} = f_x \delta_{jm} + f_s \frac{ds_m}{dx_j}, \qquad
    \frac{ds_k}{dx_j} = g_s \frac{ds_{k-1}}{dx_j} + g_x \delta_{jk} + g_{x'} \delta_{j,k-1},

contains all four matrices and is compared with differences to either side, one of which no corner of the law disturbs.
"""

from __future__ import annotations

import ctypes
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Annotated, Any, Self

import numpy as np
from numpy.typing import NDArray
from scipy import LowLevelCallable

from bdamper import _core
from bdamper.model.structure import ContactStiffness
from bdamper.util import validation
from bdamper.util.errors import SettingError, one_line, warn
from bdamper.util.formatting import short_repr

# ---- Contact laws by number, and how contact forces are found over a cycle ----


LAW_SEPARABLE, LAW_NORMAL, LAW_CONSTANT, LAW_COUPLED, LAW_COUPLED_CONSTANT, LAW_BONDED, LAW_CUBIC, LAW_USER = range(8)
MAX_SAMPLES = 1 << 20
"""Samples per period that the core takes at most."""


@dataclass(frozen=True)
class AFT(validation.Checked):
    """Contact forces from samples in time (alternating frequency/time) instead of exact events.

    Parameters
    ----------
    n_time : int
        Samples per period, at least ``4 harmonics + 4``.
    interpolate : bool
        Interpolate the instant of closing between samples; without it the derivative does not converge.
    """

    n_time: Annotated[int, partial(validation.integer, least=8, most=MAX_SAMPLES)] = 128
    interpolate: bool = True


def check_evaluation(contact_forces: str | AFT, harmonics: int) -> None:
    """Refuse what is no evaluation, or too few samples for the highest harmonic."""
    if isinstance(contact_forces, AFT):
        expected = f"AFT with at least {4 * harmonics + 4} samples for {harmonics} harmonics"
        n_time = contact_forces.n_time
        validation.check_value(n_time >= 4 * harmonics + 4, "contact_forces", expected, n_time)
    elif not isinstance(contact_forces, str) or contact_forces != "event_driven":
        raise validation.invalid("contact_forces", '"event_driven" or AFT(n_time)', contact_forces)


# ---- Tests of a user's contact law at a few states, before an analysis relies on it ----


LENGTHS = (1.0, 30.0, 1000.0)
"""Of the paths, relative to the motion under the excitation at rest; resonance makes it larger."""
STEPS = 4
REST = 1e-7
"""Largest change of the state in a step without motion, relative to the state."""
SHORT = 1e-6
"""Step of the differences, relative to the length of the path."""
SLOPE = 1e-3
"""Largest error of a derivative, relative to the largest one."""



def check(where: str, function: LowLevelCallable, parameters: NDArray, n_state: int, length: float) -> None:
    """Refuse a law that breaks the contract on paths of about a length (m).

    On the longer paths a law need not be finite.

    Raises
    ------
    SettingError
    """
    law, rng = _Law(function, parameters, n_state), np.random.default_rng(0)
    for size in length * np.array(LENGTHS):
        path = size * rng.uniform([-1.0, -1.0, -0.3], 1.0, (STEPS, 3))
        F, D, states = law.time_response(path)
        if not all(np.isfinite(a).all() for a in (F, D, states)):
            if size > length:
                return
            raise _broken(where, "finite forces, states and derivatives", f"others at motions of {size:.3g} m")
        for x, s in zip(path, states):
            change = np.abs(law.step(x, x, s)[0] - s)
            if not (change <= REST * np.abs(s)).all():
                i = int(np.argmax(change))
                found = f"that state {i} changes by {change[i]:.3g} from {s[i]:.6g} in such a step"
                raise _broken(where, "a state that a step without motion leaves as it is", found)
        _check_slopes(where, law, path, F, D, SHORT * size)


def _check_slopes(where: str, law: _Law, path: NDArray, F: NDArray, D: NDArray, h: float) -> None:
    rounding = 1e3 * np.finfo(float).eps * np.abs(F).max() / h
    for j, shift in enumerate(h * np.eye(path.size).reshape(-1, *path.shape)):
        slopes = [(law.time_response(path + sign * shift)[0] - F) / (sign * h) for sign in (1.0, -1.0)]
        slope = min(slopes, key=lambda slope: np.abs(slope - D[:, j]).max())
        error = np.abs(slope - D[:, j])
        if not error.max() <= SLOPE * max(np.abs(D).max(), np.abs(slope).max()) + rounding:
            i = int(np.argmax(error))
            by = f"of force {i + 1} by motion {j % 3 + 1}, {STEPS - 1 - j // 3} steps before"
            expected = f"derivatives that agree with finite differences, {slope[i]:.6g} {by}"
            raise _broken(where, expected, f"{D[i, j]:.6g}")


def _broken(where: str, expected: str, found: str) -> SettingError:
    return SettingError(f"{where}: expected {expected}, found {found}")


class _Law:
    """A law that Python calls.

    Parameters
    ----------
    function : LowLevelCallable
    parameters : (n,) float
    n_state : int
    """

    def __init__(self, function: LowLevelCallable, parameters: NDArray, n_state: int) -> None:
        capsule, api = tuple.__getitem__(function, 0), ctypes.pythonapi
        name = ctypes.PYFUNCTYPE(ctypes.c_void_p, ctypes.py_object)(("PyCapsule_GetName", api))(capsule)
        of_capsule = ctypes.PYFUNCTYPE(ctypes.c_void_p, ctypes.py_object, ctypes.c_void_p)
        address = of_capsule(("PyCapsule_GetPointer", api))(capsule, name)
        self._data = ctypes.PYFUNCTYPE(ctypes.c_void_p, ctypes.py_object)(("PyCapsule_GetContext", api))(capsule)
        self._call = ctypes.CFUNCTYPE(None, *11 * [ctypes.c_void_p])(address)
        self._parameters, self._n = np.ascontiguousarray(parameters, float), n_state

    def step(self, x: NDArray, before: NDArray, s: NDArray) -> list[NDArray]:
        """State and forces after a step, and the matrices Fx, Fs, sx, ss."""
        n = self._n
        out = [np.zeros(shape) for shape in (n, 3, (3, 3), (3, n), (n, 6), (n, n))]
        self._call(*(a.ctypes.data for a in (x, before, self._parameters, s, *out)), self._data)
        return out

    def time_response(self, path: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Forces (3,) at the end of a path (m, 3) from rest, their derivative (3, 3 m) by it, and states (m, n_state)."""
        n, m = self._n, len(path)
        before, s, by, states = np.zeros(3), np.zeros(n), np.zeros((n, 3 * m + 3)), []
        for k, x in enumerate(path):
            s, F, Fx, Fs, sx, ss = self.step(x, before, s)
            by = ss @ by
            by[:, 3 * k : 3 * k + 6] += sx[:, [3, 4, 5, 0, 1, 2]]  # the first three columns belong to the start
            before = x
            states.append(s)
        D = Fs @ by[:, 3:]
        D[:, -3:] += Fx
        return F, D, np.array(states)


# ---- Contact laws as compiled functions ----


SIGNATURE = re.compile(r"void ?\(([^,()]*\*,){10}[^,()]*\*\)")
"""Eleven pointers and no value, as SciPy and C name them."""
Numbers = Sequence[float] | NDArray
SHIPPED = {"jenkins": _core.jenkins, "iwan": _core.jenkins, "bouc_wen": _core.bouc_wen}
"""Functions of the core by the names of the laws that use them."""


@dataclass(frozen=True, eq=False)
class ContactLaw:
    """A contact law as a compiled function, for ``friction_law=`` of a study.

    The function has the signature ``bd_user_law`` of ``csrc/bd_law.h``: eleven pointers and no value.  It must not call
    Python, and must do the same in every call with the same arguments: threads call it side by side.

    Parameters
    ----------
    function : PyCapsule, scipy.LowLevelCallable or numba cfunc
        A capsule has the C signature as its name.  The user data of a LowLevelCallable is the last argument.
    n_state : int
        Numbers in the state, which is zero before any load.
    parameters : (n,) or (n_points, n) float
        What the function takes as ``p``: the same for all points of an interface, or a row for each.
    stick : (3,) or (n_points, 3) float, N/m
        Springs kt1, kt2, kn of the law while nothing slips, in place of the contact stiffness: for stuck curves and
        frequencies.  A ``gap`` is measured by them, too, so kn must not be zero where there is one.
    name : str
        For prints and files; the function's own name by default, if it has one.  The names of the built-in laws are
        reserved for them.
    resolution : float, m
        Smallest amplitude of the relative motion that the law resolves.  Tracking warns if the motion stays below it.

    Raises
    ------
    SettingError
        If the function is none of these or has another signature; for numbers that do not fit.
    """

    function: Any = field(repr=False)
    n_state: int
    parameters: NDArray
    stick: NDArray
    name: str = ""
    resolution: float = 0.0
    pointer: Any = field(init=False, repr=False)
    """What the core calls."""

    def __post_init__(self) -> None:
        pointer, name = _pointer(self.function)
        object.__setattr__(self, "pointer", pointer)
        object.__setattr__(self, "name", self.name or name)
        object.__setattr__(self, "n_state", validation.integer("n_state", self.n_state, most=1000))
        validation.number("resolution", self.resolution, least=0.0, unit="m")
        for own in ("parameters", "stick"):
            given = _numbers(getattr(self, own))
            validation.check_value(given is not None, own, "finite numbers, (n,) or (n_points, n)", getattr(self, own))
            object.__setattr__(self, own, given)
        good = self.stick.shape[-1] == 3 and (self.stick >= 0.0).all() and self.stick.any()
        validation.check_value(good, "stick", "stiffness kt1, kt2, kn in N/m, none negative, one positive", self.stick)
        free = self.name not in SHIPPED or pointer.function is SHIPPED[self.name]
        validation.check_value(free, "name", f"none of {tuple(SHIPPED)}, which are those of built-in laws", self.name)
        for row in np.atleast_2d(self.parameters):
            try:
                _core.check_laws(((pointer, row, np.zeros(3 + self.n_state)),))
            except (TypeError, ValueError) as error:
                raise SettingError(f"law '{self.name}': {error}: {one_line(row.tolist())}") from error

    def __str__(self) -> str:
        return f"{self.name} ({self.parameters.shape[-1]} parameters, {self.n_state} states)"

    @classmethod
    @validation.check_arguments
    def jenkins(cls, stiffness: Numbers, limit: Numbers | float, mu: Numbers | float = 0.0, *, kn: float = 0.0) -> Self:
        """Springs with sliders, side by side along each tangential direction.

        Parameters
        ----------
        stiffness : (n,) float, N/m
        limit : number or (n,) float, N
            Force at which each slider slips without normal force.
        mu : number or (n,) float
            What its limit gains with each newton of normal force.
        kn : float, N/m
            Of the normal spring, which only pushes.  Without it the sliders know nothing of separation.
        """
        k = validation.numbers("stiffness", stiffness, above=0.0)
        several = [("limit", limit), ("mu", mu)]
        f, m = (validation.numbers(n, [x] * len(k) if np.ndim(x) == 0 else x, len(k), least=0.0) for n, x in several)
        kn = validation.number("kn", kn, least=0.0, unit="N/m")
        parameters = np.concatenate([[len(k), kn], np.column_stack([k, f, m]).ravel()])
        return cls(_core.jenkins, 2 * len(k), parameters, np.array([k.sum(), k.sum(), kn]), "jenkins")

    @classmethod
    @validation.check_arguments
    def iwan(
        cls,
        strength: float,
        stiffness: float,
        chi: float,
        beta: float,
        *,
        kn: float = 0.0,
        n: int | None = None,
        decades: float = 3.0,
    ) -> Self:
        """Segalman's four-parameter Iwan model of a joint, in n + 1 Jenkins elements along each tangential direction.

        Strength, stiffness and the share of each element are exact; its slip displacement is the mean of its interval.
        With 13 intervals per decade the loss of a cycle is within 2 % of the power law, from the amplitude
        10^(1 - decades) of macroslip on, which is the ``resolution`` of the law.

        Parameters
        ----------
        strength : float, N
            Force of macroslip.
        stiffness : float, N/m
            Tangential stiffness of the joint that sticks.
        chi : float
            Exponent of the density of slip displacements, -1 < chi <= 0.
        beta : float
            Stiffness of the elements that slip last over that of the others.
        kn : float, N/m
            As of :meth:`jenkins`.
        n : int, optional
            Intervals of slip displacements; 13 per decade by default.  The first one begins at zero, the others have
            equal ratios.
        decades : float
            Decades of slip displacements, from the end of the first interval to macroslip.
        """
        F = validation.number("strength", strength, above=0.0, unit="N")
        K = validation.number("stiffness", stiffness, above=0.0, unit="N/m")
        chi = validation.number("chi", chi, above=-1.0, most=0.0)
        beta = validation.number("beta", beta, least=0.0)
        decades = validation.number("decades", decades, least=1.0, most=12.0)
        n = round(13.0 * decades) if n is None else validation.integer("n", n, least=2, most=400)
        edge = np.concatenate([[0.0], np.geomspace(10.0**-decades, 1.0, n)])
        last = F * (1.0 + beta) / (K * (beta + (chi + 1.0) / (chi + 2.0)))
        share = np.diff(edge ** (chi + 1.0))
        mean = (chi + 1.0) / (chi + 2.0) * np.diff(edge ** (chi + 2.0)) / share
        k, slip = np.append(share, beta) * K / (1.0 + beta), np.append(mean, 1.0) * last
        held = k > 0.0
        law = cls.jenkins(k[held], (k * slip)[held], kn=kn)
        return replace(law, name="iwan", resolution=10.0 ** (1.0 - decades) * last)

    @classmethod
    @validation.check_arguments
    def bouc_wen(
        cls, stiffness: float, alpha: float, beta: float, gamma: float, n: float = 1.0, *, kn: float = 0.0
    ) -> Self:
        """Bouc-Wen hysteresis along each tangential direction, T = alpha k u + (1 - alpha) k z.

        Its state follows dz = du - beta abs(du) abs(z)^(n - 1) z - gamma du abs(z)^n.

        Parameters
        ----------
        stiffness : float, N/m
            k.
        alpha : float
            Share of the stiffness that stays in macroslip, 0 to 1.
        beta, gamma : float, 1/m^n
            -beta <= gamma <= beta; beyond these bounds the law would gain energy.
        n : float
            At least 1.
        kn : float, N/m
            Of the normal spring, which only pushes and has no influence on T.
        """
        k = validation.number("stiffness", stiffness, above=0.0, unit="N/m")
        alpha = validation.number("alpha", alpha, least=0.0, most=1.0)
        beta = validation.number("beta", beta, above=0.0)
        gamma = validation.number("gamma", gamma, least=-beta, most=beta)
        n = validation.number("n", n, least=1.0)
        kn = validation.number("kn", kn, least=0.0, unit="N/m")
        return cls(_core.bouc_wen, 2, np.array([kn, k, alpha, beta, gamma, n]), np.array([k, k, kn]), "bouc_wen")

    def record(self) -> dict[str, Any]:
        """Record of the law for files and results: everything except the function."""
        numbers = {"parameters": self.parameters.tolist(), "stick": self.stick.tolist(), "resolution": self.resolution}
        return {"contact_law": self.name, "n_state": self.n_state, **numbers}

    @classmethod
    def of_record(cls, record: Mapping[str, Any]) -> Self:
        """The law of a record, if bdamper has its function.

        Raises
        ------
        SettingError
        """
        name = record.get("contact_law")
        if not isinstance(name, str) or name not in SHIPPED:
            found = f"{name!r}, of which a file has no function; make the study again with the law"
            raise SettingError(f"friction_law: expected a law of {tuple(SHIPPED)}, found {one_line(found)}")
        numbers: dict[str, Any] = {key: record.get(key) for key in ("n_state", "parameters", "stick")}
        return cls(SHIPPED[name], **numbers, name=name, resolution=record.get("resolution", 0.0))

    def __reduce__(self) -> Any:
        """Shipped laws go to other processes; the address of another function means nothing there."""
        return ContactLaw.of_record, (self.record(),)

    @property
    def shipped(self) -> bool:
        """Whether the function is one of the core."""
        return any(self.pointer.function is function for function in SHIPPED.values())

    def springs(self, n: int, interface: str) -> ContactStiffness:
        """Return the contact stiffness of the n points of an interface under the law."""
        return ContactStiffness(self._rows("stick", n, interface).copy(), "user")

    def of_points(self, n: int, interface: str) -> list[tuple[ContactLaw, NDArray, str]]:
        """The law, its parameters and the interface for each of n points of an interface."""
        return [(self, p, interface) for p in self._rows("parameters", n, interface)]

    def _rows(self, name: str, n: int, interface: str) -> NDArray:
        """Return the parameters or the springs with a row for each of n points."""
        given = getattr(self, name)
        good = given.ndim == 1 or len(given) == n
        validation.check(good, f"{name} of law '{self.name}'", f"{n} rows for '{interface}'", f"{len(given)}")
        return np.broadcast_to(given, (n, given.shape[-1]))


def _numbers(given: Any) -> NDArray | None:
    """Finite numbers of one or two dimensions, of a list or an array; None for anything else."""
    try:
        out = np.array(given)
    except ValueError:  # rows of several lengths
        return None
    good = out.ndim in (1, 2) and out.dtype.kind in "iuf" and np.isfinite(out).all()
    return out.astype(float, order="C") if good else None


def _pointer(function: Any) -> tuple[LowLevelCallable, str]:
    """What the core calls, and the name of the function if it has one."""
    name = getattr(function, "__name__", "own law")
    try:
        if hasattr(function, "native_name") and hasattr(function, "ctypes"):  # a cfunc of numba
            function = function.ctypes
        made = function if isinstance(function, LowLevelCallable) else LowLevelCallable(function)
        signature = str(made.signature)
    except (TypeError, ValueError) as error:
        expected = "a PyCapsule, scipy.LowLevelCallable or cfunc of numba, since the core calls no Python"
        raise validation.invalid("function", expected, function) from error
    if SIGNATURE.fullmatch(signature.replace(", ", ",")) is None:
        raise SettingError(f"function: expected the signature void of eleven pointers (bd_user_law), found '{signature}'")
    return made, getattr(made.function, "__name__", name)


@dataclass(frozen=True, eq=False)
class OwnLaws:
    """Laws of the contact points of a structure, of which some have functions of their own.

    Parameters
    ----------
    points : sequence of (ContactLaw, parameters, interface) or None
        For each point.
    rest : (n_points,) float, m
        Closing of the surfaces where the motion is zero: interference, or minus the gap.
    """

    points: Sequence[tuple[ContactLaw, NDArray, str] | None]
    rest: NDArray

    @classmethod
    def of(
        cls, laws: Sequence[tuple[slice, str, ContactLaw]], kn: NDArray, gap: NDArray, length: float
    ) -> Self | None:
        """Laws of several interfaces, each with its rows among all points, which have springs kn and gaps (n_points,).

        Functions of users are tested on motions of about a length (m).
        """
        points: list[Any] = [None] * len(kn)
        for rows, name, law in laws:
            points[rows] = law.of_points(rows.stop - rows.start, name)
            for p in () if law.shipped else np.unique(np.atleast_2d(law.parameters), axis=0):
                check(f"friction_law: {_named(law, name)}", law.pointer, p, law.n_state, length)
        return cls(points, np.where(kn > 0.0, -gap, 0.0)) if any(points) else None

    @property
    def held(self) -> NDArray:
        """(n_points,) bool: points with functions."""
        return np.array([point is not None for point in self.points])

    @property
    def names(self) -> str:
        """The laws with their interfaces, for messages."""
        return ", ".join(sorted({_named(law, interface) for law, _, interface in filter(None, self.points)}))

    def warn_below(self, motion: NDArray) -> None:
        """Warn of interfaces whose motions (n_points, 3, n_coef) all stay below the resolution of their law."""
        moved = np.abs(motion[:, :2, 1:]).sum(axis=2).max(axis=1)
        largest: dict[tuple[ContactLaw, str], float] = {}
        for point, x in zip(self.points, moved.tolist()):
            if point is not None:
                key = point[0], point[2]
                largest[key] = max(x, largest.get(key, 0.0))
        for (law, interface), x in largest.items():
            if x < law.resolution:
                warn(
                    f"{_named(law, interface)} moves by at most {x:.3g} m at the highest point, less than the "
                    f"{law.resolution:.3g} m that the law resolves: its dissipation is wrong there; raise its decades"
                )

    @property
    def width(self) -> int:
        """Numbers that a point remembers: its latest motion and the state of its law there."""
        return max(3 + point[0].n_state for point in self.points if point is not None)

    def core(self, memory: NDArray) -> tuple[tuple[Any, ...] | None, ...]:
        """Functions as the core takes them, with what each point (n_points, width) remembers."""
        return tuple(
            None if point is None else (point[0].pointer, point[1].copy(), kept[: 3 + point[0].n_state].copy(), point[0])
            for point, kept in zip(self.points, np.reshape(memory, (len(self.points), self.width)).astype(float))
        )

    def step(self, x: NDArray, memory: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Forces (n_points, 3), their derivative (n_points, 3, 3) and what points remember after a step to motions x.

        What belongs to points without functions is zero, and what they remember as it was.
        """
        at = np.array(x, float)
        at[:, 2] += self.rest
        before, after = np.array(memory, float, order="C"), np.array(memory, float, order="C")
        F, D = np.zeros((len(at), 3)), np.zeros((len(at), 3, 3))
        _core.step_laws(self.core(before), at, before, after, F, D)
        wrong = ~(np.isfinite(F).all(axis=1) & np.isfinite(after).all(axis=1) & np.isfinite(D).all(axis=(1, 2)))
        for point, motion in ((self.points[int(i)], at[i].tolist()) for i in np.flatnonzero(wrong)):
            where = f"friction_law: {_named(point[0], point[2])}" if point else ""
            raise SettingError(f"{where}: expected finite forces and states, found others at the motion {motion} m")
        return F, D, after


def _named(law: ContactLaw, interface: str) -> str:
    return f"law '{law.name}' of interface '{interface}'"


def refuse(own: OwnLaws | None, what: str) -> None:
    """Refuse contact laws of a user's own where nothing is known of their events or of how they change."""
    if own is not None:
        names = sorted({point[0].name for point in own.points if point is not None})
        raise SettingError(f"friction_law: {what} expected laws whose events bdamper knows, found {', '.join(names)}")


# ---- Parameters of the contact points, as the equations take them ----


@short_repr
@dataclass(frozen=True)
class PointArrays:
    """Parameters of all contact points, stacked.

    Parameters
    ----------
    kt : (n_points, 2) float, N/m
    kn : (n_points,) float, N/m
    mu, n0 : (n_points,) float
        Friction coefficient; normal load at zero closing (N), negative for a gap.
    slider : (n_points, 2) float, m
        An infinite slider asks for that end of the interval of admissible ones where a point never slips.
    law : (n_points,) int
        LAW_SEPARABLE, LAW_NORMAL (no friction), LAW_CONSTANT (friction limited by ``load``, two-sided normal spring),
        LAW_COUPLED, LAW_COUPLED_CONSTANT (friction force in a disk), LAW_BONDED (linear springs),
        LAW_CUBIC (``kt u^3`` along both tangential directions, kt in N/m3, and nothing else), LAW_USER (functions in
        ``own``, with kt and kn as springs while nothing slips).
    shift : (n_points, 3) float, m
        Constant part of (u1, u2, v) that the modes do not carry.
    load : (n_points,) float, N, optional
        Normal load that limits friction under the laws of constant load; ``n0`` by default.
    index : (n_points,) int, optional
        Contact point of the structure that each is made of; where two are made of one, the second one's normal force is
        taken off that of the first.
    own : OwnLaws, optional
    memory : (n_points, width) float, optional
        What points with functions of their own remember from the static state.
    """

    kt: NDArray
    kn: NDArray
    mu: NDArray
    n0: NDArray
    slider: NDArray
    law: NDArray
    shift: NDArray
    load: NDArray | None = None
    index: NDArray | None = None
    own: OwnLaws | None = None
    memory: NDArray | None = None

    def taken(self, index: NDArray) -> PointArrays:
        """The points numbered ``index`` (n,), in this order and as often as they are named, without ``load``."""
        names = ("kt", "kn", "mu", "n0", "slider", "law", "shift")
        arrays: dict[str, Any] = {name: getattr(self, name)[index] for name in names}
        return replace(self, **arrays, load=None, index=index)
