// Draws points by WebGL 2: round dots of a width in metres, then shaded by depth so that shapes stand out.

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
    cloud.positionBuffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, cloud.positionBuffer);
    gl.bufferData(gl.ARRAY_BUFFER, cloud.positions, gl.STATIC_DRAW);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 3, gl.UNSIGNED_SHORT, true, 8, 0);
    gl.bindBuffer(gl.ARRAY_BUFFER, cloud.colorBuffer);
    gl.enableVertexAttribArray(1);
    gl.vertexAttribPointer(1, 3, gl.UNSIGNED_BYTE, true, 4, 0);
  }

  release(cloud) {
    this.gl.deleteVertexArray(cloud.array);
    for (const buffer of [cloud.positionBuffer, cloud.colorBuffer]) this.gl.deleteBuffer(buffer);
  }

  recolor(cloud, colors) {
    const gl = this.gl;
    gl.bindBuffer(gl.ARRAY_BUFFER, cloud.colorBuffer);
    gl.bufferData(gl.ARRAY_BUFFER, colors, gl.DYNAMIC_DRAW);
  }

  /** Draws the first `count` points; returns the row of the canvas at which the picture begins. */
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

  /** Returns when everything is drawn: reading a pixel waits for it, which gl.finish() does not in every browser. */
  finish() {
    this.gl.readPixels(0, 0, 1, 1, this.gl.RGBA, this.gl.UNSIGNED_BYTE, new Uint8Array(4));
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
