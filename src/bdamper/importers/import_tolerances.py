"""One table of the bounds of all checks of an import, with what each is of and what it was measured on."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Bounds:
    """Bounds of the checks of an import; shares and relative differences where no unit is given."""

    # What no machine has points to mistaken units.
    size: tuple[float, float] = (1e-3, 30.0)
    """Largest extent of a body, m."""
    density: tuple[float, float] = (200.0, 30000.0)
    """Mass over volume, kg/m3."""
    frequency: tuple[float, float] = (0.1, 5e6)
    """Lowest elastic frequency, Hz."""
    wave_speed: tuple[float, float] = (1000.0, 15000.0)
    """Of longitudinal waves in solids of machines, m/s: 2200 in lead and in plastics, 12900 in beryllium."""
    radial_angle: float = 15.0
    """Largest angle (degrees) between ``radial`` and the middle of a narrow sector, for a lean of the blade."""

    # Matrices that belong to their nodes.
    symmetry: float = 1e-6
    """Difference between a matrix and its transpose over its largest entry."""
    rigid_strain: float = 3e-3
    """Strain of a rigid motion: the root of its energy over that of a stretch with the same displacements."""
    rigid_force: float = 0.01
    """Force of a rigid motion on a node, over the sum of the sizes of its parts.  On reference sector and damper at most
    4e-15 in the right order of the rows, 4e-5 with positions rounded to a micrometre; at least 0.1 and at the median 0.4
    to 0.8 in the order of components.  Stress stiffening adds some stress over modulus."""
    odd_ones: float = 0.5
    """Share of the nodes on which there may be such forces (springs to the ground act on few), and of the elements that may
    be twisted (sliver elements of a good mesh are few)."""

    # Two things that should be one.
    same_place: float = 1e-9
    """Distance of nodes at one place over the size of a body."""
    sector_faces: float = 1e-5
    """Distance of matching nodes of the sector faces over the size of the sector: files round positions."""
    tied_faces: float = 1e-4
    """Distance of sector faces whose meshes differ over the size of the sector: one blade of 100 too many is 6e-4."""
    agreement: float = 0.01
    """Difference up to which two programs agree on a frequency, two faces are equal in area, and modes at one speed are
    combinations of those at another."""
    axes: float = 1e-6
    """Product of two directions at right angles, and deviation of their lengths from 1."""

    # Faces that touch.
    overlap: float = 0.05
    """Share of the smaller face that two faces must have in common."""
    distance: float = 0.2
    """Distance of two faces, or gap between them, over the width of what they have in common."""
    misfit: float = 0.02
    """Distance of the meshes of two faces beside the gap that is given, over their width, and lack of overlap of faces that
    are equal in area; more than that draws a warning."""

    # Numbers of things.
    modes: int = 1000
    points: int = 400
    """Contact points on one face; a study with more than some 200 takes minutes."""


BOUNDS = Bounds()
