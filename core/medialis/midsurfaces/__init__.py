"""Midsurfaces: the sheets between opposite walls of a solid (not in the thesis)."""
