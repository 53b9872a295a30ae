"""Lengths with units: what a person types, what it is as a fraction, and what is refused."""

import json
import math
import pickle
import re
from dataclasses import replace

import numpy as np
import pytest

import medialis
from medialis.base.options import METERS, Length, Size, as_length, nearest_unit, unit_name
from medialis.cli.commands import main
from medialis.formats.ply_attributes import write_ply
from medialis.operations.result import quantity
from medialis.show.reports.page import number
from medialis.show.reports.report import report_texts

BOX = [[0, 0, 0], [30, 0, 0], [0, 40, 0], [30, 40, 0]]
FACES = [[0, 1, 2], [1, 3, 2]]
DIAGONAL = 50.0  # of 30 by 40


@pytest.fixture(scope="module")
def creature():
    return replace(medialis.organic_shape(56), unit="mm")


def fraction(text, unit="mm"):
    return Size(DIAGONAL, unit).fraction(as_length(text, "threshold", 0.0, 1.0), "threshold")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("0.01", 0.01), ("1%", 0.01), (" 1 % ", 0.01), ("5e-1 %", 0.005), (".5%", 0.005),
        ("1mm", 1 / 50), ("1 mm", 1 / 50), ("0.1cm", 1 / 50), ("0.2in", 5.08 / 50),
        ("1000um", 1 / 50), ("1000 µm", 1 / 50), ("0.001 metres", 1 / 50), ("2units", 2 / 50),
        ("0.01 feet", 3.048 / 50), ("0", 0.0), ("0mm", 0.0), ("0.1 Inches", 2.54 / 50),
    ],
)  # fmt: skip
def test_what_a_length_is_as_a_fraction(text, expected):
    assert fraction(text) == pytest.approx(expected, rel=1e-15)


def test_the_same_length_in_every_unit_is_the_same_fraction():
    """A box of 50 mm is one of 50 mm whatever its file counts in."""
    for unit, meters in METERS.items():
        size = Size(0.050 / meters, unit)
        assert size.fraction(Length(1.0, "mm"), "x") == pytest.approx(0.02, rel=1e-12)
        assert size.fraction(Length(1.0 / meters / 1000, unit), "x") == pytest.approx(0.02)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("1", ["100 %", "1mm", "1%"]), ("250", ["25000 %", "250mm", "250%"]),
        ("-1mm", ["0 % to 100 %", "0.5%", "1mm"]), ("101%", ["0 % to 100 %"]),
        ("one", ["0.5%", "1mm", "0.2in"]), ("1 furlong", ["mm", "in", "furlong"]),
        ("", ["0.5%"]), ("nan", ["0.5%"]), ("1e999mm", ["finite"]), ("1mm2", ["1mm"]),
    ],
)  # fmt: skip
def test_what_is_refused_says_what_to_write(text, told):
    with pytest.raises(medialis.InvalidOptionError) as error:
        as_length(text, "threshold", 0.0, 1.0)
    assert all(part in str(error.value) for part in told), str(error.value)


def test_text_of_a_length_reads_back_as_the_same():
    rng = np.random.default_rng(1)
    for amount in [*rng.random(50), 0.1, 1e-7, 3.0]:
        for unit in ("mm", "%", "units", ""):
            length = Length(float(amount) / (4 if unit == "" else 1), unit)
            assert as_length(str(length), "x", 0.0, 1.0) == length == eval_pickle(length)


def eval_pickle(length):
    return pickle.loads(pickle.dumps(length))


def test_units_of_files_in_words():
    assert [unit_name(w) for w in ("MM", "meters", "Foot", "parsec")] == ["mm", "m", "ft", None]
    assert nearest_unit("0.01 * meters") == "cm" and nearest_unit("x * meters") is None
    with pytest.raises(medialis.InvalidOptionError, match="unit must be one of"):
        medialis.make_shape(BOX, FACES, unit="parsec")


@pytest.mark.slow
def test_text_values_and_numbers_give_the_same_bits(creature):
    """For operations, for functions of a shape, of a cloud, and of what is computed from one."""
    share = 1.0 / creature.diagonal
    for spelling in ("1mm", medialis.mm(1), medialis.Length(0.1, "cm"), "1 units"):
        assert medialis.refine(creature, longest_edge=spelling).points.tobytes() == (
            medialis.refine(creature, longest_edge=share).points.tobytes()
        )
    cloud = medialis.surface_skeleton(creature)
    length = 0.08 * cloud.surface.diagonal
    graph = medialis.curve_skeleton(cloud, threshold=f"{length!r}mm")
    assert graph.nodes.tobytes() == medialis.curve_skeleton(cloud, threshold=0.08).nodes.tobytes()
    short = medialis.simplify_branches(graph, simplify="2%")
    assert short.nodes.tobytes() == medialis.simplify_branches(graph, simplify=0.02).nodes.tobytes()
    importance = medialis.geodesic_importance(cloud)
    found = medialis.important_points(importance, threshold="5 %")
    assert (found == medialis.important_points(importance, threshold=0.05)).all()


def test_lengths_of_plain_arrays_are_shares_of_their_extent():
    points = np.array(BOX, float)
    by_text = medialis.mean_shift(points, search_radius="20%")
    assert (by_text.labels == medialis.mean_shift(points, search_radius=0.2).labels).all()
    with pytest.raises(medialis.InvalidOptionError, match="unit of the shape is not known"):
        medialis.mean_shift(points, search_radius="1mm")


@pytest.mark.slow
def test_a_run_tells_what_was_given_in_all_spellings(creature):
    result = medialis.run("thickness", creature, threshold="0.002in")
    own = 0.002 * 25.4
    assert result.parameters["threshold"] == pytest.approx(own / creature.diagonal)
    told = [m for m in result.messages if m.code == "length"]
    assert len(told) == 1
    numbers = re.findall(r"[\d.]+ (?:in|mm|%)", told[0])
    share = f"{100 * own / creature.diagonal:.4g} %"
    assert numbers == ["0.002 in", "0.0508 mm", share, f"{creature.diagonal:.4g} mm"]
    assert not [m for m in medialis.run("thickness", creature).messages if m.code == "length"]


def test_real_lengths_need_a_unit(creature):
    with pytest.raises(medialis.InvalidOptionError, match="--unit mm"):
        medialis.run("thickness", replace(creature, unit=None), threshold="1mm")


def test_a_length_beyond_its_range_is_refused_with_its_size(creature):
    with pytest.raises(medialis.InvalidOptionError, match=r"5 m = 5,000 mm = .*0 % to 100 %"):
        medialis.run("thickness", creature, threshold="5m")


@pytest.mark.slow
def test_the_unit_stays_with_what_is_computed(creature):
    cloud = medialis.surface_skeleton(creature)
    assert cloud.surface is not creature and cloud.surface.unit == "mm"
    assert medialis.run("thickness", creature).shape.unit == "mm"
    far = replace(creature, points=creature.points + 1e5)
    assert medialis.run("thickness", far).shape.unit == "mm"


def test_a_number_beyond_its_range_is_told_how_lengths_are_written(creature):
    with pytest.raises(medialis.InvalidOptionError, match=r"Write 3mm, 3units \(of the shape\)"):
        medialis.run("thickness", creature, refine=3)


@pytest.mark.slow
def test_a_threshold_that_calls_most_of_a_shape_thin_is_said(creature):
    result = medialis.run("thickness", creature, threshold="90%")
    warned = [m for m in result.messages if m.code == "mostly_thin"]
    assert len(warned) == 1 and warned[0].data["share"] == 1.0 and "2.739 mm" in warned[0]
    median = f"{0.9 * result.values['thickness_median'] / creature.diagonal:.9f}"
    few = medialis.run("thickness", creature, threshold=float(median))
    assert not [m for m in few.messages if m.code == "mostly_thin"]


@pytest.mark.slow
def test_the_command_line_takes_lengths_and_the_unit_of_a_file(creature, tmp_path, capsys):
    path = tmp_path / "part.ply"
    write_ply(path, creature.points, faces=creature.faces)
    plain = ["thickness", str(path), "-o", str(tmp_path / "out"), "--no-picture", "--json"]
    assert main([*plain, "--unit", "cm", "--threshold", "0.5 mm"]) == 0
    manifest = json.loads(capsys.readouterr().out)
    assert manifest["parameters"]["threshold"] == pytest.approx(0.05 / creature.diagonal)
    assert manifest["unit"] == "cm" and manifest["lengths"] == {"threshold": "0.5 mm"}
    for bad in (["--threshold", "1"], ["--threshold", "1mm"], ["--unit", "ell"]):
        assert main([*plain, "--overwrite", *bad]) == 2
    said = capsys.readouterr().err.splitlines()
    assert "Write 1mm" in said[0] and "--unit mm" in said[1] and "unit must be" in said[2]


@pytest.mark.parametrize(("ending", "unit"), [("3mf", "mm"), ("glb", "m"), ("ply", None)])
def test_the_format_of_a_file_tells_its_unit(ending, unit, tmp_path):
    trimesh = pytest.importorskip("trimesh", reason="reads these formats")
    if ending == "3mf":
        pytest.importorskip("lxml", reason="trimesh reads 3MF with it")
    path = tmp_path / f"box.{ending}"
    trimesh.creation.box(extents=(1, 2, 3)).export(path)
    shape = medialis.read_shape(path)
    assert shape.unit == unit and shape.diagonal == pytest.approx(math.sqrt(14))
    progress = medialis.Progress()
    assert medialis.read_shape(path, unit="inches", progress=progress).unit == "in"
    assert ["other_unit"] * (unit is not None) == [m.code for m in progress.messages]


@pytest.mark.slow
def test_the_report_tells_lengths_and_areas_in_the_unit(creature):
    result = medialis.run("skeleton_mesh", creature)
    told = report_texts(result)
    page, values = told["report.html"], result.values
    assert json.loads(told["report.json"])["unit"] == "mm"
    assert f"diagonal {number(values['diagonal'])} mm" in page
    assert f"{number(values['radius_max'])} mm" in page
    assert f"{number(values['area'])} mm²" in page
    bare = report_texts(medialis.run("skeleton_mesh", replace(creature, unit=None)))["report.html"]
    assert " mm" not in bare and "in the units of the file" in bare


@pytest.mark.parametrize(("ending", "told"), [("glb", "unit: m"), ("ply", "unit: unknown")])
def test_info_tells_the_unit(ending, told, creature, tmp_path, capsys):
    if ending == "glb":
        trimesh = pytest.importorskip("trimesh", reason="reads glTF")
        trimesh.creation.box().export(tmp_path / "a.glb")
    else:
        write_ply(tmp_path / "a.ply", creature.points, faces=creature.faces)
    assert main(["info", str(tmp_path / f"a.{ending}")]) == 0
    said = capsys.readouterr().out
    assert told in said
    if ending == "glb":  # each length, area and volume has its unit
        for words in ("size 1 x 1 x 1 m\n", "area 6 m²", "volume 1 m³", "diagonal 1.73205 m,"):
            assert words in said
    else:
        assert " m" not in said.partition("diagonal")[2].partition("unit")[0]


def numbers_of(values, names=()):
    """Numbers of a result by the names that lead to them; tables are lists of dictionaries."""
    for name, value in values.items():
        if isinstance(value, float) and value:
            yield (*names, name), value
        elif isinstance(value, dict):
            yield from numbers_of(value, (*names, name))
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            yield from numbers_of(value[0], (*names, name))


@pytest.mark.slow
@pytest.mark.parametrize(
    "operation",
    ["tree_cylinders", "convex_pieces", "thickness", "curve_skeleton", "surface_skeleton"],
)
def test_values_are_lengths_areas_and_volumes_where_they_scale_so(operation, creature):
    """Volumes of trees and pieces were printed without a unit (fixed)."""
    powers = {"length": 1, "area": 2, "volume": 3}
    large = medialis.make_shape(4.0 * creature.points, creature.faces)
    small, large = (dict(numbers_of(medialis.run(operation, one).values))
                    for one in (replace(creature, unit=None), large))  # fmt: skip
    assert len(small) > 3 and small.keys() == large.keys()
    for names, value in small.items():
        if names[-1] != "persistence":  # a length of thin spots, but not of parts and ends
            power = powers.get(quantity(names[-1]), 0)
            assert large[names] == pytest.approx(4.0**power * value, rel=0.02), names
