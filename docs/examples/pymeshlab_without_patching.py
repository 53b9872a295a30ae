"""A MeshSet of our own instead of patching pymeshlab's; clouds, errors, pictures.

python pymeshlab_without_patching.py [mesh or cloud file]
"""

import sys

import pymeshlab

import medialis
from medialis.show.png import write_png
from medialis_meshset import MeshSet, filter_parameter_values

ms = MeshSet()
if len(sys.argv) > 1:
    ms.load_new_mesh(sys.argv[1])
else:
    creature = medialis.organic_shape()
    ms.add_mesh(pymeshlab.Mesh(creature.points, v_normals_matrix=creature.normals), "cloud")

# A layer without faces is a point cloud; its normals are used, or estimated where it has none.
result = ms.apply_filter("generate_surface_skeleton", subsample=pymeshlab.PercentageValue(1))
print(result["skeleton_points"], result["messages"])

# Errors are MeshLab's, with a sentence that says what to do; nothing has changed then.
ms.set_current_mesh(0)
try:
    ms.generate_surface_skeleton(tolerance=pymeshlab.PercentageValue(50))
except pymeshlab.PyMeshLabException as error:
    print(error)
print(ms.mesh_number(), "layers")

# Defaults can be read, changed and given back.
parameters = filter_parameter_values("get_medial_reconstruction_image")
parameters["size"] = 200
result = ms.get_medial_reconstruction_image(**parameters)
write_png("reconstruction.png", result["images"]["reconstruction"])
