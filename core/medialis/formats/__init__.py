"""Files in and out that no single feature owns.

In come meshes, point clouds and CAD models: `read_mesh` takes any of them and gives `MeshData`
(meshes.py, then one parser a format: ply, text_meshes for OFF, OBJ and STL, point_texts; step,
three_mf and what trimesh reads in a process with limits, see foreign). Out
go layers of results with named values: PLY without loss (ply_attributes), VTK (vtk), shell models
for solvers (shells), glTF (gltf), and arrays and text (json_npz). What is written appears whole or
not at all: a file by `complete_file` of files.py, a folder by output_folder.py; files are touched
by `base/disk.py` alone.

Read meshes.py first. A new mesh format is a parser that returns a `ParsedMesh`, entered in
meshes.py; a format of one feature belongs to that feature. Sources: the manuals that the modules
name.
"""
