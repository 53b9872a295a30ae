"""Robots as URDF: the shape of each link in its frame, and files of balls as robots take them.

A link has the shapes of its `collision` elements, else of its `visual` ones: meshes, boxes,
cylinders and spheres, each at its `origin`. Meshes are looked for beside the file, and those of
packages (``package://NAME/...``) in a folder of that name, or of none, on the way up from it.
Lengths are metres.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import unquote
from xml.etree import ElementTree
from xml.sax.saxutils import quoteattr

import numpy as np

from medialis.base.errors import FileError, InvalidShapeError
from medialis.base.options import METERS
from medialis.base.progress import Progress
from medialis.base.threads import run_patiently
from medialis.base.validation import FloatArray
from medialis.formats.files import file_bytes, reading
from medialis.formats.meshes import read_mesh
from medialis.medial_meshes.mesh import BallCover
from medialis.robots.covers import CapsuleCover
from medialis.shape.normals import ring_normals
from medialis.shape.repair import repaired
from medialis.shape.shape import Shape

SIDES = 32
"""Of a cylinder: its faces lie 0.5 % of the radius inside; it is made so much wider."""


def robot_of(path: str | os.PathLike[str]) -> ElementTree.Element:
    """Read a URDF file.

    Raises
    ------
    FileError
        When it cannot be read.
    InvalidShapeError
        When it is no URDF.
    """
    name = os.fspath(path)
    with reading(name):
        data = file_bytes(name)
        if b"<!ENTITY" in data or b"<!DOCTYPE" in data:
            raise InvalidShapeError("it defines entities, which URDF has no use for.")
        try:
            root = ElementTree.fromstring(data)
        except ElementTree.ParseError as error:
            raise InvalidShapeError(f"it is no XML ({error}); expand xacro files first.") from None
        if root.tag != "robot":
            raise InvalidShapeError(f"it is no URDF: it begins with <{root.tag}>, not <robot>.")
        return root


def link_shapes(
    path: str | os.PathLike[str], root: ElementTree.Element, progress: Progress
) -> dict[str, Shape]:
    """Return the shape of each link that has one, in its frame and in metres.

    Raises
    ------
    FileError, InvalidShapeError
        When a mesh is missing or cannot be used; the sentence names it.
    """
    found: dict[str, Shape] = {}
    links = root.findall("link")
    for number, link in enumerate(links):
        parts = [*_parts(Path(path), link, progress.still)]
        if parts:
            counts = np.cumsum([0, *(len(points) for points, _ in parts[:-1])])
            faces = [rows + first for (_, rows), first in zip(parts, counts, strict=True)]
            points = np.concatenate([points for points, _ in parts])
            name = link.get("name", "")
            with reading(f"link {name} of {os.fspath(path)}"):
                found[name] = _mended(points, np.concatenate(faces))
        progress.update((number + 1) / len(links))
    return found


def _mended(points: Any, faces: Any) -> Shape:
    """Weld and orient the triangles of a link.

    Without the fits of cylinders and planes by which `make_shape` gets exact normals: balls and
    capsules do not need them, and they take most of the time.
    """
    fixed, _ = repaired(points, faces, None)
    if fixed.faces is None or len(fixed.faces) == 0:
        raise InvalidShapeError("no triangle of it has an area.")
    return Shape(fixed.points, ring_normals(fixed.points, fixed.faces), fixed.faces, unit="m")


def _parts(path: Path, link: ElementTree.Element, progress: Progress) -> Iterator[tuple[Any, Any]]:
    """Yield points and faces of each shape of a link, in its frame."""
    for one in link.findall("collision") or link.findall("visual"):
        geometry = one.find("geometry")
        kind = None if geometry is None else next(iter(geometry), None)
        if kind is None:
            continue
        with reading(os.fspath(path)):
            points, faces = _shape(path, kind, progress)
            turn, place = _origin(one)
        yield points @ turn.T + place, faces


def _shape(path: Path, kind: ElementTree.Element, progress: Progress) -> tuple[Any, Any]:
    if kind.tag == "mesh":
        file = mesh_file(path, kind.get("filename", ""))
        mesh = run_patiently(lambda: read_mesh(file), progress)
        if mesh.faces is None:
            raise InvalidShapeError(f"its mesh {file.name} is a point cloud.")
        scale = _numbers(kind.get("scale", "1 1 1"), 3) * METERS.get(mesh.unit or "m", 1.0)
        faces = mesh.faces if np.prod(scale) > 0 else mesh.faces[:, ::-1]
        return mesh.points * scale, faces
    if kind.tag == "box":
        corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) - 0.5
        quads = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
        faces = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
        return corners * _numbers(kind.get("size", ""), 3), faces
    radius = float(_numbers(kind.get("radius", ""), 1)[0])
    if kind.tag == "cylinder":
        return _cylinder(radius, float(_numbers(kind.get("length", ""), 1)[0]))
    if kind.tag == "sphere":
        return _sphere(radius)
    raise InvalidShapeError(f"it has a shape <{kind.tag}>; URDF has mesh, box, cylinder, sphere.")


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint of a robot.

    Attributes
    ----------
    name, kind : str
        The kind is "fixed", "revolute", "continuous", "prismatic", "floating" or "planar".
    parent, child : str
        Links.
    rotation : (3, 3) float64
    origin : (3,) float64
        Of the frame of the child in that of the parent, at joint value 0; in metres.
    axis : (3,) float64
        In the frame of the child, of length 1.
    limits : (float, float) or None
        Smallest and largest value, in radians or metres.
    """

    name: str
    kind: str
    parent: str
    child: str
    rotation: FloatArray
    origin: FloatArray
    axis: FloatArray
    limits: tuple[float, float] | None

    def at_rest(self) -> tuple[FloatArray, FloatArray]:
        """Return rotation and origin of the child at value 0, or the nearest that limits allow."""
        value = 0.0 if self.limits is None else min(max(0.0, self.limits[0]), self.limits[1])
        if value == 0.0 or self.kind not in ("revolute", "prismatic"):
            return self.rotation, self.origin
        if self.kind == "prismatic":
            return self.rotation, self.origin + self.rotation @ self.axis * value
        from scipy.spatial.transform import Rotation

        return self.rotation @ Rotation.from_rotvec(value * self.axis).as_matrix(), self.origin


def joints_of(root: ElementTree.Element) -> list[Joint]:
    """Return the joints of a robot.

    Raises
    ------
    InvalidShapeError
        When an attribute does not have the numbers that it should have.
    """
    found = []
    for one in root.findall("joint"):
        parent, child = (
            "" if end is None else end.get("link", "") for end in map(one.find, ("parent", "child"))
        )
        axis, limit = one.find("axis"), one.find("limit")
        vector = _numbers("1 0 0" if axis is None else axis.get("xyz", "1 0 0"), 3)
        limits = None
        if limit is not None and one.get("type") in ("revolute", "prismatic"):
            low, high = (float(_numbers(limit.get(name, "0"), 1)[0]) for name in ("lower", "upper"))
            limits = (low, high) if low <= high else None
        length = float(np.linalg.norm(vector)) or 1.0
        frame = _origin(one)
        name, kind = one.get("name", ""), one.get("type", "")
        found.append(Joint(name, kind, parent, child, *frame, vector / length, limits))
    return found


def rest_frames(
    root: ElementTree.Element, *, fixed: bool = False
) -> dict[str, tuple[FloatArray, FloatArray]]:
    """Return where links are when no joint is moved.

    Parameters
    ----------
    root : Element
    fixed : bool
        Only the links that no joint can move.

    Returns
    -------
    dict of (rotation (3, 3), origin (3,))
        In the frame of the first link: of links that nothing is a parent of, and of all that joints
        connect to them.
    """
    joints = joints_of(root)
    moved = {joint.child for joint in joints}
    names = [link.get("name", "") for link in root.findall("link")]
    found = {name: (np.eye(3), np.zeros(3)) for name in names if name not in moved}
    waiting = list(found)
    for link in waiting:  # grows meanwhile
        rotation, origin = found[link]
        for joint in joints:
            if joint.parent != link or joint.child in found or (fixed and joint.kind != "fixed"):
                continue
            turn, place = joint.at_rest()
            found[joint.child] = rotation @ turn, rotation @ place + origin
            waiting.append(joint.child)
    return found


def separate_pairs(root: ElementTree.Element) -> Callable[[str, str], bool]:
    """Return a function that tests whether two links move against each other without a joint.

    Links that fixed joints connect are one body; bodies that a joint connects are neighbours. Of
    links that no joints connect at all it is not known where they are.
    """
    joints = joints_of(root)
    body = {link.get("name", ""): link.get("name", "") for link in root.findall("link")}
    tree = dict(body)
    for joint in joints:
        if joint.parent in body and joint.child in body:
            for label in (tree, body) if joint.kind == "fixed" else (tree,):
                old, new = label[joint.child], label[joint.parent]
                label.update({link: new for link, one in label.items() if one == old})
    joined = {frozenset((body.get(one.parent), body.get(one.child))) for one in joints}

    def are_separate(first: str, second: str) -> bool:
        ends = frozenset((body[first], body[second]))
        return tree[first] == tree[second] and len(ends) == 2 and ends not in joined

    return are_separate


def _origin(element: ElementTree.Element) -> tuple[FloatArray, FloatArray]:
    """Return rotation and place of what an element has an origin for."""
    origin = element.find("origin")
    if origin is None:
        return np.eye(3), np.zeros(3)
    turn = _rotation(_numbers(origin.get("rpy", "0 0 0"), 3))
    return turn, _numbers(origin.get("xyz", "0 0 0"), 3)


def mesh_file(path: Path, name: str) -> Path:
    """Return the file of a mesh that a URDF file names.

    Raises
    ------
    FileError
        When it is nowhere.
    """
    plain = unquote(name.removeprefix("file://"))
    if not name.startswith("package://"):
        tried = [path.parent / plain]
    else:
        inside = unquote(name.removeprefix("package://"))
        rest = inside.partition("/")[2]
        above = path.absolute().parents
        tried = [folder / part for folder in above for part in (inside, rest)]
    for file in tried:
        if file.is_file():
            return file
    raise FileError(f"Cannot read {path}: there is no mesh {name} beside it or above.")


def _numbers(text: str, count: int) -> FloatArray:
    try:
        found = np.array([float(word) for word in text.split()])
    except ValueError:
        found = np.empty(0)
    if len(found) != count or not np.isfinite(found).all():
        raise InvalidShapeError(f"{count} numbers are expected in an attribute, got {text!r}.")
    return found


def _rotation(rpy: FloatArray) -> FloatArray:
    """Return the matrix of roll, pitch and yaw about fixed axes, in radians.

    Not by scipy, which takes a fifth of a second to load.
    """
    (sx, sy, sz), (cx, cy, cz) = np.sin(rpy), np.cos(rpy)
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cx, -sx], [0.0, sx, cx]])
    about_y = np.array([[cy, 0.0, sy], [0.0, 1.0, 0.0], [-sy, 0.0, cy]])
    about_z = np.array([[cz, -sz, 0.0], [sz, cz, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(about_z @ about_y @ about_x)


def _cylinder(radius: float, length: float) -> tuple[Any, Any]:
    wide = radius / math.cos(math.pi / SIDES)
    ends = np.array([-0.5, 0.5]) * length
    return _revolved(np.array([wide, wide]), ends, (-0.5 * length, 0.5 * length))


def _sphere(radius: float) -> tuple[Any, Any]:
    """Return points and faces of a sphere of rings, no point of which lies outside."""
    up = np.pi * np.arange(1, SIDES // 2) / (SIDES // 2)
    return _revolved(radius * np.sin(up), -radius * np.cos(up), (-radius, radius))


def _revolved(
    radii: FloatArray, heights: FloatArray, poles: tuple[float, float]
) -> tuple[Any, Any]:
    """Return points and faces of rings about the z axis, closed by two poles; faces are outward."""
    turn = 2.0 * np.pi * np.arange(SIDES) / SIDES
    rings = np.empty((len(radii), SIDES, 3))
    rings[..., 0] = np.multiply.outer(radii, np.cos(turn))
    rings[..., 1] = np.multiply.outer(radii, np.sin(turn))
    rings[..., 2] = heights[:, None]
    points = np.concatenate([rings.reshape(-1, 3), [[0.0, 0.0, pole] for pole in poles]])
    row = np.arange(len(radii) * SIDES).reshape(-1, SIDES)
    after = np.roll(row, -1, axis=1)
    low, high = np.full(SIDES, row.size), np.full(SIDES, row.size + 1)
    faces = [
        np.stack([row[:-1], after[:-1], after[1:]], axis=2).reshape(-1, 3),
        np.stack([row[:-1], after[1:], row[1:]], axis=2).reshape(-1, 3),
        np.stack([after[0], row[0], low], axis=1),
        np.stack([row[-1], after[-1], high], axis=1),
    ]
    return points, np.concatenate(faces)


def rows_of(cover: BallCover) -> list[list[float]]:
    """Return center and radius of each ball."""
    return np.column_stack([cover.centers, cover.radii]).tolist()


class Ends(NamedTuple):
    """A ball or a capsule: ends of its axis, the same twice for a ball, and radius."""

    start: FloatArray
    end: FloatArray
    radius: float

    @property
    def length(self) -> float:
        """Length of the axis; 0 for a ball."""
        return float(np.linalg.norm(self.end - self.start))


def ends_of(cover: BallCover | CapsuleCover) -> list[Ends]:
    """Return the balls or capsules of a cover."""
    if isinstance(cover, BallCover):
        return [*map(Ends, cover.centers, cover.centers, cover.radii.tolist())]
    return [*map(Ends, cover.starts, cover.ends, cover.radii.tolist())]


def yaml_text(name: str, links: Mapping[str, BallCover]) -> str:
    """Return the balls as cuRobo's file of spheres."""
    lines = [f"# Balls of {json.dumps(name)} by medialis; lengths in metres.", "collision_spheres:"]
    for link, cover in links.items():
        lines.append(f"  {json.dumps(link)}:")
        for x, y, z, radius in rows_of(cover):
            lines += [f'    - "center": [{x!r}, {y!r}, {z!r}]', f'      "radius": {radius!r}']
    return "\n".join(lines) + "\n"


def srdf_text(name: str, links: Mapping[str, BallCover]) -> str:
    """Return the balls as MoveIt's approximations of links."""
    lines = ['<?xml version="1.0"?>', f"<robot name={quoteattr(name)}>"]
    for link, cover in links.items():
        lines.append(f"  <link_sphere_approximation link={quoteattr(link)}>")
        for x, y, z, radius in rows_of(cover):
            lines.append(f'    <sphere center="{x!r} {y!r} {z!r}" radius="{radius!r}"/>')
        lines.append("  </link_sphere_approximation>")
    return "\n".join([*lines, "</robot>", ""])


def urdf_text(urdf: str, links: Mapping[str, BallCover | CapsuleCover]) -> str:
    """Return a URDF whose links have balls or capsules in the place of their collision elements.

    URDF has no capsules: each becomes a cylinder and two spheres.
    """
    root = ElementTree.fromstring(urdf)
    for link in root.findall("link"):
        if link.get("name", "") not in links:
            continue
        for one in link.findall("collision"):
            link.remove(one)
        for part in ends_of(links[link.get("name", "")]):
            radius = repr(part.radius)
            _collision(link, part.start, "0 0 0", "sphere", radius=radius)
            if part.length > 0.0:
                _collision(link, part.end, "0 0 0", "sphere", radius=radius)
                angles = _angles_to(part.end - part.start)
                size = {"radius": radius, "length": repr(part.length)}
                _collision(link, 0.5 * (part.start + part.end), angles, "cylinder", **size)
    ElementTree.indent(root)
    return '<?xml version="1.0"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


def _collision(
    link: ElementTree.Element, place: FloatArray, angles: str, kind: str, **size: str
) -> None:
    one = ElementTree.SubElement(link, "collision")
    ElementTree.SubElement(one, "origin", {"xyz": _text(place), "rpy": angles})
    ElementTree.SubElement(ElementTree.SubElement(one, "geometry"), kind, size)


def _angles_to(direction: FloatArray) -> str:
    """Return roll, pitch and yaw that turn the z axis into a direction."""
    x, y, z = direction.tolist()
    return _text([0.0, math.atan2(math.hypot(x, y), z), math.atan2(y, x)])


def _text(values: Iterable[float]) -> str:
    return " ".join(repr(float(value)) for value in values)


def mjcf_text(urdf: str, links: Mapping[str, BallCover | CapsuleCover]) -> str:
    """Return a MuJoCo model with the joints and masses of a robot, and its balls or capsules."""
    root = ElementTree.fromstring(urdf)
    model = ElementTree.Element("mujoco", {"model": root.get("name", "robot")})
    # Links without mass or shape, as frames are, may move: MuJoCo wants a mass of them.
    settings = {"angle": "radian", "balanceinertia": "true"}
    small = {"boundmass": "1e-6", "boundinertia": "1e-9"}
    ElementTree.SubElement(model, "compiler", settings | small)
    world = ElementTree.SubElement(model, "worldbody")
    joints, elements = joints_of(root), {one.get("name", ""): one for one in root.findall("link")}
    moved = {joint.child for joint in joints}
    waiting: list[tuple[str, ElementTree.Element, Joint | None]] = [
        (name, world, None) for name in elements if name not in moved
    ]
    for name, parent, joint in waiting:  # grows meanwhile
        body = ElementTree.SubElement(parent, "body", {"name": name})
        if joint is not None:
            body.set("pos", _text(joint.origin))
            body.set("quat", _quaternion(joint.rotation))
            _add_joint(body, joint)
        _add_mass(body, elements[name].find("inertial"))
        for part in ends_of(links[name]) if name in links else ():
            if part.length > 0.0:
                ends = {"type": "capsule", "fromto": f"{_text(part.start)} {_text(part.end)}"}
            else:
                ends = {"type": "sphere", "pos": _text(part.start)}
            ElementTree.SubElement(body, "geom", ends | {"size": repr(part.radius)})
        waiting += [(one.child, body, one) for one in joints if one.parent == name]
    ElementTree.indent(model)
    return '<?xml version="1.0"?>\n' + ElementTree.tostring(model, encoding="unicode") + "\n"


def _quaternion(rotation: FloatArray) -> str:
    """Return w, x, y and z of a rotation."""
    from scipy.spatial.transform import Rotation

    return _text(np.roll(Rotation.from_matrix(rotation).as_quat(), 1))


def _add_joint(body: ElementTree.Element, joint: Joint) -> None:
    about = {"name": joint.name, "axis": _text(joint.axis)}
    if joint.limits is not None:
        about["range"] = _text(joint.limits)
    if joint.kind in ("revolute", "continuous"):
        ElementTree.SubElement(body, "joint", about | {"type": "hinge"})
    elif joint.kind == "prismatic":
        ElementTree.SubElement(body, "joint", about | {"type": "slide"})
    elif joint.kind == "planar":
        least = np.eye(3)[np.abs(joint.axis).argmin()]
        across = np.cross(joint.axis, least) / np.linalg.norm(np.cross(joint.axis, least))
        for letter, axis in zip("xy", (across, np.cross(joint.axis, across)), strict=True):
            slide = {"name": f"{joint.name}_{letter}", "type": "slide", "axis": _text(axis)}
            ElementTree.SubElement(body, "joint", slide)
        ElementTree.SubElement(body, "joint", about | {"type": "hinge"})
    elif joint.kind == "floating":
        for letter, axis in zip("xyz", np.eye(3), strict=True):
            slide = {"name": f"{joint.name}_{letter}", "type": "slide", "axis": _text(axis)}
            ElementTree.SubElement(body, "joint", slide)
        ElementTree.SubElement(body, "joint", {"name": joint.name, "type": "ball"})


def _add_mass(body: ElementTree.Element, inertial: ElementTree.Element | None) -> None:
    """Add mass and inertia where the link has some; else MuJoCo takes those of the shapes."""
    mass = None if inertial is None else inertial.find("mass")
    inertia = None if inertial is None else inertial.find("inertia")
    if inertial is None or mass is None or inertia is None:
        return
    value = float(_numbers(mass.get("value", ""), 1)[0])
    turn, place = _origin(inertial)
    xx, xy, xz, yy, yz, zz = (
        float(_numbers(inertia.get(name, "0"), 1)[0])
        for name in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    )
    tensor = turn @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ turn.T
    if value > 0.0 and np.linalg.eigvalsh(tensor)[0] > 0.0:
        entries = tensor[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
        about = {"pos": _text(place), "mass": repr(value), "fullinertia": _text(entries)}
        ElementTree.SubElement(body, "inertial", about)
