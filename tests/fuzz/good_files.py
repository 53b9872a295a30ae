"""Good files of every format that is read, a few kilobytes each, always the same bytes."""

from __future__ import annotations

import base64
import io
import json
import struct
import tempfile
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fuzz.nasty_shapes import grid_box, tube
from medialis.curves.curve_skeleton import CurveSkeleton
from medialis.curves.operation import write_curve_skeleton
from medialis.formats.files import Drawn
from medialis.formats.ply_attributes import write_ply
from medialis.formats.vtk import write_vtp

DATA = Path(__file__).parents[1] / "formats/data"


@dataclass(frozen=True)
class GoodFile:
    """A file, and the reader that it is for."""

    reader: str
    """mesh, attributes, npz, curve, pairs, seeds or manifest."""
    ending: str
    data: bytes


def good_files() -> list[GoodFile]:
    """Return all of them."""
    points, faces = grid_box(3)
    meshes = [
        *((".ply", data) for data in _ply_files(points, faces)),
        *((".obj", data) for data in _obj_files(points, faces)),
        *((".off", data) for data in _off_files(points, faces)),
        *((".stl", data) for data in _stl_files(points, faces)),
        *((ending, data) for ending, data in _point_files(points)),
        (".glb", _glb(points, faces)),
        (".gltf", _gltf(points, faces)),
        (".3mf", _three_mf(points, faces)),
        (".3mf", assembly(3, 4)),
        (".step", (DATA / "plate_with_hole.step").read_bytes()),
        (".dae", _collada(points, faces)),
        *((".pcd", data) for data in pcd_files(points)),
        *((".vtp", data) for data in vtp_files(points, faces)),
        (".las", las_file(points)),
        (".laz", (DATA / "box.laz").read_bytes()),
        (".e57", (DATA / "box.e57").read_bytes()),
    ]
    return [
        *(GoodFile("mesh", ending, data) for ending, data in meshes),
        *(GoodFile("attributes", ".ply", data) for data in _ply_files(points, faces)),
        *(GoodFile("npz", ".npz", data) for data in _npz_files()),
        *(GoodFile("curve", ending, data) for ending, data in _curve_files()),
        GoodFile("pairs", ".txt", b"# two vertices a line\n0 5\n7, 30 # across\n\n12 0\n"),
        GoodFile(
            "seeds", ".txt", b"# vertices or points\n0\n17\n0.1 0.2 1.0\n1, 1, 0.5 # corner\n"
        ),
        GoodFile("manifest", ".json", b""),  # made beside its files, see mutated_files
    ]


def _ply_files(points: NDArray[np.float64], faces: NDArray[np.int32]) -> list[bytes]:
    """Ascii and binary of both byte orders, with lists, normals, edges and attributes."""
    body = "\n".join(
        [f"{x:g} {y:g} {z:g} {i % 7} 0.5" for i, (x, y, z) in enumerate(points.tolist())]
        + [f"3 {a} {b} {c} {i % 4}" for i, (a, b, c) in enumerate(faces.tolist())]
        + ["2 0 1 9", "0 9"]
    )
    header = (
        "ply\nformat {} 1.0\ncomment by hand\nobj_info also a comment\n"
        f"element vertex {len(points)}\nproperty float x\nproperty float y\nproperty float z\n"
        "property uchar red\nproperty double quality\n"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nproperty short part\n"
        "{}end_header\n"
    )
    extra = "element strip 2\nproperty list int int rows\nproperty int tail\n"
    result = [(header.format("ascii", extra) + body + "\n").encode()]
    for order, name in (("<", "binary_little_endian"), (">", "binary_big_endian")):
        rows = b"".join(
            struct.pack(f"{order}3fBd", *point, i % 7, 0.5) for i, point in enumerate(points)
        )
        rows += b"".join(
            struct.pack(f"{order}B3ih", 3, *face.tolist(), i % 4) for i, face in enumerate(faces)
        )
        rows += struct.pack(f"{order}i2ii", 2, 0, 1, 9) + struct.pack(f"{order}ii", 0, 9)
        result.append(header.format(name, extra).encode() + rows)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.ply"
        kinds = {
            "radius": np.arange(len(points)) * 0.5,
            "label": np.arange(len(points)),
            "kept": np.arange(len(points)) % 2 == 0,
            "frame": np.arange(len(points) * 6, dtype=np.float32).reshape(-1, 2, 3),
        }
        write_ply(
            path,
            points,
            faces,
            edges=faces[:, :2],
            attributes=kinds,
            face_attributes={"part": np.arange(len(faces))},
        )
        result.append(path.read_bytes())
    return result


def _obj_files(points: NDArray[np.float64], faces: NDArray[np.int32]) -> list[bytes]:
    vertices = "".join(f"v {x:g} {y:g} {z:g}\n" for x, y, z in points.tolist())
    plain = "".join(f"f {a} {b} {c}\n" for a, b, c in (faces + 1).tolist())
    count = len(points)
    back = "".join(f"f {a}/1/1 {b}//1 {c}/1\n" for a, b, c in (faces.astype(int) - count).tolist())
    more = "mtllib a.mtl\no part\nvt 0 1\nvn 0 0 1\ng side\ns off\n"
    polygon = "f 1 2 3 4 \\\n5\nl 1 2\np 3\n"
    return [(vertices + plain).encode(), (more + vertices + back + polygon).encode()]


def _off_files(points: NDArray[np.float64], faces: NDArray[np.int32]) -> list[bytes]:
    vertices = "".join(f"{x:g} {y:g} {z:g}\n" for x, y, z in points.tolist())
    colored = "".join(f"{x:g} {y:g} {z:g} 255 0 0 255\n" for x, y, z in points.tolist())
    rows = "".join(f"3 {a} {b} {c}\n" for a, b, c in faces.tolist())
    counts = f"{len(points)} {len(faces)} 0\n"
    return [
        f"OFF\n# box\n{counts}{vertices}{rows}".encode(),
        f"COFF {counts}{colored}{rows}".encode(),
    ]


def _stl_files(points: NDArray[np.float64], faces: NDArray[np.int32]) -> list[bytes]:
    corners = points[faces]
    text = "solid box\n"
    for triangle in corners.tolist():
        rows = "".join(f"  vertex {x:g} {y:g} {z:g}\n" for x, y, z in triangle)
        text += f"facet normal 0 0 0\n outer loop\n{rows} endloop\nendfacet\n"
    facets = b"".join(
        struct.pack("<12fH", 0, 0, 0, *triangle.ravel().tolist(), 0) for triangle in corners
    )
    binary = b"made by hand".ljust(80) + struct.pack("<I", len(faces)) + facets
    return [(text + "endsolid box\n").encode(), binary]


def _point_files(points: NDArray[np.float64]) -> list[tuple[str, bytes]]:
    normals = points - points.mean(axis=0)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    rows = np.hstack([points, normals]).tolist()
    xyz = "".join(f"{x:g} {y:g} {z:g}\n" for x, y, z, *_ in rows)
    xyzn = "".join(" ".join(f"{v:.6f}" for v in row) + "\n" for row in rows)
    csv = "x,y,z,nx,ny,nz\n" + "".join(",".join(f"{v:.6f}" for v in row) + "\n" for row in rows)
    pts = f"{len(rows)}\n{xyz}"
    german = "Nr;x;y;z\n" + "".join(
        f"{k};{x:.3f};{y:.3f};{z:.3f}\n".replace(".", ",") for k, (x, y, z, *_) in enumerate(rows)
    )
    texts = {".xyz": xyz, ".xyzn": xyzn, ".csv": csv, ".pts": pts, ".txt": f"# points\n{xyz}"}
    return [*((ending, text.encode()) for ending, text in texts.items()), (".csv", german.encode())]


def pcd_files(points: NDArray[np.float64], viewpoint: str = "0 0 0") -> list[bytes]:
    """Return PCD files of all three encodings, with normals, a padding field and a label."""
    rows = np.zeros(
        len(points), [("xyz", "<f4", 3), ("pad", "u1", 4), ("n", "<f4", 3), ("i", "<u2")]
    )
    rows["xyz"], rows["i"] = points, np.arange(len(points))
    normals = points - points.mean(axis=0)
    rows["n"] = normals / np.linalg.norm(normals, axis=1)[:, None]
    header = (
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\n"
        "FIELDS x y z _ normal_x normal_y normal_z label\nSIZE 4 4 4 1 4 4 4 2\n"
        f"TYPE F F F U F F F U\nCOUNT 1 1 1 4 1 1 1 1\nWIDTH {len(points)}\nHEIGHT 1\n"
        f"VIEWPOINT {viewpoint} 1 0 0 0\nPOINTS {len(points)}\nDATA "
    )
    text = "".join(
        " ".join(f"{v:.9g}" for v in (*row["xyz"], 0, 0, 0, 0, *row["n"], row["i"])) + "\n"
        for row in rows
    )
    columns = [rows["xyz"][:, k] for k in range(3)] + [rows["pad"]]
    columns += [rows["n"][:, k] for k in range(3)] + [rows["i"]]
    block = b"".join(np.ascontiguousarray(column).tobytes() for column in columns)
    packed = packed_lzf(block)
    bodies = {
        "ascii": text.encode(),
        "binary": rows.tobytes(),
        "binary_compressed": struct.pack("<II", len(packed), len(block)) + packed,
    }
    return [f"{header}{name}\n".encode() + body for name, body in bodies.items()]


def packed_lzf(data: bytes) -> bytes:
    """Return data compressed by LZF, as PCD files have it."""
    result, waiting, seen, at = bytearray(), bytearray(), dict[bytes, int](), 0

    def copy() -> None:
        for start in range(0, len(waiting), 32):
            piece = waiting[start : start + 32]
            result.append(len(piece) - 1)
            result.extend(piece)
        waiting.clear()

    while at < len(data):
        key = data[at : at + 3]
        before = seen.get(key, at)
        seen[key] = at
        length = 0
        while before < at <= before + 8192 and at + length < len(data) and length < 264:
            if data[before + length] != data[at + length]:
                break
            length += 1
        if length < 3:
            waiting.append(data[at])
            at += 1
            continue
        copy()
        away = at - before - 1
        if length < 9:
            result.append((length - 2) << 5 | away >> 8)
        else:
            result += bytes([7 << 5 | away >> 8, length - 9])
        result.append(away & 255)
        at += length
    copy()
    return bytes(result)


def vtp_files(points: NDArray[np.float64], faces: NDArray[np.int32]) -> list[bytes]:
    """Return VTK PolyData as text, base64, compressed base64 and raw; the last one of our own."""
    arrays = {
        "points": ("Float64", points.astype("<f8"), 'NumberOfComponents="3"'),
        "connectivity": ("Int64", faces.astype("<i8"), ""),
        "offsets": ("Int32", 3 * np.arange(1, len(faces) + 1, dtype="<i4"), ""),
    }

    def text(values: NDArray[np.generic]) -> str:
        return " ".join(map(str, values.ravel().tolist()))

    def inline(values: NDArray[np.generic]) -> str:
        data = values.tobytes()
        return base64.b64encode(struct.pack("<I", len(data)) + data).decode()

    def compressed(values: NDArray[np.generic]) -> str:
        data, size = values.tobytes(), 400
        blocks = [zlib.compress(data[k : k + size]) for k in range(0, len(data), size)]
        head = [len(blocks), size, len(data) % size, *map(len, blocks)]
        parts = struct.pack(f"<{len(head)}I", *head), b"".join(blocks)
        return "".join(base64.b64encode(part).decode() for part in parts)

    result = []
    for encoding, how, more in (
        (text, "ascii", ""),
        (inline, "binary", ""),
        (compressed, "binary", ' compressor="vtkZLibDataCompressor"'),
    ):
        made = {
            name: f'<DataArray type="{kind}" Name="{name}" format="{how}" {width}>'
            f"{encoding(values)}</DataArray>"
            for name, (kind, values, width) in arrays.items()
        }
        content = (
            f'<?xml version="1.0"?>\n<VTKFile type="PolyData" version="0.1" '
            f'byte_order="LittleEndian"{more}>\n<PolyData>\n<Piece NumberOfPoints="{len(points)}" '
            f'NumberOfPolys="{len(faces)}">\n<Points>{made["points"]}</Points>\n<Polys>\n'
            f"{made['connectivity']}\n{made['offsets']}\n</Polys>\n</Piece>\n</PolyData>\n"
            "</VTKFile>\n"
        )
        result.append(content.encode())
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.vtp"
        write_vtp(path, Drawn(points, faces))
        result.append(path.read_bytes())
    return result


def las_file(
    points: NDArray[np.float64],
    *,
    scale: float = 0.001,
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0),
    records: tuple[tuple[int, bytes], ...] = (),
    withheld: int = 0,
) -> bytes:
    """Return a LAS 1.2 file; `records` are numbers and contents of its projection."""
    projection = b"".join(
        struct.pack("<H16sHH32s", 0, b"LASF_Projection", number, len(data), b"") + data
        for number, data in records
    )
    low, high = points.min(axis=0), points.max(axis=0)
    limits = [value for pair in zip(high, low, strict=True) for value in pair]
    header = struct.pack(
        "<4sHH16sBB32s32sHHHIIBHI5I3d3d6d",
        *(b"LASF", 0, 0, b"", 1, 2, b"", b"", 1, 2026, 227, 227 + len(projection), len(records)),
        *(0, 20, len(points), len(points), 0, 0, 0, 0, *([scale] * 3), *offset, *limits),
    )
    rows = np.zeros(len(points), [("xyz", "<i4", 3), ("rest", "u1", 8)])
    rows["xyz"] = np.round((points - offset) / scale)
    rows["rest"][:withheld, 3] = 128  # in the byte of the class
    return header + projection + rows.tobytes()


def _npz_files() -> list[bytes]:
    arrays = {
        "points": np.arange(60.0).reshape(20, 3),
        "labels": np.arange(7),
        "names": np.array(["a", "bc"]),
        "none": np.empty((0, 3), np.float32),
        "one": np.array(3.5),
        "order": np.asfortranarray(np.arange(12).reshape(3, 4)),
        "table": np.zeros(3, [("a", "<i2"), ("b", "<f8")]),
    }
    result = []
    for packing in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        stream = io.BytesIO()
        with zipfile.ZipFile(stream, "w", packing) as archive:
            for name, array in arrays.items():
                member = io.BytesIO()
                np.lib.format.write_array(member, array, version=(1, 0))
                archive.writestr(zipfile.ZipInfo(f"{name}.npy"), member.getvalue())
        result.append(stream.getvalue())
    return result


def _curve_files() -> list[tuple[str, bytes]]:
    nodes = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [1, 1, 0], [1, 2, 0], [0, 2, 0.0]])
    edges = [(0, 1), (1, 2), (1, 3), (3, 4), (4, 5), (5, 0)]
    graph = CurveSkeleton.of(nodes, edges, np.linspace(0.1, 0.2, 6))
    result = []
    with tempfile.TemporaryDirectory() as folder:
        for ending in (".json", ".swc"):
            path = Path(folder) / f"a{ending}"
            write_curve_skeleton(path, graph)
            result.append((ending, path.read_bytes()))
    return result


def _gltf_parts(
    points: NDArray[np.float64], faces: NDArray[np.int32], buffer: dict[str, object]
) -> tuple[str, bytes]:
    """Return the JSON of a glTF file and its buffer."""
    xyz, rows = points.astype("<f4").tobytes(), faces.astype("<u4").tobytes()
    view = {"buffer": 0, "byteOffset": 0, "byteLength": len(xyz)}
    low, high = points.min(axis=0).tolist(), points.max(axis=0).tolist()
    vertices = {"bufferView": 0, "componentType": 5126, "count": len(points), "type": "VEC3"}
    indices = {"bufferView": 1, "componentType": 5125, "count": faces.size, "type": "SCALAR"}
    content = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "translation": [1, 2, 3]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [{**vertices, "min": low, "max": high}, indices],
        "bufferViews": [view, {**view, "byteOffset": len(xyz), "byteLength": len(rows)}],
        "buffers": [{**buffer, "byteLength": len(xyz) + len(rows)}],
    }
    return json.dumps(content), xyz + rows


def _glb(points: NDArray[np.float64], faces: NDArray[np.int32]) -> bytes:
    text, buffer = _gltf_parts(points, faces, {})
    header = text.encode().ljust(-(-len(text) // 4) * 4)
    chunks = struct.pack("<I4s", len(header), b"JSON") + header
    chunks += struct.pack("<I4s", len(buffer), b"BIN\0") + buffer
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def _gltf(points: NDArray[np.float64], faces: NDArray[np.int32]) -> bytes:
    import base64

    _, buffer = _gltf_parts(points, faces, {})
    uri = "data:application/octet-stream;base64," + base64.b64encode(buffer).decode()
    return _gltf_parts(points, faces, {"uri": uri})[0].encode()


def _three_mf(points: NDArray[np.float64], faces: NDArray[np.int32]) -> bytes:
    item = '<item objectid="1" transform="1 0 0 0 1 0 0 0 1 5 0 0"/>'
    return three_mf(f'<object id="1" type="model">{_mesh(points, faces)}</object>', item)


def assembly(parts: int, items: int) -> bytes:
    """Return a 3MF file of a cube of 1 mm that an object places, and that one the build.

    So many times each, 2 mm apart in x and in y.
    """
    rows = [f'<component objectid="1" transform="{_shift(2 * k, 0)}"/>' for k in range(parts)]
    placed = [f'<item objectid="2" transform="{_shift(0, 2 * k)}"/>' for k in range(items)]
    return three_mf(
        f'<object id="1" type="model">{_mesh(*grid_box(1))}</object>'
        f'<object id="2" type="model"><components>{"".join(rows)}</components></object>',
        "".join(placed),
    )


def _shift(x: float, y: float) -> str:
    return f"1 0 0 0 1 0 0 0 1 {x} {y} 0"


def _mesh(points: NDArray[np.float64], faces: NDArray[np.int32]) -> str:
    vertices = "".join(f'<vertex x="{x:g}" y="{y:g}" z="{z:g}"/>' for x, y, z in points.tolist())
    rows = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in faces.tolist())
    return f"<mesh><vertices>{vertices}</vertices><triangles>{rows}</triangles></mesh>"


def three_mf(objects: str, items: str, *, before: str = "", unit: str = "millimeter") -> bytes:
    """Return a 3MF file with these objects, and items of its build."""
    space = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
    model = (
        f'<?xml version="1.0"?>{before}<model unit="{unit}" xmlns="{space}"><resources>'
        f"{objects}</resources><build>{items}</build></model>"
    )
    types = (
        '<?xml version="1.0"?><Types xmlns="http://schemas.openxmlformats.org/package/2006/'
        'content-types"><Default Extension="model" ContentType="application/vnd.ms-package.'
        '3dmanufacturing-3dmodel+xml"/></Types>'
    )
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(zipfile.ZipInfo("[Content_Types].xml"), types)
        archive.writestr(zipfile.ZipInfo("3D/3dmodel.model"), model)
    return stream.getvalue()


def _collada(points: NDArray[np.float64], faces: NDArray[np.int32]) -> bytes:
    values = " ".join(f"{v:g}" for v in points.ravel().tolist())
    rows = " ".join(map(str, faces.ravel().tolist()))
    accessor = "".join(f'<param name="{axis}" type="float"/>' for axis in "XYZ")
    return (
        '<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" '
        'version="1.4.1"><asset><up_axis>Z_UP</up_axis></asset><library_geometries>'
        '<geometry id="g" name="g"><mesh><source id="p">'
        f'<float_array id="pa" count="{points.size}">{values}</float_array><technique_common>'
        f'<accessor source="#pa" count="{len(points)}" stride="3">{accessor}</accessor>'
        '</technique_common></source><vertices id="v"><input semantic="POSITION" source="#p"/>'
        f'</vertices><triangles count="{len(faces)}"><input semantic="VERTEX" source="#v" '
        f'offset="0"/><p>{rows}</p></triangles></mesh></geometry></library_geometries>'
        '<library_visual_scenes><visual_scene id="s"><node id="n"><instance_geometry url="#g"/>'
        '</node></visual_scene></library_visual_scenes><scene><instance_visual_scene url="#s"/>'
        "</scene></COLLADA>"
    ).encode()


def small_tube() -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Return a mesh on which operations take a few milliseconds, for pairs and seeds."""
    return tube(12, 24)
