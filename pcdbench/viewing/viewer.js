// Draws the point clouds of every viewer on a page: panels side by side, one camera for all panels of a viewer.
//
// A viewer is <section class="pcdbench-viewer">, made by pcdbench/viewing/page.py: panels with a canvas each, controls,
// and the clouds as JSON (see payload.py). All panels of a page share one WebGL context, because browsers allow few:
// it draws off the screen, and each panel copies its picture.
(() => {
  "use strict";

  const FIELD_OF_VIEW = Math.PI / 4;
  const START = { yaw: -Math.PI / 3, pitch: 0.9 };
  const STEEPEST = Math.PI / 2 - 0.001;
  const OBSERVED = [158, 166, 176], ADDED = [226, 106, 14]; // the legend's, in viewer.css
  const SHARPEST = 2; // device pixels a CSS pixel at most: phones have 3, and nobody sees them in points

  const POINTS_VERTEX = `#version 300 es
    uniform mat4 clip_from_cloud; uniform float size; uniform float cut;
    layout(location = 0) in vec3 position; layout(location = 1) in vec3 color;
    flat out vec3 shown; flat out float is_round;
    void main() {
      gl_Position = position.z > cut ? vec4(2.0, 2.0, 2.0, 1.0) : clip_from_cloud * vec4(position, 1.0);
      gl_PointSize = clamp(size / gl_Position.w, 1.0, 60.0);
      is_round = gl_PointSize > 2.5 ? 1.0 : 0.0;
      shown = color;
    }`;
  const POINTS_FRAGMENT = `#version 300 es
    precision mediump float;
    flat in vec3 shown; flat in float is_round; out vec4 pixel;
    void main() {
      vec2 offset = gl_PointCoord - 0.5;
      if (is_round * dot(offset, offset) > 0.25) discard;
      pixel = vec4(shown, 1.0);
    }`;
  const SHADE_VERTEX = `#version 300 es
    void main() { gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, 0.0, 1.0); }`;
  // Eye-dome lighting (Boucheny 2009, thesis, Grenoble): a pixel darkens by how far its neighbours stand before it.
  // It gives clouds without normals, and without colour, a visible shape.
  const SHADE_FRAGMENT = `#version 300 es
    precision highp float; precision highp sampler2D;
    uniform sampler2D colors, depths; uniform vec2 planes; uniform int reach; uniform ivec2 last; out vec4 pixel;
    float log_depth(ivec2 at) {
      float z = texelFetch(depths, clamp(at, ivec2(0), last), 0).r;
      return log2(planes.x * planes.y / (planes.y - z * (planes.y - planes.x)));
    }
    void main() {
      ivec2 at = ivec2(gl_FragCoord.xy);
      vec4 color = texelFetch(colors, at, 0);
      if (color.a == 0.0) { pixel = vec4(0.0); return; }
      float here = log_depth(at);
      float before = max(0.0, here - log_depth(at + ivec2(reach, 0))) + max(0.0, here - log_depth(at - ivec2(reach, 0)))
        + max(0.0, here - log_depth(at + ivec2(0, reach))) + max(0.0, here - log_depth(at - ivec2(0, reach)));
      pixel = vec4(color.rgb * max(0.3, exp(-6.0 * before)), 1.0);
    }`;

  /** The page's one WebGL context: draws one cloud at a time into its own canvas, lower left corner. */
  class Renderer {
    constructor() {
      this.canvas = document.createElement("canvas");
      this.gl = this.canvas.getContext("webgl2", { antialias: false, depth: false, powerPreference: "high-performance" });
      this.viewers = [];
      this.canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
      this.canvas.addEventListener("webglcontextrestored", () => {
        this.setUp();
        for (const viewer of this.viewers) viewer.upload();
      });
      if (this.gl) this.setUp();
    }

    setUp() {
      const gl = this.gl;
      this.points = program(gl, POINTS_VERTEX, POINTS_FRAGMENT);
      this.shade = program(gl, SHADE_VERTEX, SHADE_FRAGMENT);
      this.nothing = gl.createVertexArray();
      this.framebuffer = gl.createFramebuffer();
      this.width = this.height = 0;
    }

    /** The textures only grow: panels that differ by a pixel must not make them anew in every frame. */
    makeRoom(width, height) {
      if (width <= this.width && height <= this.height) return;
      const gl = this.gl;
      this.width = this.canvas.width = Math.max(width, this.width);
      this.height = this.canvas.height = Math.max(height, this.height);
      gl.bindFramebuffer(gl.FRAMEBUFFER, this.framebuffer);
      for (const texture of [this.colorTexture, this.depthTexture]) if (texture) gl.deleteTexture(texture);
      this.colorTexture = this.texture(gl.RGBA8, gl.COLOR_ATTACHMENT0);
      this.depthTexture = this.texture(gl.DEPTH_COMPONENT24, gl.DEPTH_ATTACHMENT);
    }

    texture(format, attachment) {
      const gl = this.gl, texture = gl.createTexture();
      gl.bindTexture(gl.TEXTURE_2D, texture);
      gl.texStorage2D(gl.TEXTURE_2D, 1, format, this.width, this.height);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
      gl.framebufferTexture2D(gl.FRAMEBUFFER, attachment, gl.TEXTURE_2D, texture, 0);
      return texture;
    }

    upload(cloud) {
      const gl = this.gl;
      cloud.array = gl.createVertexArray();
      cloud.colorBuffer = gl.createBuffer();
      gl.bindVertexArray(cloud.array);
      gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
      gl.bufferData(gl.ARRAY_BUFFER, cloud.positions, gl.STATIC_DRAW);
      gl.enableVertexAttribArray(0);
      gl.vertexAttribPointer(0, 3, gl.UNSIGNED_SHORT, true, 8, 0);
      gl.bindBuffer(gl.ARRAY_BUFFER, cloud.colorBuffer);
      gl.enableVertexAttribArray(1);
      gl.vertexAttribPointer(1, 3, gl.UNSIGNED_BYTE, true, 4, 0);
    }

    recolor(cloud, colors) {
      const gl = this.gl;
      gl.bindBuffer(gl.ARRAY_BUFFER, cloud.colorBuffer);
      gl.bufferData(gl.ARRAY_BUFFER, colors, gl.DYNAMIC_DRAW);
    }

    draw(cloud, count, view, width, height) {
      const gl = this.gl;
      this.makeRoom(width, height);
      gl.viewport(0, 0, width, height);
      gl.bindFramebuffer(gl.FRAMEBUFFER, this.framebuffer);
      gl.clearColor(0, 0, 0, 0);
      gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
      gl.enable(gl.DEPTH_TEST);
      gl.useProgram(this.points.program);
      gl.uniformMatrix4fv(this.points.at("clip_from_cloud"), false, view.matrix);
      gl.uniform1f(this.points.at("size"), view.pointSize);
      gl.uniform1f(this.points.at("cut"), view.cut);
      gl.bindVertexArray(cloud.array);
      gl.drawArrays(gl.POINTS, 0, count);

      gl.bindFramebuffer(gl.FRAMEBUFFER, null);
      gl.disable(gl.DEPTH_TEST);
      gl.useProgram(this.shade.program);
      gl.activeTexture(gl.TEXTURE0);
      gl.bindTexture(gl.TEXTURE_2D, this.colorTexture);
      gl.activeTexture(gl.TEXTURE1);
      gl.bindTexture(gl.TEXTURE_2D, this.depthTexture);
      gl.uniform1i(this.shade.at("colors"), 0);
      gl.uniform1i(this.shade.at("depths"), 1);
      gl.uniform2f(this.shade.at("planes"), view.near, view.far);
      gl.uniform1i(this.shade.at("reach"), Math.max(1, Math.round(1.4 * view.sharpness)));
      gl.uniform2i(this.shade.at("last"), width - 1, height - 1);
      gl.bindVertexArray(this.nothing);
      gl.drawArrays(gl.TRIANGLES, 0, 3);
      return this.canvas.height - height;
    }
  }

  function program(gl, vertex, fragment) {
    const made = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(made, shader);
    }
    gl.linkProgram(made);
    if (!gl.getProgramParameter(made, gl.LINK_STATUS) && !gl.isContextLost()) throw new Error(gl.getProgramInfoLog(made));
    const places = {};
    return { program: made, at: (name) => (places[name] ??= gl.getUniformLocation(made, name)) };
  }

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
      Object.assign(this, { data, mode: data.mode, cut: data.cut_m, size: 1, waiting: false });
      this.maps = Object.fromEntries(Object.entries(data.maps).map(([name, text]) => [name, bytes(text)]));
      this.camera = new Camera(data.low, data.high);
      const canvases = [...element.querySelectorAll(".panel canvas")];
      this.panels = canvases.map((canvas, i) => ({ canvas, context: canvas.getContext("2d"), cloud: unpacked(data.clouds[i]) }));
      for (const bar of element.querySelectorAll("canvas[data-map]")) drawBar(bar, this.maps[bar.dataset.map]);
      this.upload();
      this.connectControls();
      const resized = new ResizeObserver(() => this.draw());
      for (const { canvas } of this.panels) {
        connectPointers(canvas, this.camera, () => this.draw());
        resized.observe(canvas);
      }
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
      const { count, positions, rgb, added, distance } = cloud;
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
      if (this.mode === "color" && rgb) fill(rgb, (i) => 3 * i);
      else if (this.mode === "distance") fill(this.maps.distance, (i) => 3 * distance[i]);
      else if (this.mode === "height") fill(this.maps.height, (i) => 3 * Math.round(255 * height(i)));
      else if (this.mode === "added" && added) fill([...OBSERVED, ...ADDED], (i) => 3 * ((added[i >> 3] >> (i & 7)) & 1), light);
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

    drawNow() {
      if (this.renderer.gl.isContextLost()) return;
      const sharpness = Math.min(window.devicePixelRatio || 1, SHARPEST);
      for (const { canvas, context, cloud } of this.panels) {
        const width = Math.round(canvas.clientWidth * sharpness), height = Math.round(canvas.clientHeight * sharpness);
        if (!width || !height) continue;
        if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
        const view = this.camera.view(this.data.span_m, width / height);
        view.sharpness = sharpness;
        view.pointSize = (1.2 * this.data.spacing_m * this.size * height) / (2 * view.tangent);
        view.cut = this.cut === null ? 2 : this.cut / this.data.span_m;
        const top = this.renderer.draw(cloud, cloud.count, view, width, height);
        context.clearRect(0, 0, width, height);
        context.drawImage(this.renderer.canvas, 0, top, width, height, 0, 0, width, height);
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
    return { count, positions, rgb: optional("rgb"), added: optional("added"), distance: optional("distance") };
  }

  function start() {
    const elements = [...document.querySelectorAll(".pcdbench-viewer:not([data-started])")];
    if (!elements.length) return;
    const renderer = new Renderer();
    for (const element of elements) {
      element.dataset.started = renderer.gl ? "yes" : "no";
      if (renderer.gl) renderer.viewers.push(new Viewer(element, renderer));
      else element.querySelector(".no-webgl").hidden = false;
    }
  }

  if (document.readyState === "loading") document.addEventListener("DOMContentLoaded", start);
  else start();
})();
