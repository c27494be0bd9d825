"""Checks of a model; each error names one item, the expected and the actual value.

Items have the names of the model file, for files and for models in memory:
``model: /bodies/damper/nd000/omega2: expected ..., found ...``.

Explanation of some conditions:

* **Rigid-body modes.** Let the columns of ``B`` be the exact rigid motions at contact points and
  locations: translations divided by ``sqrt(mass)`` and rotations about the principal axes divided
  by ``sqrt(inertia)``.  They are mass-orthonormal.  Six modes ``Phi`` are rigid, independent
  and mass-normalised if and only if ``Phi = B X`` with ``X`` orthogonal.  Such an ``X`` exists if
  and only if ``Phi Phi^T = B B^T``.
* **Flexibility.** The retained elastic modes contribute ``Phi Omega^-2 Phi^H`` to the static
  receptance.  The remainder belongs to the omitted modes and is positive semi-definite.
* **Nodal diameter 0** describes the mean position, a real displacement, so its modes are real (also
  as a complex array with zero imaginary part).
* The order of the natural frequencies is arbitrary; usually it is ascending.
"""

from __future__ import annotations

import weakref
from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from bdamper.model.kinematics import N_RIGID
from bdamper.model.modal_basis import LocalBasis, SpeedBasis, SpinStatic, rigid_motions
from bdamper.model.structure import Body, BodyLoad, Interface, ModalBasis, Model, StressSet, turn
from bdamper.util.errors import check, check_sentence, mismatch
from bdamper.util.records import (
    ROUNDING,
    SINGLE,
    Sizes,
    check_all,
    check_hermitian,
    check_integer,
    check_record,
    check_type,
    is_positive_definite,
    layout,
)

RIGID_TOLERANCE = 1e-5
STIFFNESS_TOLERANCE = 1e-9
NEAREST_FREQUENCY = 0.05  # relative error of the lowest mode of a local basis with few root shapes

_CHECKED: dict[int, weakref.ref[Model]] = {}


def as_checked(model: Model) -> Model:
    """Mark a model as checked, for models derived from checked ones."""
    key = id(model)
    _CHECKED[key] = weakref.ref(model, lambda _: _CHECKED.pop(key, None))
    return model


def check_model_once(model: Model) -> None:
    """Apply :func:`check_model` unless this object was checked before."""
    if id(model) not in _CHECKED:
        check_model(model)
        as_checked(model)


def check_model(model: Model, *, where: str = "model") -> None:
    """Check that a model is complete and consistent and follows the conventions.

    Parameters
    ----------
    model : Model
    where : str
        Name of the model in messages, for example its file.

    Raises
    ------
    ModelError
        If a condition is violated; the message describes the first violation.
    """
    check(isinstance(model, Model), where, "a Model", type(model).__name__)
    # numbers out of range cause an error, not also a warning
    with np.errstate(all="ignore"):
        _check_head(model, where)
        for name, interface in model.interfaces.items():
            _check_interface(interface, model, f"{where}: /interfaces/{name}")
        for name, body in model.bodies.items():
            _check_ports(body, model, f"{where}: /bodies/{name}")
        for name, interface in model.interfaces.items():
            _check_sides(interface, model, f"{where}: /interfaces/{name}")
        _check_locations(model, where)
        for name, body in model.bodies.items():
            _check_body(body, model, f"{where}: /bodies/{name}")
        _check_optional(model, where)
        for name, stress in model.stress.items():
            _check_stress(stress, model, f"{where}: /stress/{name}")
        _check_provenance(model, where)


# ---- Whole model ----


def _check_head(model: Model, where: str) -> None:
    check_integer(model.n_blades, f"{where}: /@n_blades")
    check(model.n_blades >= 1, f"{where}: /@n_blades", "at least 1", model.n_blades)
    for group in layout(Model):
        if not group.is_record:
            continue
        members = getattr(model, group.name)
        check_type(members, Mapping, f"{where}: /{group.place()}")
        for name, member in members.items():
            item = f"{where}: /{group.place(name)}"
            is_name = isinstance(name, str) and name and name.isprintable()
            is_name = is_name and not set(name) & set("/.")
            check(is_name, item, "a name of printable characters without '/' and '.'", repr(name))
            check_type(member, group.kind, item)
            member_name = getattr(member, "name", name)
            check(member_name == name, item, f"the name '{name}'", repr(member_name))
    check(bool(model.bodies), f"{where}: /bodies", "at least one body", "none")


def _check_interface(interface: Interface, model: Model, item: str) -> None:
    check(np.size(interface.area) > 0, f"{item}/area", "at least one point", "none")
    check_record(interface, Interface, item)
    _check_frame(interface.frame, f"{item}/frame")
    allowed = (0,) if model.n_blades == 1 else (-1, 0, 1)
    expected = f"one of {list(allowed)} (n_blades = {model.n_blades})"
    for side, sector in (("a", interface.sector_a), ("b", interface.sector_b)):
        check(sector in allowed, f"{item}/@sector_{side}", expected, sector)


def _check_frame(frame: NDArray, item: str) -> None:
    """Check the axes (n_points, 3, 3) of contact points; the rows are t1, t2 and n."""
    products = frame @ frame.transpose(0, 2, 1)
    error = np.abs(products - np.eye(3)).max(axis=(1, 2))
    check_all(error <= SINGLE, error, "orthonormal rows t1, t2, n (errors of their products)", item)
    determinant = np.linalg.det(frame)
    check_all(determinant > 0, determinant, "right-handed rows t1, t2, n (determinants)", item)


def _check_ports(body: Body, model: Model, item: str) -> None:
    """Check that the ports of a body are the sides of its interfaces, each of them once.

    The ground may omit ports.
    """
    kinds = ["constrained", "free", "ring", "lumped", "ground"]
    check(body.kind in kinds, f"{item}/@kind", f"one of {kinds}", repr(body.kind))
    item = f"{item}/@ports"
    check_type(body.ports, tuple, item)
    for port in body.ports:
        is_pair = isinstance(port, tuple) and len(port) == 2
        are_texts = is_pair and isinstance(port[0], str) and isinstance(port[1], str)
        is_port = are_texts and port[1] in ("a", "b")
        check(is_port, item, "pairs (interface, 'a' or 'b')", repr(port))

    sides = [(face.name, "a") for face in model.interfaces.values() if face.body_a == body.name]
    sides += [(face.name, "b") for face in model.interfaces.values() if face.body_b == body.name]
    sides.sort()
    agrees = sorted(body.ports) == sides
    if body.kind == "ground":
        agrees = agrees or set(body.ports) <= set(sides)
    expected = f"the sides of interfaces that name this body, {sides}"
    check(agrees, item, expected, f"{list(body.ports)}")
    moves_freely = body.kind == "free" and not body.ports
    check(not moves_freely, item, "at least one contact of a free body", "none")


def _check_sides(interface: Interface, model: Model, item: str) -> None:
    """Check that both sides of an interface are bodies with possible relative motion."""
    body_a = _known_body(interface.body_a, model, f"{item}/@body_a")
    body_b = _known_body(interface.body_b, model, f"{item}/@body_b")
    one_can_move = body_a.kind != "ground" or body_b.kind != "ground"
    check(one_can_move, item, "a body that can move", "ground on both sides")
    different = body_a is not body_b or interface.sector_a != interface.sector_b
    found = f"body '{interface.body_a}' of sector {interface.sector_a} on both sides"
    check(different, item, "two bodies, or one body in two sectors", found)


def _known_body(name: object, model: Model, item: str) -> Body:
    body = model.bodies.get(name) if isinstance(name, str) else None
    if body is None:
        raise mismatch(item, f"a body of {list(model.bodies)}", repr(name))
    return body


def _check_locations(model: Model, where: str) -> None:
    for name, location in model.locations.items():
        item = f"{where}: /locations/{name}"
        check_record(location, type(location), item)
        body = _known_body(location.body, model, f"{item}/@body")
        found = f"'{body.name}', which is ground"
        check(body.kind != "ground", f"{item}/@body", "a body that can move", found)


# ---- Bodies ----


def _check_body(body: Body, model: Model, item: str) -> None:
    check_type(body.bases, Mapping, item)
    if body.kind == "ground":
        found = f"nodal diameters {list(body.bases)}"
        check(not body.bases, item, "no modes of a ground body", found)
        check(body.load is None, f"{item}/load", "no load on a ground body", "one")
        return
    _check_nodal_diameters(body, model, item)
    n_points = _n_points(body, model)
    sizes: Sizes = {"n_points": n_points, "n_forces": 3 * n_points}
    places = [name for name, location in model.locations.items() if location.body == body.name]
    for d, basis in body.bases.items():
        _check_basis(d, basis, body, sizes, places, f"{item}/nd{d:03d}")
    sizes |= {"n_static": body.bases[0].n_modes}
    check_record(body, Body, item, sizes)
    if body.inertia is not None:
        smallest = np.linalg.eigvalsh(body.inertia)[0]
        check(smallest > 0, f"{item}/inertia", "principal moments > 0", f"{smallest:.6g}")
    _check_real(body.bases[0], f"{item}/nd000", body.kind == "lumped")
    if body.is_free:
        for key in ("mass", "centre", "inertia"):
            stored = getattr(body, key) is not None
            check_sentence(stored, f"{item}/{key}", f"the {key} of a free body is missing")
    if body.kind == "free":
        _check_rigid(body, model, f"{item}/nd000")
    if body.load is not None:
        check_record(body.load, BodyLoad, f"{item}/load", sizes)
        length = np.linalg.norm(body.load.direction)
        is_unit = abs(length - 1) <= SINGLE
        check(is_unit, f"{item}/load/direction", "a unit vector", f"length {length:.9g}")
    if body.spin is not None:
        check_record(body.spin, SpinStatic, f"{item}/spin", sizes)
        _check_places(body.spin.locations, places, f"{item}/spin")
    if body.local is not None:
        _check_local(body, body.local, model, f"{item}/wheel", sizes)
        _check_places(body.local.locations, places, f"{item}/wheel")


def _n_points(body: Body, model: Model) -> int:
    return sum(model.interfaces[name].n_points for name, _ in body.ports)


def _check_places(names: Iterable[str], places: Iterable[str], item: str) -> None:
    """Check that data at locations have the names of all locations on the body."""
    check(set(names) == set(places), f"{item}/locations", f"{sorted(places)}", f"{sorted(names)}")


def _check_nodal_diameters(body: Body, model: Model, item: str) -> None:
    largest = 0 if body.kind in ("free", "lumped") else model.n_blades // 2
    for d in body.bases:
        check_integer(d, f"{item} (nodal diameter)")
        expected = f"nodal diameters 0 to {largest} of a {body.kind} body"
        check(0 <= d <= largest, item, f"{expected} (n_blades = {model.n_blades})", d)
    found = f"only {sorted(body.bases)}"
    check(0 in body.bases, f"{item}/nd000", "the modes of nodal diameter 0", found)


def _check_basis(
    d: int, basis: ModalBasis, body: Body, sizes: Sizes, places: list[str], item: str
) -> None:
    check_record(basis, ModalBasis, item, sizes)
    _check_places(basis.locations, places, item)
    n_rigid = _n_rigid(d, basis, body, item)
    check(
        basis.n_natural > 0,
        f"{item}/static_shapes",
        "at least one mode before the static shapes",
        f"{basis.static_shapes} of {basis.n_modes}",
    )
    _check_frequencies(basis.omega2, n_rigid, f"{item}/omega2", lumped=body.kind == "lumped")
    if basis.flexibility is not None:
        modes = basis.contact_modes.reshape(len(basis.flexibility), basis.n_modes)
        elastic = modes[:, n_rigid:]
        rest = basis.flexibility - (elastic / basis.omega2[n_rigid:]) @ elastic.conj().T
        what = "flexibility - Phi Omega^-2 Phi^H (elastic modes)"
        _check_residual(rest, basis.flexibility, f"{item}/flexibility", what)
    if basis.speed is not None:
        item = f"{item}/speed"
        check(not body.is_free, item, "no speed-dependent data on a free body", "a group")
        check(basis.drag is None, item, "no drag on modes that change with speed", "drag")
        check_record(basis.speed, SpeedBasis, item, {**sizes, "n_modes": basis.n_modes})
        _check_speed(basis, basis.speed, item)


def _n_rigid(d: int, basis: ModalBasis, body: Body, item: str) -> int:
    """Return the number of rigid-body modes at nodal diameter d."""
    if body.kind == "free":
        return N_RIGID
    if body.kind != "ring":
        return 0
    n_zero = int((basis.omega2 == 0.0).sum())
    allowed: tuple[int, ...] = (0,)
    # along and about the axis; a split ring also moves radially
    if d == 0:
        allowed = (2, 3)
    # across the axis and tilting
    elif d == 1:
        allowed = (2,)
    expected = f"{' or '.join(map(str, allowed))} rigid-body modes of a ring"
    check(n_zero in allowed, f"{item}/omega2", expected, n_zero)
    enough = basis.n_natural >= N_RIGID
    check(enough, f"{item}/omega2", f"at least {N_RIGID} modes of a ring", basis.n_natural)
    return n_zero


def _check_frequencies(omega2: NDArray, n_rigid: int, item: str, lumped: bool = False) -> None:
    if lumped:
        check_all(omega2 >= 0, omega2, "numbers >= 0", item)
        return
    check(len(omega2) >= n_rigid, item, f"{n_rigid} rigid-body modes first", f"{len(omega2)} modes")
    expected = f"exactly 0 for the {'six' if n_rigid == N_RIGID else n_rigid} rigid-body modes"
    check_all(omega2[:n_rigid] == 0, omega2, expected, item)
    rigid_or_positive = omega2 > 0
    rigid_or_positive[:n_rigid] = True
    check_all(rigid_or_positive, omega2, "numbers > 0 for elastic modes", item)


def _check_residual(rest: NDArray, flexibility: NDArray, item: str, what: str) -> None:
    """Check that the residual part of a static receptance is positive semi-definite.

    ``rest`` (n_forces, n_forces), m/N, is the part of ``flexibility`` of the omitted modes; ``what``
    names it in the message.
    """
    size = np.linalg.norm(flexibility)
    finite = np.isfinite(size) and np.isfinite(rest).all()
    found = f"sizes up to {np.abs(flexibility).max(initial=0.0):.3g}"
    check(finite, item, "numbers whose squares are finite", found)
    # all eigenvalues above -allowed?
    allowed = SINGLE * size
    if is_positive_definite(rest + allowed * np.eye(len(rest))):
        return
    # the quick test may fail by rounding, and the message needs the eigenvalue
    smallest = np.linalg.eigvalsh(0.5 * (rest + rest.conj().T))[0]
    found = f"the eigenvalue {smallest:.3g} m/N, size {size:.3g} m/N"
    check(not smallest < -allowed, item, f"{what} positive semi-definite", found)


def _check_speed(basis: ModalBasis, speed: SpeedBasis, item: str) -> None:
    """Check that the speed-dependent matrices agree with the basis at its speed.

    They give its frequencies and its flexibility.
    """
    # entry (i, j) of the stiffness is compared with omega_i omega_j; rigid-body modes have no size
    smallest = 1e-8 * basis.omega2.max(initial=0.0)
    omega = np.sqrt(np.maximum(basis.omega2, smallest))
    size = np.outer(omega, omega)
    stiffness = speed.stiffness(speed.omega_ref)
    difference = np.abs(stiffness - np.diag(basis.omega2)) / size
    error = difference.max(initial=0.0)
    check(
        error <= STIFFNESS_TOLERANCE,
        f"{item}/stiffness0",
        "stiffness0 + omega_ref^2 stiffness2 = the diagonal matrix of omega2",
        f"a relative difference of {error:.3g}",
    )
    if (speed.residual0 is None) != (speed.residual2 is None):
        missing = "residual0" if speed.residual0 is None else "residual2"
        raise mismatch(f"{item}/{missing}", "residual0 and residual2, or neither", "only one")
    if speed.residual_above is not None and (speed.residual2 is None or speed.middle is None):
        missing = "residual2" if speed.residual2 is None else "middle"
        raise mismatch(f"{item}/{missing}", "it, because residual_above is given", "none")

    residual = speed.residual(speed.omega_ref)
    if residual is None or basis.flexibility is None:
        return
    elastic = basis.omega2 > 0.0
    modes = basis.contact_modes.reshape(len(residual), basis.n_modes)[:, elastic]
    complete = residual + (modes / basis.omega2[elastic]) @ modes.conj().T
    flexibility_size = np.linalg.norm(basis.flexibility) or 1.0
    error = np.linalg.norm(complete - basis.flexibility) / flexibility_size
    check(
        error <= SINGLE,
        f"{item}/residual0",
        "residual0 + omega_ref^2 residual2 + Phi Omega^-2 Phi^H = flexibility",
        f"a relative difference of {error:.3g}",
    )


def _check_real(basis: ModalBasis, item: str, lumped: bool) -> None:
    """Check that the arrays of nodal diameter 0 are real."""
    modes = {"modes": basis.contact_modes}
    # lumped masses may have a complex location: forces on several masses with different phases
    if not lumped:
        for name, values in basis.locations.items():
            modes[f"locations/{name}"] = values
    _check_real_arrays(modes, item)
    if basis.flexibility is not None:
        _check_real_arrays({"flexibility": basis.flexibility}, item)


def _check_real_arrays(arrays: Mapping[str, NDArray], item: str) -> None:
    """Check arrays of one unit, named by their paths, relative to the largest number in all."""
    size = max(np.abs(values).max(initial=0.0) for values in arrays.values())
    for key, values in arrays.items():
        largest = np.abs(values.imag).max(initial=0.0)
        real = largest <= ROUNDING * size
        found = f"imaginary parts up to {largest:.3g}, size {size:.3g}"
        check(real, f"{item}/{key}", "real numbers at nodal diameter 0", found)


# ---- Rigid-body modes ----


def _check_rigid(body: Body, model: Model, item: str) -> None:
    """Check that the first six modes are an orthonormal combination of the rigid motions."""
    basis = body.bases[0]
    exact = _rigid_motions(body, model)
    at_locations = [values[None] for values in basis.locations.values()]
    # contact points, then locations: (n, 3, n_modes)
    modes = np.concatenate([basis.contact_modes, *at_locations])
    stored = modes[:, :, :N_RIGID].real.reshape(-1, N_RIGID)
    if len(stored) == 0:
        return
    item = f"{item}/modes"
    size = np.abs(exact).max()
    finite = np.isfinite(exact).all() and np.isfinite(stored @ stored.T).all() and size > 0
    check(finite, item, "rigid-body modes of finite size", "numbers out of range")

    combination = np.linalg.lstsq(exact, stored, rcond=1e-9)[0]
    error = np.abs(exact @ combination - stored).max(axis=0) / size
    worst = int(np.argmax(error))
    check(
        error[worst] <= RIGID_TOLERANCE,
        item,
        "rigid motions about the centre as the first six modes",
        f"mode {worst} off by {error[worst]:.3g} of the largest rigid motion",
    )
    # orthonormal combinations have the same products
    difference = np.abs(stored @ stored.T - exact @ exact.T).max() / size**2
    check(
        difference <= 4 * RIGID_TOLERANCE,
        item,
        "mass-normalised independent rigid-body modes (Phi Phi^T as from mass, centre, inertia)",
        f"a relative difference of {difference:.3g}",
    )


def _rigid_motions(body: Body, model: Model) -> NDArray:
    """Return mass-orthonormal rigid motions at contact points, then locations, (3 n, 6)."""
    assert body.mass is not None and body.centre is not None and body.inertia is not None
    points = []
    frames = []
    for name, side in body.ports:
        face = model.interfaces[name]
        # the side of the body may be in a neighbouring sector: turn it back to its sector 0;
        # points and axes are rows, for which x R is R^T x
        sector = face.sector_a if side == "a" else face.sector_b
        rotation = turn(2 * np.pi * sector / model.n_blades)
        points.append(face.points @ rotation)
        frames.append(face.frame @ rotation)
    for name in body.bases[0].locations:
        points.append(model.locations[name].position[None])
        frames.append(np.eye(3)[None])
    if not points:
        return np.zeros((0, N_RIGID))
    moments, axes = np.linalg.eigh(body.inertia)
    motions = rigid_motions(np.concatenate(points), body.centre, np.eye(3), axes.T)
    motions /= np.sqrt([body.mass, body.mass, body.mass, *moments])
    along_axes = np.concatenate(frames) @ motions.reshape(-1, 3, N_RIGID)
    return along_axes.reshape(-1, N_RIGID)


# ---- Local bases of mistuned bladed disks ----


def _check_local(body: Body, local: LocalBasis, model: Model, item: str, sizes: Sizes) -> None:
    """Check the local basis of a constrained body and its agreement with the modes of the body.

    By Rayleigh-Ritz its frequencies are not below the modes of the body, and the lowest one is
    close.
    """
    check_type(local, LocalBasis, item)
    expected = "a local basis on constrained bodies only"
    check(body.kind == "constrained", item, expected, f"one on a {body.kind} body")
    check(model.n_blades > 1, item, "a local basis in cyclic structures only", "an acyclic one")
    loaded = body.load is not None or body.constant_force is not None
    check(not loaded, item, "no static load on a body with a local basis", "one")

    check_type(local.blade_stiffness, np.ndarray, f"{item}/blade_stiffness")
    n_diameters = model.n_blades // 2 + 1
    n = len(np.atleast_1d(local.blade_stiffness))
    check_record(local, LocalBasis, item, {**sizes, "n": n, "n_diameters": n_diameters})
    n_roots = local.n_interface
    n_cantilever = local.n_cantilever
    check(
        local.n_attachment >= 0 and n_roots > 0 and n_cantilever > 0,
        item,
        "cantilever modes and root shapes, together at most n",
        f"{n_cantilever} and {n_roots} of n = {local.n}",
    )

    _check_disk(local.disk_stiffness, model.n_blades, f"{item}/disk_stiffness")
    _check_disk(local.disk_mass, model.n_blades, f"{item}/disk_mass")
    _check_cantilever(local, item)
    for d in range(n_diameters):
        expected = "blade and disk positive definite"
        found = f"not at nodal diameter {d}"
        check(is_positive_definite(local.stiffness(d)), f"{item}/disk_stiffness", expected, found)
        check(is_positive_definite(local.mass(d)), f"{item}/disk_mass", expected, found)
    residual = local.residual_flexibility()
    if local.flexibility is not None and residual is not None:
        what = "flexibility less that of the coordinates"
        _check_residual(residual, local.flexibility, f"{item}/flexibility", what)
    for d, basis in body.bases.items():
        _check_local_frequencies(local, d, basis, item)


def _check_local_frequencies(local: LocalBasis, d: int, basis: ModalBasis, item: str) -> None:
    """Check that the local basis has frequencies close to a nodal diameter, and not below."""
    n = basis.n_natural
    omega2 = eigh(local.stiffness(d), local.mass(d), eigvals_only=True)[:n]
    # the local basis may have fewer modes
    exact = np.sort(basis.omega2[:n])[: len(omega2)]
    ratio = np.sqrt(omega2 / exact)
    within = f"{100 * NEAREST_FREQUENCY:g} %"
    check(
        ratio.min() >= 1.0 - SINGLE and ratio[0] <= 1.0 + NEAREST_FREQUENCY,
        item,
        f"frequencies of nd{d:03d} or above, the lowest within {within}",
        f"{ratio[0]:.6g} times the lowest, {ratio.min():.9g} times at least",
    )


def _check_disk(disk: NDArray, n_blades: int, item: str) -> None:
    """Check Hermitian matrices, real at nodal diameters 0 and N/2."""
    for d, matrix in enumerate(disk):
        check_hermitian(matrix, f"{item} at nodal diameter {d}")
        may_be_complex = 2 * d % n_blades > 0
        is_allowed = may_be_complex or not np.any(matrix.imag)
        found = f"imaginary parts up to {np.abs(matrix.imag).max():.3g}"
        check(is_allowed, f"{item} at nodal diameter {d}", "real numbers", found)


def _check_cantilever(local: LocalBasis, item: str) -> None:
    """Check that the cantilever modes have the stiffness omega2 without coupling.

    The stiffness of the blade is positive semi-definite.
    """
    item = f"{item}/blade_stiffness"
    m = local.n_cantilever
    # rows of the cantilever modes: no coupling with other coordinates
    exact = np.zeros((m, local.n))
    exact[:, :m] = np.diag(local.omega2)
    # entry (i, j) is compared with size_i size_j
    diagonal = np.abs(np.diag(local.blade_stiffness))
    size = np.sqrt(np.maximum(diagonal, local.omega2.min()))
    error = np.abs(local.blade_stiffness[:m] - exact) / np.outer(size[:m], size)
    # also true for NaN
    if not error.max() <= ROUNDING:
        row, column = np.unravel_index(error.argmax(), error.shape)
        stored = local.blade_stiffness[row, column]
        raise mismatch(
            item,
            "a diagonal block with omega2 for the cantilever modes",
            f"{stored:.9g} instead of {exact[row, column]:.9g} at ({row}, {column})",
        )
    smallest = np.linalg.eigvalsh(local.blade_stiffness / np.outer(size, size))[0]
    found = f"{smallest:.3g} of its size"
    check(smallest >= -ROUNDING, item, "no negative eigenvalue", found)


# ---- Optional parts ----


def _check_optional(model: Model, where: str) -> None:
    """Check that contact stiffness, static solutions and surfaces have an interface or a body.

    The sizes agree with this owner.
    """
    for group in layout(Model):
        if group.name in ("contact", "static"):
            for name, part in getattr(model, group.name).items():
                item = f"{where}: /{group.place(name)}"
                expected = f"the name of an interface of {list(model.interfaces)}"
                check(name in model.interfaces, item, expected, f"'{name}'")
                n_points = model.interfaces[name].n_points
                check_record(part, group.kind, item, {"n_points": n_points})
        elif group.name == "meshes":
            for name, part in model.meshes.items():
                item = f"{where}: /{group.place(name)}"
                expected = f"the name of a body of {list(model.bodies)}"
                check(name in model.bodies, item, expected, f"'{name}'")
                check_record(part, group.kind, item, {"n_points": 0})
    for name, mesh in model.meshes.items():
        inside = (mesh.quads >= 0) & (mesh.quads < len(mesh.points))
        expected = f"indices 0 to {len(mesh.points) - 1}"
        check_all(inside, mesh.quads, expected, f"{where}: /mesh/{name}/quads")


def _check_stress(stress: StressSet, model: Model, item: str) -> None:
    """Check body, nodal diameters and number of modes of a stress set."""
    bodies = {}
    for name, body in model.bodies.items():
        if body.kind in ("constrained", "lumped"):
            bodies[name] = body
    expected = f"a constrained body of {list(bodies)}"
    check(stress.body in bodies, f"{item}/@body", expected, repr(stress.body))
    body = bodies[stress.body]
    check_record(stress, StressSet, item, {"n_forces": 3 * _n_points(body, model)})
    check(len(stress) > 0, f"{item}/points", "at least one point", "none")

    diameters = sorted(stress.modes)
    in_bases = 0 in stress.modes and set(stress.modes) <= set(body.bases)
    expected = f"nodal diameter 0 and others of {sorted(body.bases)}"
    check(in_bases, f"{item} (nodal diameters)", expected, diameters)
    paired = not stress.contact or set(stress.contact) == set(stress.modes)
    of_contact = sorted(stress.contact)
    check(paired, f"{item} (nodal diameters of contact)", f"{diameters}", of_contact)
    for d, of_modes in stress.modes.items():
        shape = (len(stress), 6, body.bases[d].n_modes)
        fits = of_modes.shape == shape
        check(fits, f"{item}/nd{d:03d}/mode_stress", f"shape {shape}", of_modes.shape)


def _check_provenance(model: Model, where: str) -> None:
    item = f"{where}: /provenance"
    check_type(model.provenance, Mapping, item)
    for key, value in model.provenance.items():
        entry = f"{key!r}: {value!r}"
        check(isinstance(key, str) and isinstance(value, str), item, "texts", entry)
        text = key + value
        in_utf8 = text.encode(errors="ignore").decode() == text
        is_storable = key and "\0" not in text and in_utf8
        check(is_storable, item, "named texts that UTF-8 can hold, without NUL", entry)
        size = len(value.encode())
        most = 60000  # bytes; an HDF5 attribute with its name has at most 64 KiB
        found = f"{size} bytes in '{key[:40]}'"
        check(size + len(key.encode()) <= most, item, f"texts of at most {most} bytes", found)
