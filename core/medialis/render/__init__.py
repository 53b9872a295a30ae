"""Software renderer: z-buffered balls and triangles, pictures, and thesis 3.4's reconstruction.

It needs no display and no graphics card, so the same pictures come out of tests, the command line
and documentation builds, bit for bit.
"""
