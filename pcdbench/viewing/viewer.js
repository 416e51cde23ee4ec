// Draws the point clouds of every viewer on a page: panels side by side, one camera for all panels of a viewer.
//
// A viewer is <section class="pcdbench-viewer">, made by pcdbench/viewing/page.py: panels with a canvas each, controls,
// and the clouds as JSON (see payload.py). All panels of a page share one WebGL context, because browsers allow few:
// it draws off the screen, and each panel copies its picture. What draws is renderer.js, which comes before.

const FIELD_OF_VIEW = Math.PI / 4;
const START = { yaw: -Math.PI / 3, pitch: 0.9 };
const STEEPEST = Math.PI / 2 - 0.001;
const OBSERVED = [158, 166, 176], ADDED = [226, 106, 14]; // the legend's, in viewer.css
const SHARPEST = 2; // device pixels a CSS pixel at most: phones have 3, and nobody sees them in points
const WIDER = 1.2; // than the spacing, so that neighbours overlap
const FLUENT_MS = 30, REST_MS = 180, SMALLEST_SHARE = 0.05;

/** Looks at a target from a distance; z is up. Lengths in metres, from the lower corner of the clouds' frame. */
class Camera {
  constructor(low, high) {
    this.home = low.map((value, axis) => (value + high[axis]) / 2);
    this.radius = Math.max(Math.hypot(...high.map((value, axis) => value - low[axis])) / 2, 1e-3);
    this.reset();
  }

  reset() {
    Object.assign(this, START, { target: [...this.home], distance: this.radius * 2.45 });
  }

  lookDown() {
    Object.assign(this, { yaw: -Math.PI / 2, pitch: STEEPEST });
  }

  turn(right, up) {
    this.yaw -= right;
    this.pitch = Math.min(STEEPEST, Math.max(-STEEPEST, this.pitch + up));
  }

  zoom(factor) {
    this.distance = Math.min(this.radius * 20, Math.max(this.radius * 0.02, this.distance * factor));
  }

  /** Moves what is seen, by shares of the picture's height. */
  move(right, up) {
    const metres = this.distance * 2 * Math.tan(FIELD_OF_VIEW / 2), { x, y } = this.axes();
    for (let i = 0; i < 3; i++) this.target[i] -= metres * (right * x[i] + up * y[i]);
  }

  axes() {
    const [cy, sy, cp, sp] = [Math.cos(this.yaw), Math.sin(this.yaw), Math.cos(this.pitch), Math.sin(this.pitch)];
    return { x: [-sy, cy, 0], y: [-sp * cy, -sp * sy, cp], z: [cp * cy, cp * sy, sp] };
  }

  /** The column-major matrix from the cloud's unit cube to clip space, and its planes. */
  view(span, aspect) {
    const { x, y, z } = this.axes();
    // A narrow picture must still show the whole width.
    const tangent = Math.tan(FIELD_OF_VIEW / 2) / Math.min(1, aspect);
    const far = this.distance + 8 * this.radius, near = Math.max(far / 5000, this.distance / 100);
    const eye = this.target.map((value, i) => value + this.distance * z[i]);
    const dot = (a) => a[0] * eye[0] + a[1] * eye[1] + a[2] * eye[2];
    const [sx, sy, sz] = [1 / (tangent * aspect), 1 / tangent, (far + near) / (near - far)];
    const matrix = new Float32Array(16);
    for (let i = 0; i < 3; i++) matrix.set([sx * x[i] * span, sy * y[i] * span, sz * z[i] * span, -z[i] * span], 4 * i);
    matrix.set([-sx * dot(x), -sy * dot(y), -sz * dot(z) + (2 * far * near) / (near - far), dot(z)], 12);
    return { matrix, near, far, tangent };
  }
}

class Viewer {
  constructor(element, renderer) {
    this.element = element;
    this.renderer = renderer;
    const data = JSON.parse(element.querySelector("script[type='application/json']").textContent);
    Object.assign(this, { data, mode: data.mode, cut: data.cut_m, size: 1, waiting: false, share: 1, resting: 0 });
    this.maps = Object.fromEntries(Object.entries(data.maps).map(([name, text]) => [name, bytes(text)]));
    this.camera = new Camera(data.low, data.high);
    const canvases = [...element.querySelectorAll(".panel canvas")];
    this.panels = canvases.map((canvas, i) => ({ canvas, context: canvas.getContext("2d"), cloud: unpacked(data.clouds[i]) }));
    for (const bar of element.querySelectorAll("canvas[data-map]")) drawBar(bar, this.maps[bar.dataset.map]);
    this.upload();
    this.connectControls();
    this.resized = new ResizeObserver(() => this.draw());
    for (const { canvas } of this.panels) {
      connectPointers(canvas, this.camera, () => this.drawMoving());
      this.resized.observe(canvas);
    }
  }

  release() {
    clearTimeout(this.resting);
    this.resized.disconnect();
    for (const { cloud } of this.panels) this.renderer.release(cloud);
  }

  upload() {
    for (const { cloud } of this.panels) this.renderer.upload(cloud);
    this.recolor();
  }

  recolor() {
    for (const { cloud } of this.panels) this.renderer.recolor(cloud, this.colorsOf(cloud));
    for (const legend of this.element.querySelectorAll("[data-legend]")) legend.hidden = legend.dataset.legend !== this.mode;
    this.draw();
  }

  /** Four bytes a point: its colour in the mode that is on, and padding. */
  colorsOf(cloud) {
    const { count, positions, rgb, added, confidence, distance } = cloud;
    const colors = new Uint8Array(4 * count);
    const [low, high] = [this.data.low[2], this.data.high[2]].map((value) => (value / this.data.span_m) * 65535);
    const height = (i) => Math.min(1, Math.max(0, (positions[4 * i + 2] - low) / Math.max(high - low, 1)));
    const fill = (table, placeOf, light = () => 1) => {
      for (let i = 0; i < count; i++) {
        const at = placeOf(i), share = light(i);
        for (let channel = 0; channel < 3; channel++) colors[4 * i + channel] = share * table[at + channel];
      }
    };
    // What has one colour is lighter the higher it is, or desks could not be told from floors.
    const light = (i) => 0.72 + 0.4 * height(i);
    const isAdded = (i) => (added ? (added[i >> 3] >> (i & 7)) & 1 : 1);
    if (this.mode === "color" && rgb) fill(rgb, (i) => 3 * i);
    else if (this.mode === "distance") fill(this.maps.distance, (i) => 3 * distance[i]);
    else if (this.mode === "height") fill(this.maps.height, (i) => 3 * Math.round(255 * height(i)));
    else if (this.mode === "added" && added) fill([...OBSERVED, ...ADDED], (i) => 3 * isAdded(i), light);
    else if (this.mode === "confidence" && confidence) {
      // What was observed is not in question.
      fill([...OBSERVED, ...this.maps.confidence], (i) => isAdded(i) * (3 + 3 * confidence[i]), (i) => (isAdded(i) ? 1 : light(i)));
    }
    else fill(OBSERVED, () => 0, light);
    return colors;
  }

  connectControls() {
    const control = (name) => this.element.querySelector(`[data-control='${name}']`);
    for (const button of this.element.querySelectorAll("[data-mode]")) {
      button.addEventListener("change", () => { this.mode = button.dataset.mode; this.recolor(); });
      // Browsers keep what was chosen before a page was loaded anew.
      if (button.checked) this.mode = button.dataset.mode;
    }
    const size = control("size"), cut = control("cut");
    const readSize = () => { this.size = 2 ** Number(size.value); this.draw(); };
    const readCut = () => {
      const all = Number(cut.value) >= Number(cut.max);
      this.cut = all ? null : Number(cut.value);
      const shown = this.element.querySelector("[data-shows='cut']");
      shown.textContent = all ? "all" : `${(this.cut - this.data.low[2]).toFixed(2)} m`;
      this.draw();
    };
    size.addEventListener("input", readSize);
    cut.addEventListener("input", readCut);
    control("reset").addEventListener("click", () => { this.camera.reset(); this.draw(); });
    control("above").addEventListener("click", () => { this.camera.lookDown(); this.draw(); });
    this.recolor();
    readSize();
    readCut();
  }

  draw() {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => { this.waiting = false; this.drawNow(); });
  }

  /** While the camera moves a slow machine draws fewer points in fewer pixels, and all of them once it rests. */
  drawMoving() {
    if (!this.resting) this.share = null;
    clearTimeout(this.resting);
    this.resting = setTimeout(() => { this.resting = 0; this.share = 1; this.draw(); }, REST_MS);
    this.draw();
  }

  drawNow() {
    if (this.renderer.gl.isContextLost()) return;
    const unknown = this.share === null, before = performance.now();
    if (unknown) this.share = 1;
    const sharpness = Math.min(window.devicePixelRatio || 1, SHARPEST), scale = Math.sqrt(this.share);
    for (const { canvas, context, cloud } of this.panels) {
      const width = Math.round(canvas.clientWidth * sharpness), height = Math.round(canvas.clientHeight * sharpness);
      if (!width || !height) continue;
      if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
      const view = this.camera.view(this.data.span_m, width / height);
      view.sharpness = sharpness * scale;
      view.pointSize = (WIDER * this.data.spacing_m * this.size * height) / (2 * view.tangent);
      view.cut = this.cut === null ? 2 : this.cut / this.data.span_m;
      const [w, h] = [Math.ceil(width * scale), Math.ceil(height * scale)];
      const top = this.renderer.draw(cloud, Math.ceil(cloud.count * this.share), view, w, h);
      context.clearRect(0, 0, width, height);
      context.drawImage(this.renderer.canvas, 0, top, w, h, 0, 0, width, height);
    }
    if (unknown) {
      this.renderer.finish();
      this.share = Math.min(1, Math.max(SMALLEST_SHARE, FLUENT_MS / (performance.now() - before)));
    }
  }
}

function connectPointers(canvas, camera, draw) {
  const held = new Map();
  const place = (event) => ({ x: event.clientX, y: event.clientY });
  canvas.addEventListener("pointerdown", (event) => {
    canvas.focus({ preventScroll: true });
    try { canvas.setPointerCapture(event.pointerId); } catch { /* a pointer that is gone again */ }
    held.set(event.pointerId, place(event));
    event.preventDefault();
  });
  for (const name of ["pointerup", "pointercancel", "lostpointercapture"]) {
    canvas.addEventListener(name, (event) => held.delete(event.pointerId));
  }
  canvas.addEventListener("pointermove", (event) => {
    const before = held.get(event.pointerId);
    if (!before) return;
    const now = place(event), [right, down] = [now.x - before.x, now.y - before.y], height = canvas.clientHeight;
    const other = [...held].find(([id]) => id !== event.pointerId)?.[1];
    held.set(event.pointerId, now);
    if (other) {
      const apart = (point) => Math.max(Math.hypot(point.x - other.x, point.y - other.y), 1);
      camera.zoom(apart(before) / apart(now));
      camera.move(right / 2 / height, -down / 2 / height);
    } else if (event.shiftKey || event.buttons & 6) camera.move(right / height, -down / height);
    else camera.turn((right / height) * Math.PI, (down / height) * Math.PI);
    draw();
  });
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    camera.zoom(Math.exp(Math.max(-120, Math.min(120, event.deltaY * (event.deltaMode ? 30 : 1))) * 0.0015));
    draw();
  }, { passive: false });
  canvas.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const arrow = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
    if (arrow && event.shiftKey) camera.move(arrow[0] * 0.05, arrow[1] * 0.05);
    else if (arrow) camera.turn(arrow[0] * 0.09, -arrow[1] * 0.09);
    else if (event.key === "+" || event.key === "=") camera.zoom(0.9);
    else if (event.key === "-") camera.zoom(1 / 0.9);
    else if (event.key === "Home" || event.key === "0") camera.reset();
    else if (event.key === "t") camera.lookDown();
    else return;
    event.preventDefault();
    draw();
  });
}

function drawBar(canvas, map) {
  Object.assign(canvas, { width: 256, height: 1 });
  const context = canvas.getContext("2d"), row = context.createImageData(256, 1);
  for (let i = 0; i < 256; i++) row.data.set([map[3 * i], map[3 * i + 1], map[3 * i + 2], 255], 4 * i);
  context.putImageData(row, 0, 0);
}

function bytes(text) {
  const binary = atob(text), found = new Uint8Array(binary.length);
  for (let i = 0; i < binary.length; i++) found[i] = binary.charCodeAt(i);
  return found;
}

/** Positions get a fourth, unused value: graphics cards want vertices at multiples of four bytes. */
function unpacked(packed) {
  const raw = bytes(packed.xyz), count = raw.length / 6, positions = new Uint16Array(4 * count);
  for (let i = 0; i < count; i++) {
    for (let axis = 0; axis < 3; axis++) positions[4 * i + axis] = raw[6 * i + 2 * axis] | (raw[6 * i + 2 * axis + 1] << 8);
  }
  const optional = (name) => (packed[name] === null ? null : bytes(packed[name]));
  return { count, positions, rgb: optional("rgb"), added: optional("added"), confidence: optional("confidence"), distance: optional("distance") };
}

let renderer = null;

/** Starts the viewers that have not been started, and lets go of those that have left the page. */
function start() {
  const elements = [...document.querySelectorAll(".pcdbench-viewer:not([data-started])")];
  if (!elements.length) return;
  renderer ??= new Renderer();
  const gone = renderer.viewers.filter((viewer) => !viewer.element.isConnected);
  for (const viewer of gone) viewer.release();
  renderer.viewers = renderer.viewers.filter((viewer) => !gone.includes(viewer));
  for (const element of elements) {
    element.dataset.started = renderer.gl ? "yes" : "no";
    if (renderer.gl) renderer.viewers.push(new Viewer(element, renderer));
    else element.querySelector(".no-webgl").hidden = false;
  }
}

// A page that puts in a viewer later says so by this event.
document.addEventListener("pcdbench-viewers", start);
if (document.readyState === "loading") document.addEventListener("DOMContentLoaded", start);
else start();
