"""The public face: groups, types, examples and short texts of what `import medialis` gives."""

import inspect
import re
import typing
from dataclasses import fields, is_dataclass

import pytest
from website.generated_pages import groups
from website.pages import DOCS

import medialis

NAMES = [name for name in medialis.__all__ if not name.startswith("__")]
FUNCTIONS = [name for name in NAMES if inspect.isfunction(getattr(medialis, name))]
CLASSES = [name for name in NAMES if inspect.isclass(getattr(medialis, name))]
SHORT = 200
"""Characters."""


def test_every_public_name_is_in_one_group():
    named = [name for names in groups().values() for name in names]
    assert sorted(named) == sorted(NAMES)


def test_the_page_of_groups_names_them_all():
    text = (DOCS / "api.md").read_text("utf-8")
    sections = dict(re.findall(r"^## (.*?)\n(.*?)(?=^## |\Z)", text, re.MULTILINE | re.DOTALL))
    for group, names in groups().items():
        for name in names:
            assert f"`{name}" in sections[group], f"{name} is not in the section {group}"


def classes_in(annotation) -> set[type]:
    """Classes of this package that an annotation mentions, at any depth.

    Protocols only say what the meshes of other libraries have.
    """
    inside = {c for part in typing.get_args(annotation) for c in classes_in(part)}
    own = inspect.isclass(annotation) and annotation.__module__.startswith("medialis.")
    own = own and typing.Protocol not in annotation.__bases__
    return inside | ({annotation} if own else set())


def mentioned(name: str) -> set[type]:
    """Classes that the signature of a public function, or the public fields of a class, mention."""
    thing = getattr(medialis, name)
    if inspect.isfunction(thing):
        hints = typing.get_type_hints(thing)
        if hasattr(thing, "of"):  # its options are keywords
            del hints["options"]
    elif is_dataclass(thing):
        bases = [inspect.getmodule(base) for base in reversed(thing.__mro__)]
        module = {name: value for base in bases for name, value in vars(base).items()}
        checked = {**module, **imported_for_checks(thing)}
        known = typing.get_type_hints(thing, checked)
        hints = {f.name: known[f.name] for f in fields(thing) if not f.name.startswith("_")}
    else:
        return set()
    return {c for hint in hints.values() for c in classes_in(hint)}


def imported_for_checks(thing: type) -> dict[str, type]:
    """Public types by name: what a module imports for type checkers only."""
    return {name: getattr(medialis, name) for name in CLASSES if name != thing.__name__}


@pytest.mark.parametrize("name", NAMES)
def test_types_of_signatures_are_public(name):
    # A result shows itself; what it is without that is its base, which hosts use.
    public = {base for known in CLASSES for base in getattr(medialis, known).__mro__}
    assert mentioned(name) <= public


@pytest.mark.parametrize("name", FUNCTIONS)
def test_functions_have_an_example_and_say_what_to_see(name):
    text = inspect.getdoc(getattr(medialis, name)) or ""
    assert ">>> " in text, "no example"
    assert "See Also\n--------" in text
    for also in see_also(text):
        assert also in NAMES, f"{also} is no public name"


def see_also(text: str) -> list[str]:
    """Names in the section See Also of a docstring."""
    section = text.partition("See Also\n--------\n")[2].partition("\n\n")[0]
    lines = [line for line in section.splitlines() if not line.startswith(" ")]
    return [name.strip() for line in lines for name in line.partition(" :")[0].split(",")]


@pytest.mark.parametrize("name", FUNCTIONS)
def test_functions_have_few_parameters(name):
    parameters = inspect.signature(getattr(medialis, name)).parameters
    if not hasattr(getattr(medialis, name), "of"):  # options are fields of one class
        assert len(parameters) <= 8


@pytest.fixture(scope="module")
def results() -> dict[str, object]:
    """A small object of each public dataclass, by the name of its class."""
    shape = medialis.organic_shape(56)
    cloud = medialis.surface_skeleton(shape)
    curve = medialis.curve_skeleton(cloud)
    result = medialis.run("thickness", shape)
    sheets = medialis.medial_sheets(cloud)
    rig = medialis.bones(curve)
    made = [
        *(shape, cloud, curve, result, result.layers[0], sheets, rig),
        *(medialis.skin_weights(rig), medialis.y_network(sheets), medialis.sheet_meshes(sheets)),
        *(medialis.geodesic_importance(cloud), medialis.skeleton_mesh(cloud)),
        *(medialis.extended_feature_transform(cloud), medialis.soft_edges(cloud)),
        *(medialis.patches(cloud), medialis.diagnose(shape.points, shape.faces)),
        *(medialis.geodesic(shape, 0, 9), medialis.operation("thickness"), cloud.inverse_features),
    ]
    return {type(thing).__name__: thing for thing in made}


@pytest.mark.slow
def test_texts_of_results_are_short(results):
    for name, thing in results.items():
        assert len(repr(thing)) < SHORT, f"{name}: {repr(thing)[:SHORT]}..."


@pytest.mark.parametrize("name", [n for n in CLASSES if is_dataclass(getattr(medialis, n))])
def test_classes_that_hold_arrays_have_a_text_of_their_own(name):
    """The text that a dataclass gives by itself prints every array."""
    thing = getattr(medialis, name)
    holds_arrays = any("Array" in str(f.type) or "Mapping" in str(f.type) for f in fields(thing))
    made_by_dataclass = getattr(thing.__repr__, "__wrapped__", None) is not None
    assert not (holds_arrays and made_by_dataclass)


def test_the_version_is_there():
    assert re.fullmatch(r"\d+\.\d+\.\d+|unknown", medialis.__version__)
