"""Places of DXF entities in space, and the drawing as it is seen from above.

Z is left out: a circle that leans is seen as the ellipse that it looks like.
"""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jcontour.geometry.drawings.affine import Planar
from jcontour.geometry.drawings.dxf_tags import Entity, Point

STEEP = 1 / 64  # of an extrusion's x and y: below, the y axis helps to find its own x axis
EXTRUSION, ABOVE = 210, (0.0, 0.0, 1.0)


class Placement(NamedTuple):
    """p -> axes p + origin, from a block's or an entity's own system to the drawing [m]."""

    axes: Float[np.ndarray, "3 3"]
    origin: Float[np.ndarray, " 3"]

    def seen(self, point: Point) -> Planar:
        """Where a point is seen from above."""
        (a, b, c), (d, e, f) = self.axes[:2].tolist()
        x, y, z = point
        return complex(
            a * x + b * y + c * z + self.origin[0], d * x + e * y + f * z + self.origin[1]
        )

    def seen_direction(self, direction: Point) -> Planar:
        """How a difference of two points is seen from above."""
        return self._replace(origin=np.zeros(3)).seen(direction)

    def of(self, inner: "Placement") -> "Placement":
        """Place of what is placed within this one."""
        return Placement(self.axes @ inner.axes, self.axes @ inner.origin + self.origin)


def scaled(unit: float) -> Placement:
    """The drawing itself, in units of so many metres."""
    return Placement(unit * np.eye(3), np.zeros(3))


def own_system(entity: Entity) -> Placement:
    """System of an entity in that of its drawing or block (OCS), by its extrusion.

    Autodesk's "arbitrary axis algorithm": the x axis is at right angles to the extrusion and to
    the drawing's z, or y where the extrusion is nearly along z.
    """
    x, y, z = entity.point(EXTRUSION, ABOVE)
    length = math.hypot(x, y, z)
    if (x, y) == (0.0, 0.0) and z > 0 or not (1e-100 < length < 1e100):
        return Placement(np.eye(3), np.zeros(3))
    normal = np.array([x, y, z]) / length
    helper = [0.0, 1.0, 0.0] if max(abs(normal[0]), abs(normal[1])) < STEEP else [0.0, 0.0, 1.0]
    along = np.cross(helper, normal)
    along /= np.linalg.norm(along)
    return Placement(np.stack([along, np.cross(normal, along), normal], axis=1), np.zeros(3))


def inserted(insert: Entity, base: Point, column: int, row: int) -> Placement:
    """Place of a block that an INSERT puts into the drawing, in one cell of its array."""
    own = own_system(insert)
    angle = math.radians(insert.number(50, 0.0))
    cos, sin = math.cos(angle), math.sin(angle)
    turned = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    scale = np.diag([insert.number(code, 1.0) for code in (41, 42, 43)])
    cell = np.array([column * insert.number(44, 0.0), row * insert.number(45, 0.0), 0.0])
    axes = own.axes @ turned @ scale
    origin = own.axes @ (np.array(insert.point(10)) + turned @ cell)
    return Placement(axes, origin - axes @ np.array(base))
