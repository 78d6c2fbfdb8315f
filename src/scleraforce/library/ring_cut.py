"""Where the plane of a B-scan meets the rings of a surface of revolution.

A surface consists of rings at distance r from the needle axis and depth d below the
undeformed contact. In the frame of `mechanics.contact_and_section.ScanPlane` (gap g,
tilt tau) the point of the plane at lateral X and depth Y lies at X along the lateral
axis, g + Y sin(tau) along the offset, and Y cos(tau) deep. So the plane meets the ring
(r, d) at

    Y = d / cos(tau),   X^2 = r^2 - (g + d tan(tau))^2,

if that is not negative: on both sides of the needle axis alike, whatever the direction
of the plane. A ring that the eye's base has moved (`library.moving_base`) is met where
its motion across the plane has been taken from g; the rest of the motion moves the
point. The fit (`fit.shown_wall`) and slices (`library.plane_cut`) share this, and
differ in how they join the points.
"""

from scleraforce.base.arrays import Floats
from scleraforce.base.compiled_loops import compiled_in_place


@compiled_in_place
def meet_rings(
    curve: Floats, across: Floats, gap_m: float, slope: float, squares: Floats
) -> tuple[int, float]:
    """Write X^2 of rings (ring,), m^2; return the first ring beyond X = 0, and d there.

    `curve` (node, 2) may have more nodes than the rings wanted, those `across` (ring,)
    moves across the plane, m; `slope` is tan(tau). Where the plane misses all rings,
    the first one is their number.
    """
    rings = len(across)
    first = 0

    for ring in range(rings):
        gap = gap_m - across[ring] + slope * curve[ring, 1]
        squares[ring] = curve[ring, 0] ** 2 - gap**2
        if squares[ring] <= 0.0:
            first = ring + 1

    if first == 0 or first == rings:
        return first, curve[0, 1]

    last = first - 1
    rise = squares[first] - squares[last]  # above 0: one side is, the other is not
    share = -squares[last] / rise
    return first, curve[last, 1] + share * (curve[first, 1] - curve[last, 1])
