"""The types that stages hand on: frozen dataclasses of read-only arrays, no algorithms.

Size letters everywhere: n surface samples, m triangles, k skeleton points.
"""
