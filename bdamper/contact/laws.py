r"""Contact laws, and the parameters of the contact points.

Relative motion :math:`x = (u_1, u_2, v)`, with the closing :math:`v`, gives the contact forces
:math:`F = (T_1, T_2, N)`.

The laws ``LAW_*`` are part of the C core: Coulomb friction with variable normal load and separation
(``csrc/contact/element.c``, exact integration over a cycle in ``contact/event_driven.c``, samples
in time in ``contact/aft.c``) and its form with coupled tangential directions
(``contact/coupled_friction.c``).  :class:`PointArrays` holds their parameters.

A compiled law (:class:`ContactLaw`) maps one instant to the next.  Its state :math:`s` depends on
the motion, and on motion and state one instant earlier:

.. math:: s_k = g(x_k, x_{k-1}, s_{k-1}), \qquad F_k = f(x_k, s_k).

Its signature is ``bd_user_law`` of ``csrc/contact/user_law.h``.  The C core calls it in harmonic
balance (``csrc/contact/user_law_aft.c``), in the static analysis and in time integration.
``law_checks.check_law`` tests it before an analysis uses it.

**A new contact law** is such a function, written by the user or added to
``csrc/contact/shipped_laws.c`` with an entry in :data:`SHIPPED` and a class method of
``ContactLaw``.  A law with exact integration needs a new number ``LAW_*`` and a branch in the C
core.

The Iwan model of Segalman (J. Appl. Mech. 72, 2005, 752-760) has a strength :math:`F_S`, a
stiffness :math:`K_T`, an exponent :math:`\chi` and a ratio :math:`\beta`.  It is a distribution of
Jenkins elements over the slip displacement :math:`\phi` with the density :math:`R \phi^\chi` below
:math:`\phi_m` and the additional stiffness :math:`S` there:

.. math::
    \phi_m = \frac{F_S (1 + \beta)}{K_T \left(\beta + \frac{\chi + 1}{\chi + 2}\right)}, \qquad
    R \phi_m^{\chi + 1} = \frac{K_T (\chi + 1)}{1 + \beta}, \qquad S = \frac{K_T \beta}{1 + \beta}.

Below macroslip the dissipation per cycle of amplitude :math:`u` is
:math:`4 R u^{\chi + 3}/((\chi + 3)(\chi + 2))`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Annotated, Any, Self

import numpy as np
from numpy.typing import NDArray
from scipy import LowLevelCallable

from bdamper import _core
from bdamper.contact.law_checks import check_law
from bdamper.model.structure import ContactStiffness
from bdamper.util import validation
from bdamper.util.errors import SettingError, one_line, warn
from bdamper.util.formatting import short_repr

# ---- Sliders of a joint ----


def power_law_sliders(
    exponent: float, decades: float, n: int | None = None
) -> tuple[NDArray, NDArray]:
    r"""Return parallel sliders whose energy loss per cycle is a power of the amplitude.

    The share of the stiffness that slips below :math:`\phi`, relative to macroslip, is
    :math:`\phi^a`.  Then the energy loss per cycle of amplitude u is
    :math:`4 a u^{a+2}/((a+1)(a+2))`.  Two sliders represent each interval of slip displacements.
    As in Gaussian quadrature, their first four moments equal those of the distribution in the
    interval.  Force and loss depend only on moments up to the second, so both are exact at all
    ends of intervals.

    Parameters
    ----------
    exponent : float
        Exponent a of the distribution.
    decades : float
        Number of decades of amplitude below macroslip for which the loss is accurate to 2 %.
    n : int, optional
        Number of intervals.

    Returns
    -------
    share, slip : (2 n,) float
        Stiffness, with the sum 1, and slip displacements relative to the displacement at
        macroslip.
    """
    a = exponent
    if n is None:
        # measured for a from 0.02 to 10: 1.0 to 1.9 % off the power law between the ends
        n = int(np.ceil(np.ceil(3.75 + 3.0 * a) * decades)) + 1
    ends = np.concatenate([[0.0], np.geomspace(10.0**-decades, 1.0, n)])
    # integrals of a phi^(a - 1) phi^power over each interval, (4, n)
    power = np.arange(4)[:, None]
    moment = a / (a + power) * np.diff(ends ** (a + power))
    stiffness = moment[0]

    # moments of the distribution in each interval
    mean = moment[1] / stiffness
    square = moment[2] / stiffness
    cube = moment[3] / stiffness
    variance = square - mean**2
    # third central moment over the variance
    skewed = (cube - 3.0 * mean * square + 2.0 * mean**3) / variance
    half = np.hypot(0.5 * skewed, np.sqrt(variance))
    # two points of Gaussian quadrature
    low = mean + 0.5 * skewed - half
    high = mean + 0.5 * skewed + half
    of_low = (high - mean) / (high - low)
    # (n, 2), so that both sliders of an interval are adjacent
    share = np.stack([stiffness * of_low, stiffness * (1.0 - of_low)], axis=1)
    slip = np.stack([low, high], axis=1)
    return share.ravel(), slip.ravel()


# ---- Contact laws of the C core ----

(
    LAW_SEPARABLE,
    LAW_NORMAL,
    LAW_CONSTANT,
    LAW_COUPLED,
    LAW_COUPLED_CONSTANT,
    LAW_BONDED,
    LAW_CUBIC,
    LAW_USER,
) = range(8)
MAX_SAMPLES = 1 << 20
"""Largest number of samples per period in the C core."""


@dataclass(frozen=True)
class AFT(validation.Checked):
    """Evaluation of contact forces from samples in time (alternating frequency/time method).

    Parameters
    ----------
    n_time : int
        Samples per period, at least ``4 harmonics + 4``.  With 128 samples, peaks of the examples
        in docs/accuracy.md differ by up to 4e-3 from peaks with exact events.
    interpolate : bool
        Interpolate the instant of closing between samples.  Otherwise the derivative of the forces
        does not converge.
    """

    n_time: Annotated[int, partial(validation.integer, least=8, most=MAX_SAMPLES)] = 128
    interpolate: bool = True


def check_evaluation(contact_forces: str | AFT, harmonics: int) -> None:
    """Raise SettingError unless ``contact_forces`` is a method that resolves all harmonics.

    These methods are "event_driven" and AFT with enough samples.
    """
    if isinstance(contact_forces, AFT):
        least = 4 * harmonics + 4
        enough = contact_forces.n_time >= least
        expected = f"AFT with at least {least} samples for {harmonics} harmonics"
        validation.check_value(enough, "contact_forces", expected, contact_forces.n_time)
    elif not isinstance(contact_forces, str) or contact_forces != "event_driven":
        raise validation.invalid("contact_forces", '"event_driven" or AFT(n_time)', contact_forces)


@short_repr
@dataclass(frozen=True)
class PointArrays:
    """Parameters of all contact points, stacked in the order of the interfaces.

    Parameters
    ----------
    kt : (n_points, 2) float, N/m
        Tangential contact stiffness.
    kn : (n_points,) float, N/m
        Normal contact stiffness.
    mu, n0 : (n_points,) float
        Friction coefficient; normal load (N) at zero closing, negative for a gap.
    slider : (n_points, 2) float, m
        Initial position of the sliders.  For a point that never slips, plus or minus infinity
        selects an end of the interval of admissible positions.
    law : (n_points,) int
        LAW_SEPARABLE, LAW_NORMAL (no friction), LAW_CONSTANT (friction limited by ``load``,
        two-sided normal spring), LAW_COUPLED and LAW_COUPLED_CONSTANT (friction force in a disk),
        LAW_BONDED (linear springs).  LAW_CUBIC is a spring ``kt u^3`` along both tangential
        directions, kt in N/m3, without any other force.  LAW_USER is a compiled law in ``own``; kt
        and kn are its springs in stick.
    shift : (n_points, 3) float, m
        Constant part of (u1, u2, v) that the modes do not represent.
    load : (n_points,) float, N, optional
        Normal load that limits friction under the laws of constant load; ``n0`` by default.
    index : (n_points,) int, optional
        Contact point of the structure for each element, if they differ.  A contact that cannot
        separate consists of two elements at one point: the second has the opposite normal direction
        and acts in tension.
    own : OwnLaws, optional
        Compiled laws.
    memory : (n_points, width) float, optional
        Motion and state of points with compiled laws in the static state.
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
        """Return the points with the indices ``index`` (n,), in this order.

        An index may occur more than once.  The result has no field ``load``.
        """
        return replace(
            self,
            kt=self.kt[index],
            kn=self.kn[index],
            mu=self.mu[index],
            n0=self.n0[index],
            slider=self.slider[index],
            law=self.law[index],
            shift=self.shift[index],
            load=None,
            index=index,
        )


# ---- Compiled contact laws ----
SIGNATURE = re.compile(r"void ?\(([^,()]*\*,){10}[^,()]*\*\)")
"""Eleven pointers without return value, in the notation of SciPy and of C."""
Numbers = Sequence[float] | NDArray
SHIPPED = {"jenkins": _core.jenkins, "iwan": _core.jenkins, "bouc_wen": _core.bouc_wen}
"""Functions of the C core by the name of the law."""


@dataclass(frozen=True, eq=False)
class ContactLaw:
    """Contact law as a compiled function, for ``friction_law`` of a study.

    The function has the signature ``bd_user_law`` of ``csrc/contact/user_law.h``: eleven pointers,
    no return value.  It must not call Python.  Several threads call it at the same time, so its
    results must depend only on its arguments.

    Parameters
    ----------
    function : PyCapsule, scipy.LowLevelCallable or numba cfunc
        A capsule has the C signature as its name.  The user data of a LowLevelCallable is the last
        argument.
    n_state : int
        Number of state variables, which are zero before any load.
    parameters : (n,) or (n_points, n) float
        Argument ``p`` of the function: the same for all points of an interface, or one row for each
        point.
    stick : (3,) or (n_points, 3) float, N/m
        Springs kt1, kt2, kn of the law in stick.  They replace the contact stiffness in stuck
        curves and frequencies and convert a ``gap`` to a force, so kn must be positive at points
        with a gap.
    name : str
        Name in output and files, by default the name of the function.  Names of built-in laws are
        reserved.
    resolution : float, m
        Smallest amplitude of relative motion that the law resolves.  bdamper warns about smaller
        motions.

    Raises
    ------
    SettingError
        If the function has the wrong type or signature, or if numbers are invalid.
    """

    function: Any = field(repr=False)
    n_state: int
    parameters: NDArray
    stick: NDArray
    name: str = ""
    resolution: float = 0.0
    pointer: Any = field(init=False, repr=False)
    """Function as a LowLevelCallable for the C core."""

    def __post_init__(self) -> None:
        # the dataclass is frozen: checked values replace those of the user by object.__setattr__
        pointer, function_name = _pointer(self.function)
        object.__setattr__(self, "pointer", pointer)
        object.__setattr__(self, "name", self.name or function_name)
        object.__setattr__(self, "n_state", validation.integer("n_state", self.n_state, most=1000))
        validation.number("resolution", self.resolution, least=0.0, unit="m")
        for field_name in ("parameters", "stick"):
            value = getattr(self, field_name)
            numbers = _numbers(value)
            expected = "finite numbers, (n,) or (n_points, n)"
            validation.check_value(numbers is not None, field_name, expected, value)
            object.__setattr__(self, field_name, numbers)

        springs = self.stick.shape[-1] == 3 and (self.stick >= 0.0).all() and self.stick.any()
        expected = "stiffness kt1, kt2, kn in N/m, none negative, one positive"
        validation.check_value(springs, "stick", expected, self.stick)

        unreserved = self.name not in SHIPPED or pointer.function is SHIPPED[self.name]
        reserved = f"'{self.name}' is the name of a built-in law ({', '.join(SHIPPED)})"
        validation.check_sentence(unreserved, "name", reserved)

        # the core knows which parameters its own laws accept
        no_memory = np.zeros(3 + self.n_state)
        for row in np.atleast_2d(self.parameters):
            try:
                _core.check_laws(((pointer, row, no_memory),))
            except (TypeError, ValueError) as error:
                of_row = one_line(row.tolist())
                raise SettingError(f"law '{self.name}': {error}: {of_row}") from error

    def __str__(self) -> str:
        return f"{self.name} ({self.parameters.shape[-1]} parameters, {self.n_state} states)"

    @classmethod
    @validation.check_arguments
    def jenkins(
        cls,
        stiffness: Numbers,
        limit: Numbers | float,
        mu: Numbers | float = 0.0,
        *,
        kn: float = 0.0,
    ) -> Self:
        """Return a law with parallel Jenkins elements in each tangential direction.

        An element is a spring and a slider in series.

        Parameters
        ----------
        stiffness : (n,) float, N/m
        limit : float or (n,) float, N
            Slip force of each slider without normal force.
        mu : float or (n,) float
            Increase of the slip force per newton of normal force.
        kn : float, N/m
            Normal spring in compression only.  Without it the sliders do not depend on separation.
        """
        k = validation.numbers("stiffness", stiffness, above=0.0)
        n = len(k)
        # one value applies to all elements
        limits = [limit] * n if np.ndim(limit) == 0 else limit
        slip_force = validation.numbers("limit", limits, n, least=0.0)
        increases = [mu] * n if np.ndim(mu) == 0 else mu
        increase = validation.numbers("mu", increases, n, least=0.0)
        kn = validation.number("kn", kn, least=0.0, unit="N/m")
        elements = np.column_stack([k, slip_force, increase])
        return cls(
            function=_core.jenkins,
            n_state=2 * n,
            parameters=np.concatenate([[n, kn], elements.ravel()]),
            stick=np.array([k.sum(), k.sum(), kn]),
            name="jenkins",
        )

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
        """Return Segalman's four-parameter Iwan model.

        It consists of Jenkins elements in each tangential direction, two for each interval of
        slip displacements and one that slips last.  Strength, total stiffness and the stiffness of
        each interval are exact.  The dissipation is within 2 % of the power law for amplitudes
        between 10^(-decades) times the macroslip displacement (the ``resolution`` of the law) and
        the macroslip displacement.  In the next lower decade, the error reaches a factor of 5.

        Parameters
        ----------
        strength : float, N
            Force at macroslip.
        stiffness : float, N/m
            Tangential stiffness of the joint in stick.
        chi : float
            Exponent of the density of slip displacements, -1 < chi <= 0.
        beta : float
            Stiffness of the elements that slip last, relative to all others.
        kn : float, N/m
            Normal spring, see :meth:`jenkins`.
        n : int, optional
            Number of intervals of slip displacements; by default the number required for an
            accuracy of 2 %, which is 12 to 22 for three decades.  The first interval begins at
            zero; the ends of the others form a geometric sequence.
        decades : float
            Number of decades of amplitude below macroslip over which the law holds.
        """
        strength = validation.number("strength", strength, above=0.0, unit="N")
        stiffness = validation.number("stiffness", stiffness, above=0.0, unit="N/m")
        chi = validation.number("chi", chi, above=-1.0, most=0.0)
        beta = validation.number("beta", beta, least=0.0)
        decades = validation.number("decades", decades, least=1.0, most=12.0)
        if n is not None:
            n = validation.integer("n", n, least=2, most=400)

        # stiffness of the elements, and their slip displacements in units of macroslip
        share, slip = power_law_sliders(chi + 1.0, decades, n)
        # the slip displacements of the power law have the mean (chi + 1)/(chi + 2), in units of
        # macroslip: the displacement (m) at which all elements slip, so that their forces add up to
        # the strength
        macroslip = strength * (1.0 + beta) / (stiffness * (beta + (chi + 1.0) / (chi + 2.0)))

        # the last element has the fraction beta and slips at macroslip
        k = np.append(share, beta) * stiffness / (1.0 + beta)
        limit = k * np.append(slip, 1.0) * macroslip
        has_stiffness = k > 0.0
        law = cls.jenkins(k[has_stiffness], limit[has_stiffness], kn=kn)
        return replace(law, name="iwan", resolution=10.0**-decades * macroslip)

    @classmethod
    @validation.check_arguments
    def bouc_wen(
        cls,
        stiffness: float,
        alpha: float,
        beta: float,
        gamma: float,
        n: float = 1.0,
        *,
        kn: float = 0.0,
    ) -> Self:
        """Return a law with Bouc-Wen hysteresis in each tangential direction.

        The force is T = alpha k u + (1 - alpha) k z.  The state z follows dz = du - beta abs(du)
        abs(z)^(n - 1) z - gamma du abs(z)^n.

        Parameters
        ----------
        stiffness : float, N/m
            Stiffness k in stick.
        alpha : float
            Fraction of the stiffness in macroslip, 0 to 1.
        beta, gamma : float, 1/m^n
            Parameters with -beta <= gamma <= beta; the law would generate energy otherwise.
        n : float
            Exponent, at least 1.
        kn : float, N/m
            Normal spring in compression only, without effect on T.
        """
        k = validation.number("stiffness", stiffness, above=0.0, unit="N/m")
        alpha = validation.number("alpha", alpha, least=0.0, most=1.0)
        beta = validation.number("beta", beta, above=0.0)
        gamma = validation.number("gamma", gamma, least=-beta, most=beta)
        n = validation.number("n", n, least=1.0)
        kn = validation.number("kn", kn, least=0.0, unit="N/m")
        return cls(
            function=_core.bouc_wen,
            n_state=2,
            parameters=np.array([kn, k, alpha, beta, gamma, n]),
            stick=np.array([k, k, kn]),
            name="bouc_wen",
        )

    def record(self) -> dict[str, Any]:
        """Return the data of the law for files and results, without the function."""
        return {
            "contact_law": self.name,
            "n_state": self.n_state,
            "parameters": self.parameters.tolist(),
            "stick": self.stick.tolist(),
            "resolution": self.resolution,
        }

    @classmethod
    def of_record(cls, record: Mapping[str, Any]) -> Self:
        """Restore a built-in law from its record.

        Raises
        ------
        SettingError
            If the record belongs to a user-defined law.
        """
        name = record.get("contact_law")
        if not isinstance(name, str) or name not in SHIPPED:
            found = one_line(
                f"{name!r}, whose function is not in the file; create the study again with this law"
            )
            built_in = ", ".join(SHIPPED)
            raise SettingError(f"friction_law: expected a built-in law ({built_in}), found {found}")
        # incomplete records of a file reach the checks of the constructor
        data: Any = record
        return cls(
            function=SHIPPED[name],
            n_state=data.get("n_state"),
            parameters=data.get("parameters"),
            stick=data.get("stick"),
            name=name,
            resolution=data.get("resolution", 0.0),
        )

    def __reduce__(self) -> Any:
        """Pickle by record, because other processes have built-in functions only.

        Addresses differ between processes.
        """
        return ContactLaw.of_record, (self.record(),)

    @property
    def shipped(self) -> bool:
        """Whether the function is part of the C core."""
        return any(self.pointer.function is function for function in SHIPPED.values())

    def springs(self, n: int, interface: str) -> ContactStiffness:
        """Return the contact stiffness in stick at the n points of an interface."""
        stiffness = self._per_point("stick", self.stick, n, interface)
        return ContactStiffness(stiffness.copy(), "user")

    def of_points(self, n: int, interface: str) -> list[LawPoint]:
        """Return the law at each of the n points of an interface."""
        rows = self._per_point("parameters", self.parameters, n, interface)
        return [LawPoint(self, parameters, interface) for parameters in rows]

    def _per_point(self, name: str, rows: NDArray, n: int, interface: str) -> NDArray:
        """Return one row for each of n points of an interface."""
        fits = rows.ndim == 1 or len(rows) == n
        expected = f"{n} rows for '{interface}'"
        validation.check(fits, f"{name} of law '{self.name}'", expected, f"{len(rows)}")
        return np.broadcast_to(rows, (n, rows.shape[-1]))


@dataclass(frozen=True, eq=False)
class LawPoint:
    """Compiled law of one contact point, with its parameters (n,) and the name of its interface."""

    law: ContactLaw
    parameters: NDArray
    interface: str

    @property
    def where(self) -> str:
        """Law and interface for messages."""
        return _named(self.law, self.interface)

    @property
    def width(self) -> int:
        """Number of stored values: the latest motion and the state variables of the law."""
        return 3 + self.law.n_state


def _named(law: ContactLaw, interface: str) -> str:
    return f"law '{law.name}' of interface '{interface}'"


def _numbers(value: Any) -> NDArray | None:
    """Convert to a finite array of one or two dimensions; return None for anything else."""
    try:
        array = np.array(value)
    except ValueError:  # rows of different lengths
        return None
    numeric = array.ndim in (1, 2) and array.dtype.kind in "iuf"
    if numeric and np.isfinite(array).all():
        return array.astype(float, order="C")
    return None


def _pointer(function: Any) -> tuple[LowLevelCallable, str]:
    """Return the function as a LowLevelCallable and its name; check type and signature."""
    name = getattr(function, "__name__", "own law")
    try:
        if hasattr(function, "native_name") and hasattr(function, "ctypes"):  # a cfunc of numba
            function = function.ctypes
        if not isinstance(function, LowLevelCallable):
            function = LowLevelCallable(function)
        signature = str(function.signature)
    except (TypeError, ValueError) as error:
        expected = (
            "a PyCapsule, scipy.LowLevelCallable or numba cfunc, "
            "since the core cannot call Python functions"
        )
        raise validation.invalid("function", expected, function) from error
    if SIGNATURE.fullmatch(signature.replace(", ", ",")) is None:
        raise SettingError(
            "function: expected the signature void of eleven pointers (bd_user_law), "
            f"found '{signature}'"
        )
    return function, getattr(function.function, "__name__", name)


@dataclass(frozen=True, eq=False)
class OwnLaws:
    """Compiled laws at the contact points of a structure.

    Parameters
    ----------
    points : sequence of LawPoint or None
        One entry per point; None for laws of the C core.
    rest : (n_points,) float, m
        Closing at zero motion: interference, or minus the gap.
    """

    points: Sequence[LawPoint | None]
    rest: NDArray

    @classmethod
    def of(
        cls, laws: Sequence[tuple[slice, str, ContactLaw]], kn: NDArray, gap: NDArray, length: float
    ) -> Self | None:
        """Combine the laws of several interfaces; return None if there is no compiled law.

        Parameters
        ----------
        laws : sequence of (rows, interface, ContactLaw)
            Rows of the interface among all points.
        kn, gap : (n_points,) float, N/m and m
        length : float, m
            Typical relative motion, for the check of user-defined functions
            (``law_checks.check_law``).
        """
        points: list[LawPoint | None] = [None] * len(kn)
        for rows, interface, law in laws:
            points[rows] = law.of_points(rows.stop - rows.start, interface)
            if law.shipped:
                continue
            for parameters in np.unique(np.atleast_2d(law.parameters), axis=0):
                where = f"friction_law: {_named(law, interface)}"
                check_law(where, law.pointer, parameters, law.n_state, length)
        if not any(points):
            return None
        # without a normal spring there is no contact to close
        rest = np.where(kn > 0.0, -gap, 0.0)
        return cls(points, rest)

    @property
    def _own_points(self) -> list[LawPoint]:
        """The points with a compiled law."""
        return [point for point in self.points if point is not None]

    @property
    def compiled(self) -> NDArray:
        """Whether each point has a compiled law, (n_points,) bool."""
        return np.array([point is not None for point in self.points])

    @property
    def names(self) -> str:
        """Laws and interfaces for messages."""
        return ", ".join(sorted({point.where for point in self._own_points}))

    def warn_below(self, motion: NDArray) -> None:
        """Warn about interfaces that move less than the resolution of their law.

        Parameters
        ----------
        motion : (n_points, 3, n_coef) complex, m
        """
        # bound of the tangential motion of each point: sum of the coefficients without the mean
        moved = np.abs(motion[:, :2, 1:]).sum(axis=2).max(axis=1)
        # by law and interface
        largest: dict[str, float] = {}
        resolution: dict[str, float] = {}
        for point, amplitude in zip(self.points, moved.tolist()):
            if point is not None:
                largest[point.where] = max(amplitude, largest.get(point.where, 0.0))
                resolution[point.where] = point.law.resolution
        for where, amplitude in largest.items():
            if amplitude < resolution[where]:
                warn(
                    f"{where} moves by at most {amplitude:.3g} m at the highest point, "
                    f"less than the {resolution[where]:.3g} m that the law resolves: "
                    "its dissipation is wrong there; increase its decades"
                )

    @property
    def width(self) -> int:
        """Largest number of stored values of a point: its latest motion and its state variables."""
        return max(point.width for point in self._own_points)

    def core(self, memory: NDArray) -> tuple[tuple[Any, ...] | None, ...]:
        """Return functions, parameters and memory (n_points, width) as arguments of the C core."""
        rows = np.reshape(memory, (len(self.points), self.width)).astype(float)
        arguments: list[tuple[Any, ...] | None] = []
        for point, row in zip(self.points, rows):
            if point is None:
                arguments.append(None)
                continue
            # the core keeps a reference to the law, so that its function stays in memory
            own_memory = row[: point.width].copy()
            arguments.append((point.law.pointer, point.parameters.copy(), own_memory, point.law))
        return tuple(arguments)

    def step(self, x: NDArray, memory: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Evaluate one step of the laws to the motions x (n_points, 3), m.

        The force is zero and the memory unchanged at points without a compiled law.

        Returns
        -------
        force, derivative : (n_points, 3), (n_points, 3, 3) float, N and N/m
        memory : (n_points, width) float

        Raises
        ------
        SettingError
            If a force, state or derivative is not finite.
        """
        motion = np.array(x, float)
        motion[:, 2] += self.rest
        before = np.array(memory, float, order="C")
        after = before.copy()
        force = np.zeros((len(motion), 3))
        derivative = np.zeros((len(motion), 3, 3))
        _core.step_laws(self.core(before), motion, before, after, force, derivative)

        finite = np.isfinite(force).all(axis=1)
        finite &= np.isfinite(after).all(axis=1)
        finite &= np.isfinite(derivative).all(axis=(1, 2))
        if not finite.all():
            first = int(np.argmin(finite))
            point = self.points[first]
            where = f"friction_law: {point.where}" if point else ""
            raise SettingError(
                f"{where}: expected finite forces and states, "
                f"found NaN or infinite ones for the displacement {motion[first].tolist()} m"
            )
        return force, derivative, after


def refuse(own: OwnLaws | None, what: str) -> None:
    """Raise SettingError if there are compiled laws.

    The analysis ``what`` needs the events of the laws of the core.
    """
    if own is not None:
        names = sorted({point.law.name for point in own.points if point is not None})
        raise SettingError(
            f"friction_law: {what} needs the slip and contact events of the laws in the C core, "
            f"found {', '.join(names)}"
        )
