"""The page in a real browser: opened from disk, moved, cut, asked; no error is logged."""

import base64
import dataclasses
import os
import re
from pathlib import Path

import numpy as np
import pytest

import medialis
import page_in_browser as browser
from medialis.show.viewer.page import write_viewer

HOSTILE = "</script><script>window.hacked = 1</script><img src=x onerror='hacked = 2'>\"&.ply"


@pytest.fixture(scope="module")
def results():
    browser.need_viewer()
    shape = medialis.organic_shape(56)
    names = ("thickness", "surface_skeleton", "curve_skeleton", "parts")
    return {name: medialis.run(name, shape) for name in names}


@pytest.fixture(scope="module")
def page(results, tmp_path_factory):
    path = tmp_path_factory.mktemp("viewer") / "page.html"
    write_viewer(path, [results[n] for n in ("surface_skeleton", "thickness", "curve_skeleton")])
    return path


@pytest.mark.slow
def test_the_slider_hides_points(page):
    found = browser.looked_at(
        page,
        """
        const part = panel.active, version = part.codes.version;
        const all = () => [...Array(part.count).keys()].filter(row => part.isSeen(row)).length;
        set("from", 0);
        const before = viewer.pixels(), seen = all();
        set("from", 600);
        const after = viewer.pixels();
        set("from", 0);
        return {title: part.title, field: part.field.name, differ: differ(before, after), seen,
          left: (set("from", 600), all()), same: (set("from", 0), differ(before, viewer.pixels())),
          buffers: part.codes.version - version, said: $("kept").textContent, count: part.count};
        """,
    )
    assert (found["title"], found["field"]) == ("surface skeleton", "importance")
    assert found["differ"] > 0.002 and found["same"] == 0
    assert found["seen"] == found["count"] > found["left"] > 0
    assert found["buffers"] == 0, "the slider must not send buffers to the graphics card"


@pytest.mark.slow
def test_the_threshold_of_the_result_is_where_the_slider_stands(page, results):
    found = browser.looked_at(
        page,
        """
        const part = panel.active;
        return {rows: [...Array(part.count).keys()].filter(row => part.isSeen(row)),
          said: $("kept").textContent};
        """,
    )
    layer = results["surface_skeleton"].layers[0]
    seen = np.flatnonzero(~layer.hidden)
    # Values are rounded to 1/65533 of their range: points within one step may go either way.
    values = layer.attributes["importance"]
    step = np.ptp(values[np.isfinite(values)]) / 65_533
    limit = layer.filter_unit.attribute(layer.filter_default)
    differ = np.setxor1d(seen, found["rows"])
    assert np.all(np.abs(values[differ] - limit) <= step)
    assert "3 % of the size" in found["said"]


@pytest.mark.slow
def test_everything_on_the_page_does_something(page, results):
    found = browser.looked_at(
        page,
        """
        const steps = {}, start = viewer.pixels();
        const step = (name, change, back) => {
          change();
          const now = viewer.pixels();
          back();
          steps[name] = [differ(start, now), differ(start, viewer.pixels())];
        };
        for (const part of viewer.parts)
          step(part.title, () => panel.switchOn(part, !part.visible),
            () => panel.switchOn(part, !part.visible));
        const surface = viewer.parts.find(part => part.kind === "surface");
        step("opacity", () => { surface.opacity = 1; surface.refresh(); },
          () => { surface.opacity = 0.2; surface.refresh(); });
        step("colour", () => surface.showColors(0), () => surface.showColors(null));
        $("inside").checked = true;
        step("section", () => $("cutbutton").click(), () => $("cutbutton").click());
        step("theme", () => panel.setTheme(viewer.isDark() ? "light" : "dark"),
          () => panel.setTheme(viewer.isDark() ? "light" : "dark"));
        step("spot", () => viewer.showBall([0, 0, 0], 0.2), () => viewer.showBall([0, 0, 0], 0));
        const paper = viewer.picture([{text: "one"}, {text: "two", colors: ["red", "blue"]}]);
        return {steps, labels: document.querySelectorAll(".spot").length, width: paper.width,
          calls: viewer.renderer.info.render.calls,
          objects: viewer.parts.flatMap(part => part.objects).length};
        """,
    )
    for name, (changed, left) in found["steps"].items():
        assert changed > 0, f"{name} changes nothing"
        assert left == 0, f"{name} does not go back"
    assert found["labels"] == results["thickness"].values["thin_spots"]
    assert found["width"] > 1000
    # A see-through surface is drawn twice; nothing is drawn point by point.
    assert found["calls"] <= found["objects"] + 1


@pytest.mark.slow
def test_picking_tells_the_values_of_the_place(page, results):
    found = browser.looked_at(
        page,
        """
        const surface = viewer.parts.find(part => part.kind === "surface");
        for (const part of viewer.parts) panel.switchOn(part, part === surface);
        surface.opacity = 1;
        surface.refresh();
        const at = [0, 1, 2].map(axis => surface.points[3 * 100 + axis]);
        viewer.lookFrom(at, viewer.data.up);
        viewer.drawNow();
        const first = panel.pick(...viewer.onScreen(at));
        const skeleton = viewer.parts.find(part => part.title === "surface skeleton");
        for (const part of viewer.parts) panel.switchOn(part, part === skeleton);
        const row = [...Array(skeleton.count).keys()].find(row => skeleton.isSeen(row));
        const place = [...skeleton.points.slice(3 * row, 3 * row + 3)];
        const second = panel.pick(...viewer.onScreen(place));
        return {first, second, shown: $("card").hidden, radius: viewer.ball.scale.x,
          none: panel.pick(2, 2), away: $("card").hidden};
        """,
    )
    first = dict(found["first"]["rows"])
    thickness = results["thickness"]
    field = thickness.shown[0].attributes["thickness"]
    assert number(first["thickness"]) == pytest.approx(field[found["first"]["row"]], rel=1e-3)
    assert number(first["radius of the ball here"]) > 0
    second, row = dict(found["second"]["rows"]), found["second"]["row"]
    layer = results["surface_skeleton"].layers[0]
    for name in ("radius", "importance"):
        expected = layer.attributes[name][row]
        step = np.nanmax(layer.attributes[name]) / 65_533
        assert number(second[name]) == pytest.approx(expected, rel=1e-3, abs=step)
    assert number(second["spoke angle"].rstrip("°")) == pytest.approx(
        np.degrees(layer.attributes["spoke_angle"][row]), rel=1e-3
    )
    assert "thickness nearby" in second
    assert found["radius"] == pytest.approx(layer.attributes["radius"][row], rel=1e-3)
    assert found["shown"] is False and found["none"] is None and found["away"] is True


def number(text: str) -> float:
    return float(text.split(" ")[0])


@pytest.mark.slow
def test_arrays_arrive(page, results):
    found = browser.looked_at(
        page,
        """
        const part = viewer.parts[0], surface = viewer.parts.find(part => part.kind === "surface");
        const radius = part.fields.find(field => field.name === "radius");
        return {origin: viewer.data.origin, points: [...part.points], faces: [...surface.faces],
          radius: Array.from({length: part.count}, (_, row) => part.value(radius, row))};
        """,
    )
    layer = results["surface_skeleton"].layers[0]
    points = np.reshape(found["points"], (-1, 3)) + found["origin"]
    step = np.ptp(layer.points, axis=0).max() / 65_535
    assert np.abs(points - layer.points).max() <= 0.51 * step + 1e-6
    radii = layer.attributes["radius"]
    assert np.abs(np.array(found["radius"]) - radii).max() <= 0.51 * np.ptp(radii) / 65_533 + 1e-9
    faces = np.reshape(found["faces"], (-1, 3))
    assert turned(faces) == turned(results["thickness"].shown[0].faces)


def turned(faces) -> set:
    """Triangles, each beginning with its lowest corner."""
    return {tuple(np.roll(face, -int(np.argmin(face))).tolist()) for face in faces}


@pytest.mark.slow
def test_labels_have_the_colours_of_the_pictures(results, tmp_path):
    results["parts"].viewer_html(tmp_path / "parts.html")
    found = browser.looked_at(
        tmp_path / "parts.html",
        """
        const values = viewer.parts[0].field.values;
        const order = viewer.parts[0].objects[0].geometry.index.array;
        return {labels: [...values], order: [...order], swatches: $("swatches").children.length,
          scale: $("scale").hidden};
        """,
    )
    labels = results["parts"].shown[0].attributes["parts"]
    assert np.array_equal(found["labels"][: len(labels)], labels)  # then come cuts at borders
    assert found["swatches"] == len(np.unique(labels[labels >= 0])) and found["scale"]
    corner = np.asarray(found["labels"])[np.reshape(found["order"], (-1, 3))]
    assert (corner == corner[:, :1]).all(), "no triangle has two labels: borders are lines"
    two = (corner[:, 0] == corner[:, 1]) | (corner[:, 1] == corner[:, 2])
    two |= corner[:, 0] == corner[:, 2]
    last = corner[:, 2]
    assert ((corner == last[:, None]).sum(axis=1)[two] >= 2).all()


KEYS = """
    const event = key => new KeyboardEvent("keydown", {key, bubbles: true});
    const press = (id, key) => $(id).dispatchEvent(event(key));
    const says = id => $(id).getAttribute("aria-valuetext");
"""


@pytest.mark.slow
def test_keys_turn_the_shape_and_move_sliders_in_round_steps(page):
    found = browser.looked_at(
        page,
        f"""{KEYS}
        const keys = ["ArrowRight", "ArrowRight", "PageUp", "Home"];
        const steps = keys.map(key => (press("from", key), says("from")));
        const start = viewer.camera.position.toArray();
        press("canvas", "ArrowLeft");
        const turned = viewer.camera.position.toArray();
        press("canvas", "+");
        const near = viewer.camera.position.length();
        press("canvas", "0");
        $("cutbutton").click();
        press("depth", "ArrowRight");
        const depth = [says("depth"), $("depthwords").textContent];
        $("cutbutton").click();
        document.querySelector("#places button").click();
        const card = !$("card").hidden;
        document.body.dispatchEvent(event("Escape"));
        return {{steps, start, turned, near, home: viewer.camera.position.toArray(), depth, card,
          closed: $("card").hidden, menu: $("menu").getAttribute("aria-expanded")}};
        """,
    )
    values = [number(text) for text in found["steps"]]
    assert values[0] < values[1] < values[2] > values[3]
    assert all(float(f"{value:.2g}") == value for value in values[:3]), "round numbers"
    assert all(text.endswith("% of the size)") for text in found["steps"])
    start, turned = (np.linalg.norm(found[name]) for name in ("start", "turned"))
    assert start == pytest.approx(turned) and found["start"] != found["turned"]
    assert found["near"] == pytest.approx(0.85 * start)
    assert found["home"] == pytest.approx(found["start"])
    assert found["depth"][0] == found["depth"][1] and found["depth"][0].startswith("x = ")
    assert found["card"] and found["closed"] and found["menu"] == "true"


AXE = """
    (0, eval)(new TextDecoder().decode(Uint8Array.from(atob("AXE"), c => c.charCodeAt(0))));
    await new Promise(done => setTimeout(done, 200));
    const found = await axe.run(document, {resultTypes: ["violations"]});
    return {bad: found.violations.filter(one => ["serious", "critical"].includes(one.impact))
      .map(one => [one.id, one.nodes.map(node => node.html.slice(0, 100))]),
      rules: found.passes.length};
"""


@pytest.mark.slow
@pytest.mark.parametrize("webgl", [True, False])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_nothing_serious(page, webgl, scheme):
    """The accessibility checker axe-core of npm, where AXE_CORE names its axe.min.js."""
    file = Path(os.environ.get("AXE_CORE", ""))
    if not file.is_file():
        pytest.skip("needs axe-core (AXE_CORE names its axe.min.js)")
    source = base64.b64encode(file.read_bytes()).decode()
    theme = f"document.documentElement.dataset.theme = {scheme!r};"
    found = browser.looked_at(page, theme + AXE.replace("AXE", source), webgl=webgl)
    assert found["bad"] == [] and found["rules"] > 10


@pytest.mark.slow
def test_without_webgl_there_is_a_picture_with_numbers_and_places(page, results):
    found = browser.looked_at(
        page,
        """
        const still = $("still"), rows = [...document.querySelectorAll("#places li")];
        return {why: $("why").textContent, shown: !still.hidden, width: still.naturalWidth,
          alt: still.alt, places: rows.map(row => row.textContent),
          numbers: $("numberlist").textContent,
          buttons: document.querySelectorAll("nav:not([hidden])").length};
        """,
        webgl=False,
    )
    assert "WebGL" in found["why"] and found["shown"] and found["width"] > 300 and found["alt"]
    spots = results["thickness"].values["spots"]
    assert len(found["places"]) == len(spots) and found["buttons"] == 0
    for row, text in enumerate(found["places"], 1):
        assert re.fullmatch(rf"{row} [\d.]+, at \(-?[\d.]+, -?[\d.]+, -?[\d.]+\)", text)
    assert "samples" in found["numbers"]


@pytest.mark.slow
def test_a_hostile_name_stays_text(results, tmp_path):
    result = results["surface_skeleton"]
    layer = dataclasses.replace(
        result.layers[0],
        name=HOSTILE,
        attributes={HOSTILE: result.layers[0].attributes["radius"]},
        color_by=HOSTILE,
        filter_by=None,
    )
    hostile = dataclasses.replace(result, layers=(layer,), messages=(HOSTILE,))
    hostile.viewer_html(tmp_path / "page.html", title=HOSTILE)
    found = browser.looked_at(
        tmp_path / "page.html",
        """
        await new Promise(done => setTimeout(done, 200));
        return {hacked: window.hacked ?? null, title: $("title").textContent,
          document: document.title, note: $("notelist").textContent, images: document.images.length,
          layer: [...document.querySelectorAll(".name")].at(-1).textContent,
          field: $("field").textContent};
        """,
    )
    assert found["hacked"] is None and found["images"] == 1
    assert found["title"] == found["document"] == found["note"] == HOSTILE
    assert found["layer"] == HOSTILE.replace("_", " ") and found["field"] == HOSTILE


@pytest.mark.slow
@pytest.mark.parametrize("width", [390, 1280])
def test_the_page_fits_the_screen(page, width):
    found = browser.looked_at(
        page,
        """
        if (document.body.classList.contains("closed")) $("menu").click();
        $("cutbutton").click();
        panel.pick(...viewer.onScreen(viewer.parts[0].points.slice(0, 3)));
        const boxes = [...document.querySelectorAll(".card, nav, #panel, .layer, nav button")]
          .map(e => [e.id || e.className || e.tagName, e.getBoundingClientRect()]);
        return {width: innerWidth, page: document.scrollingElement.scrollWidth,
          out: boxes.filter(([, b]) => b.left < 0 || b.right > innerWidth + 1).map(([id]) => id),
          small: boxes.filter(([id, box]) => id === "BUTTON" && box.height < 38).length,
          canvas: viewer.canvas.clientWidth};
        """,
        (width, 800),
    )
    assert found["width"] == width == found["page"]
    assert found["out"] == [] and found["canvas"] > 300


@pytest.mark.slow
def test_shapes_far_from_the_origin_look_the_same(tmp_path):
    """Graphics cards have single precision: at 10^7 a shape of size 3 would be a few steps wide."""
    shape, far = medialis.organic_shape(56), np.array([1e7, -2e7, 3e7])
    points = np.round(shape.points, 6)  # exact after the move, to 4e-9
    seen = []
    for number, offset in enumerate((0 * far, far)):
        result = medialis.run("thickness", (points + offset, shape.faces), refine=0)
        result.viewer_html(tmp_path / f"{number}.html", title="shape")
        seen.append(
            browser.looked_at(
                tmp_path / f"{number}.html",
                """
                const row = 100, place = [...viewer.parts[0].points.slice(3 * row, 3 * row + 3)];
                return {pixels: [...viewer.pixels()], place: panel.placeWords(place).split(", ")};
                """,
                (400, 300),
            )
        )
    near, away = (np.array(one["pixels"]) for one in seen)
    assert (np.abs(near - away) > 16).mean() < 0.005
    expected = np.array(seen[0]["place"], float) + far
    assert np.allclose(np.array(seen[1]["place"], float), expected, rtol=0, atol=2e-3)
