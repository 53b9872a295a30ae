"""Poses that try a rig: bent at each main joint, and what of the surface stretches or collapses.

`test_poses` says where a rig bends: at the joints that its names tell (those of this project and of
the programs in `naming.py`), elbows and knees the way they are bent already (`_by_names`); else at
the largest joints (`_by_size`). `strains` bends the surface there by its own weights, as programs
do (linear blending), and counts edges that grow and triangles that shrink to nothing or turn over.
`tried` is both for operations: values, sentences, and the panels of a picture.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from medialis.base.arrays import corner_vectors, twice_areas, unit_rows
from medialis.base.progress import Progress
from medialis.base.validation import Directions, FloatArray, IntArray, Positions
from medialis.operations.result import Layer
from medialis.rigging.armature import Armature
from medialis.rigging.bones import Bones, SkinWeights
from medialis.rigging.figures import ACROSS_TRUNK
from medialis.rigging.naming import BENT, TARGETS
from medialis.shape.shape import Shape

WORDS = (
    *("hips", "spine", "chest", "neck", "head"),
    *(
        word + mark
        for word in ("shoulder", "upper_arm", "forearm", "hand", "thigh", "shin", "foot", "toe",
                     "front_thigh", "front_shin", "front_foot", "front_toe")
        for mark in (".L", ".R")
    ),
    *("tail", "tail.001", "tail.002", "ear.L", "ear.R"),
)  # fmt: skip
"""Parts of figures, by which names are known."""

PREFIX, VROID = re.compile(r"^(mixamorig\d*_?|DEF-|ORG-|MCH-)"), re.compile(r"^J_Bip_([LRC])_")
"""What programs write before the names of bones."""

FEW_NAMES = 6
"""Parts that a rig names at least, for its names to be believed."""

JOINTS = (
    ("elbows", ("forearm", "front_shin"), "ahead", 80.0),
    ("shoulders", ("upper_arm", "front_thigh"), "ahead", 50.0),
    ("knees", ("shin",), "behind", 80.0),
    ("hips", ("thigh",), "ahead", 50.0),
    ("neck", ("neck",), "", 35.0),
    ("spine", ("spine",), "", 35.0),
)
"""Joints of figures: the bones that turn there, which way they go, and degrees. Neck and spine bend
about the axis across the body, as for a bow."""

CLEARLY_BENT = 0.3
"""Sine of the bend of an elbow or knee from which on it goes on bending that way: 17 degrees."""

MOST_POSES, ANGLE = 6, 50.0
"""Joints that rigs without such names are bent at, and degrees."""

STRETCHED = 2.0
"""Times its length to which an edge grows that counts. On a person, an armadillo and a pig with the
weights of `bind` 99.9 % of the edges at a joint stay below 1.2 to 2.3 of their length."""

COLLAPSED = 0.1
"""Share of its area to which a triangle shrinks that counts; there at most 26 of 49,000 did."""


PARTLY = 1e-3
"""Share of a bone in a vertex from which on, and to which, it moves with it partly."""


@dataclass(frozen=True, eq=False)
class Bend:
    """Bones that turn about their heads, each with all that hangs on it.

    Attributes
    ----------
    joint : str
        "elbows", or the name of the first bone.
    bones : (k,) int32
        None hangs on another one.
    axes : (k, 3) float64
        Unit.
    degrees : float
    """

    joint: str
    bones: IntArray
    axes: Directions
    degrees: float

    @property
    def turns(self) -> FloatArray:
        """The rotation of each bone, (k, 3, 3)."""
        from scipy.spatial.transform import Rotation

        turns = np.radians(self.degrees) * np.asarray(self.axes)
        return np.asarray(Rotation.from_rotvec(turns).as_matrix())


@dataclass(frozen=True, eq=False)
class Strain:
    """What a bend does to a surface of n points.

    Attributes
    ----------
    bend : Bend
    points : (n, 3) float64
        As the bones move them.
    stretch : (n,) float64
        Length of the edge at each point that changes most, of that at rest.
    edges, stretched : int
        Edges that move with the joint but not as a whole, and how many of them grow to `STRETCHED`.
    collapsed : int
        Triangles that shrink to `COLLAPSED`, or turn over.
    largest : float
        The most that an edge grows.
    """

    bend: Bend
    points: Positions
    stretch: FloatArray
    edges: int
    stretched: int
    collapsed: int
    largest: float


def test_poses(rig: Bones | Armature) -> tuple[Bend, ...]:
    """Return where a rig is bent to try it: its main joints, both sides at once.

    Parameters
    ----------
    rig : Bones or Armature
        Joints are told by its names; without names of a figure, the largest ones are taken.

    Returns
    -------
    tuple of Bend
        Empty where no bone has a parent.

    Examples
    --------
    >>> arm = Armature([[0, 0, 0], [2, 0, 0]], [[2, 0, 0], [3, 0, 0]], [-1, 0], ("upper", "lower"))
    >>> [(bend.joint, bend.bones.tolist()) for bend in test_poses(arm)]
    [('lower', [1])]
    """
    return tuple(_by_names(rig)) or tuple(_by_size(rig))


test_poses.__test__ = False  # type: ignore[attr-defined]  # of pytest


@dataclass(frozen=True, eq=False)
class FigureParts:
    """Which bones of a rig are those of a biped or quadruped, and how it stands.

    Attributes
    ----------
    rows : dict of int
        Bones by the names of parts: "hips", "forearm.L".
    left, ahead, up : (3,) float64
        Unit, at right angles: the figure's own.
    """

    rows: dict[str, int]
    left: FloatArray
    ahead: FloatArray
    up: FloatArray

    @property
    def kind(self) -> str:
        """Whether it is a "biped" or "quadruped"."""
        return "quadruped" if "front_thigh.L" in self.rows else "biped"


def bare_name(name: str) -> str:
    """Return the name of a bone in lower case, without what programs write before it.

    Such prefixes are namespaces ("mixamorig:"), layers of Rigify ("DEF-"), and those of VRoid,
    whose letter for the side becomes a word.

    Examples
    --------
    >>> [bare_name(name) for name in ("mixamorig5:LeftArm", "DEF-thigh.L", "J_Bip_L_UpperArm")]
    ['leftarm', 'thigh.l', 'leftupperarm']
    """
    bare = PREFIX.sub("", name.rsplit(":", 1)[-1].rsplit("|", 1)[-1])
    vroid = VROID.match(bare)
    if vroid:
        bare = {"L": "left", "R": "right", "C": ""}[vroid[1]] + bare[vroid.end() :]
        bare = bare.replace("ToeBase", "Toes")
    return bare.lower()


def figure_parts(rig: Bones | Armature) -> FigureParts | None:
    """Return the parts of a figure by the names of bones; None where they name none.

    Names are those of this project, or of the programs in `naming.py`, with or without prefixes.

    Examples
    --------
    >>> heads = np.array([[0, 0, 1.0], [1, 0, 1], [-1, 0, 1], [1, 0, 2], [-1, 0, 2], [0, 0, 2.5]])
    >>> names = ("LeftUpLeg", "RightUpLeg", "LeftArm", "RightArm", "Neck")
    >>> names = ("mixamorig:Hips", *(f"mixamorig:{name}" for name in names))
    >>> rig = Armature(heads, heads - [0, 0, 0.5], [-1, 0, 0, 0, 0, 0], names)
    >>> found = figure_parts(rig)
    >>> found.rows["upper_arm.L"], found.left.tolist(), found.ahead.tolist()
    (3, [1.0, 0.0, 0.0], [0.0, -1.0, 0.0])
    """
    # Of an original, a mechanism and a deforming bone of the same name, the last one counts.
    order = sorted(range(rig.count), key=lambda bone: rig.names[bone].startswith("DEF-"))
    of_names = {bare_name(rig.names[bone]): bone for bone in order}
    found: list[dict[str, int]] = []
    for target in TARGETS.values():
        names = {part: bare_name(target.name(part)) for part in WORDS}
        found.append({part: of_names[name] for part, name in names.items() if name in of_names})
    rows = max(found, key=len)
    if len(rows) < FEW_NAMES:
        return None
    left = np.zeros(3)
    for part, bone in rows.items():
        if part.endswith(".L") and (twin := rows.get(f"{part[:-1]}R")) is not None:
            left += rig.heads[bone] - rig.heads[twin]
    legs = [bone for part, bone in rows.items() if part.startswith(("thigh", "shin"))]
    up = (rig.heads[legs] - rig.tails[legs]).sum(axis=0)
    trunk = up
    if {"hips", "neck"} <= rows.keys():
        trunk = rig.heads[rows["neck"]] - rig.heads[rows["hips"]]
    # Some programs have one name for arms and front legs.
    biped = unit_rows(trunk) @ unit_rows(up) >= ACROSS_TRUNK
    other = ("front_",) if biped else ("upper_arm", "forearm", "hand")
    both = {"front_thigh.L", "upper_arm.L"} <= rows.keys()
    rows = {part: bone for part, bone in rows.items() if not (both and part.startswith(other))}
    if "front_thigh.L" not in rows:  # legs may be bent
        up = trunk
    if isinstance(rig, Bones) and rig.frame is not None:
        return FigureParts(rows, *rig.frame)
    ahead = unit_rows(np.cross(left, up))
    if not ahead.any():
        return None
    left = unit_rows(left)
    return FigureParts(rows, left, ahead, np.cross(ahead, left))


def _by_names(rig: Bones | Armature) -> Iterator[Bend]:
    parts = figure_parts(rig)
    if parts is None:
        return
    along = unit_rows(rig.tails - rig.heads)
    for joint, words, goal, degrees in JOINTS:
        marked = [word + mark for word in words for mark in ("", ".L", ".R")]
        bones = [parts.rows[name] for name in marked if name in parts.rows]
        axes = []
        for bone in bones:
            way = parts.ahead if goal == "ahead" else -parts.ahead
            axis = np.cross(along[bone], way) if goal else parts.left
            if np.linalg.norm(axis) < CLEARLY_BENT:  # it points there already: up, or on
                axis = -parts.left if goal == "ahead" else parts.left
            above = int(rig.parents[bone])
            if joint in ("elbows", "knees") and above >= 0:
                bent = np.cross(along[above], along[bone])
                axis = bent if np.linalg.norm(bent) >= CLEARLY_BENT else axis
            axes.append(axis)
        if bones:
            yield Bend(joint, np.array(bones, np.int32), unit_rows(np.array(axes)), degrees)


def _by_size(rig: Bones | Armature) -> Iterator[Bend]:
    """Yield bends at the joints with the longest bones on the shorter of both sides."""
    lengths = np.linalg.norm(rig.tails - rig.heads, axis=1)
    below = np.array([lengths[_hanging(rig, bone)].sum() for bone in range(rig.count)])
    size = np.where(rig.parents >= 0, np.minimum(below, lengths.sum() - below), 0.0)
    along = unit_rows(rig.tails - rig.heads)
    rows = {name: bone for bone, name in enumerate(rig.names)}
    taken: set[int] = set()
    count = 0
    for bone in np.argsort(-size, kind="stable").tolist():
        if bone in taken or size[bone] <= 0 or count == MOST_POSES:
            continue
        twin = rows.get(_twin(rig.names[bone]), -1)
        pair = twin >= 0 and not (_hanging(rig, bone)[twin] or _hanging(rig, twin)[bone])
        bones = [bone, twin] if pair and rig.parents[twin] >= 0 else [bone]
        taken.update(bones)
        axes = np.cross(along[rig.parents[bones]], along[bones])
        least = np.eye(3)[np.abs(along[bones]).argmin(axis=1)]
        straight = np.linalg.norm(axes, axis=1, keepdims=True) < BENT
        axes = np.where(straight, np.cross(along[bones], least), axes)
        count += 1
        yield Bend(rig.names[bone], np.array(bones, np.int32), unit_rows(axes), ANGLE)


def _twin(name: str) -> str:
    """Return the name of the bone on the other side, "" where it tells none."""
    for left, right in ((".L", ".R"), ("_l", "_r"), ("Left", "Right"), ("left", "right")):
        for one, other in ((left, right), (right, left)):
            if name.endswith(one) or (len(one) > 2 and one in name):
                before, _, after = name.rpartition(one)
                return before + other + after
    return ""


def _hanging(rig: Bones | Armature, bone: int) -> np.ndarray:
    """Return which bones move with one: itself and all that hang on it, (b,) bool."""
    found = np.arange(rig.count) == bone
    while True:
        more = found | ((rig.parents >= 0) & found[rig.parents])
        if (more == found).all():
            return found
        found = more


def strains(shape: Shape, skin: SkinWeights) -> Iterator[Strain]:
    """Bend a surface at the main joints of its rig, by its weights, and measure what that does.

    A triangle turns over where it looks against the way in which its own weights turn it.

    Parameters
    ----------
    shape : Shape
        With faces, and n points.
    skin : SkinWeights
        Of its points, with its bones.
    """
    faces, edges = shape.faces, shape.edges
    assert skin.rig is not None and faces is not None
    least = 1e-9 * shape.diagonal  # what is smaller has no length or area to be measured by
    rest, areas = shape.edge_lengths, twice_areas(shape.points, faces)
    for bend in test_poses(skin.rig):
        points, wanted, partly = _bent(shape, skin, bend)
        now = np.linalg.norm(np.subtract(*points[edges.T]), axis=1)
        ratio = np.where(rest > least, now / np.maximum(rest, least), 1.0)
        normals = corner_vectors(points, faces)
        flat = np.linalg.norm(normals, axis=1) <= COLLAPSED * areas
        turned = (normals * wanted).sum(axis=1) < 0
        yield Strain(
            bend,
            points,
            _farthest_from_one(ratio, edges, len(points)),
            edges=int(partly[edges].any(axis=1).sum()),
            stretched=int((ratio >= STRETCHED).sum()),
            collapsed=int(((flat | turned) & (areas > least**2)).sum()),
            largest=float(ratio.max(initial=1.0)),
        )


def _bent(shape: Shape, skin: SkinWeights, bend: Bend) -> tuple[FloatArray, FloatArray, np.ndarray]:
    """Return the points as the bones move them, normals of faces turned alike, what moves partly.

    Bones of a bend do not hang on each other: what they do to a point adds up.
    """
    rig, faces, points = skin.rig, shape.faces, np.array(shape.points)
    assert rig is not None and faces is not None
    normals = corner_vectors(shape.points, faces)
    turned, partly = np.array(normals), np.zeros(len(points), bool)
    for bone, turn in zip(bend.bones.tolist(), bend.turns, strict=True):
        inside = np.append(_hanging(rig, bone), False)  # -1: no bone
        share = (skin.weights * inside[skin.bones]).sum(axis=1)
        off = shape.points - rig.heads[bone]
        points += share[:, None] * (off @ turn.T - off)
        turned += share[faces].mean(axis=1)[:, None] * (normals @ turn.T - normals)
        partly |= (share > PARTLY) & (share < 1 - PARTLY)
    return points, turned, partly


def _farthest_from_one(ratio: FloatArray, edges: IntArray, count: int) -> FloatArray:
    """Return the ratio of the edge at each point that is farthest from 1."""
    logs = np.log(np.maximum(ratio, 1e-6))
    most, least = np.zeros(count), np.zeros(count)
    np.maximum.at(most, edges.ravel(), np.repeat(logs, 2))
    np.minimum.at(least, edges.ravel(), np.repeat(logs, 2))
    return np.exp(np.where(most >= -least, most, least))


def tried(
    shape: Shape, skin: SkinWeights, progress: Progress
) -> tuple[list[dict[str, Any]], tuple[tuple[str, Layer], ...]]:
    """Return a row for each test pose and its panel of a picture; tell what stretches there.

    Parameters
    ----------
    shape : Shape
        With faces, and the points of `skin`.
    skin : SkinWeights
        With its bones.
    progress : Progress
        Gets the sentences.
    """
    found = list(strains(shape, skin))
    rows = [_row(strain, skin) for strain in found]
    clean = sum(not (row["stretched"] or row["collapsed"]) for row in rows)
    text = f"In {clean or 'none'} of {len(rows)} test poses nothing stretches or collapses."
    if not rows:
        text = "No bone hangs on another one: there is no joint to bend."
    progress.note(text, "test_poses", poses=len(rows), clean=clean)
    panels = []
    for strain, row in zip(found, rows, strict=True):
        caption = strain.bend.joint
        if row["stretched"] or row["collapsed"]:
            progress.note(_sentence(strain, row["bones"]), "strained", **row)
            kinds = ("stretched", "collapsed")
            caption += ": " + ", ".join(f"{row[kind]} {kind}" for kind in kinds if row[kind])
        panels.append((
            caption,
            Layer("pose", strain.points, shape.faces, attributes={"stretch": strain.stretch},
                  color_by="stretch", color_map="diverging", color_limits=(0.0, STRETCHED)),
        ))  # fmt: skip
    return rows, tuple(panels)


def _row(strain: Strain, skin: SkinWeights) -> dict[str, Any]:
    assert skin.rig is not None
    names = skin.rig.names
    return {
        "kind": strain.bend.joint,
        "bones": [names[bone] for bone in strain.bend.bones.tolist()],
        "degrees": strain.bend.degrees,
        "edges": strain.edges,
        "stretched": strain.stretched,
        "collapsed": strain.collapsed,
        "largest_stretch": strain.largest,
    }


def _sentence(strain: Strain, names: list[str]) -> str:
    """Say what stretches or collapses, and where."""
    told = []
    if strain.stretched:
        verb = "edge grows" if strain.stretched == 1 else "edges grow"
        told.append(
            f"{strain.stretched:,} of {strain.edges:,} {verb} to {STRETCHED:g} times the length "
            f"or more ({strain.largest:.1f} at most)"
        )
    if strain.collapsed:
        verb = (
            "triangle collapses or turns"
            if strain.collapsed == 1
            else ("triangles collapse or turn")
        )
        told.append(f"{strain.collapsed:,} {verb} over")
    where = " and ".join(names)
    return f"Bent by {strain.bend.degrees:g} degrees at {where}: {' and '.join(told)}."
