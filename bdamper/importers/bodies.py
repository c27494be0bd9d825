r"""Bodies of an imported model, from matrices or from modes, with speed-dependent data and local
basis.

**Modes.** Modes of a file become travelling waves toward +X with unit modal mass.  Their modal
masses come from the file or the user.  Static receptances do not follow from a few modes.  Without
matrices the user therefore gives the contact stiffness, and a damper is rigid.

**Rotor speed.** Matrices at two speeds give the stiffness per squared speed as a difference
quotient.  If a program gives modes only, the modes of the second speed are combinations of the
modes of the first.  With the unitary polar factor A of their overlap,

.. math:: K(\Omega_1) = \omega_1^2, \qquad K(\Omega_2) = A\,\omega_2^2 A^H

on the modes of the first speed.  Pairing the modes in the order of their frequencies would fail at
veerings.

References
----------
K. Fan, A. J. Hoffman, "Some metric inequalities in the space of matrices", *Proceedings of the
American Mathematical Society* 6 (1955): the polar factor is the nearest unitary matrix.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg
from numpy.typing import NDArray
from scipy.linalg import polar, svdvals

from bdamper.fem.cyclic_symmetry import (
    CyclicSector,
    Sectors,
    Waves,
    sector_inside,
    travelling_waves,
)
from bdamper.fem.local_basis import BladePart, LocalSizes, damper_motion, local_basis, sampled_waves
from bdamper.fem.reduced_bodies import (
    PICTURED_MODES,
    FreeBody,
    RingSector,
    Wanted,
    constrained_body,
    free_body,
    nodes_of,
    ring_body,
)
from bdamper.fem.rotation import IN_PLANE, Rotation
from bdamper.importers.fe_body import BOUNDS, FEBody, Modes
from bdamper.importers.options import NodeSet, Sector
from bdamper.importers.plausibility import check_rigid_motion, compare_frequencies
from bdamper.importers.prepared_body import CyclicStructure, PreparedBody
from bdamper.model.modal_basis import fix_phase, rigid_motions
from bdamper.model.structure import Body, BodyLoad, Interface, ModalBasis
from bdamper.util import validation
from bdamper.util.errors import SettingError, check

if TYPE_CHECKING:
    from bdamper.fem.element_stress import StressRows


# ---- Rotor speeds ----


def over_speed(bodies: Mapping[float, FEBody]) -> FEBody:
    """Combine the same body at two or three rotor speeds, with matrices or modes at each speed.

    With matrices at three speeds the stiffness is quadratic in the squared speed, otherwise linear.
    Modes at a third speed between the others only check that it is.

    Parameters
    ----------
    bodies : mapping of rotor speed (rad/s) to FEBody
        Two or three speeds, for example
        ``{0.0: read_calculix("standstill"), 600.0: read_calculix("running")}``.  The model
        has the modes of the lowest speed, and the other speeds determine how they change.  The
        import compares frequencies and flexibilities of the model with the matrices at each speed.
        It asks for a third speed if two do not suffice.

    Returns
    -------
    FEBody
        Body for :func:`bdamper.importers.build_model`.

    Raises
    ------
    SettingError, ModelError
        If there are not two or three speeds, the nodes differ, or one speed has matrices and
        another has modes only.
    """
    if not isinstance(bodies, Mapping) or len(bodies) not in (2, 3):
        raise validation.invalid(
            "over_speed", "a mapping of two or three rotor speeds to FEBody", bodies
        )
    checked = []
    for key, value in bodies.items():
        omega = validation.number("rotor speed", key, least=0.0, unit="rad/s")
        body = validation.instance(f"body at {omega:g} rad/s", value, FEBody)
        checked.append(replace(body, rotor_speed=omega, faster=None, between=None))
    slowest, *others = sorted(checked, key=lambda body: body.rotor_speed)
    for other in others:
        same_nodes = np.array_equal(slowest.numbers, other.numbers)
        item = f"{other.source} at {other.rotor_speed:g} rad/s"
        check(same_nodes, item, f"the nodes of {slowest.source}", "other numbers")
        if (slowest.stiffness is None) != (other.stiffness is None):
            raise SettingError(
                "over_speed: expected matrices at all speeds, or modes at all speeds, "
                "found matrices at one and modes at another"
            )
    *middle, fastest = others
    return replace(slowest, faster=fastest, between=middle[0] if middle else None)


def rotation_of(body: PreparedBody) -> Rotation | None:
    """Return the change of stiffness with rotor speed of a body with matrices, or None for a single
    speed.

    Raises
    ------
    ModelError
        If the mass matrix changes with speed.
    """
    faster = body.faster
    if faster is None:
        return None
    first, last = body.raw.rotor_speed, faster.raw.rotor_speed
    norm = scipy.sparse.linalg.norm
    mass = body.structure.mass
    for other in (body.between, faster):
        if other is None:
            continue
        same_mass = norm(other.structure.mass - mass) <= 1e-6 * norm(mass)
        item = f"mass matrix at {other.raw.rotor_speed:g} rad/s"
        body.require(same_mass, item, "the mass matrix of the other speeds", "a different one")
    per_squared_speed = _per_squared_speed(body, faster)
    softening = _spin_softening(body, per_squared_speed)
    _check_softening(body, softening, first, last)
    between = body.between
    if between is not None:
        middle = between.raw.rotor_speed
        of_middle = _spin_softening(body, _per_squared_speed(body, between))
        _check_softening(body, of_middle, first, middle)
    if abs(softening) <= TOLERATED_SOFTENING:
        body.report.missing.append(
            f"spin softening of the {body.name}: the stiffness at {last:g} rad/s contains "
            f"{_percent(softening)} of the spin softening of its mass; frequencies of bending "
            "in the plane of rotation are too high"
        )
    body.passed(
        f"{body.name}: stiffness at {first:g} and {last:g} rad/s, "
        f"spin softening {100 * softening:.4g} %"
    )
    third, bend = _bend(body, per_squared_speed)
    return Rotation(per_squared_speed, first, last, third, bend, body.raw.source)


def _bend(
    body: PreparedBody, per_squared_speed: sp.csr_matrix
) -> tuple[float | None, sp.csr_matrix | None]:
    """Return the third speed (rad/s) and the matrix Q (:mod:`bdamper.fem.rotation`), if there is one.

    With Q the stiffness (3 n_nodes, 3 n_nodes) is exact at this speed as well.
    """
    between = body.between
    if between is None or body.faster is None:
        return None, None
    first, last = body.raw.rotor_speed, body.faster.raw.rotor_speed
    omega = between.raw.rotor_speed
    on_chord = body.structure.stiffness + (omega**2 - first**2) * per_squared_speed
    beside_chord = between.structure.stiffness - on_chord
    bend = beside_chord / ((omega**2 - first**2) * (omega**2 - last**2))
    return omega, bend.tocsr()


def _percent(fraction: float) -> str:
    return f"{100.0 * fraction:.3g} %"


def _per_squared_speed(body: PreparedBody, faster: PreparedBody) -> sp.csr_matrix:
    """Return the change of the stiffness of a body with the squared rotor speed, in kg."""
    difference = faster.structure.stiffness - body.structure.stiffness
    return (difference / (faster.raw.rotor_speed**2 - body.raw.rotor_speed**2)).tocsr()


TOLERATED_SOFTENING = 0.005
"""Deviation of the spin softening from all or nothing, due to rounding in files; speeds in
revolutions per minute give 0.011.
"""


def _check_softening(body: PreparedBody, softening: float, first: float, last: float) -> None:
    """Check that a stiffness contains the complete spin softening of the mass, or none.

    Any other fraction shows that the matrices belong to other speeds.  A fraction below 0 or above 1
    is an error, and one between them a failed comparison.

    Parameters
    ----------
    softening : float
        Fraction of the spin softening of the mass in the change from ``first`` to ``last``.
    first, last : float, rad/s
        Speeds of the matrices according to the user.

    Raises
    ------
    ModelError
    """
    tolerance = TOLERATED_SOFTENING
    complete = abs(softening - 1.0) <= tolerance
    none = abs(softening) <= tolerance
    if complete or none:
        return
    # with complete softening the change is that up to this squared speed
    squared = first**2 + softening * (last**2 - first**2)
    if softening < 0.0:
        suspicion = "the matrices of both speeds are exchanged"
    elif abs(softening / RPM_SOFTENING - 1.0) <= tolerance and first == 0.0:
        suspicion = "the speeds are in revolutions per minute; give rad/s"
    else:
        suspicion = f"the matrices belong to {np.sqrt(squared):.4g} rad/s"
    item = f"stiffness at {last:g} rad/s"
    expected = "all of the spin softening of the mass, or none"
    found = f"{_percent(softening)}; possibly {suspicion}"
    if 0.0 < softening < 1.0:
        with body.report.comparison():
            body.require(False, item, expected, found)
    else:
        body.require(False, item, expected, found)


RPM_SOFTENING = (np.pi / 30.0) ** 2
"""Fraction of the spin softening if the speeds are in revolutions per minute."""


def _spin_softening(body: PreparedBody, per_squared_speed: sp.csr_matrix) -> float:
    """Return the fraction of the mass in the plane of rotation by which the stiffness is softened.

    It is 1 for matrices with full spin softening, and 0 without.  A translation in this plane
    causes no force of the elastic and geometric stiffness on inner nodes, so that only the
    softening remains there.  Nodes next to a held node are not inner, with or without held
    components in the matrices.
    """
    structure = body.structure
    # along X and Y: (3 n_nodes, 2)
    translations = np.tile(IN_PLANE[:, :2], (len(structure.nodes), 1))
    momentum = structure.mass @ translations
    force = structure.stiffness @ translations
    # of any displacement with components of at most 1
    largest_force = np.abs(structure.stiffness).sum(axis=1).A1
    is_loaded = np.ones(len(structure.nodes), bool)
    # the stiffness at the lower speed is without or with softening
    for restored in (0.0, body.raw.rotor_speed**2):
        elastic_force = np.abs(force + restored * momentum).max(axis=1)
        is_loaded &= (elastic_force > 1e-6 * largest_force).reshape(-1, 3).any(axis=1)
    has_held_component = body.fixed(held=None).any(axis=1)
    is_inner = np.repeat(~(is_loaded | has_held_component), 3)
    inertia = is_inner[:, None] * momentum
    squared_mass = float(np.square(inertia).sum())
    # without inner nodes there is no comparison, and the softening counts as complete
    if not squared_mass:
        return 1.0
    # least squares: the stiffness loses this fraction of the mass per squared speed
    return -float((inertia * (per_squared_speed @ translations)).sum()) / squared_mass


def check_fall(
    body: PreparedBody, d: int, slower: NDArray, faster: NDArray, speeds: tuple[float, float]
) -> None:
    """Check that frequencies fall with speed by no more than spin softening explains.

    Rotation stretches a structure, so its geometric stiffness is not negative.  Spin softening
    reduces a squared natural frequency by at most the squared speed.

    Parameters
    ----------
    slower, faster : (n,) float, rad2/s2
        Squared natural frequencies of a nodal diameter d at both speeds, in any order.
    speeds : (2,) float, rad/s
    """
    n = min(len(slower), len(faster))
    first, last = speeds
    softening = last**2 - first**2
    fall = np.sort(slower)[:n] - np.sort(faster)[:n]
    largest = float(fall.max(initial=0.0)) / softening
    with body.report.comparison():
        body.require(
            largest <= 1.0 + BOUNDS.fall,
            f"nodal diameter {d} at {last:g} rad/s",
            f"squared frequencies that decrease from {first:g} rad/s by at most the spin softening",
            f"{largest:.3g} times as much; possibly the bodies of both speeds are exchanged",
        )


def basis_from_modes(
    body: PreparedBody,
    d: int,
    basis: ModalBasis,
    shapes: NDArray,
    omega2: NDArray,
    moved: NDArray,
) -> ModalBasis:
    """Add speed-dependent data to a basis of a nodal diameter d.

    Parameters
    ----------
    shapes : (3 n_nodes, n_modes)
        Mass-normalised modes of the basis, NaN at nodes without values.
    omega2, moved : (n_modes,), (3 n_nodes, n_modes)
        Squared natural frequencies (rad2/s2) and mass-normalised modes at the higher speed.

    Raises
    ------
    ModelError
        If the modes of the higher speed are not combinations of the modes of the basis.
    """
    assert body.raw.faster is not None
    first, omega = body.raw.rotor_speed, body.raw.faster.rotor_speed
    item = f"modes of nodal diameter {d} at {omega:g} rad/s"
    n_moved = moved.shape[1]
    expected = f"{basis.n_modes} modes as at {first:g} rad/s"
    body.require(n_moved == basis.n_modes, item, expected, n_moved)
    has_values = ~(np.isnan(shapes).any(axis=1) | np.isnan(moved).any(axis=1))
    # moved = shapes @ overlap
    overlap, *_ = np.linalg.lstsq(shapes[has_values], moved[has_values], rcond=None)
    # a rotation of the modes has singular values of 1; they are in descending order
    sizes = svdvals(overlap)
    expected = (
        f"combinations of the modes at {first:g} rad/s "
        "(singular values of the overlap within 1 % of 1)"
    )
    found = f"{sizes[-1]:.4g} to {sizes[0]:.4g}; use fewer modes, or speeds closer together"
    body.require(np.abs(sizes - 1.0).max() <= BOUNDS.agreement, item, expected, found)
    # the nearest rotation; the stiffness at the higher speed, in the modes of the lower speed, is
    # turning @ diag(omega2) @ turning^H
    turning, _ = polar(overlap)
    change = (turning * omega2) @ turning.conj().T - np.diag(basis.omega2)
    per_squared_speed = change / (omega**2 - first**2)
    body.passed(
        f"{body.name}, nodal diameter {d}: overlap of the modes at the two speeds at least "
        f"{sizes[-1]:.5g}"
    )
    check_fall(body, d, basis.omega2, omega2, (first, omega))
    hermitian = 0.5 * (per_squared_speed + per_squared_speed.conj().T)
    return basis.with_speed(hermitian, omega_ref=first, source=body.raw.source)


# ---- Bodies from modes ----


NO_RECEPTANCE = (
    "static receptances of the {} (no matrices): contact stiffness cannot be derived; "
    "give it as numbers (ContactFaces(stiffness=...), or Study(contact_stiffness=...))"
)


def _pictures(body: PreparedBody, d: int, shapes: NDArray) -> dict[int, NDArray]:
    """Return the first shapes (n_nodes, 3, n) of (3 n_nodes, n_modes) by nodal diameter.

    Without elements, or without values at some of their nodes, there are none.
    """
    pictured = shapes.reshape(-1, 3, shapes.shape[1])[..., :PICTURED_MODES].copy()
    if not body.elements or not np.isfinite(pictured[body.used]).all():
        return {}
    return {d: pictured}


def _waves(body: PreparedBody, modes: Modes, ring: CyclicStructure) -> Waves:
    """Return travelling waves of one nodal diameter on all nodes, NaN at nodes without values."""
    d = modes.nodal_diameter
    item = f"modes of nodal diameter {d} ({modes.source or 'given'})"
    shapes = body.shapes(np.asarray(modes.numbers), np.asarray(modes.shapes), item)
    n_modes = shapes.shape[1]
    if ring.faces.n_sectors == 1:
        # a structure without sectors has no phase condition to violate
        waves = Waves(
            index=np.arange(n_modes),
            shapes=shapes.real,
            mismatch=np.zeros(n_modes),
            turned=0,
            combined=0,
        )
    else:
        # nodes without values have none in any mode
        first_mode = shapes[:, 0].real.reshape(-1, 3)
        has_values = ~np.isnan(first_mode).any(axis=1)
        faces = ring.faces.among(has_values)
        expected = "values at matching nodes of the two sector faces"
        body.require(len(faces.dependent), item, expected, "none")
        frequency = np.asarray(modes.frequency, float)
        with body.refusing(item, "travelling waves"):
            waves = travelling_waves(frequency, np.nan_to_num(shapes), faces, d)
        has_component = np.repeat(has_values, 3)[:, None]
        waves = replace(waves, shapes=np.where(has_component, waves.shapes, np.nan))
    text = (
        f"{body.name}, nodal diameter {d}: {len(waves.index)} modes are waves of it "
        f"within {waves.mismatch.max():.1g}"
    )
    if waves.turned:
        text += f"; {waves.turned} of them travelled the other way and were reversed"
    if waves.combined:
        text += f"; {waves.combined} were combined from pairs of real shapes"
    body.passed(text)
    return waves


def compare_known(body: PreparedBody, d: int, omega2: NDArray, ring: CyclicStructure) -> None:
    """Compare modes at a nodal diameter d with expected frequencies and with the modes of a file.

    The squared natural frequencies ``omega2`` (n_modes,) are in rad2/s2.
    """
    item = f"{body.name}, nodal diameter {d}"
    computed = np.sqrt(np.maximum(omega2, 0.0)) / (2.0 * np.pi)
    # frequencies (Hz) with their source
    references: list[tuple[NDArray, str]] = []
    if d in ring.expected:
        references.append((np.asarray(ring.expected[d], float), "expected_frequencies"))
    if body.has_matrices:
        for modes in body.raw.modes:
            if modes.nodal_diameter != d:
                continue
            with body.report.comparison():
                index = _waves(body, modes, ring).index
                frequency = np.asarray(modes.frequency, float)[index]
                references.append((frequency, modes.source or "the modes"))
    for expected, source in references:
        with body.report.comparison():
            error = compare_frequencies(computed, expected, item, source)
            body.passed(f"{item}: frequencies agree with {source} within {100 * error:.2g} %")


EXACT_FREQUENCIES = 1e-6
"""Relative error of frequencies that does not show in print."""
EXACT_FLEXIBILITY = 1e-4
"""Error of a flexibility, relative to that of its points, that does not matter.

It is a small difference of large numbers: rounding made it 1e-7 on imported sectors.
"""
STRAIGHT = 0.05
"""Relative distance of a squared frequency from its chord over the squared speed.

Above it two speeds do not tell how the stiffness changes between them.  It is 0.001 on the shipped
disk up to 600 rad/s, and 0.45 on a stage with thin blades up to 1,000 rad/s, where the first
frequency is 17 % too high at 300 rad/s.
"""


def distance_from_chord(basis: ModalBasis, first: float, last: float) -> float:
    """Return the largest distance of the lowest squared frequency from its chord.

    It is relative to the chord between the speeds ``first`` and ``last`` (rad/s), over the squared
    speed.  The lowest eigenvalue of a linear stiffness is concave, and it leaves the chord if its
    shape changes.
    """
    assert basis.speed is not None
    inside = np.linspace(0.0, 1.0, 9)
    lowest = []
    for fraction in inside:
        omega = np.sqrt(first**2 + fraction * (last**2 - first**2))
        omega2, _ = basis.speed.modes(float(omega))
        lowest.append(omega2.min())
    chord = lowest[0] + inside * (lowest[-1] - lowest[0])
    return float(np.abs(np.array(lowest) / chord - 1.0).max())


def check_second_speed(
    body: PreparedBody, bases: Mapping[int, ModalBasis], ring: CyclicStructure
) -> None:
    """Compare frequencies and flexibilities of the model with the matrices at each rotor speed.

    The frequencies are compared with the modes in the file of the highest speed as well.  The
    report asks for a third speed if the lowest frequency of two speeds leaves its chord.
    """
    faster = body.faster
    if faster is None:
        return
    first, last = body.raw.rotor_speed, faster.raw.rotor_speed
    between = "" if body.between is None else f", {body.between.raw.rotor_speed:g}"
    for d, basis in bases.items():
        assert basis.speed is not None and basis.speed.error is not None
        assert basis.speed.flexibility_error is not None
        speeds = f"nodal diameter {d}, {first:g}{between} and {last:g} rad/s"
        error = f"{basis.speed.error:.1g}"
        with body.report.comparison():
            expected = f"the frequencies of the matrices within {EXACT_FREQUENCIES:g}"
            body.require(basis.speed.error <= EXACT_FREQUENCIES, speeds, expected, error)
            body.passed(
                f"{body.name}: frequencies at {speeds} are those of the matrices within {error}"
            )
        flexibility_error = basis.speed.flexibility_error
        with body.report.comparison():
            expected = f"the flexibility of the matrices within {EXACT_FLEXIBILITY:g}"
            found = f"{flexibility_error:.1g}"
            body.require(flexibility_error <= EXACT_FLEXIBILITY, speeds, expected, found)
            body.passed(
                f"{body.name}: flexibilities at {speeds} are those of the matrices within {found}"
            )
        at_last, _ = basis.at_speed(last)
        natural = slice(basis.n_natural)
        check_fall(body, d, basis.omega2[natural], at_last.omega2[natural], (first, last))
        distance = distance_from_chord(basis, first, last)
        if body.between is None and distance > STRAIGHT:
            body.report.missing.append(
                f"a third rotor speed of the {body.name}: at nodal diameter {d} the lowest squared "
                f"frequency between {first:g} and {last:g} rad/s is up to {100 * distance:.2g} % "
                "away from its chord over the squared speed, so that two speeds do not determine "
                "it; add matrices at a third of the highest speed to over_speed"
            )
        of_diameter = [modes for modes in faster.raw.modes if modes.nodal_diameter == d]
        for modes in of_diameter:
            item = f"{body.name}, nodal diameter {d} at {last:g} rad/s"
            source = modes.source or "the modes"
            with body.report.comparison():
                index = _waves(faster, modes, ring).index
                in_file = np.asarray(modes.frequency, float)[index]
                computed = np.sqrt(at_last.omega2[: basis.n_natural]) / (2.0 * np.pi)
                difference = compare_frequencies(computed, in_file, item, source)
                body.passed(
                    f"{item}: frequencies agree with {source} within {100 * difference:.2g} %"
                )


def check_between_speeds(
    body: PreparedBody, bases: Mapping[int, ModalBasis], ring: CyclicStructure
) -> None:
    """Compare frequencies of a model from modes with the modes at a speed between both.

    They show whether the stiffness is linear in the squared speed.  The stiffness of a thin blade
    with large deflections is not.
    """
    between = body.between
    if between is None:
        return
    assert body.raw.faster is not None
    highest = body.raw.faster.rotor_speed
    omega = between.raw.rotor_speed
    source = f"{between.raw.source} at this speed"
    for d, basis in bases.items():
        of_model, _ = basis.at_speed(omega)
        # squared frequencies of a stiffness that is not linear may be negative
        squared = np.maximum(of_model.omega2[: basis.n_natural], 0.0)
        at_last, _ = basis.at_speed(highest)
        computed = np.sqrt(squared) / (2.0 * np.pi)
        item = f"{body.name}, nodal diameter {d} at {omega:g} rad/s"
        with body.report.comparison():
            given, _ = _normalised(between, d, ring, basis.n_natural)
            error = compare_frequencies(computed, np.sqrt(given) / (2.0 * np.pi), item, source)
            n = min(len(squared), len(given))
            deviation = np.abs(np.sort(squared)[:n] - np.sort(given)[:n]).max()
            change = np.abs(at_last.omega2[: basis.n_natural] - basis.omega2[: basis.n_natural])
            part = float(deviation / change.max())
            expected = (
                f"squared frequencies of {source} within {_percent(BOUNDS.of_change)} of their "
                "change up to the highest speed"
            )
            body.require(part <= BOUNDS.of_change, item, expected, _percent(part))
            body.passed(
                f"{item}, between both speeds: frequencies agree within {100 * error:.2g} %"
            )


def check_reached(body: PreparedBody, wanted: Wanted, absent: NDArray, content: str) -> None:
    """Raise ModelError if a contact face or location includes nodes (n,) without ``content``."""
    nodes_of_part = {"contact faces": wanted.contact.indices // 3}
    for name, location in wanted.locations.items():
        nodes_of_part[f"location '{name}'"] = nodes_of(location)
    for item, nodes in nodes_of_part.items():
        wrong = body.raw.numbers[np.intersect1d(nodes, absent)]
        numbers = ", ".join(map(str, wrong[:5]))
        body.require_sentence(not len(wrong), item, f"nodes {numbers} lack {content}")


def _normalised(
    body: PreparedBody, d: int, ring: CyclicStructure, n_modes: int
) -> tuple[NDArray, NDArray]:
    """Return the lowest modes of a nodal diameter d.

    Returns
    -------
    omega2 : (n,) float
        Squared natural frequencies, rad2/s2.
    shapes : (3 n_nodes, n) complex
        Mass-normalised shapes.
    """
    item = f"modes of nodal diameter {d}"
    diameters = [modes.nodal_diameter for modes in body.raw.modes]
    once = diameters.count(d) == 1
    body.require(once, "modes", f"{item} once", f"modes of {diameters}")
    modes = body.raw.modes[diameters.index(d)]
    waves = _waves(body, modes, ring)
    expected = "modal masses (or matrices) to rescale the modes to unit modal mass over one sector"
    body.require(modes.modal_mass is not None, item, expected, "neither")
    mass = body.placement.units.mass * np.asarray(modes.modal_mass, float)[waves.index]
    frequency = np.asarray(modes.frequency, float)[waves.index]
    lowest = frequency.min(initial=np.inf)
    body.require((frequency > 0.0).all(), item, "frequencies > 0 of a constrained sector", lowest)
    lowest_first = np.argsort(frequency, kind="stable")[:n_modes]
    normalised = (waves.shapes / np.sqrt(mass))[:, lowest_first]
    omega2 = (2.0 * np.pi * frequency[lowest_first]) ** 2
    # modes alone have no mass matrix; the identity gives all components the same weight
    equal_weights = sp.identity(len(waves.shapes), format="csr")
    return omega2, fix_phase(normalised, equal_weights)


def constrained_from_modes(
    body: PreparedBody, wanted: Wanted, ring: CyclicStructure
) -> tuple[Body, dict[int, NDArray]]:
    """Make a sector from its modes at each nodal diameter.

    Returns
    -------
    body : Body
    pictures : dict of nodal diameter to (n_nodes, 3, n)
        First mode shapes, for pictures.

    Raises
    ------
    ModelError
        If modes of a nodal diameter are missing, are not travelling waves, or have no modal mass.
    """
    bases: dict[int, ModalBasis] = {}
    pictures: dict[int, NDArray] = {}
    at_higher_speed = body.faster
    for d in ring.diameters:
        omega2, shapes = _normalised(body, d, ring, wanted.n_modes)
        compare_known(body, d, omega2, ring)
        # the file may contain the modes at some nodes only
        values_of_node = shapes.reshape(len(body.nodes), -1)
        incomplete = np.flatnonzero(np.isnan(values_of_node).any(axis=1))
        check_reached(body, wanted, incomplete, "values of the modes")
        if d in ring.pictured:
            pictures |= _pictures(body, d, shapes)
        basis = wanted.basis(omega2, shapes)
        if at_higher_speed is not None:
            n_modes = len(omega2)
            higher_omega2, higher_shapes = _normalised(at_higher_speed, d, ring, n_modes)
            basis = basis_from_modes(body, d, basis, shapes, higher_omega2, higher_shapes)
        bases[d] = basis
    check_between_speeds(body, bases, ring)
    body.passed(f"{body.name}: modes rescaled, modal mass from the file or the user (not checked)")
    body.report.missing.append(NO_RECEPTANCE.format(body.name))
    return Body(body.name, "constrained", wanted.ports, bases), pictures


def free_from_modes(body: PreparedBody, wanted: Wanted) -> Body:
    """Make a rigid free body from mass, centre of mass and inertia.

    Raises
    ------
    ModelError
        If the mass properties are missing or unphysical.
    """
    rigid = body.raw.rigid
    if rigid is None:
        expected = "matrices, or mass, centre and inertia (MassProperties)"
        raise body.error("free body", expected, "neither")
    units = body.placement.units
    to_model = body.placement.rotation
    item = "mass properties"
    expected = "a mass > 0, a centre (3,) and an inertia (3, 3)"
    with body.refusing(item, expected):
        mass = units.mass * float(rigid.mass)
        offset = np.reshape(rigid.centre, 3) - body.placement.origin
        centre = units.length * to_model @ offset
        inertia = units.mass * units.length**2 * to_model @ rigid.inertia @ to_model.T
        moments, principal = np.linalg.eigh(inertia)
    # each moment is at most the sum of the two others
    smallest, middle, largest = moments
    is_solid = smallest > 0 and largest <= (smallest + middle) * (1 + 1e-6)
    expected += " with principal moments > 0, none larger than the sum of the others"
    found = f"{mass} kg, {moments} kg m2"
    body.require(mass > 0 and is_solid and np.isfinite(centre).all(), item, expected, found)
    # tangential, radial and axial translation, and rotations about the principal axes
    axes = body.damper_axes(centre)
    inertias = [mass, mass, mass, *moments]
    shapes = rigid_motions(body.nodes, centre, axes, principal.T) / np.sqrt(inertias)
    basis = wanted.basis(omega2=np.zeros(6), shapes=shapes)
    body.report.missing.append(NO_RECEPTANCE.format(body.name))
    body.report.missing.append(f"elastic deformation of the {body.name} (no matrices)")
    # a radial force of 1 N acts on the second motion, the radial translation, alone
    radial_motion = np.array([0.0, 1.0, 0.0, 0.0, 0.0, 0.0])
    modal_load = radial_motion / np.sqrt(mass)
    n_points = wanted.contact.shape[0] // 3
    # a rigid body has no elastic displacement at its contact points
    load = BodyLoad(axes[1], modal_load, np.zeros((n_points, 3)))
    return Body(
        body.name,
        "free",
        wanted.ports,
        {0: basis},
        mass=mass,
        centre=centre,
        inertia=inertia,
        load=load,
    )


# ---- Bodies from matrices ----


def held_components(
    body: PreparedBody, wanted: Wanted, fixed: NodeSet | None, ring: CyclicStructure
) -> NDArray:
    """Return the mask (n_nodes, 3) of fixed components.

    Images of fixed nodes on the other sector face are included.  Other programs fix one face only,
    because their cyclic constraint holds the other.

    Raises
    ------
    ModelError
        If a contact face or location has no rows in the matrices.
    """
    held = None if fixed is None else body.node_set(fixed, "fixed")
    without_rows = np.flatnonzero(body.fixed(held=None).all(axis=1))
    if held is not None:
        without_rows = np.setdiff1d(without_rows, held)
    check_reached(body, wanted, without_rows, "rows in the matrices")
    mask = body.fixed(held)
    # the images of each of the three components
    with_images = np.stack([ring.faces.images(component) for component in mask.T], axis=1)
    n_added = int((with_images & ~mask).any(axis=1).sum())
    if n_added:
        body.passed(
            f"{body.name}: {n_added} nodes of a sector face fixed, because their images on the "
            "other face are fixed"
        )
    return with_images


def cyclic_sectors(
    body: PreparedBody, ring: CyclicStructure, mask: NDArray, kept: Collection[int]
) -> Sectors:
    """Return the sector from matrices as a function of the nodal diameter.

    Sectors of the nodal diameters ``kept`` are cached, with their modes.
    """
    made: dict[int, CyclicSector] = {}
    report = body.report.steps.report_pass
    inside = sector_inside(body.structure, ring.faces, mask, report)

    def sector(d: int) -> CyclicSector:
        if d in made:
            return made[d]
        body.report.steps.begin(f"nodal diameter {d}")
        for other in made.values():
            other.forget_matrices()
        expected = "fixed components that are compatible with both sector faces"
        with body.refusing(f"nodal diameter {d}", expected):
            new = CyclicSector(body.structure, ring.faces, mask, d, inside)
        # at other nodal diameters the frequencies show whether the body is held
        if d == 0 or ring.faces.n_sectors == 1:
            _check_held(body, new, bool(mask.any()))
        if d in kept:
            made[d] = new
        return new

    return sector


def constrained_from_matrices(
    body: PreparedBody,
    wanted: Wanted,
    ring: CyclicStructure,
    sector: Sector,
    sizes: LocalSizes,
    interfaces: Mapping[str, Interface],
    stress: Iterable[StressRows],
) -> tuple[Body, dict[int, NDArray]]:
    """Make a sector from its matrices at each nodal diameter, with a local basis if the sector
    names its blade.

    The stress of each mode and static shape is added to the objects ``stress``.

    Returns
    -------
    body : Body
    pictures : dict of nodal diameter to (n_nodes, 3, n)
        First mode shapes, for pictures.

    Raises
    ------
    ModelError
        If the sector is not fixed, or a matrix is not positive definite.
    """
    mask = held_components(body, wanted, sector.fixed, ring)
    part = None
    if sector.blade_nodes is not None:
        part = blade_part(body, wanted, ring, mask, sector.blade_nodes, interfaces)
    kept = []
    if body.raw.faster:
        kept.append(0)  # for the displacement by rotation
    if part is not None:
        kept += sampled_waves(ring.faces.n_sectors)
    at_diameter = cyclic_sectors(body, ring, mask, kept)
    # an eigensolver needs more unknowns than modes
    n_unknowns = int((~mask).sum()) - 3 * len(ring.faces.dependent)
    n_modes = min(wanted.n_modes, max(1, n_unknowns // 2))
    pictures: dict[int, NDArray] = {}

    def seen(made: CyclicSector, omega2: NDArray, shapes: NDArray) -> None:
        """Use the modes of a nodal diameter; ``omega2`` and ``shapes`` include static shapes."""
        d = made.nodal_diameter
        modal_omega2, mode_shapes = made.modes(n_modes)
        compare_known(body, d, modal_omega2, ring)
        if d in ring.pictured:
            pictures.update(_pictures(body, d, mode_shapes))
        for rows in stress:
            rows.add(made, wanted.contact, omega2, shapes)

    expected = "a positive definite stiffness (fixed nodes?) and a positive definite mass matrix"
    with body.refusing("matrices", expected):
        fewer = replace(wanted, n_modes=n_modes)
        rotation = rotation_of(body)
        built = constrained_body(body.name, fewer, at_diameter, ring.diameters, rotation, seen)
    for d, basis in built.bases.items():
        # six squared frequencies of a body that is not held are rounding errors, of either sign
        low = basis.omega2[0]
        high = basis.omega2[-1]
        held = low > max(1e-10 * high, 0.0)
        found = f"squared frequencies {low:.3g} to {high:.3g} rad2/s2"
        body.require(held, f"nodal diameter {d}", "a constrained sector (fixed nodes)", found)
    body.passed("stiffness symmetric and positive definite at every nodal diameter, mass symmetric")
    check_second_speed(body, built.bases, ring)
    if n_modes < wanted.n_modes:
        body.passed(
            f"{n_modes} modes instead of {wanted.n_modes}: the matrices have too few rows for more"
        )
    if part is not None:
        built = with_local_basis(built, body, wanted, at_diameter, interfaces, part, sizes)
    return built, pictures


def _check_held(body: PreparedBody, sector: CyclicSector, held: bool) -> None:
    """Raise ModelError if the factorisation shows an indefinite stiffness or a body that is not
    fixed.

    ``held`` tells whether any component is fixed or has no row in the matrices.
    """
    item = f"stiffness matrix, nodal diameter {sector.nodal_diameter}"
    pivots = sector.solver.pivots
    # a motion without force has a pivot of the size of rounding errors
    if held:
        least = 1e-13 * np.median(np.abs(sector.stiffness.diagonal()))
    else:
        least = 1e-9 * np.median(np.abs(pivots))
    expected = (
        "a constrained body: Sector(fixed=a set of nodes), or components without rows in the "
        "matrices"
    )
    found = f"{'fixed components' if held else 'neither'}, and a rigid-body motion without force"
    body.require(np.abs(pivots).min() >= least, item, expected, found)
    n_negative = int((pivots <= 0.0).sum())
    found = f"{n_negative} negative eigenvalues"
    body.require(not n_negative, item, "a positive definite matrix", found)


def free_from_matrices(body: PreparedBody, wanted: Wanted) -> Body:
    """Make a damper from its matrices, with the centrifugal load of its mass.

    Raises
    ------
    ModelError
        If the stiffness constrains the body, or if it has zero-energy motions other than the six
        rigid-body motions.
    """
    free = _free_in_space(body)
    structure = body.structure
    n_modes = min(wanted.n_modes, max(6, structure.n_dof // 2))
    wanted = replace(wanted, n_modes=n_modes)
    with body.refusing("matrices", "a stiffness matrix with six rigid-body motions and no others"):
        _, radial, _ = free.axes
        built = free_body(body.name, wanted, free, radial)
    # after the six rigid-body motions
    elastic = built.bases[0].omega2[6:]
    expected = "six rigid-body motions and no others"
    found = f"omega2 = {elastic.min(initial=np.inf):.3g}"
    body.require((elastic > 0.0).all(), "stiffness matrix", expected, found)
    body.passed(f"{body.name}: six rigid-body motions without force")
    return built


def _free_in_space(body: PreparedBody) -> FreeBody:
    """Return a body without supports, with its tangential, radial and axial direction."""
    incomplete = body.raw.numbers[body.fixed(held=None).any(axis=1)]
    # empty if all nodes are complete
    first_node = ", ".join(map(str, incomplete[:1]))
    expected = "rows for all three components of every node of a free body"
    found = f"rows missing at {len(incomplete)} nodes, such as node {first_node}"
    body.require(not len(incomplete), "matrices", expected, found)
    body.report.steps.begin(body.name)
    check_rigid_motion(body)
    with body.refusing("mass matrix", "a positive definite matrix"):
        in_model_axes = FreeBody(body.structure, np.eye(3))
    axes = body.damper_axes(in_model_axes.centre)
    return FreeBody(body.structure, axes, report=body.report.steps.report_pass)


def ring_from_matrices(
    body: PreparedBody, wanted: Wanted, ring: CyclicStructure, split: bool
) -> tuple[Body, dict[int, NDArray]]:
    """Make a friction ring from the matrices of one sector.

    Parameters
    ----------
    body : PreparedBody
    wanted : Wanted
    ring : CyclicStructure
        Sector faces of the ring, and the nodal diameters of the model.
    split : bool
        Whether the ring has a gap.

    Returns
    -------
    body : Body
    pictures : dict of nodal diameter to (n_nodes, 3, n)
        First mode shapes, for pictures.

    Raises
    ------
    ModelError
        If the stiffness constrains the sector, or if the ring has zero-energy motions other than
        its rigid-body motions.
    """
    whole = _free_in_space(body)
    n_coordinates = 3 * (len(body.nodes) - len(ring.faces.dependent))
    n_modes = max(6, min(wanted.n_modes, n_coordinates // 2))
    pictures: dict[int, NDArray] = {}

    def sector(d: int) -> RingSector:
        steps = body.report.steps
        steps.begin(f"{body.name}, nodal diameter {d}")
        # only the sectors of a split ring move radially
        radial = whole.axes[1] if split else None
        return RingSector(body.structure, ring.faces, d, radial, steps.report_pass)

    def seen(made: RingSector, omega2: NDArray, shapes: NDArray) -> None:
        """Check that all modes after the rigid-body motions are elastic, and keep pictures."""
        d = made.nodal_diameter
        expected = f"a ring with {made.n_rigid} rigid-body motions at nodal diameter {d}"
        lowest = omega2[made.n_rigid :].min(initial=np.inf)
        positive = lowest > 1e-10 * omega2.max()
        body.require(positive, "stiffness matrix", expected, f"omega2 = {lowest:.3g}")
        if d in ring.pictured or d == 0:
            pictures.update(_pictures(body, d, shapes))

    with body.refusing("matrices", "a sector of a ring without supports"):
        fewer = replace(wanted, n_modes=n_modes)
        built = ring_body(body.name, fewer, sector, ring.diameters, whole, seen)
    kind = "split ring" if split else "closed ring"
    body.passed(
        f"{body.name}: {kind} of {ring.faces.n_sectors} sectors, rigid-body motions at nodal "
        "diameters 0 and 1 only"
    )
    carries = "its hoop force is zero, the contacts carry its whole centrifugal load"
    if not split:
        carries = "its hoop stiffness carries a part of its centrifugal load"
    body.passed(f"{body.name}: {carries}")
    return built, pictures


# ---- Local basis for mistuned bladed disks ----


def blade_part(
    body: PreparedBody,
    wanted: Wanted,
    ring: CyclicStructure,
    fixed: NDArray,
    blade: NodeSet,
    interfaces: Mapping[str, Interface],
) -> BladePart:
    """Return the blade within a sector, for mistuned bladed disks.

    Parameters
    ----------
    fixed : (n_nodes, 3) bool
        Fixed components.
    blade : NodeSet
        Nodes of the blade, including the nodes shared with the disk.

    Raises
    ------
    ModelError, SettingError
        If there is no cyclic sector with matrices, blades touch each other, or the set lacks
        contact points or locations.
    """
    if ring.faces.n_sectors == 1:
        raise SettingError(
            "blade_nodes: expected a sector of a cyclic structure, found an acyclic structure"
        )
    for name, interface in interfaces.items():
        if interface.body_a == interface.body_b == body.name:
            raise SettingError(
                f"blade_nodes: expected contacts between blades and dampers only, found '{name}' "
                "between blades"
            )
    nodes = body.node_set(blade, "blade_nodes")
    expected = "the nodes of a blade from root to tip, with all its contact faces and locations"
    with body.refusing("blade_nodes", expected):
        part = BladePart(body.structure, nodes, fixed, steps=body.report.steps)
        part.check_wanted(wanted, ring.faces)
    return part


def with_local_basis(
    made: Body,
    body: PreparedBody,
    wanted: Wanted,
    sector: Sectors,
    interfaces: Mapping[str, Interface],
    part: BladePart,
    sizes: LocalSizes,
) -> Body:
    """Return the sector ``made`` with a local basis, for mistuned bladed disks.

    Raises
    ------
    ModelError
        If the matrices of the blade clamped at its root are not positive definite.
    """
    with body.refusing("blade_nodes", "a blade that its root holds"):
        motion = damper_motion(wanted.ports, interfaces)
        local = local_basis(part, sector, wanted, motion, sizes, "set of nodes")
    lowest_clamped = np.sqrt(local.omega2[:3]) / (2.0 * np.pi)
    clamped = ", ".join(f"{hertz:.5g}" for hertz in lowest_clamped)
    # relative errors of the lowest frequencies of the local basis
    errors = []
    for d, basis in made.bases.items():
        squared_ratio = local.nodal_diameter(d).omega2[0] / basis.omega2[0]
        errors.append(np.sqrt(squared_ratio) - 1.0)
    body.report.checks += [
        f"wheel: blade of {len(part.nodes)} nodes, {len(part.root)} of them at its root; "
        f"clamped there {clamped} ... Hz; {local.n_cantilever} such modes, "
        f"{local.n_attachment} attachments, {local.n_interface} shapes of the root",
        f"wheel: the lowest frequency of each nodal diameter at most {100.0 * max(errors):.2g} % "
        "too high",
    ]
    return replace(made, local=local)
