"""A damper taken apart: several free bodies side by side that together are the one of a model."""

from dataclasses import replace

import numpy as np

from bdamper.model.structure import BodyLoad


def split_damper(model, shares):
    """The model with bodies of these shares, which sum to 1, of the damper's mass, load and contact areas.

    Each has the damper's motions: modes of ``share`` times the mass are those of the whole over the root of the share.
    """
    faces, places = {}, {}
    for name, face in model.interfaces.items():
        parts = (
            {"": 1.0}
            if "damper" not in (face.body_a, face.body_b)
            else {f"_{key}": s for key, s in shares.items()}
        )
        places[name] = [name + key for key in parts]
        for key, share in parts.items():
            ends = {end: getattr(face, end) for end in ("body_a", "body_b")}
            bodies = {end: key[1:] if body == "damper" else body for end, body in ends.items()}
            faces[name + key] = replace(face, name=name + key, area=share * face.area, **bodies)

    def repeated(body):
        """Ports of a neighbour, and which of its contact points stand at them."""
        ports, rows = [], []
        for name, side in body.ports:
            own = np.arange(len(body.bases[0].contact_modes))[
                model.port_slice(body.name, (name, side))
            ]
            for copy in places[name]:
                ports.append((copy, side))
                rows.extend(own)
        return tuple(ports), np.array(rows, int)

    bodies = {}
    for name, body in model.bodies.items():
        if name == "damper":
            bodies |= {key: _part(body, key, share) for key, share in shares.items()}
            continue
        if not body.bases:
            bodies[name] = replace(
                body,
                ports=tuple((copy, side) for port, side in body.ports for copy in places[port]),
            )
            continue
        ports, rows = repeated(body)
        three = (3 * rows[:, None] + np.arange(3)).ravel()
        bases = {
            d: replace(
                basis, speed=None, contact_modes=basis.contact_modes[rows],
                flexibility=None if basis.flexibility is None else basis.flexibility[np.ix_(three, three)],
            )
            for d, basis in body.bases.items()
        }  # fmt: skip
        bodies[name] = replace(body, ports=ports, bases=bases, spin=None, local=None)
    locations = {name: at for name, at in model.locations.items() if at.body != "damper"}
    return replace(
        model,
        bodies=bodies,
        interfaces=faces,
        locations=locations,
        contact={},
        static={},
        meshes={},
        stress={},
    )


def _part(damper, key, share):
    root, basis = np.sqrt(share), damper.bases[0]
    modes = replace(
        basis, speed=None, contact_modes=basis.contact_modes / root, locations={},
        flexibility=None if basis.flexibility is None else basis.flexibility / share,
    )  # fmt: skip
    load = damper.load
    own = BodyLoad(load.direction, load.generalised / root, load.displacement / share)
    ports = tuple((f"{name}_{key}", side) for name, side in damper.ports)
    return replace(
        damper,
        name=key,
        ports=ports,
        bases={0: modes},
        mass=share * damper.mass,
        inertia=share * damper.inertia,
        load=own,
    )
