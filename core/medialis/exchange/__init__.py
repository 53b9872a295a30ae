"""What speaks with other libraries: their objects in and out, as files that other programs read.

`libraries` turns results into meshes of trimesh, PyVista, Open3D and meshio, graphs of networkx,
neurons of navis and tables of pandas, and graphs and neurons back into curve skeletons; read it
first: what can be drawn at all is `Drawn.of`. `write_mesh` writes them in mesh formats.
`label_volumes` makes shapes of labelled volumes (images of nibabel and SimpleITK, arrays).
No library is imported before it is asked for, and none is needed: one that is missing is one
sentence with what to install (`library`). What reads a shape from a path, arrays or a foreign mesh
is `medialis.shape.reading`. Another library: a function `to_NAME` that begins with `Drawn.of`, its
name in `medialis/__init__.pyi`, and a test in `tests/exchange/test_other_libraries.py`.
"""
