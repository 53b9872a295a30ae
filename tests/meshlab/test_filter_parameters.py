"""Parameters as MeshLab users know them: values, units, errors and lists."""

import inspect

import numpy as np
import pytest

from medialis.hosts import filters
from medialis.operations.declaration import Kind, Parameter
from medialis.operations.registry import OPERATIONS
from medialis.operations.result import Layer, Outcome

pymeshlab = pytest.importorskip("pymeshlab", reason="needs pymeshlab (the extra meshlab)")
import medialis_meshlab  # noqa: E402

PercentageValue, PureValue = pymeshlab.PercentageValue, pymeshlab.PureValue
ALL_KINDS = (
    Parameter("share", Kind.FLOAT, 0.5, "Share", "A number."),
    Parameter("count", Kind.INT, 3, "Count", "A whole number.", high=10),
    Parameter("flag", Kind.BOOL, False, "Flag", "Yes or no."),
    Parameter("mode", Kind.CHOICE, "soft", "Mode", "How.", choices=("soft", "hard")),
    Parameter("length", Kind.LENGTH, 0.25, "Length", "How far.", low=0.1, high=2.0),
    Parameter("angle", Kind.ANGLE, 30.0, "Angle", "How wide.", high=90.0),
    Parameter("file", Kind.FILE, "", "File", "Which."),
)


@pytest.fixture
def seen(register):
    """What the core got: a filter generate_made with a parameter of each kind."""
    got = {}

    def run(shape, values, progress):
        got.clear()
        got.update(values.values())
        return Outcome(shape, (Layer("made", shape.points[:1]),))

    register(parameters=ALL_KINDS, run=run)
    return got


def error_of(call):
    """Class and text of the error that a call raises."""
    with pytest.raises(Exception) as caught:
        call()
    return type(caught.value), str(caught.value)


def test_values_reach_the_core(mesh_set, seen, tmp_path, creature):
    mesh_set.generate_made()
    assert seen == {p.name: p.default for p in ALL_KINDS}
    mesh_set.set_current_mesh(0)
    mesh_set.generate_made(
        share=np.float32(0.25),
        count=np.int64(4),
        flag=True,
        mode=1,
        length=PercentageValue(50),
        angle=45,
        file=tmp_path,
    )
    assert seen == {
        "share": 0.25,
        "count": 4,
        "flag": True,
        "mode": "hard",
        "length": 0.5,
        "angle": 45.0,
        "file": str(tmp_path),
    }
    mesh_set.set_current_mesh(0)
    mesh_set.apply_filter("generate_made", mode="hard", length=PureValue(1.2))
    assert seen["mode"] == "hard"
    assert seen["length"] == pytest.approx(1.2 / creature.diagonal, rel=1e-15)


def test_an_unknown_parameter_is_refused_as_by_meshlab(mesh_set, seen):
    ours = error_of(lambda: mesh_set.generate_made(depth=1))
    theirs = error_of(lambda: mesh_set.meshing_merge_close_vertices(depth=1))
    assert ours[0] is theirs[0] is pymeshlab.PyMeshLabException
    assert ours[1] == theirs[1].replace("meshing_merge_close_vertices", "generate_made")


def test_choices_are_refused_as_by_meshlab(mesh_set, seen):
    mesh_set.compute_scalar_by_function_per_vertex(q="x")
    for ours, theirs, old, new in (
        ("foo", "foo", "'RGB'; 'Viridis'; 'Plasma'; 'Cividis'; 'Turbo'; 'RdPu'", "'soft'; 'hard'"),
        (99, 99, "and 6", "and 1"),  # MeshLab's own upper limit is one too many
        (-1, -1, "and 6", "and 1"),
    ):
        mine = error_of(lambda value=ours: mesh_set.generate_made(mode=value))
        real = error_of(
            lambda value=theirs: mesh_set.compute_color_from_scalar_per_vertex(colormap=value)
        )
        assert mine[0] is real[0] is pymeshlab.InvalidEnumException
        assert mine[1] == real[1].replace(old, new)
    for value in (1.5, True, None):
        with pytest.raises(pymeshlab.InvalidEnumException, match="between 0 and 1"):
            mesh_set.generate_made(mode=value)


def test_a_length_must_say_its_unit(mesh_set, seen):
    """MeshLab's sentence, with the names that the classes have today."""
    ours = error_of(lambda: mesh_set.generate_made(length=0.5))
    theirs = error_of(lambda: mesh_set.meshing_merge_close_vertices(threshold=0.5))
    corrected = theirs[1].replace("threshold", "length")
    corrected = corrected.replace("pymeshlab.Percentage ", "pymeshlab.PercentageValue ")
    corrected = corrected.replace("apymeshlab.AbsoluteValue", "a pymeshlab.PureValue")
    assert ours == (theirs[0], corrected)


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"length": PercentageValue(1)}, "length: must be between 10% and 200% .* Value: 1%"),
        ({"length": PureValue(1e6)}, r"\(10% to 200% of the bounding box .* Value: 1e\+06$"),
        ({"length": PureValue(-1)}, "Parameter length: must be between"),
        ({"count": 1.5}, "count must be a whole number, got 1.5"),
        ({"count": 11}, "count must be a number .from 0 to 10., got 11"),
        ({"count": PureValue(1)}, "Parameter count: count must be a number"),
        ({"share": "much"}, "share must be a number"),
        ({"flag": 1}, "flag must be True or False"),
        ({"angle": 91}, "angle must be a number"),
        ({"file": 3}, "file must be the path"),
        ({"auxiliary_layers": "yes"}, "auxiliary_layers must be True or False"),
    ],
    ids=lambda part: next(iter(part)) if isinstance(part, dict) else part,
)
def test_bad_values_change_nothing(mesh_set, seen, given, text):
    with pytest.raises(pymeshlab.PyMeshLabException, match=text):
        mesh_set.generate_made(**given)
    assert mesh_set.mesh_number() == 1 and seen == {}


def test_positional_arguments_are_refused(mesh_set):
    with pytest.raises(TypeError, match="takes 1 positional argument but 2 were given"):
        mesh_set.generate_surface_skeleton(0.1)


def test_errors_of_the_input(mesh_set):
    """No mesh, no faces, no vertices, an error of the core: classes and words as MeshLab's."""
    empty = pymeshlab.MeshSet()
    ours = error_of(empty.generate_surface_skeleton)
    theirs = error_of(empty.meshing_merge_close_vertices)
    assert ours == (
        theirs[0],
        theirs[1].replace("meshing_merge_close_vertices", "generate_surface_skeleton"),
    )
    mesh_set.add_mesh(pymeshlab.Mesh(np.eye(3)), "cloud")
    ours = error_of(mesh_set.generate_geodesic_path)
    theirs = error_of(mesh_set.meshing_surface_subdivision_midpoint)
    assert ours == (
        theirs[0],
        theirs[1].replace("meshing_surface_subdivision_midpoint", "generate_geodesic_path"),
    )
    mesh_set.set_selection_all()
    mesh_set.meshing_remove_selected_vertices()
    for name in ("generate_surface_skeleton", "compute_scalar_by_medial_thickness_per_vertex"):
        with pytest.raises(pymeshlab.PyMeshLabException, match="current mesh has no vertices"):
            mesh_set.apply_filter(name)
    mesh_set.set_current_mesh(0)
    sentence = error_of(lambda: mesh_set.generate_geodesic_path(start=10**6))
    assert sentence[1].startswith("Failed to apply filter: generate_geodesic_path\nDetails: Vert")


def test_too_little_memory_is_one_sentence(mesh_set, register):
    def run(shape, values, progress):
        raise MemoryError

    register(run=run)
    with pytest.raises(pymeshlab.PyMeshLabException, match="Details: There is not enough memory"):
        mesh_set.generate_made()


def test_lists_and_defaults(mesh_set, seen, capsys, creature):
    assert "generate_made" in medialis_meshlab.filter_list()
    assert {o.filter_name for o in OPERATIONS} < {*medialis_meshlab.filter_list()}
    assert "compute_selection_by_medial_thickness_per_vertex" in medialis_meshlab.filter_list()
    medialis_meshlab.print_filter_list()
    assert "\tgenerate_surface_skeleton\n" in capsys.readouterr().out
    medialis_meshlab.print_filter_parameter_list("generate_made")
    assert capsys.readouterr().out.splitlines() == [
        "generate_made filter - list of parameter names:",
        "\tshare : float = 0.5 [min: 0; max: 1]",
        "\tcount : int = 3 [min: 0; max: 10]",
        "\tflag : bool = False",
        "\tmode : str = 'soft' ['soft'; 'hard']",
        "\tlength : PercentageValue = 25% [min: 10%; max: 200%]",
        "\tangle : float = 30.0 [min: 0; max: 90]",
        "\tfile : str = ''",
        "\thide_source : bool = False",
        "\tauxiliary_layers : bool = False",
    ]
    values = medialis_meshlab.filter_parameter_values("generate_made")
    assert values.pop("length").value() == 25
    assert values == {**{p.name: p.default for p in ALL_KINDS if p.name != "length"}} | {
        "hide_source": False,
        "auxiliary_layers": False,
    }
    now = mesh_set.filter_parameter_values("generate_made", mode="hard")
    assert now["mode"] == 1 and now["auxiliary_layers"] is False
    assert now["length"] == pytest.approx(0.25 * creature.diagonal, rel=1e-12)
    with pytest.raises(pymeshlab.PyMeshLabException, match=r"^nothing filter not found\.$"):
        medialis_meshlab.print_filter_parameter_list("nothing")


@pytest.mark.parametrize("chosen", filters(), ids=lambda chosen: chosen.name)
def test_the_defaults_of_a_filter_can_be_given_back(chosen, mesh_set):
    values = medialis_meshlab.filter_parameter_values(chosen.name)
    host = [p.name for p in chosen.host_parameters]
    assert [*values] == [*(p.name for p in chosen.parameters), *host]
    from medialis_meshset.parameters import checked, with_fractions

    given = with_fractions(chosen, checked(chosen, values), 1.0)
    assert not any(given.pop(name) for name in host)
    expected = {p.name: p.default for p in chosen.parameters}
    assert _close(given, expected)


def _close(given, expected):
    return given.keys() == expected.keys() and all(
        given[name] == pytest.approx(value, rel=1e-14)
        if isinstance(value, float)
        else given[name] == value
        for name, value in expected.items()
    )


@pytest.mark.parametrize("chosen", filters(), ids=lambda chosen: chosen.name)
def test_help_shows_parameters_units_and_defaults(chosen):
    method = getattr(pymeshlab.MeshSet, chosen.name)
    text, shown = inspect.getdoc(method), str(inspect.signature(method))
    assert text.startswith(chosen.help.partition("\n")[0][:90])
    for parameter in chosen.parameters:
        assert f"\n{parameter.name} : " in text and f"{parameter.name}=" in shown
        if parameter.auto is not None:
            assert f"{parameter.name}='auto'" in shown
        elif parameter.kind is Kind.LENGTH:
            assert f"{parameter.name}={100 * parameter.default:g}%" in shown
        if parameter.kind is Kind.ANGLE:
            assert "Degrees." in text
    assert max(map(len, text.splitlines())) <= 100


def test_the_core_is_not_asked_for_bad_parameters(mesh_set, monkeypatch):
    """A bad value is reported before the mesh is read."""
    monkeypatch.setattr(
        "medialis_meshset.filters.shape_of_mesh", lambda *_: pytest.fail("the mesh was read")
    )
    with pytest.raises(pymeshlab.PyMeshLabException, match="Parameter sides not found"):
        mesh_set.generate_surface_skeleton(sides="inner")
