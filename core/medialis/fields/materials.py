"""How thick moulded walls are, for each plastic, in millimetres.

The ranges that moulding services recommend for injection moulding; several publish the same table,
in inches (0.045 to 0.140 for ABS). They are starting points: grade, flow length and part decide.
Source: Protolabs, "Improving part design with uniform wall thickness"; the same numbers in the
design guidelines of Xcentric Mold and of UpMold.
"""

from __future__ import annotations

INCH = 25.4

_INCHES = {
    "ABS": (0.045, 0.140),
    "LCP": (0.030, 0.120),
    "PA": (0.030, 0.115),
    "PBT/PET": (0.025, 0.125),
    "PC": (0.040, 0.150),
    "PE": (0.030, 0.200),
    "PMMA": (0.025, 0.500),
    "POM": (0.030, 0.120),
    "PP": (0.025, 0.150),
    "PPS": (0.020, 0.180),
    "PS": (0.035, 0.150),
    "PUR": (0.080, 0.750),
}
"""Polyamide is nylon, POM acetal, PMMA acrylic, PBT/PET polyester, LCP liquid crystal polymer."""

MATERIALS = {
    name: (round(low * INCH, 2), round(high * INCH, 2)) for name, (low, high) in _INCHES.items()
}
"""Least and largest thickness of a wall in millimetres."""
