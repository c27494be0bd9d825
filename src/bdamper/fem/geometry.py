r"""Dimensions of the reference sector and of its wedge damper, and the contact planes (paper, Figs. 2 and 3).

Axes of the blade: X tangential (toward the next sector), Y radial, Z along the axis.  One pitch is
:math:`\gamma = 2\pi/N`.  The rotation

.. math:: R = R_z(-\gamma) = \begin{bmatrix}\cos\gamma & \sin\gamma & 0\\ -\sin\gamma & \cos\gamma & 0\\
          0 & 0 & 1\end{bmatrix}

turns +Y toward +X, so it carries sector k onto sector k+1.  The axes of the damper are those of the blade
turned by half a pitch, :math:`Q = R_z(-\gamma/2)`, so that the damper stands between blade 0 and blade 1.

Cross-section of the damper in its own axes (x, y), ``r`` the radius of its ridge, ``w`` the width of the
ridge, ``l`` the length of a face, ``a`` the angle of the faces from the radial axis, ``h`` the height of its
body::

            (-w/2, r) ____ (w/2, r)            left face:  p(s) = (-w/2 - s sin a, r - s cos a),  0 <= s <= l
                     /    \                    right face: its mirror image
                    /      \
    p(l) on the left        p(l) on the right
                   |        |
                   |________|  h below the eaves

The underside of the platform of blade 0 lies in the plane of the left face and reaches from the edge of the
platform (``c`` the clearance between two platforms, so ``x = -c/2``) down to the shank.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bdamper.model.structure import turn

__all__ = ["Geometry", "Material", "paper_geometry", "turn"]


@dataclass(frozen=True)
class Material:
    """Isotropic linear elastic material.

    Parameters
    ----------
    youngs_modulus : float, Pa
    poisson_ratio : float
    density : float, kg/m3
    """

    youngs_modulus: float = 2.1e11
    poisson_ratio: float = 0.3
    density: float = 7850.0


@dataclass(frozen=True)
class Geometry:
    """Dimensions of one sector and of the damper; lengths in m, angles in rad.

    Parameters
    ----------
    n_blades : int
    bore_radius, rim_radius, axial_length : float
        Disk segment; shank and platform have the same axial length.
    shank_width : float
    face_angle : float
        Angle of the contact faces from the radial axis (alpha = beta).
    face_length, face_width : float
        Contact face of the damper along the slope and along the axis.
    ridge_radius, ridge_width : float
    damper_body_height : float
        From the eaves to the flat bottom of the damper.
    platform_clearance, platform_edge_thickness : float
    airfoil_height, root_chord, tip_chord, root_thickness, tip_thickness, camber, twist : float
        The chord lies along the axis at the root and turns by ``twist`` about Y toward the tip.
    end_gap : float
        Clearance between each end face of the damper and its axial stop.
    """

    n_blades: int = 65
    bore_radius: float = 0.300
    rim_radius: float = 0.400
    axial_length: float = 0.040
    shank_width: float = 0.011
    face_angle: float = np.pi / 3
    face_length: float = 0.012
    face_width: float = 0.036
    ridge_radius: float = 0.4415
    ridge_width: float = 0.001
    damper_body_height: float = 0.00807
    platform_clearance: float = 0.001
    platform_edge_thickness: float = 0.003
    airfoil_height: float = 0.175
    root_chord: float = 0.034
    tip_chord: float = 0.028
    root_thickness: float = 0.013
    tip_thickness: float = 0.0048
    camber: float = 0.004
    twist: float = np.pi / 6
    end_gap: float = 2.0e-4

    def __post_init__(self) -> None:
        if self.ridge_width < self.platform_clearance:
            widths = f"ridge_width {self.ridge_width} m is less than platform_clearance {self.platform_clearance} m"
            raise ValueError(f"the contact face must lie under the platform: {widths}")

    @property
    def pitch(self) -> float:
        """Angle of one sector, rad."""
        return 2.0 * np.pi / self.n_blades

    def face_points(self, s: NDArray) -> NDArray:
        """Points (n, 2) of the left face plane in the damper's axes, ``s`` (n,) metres below the ridge."""
        s, a = np.asarray(s, float), self.face_angle
        return np.stack([-0.5 * self.ridge_width - s * np.sin(a), self.ridge_radius - s * np.cos(a)], axis=-1)

    def underside_points(self, s: NDArray) -> NDArray:
        """The same points (n, 2) in the axes of blade 0: its right underside."""
        return self.face_points(s) @ turn(0.5 * self.pitch)[:2, :2].T

    @property
    def underside_range(self) -> tuple[float, float]:
        """Distances below the ridge at which the underside meets the platform's edge and the shank, m."""
        edge = 0.5 * (self.platform_clearance - self.ridge_width) / np.sin(self.face_angle)
        # Along the slope the blade's x falls linearly with s, so one linear equation gives the shank's
        # corner.
        x0, x1 = self.underside_points(np.array([0.0, 1.0]))[:, 0]
        shank = (0.5 * self.shank_width - x0) / (x1 - x0)
        return float(edge), float(shank)


def paper_geometry() -> Geometry:
    """A sector on which the method of the paper finds what the paper reports in sections 4.1.1 and 4.1.3.

    A stiff shank, a thick blade with little twist and a small damper give the frequency shifts of its Figs 8 and 9;
    with more twist mode 2 would open the contacts.  All lengths are scaled so that the first frequency without
    dampers is 263 Hz: its Fig. 16 has the resonance of 5 kN at 308.3 Hz, which the shift of 17.2 % takes there.
    """
    lengths: dict[str, Any] = {
        "bore_radius": 262.144, "rim_radius": 400.0, "axial_length": 35.319, "shank_width": 9.446, "face_length": 10.047,
        "face_width": 33.705, "ridge_radius": 414.784, "ridge_width": 3.0, "damper_body_height": 4.0,
        "platform_clearance": 1.0, "platform_edge_thickness": 4.727, "airfoil_height": 170.404, "root_chord": 33.553,
        "tip_chord": 29.038, "root_thickness": 17.036, "tip_thickness": 9.449, "camber": 1.0, "end_gap": 0.2,
    }  # fmt: skip
    scale = 1.369e-3
    return Geometry(face_angle=0.872094, twist=0.06, **{name: scale * value for name, value in lengths.items()})
