"""Bodies of an imported model from modes, where the matrices are not known.

Modes are turned into waves toward +X and rescaled to unit modal mass by the modal masses of the file or the user.  Static
receptances do not follow from a few modes, so that contact stiffness must be given as numbers; a damper is rigid.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bdamper.fem.reduced_bodies import Wanted, nodes_of
from bdamper.fem.travelling_waves import Waves, travelling_waves
from bdamper.importers.fe_body import Modes
from bdamper.importers.plausibility import compare_frequencies
from bdamper.importers.prepared_body import PreparedBody, Ring
from bdamper.importers.two_speeds import basis_from_modes
from bdamper.model.rigid_motions import fix_phase, rigid_motions
from bdamper.model.structure import Body, BodyLoad

NO_RECEPTANCE = (
    "static receptances of the {} (no matrices): contact stiffness cannot be derived; give it as numbers "
    "(ContactFaces(stiffness=...), or Study(contact_stiffness=...))"
)


def _waves(body: PreparedBody, modes: Modes, ring: Ring) -> Waves:
    """Waves of one nodal diameter on all nodes of the body, NaN at nodes without values; noted among the checks."""
    d = modes.nodal_diameter
    item = f"modes of nodal diameter {d} ({modes.source or 'given'})"
    shapes = body.shapes(np.asarray(modes.numbers), np.asarray(modes.shapes), item)
    if ring.faces.n_sectors == 1:
        waves = Waves(np.arange(shapes.shape[1]), shapes.real, np.zeros(shapes.shape[1]), 0, 0)
    else:
        known = ~np.isnan(shapes[:, 0].real).reshape(-1, 3).any(axis=1)
        faces = ring.faces.among(known)
        body.require(len(faces.dependent), item, "values at matching nodes of the two sector faces", "none")
        with body.refusing(item, "travelling waves"):
            waves = travelling_waves(np.asarray(modes.frequency, float), np.nan_to_num(shapes), faces, d)
        waves = replace(waves, shapes=np.where(np.repeat(known, 3)[:, None], waves.shapes, np.nan))
    text = f"{body.name}, nodal diameter {d}: {len(waves.index)} modes are waves of it within {waves.mismatch.max():.1g}"
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


def check_reached(body: PreparedBody, wanted: Wanted, absent: NDArray, what: str) -> None:
    """Refuse contact faces and locations at nodes (n,) for which something is absent."""
    places = {"contact faces": wanted.contact.indices // 3}
    places |= {f"location '{name}'": nodes_of(place) for name, place in wanted.locations.items()}
    for item, nodes in places.items():
        wrong = body.given.numbers[np.intersect1d(nodes, absent)]
        body.require(not len(wrong), item, f"nodes with {what}", f"none at {', '.join(map(str, wrong[:5]))}")


def _normalised(body: PreparedBody, d: int, ring: Ring, n_modes: int) -> tuple[NDArray, NDArray]:
    """Lowest modes of a nodal diameter: squared frequencies (n,) and mass-normalised shapes (3 n_nodes, n)."""
    item, given = f"modes of nodal diameter {d}", [modes for modes in body.given.modes if modes.nodal_diameter == d]
    known = [modes.nodal_diameter for modes in body.given.modes]
    body.require(len(given) == 1, "modes", f"modes of nodal diameter {d} once", f"those of {known}")
    modes, waves = given[0], _waves(body, given[0], ring)
    expected = "modal masses (or matrices) to rescale the modes to unit modal mass over one sector"
    body.require(modes.modal_mass is not None, item, expected, "neither")
    mass = body.place.units.mass * np.asarray(modes.modal_mass, float)[waves.index]
    frequency = np.asarray(modes.frequency, float)[waves.index]
    body.require((frequency > 0.0).all(), item, "frequencies > 0 of a held sector", frequency.min(initial=np.inf))
    order = np.argsort(frequency, kind="stable")[:n_modes]
    shapes = fix_phase((waves.shapes / np.sqrt(mass))[:, order], sp.identity(len(waves.shapes), format="csr"))
    return (2.0 * np.pi * frequency[order]) ** 2, shapes


def constrained_from_modes(body: PreparedBody, wanted: Wanted, ring: Ring) -> Body:
    """A sector from its modes at each nodal diameter.

    Raises
    ------
    ModelError
        If modes of a nodal diameter are missing, are no waves of it, or cannot be rescaled.
    """
    bases, faster = {}, body.faster
    for d in ring.diameters:
        omega2, shapes = _normalised(body, d, ring, wanted.n_modes)
        compare_known(body, d, omega2, ring)
        unknown = np.isnan(shapes).reshape(len(body.nodes), -1).any(axis=1)
        check_reached(body, wanted, np.flatnonzero(unknown), "values of the modes")
        if d in ring.pictured:
            body.keep_pictures(d, shapes)
        bases[d] = wanted.basis(omega2, shapes)
        if faster is not None:
            bases[d] = basis_from_modes(body, d, bases[d], shapes, *_normalised(faster, d, ring, len(omega2)))
    body.checks.append(f"{body.name}: modes rescaled, modal mass from the file or the user (not checked)")
    body.missing.append(NO_RECEPTANCE.format(body.name))
    return Body(body.name, "constrained", wanted.ports, bases)


def free_from_modes(body: PreparedBody, wanted: Wanted) -> Body:
    """A rigid damper from mass, centre and inertia.

    Raises
    ------
    ModelError
        If the mass properties are missing or unphysical.
    """
    given, units, q = body.given.rigid, body.place.units, body.place.rotation
    if given is None:
        raise body.error("free body", "matrices, or mass, centre and inertia (MassProperties)", "neither")
    item, expected = "mass properties", "a mass > 0, a centre (3,) and an inertia (3, 3)"
    with body.refusing(item, expected):
        mass = units.mass * float(given.mass)
        centre = units.length * q @ (np.reshape(given.centre, 3) - body.place.origin)
        inertia = units.mass * units.length**2 * q @ given.inertia @ q.T
        moments, principal = np.linalg.eigh(inertia)
    expected += " with principal moments > 0, none larger than the sum of the others"
    solid = moments[0] > 0 and moments[2] <= (moments[0] + moments[1]) * (1 + 1e-6)
    good = mass > 0 and solid and np.isfinite(centre).all()
    body.require(good, item, expected, f"{mass} kg, {moments} kg m2")
    axes = body.damper_axes(centre)
    shapes = rigid_motions(body.nodes, centre, axes, principal.T) / np.sqrt([*3 * [mass], *moments])
    basis = wanted.basis(np.zeros(6), shapes)
    body.missing += [NO_RECEPTANCE.format(body.name), f"elastic deformation of the {body.name} (no matrices)"]
    load = BodyLoad(axes[1], np.eye(6)[1] / np.sqrt(mass), np.zeros((wanted.contact.shape[0] // 3, 3)))
    return Body(body.name, "free", wanted.ports, {0: basis}, mass=mass, centre=centre, inertia=inertia, load=load)
