// The scene on its canvas: camera, colours of the page, section, pictures.
"use strict";

const FIELD_OF_VIEW = 30, FAR_AWAY = 60, LEGEND = 140, BUTTONS = 70;  // pixels below and above

class Viewer {
  constructor(data, bytes, canvas) {
    this.data = data;
    this.canvas = canvas;
    this.diagonal = data.diagonal;
    this.middle = new THREE.Vector3();  // all places are relative to the middle of the shape
    this.cut = [0, 0, 0, 1];
    this.cutsAll = false;
    this.palette = colorTexture(base64Bytes(data.palette), false);
    this.maps = Object.fromEntries(Object.entries(data.maps).map(
      ([name, text]) => [name, colorTexture(base64Bytes(text), true)]));
    this.renderer = new THREE.WebGLRenderer({canvas, antialias: true});
    this.renderer.setPixelRatio(this.ratio());
    this.scene = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(FIELD_OF_VIEW, 1, this.diagonal / 500, FAR_AWAY * this.diagonal);
    this.controls = new THREE.OrbitControls(this.camera, canvas);
    this.controls.enableDamping = true;
    this.controls.dampingFactor = 0.12;
    this.controls.maxDistance = FAR_AWAY * this.diagonal / 2;
    this.controls.addEventListener("change", () => this.draw());
    this.controls.addEventListener("start", () => { this.isFirstView = false; });
    this.parts = data.parts.map(about => new Part(about, bytes, this));
    for (const part of this.parts) for (const object of part.objects) this.scene.add(object);
    this.ball = this.makeBall();
    this.drawn = [];  // called after each frame, to move labels
    this.lookFrom(data.direction, data.up);
    new ResizeObserver(() => this.resize()).observe(canvas.parentElement);
    this.resize();
  }

  ratio() { return Math.min(window.devicePixelRatio || 1, 2); }

  isDark() { return document.documentElement.dataset.theme === "dark"; }
  plainColor(kind) {
    if (kind === "surface") return this.isDark() ? [0.66, 0.71, 0.78] : [0.62, 0.67, 0.74];
    return this.isDark() ? [0.75, 0.78, 0.82] : [0.42, 0.45, 0.50];
  }
  innerColor() { return this.isDark() ? [0.30, 0.25, 0.24] : [0.86, 0.74, 0.68]; }
  background() { return this.isDark() ? 0x14161a : 0xffffff; }

  // From outside along a direction; all of the shape is seen, on narrow screens as well.
  lookFrom(direction, up) {
    const away = new THREE.Vector3(...direction).normalize();
    this.camera.up.set(...up);
    this.camera.position.copy(this.middle).addScaledVector(away, this.distanceAlong(away));
    this.isFirstView = true;
    this.controls.target.copy(this.middle);
    this.controls.update();
    this.draw();
  }

  // How far away the camera must be for all that is seen at first to be above the legend and below the
  // buttons.
  distanceAlong(away) {
    const {clientWidth: width, clientHeight: height} = this.canvas.parentElement;
    const right = this.camera.up.clone().cross(away).normalize(), above = away.clone().cross(right);
    const half = 0.93 * Math.tan(FIELD_OF_VIEW / 2 * Math.PI / 180);
    const wide = half * Math.max(0.2, width / Math.max(1, height));
    const tall = half * Math.max(0.2, (height - LEGEND - BUTTONS) / Math.max(1, height));
    const place = new THREE.Vector3();
    let farthest = 0.1 * this.diagonal;
    for (const {points, balls} of this.parts.filter(part => part.visible)) {
      const step = Math.ceil(points.length / 60000);
      for (let row = 0; 3 * row < points.length; row += step) {
        place.set(points[3 * row], points[3 * row + 1], points[3 * row + 2]).sub(this.middle);
        const sides = Math.max(Math.abs(place.dot(right)), Math.abs(place.dot(above)) * wide / tall);
        const off = (sides + (balls ? balls[row] : 0)) / wide;
        if (place.length() < 2 * this.diagonal) farthest = Math.max(farthest, place.dot(away) + off);
      }
    }
    return farthest;
  }

  // Turn round what is looked at: about the axis that is up, and up or down, short of the poles.
  turn(around, down) {
    const {camera, controls} = this, up = camera.up.clone().normalize();
    const away = camera.position.clone().sub(controls.target);
    const polar = away.angleTo(up), right = up.clone().cross(away).normalize();
    const room = Math.min(Math.PI - 0.01, Math.max(0.01, polar + down)) - polar;
    away.applyAxisAngle(right, room).applyAxisAngle(up, around);
    this.isFirstView = false;
    camera.position.copy(controls.target).add(away);
    this.draw();
  }

  zoom(factor) {
    const {camera, controls} = this, away = camera.position.clone().sub(controls.target);
    this.isFirstView = false;
    const far = Math.min(controls.maxDistance, Math.max(this.diagonal / 400, factor * away.length()));
    camera.position.copy(controls.target).add(away.setLength(far));
    this.draw();
  }

  // Fly to a place: the camera keeps its direction and comes nearer.
  lookAt(place) {
    this.isFirstView = false;
    const from = this.camera.position.clone(), target = this.controls.target.clone();
    const to = new THREE.Vector3(...place), away = from.clone().sub(target).normalize();
    const near = to.clone().addScaledVector(away, Math.min(from.distanceTo(target), 0.9 * this.diagonal));
    const begin = performance.now();
    const step = now => {
      const t = Math.min(1, (now - begin) / 450), s = t * t * (3 - 2 * t);
      this.camera.position.lerpVectors(from, near, s);
      this.controls.target.lerpVectors(target, to, s);
      this.controls.update();
      if (t < 1) requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }

  resize() {
    const {clientWidth: width, clientHeight: height} = this.canvas.parentElement;
    if (!width || !height) return;
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.setViewOffset(width, height, 0, (LEGEND - BUTTONS) / 2, width, height);
    if (this.isFirstView) this.lookFrom(this.data.direction, this.data.up);
    this.draw();
  }

  // Pixels that one unit of length takes at distance 1.
  pixelsAtOne() {
    const height = this.canvas.clientHeight * this.ratio();
    return height / 2 / Math.tan(FIELD_OF_VIEW / 2 * Math.PI / 180);
  }

  // Draw with the next frame, once for all changes before it.
  draw() {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => {
      this.waiting = false;
      this.controls.update();
      this.drawNow();
    });
  }

  drawNow() {
    this.renderer.setClearColor(this.background());
    for (const part of this.parts ?? []) part.uniforms.pixels.value = this.pixelsAtOne();
    this.renderer.render(this.scene, this.camera);
    for (const call of this.drawn ?? []) call();
  }

  refresh() { for (const part of this.parts) part.refresh(); }

  // Where a place is on the canvas, in pixels of the page; null behind the camera.
  onScreen(place) {
    const seen = new THREE.Vector3(...place).project(this.camera);
    if (seen.z > 1) return null;
    return [(seen.x + 1) / 2 * this.canvas.clientWidth, (1 - seen.y) / 2 * this.canvas.clientHeight];
  }

  rayThrough(x, y) {
    const at = new THREE.Vector3(
      2 * x / this.canvas.clientWidth - 1, 1 - 2 * y / this.canvas.clientHeight, 0.5);
    const origin = this.camera.position.clone();
    return {origin, direction: at.unproject(this.camera).sub(origin).normalize()};
  }

  // Cut away what lies beyond a plane: its normal, and its place from 0 to 1 across the shape.
  cutBy(normal, share) {
    const n = new THREE.Vector3(...normal).normalize();
    const reach = this.data.half.reduce((sum, half, axis) => sum + half * Math.abs(n.getComponent(axis)), 0);
    this.cut = [n.x, n.y, n.z, n.dot(this.middle) + (2 * share - 1) * 1.001 * reach];
    this.refresh();
  }

  isCutAway(place) {
    const [x, y, z, w] = this.cut;
    return x * place[0] + y * place[1] + z * place[2] > w;
  }

  uncut() {
    this.cut = [0, 0, 0, 1];
    this.refresh();
  }

  makeBall() {
    const material = new THREE.ShaderMaterial({
      glslVersion: THREE.GLSL3, transparent: true, depthWrite: false,
      uniforms: {color: {value: new THREE.Color(0.95, 0.55, 0.1)}},
      vertexShader: `out vec3 away; out vec3 toEye; void main() {
        vec4 seen = modelViewMatrix * vec4(position, 1.0); away = normalMatrix * normal;
        toEye = -seen.xyz; gl_Position = projectionMatrix * seen; }`,
      fragmentShader: `precision highp float; uniform vec3 color; in vec3 away; in vec3 toEye;
        out vec4 fragment; void main() {
        float side = 1.0 - abs(dot(normalize(away), normalize(toEye)));
        fragment = vec4(color, 0.16 + 0.7 * side * side); }`,
    });
    const ball = new THREE.Mesh(new THREE.SphereGeometry(1, 48, 32), material);
    ball.visible = ball.frustumCulled = false;
    ball.renderOrder = 2;
    this.scene.add(ball);
    return ball;
  }

  showBall(center, radius) {
    this.ball.visible = radius > 0;
    if (radius > 0) {
      this.ball.position.set(...center);
      this.ball.scale.setScalar(radius);
    }
    this.draw();
  }

  // The colours of all pixels of the canvas, from the lowest row.
  pixels() {
    this.drawNow();
    const gl = this.renderer.getContext();
    const {drawingBufferWidth: width, drawingBufferHeight: height} = gl;
    const found = new Uint8Array(4 * width * height);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, found);
    return found;
  }

  // A picture with the legend in words below, in twice the pixels of the screen at least.
  picture(lines) {
    const ratio = this.renderer.getPixelRatio();
    this.renderer.setPixelRatio(Math.max(2, ratio));
    this.resize();
    this.drawNow();
    const {width, height} = this.canvas, paper = document.createElement("canvas");
    const row = Math.round(width / 48), pen = paper.getContext("2d");
    [paper.width, paper.height] = [width, height + row * (0.8 + 1.4 * lines.length)];
    pen.fillStyle = this.isDark() ? "#14161a" : "#ffffff";
    pen.fillRect(0, 0, paper.width, paper.height);
    pen.drawImage(this.canvas, 0, 0);
    pen.fillStyle = this.isDark() ? "#e4e6e9" : "#1d2126";
    pen.font = `${row}px system-ui, sans-serif`;
    lines.forEach((line, i) => this.writeLine(pen, line, row, height + row * (1.2 + 1.4 * i)));
    this.renderer.setPixelRatio(ratio);
    this.resize();
    return paper;
  }

  writeLine(pen, {text, colors}, row, top) {
    let left = row;
    if (colors) {
      const bar = pen.createLinearGradient(left, 0, left + 12 * row, 0);
      colors.forEach((color, i) => bar.addColorStop(i / (colors.length - 1), color));
      const ink = pen.fillStyle;
      pen.fillStyle = bar;
      pen.fillRect(left, top - 0.75 * row, 12 * row, 0.8 * row);
      pen.fillStyle = ink;
      left += 13 * row;
    }
    pen.fillText(text, left, top);
  }
}
