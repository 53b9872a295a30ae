"""Keys, pages of the manual, tooltips of choices, selections, assets."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy", reason="bpy is not installed: make hosts")

import medialis
from blender_scenes import add_mesh, counts, read_back
from medialis.operations.registry import OPERATIONS

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def creature(scene):
    shape = medialis.organic_shape(56)
    return add_mesh("creature", shape.points, shape.faces)


def selected(chosen):
    """Return whether each face is selected, edges and vertices with them, in edit mode."""
    import bmesh

    assert chosen.mode == "EDIT"
    edited = bmesh.from_edit_mesh(chosen.data)
    faces = [face for face in edited.faces if face.select]
    assert {e.index for e in edited.edges if e.select} == {e.index for f in faces for e in f.edges}
    assert {v.index for v in edited.verts if v.select} == {v.index for f in faces for v in f.verts}
    return np.array([face.select for face in edited.faces])


def of_faces(chosen, vertices):
    faces = np.array([face.vertices[:] for face in chosen.data.polygons])
    return vertices[faces].any(axis=1)


def test_keys_are_there_to_be_assigned_and_none_is(addon):
    """All of them go with the add-on."""
    from blender_addon import finding

    def entries():
        keymap = bpy.context.window_manager.keyconfigs.addon.keymaps.get("3D View")
        found = [] if keymap is None else list(keymap.keymap_items)
        return [item for item in found if item.idname.startswith(("medialis.", "wm.call_menu_pie"))]

    assert [item.idname for item in entries()] == [name for name, _ in finding.KEYS]
    assert {item.type for item in entries()} == {"NONE"}
    assert entries()[0].properties.name == "MEDIALIS_MT_pie"
    addon.unregister()
    assert entries() == []
    addon.register()
    assert len(entries()) == len(finding.KEYS)


def test_every_operator_has_its_page(addon):
    """On the site that the project names; the pages are there."""
    from blender_addon import finding

    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert project["urls"]["Documentation"] + "/" == finding.DOCUMENTATION
    look_up = bpy.types.WM_OT_doc_view_manual._lookup_rna_url
    names = [name for name in dir(bpy.ops.medialis) if not name.startswith("_")]
    assert len(names) > len(OPERATIONS)
    for name in names:
        page = look_up(f"bpy.ops.medialis.{name}", verbose=False).removeprefix(
            finding.DOCUMENTATION
        )
        assert (ROOT / "docs" / page).with_suffix(".md").is_file()
    for operation in OPERATIONS:
        page = f"{finding.DOCUMENTATION}{operation.name}.html"
        option = operation.parameters[0].name
        for asked in (f"ops.medialis.{operation.name}", f"ops.medialis.{operation.name}.{option}",
                      f"types.MEDIALIS_PG_{operation.name}.{option}"):  # fmt: skip
            assert look_up(f"bpy.{asked}", verbose=False) == page
    assert look_up("bpy.ops.medialis.print_check", verbose=False).endswith("/wall_check.html")


def test_every_choice_has_a_tooltip(addon):
    from blender_addon import editing

    formats = {f.name for o in OPERATIONS for f in o.formats if not f.of}
    assert formats <= set(editing.ABOUT)
    for name in dir(bpy.ops.medialis):
        rna = getattr(bpy.ops.medialis, name).get_rna_type()
        for shown in rna.properties:
            if shown.type == "ENUM":
                assert all(item.description for item in shown.enum_items), (name, shown.identifier)


@pytest.mark.parametrize("mode", ["OBJECT", "EDIT"])
def test_thin_faces_become_the_selection(mode, creature):
    """Below the threshold of the panel, below another, or those of the thin spots."""
    bpy.context.scene.medialis.of_thickness.threshold = 4.0
    bpy.ops.medialis.thickness(threshold=4.0)
    thickness, spot = (read_back(creature.data, name) for name in ("wall_thickness", "thin_spot"))
    limit = 0.04 * np.linalg.norm(np.ptp(read_back(creature.data, "position"), axis=0))
    bpy.ops.object.mode_set(mode=mode)
    for given, vertices in (({}, thickness < limit), ({"threshold": 0.3}, thickness < 0.3),
                            ({"threshold": 0.0}, spot >= 0)):  # fmt: skip
        assert bpy.ops.medialis.select_faces(which="THIN", **given) == {"FINISHED"}
        found = selected(creature)
        assert (found == of_faces(creature, vertices)).all() and 0 < found.sum() < len(found)
        assert tuple(bpy.context.tool_settings.mesh_select_mode) == (False, False, True)
        bpy.ops.object.mode_set(mode=mode)


def test_failed_faces_from_a_result_of_its_own(creature):
    """The active object is the list of regions: its source is selected on. Overlaps pass."""
    bpy.ops.medialis.wall_check(minimum=8.0)
    check = read_back(creature.data, "check")
    bpy.context.view_layer.objects.active = bpy.data.objects["creature wall regions"]
    assert bpy.ops.medialis.select_faces(which="FAILED") == {"FINISHED"}
    assert (selected(creature) == of_faces(creature, np.isin(check, [1, 2, 5]))).all()
    assert bpy.context.view_layer.objects.active == creature


def test_faces_of_a_part(creature):
    """Of the active face, or of a number; more can be added; hidden ones are left out."""
    import bmesh

    bpy.ops.medialis.parts()
    parts = read_back(creature.data, "face_parts")
    creature.data.polygons.active = 7
    bpy.ops.medialis.select_faces(which="PART")
    assert (selected(creature) == (parts == parts[7])).all()
    other = int(parts[parts != parts[7]][0])
    edited = bmesh.from_edit_mesh(creature.data)
    edited.faces.ensure_lookup_table()
    edited.faces.active = edited.faces[int(np.flatnonzero(parts == other)[0])]
    bpy.ops.medialis.select_faces(which="PART", extend=True)
    assert (selected(creature) == np.isin(parts, [parts[7], other])).all()
    bpy.ops.mesh.hide()
    bpy.ops.medialis.select_faces(which="PART", part=other)
    assert not selected(creature).any()


def test_what_was_not_computed_is_a_sentence(creature):
    select = bpy.ops.medialis.select_faces
    with pytest.raises(RuntimeError, match="Compute thickness, a wall check"):
        select(which="THIN")
    bpy.ops.medialis.parts()
    with pytest.raises(RuntimeError, match="run Thickness first"):
        select(which="THIN")
    with pytest.raises(RuntimeError, match="was not checked"):
        select(which="FAILED")
    bpy.ops.medialis.remove_result()
    bpy.ops.medialis.thickness()
    with pytest.raises(RuntimeError, match="has no parts"):
        select(which="PART")


def test_results_are_hidden_and_shown(creature):
    bpy.ops.medialis.surface_skeleton()
    made = bpy.context.active_object
    bpy.ops.medialis.show_result()
    assert made.hide_get() and bpy.context.view_layer.objects.active == creature
    bpy.ops.medialis.show_result()
    assert not made.hide_get() and not creature.hide_get()


def test_assets_and_their_catalogue(creature, tmp_path):
    """Only when asked; other lines stay; what is no asset still goes with its result."""
    from blender_addon import assets

    bpy.ops.medialis.surface_skeleton()
    with pytest.raises(RuntimeError, match="Save the file first"):
        bpy.ops.medialis.add_to_catalogue()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "file.blend"))
    assert not (tmp_path / assets.FILE).exists()
    assert not any(group.asset_data for group in bpy.data.node_groups)
    for _ in range(2):
        assert bpy.ops.medialis.add_to_catalogue() == {"FINISHED"}
        lines = (tmp_path / assets.FILE).read_text().splitlines()
        assert lines.count(assets.LINE) == 1 and "VERSION 1" in lines
    kinds = set()
    for group in bpy.data.node_groups:
        about = group.asset_data
        assert about.catalog_id == assets.CATALOG and about.author and about.description
        assert group.is_modifier
        kinds |= {tag.name for tag in about.tags}
    assert kinds == {"medialis", "slider", "look"}
    marked = len(bpy.data.node_groups)
    creature.select_set(True)
    bpy.context.view_layer.objects.active = creature
    bpy.ops.medialis.curve_skeleton()
    assert len(bpy.data.node_groups) > marked
    for _ in range(2):
        bpy.ops.medialis.remove_result()
    assert len(bpy.data.node_groups) == marked and counts()["objects"] == 1
    leftovers = [path.name for path in tmp_path.iterdir() if path.suffix != ".blend"]
    assert leftovers == [assets.FILE]


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_other_catalogues_stay(end, addon, tmp_path):
    from blender_addon import assets

    path = tmp_path / assets.FILE
    other = f"# mine{end}VERSION 1{end}{end}11111111-2222-3333-4444-555555555555:Ä/b:b".encode()
    path.write_bytes(other)
    path.chmod(0o640)
    assert assets.write_catalogue(tmp_path)
    assert path.read_bytes() == other + f"{end}{assets.LINE}{end}".encode()
    assert path.stat().st_mode & 0o777 == 0o640
    path.write_bytes(path.read_bytes().replace(b":Medialis:Medialis", b":Mine/Medialis:mine"))
    assert not assets.write_catalogue(tmp_path)  # the user has moved it


def test_a_catalogue_that_cannot_be_written_stays_as_it_was(addon, tmp_path, monkeypatch):
    from blender_addon import assets

    path = tmp_path / assets.FILE
    path.write_text("VERSION 1\n")

    def broken(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", broken)
    with pytest.raises(OSError, match="No space"):
        assets.write_catalogue(tmp_path)
    assert [(p.name, p.read_text()) for p in tmp_path.iterdir()] == [(assets.FILE, "VERSION 1\n")]


def test_catalogues_lie_in_the_library_of_the_file(addon, tmp_path):
    from blender_addon import assets

    (tmp_path / "deep").mkdir()
    blend = tmp_path / "deep" / "file.blend"
    assert assets.catalogue_folder(blend) == tmp_path / "deep"
    bpy.ops.preferences.asset_library_add(directory=str(tmp_path))
    libraries = bpy.context.preferences.filepaths.asset_libraries
    try:
        assert assets.catalogue_folder(blend).samefile(tmp_path)
    finally:
        bpy.ops.preferences.asset_library_remove(index=len(libraries) - 1)
