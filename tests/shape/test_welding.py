"""Vertices parted by rounding are one; thin walls, and bodies that only touch, stay as they are.

What varies in the family: the shape (genus 0 and 1, round and flat, thin), its size (1e-6 to 1e6),
its distance from the origin, how corners of a triangle soup differ (zeros of both signs, last
bits, 1e-9 of the size, single precision against decimal text, one step of a decimal), and the file
(arrays, STL as text and binary, OBJ with few digits). The answer is that of the mesh before it was
cut into triangles: closed, with its components and its number of vertices.
"""

import numpy as np
import pytest

import medialis
from assemblies import KINDS, together
from medialis.base.progress import Progress
from medialis.shape.surface import Surface
from medialis.shape.welding import coordinate_step, weld

CUBE = np.array([[x, y, z] for x in (0.0, 1) for y in (0.0, 1) for z in (0.0, 1)])
QUADS = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4],
                  [1, 5, 7, 3]])  # fmt: skip
FACES = QUADS[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3).astype(np.int32)


def tube(rng, around=12, along=8, ratio=0.4):
    """Torus of random radii."""
    u, v = np.meshgrid(np.arange(along), np.arange(around), indexing="ij")
    a, b = 2 * np.pi * u.ravel() / along, 2 * np.pi * v.ravel() / around
    wide = 1 + ratio * rng.uniform(0.5, 1.0) * np.cos(b)
    points = np.stack([wide * np.cos(a), wide * np.sin(a), ratio * np.sin(b)], axis=1)
    here = (u * around + v).ravel()
    right, up = ((u + 1) % along * around + v).ravel(), (u * around + (v + 1) % around).ravel()
    both = ((u + 1) % along * around + (v + 1) % around).ravel()
    faces = np.concatenate([np.stack([here, right, both], 1), np.stack([here, both, up], 1)])
    return points, faces.astype(np.int32)


def slab(rng, thickness=None, cells=4):
    """Plate with a grid on both sides, and its rim."""
    thickness = rng.uniform(0.1, 1.0) if thickness is None else thickness
    k = cells + 1
    x, y = (g.ravel() for g in np.meshgrid(np.arange(k) / cells, np.arange(k) / cells))
    points = np.concatenate([np.stack([x, y, np.full_like(x, z)], 1) for z in (thickness, 0)])
    i = (np.arange(cells)[:, None] * k + np.arange(cells)).ravel()
    top = np.concatenate([np.stack([i, i + 1, i + k + 1], 1), np.stack([i, i + k + 1, i + k], 1)])
    ring = [
        *range(cells),
        *(cells + k * r for r in range(cells)),
        *(k * k - 1 - c for c in range(cells)),
        *(k * (cells - r) for r in range(cells)),
    ]
    a, b = np.array(ring), np.roll(ring, -1)
    rim = np.concatenate([np.stack([a, a + k * k, b], 1), np.stack([b, a + k * k, b + k * k], 1)])
    return points, np.concatenate([top, top[:, ::-1] + k * k, rim]).astype(np.int32)


def ball(rng):
    """Octahedron, divided twice."""
    points = np.concatenate([np.eye(3), -np.eye(3)])
    faces = np.array([[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2],
                      [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]])  # fmt: skip
    for _ in range(2):
        ends = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        edges, which = np.unique(ends, axis=0, return_inverse=True)
        a, b, c = (len(points) + which.reshape(-1, 3)).T
        p, q, r = faces.T
        rows = ([p, a, c], [a, q, b], [c, b, r], [a, b, c])
        points = np.concatenate([points, points[edges].mean(axis=1)])
        faces = np.concatenate([np.stack(row, axis=1) for row in rows])
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    return points * rng.uniform(0.5, 1.0, 3), faces.astype(np.int32)


def cut(points, faces, order=None):
    """Triangle soup: three corners of each face."""
    return points[faces].reshape(-1, 3)


def turned(points, rng):
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return points @ (rotation * np.sign(np.linalg.det(rotation)))


def parted(soup, kind, rng):
    """Corners that differ as those of a program do; the size of the shape is about 1."""
    if kind == "zeros":
        return np.where(soup == 0, rng.choice([-1e-17, 0.0, 1e-17], soup.shape), soup)
    if kind == "bits":
        return soup + np.spacing(np.abs(soup)) * rng.integers(-3, 4, soup.shape)
    if kind == "nano":
        return soup + rng.uniform(-1e-9, 1e-9, soup.shape)
    single = soup.astype(np.float32).astype(np.float64)
    text = np.array([float(f"{x:.9g}") for x in soup.ravel()]).reshape(soup.shape)
    return np.where(rng.random((len(soup), 1)) < 0.5, single, text)


def one_step_off(soup, step, rng):
    """A tenth of the corners are off by one step of a number in one coordinate."""
    rows = np.flatnonzero(rng.random(len(soup)) < 0.1)
    result = soup.copy()
    result[rows, rng.integers(0, 3, len(rows))] += step * rng.choice([-1, 1], len(rows))
    return result


def read(path, text):
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    progress = Progress()
    shape = medialis.read_shape(path, progress=progress)
    return shape, {m.code: dict(m.data) for m in progress.messages}


def stl_text(soup, digits):
    lines = ["solid x"]
    for a in soup.reshape(-1, 9):
        n = [" ".join(f"{x:{digits}}" for x in row) for row in a.reshape(3, 3)]
        lines += [
            "facet normal 0 0 0",
            "outer loop",
            *(f"vertex {row}" for row in n),
            "endloop",
            "endfacet",
        ]
    return "\n".join([*lines, "endsolid x", ""])


def stl_binary(soup):
    table = np.zeros(len(soup) // 3, [("n", "<f4", 3), ("c", "<f4", (3, 3)), ("a", "<u2")])
    table["c"] = soup.reshape(-1, 3, 3)
    return b" " * 80 + np.uint32(len(table)).tobytes() + table.tobytes()


def obj_text(soup, digits):
    lines = ["v " + " ".join(f"{x:{digits}}" for x in row) for row in soup]
    return "\n".join([*lines, *(f"f {i + 1} {i + 2} {i + 3}" for i in range(0, len(soup), 3)), ""])


SHAPES = {"tube": tube, "slab": slab, "ball": ball}


def check(points, faces, shape, data, crack):
    assert shape.part_count == 1 and shape.topology.is_solid
    assert shape.point_count == len(points) and shape.face_count == len(faces)
    assert shape.diagnosis.crack_vertices > 0 if crack else shape.diagnosis.crack_vertices == 0
    if crack:
        welded = data["cracks_welded"]
        assert welded["vertices"] == shape.diagnosis.crack_vertices
        assert welded["distance"] == shape.diagnosis.weld_distance > 0
    else:
        assert "cracks_welded" not in data


def arrays_of(kind, seed):
    rng = np.random.default_rng(seed)
    name = list(SHAPES)[seed % 3]
    points, faces = SHAPES[name](rng)
    if kind != "zeros":
        points = turned(points, rng)
    return points, faces, rng


@pytest.mark.parametrize("kind", ["zeros", "bits", "nano", "mixed"])
@pytest.mark.parametrize("size", [1e-6, 1e-3, 1.0, 1e3, 1e6])
def test_arrays(kind, size):
    """60 members: three shapes of each size and kind. Zeros of a box and an octahedron."""
    for seed in range(3):
        points, faces, rng = arrays_of(kind, 100 + seed)
        scale = size * rng.uniform(1, 10)
        soup = parted(cut(points, faces), kind, rng) * scale
        if kind == "mixed":
            soup = parted(cut(points * scale, faces), kind, rng)
        progress = Progress()
        triangles = np.arange(len(soup)).reshape(-1, 3)
        shape = medialis.make_shape(soup, triangles, repair=True, progress=progress)
        data = {m.code: dict(m.data) for m in progress.messages}
        crack = len(np.unique(soup + 0.0, axis=0)) > len(points)
        check(points, faces, shape, data, crack)


@pytest.mark.parametrize("away", [1.0, 100.0, 1e4, 1e6])
def test_far_from_the_origin(away):
    """36 members: double precision that lost digits, in three kinds."""
    for seed, kind in enumerate(["bits", "nano", "far"] * 3):
        points, faces, rng = arrays_of(kind, 200 + seed)
        soup = cut(points, faces)
        soup = soup if kind == "far" else parted(soup, kind, rng)
        soup = soup + away * rng.uniform(1, 2, 3)
        if kind == "far":
            soup += np.spacing(np.abs(soup)) * rng.integers(-1, 2, soup.shape)
        shape = medialis.make_shape(soup, np.arange(len(soup)).reshape(-1, 3), repair=True)
        assert shape.part_count == 1 and shape.topology.is_solid, (kind, seed)
        assert shape.point_count == len(points)


@pytest.mark.parametrize("size", [1e-6, 1e-3, 1.0, 1e3, 1e6])
@pytest.mark.parametrize("kind", ["binary", ".6e", ".7g", ".9g", ".6g"])
def test_stl(kind, size, tmp_path):
    """75 members: some corners are off by one step of the numbers in the file."""
    for seed in range(3):
        points, faces, rng = arrays_of("stl", 300 + seed)
        away = rng.uniform(0, 3, 3) if seed else np.zeros(3)
        soup = (cut(points, faces) + away) * size * rng.uniform(1, 10)
        largest = np.abs(soup).max()
        digits = {".6e": 7, ".7g": 7, ".9g": 9, ".6g": 6}.get(kind)
        step = np.spacing(np.float32(largest))
        if digits:
            step = 10.0 ** (np.floor(np.log10(largest)) + 1 - digits)
        soup = one_step_off(soup, step, rng)
        text = stl_binary(soup) if kind == "binary" else stl_text(soup, kind)
        shape, data = read(tmp_path / f"{seed}.stl", text)
        check(points, faces, shape, data, True)


@pytest.mark.parametrize("decimals", [3, 4, 5, 6])
def test_obj_with_few_digits(decimals, tmp_path):
    """48 members: 10 to 1000 units large, some corners off by one of the last decimal."""
    for seed in range(12):
        points, faces, rng = arrays_of("obj", 400 + seed)
        size = 10.0 ** rng.uniform(0.5 if decimals > 3 else 1.0, 3)
        soup = np.round(cut(points, faces) * size, decimals)
        soup = one_step_off(soup, 10.0**-decimals, rng)
        shape, data = read(tmp_path / f"{seed}.obj", obj_text(soup, f".{decimals}f"))
        check(points, faces, shape, data, True)


@pytest.mark.parametrize("kind", ["double", "single", ".4f", ".7g"])
def test_walls_just_above_the_distance_keep_both_sides(kind, tmp_path):
    """48 members: plates of 1.1 to 3 weld distances, with cracks of zeros along their edges."""
    for seed in range(12):
        rng = np.random.default_rng(500 + seed)
        flat, _ = slab(rng, 0.0)
        scale = rng.uniform(1, 10)
        digits = {".4f": 4, ".7g": 6}.get(kind)
        given = flat * scale + (0.0 if seed % 2 else 0.123456789)
        distance = {"double": 1e-8 * scale * 1.5, "single": 4 * np.spacing(np.float32(scale))}
        step = 2 * 10.0**-digits if digits else distance[kind]
        if kind == ".7g":
            step *= 10
        thickness = step * rng.uniform(1.1, 3.0)
        points, faces = slab(rng, thickness / scale)
        given = points * scale + (0.0 if seed % 2 else 0.123456789)
        soup = cut(given, faces)
        if kind == "double":
            soup = np.where(soup == 0, rng.choice([-1e-17, 0.0, 1e-17], soup.shape), soup)
            shape = medialis.make_shape(soup, np.arange(len(soup)).reshape(-1, 3), repair=True)
        elif kind == "single":
            shape, _ = read(tmp_path / f"{seed}.stl", stl_binary(soup))
        else:
            shape, _ = read(tmp_path / f"{seed}.obj", obj_text(soup, kind))
        assert shape.part_count == 1 and shape.topology.is_solid
        assert shape.point_count == len(points) and shape.face_count == len(faces)
        assert np.ptp(shape.points[:, 2]) == pytest.approx(thickness, rel=0.6)


@pytest.mark.parametrize("noise", [0.0, 1e-17, 1e-10])
@pytest.mark.parametrize("kind", KINDS)
def test_bodies_that_touch_are_kept_apart_in_soups(kind, noise, tmp_path):
    """36 members: with noise, cracks have to be closed first."""
    for seed in range(3):
        rng = np.random.default_rng(600 + seed)
        count = int(rng.integers(2, 6)) if kind in ("stack", "sleeves") else 2
        parts = KINDS[kind](rng, 0.0, count, seed != 1)
        points, faces = together(parts)
        soup = cut(points, faces)
        soup = soup + rng.uniform(-noise, noise, soup.shape)
        shape = medialis.make_shape(soup, np.arange(len(soup)).reshape(-1, 3), repair=True)
        assert shape.part_count == len(parts) and shape.topology.is_solid
        assert shape.point_count == len(points) and shape.body_contacts.count == len(parts)
        if noise == 0.0:
            shape, data = read(tmp_path / f"{seed}.stl", stl_binary(soup))
            assert shape.part_count == len(parts) and shape.topology.is_solid
            kept = data.get("bodies_kept_apart", {"bodies": 0})["bodies"]
            assert kept == len(parts) or seed == 1  # other facets share no edges


def boxes(*corners):
    points = np.concatenate([CUBE + corner for corner in np.array(corners, float)])
    return points, np.concatenate([FACES + 8 * k for k in range(len(corners))])


def test_bodies_whose_vertices_were_merged_are_parted_where_their_faces_lie_on_each_other():
    """As trimesh's merge_vertices leaves stacked boxes; cubes that share an edge stay one."""
    points, faces = boxes([0, 0, 0], [1, 0, 0], [2, 0, 0])
    equal = Surface(points).first_equal_point
    kept = np.unique(equal)
    shape = medialis.make_shape(points[kept], np.searchsorted(kept, equal[faces]), repair=True)
    assert len(kept) == 16 and shape.part_count == 3 and shape.topology.is_solid
    points, faces = boxes([0, 0, 0], [1, 1, 0])
    equal = Surface(points).first_equal_point
    kept = np.unique(equal)
    shape = medialis.make_shape(points[kept], np.searchsorted(kept, equal[faces]), repair=True)
    assert shape.part_count == 1 and shape.point_count == 14


def test_a_closed_body_that_a_file_holds_twice_is_one():
    points, faces = boxes([0, 0, 0], [3, 0, 0], [0, 0, 0])
    progress = Progress()
    shape = medialis.make_shape(points, faces, repair=True, progress=progress)
    assert shape.part_count == 2 and shape.point_count == 16
    data = {m.code: m.data for m in progress.messages}
    assert data["duplicates_dropped"]["faces"] == 12


def test_bodies_of_a_file_are_welded_within_themselves():
    """Two boxes with corners of their own for each face, as scenes have them; one of them open."""
    points, faces = boxes([0, 0, 0], [1, 0, 0])
    soup, triangles = cut(points, faces), np.arange(72, dtype=np.int32).reshape(-1, 3)
    welded = weld(Surface(soup, triangles), np.repeat([0, 1], 12).astype(np.int32))
    surface = Surface(soup[welded.first], welded.faces)
    assert surface.part_count == 2 and surface.topology.is_solid and welded.parted == 0
    # Halves of one box in two nodes: what is left open is welded across them.
    halves = weld(Surface(soup[:36], triangles[:12]), np.repeat([0, 1], 6).astype(np.int32))
    assert Surface(soup[halves.first], halves.faces).topology.is_solid


@pytest.mark.parametrize(
    ("given", "step"),
    [
        ([[0.125, 12.345, 99.875], [1.5, 20.25, 31.999], [41.1, 52.2, 63.3]], 1e-3),
        ([[1.2345e3, 2.3456e3, 0.12345], [3.4567e3, 4.5678e3, 12.345], [5.6789e3, 1.0, 2.0]], 0.1),
        ([[0, 1, 2], [3, 4, 5]], np.spacing(5.0)),
        ([[0, 0, 0], [0, 0, 0]], 0.0),
    ],
)
def test_the_step_of_coordinates(given, step):
    assert coordinate_step(np.array(given, float)) == pytest.approx(step, rel=1e-9)


def test_the_step_of_single_precision():
    values = np.random.default_rng(0).uniform(0, 1, (50, 3)).astype(np.float32)
    step = coordinate_step(values.astype(np.float64) * 2.0)
    assert step == np.spacing(np.float32(2.0 * values.max()))
