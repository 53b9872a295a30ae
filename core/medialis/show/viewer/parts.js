// The parts of the scene as objects of three.js: one buffer each, whatever their number of points.
"use strict";

function base64Bytes(text) {
  return Uint8Array.from(atob(text), letter => letter.charCodeAt(0));
}

function colorTexture(rgb, smooth) {
  const count = rgb.length / 3, pixels = new Uint8Array(4 * count);
  for (let i = 0; i < count; i++) pixels.set([rgb[3 * i], rgb[3 * i + 1], rgb[3 * i + 2], 255], 4 * i);
  const texture = new THREE.DataTexture(pixels, count, 1, THREE.RGBAFormat);
  texture.minFilter = texture.magFilter = smooth ? THREE.LinearFilter : THREE.NearestFilter;
  texture.needsUpdate = true;
  return texture;
}

class Part {
  constructor(about, bytes, viewer) {
    Object.assign(this, about);
    this.viewer = viewer;
    this.points = unpackedPoints(bytes, about.points);
    this.count = this.points.length / 3;
    this.faces = about.faces ? unpackedFaces(bytes, about.faces) : null;
    this.edges = about.edges ? Uint32Array.from(wholeNumbers(bytes, about.edges)) : null;
    for (const field of this.fields) {
      field.values = unpackedCodes(bytes, field);
      field.keep = [field.from, field.to];
    }
    this.keep = this.filterBy === null ? null : this.fields[this.filterBy];
    this.size = 1;
    this.objects = this.makeObjects();
    this.showColors(this.colorBy);
    this.refresh();
  }

  get field() { return this.colorBy === null ? null : this.fields[this.colorBy]; }

  makeObjects() {
    const position = new THREE.BufferAttribute(this.points, 3);
    this.uniforms = {
      colors: {value: this.viewer.palette}, scale: {value: new THREE.Vector2(1, 0)},
      keep: {value: new THREE.Vector2(0, 1)}, plain: {value: new THREE.Color()},
      cut: {value: new THREE.Vector4(0, 0, 0, 1)}, mode: {value: 0}, radius: {value: 1},
      pixels: {value: 1}, opacity: {value: 1}, inner: {value: new THREE.Color()},
      isCut: {value: false}, facets: {value: false}, ballSize: {value: 0},
    };
    this.codes = new THREE.BufferAttribute(new Float32Array(this.count), 1);
    if (this.kind === "surface") return [this.surface(position), ...(this.edges ? [this.tubes()] : [])];
    if (this.kind === "points") return [this.dots(position)];
    return [this.tubes(), this.dots(position)];
  }

  material(vertexShader, fragmentShader, more) {
    return new THREE.ShaderMaterial({
      glslVersion: THREE.GLSL3, uniforms: this.uniforms, vertexShader, fragmentShader, ...more,
    });
  }

  finished(object) {
    object.frustumCulled = false;
    return object;
  }

  surface(position) {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", position);
    geometry.setAttribute("normal", new THREE.BufferAttribute(vertexNormals(this.points, this.faces), 3));
    geometry.setAttribute("code", this.codes);
    this.plainIndex = new THREE.BufferAttribute(this.faces, 1);
    geometry.setIndex(this.plainIndex);
    const material = this.material(SURFACE_VERTEX, SURFACE_FRAGMENT, {side: THREE.DoubleSide});
    material.forceSinglePass = false;  // back faces first where it is see-through
    return this.finished(new THREE.Mesh(geometry, material));
  }

  dots(position) {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", position);
    geometry.setAttribute("code", this.codes);
    const balls = this.role === "balls" ? this.fields.find(field => field.name === "radius") : null;
    this.balls = balls ? Float32Array.from({length: this.count}, (_, row) => this.value(balls, row) ?? 0) : null;
    if (balls) geometry.setAttribute("ball", new THREE.BufferAttribute(this.balls, 1));
    return this.finished(new THREE.Points(geometry, this.material(POINT_VERTEX, POINT_FRAGMENT)));
  }

  tubes() {
    const geometry = new THREE.InstancedBufferGeometry(), edges = this.edges.length / 2;
    const corners = new Float32Array([0, -1, 0, 1, -1, 0, 1, 1, 0, 0, 1, 0]);
    geometry.setAttribute("position", new THREE.BufferAttribute(corners, 3));
    geometry.setIndex([0, 1, 2, 0, 2, 3]);
    const ends = [new Float32Array(3 * edges), new Float32Array(3 * edges)];
    for (let e = 0; e < edges; e++)
      for (let side = 0; side < 2; side++)
        for (let axis = 0; axis < 3; axis++)
          ends[side][3 * e + axis] = this.points[3 * this.edges[2 * e + side] + axis];
    geometry.setAttribute("start", new THREE.InstancedBufferAttribute(ends[0], 3));
    geometry.setAttribute("end", new THREE.InstancedBufferAttribute(ends[1], 3));
    this.edgeCodes = new THREE.InstancedBufferAttribute(new Float32Array(2 * edges), 2);
    geometry.setAttribute("codes", this.edgeCodes);
    geometry.instanceCount = edges;
    const material = this.material(TUBE_VERTEX, TUBE_FRAGMENT, {side: THREE.DoubleSide});
    return this.finished(new THREE.Mesh(geometry, material));
  }

  paletteOf(field) {
    if (field.colors && !field.texture) field.texture = colorTexture(base64Bytes(field.colors), false);
    return field.texture ?? this.viewer.palette;
  }

  // Colour by a field (its number), or plainly (null).
  showColors(number) {
    this.colorBy = number;
    const field = this.field, uniforms = this.uniforms;
    uniforms.mode.value = field === null ? 0 : field.label ? 2 : 1;
    if (field !== null) {
      this.codes.array.set(field.values);
      this.codes.needsUpdate = true;
      uniforms.colors.value = field.label ? this.paletteOf(field) : this.viewer.maps[field.map];
      const [first, last] = field.limits, range = field.high - field.low || 1;
      const span = last - first || 1;
      uniforms.scale.value.set(range / span, (field.low - first) / span);
    }
    if (this.edgeCodes) this.showEdgeColors(field);
    if (this.faces) this.objects[0].geometry.setIndex(this.faceOrder(field));
    this.refresh();
  }

  // Of labels an edge has one: that of its end with fewer edges, for junctions belong to several.
  showEdgeColors(field) {
    const codes = this.edgeCodes.array, degree = new Uint32Array(this.count);
    for (const node of this.edges) degree[node]++;
    for (let e = 0; e < codes.length / 2; e++) {
      const [a, b] = [this.edges[2 * e], this.edges[2 * e + 1]];
      codes[2 * e] = field ? field.values[a] : 0;
      codes[2 * e + 1] = field ? field.values[b] : 0;
      if (field && field.label) codes[2 * e] = codes[2 * e + 1] = field.values[degree[a] <= degree[b] ? a : b];
    }
    this.edgeCodes.needsUpdate = true;
  }

  // Of labels a face has that of its last corner: most of its corners should have it.
  faceOrder(field) {
    if (field === null || !field.label) return this.plainIndex;
    if (field.order) return field.order;
    const turned = new Uint32Array(this.faces.length), label = field.values;
    for (let i = 0; i < turned.length; i += 3) {
      const [a, b, c] = [this.faces[i], this.faces[i + 1], this.faces[i + 2]];
      const first = label[a] === label[b] && label[c] !== label[a];  // then b comes last
      turned.set(first ? [c, a, b] : [a, b, c], i);
    }
    return field.order = new THREE.BufferAttribute(turned, 1);
  }

  // Which shares of the range of a field are seen.
  keepRange(from, to) {
    this.field.keep = [from, to];
    this.refresh();
  }

  // Bring what was chosen to the graphics card: numbers only, no buffers.
  refresh() {
    const {uniforms, viewer} = this, field = this.field;
    for (const object of this.objects) {
      object.visible = this.visible;
      const clear = this.kind === "surface" && this.opacity <= 0.99;
      if (object.material.transparent !== clear) {
        object.material.transparent = clear;
        object.material.depthWrite = !clear;
        object.material.needsUpdate = true;
      }
      object.renderOrder = clear ? 1 : 0;
    }
    uniforms.opacity.value = this.opacity;
    uniforms.keep.value.set(...(field && !field.label ? field.keep : [0, 1]));
    uniforms.plain.value.setRGB(...viewer.plainColor(this.kind));
    uniforms.inner.value.setRGB(...viewer.innerColor());
    uniforms.radius.value = this.size * (this.edges ? 0.004 * viewer.diagonal : this.dotRadius());
    uniforms.ballSize.value = this.balls ? this.size : 0;
    uniforms.facets.value = this.kind === "surface" && this.count < 3000;
    const [x, y, z, w] = viewer.cut;
    const cuts = this.kind === "surface" || viewer.cutsAll;
    uniforms.isCut.value = cuts && (x !== 0 || y !== 0 || z !== 0);
    uniforms.cut.value.set(...(uniforms.isCut.value ? [x, y, z, w] : [0, 0, 0, 1]));
    viewer.draw();
  }

  // Smaller dots for more points, so that sheets look like sheets and not like gravel.
  dotRadius() {
    return this.viewer.diagonal * Math.min(0.008, Math.max(0.0008, 0.45 / Math.sqrt(this.count)));
  }

  // Whether a point is seen, by threshold and section.
  isSeen(row) {
    const field = this.field, [x, y, z, w] = this.uniforms.cut.value.toArray();
    const p = this.points, at = 3 * row;
    if (x * p[at] + y * p[at + 1] + z * p[at + 2] > w) return false;
    if (field === null || field.label || this.kind === "surface") return true;
    const code = field.values[row], [from, to] = field.keep;
    if (code === MISSING_CODE) return from <= 0 && to >= 1;
    return code >= from - 1e-6 && (code <= to + 1e-6 || (code === INFINITE_CODE && to >= 1));
  }

  // The value of a field at a point: a number, null where it is missing.
  value(field, row) {
    const code = field.values[row];
    if (field.label) return code;
    if (code === MISSING_CODE) return null;
    return code === INFINITE_CODE ? Infinity : field.low + code * (field.high - field.low);
  }

  nearest(x, y, z) {
    let best = -1, least = Infinity;
    for (let i = 0; i < this.count; i++) {
      const dx = this.points[3 * i] - x, dy = this.points[3 * i + 1] - y, dz = this.points[3 * i + 2] - z;
      const square = dx * dx + dy * dy + dz * dz;
      if (square < least) [best, least] = [i, square];
    }
    return best;
  }
}
