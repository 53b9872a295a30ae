// What stands around the canvas. All text from outside is set as text, never as HTML.
"use strict";

const STEPS = 1000, NARROW = 760, TURN = Math.PI / 18;

class Panel {
  constructor(viewer) {
    this.viewer = viewer;
    this.data = viewer.data;
    this.active = viewer.parts.find(part => part.visible && part.filterBy !== null && part.field)
      ?? viewer.parts.find(part => part.visible && part.field) ?? viewer.parts[0];
    this.byId = Object.fromEntries([...document.querySelectorAll("[id]")].map(e => [e.id, e]));
    this.showLayers();
    this.showLegend();
    this.showPlaces();
    this.section();
    this.listen();
    this.sayMenu();
    viewer.drawn.push(() => this.placeLabels());
  }

  unit(field) {
    const own = this.data.unit ?? "";
    return {length: own, area: own && own + "²", degrees: "°"}[field.unit] ?? "";
  }

  // A value with its unit, and lengths as a share of the size as well.
  words(field, value) {
    const unit = this.unit(field);
    const number = said(value) + (unit === "°" ? "°" : unit && value !== null ? ` ${unit}` : "");
    if (field.unit !== "length" || !Number.isFinite(value) || value === null) return number;
    return `${number} (${said(Number((100 * value / this.data.diagonal).toPrecision(3)))} % of the size)`;
  }

  decimals() { return Math.min(12, Math.max(0, 3 - Math.floor(Math.log10(this.data.diagonal)))); }

  // Where a place is in the units of the file, with the digits that tell places of the shape apart.
  placeWords(place) {
    const unit = this.data.unit ? ` ${this.data.unit}` : "";
    return place.map((x, axis) => (x + this.data.origin[axis]).toFixed(this.decimals())).join(", ") + unit;
  }

  showLayers() {
    this.byId.layers.replaceChildren(...this.viewer.parts.map(part => this.layer(part)));
  }

  layer(part) {
    const name = element("button", {className: "name", textContent: part.title, onclick: () => {
      this.active = part;
      this.switchOn(part, true);
    }});
    const count = element("small", {textContent: this.countOf(part)});
    const eye = element("input", {type: "checkbox", checked: part.visible,
      ariaLabel: `Show ${part.title}`, onchange: () => this.switchOn(part, eye.checked)});
    const choice = element("select", {ariaLabel: `Colours of ${part.title}`, onchange: () => {
      part.showColors(choice.value === "" ? null : Number(choice.value));
      this.active = part;
      this.showLegend();
    }}, element("option", {value: "", textContent: "one colour"}), ...part.fields.map((field, i) =>
      element("option", {value: i, textContent: field.title})));
    choice.value = part.colorBy === null ? "" : part.colorBy;
    const slider = this.layerSlider(part);
    const row = element("div", {className: "layer"}, element("label", {className: "eye"}, eye), name, count,
      element("div", {className: "more"}, ...(part.fields.length ? [choice] : []), slider));
    part.row = row;
    part.eye = eye;
    row.classList.toggle("active", part === this.active);
    return row;
  }

  countOf(part) {
    const count = part.told;  // before triangles were cut at borders
    const noun = part.faces ? "triangle" : part.edges ? "node" : "point";
    return `${count.toLocaleString("en")} ${noun}${count === 1 ? "" : "s"}`;
  }

  layerSlider(part) {
    const isSurface = part.kind === "surface", set = value => {
      if (isSurface) part.opacity = value;
      else part.size = 4 ** (2 * value - 1);
      part.refresh();
    };
    const title = isSurface ? "Opacity" : "Size";
    const slider = element("input", {type: "range", min: 0, max: 1, step: 0.05, title,
      ariaLabel: `${title} of ${part.title}`, oninput: () => { set(Number(slider.value)); say(); }});
    const say = () => slider.setAttribute("aria-valuetext", isSurface
      ? `${Math.round(100 * slider.value)} %` : `${said(Number((4 ** (2 * slider.value - 1)).toPrecision(2)))} times`);
    slider.value = isSurface ? part.opacity : 0.5;
    say();
    return slider;
  }

  switchOn(part, visible) {
    part.visible = part.eye.checked = visible;
    if (visible && part.field) this.active = part;
    part.refresh();
    this.showLegend();
  }

  // The colours of the active part, with two handles: what lies outside of them is hidden.
  showLegend() {
    const part = this.active, field = part?.field;
    for (const one of this.viewer.parts) one.row.classList.toggle("active", one === part);
    this.byId.legend.hidden = !field || !part.visible;
    if (this.byId.legend.hidden) return;
    const unit = this.unit(field);
    this.byId.field.textContent = field.title + (unit ? ` in ${unit === "°" ? "degrees" : unit}` : "");
    this.byId.of.textContent = part.title;
    this.byId.scale.hidden = field.label;
    this.byId.swatches.hidden = !field.label;
    if (field.label) return this.byId.swatches.replaceChildren(...swatchesOf(this.data, field));
    drawBar(this.byId.bar, field, colorsOf(this.data, field, BARS));
    const [from, to] = field.keep;
    [this.byId.from.value, this.byId.to.value] = [STEPS * from, STEPS * to];
    this.byId.low.textContent = said(field.low);
    this.byId.high.textContent = said(field.high) + (field.infinite ? ", infinite" : "");
    this.sayKept(field);
  }

  moveHandles(moved) {
    const part = this.active, {from, to} = this.byId;
    if (Number(from.value) > Number(to.value))
      if (moved === from) to.value = from.value; else from.value = to.value;
    part.keepRange(Number(from.value) / STEPS, Number(to.value) / STEPS);
    this.sayKept(part.field);
  }

  sayKept(field) {
    const [from, to] = field.keep, value = share => field.low + share * (field.high - field.low);
    this.byId.bar.style.setProperty("--from", `${100 * from}%`);
    this.byId.bar.style.setProperty("--to", `${100 * to}%`);
    const kept = [from > 0 ? `from ${this.words(field, value(from))}` : "",
      to < 1 ? `up to ${this.words(field, value(to))}` : ""].filter(Boolean).join(" ");
    this.byId.kept.textContent = kept ? `Shown ${kept}` : "Drag the ends to hide values";
    for (const [slider, share] of [[this.byId.from, from], [this.byId.to, to]])
      slider.setAttribute("aria-valuetext", this.words(field, value(share)));
  }

  // A step of an arrow key, or ten: to the next round value of the active part.
  stepHandle(slider, steps) {
    const {low, high} = this.active.field;
    slider.value = STEPS * stepped(slider.value / STEPS, low, high, steps);
    this.moveHandles(slider);
  }

  // The places of the first table have numbers on the shape; the list, made before, leads to all.
  showPlaces() {
    const {places} = this.data;
    this.marked = places.filter(place => place.onShape);
    this.labels = this.marked.map(place => element("button", {className: `spot ${place.kind.replace(" ", "-")}`,
      textContent: place.number, title: placeName(place), ariaLabel: placeName(place), tabIndex: -1,
      onclick: () => this.showPlace(place)}));
    this.byId.labels.append(...this.labels);
    document.querySelectorAll("#places button").forEach((button, i) =>
      button.addEventListener("click", () => this.showPlace(places[i])));
    document.getElementById("numbers")?.addEventListener("change", () => this.viewer.draw());
  }

  showPlace(place) {
    if (innerWidth < NARROW) this.showPanel(false);
    const ends = place.opposite ?? place.position;
    const middle = place.position.map((x, axis) => (x + ends[axis]) / 2);
    this.viewer.showBall(middle, place.table === "ribs" || place.kind === "too thick" ? 0 : place.value / 2);
    this.viewer.lookAt(middle);
    this.showCard(`${place.noun} ${place.number}`, [["found", place.text],
      ["position", this.placeWords(place.position)]], middle);
  }

  placeLabels() {
    const all = [...this.labels.map((label, i) => [label, this.marked[i].position])];
    const numbered = document.getElementById("numbers")?.checked;
    if (this.pin) all.push([this.byId.pin, this.pin]);
    this.byId.pin.hidden = !this.pin;
    for (const [label, place] of all) {
      const at = this.viewer.onScreen(place);
      const isSpot = label !== this.byId.pin;
      label.hidden = at === null || (isSpot && (!numbered || this.viewer.isCutAway(place)));
      if (at) label.style.transform = `translate(${at[0]}px, ${at[1]}px) translate(-50%, -50%)`;
    }
  }

  // Everything that is known at what was picked.
  pick(x, y) {
    const met = pickedAt(this.viewer, x, y);
    if (!met) return this.hideCard();
    const {part, row} = met, place = [...part.points.slice(3 * row, 3 * row + 3)];
    const rows = part.fields.map(field => [field.title, field.label
      ? (field.classes[part.value(field, row)] ?? (part.value(field, row) < 0 ? "none" : String(part.value(field, row))))
      : this.words(field, part.value(field, row))]);
    const radius = part.fields.find(field => field.name === "radius");
    let ball = radius && part.kind !== "surface" ? [place, part.value(radius, row)] : null;
    if (part.kind === "surface") {
      const touching = touchingBall(this.viewer, place);
      if (touching) {
        ball = [[...touching.part.points.slice(3 * touching.row, 3 * touching.row + 3)], touching.radius];
        rows.push(["radius of the ball here", this.words({unit: "length"}, touching.radius)]);
      }
    }
    rows.push(...this.thicknessNear(part, place), ["position", this.placeWords(place)]);
    this.viewer.showBall(ball ? ball[0] : place, ball ? ball[1] : 0);
    this.showCard(part.title, rows, place);
    return {part: part.title, row, rows};
  }

  // The thickness of the surface nearest to a place inside of it.
  thicknessNear(part, place) {
    if (part.fields.some(field => field.name === "thickness")) return [];
    for (const other of this.viewer.parts) {
      const field = other.fields.find(one => one.name === "thickness");
      if (field) return [["thickness nearby", this.words(field, other.value(field, other.nearest(...place)))]];
    }
    return [];
  }

  showCard(title, rows, place) {
    this.byId.cardtitle.textContent = title;
    this.byId.cardrows.replaceChildren(...rows.flatMap(([name, text]) =>
      [element("dt", {textContent: name}), element("dd", {textContent: text})]));
    this.byId.card.hidden = false;
    this.pin = place;
    this.viewer.draw();
  }

  hideCard() {
    this.byId.card.hidden = true;
    this.pin = null;
    this.viewer.showBall([0, 0, 0], 0);
    return null;
  }

  // The sides of the box along an axis, in the units of the file; null for the direction of view.
  depthRange(axis) {
    const row = "xyz".indexOf(axis);
    return row < 0 ? null : [-1, 1].map(side => this.data.origin[row] + side * this.data.half[row]);
  }

  depthWords(axis, share) {
    const range = this.depthRange(axis);
    if (!range) return `${Math.round(100 * share)} % of the way`;
    const unit = this.data.unit ? ` ${this.data.unit}` : "";
    const at = (range[0] + share * (range[1] - range[0])).toFixed(this.decimals());
    return `${axis} = ${said(Number(at))}${unit}`;
  }

  stepDepth(steps) {
    const {axis, depth} = this.byId;
    depth.value = STEPS * stepped(depth.value / STEPS, ...(this.depthRange(axis.value) ?? [0, 100]), steps);
    this.section();
  }

  section() {
    const {axis, depth, flip, inside} = this.byId, viewer = this.viewer;
    const isOn = !this.byId.section.hidden;
    this.byId.cutbutton.setAttribute("aria-pressed", isOn);
    const view = viewer.camera.position.clone().sub(viewer.controls.target).toArray();
    const normal = {x: [1, 0, 0], y: [0, 1, 0], z: [0, 0, 1], view}[axis.value];
    viewer.cutsAll = inside.checked;
    const share = depth.value / STEPS, words = this.depthWords(axis.value, share);
    this.byId.depthwords.textContent = words;
    depth.setAttribute("aria-valuetext", words);
    if (!isOn) return viewer.uncut();
    if (flip.checked) viewer.cutBy(normal.map(x => -x), 1 - share);
    else viewer.cutBy(normal, share);
  }

  save() {
    const field = this.active?.visible ? this.active.field : null, lines = [{text: this.data.title}];
    if (field && !field.label)
      lines.push({colors: colorsOf(this.data, field, 24),
        text: `${field.title}: ${said(field.low)} to ${this.words(field, field.high)}`});
    this.viewer.picture(lines).toBlob(blob => {
      const name = this.data.title.replace(/[^\p{L}\p{N}]+/gu, "-").replace(/^-|-$/g, "") || "picture";
      const link = element("a", {href: URL.createObjectURL(blob), download: `${name}.png`});
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 10000);
    });
  }

  setTheme(name) {
    document.documentElement.dataset.theme = name;
    this.viewer.refresh();
    this.showLegend();
  }

  listen() {
    const {byId, viewer} = this, canvas = viewer.canvas;
    let down = null;  // where the only finger or the mouse went down
    canvas.addEventListener("pointerdown", event => {
      down = event.isPrimary && event.button === 0 ? [event.clientX, event.clientY] : null;
    });
    canvas.addEventListener("pointerup", event => {
      if (!down || Math.hypot(event.clientX - down[0], event.clientY - down[1]) > 5) return;
      const box = canvas.getBoundingClientRect();
      this.pick(event.clientX - box.left, event.clientY - box.top);
    });
    for (const handle of [byId.from, byId.to]) handle.addEventListener("input", () => this.moveHandles(handle));
    for (const name of ["axis", "depth", "flip", "inside"]) byId[name].addEventListener("input", () => this.section());
    byId.cutbutton.onclick = () => { byId.section.hidden = !byId.section.hidden; this.section(); };
    byId.home.onclick = () => viewer.lookFrom(this.data.direction, this.data.up);
    byId.save.onclick = () => this.save();
    byId.theme.onclick = () => this.setTheme(viewer.isDark() ? "light" : "dark");
    byId.menu.onclick = () => this.showPanel(document.body.classList.contains("closed"));
    byId.close.onclick = () => { this.hideCard(); canvas.focus(); };
    addEventListener("keydown", event => { if (event.key === "Escape") this.escape(); });
    canvas.addEventListener("keydown", event => this.turnByKey(event));
    for (const handle of [byId.from, byId.to])
      handle.addEventListener("keydown", event => byArrow(event, steps => this.stepHandle(handle, steps)));
    byId.depth.addEventListener("keydown", event => byArrow(event, steps => this.stepDepth(steps)));
  }

  showPanel(open) {
    document.body.classList.toggle("closed", !open);
    this.sayMenu();
  }

  sayMenu() { this.byId.menu.setAttribute("aria-expanded", !document.body.classList.contains("closed")); }

  // Close what lies over the shape, the card first.
  escape() {
    if (!this.byId.card.hidden) return this.hideCard();
    if (!this.byId.section.hidden) return this.byId.cutbutton.click();
    if (innerWidth < NARROW) this.showPanel(false);
  }

  turnByKey(event) {
    const turns = {ArrowLeft: [-TURN, 0], ArrowRight: [TURN, 0], ArrowUp: [0, -TURN], ArrowDown: [0, TURN]};
    const zooms = {"+": 0.85, "=": 0.85, "-": 1 / 0.85, "−": 1 / 0.85};
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (turns[event.key]) this.viewer.turn(...turns[event.key]);
    else if (zooms[event.key]) this.viewer.zoom(zooms[event.key]);
    else if (event.key === "0" || event.key === "Home") this.byId.home.click();
    else return;
    event.preventDefault();
  }
}
