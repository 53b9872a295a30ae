"""Every registered operation: declaration, run on real and generated shapes, result, writing."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import medialis
from medialis.operations import names
from medialis.operations.names import named_operations
from medialis.operations.registry import OPERATIONS

REAL = Path(__file__).resolve().parents[3] / "shared" / "shapes"
# The largest shapes take seconds each and show nothing that horse2 does not.
NAMES = sorted(p.stem for p in REAL.glob("*.ply") if p.stem != "igea2") or ["missing"]
CUBE = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
FACES = np.array([t for a, b, c, d in QUADS for t in ((a, b, c), (a, c, d))])


@pytest.fixture(scope="module")
def creature() -> medialis.Shape:
    return medialis.organic_shape(56)


@pytest.mark.parametrize("chosen", OPERATIONS, ids=lambda o: o.name)
def test_declarations_are_complete(chosen):
    assert chosen.name.isidentifier() and chosen.filter_name.isidentifier()
    assert chosen.help.splitlines()[0].endswith(".")
    assert chosen.source is None or chosen.source.startswith("thesis ")
    for parameter in chosen.parameters:
        assert parameter.name.isidentifier() and parameter.help.endswith(".")
        assert parameter.check(parameter.default) == parameter.default
        assert len(parameter.choices) == len(parameter.choice_help)  # tooltips of hosts
        for word, sentence in zip(parameter.choices, parameter.choice_help, strict=True):
            assert sentence.endswith(".") and f"{word}: {sentence}" in parameter.full_help
        if isinstance(parameter.default, float):  # single precision in Blender, typed by people
            assert float(f"{parameter.default:.6g}") == parameter.default
    assert chosen.words and not any(word == chosen.label for word in chosen.words)
    json.dumps(chosen.describe(), allow_nan=False)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_real_shapes_give_a_skeleton_with_empty_balls(name, real_shapes):
    """Every real mesh and cloud; no sample of its body is deeper in a ball than the tolerance."""
    from scipy.spatial import cKDTree

    result = medialis.run("surface_skeleton", medialis.read_shape(real_shapes / f"{name}.ply"))
    layer, shape = result.layers[0], result.shape
    assert len(layer.points) >= 0.98 * shape.point_count
    radius = layer.attributes["radius"]
    assert np.isfinite(layer.points).all() and (radius > 0).all()
    rows = np.linspace(0, len(radius) - 1, 5000).astype(int)
    body = shape.bodies[layer.attributes["feature_1"]][rows]
    distance = np.empty(len(rows))
    for number in np.unique(body):
        tree, mine = cKDTree(shape.points[shape.bodies == number]), body == number
        distance[mine] = tree.query(layer.points[rows[mine]])[0]
    limit = (result.parameters["tolerance"] + 1e-9) * shape.diagonal
    assert (radius[rows] - distance).max() <= limit
    ends = shape.points[np.stack([layer.attributes[f"feature_{i}"] for i in (1, 2)])]
    reach = np.linalg.norm(ends - layer.points, axis=2)
    off = np.abs(reach - radius) > 1e-12 * shape.diagonal
    # Balls that touch a triangle name its corner nearest to there, at most an edge away.
    at_crease = layer.attributes["feature_1"] == layer.attributes["feature_2"]
    assert not off[0][~at_crease].any()
    if off[1].any():
        ends = shape.points[shape.edges]
        longest = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).max()
        assert (reach[1] < radius + longest).all()


@pytest.mark.slow
@pytest.mark.parametrize("chosen", OPERATIONS, ids=lambda o: o.name)
def test_every_operation_runs_on_a_real_shape(chosen, real_shapes):
    name = "hand" if chosen.sample == "creature" else "fertility"  # it stands on a plate
    shape = medialis.read_shape(real_shapes / f"{name}.ply")
    # At its default this one takes half a minute.
    quick = {"pairs": 40, "size": 128} if chosen.name == "view_curve_skeleton" else {}
    result = medialis.run(chosen.name, shape, **quick)
    assert result.layers and result.values and result.seconds["total"] > 0


@pytest.mark.parametrize(
    "given",
    [{"color_by": "x"}, {"filter_by": "x"}, {"labels": ("x",)}, {"attributes": {"a": [1]}}],
    ids=lambda given: next(iter(given)),
)
def test_a_layer_has_the_attributes_it_names(given):
    with pytest.raises(medialis.InvalidShapeError, match=r"of layer a has 1 rows|no attribute x"):
        medialis.Layer("a", np.zeros((2, 3)), **given)


@pytest.mark.parametrize("chosen", OPERATIONS, ids=lambda o: o.name)
def test_layers_on_the_input_have_its_points(chosen, small_shape, default_run):
    shape = small_shape(chosen.name)
    for layer in default_run(chosen.name).layers:
        if layer.on_input:
            assert (layer.points == shape.points).all() and (layer.faces == shape.faces).all()


@pytest.mark.slow
def test_a_cube_of_8_vertices_has_its_medial_sheets():
    """Blender's cube: the centers lie on the 12 bisector triangles of edges and center.

    A point belongs to them when its two smallest wall distances agree. Balls touch two samples, and
    a wall is sampled with the spacing h: a contact off by h/sqrt(2) changes the radius by at most
    h^2/(4 r) (thesis 3.2 with the sagitta of the ball), doubled for third-order terms and samples
    near edges; the tolerance adds its share.
    """
    shape = medialis.make_shape(CUBE, FACES, repair=True)
    result = medialis.run("surface_skeleton", shape, fans=False)  # one ball a sample
    assert "refined" in {message.code for message in result.messages}
    layer, fine = result.layers[0], result.shape
    h = np.linalg.norm(np.diff(fine.points[fine.edges], axis=1), axis=2).max()
    inner = layer.attributes["radius"] > 2 * h
    walls = np.sort(np.hstack([layer.points, 1 - layer.points]), axis=1)[inner]
    bound = h**2 / (2 * layer.attributes["radius"][inner]) + 2 * 3e-4 * shape.diagonal
    # Samples at least 2 h from the edges of their face, less one row for the edge itself.
    assert inner.mean() >= (1 - 6 * h) ** 2
    assert (np.abs(walls[:, 1] - walls[:, 0]) <= bound).all()
    assert (np.abs(layer.attributes["radius"][inner] - walls[:, 0]) <= bound).all()
    # All 6 pyramids round the center are there, and the center itself.
    assert abs(layer.attributes["radius"].max() - 0.5) < h
    plain = medialis.run("surface_skeleton", shape, refine=0, fans=False)
    assert len(plain.layers[0].points) == 8
    assert {message.code for message in plain.messages} == {"automatic"}


def test_names_and_parameters_are_checked(creature):
    for name in ("surface_skeleton", "surface-skeleton", "generate_surface_skeleton"):
        assert medialis.operation(name).name == "surface_skeleton"
    with pytest.raises(medialis.InvalidOptionError, match=r"surface_skeleton, .*ball_recon"):
        medialis.run("skeletonize", creature)
    with pytest.raises(medialis.InvalidOptionError, match="no option depth; it has side"):
        medialis.run("surface_skeleton", creature, depth=3)
    with pytest.raises(medialis.InvalidOptionError, match="side must be one of inner"):
        medialis.run("surface_skeleton", creature, side="left")
    with pytest.raises(medialis.InvalidOptionError, match="progressive must be True or False"):
        medialis.run("ball_reconstruction", creature, progressive=1)
    with pytest.raises(medialis.InvalidOptionError, match="size must be"):
        medialis.run("ball_reconstruction", creature, size=2)


def test_cancelling_midway_and_monotone_progress(creature):
    seen = []

    def stop(fraction, text):
        seen.append(fraction)
        return fraction < 0.3

    with pytest.raises(medialis.Cancelled):
        medialis.run("surface_skeleton", creature, progress=stop)
    assert seen == sorted(seen) and seen[-1] >= 0.3


def test_outer_side_of_a_sphere_has_nothing_to_show(creature):
    normals = creature.points / np.linalg.norm(creature.points, axis=1, keepdims=True)
    sphere = medialis.Shape(normals, normals)
    with pytest.raises(medialis.InvalidShapeError, match="No ball of the"):
        medialis.run("surface_skeleton", sphere, side="outer")


@pytest.mark.slow
def test_ball_reconstruction_agrees_with_the_surface():
    """The union of the balls is the shape, up to the sagitta h^2 / (8 R) between samples.

    The limbs have R >= 0.03. Along the silhouette, that gap and half a pixel of rasterizing are
    what can differ: (gap + half a pixel) times the outline over the area, some 0.12 pixels.
    """
    shape = medialis.organic_shape(160)
    result = medialis.run("ball_reconstruction", shape, size=300, progressive=True)
    gap = shape.spacing**2 / (8 * 0.03) / shape.diagonal
    assert result.values["pixels_that_differ_percent"] < 100 * 0.12 * (300 * gap + 0.5)
    assert result.values["median_depth_difference_percent"] < 100 * gap
    errors = [step[1] for step in result.values["progressive"]]
    assert errors == sorted(errors, reverse=True)
    assert result.images["reconstruction"].dtype == np.uint8


@pytest.mark.slow
def test_write_result_is_all_or_nothing(default_run, tmp_path, monkeypatch):
    result = default_run("surface_skeleton")

    def fail(*arguments, **options):
        raise medialis.FileError("disk full")

    monkeypatch.setattr("medialis.show.writing.write_png", fail)
    with pytest.raises(medialis.FileError):
        medialis.write_result(result, tmp_path / "deep" / "out")
    assert list(tmp_path.iterdir()) == []


def test_pictures_of_any_attribute_and_wrong_ones(default_run):
    result = default_run("surface_skeleton")
    for name in result.layers[0].attributes:
        assert medialis.draw_result(result, color_by=name, width=200, height=150).shape == (
            150,
            200,
            3,
        )
    with pytest.raises(medialis.InvalidOptionError, match="no attribute taste; it has importance"):
        medialis.draw_result(result, color_by="taste")


@pytest.mark.parametrize("scale", [1e40, 1e-40])
def test_sizes_beyond_pictures_are_refused(scale):
    """Views of a shape of 1e40 complained about their own pictures; at 1e100 the process ended, and
    at 1e-100 sheets had no area."""
    cube = medialis.make_shape(CUBE * scale, FACES)
    for chosen in OPERATIONS:
        with pytest.raises(medialis.InvalidShapeError, match="1e-30 to 1e\\+30, got"):
            medialis.run(chosen.name, cube)


def test_note_on_infinite_importance_counts_what_the_result_holds():
    """It said that all points between parts are infinite and kept, also where connecting pieces had
    made their importance finite."""
    both = np.concatenate([CUBE, 0.9 * CUBE + 0.05])
    shape = medialis.make_shape(both, np.concatenate([FACES, FACES[:, ::-1] + 8]))
    progress = medialis.Progress()
    result = medialis.run("skeleton_importance", shape, progress=progress)
    infinite = int(np.isinf(result.arrays["importance"]).sum())
    assert result.values["between_parts"] > 0
    (told,) = (m for m in progress.messages if m.code == "between_parts")
    assert told.data["infinite"] == infinite


def test_names_are_read_without_loading_what_they_name():
    """`medialis --help` loaded every algorithm, and numpy, to print one line of each."""
    code = (
        "import sys\n"
        "from medialis.operations.names import named_operations\n"
        "print(*(f'{n.name}|{n.first_line}|{n.order:g}' for n in named_operations()), sep='\\n')\n"
        "assert 'numpy' not in sys.modules and 'medialis.operations.registry' not in sys.modules"
    )
    told = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    expected = [f"{o.name}|{o.help.splitlines()[0]}|{o.order:g}" for o in OPERATIONS]
    assert told.stdout.splitlines() == expected


def test_a_name_that_is_not_written_out_is_found_by_loading(monkeypatch, tmp_path):
    (tmp_path / "made_by_code").mkdir()
    (tmp_path / "made_by_code" / "operation.py").write_text(
        "from dataclasses import replace\n"
        "from medialis.walls.operation import THICKNESS\n"
        "OPERATION = replace(THICKNESS, name='made_by_code')\n"
    )
    monkeypatch.setattr(names, "PACKAGE", tmp_path)
    monkeypatch.setattr(medialis, "__path__", [*medialis.__path__, str(tmp_path)])
    named_operations.cache_clear()
    try:
        assert [n.name for n in named_operations()] == ["made_by_code"]
    finally:
        named_operations.cache_clear()
        for module in [name for name in sys.modules if name.startswith("medialis.made_by_code")]:
            del sys.modules[module]


@pytest.mark.slow
def test_points_that_belong_to_no_sample_are_drawn():
    """Skeleton points in manifolds have features and no source: their picture once failed."""
    result = medialis.run("manifolds", medialis.organic_shape(56), cloud="skeleton")
    image = medialis.draw_result(result, width=200, height=150)
    assert image.shape == (150, 200, 3) and (image < 200).any()
