"""PCD, LAS, LAZ, E57 and VTP in: what was written is read, and damage ends in a sentence."""

import importlib.util
import struct
import time

import numpy as np
import pytest

import medialis
from fuzz.good_files import DATA, las_file, packed_lzf, pcd_files, vtp_files
from fuzz.nasty_shapes import grid_box
from medialis.base._lzf_kernels import unpack_lzf
from medialis.formats import foreign
from medialis.formats.meshes import read_mesh
from medialis.formats.pcd import parse_pcd
from medialis.formats.scans import wkt_length_factors
from medialis.formats.vtk_polydata import parse_vtp

POINTS, FACES = grid_box(3)


def needs(*packages):
    missing = [name for name in packages if importlib.util.find_spec(name) is None]
    reason = f'{", ".join(missing)} not installed (pip install "medialis[scans]")'
    return pytest.mark.skipif(bool(missing), reason=reason)


def read(folder, name, data):
    (folder / name).write_bytes(data)
    return read_mesh(folder / name)


def codes(mesh):
    return [message.code for message in mesh.messages]


@pytest.mark.parametrize("encoding", range(3), ids=["ascii", "binary", "compressed"])
@pytest.mark.parametrize("name", ["a.pcd", "a", "a.xyz"])
def test_pcd_files_have_points_normals_and_a_viewpoint(tmp_path, encoding, name):
    """As pypcd4 writes them, too; a viewpoint at the origin is the default, and says nothing."""
    mesh = read(tmp_path, name, pcd_files(POINTS)[encoding])
    assert mesh.format == "pcd" and mesh.faces is None and mesh.viewpoints is None
    np.testing.assert_allclose(mesh.points, POINTS, rtol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1.0, rtol=1e-9)
    assert codes(mesh)[-1] == "columns_ignored" and mesh.messages[-1].data["columns"] == 1
    mesh = read(tmp_path, name, pcd_files(POINTS, "5 -6 7.5")[encoding])
    assert (mesh.viewpoints == [5, -6, 7.5]).all() and "viewpoints" in codes(mesh)


def test_pcd_points_may_be_nan_and_of_other_types():
    rows = np.zeros(4, [("x", "<f8"), ("y", "<i2"), ("z", "<f4")])
    rows["x"], rows["y"], rows["z"] = [1e7 + 0.125, np.nan, 0, 1], [1, 2, -3, 4], 0.5
    header = b"FIELDS x y z\nSIZE 8 2 4\nTYPE F I F\nWIDTH 2\nHEIGHT 2\nDATA binary\n"
    points = parse_pcd(header + rows.tobytes()).points
    assert points[0].tolist() == [1e7 + 0.125, 1, 0.5] and np.isnan(points[1, 0])
    assert len(points) == 4 and points[2, 1] == -3


HUGE = b"FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 1000000000\nHEIGHT 1\nDATA "


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (HUGE + b"ascii\n1 2 3\n", "announces 1000000000 points"),
        (HUGE + b"binary\n" + bytes(120), "1000000000 points, which need 12000000000 bytes"),
        (HUGE + b"binary_compressed\n" + struct.pack("<II", 9, 2**32 - 1) + bytes(9), "truncated"),
        (HUGE.replace(b"1000000000", b"2") + b"binary_compressed\n\0", "truncated"),
        (HUGE + b"zipped\n", "zipped"),
        (
            HUGE.replace(b"z", b"a").replace(b"1000000000", b"1") + b"ascii\n1 2 3\n",
            "lacks one of the fields x, y, z",
        ),
        (HUGE.replace(b"y", b"x") + b"ascii\n", "names a field twice"),
        (HUGE.replace(b"F F F", b"F F") + b"ascii\n", "incomplete or inconsistent"),
        (HUGE.replace(b"4 4 4", b"4 4 3") + b"ascii\n", "incomplete or inconsistent"),
        (HUGE.replace(b"1000000000", b"-5") + b"ascii\n", "incomplete or inconsistent"),
        (HUGE.replace(b"1000000000", b"9" * 4000) + b"ascii\n", "incomplete"),
        (HUGE, "no line DATA"),
    ],
)
def test_damaged_pcd_files_are_refused_before_any_allocation(tmp_path, data, words):
    with pytest.raises(medialis.InvalidShapeError, match=words) as caught:
        read(tmp_path, "a.pcd", data)
    assert len(str(caught.value)) < 600


def test_lzf_blocks_are_unpacked_and_damaged_ones_are_not():
    rng = np.random.default_rng(0)
    for data in (b"", b"a" * 5000, rng.bytes(3000), b"abcde" * 100 + rng.bytes(50) + b"abcde" * 9,
                 np.repeat(rng.normal(size=400).astype("<f4"), 3).tobytes()):  # fmt: skip
        packed, out = packed_lzf(data), np.zeros(len(data), np.uint8)
        assert unpack_lzf(np.frombuffer(packed, np.uint8), out) == len(data)
        assert out.tobytes() == data
    for packed in (
        b"\x05ab",
        b"\x20",
        b"\xe0\x01",
        b"\x20\x00",
        b"\x00a\x20\x05",
        b"\x02abc\x02abc",
    ):
        out = np.zeros(4, np.uint8)
        assert unpack_lzf(np.frombuffer(packed, np.uint8), out) == -1
    for _ in range(300):  # never beyond the block, whatever it holds
        out = np.zeros(100, np.uint8)
        whole = unpack_lzf(np.frombuffer(rng.bytes(40), np.uint8), out[:60])
        assert whole <= 60 and not out[60:].any()


PROJECTED = 'PROJCS["UTM",GEOGCS["WGS 84",UNIT["degree",0.0174532925]],{}UNIT["{}",{}]]'
METRE = PROJECTED.format("", "metre", 1)
FOOT = PROJECTED.format('PARAMETER["false_easting",1],', "US survey foot", 0.304800609601219)
GEOGRAPHIC = 'GEOGCS["WGS 84",UNIT["degree",0.0174532925]]'
WKT2 = (
    'PROJCRS["x",BASEGEOGCRS["y",ELLIPSOID["e",6378137,298,LENGTHUNIT["metre",1]]],'
    'CONVERSION["z"],CS[Cartesian,2],AXIS["E",east],AXIS["N",north],LENGTHUNIT["foot",0.3048]]'
)


def keys(**values):
    """A directory of GeoTIFF keys."""
    names = {"model": 1024, "linear": 3076, "vertical": 4099}
    rows = [(names[name], 0, 1, value) for name, value in sorted(values.items())]
    rows.sort()
    return struct.pack(f"<{4 * len(rows) + 4}H", 1, 1, 0, len(rows), *sum(rows, ()))


@needs("laspy")
@pytest.mark.slow
@pytest.mark.parametrize(
    ("records", "unit", "code"),
    [
        ((), None, None),
        (((2112, METRE.encode()),), "m", None),
        (((2112, FOOT.encode()),), "ft", None),
        (((2112, WKT2.encode()),), "ft", None),
        (((2112, GEOGRAPHIC.encode()),), None, "geographic_coordinates"),
        (((2112, f'COMPD_CS["c",{METRE},VERT_CS["h",UNIT["foot",0.3048]]]'.encode()),), None,
         "mixed_units"),
        (((2112, f'COMPD_CS["c",{METRE},VERT_CS["h",UNIT["metre",1]]]'.encode()),), "m", None),
        (((34735, keys(model=1, linear=9001)),), "m", None),
        (((34735, keys(model=1, linear=9003, vertical=9003)),), "ft", None),
        (((34735, keys(model=1, linear=9001, vertical=9002)),), None, "mixed_units"),
        (((34735, keys(model=2)),), None, "geographic_coordinates"),
        (((34735, keys(model=1)),), None, None),
    ],
)  # fmt: skip
def test_las_files_keep_millimetres_of_utm_and_their_unit(tmp_path, records, unit, code):
    offset = (500_000.0, 5_400_000.0, 300.0)
    data = las_file(POINTS + offset, offset=offset, records=records, withheld=3)
    mesh = read(tmp_path, "a.las", data)
    assert (mesh.format, mesh.unit, mesh.up, mesh.faces) == ("las", unit, "z", None)
    np.testing.assert_allclose(mesh.points, (POINTS + offset)[3:], rtol=0, atol=5.1e-4)
    assert codes(mesh) == [*([code] if code else []), "points_withheld"]
    assert mesh.messages[-1].data == {"points": 3, "of": len(POINTS)}


@needs("laspy")
@pytest.mark.slow
def test_a_scan_far_from_the_origin_is_computed_near_it(tmp_path):
    """Distances of 1 mm are kept at 5,400 km, up to the operations."""
    rng = np.random.default_rng(1)
    ball = rng.normal(size=(1500, 3))
    ball /= np.linalg.norm(ball, axis=1)[:, None]
    offset = (500_000.0, 5_400_000.0, 300.0)
    (tmp_path / "far.las").write_bytes(las_file(ball + offset, scale=1e-4, offset=offset))
    far = medialis.read_shape(tmp_path / "far.las", unit="m")
    near = medialis.make_shape(np.round(ball, 4))
    radii = [medialis.run("surface_skeleton", one).values["radius_median"] for one in (far, near)]
    assert radii[0] == pytest.approx(radii[1], rel=1e-3) and far.unit == "m"


@pytest.mark.parametrize(
    ("text", "factors"),
    [
        (METRE, (1.0, None)),
        (WKT2, (0.3048, None)),
        (GEOGRAPHIC, (0.0, None)),
        ("", (None, None)),
        ("]" * 100 + "[" * 100, (None, None)),
        ('PROJCS["a",UNIT["x",-1]]', (None, None)),
        ('PROJCS["a",UNIT["x",nan]]', (None, None)),
        ('PROJCS["UNIT[""q"",5]",UNIT["m",1]', (1.0, None)),
    ],
)
def test_units_of_coordinate_systems(text, factors):
    assert wkt_length_factors(text) == factors


@needs("laspy", "lazrs", "pye57")
@pytest.mark.slow
def test_compressed_and_structured_scans(tmp_path):
    """The box of LAZ, and of E57 twice: turned by 90 degrees and moved, two points invalid."""
    mesh = read_mesh(DATA / "box.laz")
    assert mesh.format == "laz" and np.allclose(mesh.points, POINTS, rtol=0, atol=5.1e-4)
    mesh = read(tmp_path, "a.xyz", (DATA / "box.e57").read_bytes())  # the content wins
    turned = POINTS[2:] @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1.0]]) + [10, 20, 30]
    assert (mesh.format, mesh.unit, mesh.up) == ("e57", "m", "z")
    assert np.allclose(mesh.points, np.concatenate([turned, POINTS]), rtol=0, atol=2e-6)
    assert (mesh.viewpoints[: len(turned)] == [10, 20, 30]).all()
    assert np.isnan(mesh.viewpoints[len(turned) :]).all()
    assert codes(mesh) == ["points_invalid", "scans_joined"]
    assert mesh.messages[0].data == {"points": 2, "of": 2 * len(POINTS)}


@needs("pye57")
def test_spherical_coordinates_and_poses():
    from medialis.formats.scans import _from_spherical

    rows = np.array([[2, 0, 0], [2, np.pi / 2, 0], [2, 0, np.pi / 2], [2, 0, -np.pi / 2]])
    expected = [[2, 0, 0], [0, 2, 0], [0, 0, 2], [0, 0, -2]]
    assert np.allclose(_from_spherical(rows), expected, atol=1e-12)


@pytest.mark.parametrize("way", range(4), ids=["text", "base64", "zlib", "raw"])
def test_vtp_files_in_all_encodings(way):
    """144 files that VTK 9 wrote were read alike: 3 meshes, 4 encodings, 3 compressions, 2 orders
    of bytes, 2 sizes of headers."""
    parsed = parse_vtp(vtp_files(POINTS, FACES)[way])
    assert np.array_equal(parsed.points, POINTS) and (parsed.counts == 3).all()
    assert np.array_equal(parsed.corners.reshape(-1, 3), FACES) and parsed.messages == ()


def vtp(sections, points="0 0 0 1 0 0 1 1 0 0 1 0 2 0 0 2 1 0", count=6, more=""):
    return (
        f'<VTKFile type="PolyData" byte_order="LittleEndian"{more}><PolyData><Piece '
        f'NumberOfPoints="{count}"><Points><DataArray type="Float32" format="ascii">{points}'
        f"</DataArray></Points>{sections}</Piece></PolyData></VTKFile>"
    ).encode()


def cells(section, corners, ends):
    arrays = {"connectivity": corners, "offsets": ends}
    made = "".join(
        f'<DataArray type="Int32" Name="{name}" format="ascii">{text}</DataArray>'
        for name, text in arrays.items()
    )
    return f"<{section}>{made}</{section}>"


@pytest.mark.slow
def test_vtp_polygons_strips_and_lines(tmp_path):
    """A quad, a strip of two triangles that faces its way, and a line, which is ignored."""
    content = cells("Polys", "0 1 2 3", "4") + cells("Strips", "1 4 2 5", "4")
    mesh = read(tmp_path, "a.vtp", vtp(content + cells("Lines", "0 1 2", "3")))
    assert codes(mesh) == ["lines_ignored", "quads_split"] and len(mesh.faces) == 4
    normals = np.cross(
        *(mesh.points[mesh.faces[:, k]] - mesh.points[mesh.faces[:, 0]] for k in (1, 2))
    )
    assert (normals[:, 2] > 0).all() and normals[:, 2].sum() == 4.0
    line = read(tmp_path, "b.vtp", vtp(cells("Lines", "0 1 2", "3")))
    assert line.faces is None and len(line.points) == 6


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (vtp("", count=10**9), "announces 1000000000 points, but has 6"),
        (vtp(cells("Polys", "0 1 9", "3")), "beyond the 6"),
        (vtp(cells("Polys", "0 1 2", "4")), "offsets"),
        (vtp(cells("Polys", "0 1 2 3", "3 1")), "offsets"),
        (vtp(cells("Polys", "0 1 1.5", "3")), "whole numbers"),
        (vtp("", points="0 0 x"), "expected a number"),
        (vtp("")[:-40], "damaged or truncated"),
        (b'<!DOCTYPE a [<!ENTITY b "c">]>' + vtp(""), "document type"),
        (vtp("", more=' compressor="vtkLZ4DataCompressor"'), "zlib and LZMA"),
        (vtp("").replace(b"PolyData", b"ImageData"), "ImageData"),
        (vtp("").replace(b"Float32", b"String"), "no type of numbers"),
        (vtp("").replace(b'"ascii"', b'"binary"'), "damaged or truncated"),
        (vtp("").replace(b'"ascii"', b'"appended" offset="-7"'), "damaged or truncated"),
        (vtp("").replace(b'"ascii"', b'"appended" offset="99999999999"'), "damaged or truncated"),
    ],
)
def test_damaged_vtp_files_are_refused(data, words):
    with pytest.raises(medialis.InvalidShapeError, match=words):
        parse_vtp(data)


def test_compressed_blocks_that_claim_too_much_take_no_memory():
    """A block of 20 bytes that claims 4 GB."""
    import base64
    import zlib

    packed = zlib.compress(bytes(100))
    head = struct.pack("<4I", 1, 2**32 - 1, 0, len(packed))
    text = base64.b64encode(head).decode() + base64.b64encode(packed).decode()
    data = vtp("", points=text, more=' compressor="vtkZLibDataCompressor"')
    with pytest.raises(medialis.InvalidShapeError, match="damaged or truncated"):
        parse_vtp(data.replace(b'"ascii"', b'"binary"'))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["a.las", "box.laz", "box.e57", "a.vtp"])
def test_truncated_scans_are_refused_in_a_sentence(tmp_path, name):
    needed = {"a.las": "laspy", "box.laz": "lazrs", "box.e57": "pye57"}.get(name, "numpy")
    pytest.importorskip(needed)
    given = {"a.las": las_file(POINTS), "a.vtp": vtp_files(POINTS, FACES)[3]}
    data = given.get(name) or (DATA / name).read_bytes()
    for share in (0.02, 0.5, 0.9):
        with pytest.raises(medialis.InvalidShapeError) as caught:
            read(tmp_path, name, data[: int(share * len(data))])
        assert str(tmp_path / name) in str(caught.value) and len(str(caught.value)) < 900


@needs("laspy", "lazrs")
@pytest.mark.slow
@pytest.mark.parametrize("name", ["a.las", "box.laz"])
def test_a_header_that_claims_too_many_points_is_refused_in_time(tmp_path, name):
    data = bytearray(las_file(POINTS) if name == "a.las" else (DATA / name).read_bytes())
    data[107:111] = struct.pack("<I", 2**30)  # number of points in LAS 1.2
    begin = time.monotonic()
    with pytest.raises(medialis.InvalidShapeError):
        read(tmp_path, name, bytes(data))
    assert time.monotonic() - begin < 60


def test_missing_packages_are_named(tmp_path, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    for name, package in (("a.las", "laspy"), ("box.laz", "laspy"), ("box.e57", "pye57")):
        data = las_file(POINTS) if name == "a.las" else (DATA / name).read_bytes()
        with pytest.raises(medialis.InvalidShapeError) as caught:
            read(tmp_path, name, data)
        assert f"through {package}" in str(caught.value)
        assert 'pip install "medialis[scans]"' in str(caught.value)


@pytest.mark.parametrize("ending", foreign.BY_CONTENT)
def test_what_is_no_scan_is_told_so(tmp_path, ending):
    with pytest.raises(medialis.InvalidShapeError, match=f"does not begin like a .{ending} file"):
        read(tmp_path, f"a.{ending}", b"\x80" * 1000)
    mesh = read(tmp_path, f"b.{ending}", b"0 0 0\n1 0 0\n0 1 0\n0 0 1\n")
    assert mesh.format == "xyz" and codes(mesh) == ["other_format"]
