"""Every operation through its operator: same arrays as the core, undo, saving, errors, jobs."""

import os
from functools import cache, partial
from types import SimpleNamespace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy", reason="bpy is not installed: make hosts")
import medialis
from blender_scenes import add_mesh, add_object, counts, groups_of, read_back
from medialis.formats.meshes import read_mesh
from medialis.operations.declaration import Kind
from medialis.operations.registry import OPERATIONS, operation

CUBE = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]


def start(name, **given):
    """Run the operator of an operation, as a script does."""
    return getattr(bpy.ops.medialis, name)(**given)


def refused(name, **given):
    """Return the sentence of an operator that reports an error (a script gets it as this)."""
    before = counts()
    with pytest.raises(RuntimeError) as caught:
        start(name, **given)
    assert counts() == before
    return str(caught.value)


@pytest.fixture(scope="module")
def expected(real_shapes):
    """A real shape as Blender holds its vertices (single precision), and results of the core."""

    @cache
    def held(file):
        mesh = read_mesh(real_shapes / file)
        points = mesh.points.astype(np.float32).astype(float)
        shape = medialis.make_shape(points, mesh.faces, repair=True)
        return points, mesh.faces, shape, cache(partial(medialis.run, shape=shape))

    return lambda chosen: held("hand.ply" if chosen.sample == "creature" else "fertility.ply")


@pytest.mark.parametrize("chosen", OPERATIONS, ids=lambda o: o.name)
def test_every_operation_gives_the_arrays_of_the_core(chosen, expected, scene, tmp_path):
    """On a real shape; and what was added is the same after saving and loading the file."""
    points, faces, shape, run = expected(chosen)
    add_mesh("hand", points, faces)
    given = {"views_by": "CPU"} if chosen.name == "view_curve_skeleton" else {}
    assert start(chosen.name, add_samples=True, **given) == {"FINISHED"}
    check(run(chosen.name), shape)
    path = str(tmp_path / "file.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path, check_existing=False)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.wm.open_mainfile(filepath=path)
    check(run(chosen.name), shape)


def check(result, shape):
    hand = bpy.data.objects["hand"]
    for layer in result.layers:
        if layer.on_input:
            data = hand.data
            for name, values in layer.attributes.items():
                missing = np.nan if np.asarray(values).dtype.kind == "f" else -1
                same(data, name, shape.on_input_points(np.asarray(values), missing))
            if "skin" not in result.extras:  # otherwise the groups are weights (test_armatures.py)
                check_groups(hand, layer, shape)
            continue
        made = bpy.data.objects[f"hand {layer.name.replace('_', ' ')}"]
        assert made.parent == hand and made["medialis_summary"]
        if made.type == "ARMATURE":
            assert len(made.data.bones) == result.extras["bones"].count
            continue
        same(made.data, "position", layer.points)
        for name, values in layer.attributes.items():
            same(made.data, name, np.asarray(values))
        for name, values in layer.face_attributes.items():
            same(made.data, name, np.asarray(values))
        if layer.filter_by:
            assert made.modifiers["Medialis"].node_group is not None
        if layer.color_by:
            assert made.data.materials[0] is not None
    for name in result.images:
        assert bpy.data.images[f"hand {name.replace('_', ' ')}"].packed_file is not None


def same(data, name, values):
    if values.dtype.kind == "f":
        values = values.astype(np.float32)
    assert np.array_equal(read_back(data, name), values, equal_nan=values.dtype.kind == "f")


def check_groups(hand, layer, shape):
    groups = groups_of(hand)
    for name in layer.labels:
        labels = shape.on_input_points(np.asarray(layer.attributes[name]), -1)
        name = {"parts": "part", "patches": "patch"}.get(name, name)
        for label in np.unique(labels[labels >= 0]):
            assert groups[f"{name} {label:03d}"] == np.flatnonzero(labels == label).tolist()
        assert sum(g.startswith(f"{name} ") for g in groups) == len(np.unique(labels[labels >= 0]))


@pytest.mark.parametrize("chosen", OPERATIONS, ids=lambda o: o.name)
def test_properties_are_those_of_the_core(chosen, addon):
    """Defaults come back exactly, though Blender keeps them in single precision and per cent."""
    from blender_addon import properties

    kind = getattr(bpy.types, f"MEDIALIS_OT_{chosen.name}")
    assert kind.bl_label == chosen.label and {"REGISTER", "UNDO"} <= kind.bl_options
    rna = getattr(bpy.ops.medialis, chosen.name).get_rna_type()
    assert rna.description == chosen.help.splitlines()[0].removesuffix(".")
    for parameter in chosen.parameters:
        shown = rna.properties[parameter.name]
        assert shown.name.startswith(parameter.label)
        assert shown.description.startswith(parameter.help.removesuffix("."))
        number = parameter.default if parameter.auto is None else parameter.auto
        assert properties.value_of(parameter, shown.default) == number
        assert (f"use_{parameter.name}" in rna.properties) == (parameter.auto is not None)
        if parameter.kind is Kind.CHOICE:
            assert tuple(item.identifier for item in shown.enum_items) == parameter.choices
        if parameter.kind is Kind.LENGTH:
            assert shown.subtype == "PERCENTAGE"
            assert shown.hard_max == pytest.approx(100 * parameter.high)


def test_parameters_arrive(scene):
    """Two per cent, a choice and degrees: as the core with 0.02, the same choice and degrees."""
    shape = medialis.organic_shape(56)
    points = shape.points.astype(np.float32).astype(float)
    add_mesh("creature", points, shape.faces)
    start("surface_skeleton", subsample=2.0, side="both", tolerance=0.1)
    given = medialis.make_shape(points, shape.faces, repair=True)
    result = medialis.run("surface_skeleton", given, subsample=0.02, side="both", tolerance=0.001)
    made = bpy.context.active_object
    assert made.name == "creature surface skeleton"
    same(made.data, "position", result.layers[0].points)
    bpy.context.view_layer.objects.active = bpy.data.objects["creature"]
    start("skeleton_mesh", min_spoke_angle=np.radians(70.5))
    mesh = medialis.run("skeleton_mesh", given, min_spoke_angle=70.5)
    same(bpy.context.active_object.data, "position", mesh.layers[0].points)


def test_automatic_values_are_chosen_until_they_are_typed(scene):
    """Scripts type a number alone; buttons send all numbers, and switches that say which count."""
    from blender_addon import properties

    chosen = operation("curve_skeleton")
    defaults = bpy.ops.medialis.curve_skeleton.get_rna_type().properties

    def parameters(**given):
        values = {n: defaults[n].default for n in properties.annotations_of(chosen)} | given
        own = SimpleNamespace(is_property_set=given.__contains__)
        holder = SimpleNamespace(properties=own, lengths_in="SIZE", **values)
        return properties.parameters_of(chosen, holder)

    assert parameters()["refine"] == "auto"
    for value in (2.0, 5.0):  # the first is what automatic begins with
        assert parameters(refine=value)["refine"] == value / 100
        assert parameters(refine=value, use_refine=True)["refine"] == value / 100
        assert parameters(refine=value, use_refine=False)["refine"] == "auto"
    settings = bpy.context.scene.medialis
    own = settings.of_curve_skeleton
    sent = properties.values_of(chosen, settings)
    assert sent["use_refine"] is False
    own.use_refine = True
    assert properties.parameters_of(chosen, own)["refine"] == 0.02
    assert properties.parameters_of(chosen, own)["threshold"] == "auto"


def test_lengths_in_scene_units(scene):
    """Two tenths of a unit are what they are as a share; notes tell them in the scene's unit."""
    add_mesh("cube", CUBE, QUADS)
    scene.unit_settings.scale_length = 0.001
    start("surface_skeleton", lengths_in="SCENE", subsample_in_units=0.2)
    own = read_back(bpy.context.active_object.data, "position")
    notes = bpy.context.active_object["medialis_summary"]
    assert "0.2 mm" in notes
    bpy.context.view_layer.objects.active = bpy.data.objects["cube"]
    start("surface_skeleton", subsample=20 / np.sqrt(3))
    assert np.array_equal(own, read_back(bpy.context.active_object.data, "position"))


def test_notes_are_in_the_words_of_the_panel(scene):
    add_mesh("cube", CUBE, QUADS)
    start("surface_skeleton")
    notes = bpy.context.active_object["medialis_summary"]
    assert "Hide below: 0 % shows all" in notes and "threshold = 0" not in notes


def test_an_active_result_stands_for_its_source(scene):
    add_mesh("cube", CUBE, QUADS)
    start("surface_skeleton")
    assert bpy.context.active_object.name == "cube surface skeleton"
    start("thickness")
    assert "thickness" in bpy.data.objects["cube"].data.attributes


def test_undo_takes_the_result_back_and_redo_brings_it(scene):
    add_mesh("cube", CUBE, QUADS)
    bpy.ops.ed.undo_push(message="before")
    before, names = counts(), sorted(bpy.data.objects["cube"].data.attributes.keys())
    bpy.ops.medialis.thickness("EXEC_DEFAULT", True)
    bpy.ops.medialis.surface_skeleton("EXEC_DEFAULT", True)
    after = counts()
    bpy.ops.ed.undo()
    bpy.ops.ed.undo()
    cube = bpy.data.objects["cube"]
    assert counts() == before and sorted(cube.data.attributes.keys()) == names
    assert not cube.vertex_groups and "medialis_summary" not in cube
    bpy.ops.ed.redo()
    bpy.ops.ed.redo()
    assert counts() == after
    assert "thickness" in bpy.data.objects["cube"].data.attributes


def test_from_edit_mode(scene):
    """Attributes cannot be written in edit mode: Blender is in object mode afterwards."""
    cube = add_mesh("cube", CUBE, QUADS)
    bpy.ops.object.mode_set(mode="EDIT")
    assert start("thickness") == {"FINISHED"}
    assert cube.mode == "OBJECT" and len(read_back(cube.data, "thickness")) == 8


def test_texts_get_a_copy_with_the_field(scene):
    curve = bpy.data.curves.new("text", "FONT")
    curve.body, curve.extrude = "I", 0.2
    word = add_object("word", curve)
    assert start("thickness") == {"FINISHED"}
    made = bpy.data.objects["word thickness"]
    assert made.parent == word and (read_back(made.data, "thickness") > 0).all()


def test_errors_are_sentences_and_change_nothing(scene, tmp_path):
    assert "no active object" in refused("surface_skeleton")
    add_mesh("empty", np.empty((0, 3)), [])
    assert "empty has no vertices" in refused("thickness")
    add_mesh("points", np.random.default_rng(1).normal(size=(60, 3)), [])
    assert "Error: " in refused("geodesic_path")
    assert "got a point cloud" in refused("skeleton_mesh")
    cube = add_mesh("cube", CUBE, QUADS, scale=(1, 0, 1))
    assert "needs a size in every direction" in refused("surface_skeleton")
    cube.scale = (1, 1, 1)
    add_mesh("huge", 1000 * CUBE, QUADS, scale=(1e38, 1e38, 1e38))
    assert "must be within 1e-30 to 1e+30" in refused("surface_skeleton")
    bpy.context.view_layer.objects.active = cube
    assert "Lower the threshold" in refused("skeleton_importance", threshold=1000)
    assert "Error: " in refused("geodesic_path", start=3, end=700)
    flat = add_mesh("flat", CUBE * (1, 1, 0) + (0, 0, 1), QUADS[:1])
    assert "Error: " in refused("surface_skeleton")
    assert flat.name in bpy.data.objects
    bpy.data.libraries.write(str(tmp_path / "lib.blend"), {cube})
    with bpy.data.libraries.load(str(tmp_path / "lib.blend"), link=True) as (_, into):
        into.objects = ["cube"]
    add = into.objects[0]
    scene.collection.objects.link(add)
    bpy.context.view_layer.objects.active = add
    assert "make it local" in refused("thickness")


def test_very_small_and_large_objects(scene):
    """Results scale with the object; only beyond single precision they are refused."""
    found = []
    for scale in (1e-12, 1.0, 1e12):
        add_mesh("cube", CUBE, QUADS, scale=(scale, scale, scale))
        assert start("surface_skeleton") == {"FINISHED"}
        found.append(read_back(bpy.context.active_object.data, "radius") / np.float32(scale))
    assert np.allclose(found[0], found[1], rtol=1e-3)
    assert np.allclose(found[2], found[1], rtol=1e-3)


def test_a_cancelled_run_reports_and_changes_nothing(scene, monkeypatch):
    from blender_addon import jobs

    add_mesh("cube", CUBE, QUADS)
    before, real = counts(), jobs.Job.wait

    def wait(job, report):
        job.cancel()
        real(job, report)

    monkeypatch.setattr(jobs.Job, "wait", wait)
    assert start("thickness") == {"CANCELLED"}
    assert counts() == before and jobs.running is None


def test_a_crash_is_a_sentence_and_the_next_run_works(scene, monkeypatch):
    from blender_addon import jobs

    add_mesh("cube", CUBE, QUADS)
    real = jobs.Job.wait

    def wait(job, report):
        jobs.computer()._process.kill()
        real(job, report)

    with monkeypatch.context() as patch:
        patch.setattr(jobs.Job, "wait", wait)
        assert "The system killed the process" in refused("surface_skeleton")
    assert start("surface_skeleton") == {"FINISHED"}


class FakeOperator:
    """The operator around its methods: what a window would keep in a modal operator."""

    def __init__(self, name, **given):
        from blender_addon import operators

        self.__class__ = type("Fake", (FakeOperator, operators.OperationOperator), {})
        self.operation = operation(name)
        self.reports = []
        for parameter in self.operation.parameters:
            value = given.get(parameter.name, parameter.default)
            if parameter.auto is not None:
                setattr(self, f"use_{parameter.name}", parameter.name in given)
                value = given.get(parameter.name, parameter.auto)
            scale = {Kind.LENGTH: 100, Kind.ANGLE: np.radians(1)}.get(parameter.kind)
            setattr(self, parameter.name, value if scale is None else scale * value)
        self.add_samples = self.keep_materials = self.keep_earlier = self.curves = False
        self.legend, self.legend_in_renders, self.segments_as = True, False, set()

    def report(self, kind, text):
        self.reports.append((*kind, text))


class FakeContext:
    """The real context with a window manager that records what a window would show."""

    def __init__(self):
        self.shown, self.timers = [], 0
        self.window = SimpleNamespace()
        self.workspace = SimpleNamespace(status_text_set=self.shown.append)
        self.window_manager = SimpleNamespace(
            windows=[],
            progress_begin=lambda *_: None,
            progress_update=lambda *_: None,
            progress_end=lambda: None,
            modal_handler_add=lambda _: None,
            event_timer_add=self._add,
            event_timer_remove=self._remove,
        )

    def _add(self, *_, **__):
        self.timers += 1
        return self.timers

    def _remove(self, _):
        self.timers -= 1

    def __getattr__(self, name):
        return getattr(bpy.context, name)


TIMER = SimpleNamespace(type="TIMER", value="NOTHING")
ESC = SimpleNamespace(type="ESC", value="PRESS")
MOVE = SimpleNamespace(type="MOUSEMOVE", value="NOTHING")


@pytest.fixture
def modal(scene, monkeypatch):
    """Begin an operation as from a button; nothing is heard of it until it is let go."""
    import threading

    from blender_addon import jobs, operators

    monkeypatch.setattr(operators, "bpy", SimpleNamespace(app=SimpleNamespace(background=False)))
    go, real = threading.Event(), jobs.Job.look
    monkeypatch.setattr(
        jobs.Job, "look", lambda job: real(job) if go.is_set() else job._computation.done
    )

    def begin(name, **given):
        fake, context = FakeOperator(name, **given), FakeContext()
        assert fake.invoke(context, None) == {"RUNNING_MODAL"}
        assert jobs.running is not None
        return fake, context, go

    yield begin
    go.set()
    jobs.stop()


def finish(fake, context, go):
    go.set()
    fake._tasks.job.wait()
    return fake.modal(context, TIMER)


def test_a_job_shows_progress_and_ends_with_the_result(modal):
    from blender_addon import jobs

    add_mesh("cube", CUBE, QUADS)
    fake, context, go = modal("surface_skeleton")
    assert fake.modal(context, TIMER) == {"PASS_THROUGH"}
    assert fake.modal(context, MOVE) == {"PASS_THROUGH"}  # other work goes on
    told = []
    bar = SimpleNamespace(label=lambda text, icon="NONE": told.append((text, icon)))
    context.shown[-1](SimpleNamespace(layout=bar), context)  # as Blender draws the status bar
    assert told[0] == ("Cancel", "EVENT_ESC") and told[1][0].startswith("Surface skeleton of cube")
    with pytest.raises(RuntimeError, match="is being computed"):
        start("thickness")
    assert finish(fake, context, go) == {"FINISHED"}
    assert jobs.running is None and context.timers == 0 and context.shown[-1] is None
    assert fake.reports[0][0] == "INFO" and "cube surface skeleton" in bpy.data.objects
    assert fake._tasks.job.fraction == 1.0


def test_a_job_adds_an_armature(modal, monkeypatch):
    """Bones need edit mode for a moment: afterwards Blender is in object mode."""
    shape = medialis.organic_shape(56)
    figure = add_mesh("figure", shape.points, shape.faces)
    monkeypatch.setattr(FakeOperator, "bind", True, raising=False)
    fake, context, go = modal("armature")
    assert finish(fake, context, go) == {"FINISHED"}
    assert figure.parent.type == "ARMATURE" and bpy.context.mode == "OBJECT"
    assert len(figure.parent.data.bones) == len(figure.vertex_groups) > 8


def test_esc_cancels_at_once(modal):
    add_mesh("cube", CUBE, QUADS)
    before = counts()
    fake, context, _ = modal("surface_skeleton")
    assert fake.modal(context, ESC) == {"CANCELLED"}  # at once, also while nothing is heard
    assert fake.reports == [("INFO", "Cancelled: nothing was written or changed.")]
    assert counts() == before and context.timers == 0


def test_the_button_cancels(modal):
    add_mesh("cube", CUBE, QUADS)
    fake, context, go = modal("surface_skeleton")
    assert bpy.ops.medialis.cancel_computation() == {"FINISHED"}
    assert finish(fake, context, go) == {"CANCELLED"}
    assert bpy.ops.medialis.cancel_computation() == {"FINISHED"}  # nothing runs: nothing happens


def test_blender_ends_the_operator(modal):
    """On loading a file Blender calls `cancel`: the computation stops, nothing stays."""
    from blender_addon import jobs

    add_mesh("cube", CUBE, QUADS)
    fake, context, _ = modal("surface_skeleton")
    fake.cancel(context)
    assert jobs.running is None and context.timers == 0


def test_the_source_is_deleted_meanwhile(modal):
    cube = add_mesh("cube", CUBE, QUADS)
    fake, context, go = modal("surface_skeleton")
    bpy.data.objects.remove(cube)
    before = counts()
    assert finish(fake, context, go) == {"CANCELLED"}
    assert "cube was deleted or renamed" in fake.reports[0][1] and counts() == before


def test_the_faces_are_changed_meanwhile(modal):
    cube = add_mesh("cube", CUBE, QUADS)
    fake, context, go = modal("thickness")
    cube.data.clear_geometry()
    before = counts()
    assert finish(fake, context, go) == {"CANCELLED"}
    assert "were changed while" in fake.reports[0][1] and counts() == before
    assert "thickness" not in cube.data.attributes


@pytest.mark.parametrize("reason", [None, "no driver"])
def test_a_job_gets_its_views_from_blender(reason, modal, monkeypatch):
    """The main thread renders in the timer; where it cannot, the result says so."""
    from blender_addon import tasks, views

    if reason is None and views.why_no_gpu() is not None:
        pytest.skip("Blender cannot draw on this machine")
    monkeypatch.setattr(tasks.views, "why_no_gpu", lambda: reason)
    add_mesh("cube", CUBE, QUADS)
    fake, context, go = modal("view_curve_skeleton", pairs=12, size=64)
    assert fake._tasks.job._computation._render is None  # the fake has no such option: as "CPU"
    fake.cancel(context)
    monkeypatch.setattr(FakeOperator, "views_by", "GPU", raising=False)
    fake, context, go = modal("view_curve_skeleton", pairs=12, size=64)
    go.set()
    while fake.modal(context, TIMER) != {"FINISHED"}:
        pass
    notes = bpy.data.objects["cube view curve skeleton"]["medialis_summary"]
    assert ("cannot render views here (no driver)" in notes) == (reason is not None)


def test_other_edits_meanwhile_do_no_harm(modal):
    """Undo, moving the source and another active object: the result lies on the source."""
    cube = add_mesh("cube", CUBE, QUADS)
    bpy.ops.ed.undo_push(message="a")
    bpy.ops.mesh.primitive_uv_sphere_add()
    bpy.ops.ed.undo_push(message="b")
    bpy.context.view_layer.objects.active = bpy.data.objects["cube"]
    fake, context, go = modal("thickness")
    bpy.ops.ed.undo()
    cube = bpy.data.objects["cube"]
    cube.location = (5, 5, 5)
    bpy.context.view_layer.objects.active = None
    assert finish(fake, context, go) == {"FINISHED"}
    assert len(read_back(cube.data, "thickness")) == 8


def test_another_object_is_edited_meanwhile(modal):
    """The edits are kept; objects cannot be added in edit mode, so it ends."""
    add_mesh("cube", CUBE, QUADS)
    fake, context, go = modal("surface_skeleton")
    other = add_mesh("other", CUBE, QUADS)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.mesh.subdivide()
    assert finish(fake, context, go) == {"FINISHED"}
    assert bpy.context.mode == "OBJECT" and len(other.data.vertices) == 26
    assert bpy.data.objects["cube surface skeleton"].parent == bpy.data.objects["cube"]


def test_relative_paths_start_at_the_file(scene, tmp_path):
    """`//pairs.txt` is a file beside the .blend file."""
    add_mesh("cube", CUBE, QUADS)
    (tmp_path / "pairs.txt").write_text("0 7\n1 6\n")
    bpy.ops.wm.save_as_mainfile(filepath=os.fspath(tmp_path / "a.blend"), check_existing=False)
    assert start("geodesic_path", pairs="//pairs.txt") == {"FINISHED"}
    assert set(read_back(bpy.context.active_object.data, "pair").tolist()) == {0, 1}
