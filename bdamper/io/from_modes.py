"""Bodies of an imported model from modes, where the matrices are not known.

Modes are turned into waves toward +X and rescaled to unit modal mass, by the mass matrix if there is one, else by the
modal masses of the file or the user.  Static receptances do not follow from a few modes: they are absent unless the user
brings unit-load columns (:class:`bdamper.io.Receptance`); contact stiffness must then be given as numbers.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bdamper.io.fe_body import MassProperties, Modes
from bdamper.io.over_speed import basis_from_modes
from bdamper.io.plausible import compare_frequencies
from bdamper.io.prepare import PreparedBody, Ring
from bdamper.model.model import Body, BodyLoad
from bdamper.reduction.bodies import Wanted, nodes_of
from bdamper.reduction.cyclic import fix_phase
from bdamper.reduction.free_body import rigid_motions
from bdamper.reduction.waves import Waves, farthest_pair, travelling_waves

NO_RECEPTANCE = (
    "static receptances of the {name} (no matrices): contact stiffness cannot be derived; give it as numbers "
    "(ContactFaces(stiffness=...), or Study(contact_stiffness=...)), or bring unit-load columns (Receptance)"
)


def _waves(body: PreparedBody, modes: Modes, ring: Ring) -> Waves:
    """Waves of one nodal diameter on all nodes of the body, NaN at nodes without values; noted among the checks."""
    d = modes.nodal_diameter
    item = f"modes of nodal diameter {d} ({modes.source or 'given'})"
    shapes = body.shapes(np.asarray(modes.numbers), np.asarray(modes.shapes), item)
    if ring.n_blades == 1:
        waves = Waves(np.arange(shapes.shape[1]), shapes.real, np.zeros(shapes.shape[1]), 0, 0)
    else:
        known = ~np.isnan(shapes[:, 0].real).reshape(-1, 3).any(axis=1)
        faces = ring.faces.among(known)
        body.require(len(faces.dependent), item, "values at matching nodes of the two sector faces", "none")
        plain = np.nan_to_num(shapes)
        try:
            waves = travelling_waves(np.asarray(modes.frequency, float), plain, faces, d)
        except ValueError as error:
            k = farthest_pair(plain, faces, d)
            pair = faces.independent[int(faces.weights[k].argmax())], faces.dependent[k]
            place = "most at nodes {} and {}".format(*body.given.numbers[list(pair)])
            raise body.error(item, "travelling waves", f"{error}; {place}") from error
        out = np.array(waves.shapes)
        out[np.repeat(~known, 3)] = np.nan
        waves = replace(waves, shapes=out)
    text = f"{body.name}, nodal diameter {d}: {len(waves.index)} modes of the file are waves of it within "
    text += f"{waves.mismatch.max():.1g}"
    if waves.turned:
        text += f"; {waves.turned} of them went the other way and were turned"
    if waves.combined:
        text += f"; {waves.combined} were made of pairs of real shapes"
    body.checks.append(text)
    return waves


def compare_known(body: PreparedBody, d: int, omega2: NDArray, ring: Ring) -> None:
    """Compare modes at a nodal diameter with what is known of them.

    With frequencies that the user expects; with modes of a file beside the matrices, and whether these are waves.
    """
    found, item = np.sqrt(np.maximum(omega2, 0.0)) / (2.0 * np.pi), f"{body.name}, nodal diameter {d}"
    known = [(np.asarray(body.expected[d], float), "expected_frequencies")] if d in body.expected else []
    for modes in body.given.modes if body.has_matrices else ():
        if modes.nodal_diameter == d:
            with body.compared():
                index = _waves(body, modes, ring).index
                known.append((np.asarray(modes.frequency, float)[index], modes.source or "the modes"))
    for expected, source in known:
        with body.compared():
            error = compare_frequencies(found, expected, item, source)
            body.checks.append(f"{item}: frequencies agree with {source} to {100 * error:.2g} %")


def _modal_mass(body: PreparedBody, modes: Modes, waves: Waves) -> tuple[NDArray, str]:
    """Modal mass of each wave over one sector in kg, and where it comes from."""
    if body.given.mass is not None and body.given.stiffness is not None:  # a table of rows comes with both only
        shapes = np.nan_to_num(waves.shapes)
        mass = body.structure.mass
        return np.einsum("ij,ij->j", shapes.conj(), mass @ shapes).real, "the mass matrix"
    if modes.modal_mass is not None:
        mass = body.place.units.mass * np.asarray(modes.modal_mass, float)
        return mass[waves.index], "the file or the user (not checked)"
    expected = "modal masses (or matrices) to rescale the modes to unit modal mass over one sector"
    raise body.error(f"modes of nodal diameter {modes.nodal_diameter}", expected, "neither")


def _check_known(body: PreparedBody, wanted: Wanted, shapes: NDArray) -> None:
    """The modes have values at the contact faces and locations."""
    unknown = np.isnan(shapes).any(axis=1)
    wrong = np.intersect1d(wanted.contact.indices, np.flatnonzero(unknown))
    if len(wrong):
        number = body.given.numbers[wrong[0] // 3]
        raise body.error("contact faces", "values of the modes at its nodes", f"none at node {number}")
    for name, place in wanted.locations.items():
        known = not unknown.reshape(-1, 3)[nodes_of(place)].any()
        body.require(known, f"location '{name}'", "values of the modes at its node", "none")


def _flexibility(body: PreparedBody, contact: sp.csr_matrix, d: int) -> NDArray | None:
    """Receptance between contact points from unit-load columns of the user."""
    given = [r for r in body.given.receptances if r.nodal_diameter == d]
    if not given:
        return None
    numbers, matrix = np.asarray(given[0].numbers), np.asarray(given[0].matrix)
    item = f"receptance of nodal diameter {d}"
    shape = (3 * len(numbers), 3 * len(numbers))
    body.require(matrix.shape == shape and np.isfinite(matrix).all(), item, f"finite numbers {shape}", matrix.shape)
    nodes = body.index(numbers, item)
    columns = (3 * nodes[:, None] + np.arange(3)).ravel()
    outside = np.setdiff1d(np.unique(contact.indices), columns)
    if len(outside):
        number = body.given.numbers[outside[0] // 3]
        raise body.error(item, "columns for all nodes of the contact faces", f"none for node {number}")
    turned = sp.kron(sp.identity(len(nodes)), sp.csr_matrix(body.place.rotation), format="csr")
    rows = contact[:, columns] @ turned
    flexibility = rows @ matrix @ rows.toarray().T / body.place.units.mass
    scale = np.abs(flexibility).max(initial=0.0)
    if np.abs(flexibility - flexibility.conj().T).max(initial=0.0) > 1e-4 * scale:
        raise body.error(item, "a Hermitian matrix (unit forces in, displacements out)", "another")
    if d == 0:
        flexibility = flexibility.real
    return 0.5 * (flexibility + flexibility.conj().T)


def _by_diameter(body: PreparedBody) -> dict[int, Modes]:
    diameters = [modes.nodal_diameter for modes in body.given.modes]
    body.require(len(set(diameters)) == len(diameters), "modes", "each nodal diameter once", diameters)
    return dict(zip(diameters, body.given.modes))


def _normalised(
    body: PreparedBody, given: Mapping[int, Modes], d: int, ring: Ring, n_modes: int
) -> tuple[NDArray, NDArray, str]:
    """Lowest modes of a nodal diameter: omega2, mass-normalised shapes on all nodes, and where the modal mass is from."""
    body.require(d in given, "modes", f"modes of nodal diameter {d}", f"those of {sorted(given)}")
    modes = given[d]
    waves = _waves(body, modes, ring)
    mass, source = _modal_mass(body, modes, waves)
    body.require(np.all(mass > 0.0), f"modes of nodal diameter {d}", "modal masses > 0", mass)
    frequency = np.asarray(modes.frequency, float)[waves.index]
    item = f"modes of nodal diameter {d}"
    body.require((frequency > 0.0).all(), item, "frequencies > 0 of a held sector", frequency.min(initial=np.inf))
    order = np.argsort(frequency, kind="stable")[:n_modes]
    shapes = fix_phase((waves.shapes / np.sqrt(mass))[:, order], sp.identity(len(waves.shapes), format="csr"), True)
    return (2.0 * np.pi * frequency[order]) ** 2, shapes, source


def constrained_from_modes(body: PreparedBody, wanted: Wanted, ring: Ring) -> Body:
    """A sector from its modes at each nodal diameter.

    Raises
    ------
    ModelError
        If modes of a nodal diameter are missing, are no waves of it, or cannot be rescaled.
    """
    faster = [PreparedBody(body.name, other, body.place) for other in body.given.other_speeds]
    given, *of_others = [_by_diameter(own) for own in (body, *faster)]
    bases, source = {}, ""
    for d in ring.diameters:
        omega2, shapes, source = _normalised(body, given, d, ring, wanted.n_modes)
        compare_known(body, d, omega2, ring)
        _check_known(body, wanted, shapes)
        if d in ring.pictured:
            body.keep_pictures(d, shapes)
        bases[d] = wanted.basis(omega2, shapes, _flexibility(body, wanted.contact, d))
        if faster:
            others = [
                (own.given.rotor_speed, *_normalised(own, theirs, d, ring, len(omega2))[:2])
                for own, theirs in zip(faster, of_others)
            ]
            bases[d] = basis_from_modes(body, d, bases[d], shapes, others)
    body.checks.append(f"{body.name}: modes rescaled to unit modal mass over one sector, modal mass from {source}")
    without = [d for d, basis in bases.items() if basis.flexibility is None]
    if without:
        body.missing.append(NO_RECEPTANCE.format(name=body.name) + f"; nodal diameters {without}")
    return Body(body.name, "constrained", wanted.ports, bases)


def _mass_properties(body: PreparedBody, given: MassProperties) -> MassProperties:
    """In SI units and in the axes of the model."""
    q, u = body.place.rotation, body.place.units
    inertia = np.asarray(given.inertia, float)
    centre = np.asarray(given.centre, float)
    good = inertia.shape == (3, 3) and centre.shape == (3,) and np.isfinite([*inertia, centre]).all()
    found = f"{centre.shape}, {inertia.shape}"
    body.require(good, "mass properties", "a centre (3,) and an inertia (3, 3)", found)
    moments = np.linalg.eigvalsh(inertia)
    good = given.mass > 0 and moments[0] > 0 and moments[2] <= (moments[0] + moments[1]) * (1 + 1e-6)
    expected = "a mass > 0 and principal moments > 0, none larger than the sum of the others"
    body.require(good, "mass properties", expected, f"{given.mass}, {moments}")
    return MassProperties(
        float(given.mass) * u.mass, u.length * q @ (centre - body.place.origin), u.mass * u.length**2 * q @ inertia @ q.T
    )


def free_from_modes(body: PreparedBody, wanted: Wanted) -> Body:
    """A damper from mass, centre, inertia and, if there are any, elastic modes.

    Raises
    ------
    ModelError
        If the mass properties are missing or unphysical, or the modes cannot be rescaled.
    """
    if body.given.rigid is None:
        raise body.error("free body", "matrices, or mass, centre and inertia (MassProperties)", "neither")
    rigid = _mass_properties(body, body.given.rigid)
    axes = body.damper_axes(rigid.centre)
    moments, principal = np.linalg.eigh(rigid.inertia)
    motion = rigid_motions(body.nodes, rigid.centre, axes)
    motion[:, :3] /= np.sqrt(rigid.mass)
    motion[:, 3:] = rigid_motions(body.nodes, rigid.centre, principal.T)[:, 3:] / np.sqrt(moments)
    elastic, omega2 = _elastic_modes(body, wanted.n_modes - 6)
    omega2 = np.concatenate([np.zeros(6), omega2])
    shapes = np.hstack([motion, elastic])
    _check_known(body, wanted, shapes)
    flexibility = _flexibility(body, wanted.contact, 0)
    generalised = np.zeros(len(omega2))
    generalised[1] = rigid.mass**-0.5
    body.missing.append(f"elastic deformation of the {body.name} by its own load (no matrices): taken as zero")
    if flexibility is None:
        body.missing.append(NO_RECEPTANCE.format(name=body.name))
    basis = wanted.basis(omega2, shapes, flexibility)
    load = BodyLoad(axes[1], generalised, np.zeros((wanted.contact.shape[0] // 3, 3)))
    return Body(
        body.name, "free", wanted.ports, {0: basis}, mass=rigid.mass, centre=rigid.centre, inertia=rigid.inertia, load=load
    )


def _elastic_modes(body: PreparedBody, n_modes: int) -> tuple[NDArray, NDArray]:
    """Mass-normalised elastic modes (3 n_nodes, n) of the first set of modes, and their omega2 (n,); none without one."""
    if not body.given.modes:
        return np.zeros((3 * len(body.nodes), 0)), np.zeros(0)
    modes = body.given.modes[0]
    frequency = np.asarray(modes.frequency, float)
    elastic = np.flatnonzero(frequency > 1e-3 * frequency.max(initial=0.0))[:n_modes]
    body.require(modes.modal_mass is not None, "modes", "modal masses to rescale them", "none")
    mass = body.place.units.mass * np.asarray(modes.modal_mass, float)[elastic]
    shapes = body.shapes(np.asarray(modes.numbers), np.asarray(modes.shapes)[:, :, elastic].real, "modes")
    return shapes / np.sqrt(mass), (2.0 * np.pi * frequency[elastic]) ** 2
