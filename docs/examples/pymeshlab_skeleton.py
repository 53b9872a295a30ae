"""Surface skeletons in pymeshlab: points and triangles, their attributes, saving them.

python pymeshlab_skeleton.py [mesh file]
"""

import sys

import pymeshlab

import medialis
import medialis_meshlab

ms = pymeshlab.MeshSet()
if len(sys.argv) > 1:
    ms.load_new_mesh(sys.argv[1])
else:
    creature = medialis.organic_shape()
    ms.add_mesh(pymeshlab.Mesh(creature.points, creature.faces), "creature")

# One point for each vertex: the center of the largest ball inside that touches the surface there.
result = ms.generate_surface_skeleton(tolerance=pymeshlab.PercentageValue(0.05))
print(result["skeleton_points"], "points, radii up to", result["radius_max"])

# The new layer is the current one. It is coloured by importance, which is its quality as well;
# what bumps make is in an invisible layer of its own (threshold=0 % leaves all in one).
skeleton = ms.current_mesh()
radius = skeleton.vertex_custom_scalar_attribute_array("radius")
angle = skeleton.vertex_custom_scalar_attribute_array("spoke_angle")
print(skeleton.label(), radius.mean(), angle.max())

# Attributes are names in the expressions of MeshLab's own filters.
ms.compute_selection_by_condition_per_vertex(condselect="spoke_angle < 1")
ms.meshing_remove_selected_vertices()
print(ms.current_mesh().vertex_number(), "points with a spoke angle of 1 radian or more")

# The same skeleton as triangles. Filters work on the current layer, so go back to the mesh first.
ms.set_current_mesh(0)
result = ms.generate_surface_skeleton_mesh(min_spoke_angle=60, side="inner")
print(result["faces"], "triangles in", result["pieces"], "pieces; layers:", result["layers"])

# The attributes are saved as well; __ca_vs__radius=False would leave one out.
ms.save_current_mesh("skeleton_mesh.ply")

# All filters and their parameters; help(ms.generate_surface_skeleton_mesh) says more.
medialis_meshlab.print_filter_list()
medialis_meshlab.print_filter_parameter_list("generate_surface_skeleton_mesh")
