"""Graphs of curves: growth, handles, finishing, simplification."""
