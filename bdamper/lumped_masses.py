"""Lumped masses: studies from the matrices of the equation of motion.

    M x'' + C x' + K x + contact forces = Re(f exp(i omega t)) + P s + r_n^T N_0

An acceleration ``a`` of the ground acts as the force ``f = -M r a`` on the relative motion ``x``,
with the motion ``r`` of all degrees of freedom under a unit motion of the ground.

The modal coordinates are all modes of M and K, so the modal model is exact.  Modes of frequency 0
are free masses.  A contact is a point with the relative motion ``u = r_t x`` tangentially and the
closing ``v = r_n x`` normally.  Its forces act on the degrees of freedom by the same rows,
``-(r_t^T T + r_n^T N)``.  A static force balances its preload ``N_0``.

If damping couples these modes, the coordinates are modes of M and C: ``x = V q`` with
``V^T M V = 1`` and ``V^T C V`` diagonal.  The stiffness is then
``V^T K V = k_0 + sum_i k_i w_i w_i^T``: the smallest eigenvalue ``k_0`` in every coordinate, and
springs ``k_i`` on the motions ``w_i^T q``, as interfaces of kind "spring".
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from numbers import Integral
from typing import Annotated, Any, NamedTuple

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from bdamper.contact.laws import power_law_sliders
from bdamper.harmonic_balance.settings import Settings
from bdamper.model.loads import BASE, Excitation, Response
from bdamper.model.structure import Body, BodyLoad, Interface, Location, ModalBasis, Model
from bdamper.study import Study
from bdamper.util import validation
from bdamper.util.errors import SettingError

Stiffness = Annotated[float, validation.Limits(least=0.0, unit="N/m")]
Row = int | str | tuple[int | str, int | str] | Mapping[int | str, float]
"""Motion: a degree of freedom by number (from 0) or location name, the difference of two, or a sum
with factors.
"""
ROUNDING = 1e-9
"""Relative size of asymmetry, of coupling by damping and of negative stiffness that counts as
rounding.
"""
FIXED_SETTINGS = (
    "model",
    "excitation",
    "response",
    "engine_order",
    "friction_coefficient",
    "contact_stiffness",
    "blade_modes",
    "gap",
)
BODY = "masses"
GROUND = "ground"


@validation.check_arguments
@dataclass(frozen=True)
class Contact:
    """Contact between degrees of freedom of a lumped model, or between one of them and the ground.

    Parameters
    ----------
    tangential, normal : int, str, tuple of two or mapping, optional
        Sliding ``u`` and closing ``v`` (positive if the surfaces approach).  ``0`` is the motion of
        degree of freedom 0 relative to the ground, ``(1, 0)`` the motion of 1 relative to 0,
        ``{0: 0.5, 1: 0.866}`` a weighted sum.  Location names are accepted instead of numbers.
        Without ``normal`` the normal load is constant; without ``tangential`` there is no friction.
    kt, kn : float, N/m
        Tangential and normal contact stiffness.
    mu : float
        Friction coefficient.
    preload : float, N
        Normal load at rest, ``N = max(preload + kn v, 0)``.  A static force on the degrees of
        freedom balances it, so that the displacement at rest is zero before the loads of the model
        act.
    gap : float, m
        Distance at zero displacement, instead of a preload.
    tangential2 : int, str, tuple of two or mapping, optional
        Second tangential direction, with the same ``kt``.

    Raises
    ------
    SettingError
        If parameters are missing or contradict each other.
    """

    tangential: Row | None = None
    normal: Row | None = None
    kt: Stiffness = 0.0
    kn: Stiffness = 0.0
    mu: validation.NotNegative = 0.0
    preload: validation.Force = 0.0
    gap: validation.Length = 0.0
    tangential2: Row | None = None

    def __post_init__(self) -> None:
        validation.check_fields(self)
        slides = self.tangential is not None
        closes = self.normal is not None
        second_without_first = self.tangential2 is not None and not slides
        if not (slides or closes) or second_without_first:
            raise SettingError("contact: expected tangential, normal or both, found neither")
        if slides != (self.kt > 0.0) or slides != (self.mu > 0.0):
            found = f"tangential={self.tangential!r}, kt={self.kt:g}, mu={self.mu:g}"
            raise SettingError(
                f"contact: expected tangential, kt > 0 and mu > 0 together, found {found}"
            )
        found = f"normal={self.normal!r}, kn={self.kn:g}"
        has_both_or_none = closes == (self.kn > 0.0)
        validation.check(has_both_or_none, "contact", "normal and kn > 0 together", found)
        has_constant_load = self.preload > 0.0 and self.gap == 0.0
        if not closes and not has_constant_load:
            raise SettingError(
                "contact: expected a preload > 0 and no gap for a constant normal load "
                f"(without normal), found preload={self.preload:g}, gap={self.gap:g}"
            )
        if self.preload > 0.0 and self.gap > 0.0:
            raise SettingError(
                f"contact: expected a preload or a gap, found {self.preload:g} N and {self.gap:g} m"
            )


@partial(validation.check_arguments, also=[f.name for f in fields(Settings)])
def lumped(
    mass: Any,
    damping: Any,
    stiffness: Any,
    *,
    contacts: Sequence[Contact] = (),
    cubic: Mapping[Any, float] | None = None,
    forces: Mapping[int | str, complex] | None = None,
    base: float | complex | Mapping[int | str, complex] | None = None,
    load_per_preload: Mapping[int | str, float] | None = None,
    locations: Mapping[str, int] | None = None,
    response: int | str | Mapping[int | str, float] | None = None,
    absolute: bool = False,
    **settings: Any,
) -> Study:
    """Create a study of lumped masses from the matrices of their equation of motion.

    Parameters
    ----------
    mass, damping, stiffness : number, (n,) or (n, n) float, kg, N s/m, N/m
        Diagonals or symmetric matrices for n degrees of freedom.  The mass is positive definite,
        with eigenvalues above 1e-9 of its largest entry, the stiffness positive semi-definite.  Any
        damping matrix is represented exactly.  If it couples the modes of mass and stiffness, the
        stiffness must be positive definite.
    contacts : sequence of Contact
        Their interfaces have the names "contact 1", "contact 2" ...  Without contacts and cubic
        springs the study is linear.
    cubic : mapping of motion to N/m3, optional
        Cubic springs ``k u^3`` on motions as in :class:`Contact`: ``{0: 0.5, (1, 0): -2.0}``.
    forces : mapping of degree of freedom to float or complex, N
        Harmonic forces ``Re(f exp(i omega t))``.  ``excitation.amplitude`` is the largest of them
        and scales all.
    base : float, complex or mapping of degree of freedom to these, m/s2, optional
        Harmonic acceleration of the ground, instead of forces.  A number applies to all degrees of
        freedom.  A mapping gives the acceleration of each degree of freedom that follows the ground
        rigidly; it is 0 for degrees of freedom that are not listed.  The response is then the
        motion relative to the ground.
    load_per_preload : mapping of degree of freedom to float, optional
        Static forces per newton of the preload in an analysis: with ``{1: 1.0}``,
        ``study.frequency_response(200.0, ...)`` applies 200 N to degree of freedom 1.  Without it
        the preload must be 0.
    locations : mapping of name to degree of freedom, optional
        By default "x0", "x1" ...
    response : degree of freedom or mapping, optional
        Degree of freedom of the response; by default the one with the largest force or
        acceleration.  A mapping is a sum with factors, ``{0: 1.2, 1: -0.7}``: a point of a model in
        modal coordinates.
    absolute : bool
        With ``base``: whether the response is the absolute motion instead of the motion relative to
        the ground.
    **settings
        Other settings of the study: ``harmonics``, ``contact_forces`` ...

    Returns
    -------
    Study

    Raises
    ------
    SettingError, ModelError
        If an argument is invalid.

    Examples
    --------
    A mass with a Jenkins element, its peak at 0.1764 Hz (1.1086 rad/s):

    >>> jenkins = Contact(0, kt=1, mu=1, preload=1)
    >>> study = lumped(1, 0.02, 1, contacts=[jenkins], forces={0: 1.0}, harmonics=7)
    >>> print(f"{study.peak(0.0, (0.1, 0.3)).amplitude:.5f} m")
    3.53660 m
    """
    fixed = [name for name in FIXED_SETTINGS if name in settings]
    if fixed:
        raise SettingError(
            f"lumped: expected settings other than {fixed}, which follow from its other arguments"
        )
    modes = _Modes(mass, damping, stiffness, locations)
    for contact in validation.instance("contacts", contacts, Sequence, "a sequence of Contact"):
        validation.instance("contacts", contact, Contact)
    if cubic is None:
        cubic = {}
    validation.instance("cubic", cubic, Mapping, "a mapping of motions to N/m3")
    faces = _faces(contacts, cubic, modes)

    is_one_of_them = (forces is None) != (base is None)
    expected = "forces or an acceleration of the base"
    found = "neither" if base is None else "forces and base"
    validation.check(is_one_of_them, "excitation", expected, found)
    validation.check(base is not None or not absolute, "absolute", "base= for True", "forces")
    if base is None:
        amplitudes = _forces(modes, forces)
        excitation, excitation_rows = _excitation(modes, amplitudes)
    else:
        amplitudes = _accelerations(modes, base)
        excitation, excitation_rows = _base_excitation(modes, amplitudes)
    location, response_rows = _response(modes, response, amplitudes)

    combined_rows = excitation_rows | response_rows
    model = _model(modes, faces, combined_rows, load_per_preload, base is not None)
    stiffness_of_face = {name: np.array([face.stiffness]) for name, face in faces.items()}
    return Study(
        model,
        excitation,
        friction_coefficient=_friction_coefficient(contacts, faces),
        contact_stiffness=stiffness_of_face or None,
        response=Response(location, absolute=absolute),
        **settings,
    )


def _friction_coefficient(
    contacts: Sequence[Contact], faces: Mapping[str, _Face]
) -> float | dict[str, float]:
    """Return the friction coefficient of all contacts, or of each if they differ."""
    coefficients = [contact.mu for contact in contacts]
    if not coefficients:
        return 0.0
    if len(set(coefficients)) == 1:
        return coefficients[0]
    # the contacts are the first faces
    return dict(zip(faces, coefficients))


@validation.check_arguments
def joint(
    frequency: float,
    damping_ratio: float,
    stiffness: float,
    friction: float,
    exponent: float = 1.0,
    mass: float = 1.0,
    sliders: int | None = None,
    *,
    decades: float = 3.0,
    **settings: Any,
) -> Study:
    """Return a study of one mode with a joint that consists of parallel sliders.

    Frequency and damping refer to the stuck joint.  At the displacement ``friction / stiffness *
    x**exponent`` the fraction x of the joint's stiffness slips.  The energy loss per cycle is then
    a power of the amplitude of the joint, with the exponent ``2 + 1 / exponent`` (Segalman, J.
    Appl. Mech. 72, 2005, 752-760).  The sliders agree with it within 2 % for amplitudes between
    ``10**-decades`` times the macroslip displacement ``friction / stiffness`` and that
    displacement; bdamper warns about smaller motions.

    Parameters
    ----------
    frequency : float, Hz
        Natural frequency of the mode with stuck joint.
    damping_ratio : float
        Damping ratio of that mode without friction.
    stiffness : float, N/m
        Stiffness of the joint, a part of the modal stiffness.
    friction : float, N
        Sum of the friction limits for exponent 0; the limit in macroslip is
        ``friction / (1 + exponent)``.
    exponent : float
        Exponent of the distribution of the friction limits, at least 0.1. The limits are nearly
        equal for 0.1, and more of them are small for larger exponents; 0 is a single slider.
    mass : float, kg
        Modal mass for a unit displacement at the point of the force, where the response is
        measured.
    sliders : int, optional
        Even number of sliders. By default, the number required for an accuracy of 2 %: 28 to 44 for
        three decades and exponents of 1 and above.
    decades : float
        Number of decades of joint motion below macroslip for which friction is represented.
    **settings
        Other settings of the study; ``harmonics`` is 1 by default.

    Returns
    -------
    Study

    Raises
    ------
    SettingError
        If an argument is out of range.
    """
    modal_stiffness = mass * (2.0 * np.pi * frequency) ** 2
    expected = f"a value below the modal stiffness, {modal_stiffness:.6g} N/m"
    validation.check(stiffness < modal_stiffness, "stiffness", expected, f"{stiffness:.6g} N/m")
    decades = validation.number("decades", decades, least=1.0, most=12.0)
    if exponent == 0.0:
        share = np.ones(1)
        slip = np.ones(1)
    else:
        exponent = validation.number("exponent", exponent, least=0.1)
        pairs = None
        if sliders is not None:
            pairs = validation.integer("sliders", sliders, least=4) // 2
        share, slip = power_law_sliders(1.0 / exponent, decades, pairs)

    macroslip = friction / stiffness
    contacts = []
    for kt, relative_slip in zip(stiffness * share, slip):
        limit = float(kt * relative_slip * macroslip)
        contacts.append(Contact(0, kt=float(kt), mu=1.0, preload=limit))
    # the sliders in stick carry their part of the modal stiffness
    stiffness_without_joint = modal_stiffness - stiffness
    damping = 2.0 * damping_ratio * np.sqrt(modal_stiffness * mass)
    settings = {"harmonics": 1} | settings
    study = lumped(
        mass, damping, stiffness_without_joint, contacts=contacts, forces={0: 1.0}, **settings
    )
    resolution = 10.0**-decades * macroslip
    return study.replace(model=replace(study.model, slip_resolution=resolution))


class _Face(NamedTuple):
    """Interface of one point: two tangential motions and closing, stiffness of each, kind,
    contact.
    """

    rows: tuple[Any, Any, Any]
    stiffness: list[float]
    kind: Any
    contact: Contact | None = None


def _faces(
    contacts: Sequence[Contact], cubic: Mapping[Any, float], modes: _Modes
) -> dict[str, _Face]:
    """Return interfaces by name: contacts, cubic springs, linear springs."""
    faces = {}
    for number, contact in enumerate(contacts, start=1):
        rows = (contact.tangential, contact.tangential2, contact.normal)
        # without normal motion any normal stiffness will do; it turns the preload into a gap
        kn = contact.kn or contact.kt
        stiffness = [contact.kt, contact.kt, kn]
        faces[f"contact {number}"] = _Face(rows, stiffness, "friction", contact)
    for number, (row, value) in enumerate(cubic.items(), start=1):
        k = validation.number(f"cubic {row!r}", value, unit="N/m3")
        faces[f"cubic {number}"] = _Face((row, None, None), [k, 0.0, 0.0], "cubic")
    for number, spring in enumerate(modes.springs, start=1):
        stiffness = [spring.stiffness, 0.0, 0.0]
        faces[f"spring {number}"] = _Face((spring.motion, None, None), stiffness, "spring")
    return faces


class _Spring(NamedTuple):
    """Linear spring on a motion in modal coordinates, (n_modes,)."""

    motion: NDArray
    stiffness: float


class _Modes:
    """Modes of the masses, and degrees of freedom by number and by name."""

    def __init__(
        self, mass: Any, damping: Any, stiffness: Any, locations: Mapping[str, int] | None
    ) -> None:
        self.mass = _matrix("mass", mass)
        self.n = len(self.mass)
        C = _matrix("damping", damping, self.n)
        K = _matrix("stiffness", stiffness, self.n)

        least = float(np.linalg.eigvalsh(self.mass)[0])
        largest = float(np.abs(self.mass).max())
        expected = (
            f"a positive definite matrix with eigenvalues above {ROUNDING:g} of its largest entry, "
            f"{largest:.3g} kg"
        )
        found = f"an eigenvalue of {least:.3g} kg"
        validation.check(least > ROUNDING * largest, "mass", expected, found)

        omega2, self.shapes = scipy.linalg.eigh(K, self.mass)
        self.springs: list[_Spring] = []
        size = float(np.abs(omega2).max())
        expected = "a positive semidefinite matrix"
        found = f"a mode of {omega2[0]:.3g} rad2/s2"
        validation.check(not omega2[0] < -ROUNDING * size, "stiffness", expected, found)
        # modes of frequency 0 but for rounding are free masses
        is_free = omega2 <= ROUNDING**1.5 * size
        self.omega2 = np.where(is_free, 0.0, omega2)
        self.damping_ratio, self.drag = self._damped(C)

        if locations is None:
            locations = {f"x{i}": i for i in range(self.n)}
        expected = "a mapping of names to degrees of freedom"
        validation.instance("locations", locations, Mapping, expected)
        self.locations: dict[str, int] = {}
        for name, number in locations.items():
            freedom = validation.integer(f"location '{name}'", number, most=self.n - 1)
            self.locations[name] = freedom

    def _damped(self, C: NDArray) -> tuple[NDArray, NDArray]:
        """Return damping ratios (n,) and additional damping (n,), 1/s; diagonalise damping of modes
        of equal frequency.
        """
        self._turn_equal_frequencies(C)
        # modal damping, and its entries outside the diagonal
        D = self.shapes.T @ C @ self.shapes
        coupling = np.abs(D - np.diag(np.diag(D)))
        if coupling.max() > ROUNDING * max(np.abs(D).max(), 1e-300):
            if self.omega2[0] == 0.0:
                raise _coupled_free_motion(D, coupling)
            D = self._tied(D)
        d = np.diag(D)
        if d.min() < -ROUNDING * np.abs(d).max():
            raise SettingError(
                "damping: expected a positive semidefinite matrix, "
                f"found a mode of {d.min():.3g} 1/s"
            )
        # free and overdamped modes, and those tied by springs, have no damping ratio
        vibrates = self.omega2 > 0.0
        omega2 = np.where(vibrates, self.omega2, 1.0)
        ratio = d / (2.0 * np.sqrt(omega2))
        has_ratio = vibrates & (ratio < 1.0) & (not self.springs)
        damping_ratio = np.where(has_ratio, np.maximum(ratio, 0.0), 0.0)
        drag = np.where(has_ratio, 0.0, np.maximum(d, 0.0))
        return damping_ratio, drag

    def _turn_equal_frequencies(self, C: NDArray) -> None:
        """Turn modes of equal frequency so that their damping is diagonal."""
        # a group of equal frequencies begins with the mode `first`; omega2 is ascending
        first = 0
        rounding = ROUNDING * self.omega2[-1]
        for end in range(1, self.n + 1):
            # continue the group while the next frequency is the same
            if end < self.n and self.omega2[end] - self.omega2[first] <= rounding:
                continue
            group = self.shapes[:, first:end]
            _, turn = np.linalg.eigh(group.T @ C @ group)
            self.shapes[:, first:end] = group @ turn
            first = end

    def _tied(self, D: NDArray) -> NDArray:
        """Change to modes of mass and damping, with springs for the coupling by stiffness; return
        the diagonal damping.

        Parameters
        ----------
        D : (n, n) float, 1/s
            Damping in the modes of mass and stiffness.
        """
        # all new modes have the lowest frequency; springs add the remaining stiffness, which is
        # not diagonal in these modes
        d, turn = np.linalg.eigh(D)
        least = self.omega2[0]
        beyond_least = turn.T @ np.diag(self.omega2 - least) @ turn
        values, motions = np.linalg.eigh(beyond_least)
        threshold = ROUNDING**1.5 * self.omega2[-1]
        self.springs = []
        for motion, value in zip(motions.T, values.tolist()):
            if value > threshold:
                self.springs.append(_Spring(motion, value))
        self.shapes = self.shapes @ turn
        self.omega2 = np.full(self.n, least)
        return np.diag(d)

    def freedom(self, value: Any, what: str) -> int:
        """Return the number of a degree of freedom given by number or by location name."""
        if isinstance(value, str):
            return self.locations[validation.choice(what, value, self.locations)]
        if not isinstance(value, Integral) or isinstance(value, bool):
            raise validation.invalid(
                what, f"a degree of freedom from 0 to {self.n - 1} or the name of a location", value
            )
        return validation.integer(what, value, most=self.n - 1)

    def name(self, value: Any) -> str:
        """Return the location name of a degree of freedom; create it if missing."""
        number = self.freedom(value, "response or force")
        if isinstance(value, str):
            return value
        for name, freedom in self.locations.items():
            if freedom == number:
                return name
        new_name = self.free(f"x{number}")
        self.locations[new_name] = number
        return new_name

    def free(self, name: str) -> str:
        """Return the name, extended until no location has it."""
        while name in self.locations:
            name += "_"
        return name

    def motion(self, row: Any, what: str) -> NDArray:
        """Return a motion in modal coordinates, (n_modes,)."""
        # already in modal coordinates
        if isinstance(row, np.ndarray):
            return row
        combined = np.zeros(self.n)
        for key, factor in _factors(row, what):
            combined[self.freedom(key, what)] += factor
        expected = "a motion of at least one degree of freedom"
        validation.check_value(combined.any(), what, expected, row)
        return np.asarray(combined @ self.shapes)


def _factors(row: Any, what: str) -> list[tuple[Any, float]]:
    """Return the degrees of freedom of a motion, each with its factor."""
    if isinstance(row, tuple):
        expected = "a pair of degrees of freedom for their difference"
        validation.check_value(len(row) == 2, what, expected, row)
        return [(row[0], 1.0), (row[1], -1.0)]
    if isinstance(row, Mapping):
        return [
            (key, validation.number(f"{what}, factor of {key!r}", value))
            for key, value in row.items()
        ]
    return [(row, 1.0)]


def _coupled_free_motion(D: NDArray, coupling: NDArray) -> SettingError:
    """Return the error of damping (n, n), 1/s, that couples modes if one of them has no stiffness."""
    strongest = np.unravel_index(np.argmax(coupling), D.shape)
    i, j = sorted(int(index) for index in strongest)
    # without damping of one of the modes the coupling in 1/s
    own_damping = np.sqrt(abs(D[i, i] * D[j, j]) or 1.0)
    share = coupling[i, j] / own_damping
    return SettingError(
        "damping: expected a matrix that is diagonal in the modes of mass and stiffness, "
        f"because one of them has no stiffness (0 Hz); found modes {i + 1} and {j + 1} coupled "
        f"by {share:.2g} of their damping"
    )


def _matrix(name: str, value: Any, n: int | None = None) -> NDArray:
    """Convert a number, a diagonal or a matrix to a symmetric matrix."""
    try:
        dense = value.toarray() if hasattr(value, "toarray") else value
        # not from texts or complex numbers
        A = np.array(dense).astype(float, casting="same_kind")
    except (TypeError, ValueError):
        raise validation.invalid(name, "a number, a diagonal or a matrix", value) from None
    shape_found = A.shape
    # a number is the matrix of one mass, and zero is a matrix of any size
    if A.ndim == 0 and n is not None and (n == 1 or A == 0.0):
        A = np.full(n, float(A))
    if A.ndim < 2:
        A = np.diag(np.atleast_1d(A))
    if not np.isfinite(A).all():
        raise SettingError(f"{name}: expected finite numbers, found {A[~np.isfinite(A)][0]}")
    is_square = A.ndim == 2 and A.shape[0] == A.shape[1]
    has_size = A.size > 0 if n is None else len(A) == n
    if not (is_square and has_size):
        expected = "(n, n)" if n is None else f"{(n, n)} as the mass"
        raise SettingError(
            f"{name}: expected finite numbers, a diagonal or a matrix {expected}, "
            f"found shape {shape_found}"
        )
    asymmetry = np.abs(A - A.T).max()
    if asymmetry > ROUNDING * np.abs(A).max():
        raise SettingError(
            f"{name}: expected a symmetric matrix, found a difference of {asymmetry:.3g}"
        )
    return 0.5 * (A + A.T)


def _forces(modes: _Modes, forces: Any) -> dict[Any, complex]:
    """Return the amplitudes (N) of forces on degrees of freedom."""
    expected = "a mapping of degrees of freedom to numbers in N"
    validation.instance("forces", forces, Mapping, expected)
    amplitudes = {}
    for key, value in forces.items():
        modes.freedom(key, "forces")
        amplitudes[key] = _amplitude(f"force on {key!r}", value, "N")
    expected = "a force on at least one degree of freedom"
    validation.check(amplitudes, "forces", expected, "none")
    return amplitudes


def _accelerations(modes: _Modes, base: Any) -> dict[Any, complex]:
    """Return the amplitudes (m/s2) of an acceleration of the base, by degree of freedom."""
    # a number accelerates all of them
    by_freedom = base if isinstance(base, Mapping) else dict.fromkeys(range(modes.n), base)
    amplitudes = {}
    for key, value in by_freedom.items():
        modes.freedom(key, "base")
        amplitudes[key] = _amplitude(f"acceleration of {key!r}", value, "m/s2")
    expected = "an acceleration of at least one degree of freedom"
    validation.check(amplitudes, "base", expected, "none")
    return amplitudes


def _amplitude(name: str, value: Any, unit: str) -> complex:
    """Convert a finite number to a complex amplitude."""
    number = value.item() if isinstance(value, np.generic) else value
    is_number = isinstance(number, int | float | complex) and not isinstance(number, bool)
    if not is_number or not np.isfinite(number):
        raise validation.invalid(name, f"a finite real or complex number in {unit}", value)
    return complex(number)


def _excitation(
    modes: _Modes, forces: Mapping[Any, complex]
) -> tuple[Excitation, dict[str, NDArray]]:
    """Return the excitation, and a field of forces if several degrees of freedom are excited."""
    largest = max(abs(force) for force in forces.values())
    if len(forces) == 1:
        key, force = next(iter(forces.items()))
        phase = float(np.angle(force))
        return Excitation(modes.name(key), amplitude=abs(force), phase=phase), {}
    # forces that are all zero remain so
    unit = largest or 1.0
    field = sum(force / unit * modes.motion(key, "forces") for key, force in forces.items())
    name = modes.free("forces")
    # the study uses the conjugate of the row of a location as modal force
    return Excitation(name, amplitude=largest), {name: np.conj(field)}


def _base_excitation(
    modes: _Modes, accelerations: Mapping[Any, complex]
) -> tuple[Excitation, dict[str, NDArray]]:
    """Return the base excitation, and the inertia forces under unit acceleration of the base."""
    largest = max(accelerations.values(), key=abs)
    validation.check(largest != 0.0, "base", "an acceleration other than 0", "0")
    # motion of all degrees of freedom with a unit motion of the ground
    carried = np.zeros(modes.n)
    for key, acceleration in accelerations.items():
        ratio = acceleration / largest
        in_phase = abs(ratio.imag) < ROUNDING
        found = f"{acceleration} and {largest}"
        validation.check(in_phase, "base", "accelerations of one phase", found)
        carried[modes.freedom(key, "base")] += ratio.real
    validation.check(BASE not in modes.locations, "base", "no location of this name", "one")
    inertia = -(modes.shapes.T @ (modes.mass @ carried))
    phase = float(np.angle(largest))
    return Excitation(BASE, amplitude=abs(largest), phase=phase), {BASE: inertia}


def _response(
    modes: _Modes, response: Any, amplitudes: Mapping[Any, complex]
) -> tuple[str, dict[str, NDArray]]:
    """Return the location of the response, and its modal row if it is a sum of degrees of
    freedom.
    """
    if isinstance(response, Mapping):
        name = modes.free("response")
        return name, {name: modes.motion(response, "response")}
    if response is None:
        response = max(amplitudes, key=lambda key: abs(amplitudes[key]))
    return modes.name(response), {}


def _model(
    modes: _Modes,
    faces: Mapping[str, _Face],
    combined_rows: Mapping[str, NDArray],
    load_per_preload: Mapping[int | str, float] | None,
    base: bool = False,
) -> Model:
    """Return a model of one body with all masses and a rigid ground; ports have the relative
    motions.
    """
    zero = np.zeros(modes.n)
    shapes = np.zeros((len(faces), 3, modes.n))
    preload_force = np.zeros(modes.n)
    interfaces = {}
    for port, (name, face) in enumerate(faces.items()):
        tangential, tangential2, normal = face.rows
        u1 = _motion_or_rest(modes, tangential, name)
        u2 = _motion_or_rest(modes, tangential2, name)
        closing = _motion_or_rest(modes, normal, name)
        # closing motion is opposite to the normal of the ground
        shapes[port] = u1, u2, -closing
        gap = 0.0
        if face.contact is not None:
            # a preload is a negative gap
            gap = face.contact.gap - face.contact.preload / face.stiffness[2]
            preload_force += face.contact.preload * closing
        interfaces[name] = _interface(name, face.kind, gap)

    rows = {name: modes.shapes[freedom] for name, freedom in modes.locations.items()}
    rows |= combined_rows
    basis = ModalBasis(
        omega2=modes.omega2,
        damping_ratio=modes.damping_ratio,
        contact_modes=shapes,
        # a location moves in its first direction only
        locations={name: np.array([row, zero, zero]) for name, row in rows.items()},
        drag=modes.drag if modes.drag.any() else None,
    )
    load = None
    if load_per_preload is not None:
        load = _body_load(modes, shapes, load_per_preload)
    masses = Body(
        name=BODY,
        kind="lumped",
        ports=tuple((name, "b") for name in faces),
        bases={0: basis},
        load=load,
        constant_force=preload_force,
    )
    ground = Body(name=GROUND, kind="ground", ports=tuple((name, "a") for name in faces))
    locations = {name: Location(name, BODY, position=np.zeros(3)) for name in rows}
    if base:
        locations[BASE] = Location(BASE, BODY, position=np.zeros(3), kind="base")
    return Model(
        n_blades=1,
        bodies={BODY: masses, GROUND: ground},
        interfaces=interfaces,
        locations=locations,
        provenance={"source": "lumped masses"},
    )


def _motion_or_rest(modes: _Modes, row: Any, name: str) -> NDArray:
    """Return a motion in modal coordinates, zero if there is none in this direction."""
    if row is None:
        return np.zeros(modes.n)
    return modes.motion(row, name)


def _interface(name: str, kind: Any, gap: float) -> Interface:
    """Return an interface of one point between the ground and the masses."""
    return Interface(
        name=name,
        kind=kind,
        body_a=GROUND,
        sector_a=0,
        body_b=BODY,
        sector_b=0,
        points=np.zeros((1, 3)),
        area=np.ones(1),
        frame=np.eye(3)[None],
        gap=np.array([gap]),
    )


def _body_load(
    modes: _Modes, shapes: NDArray, load_per_preload: Mapping[int | str, float]
) -> BodyLoad:
    """Return the static load per newton of preload, with the displacement of the ports under it.

    ``shapes`` (n_ports, 3, n_modes) contains the motions of the ports.
    """
    what = "load_per_preload"
    expected = "a mapping of degrees of freedom to numbers"
    validation.instance(what, load_per_preload, Mapping, expected)
    modal_force = np.zeros(modes.n)
    for key, value in load_per_preload.items():
        force = validation.number(f"load on {key!r}", value)
        modal_force += force * modes.motion(key, what)
    expected = "a static force on at least one degree of freedom"
    validation.check(modal_force.any(), what, expected, dict(load_per_preload))
    # free masses have no static displacement
    elastic = modes.omega2 > 0.0
    coordinates = modal_force[elastic] / modes.omega2[elastic]
    return BodyLoad(
        direction=np.array([0.0, 0.0, 1.0]),
        generalised=modal_force,
        displacement=shapes[..., elastic] @ coordinates,
    )
