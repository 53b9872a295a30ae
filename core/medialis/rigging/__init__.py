"""Bones along a curve skeleton, and the weights with which they move the surface.

In: a `CurveSkeleton`, with the map from the surface for the weights; or a mesh and an `Armature`.
Out: `Bones`, `SkinWeights`.
The thesis has no rigging; it names armatures as a use of curve skeletons.

- `bones.py`: the results, bones from joint to joint, and weights by the map from the surface,
  smoothed along it; read it first.
- `limbs.py`: limbs of the tree of shortest paths, their joints, pairs of mirrored limbs.
- `figures.py`: which limbs are the arms, legs, head and tail of a biped or quadruped.
- `anatomy.py`: where the joints of such limbs are, and the plane of symmetry of a surface.
- `figure_bones.py`: the bones of a figure, with the names of its parts.
- `naming.py`: how bones are turned, and what programs call those of figures. Other names are an
  entry of `TARGETS` and a choice of the operation.
- `operation.py`: the operation armature, and rigged glTF.
- `binding.py`: weights for any `Armature` and any mesh, by the ways inside the body;
  `_way_kernels.py` searches them, `deforming.py` knows the bones that deform, `pieces.py` brings
  weights to loose pieces, `armature.py` reads and writes armatures, and
  `binding_operation.py` is the operation bind.
- `poses.py`: where a rig is bent to try it, and what stretches or collapses there.
"""
