// What the graphics card runs. Light falls from above and from the front left: a face that looks up has its full colour.

const WIDE = 2048;
const LIGHT = `
float bright(vec3 n) { return clamp(0.52 + 0.48 * dot(n, vec3(-0.30, -0.50, 0.81)) / 0.81, 0.42, 1.0); }`;

const HEAD = `#version 300 es
precision highp float; precision highp int;
uniform mat4 u_view; uniform vec3 u_eye; uniform float u_pixel;`;     // u_pixel: of the canvas, per unit of depth

// Tables of numbers are textures ${WIDE} texels wide, read by number: instancing is slow where there is no graphics card.
const TABLE = `
ivec2 texel(int k) { return ivec2(k % ${WIDE}, k / ${WIDE}); }`;

// A move as a bead, from the place of row k - 1 to that of row k. Of a round one vertex i < 4 lies around its start,
// i < 8 around its end, then come the two tips. a: width and height in steps of 5 um, 12 bits each.
const BEAD_VERTEX = `${HEAD}
uniform highp sampler2D u_places; uniform highp usampler2D u_paint; uniform int u_base; uniform int u_step;
uniform uint u_roles; uniform bool u_ribbon; uniform float u_thin; uniform sampler2D u_colours;
out vec3 v_colour; out vec3 v_normal; ${LIGHT} ${TABLE}
void main() {
  int corners = u_ribbon ? 4 : 10, k = u_base + u_step * (gl_VertexID / corners), i = gl_VertexID % corners;
  vec4 end = texelFetch(u_places, texel(k), 0);
  uvec4 paint = texelFetch(u_paint, texel(k), 0);
  vec3 from = texelFetch(u_places, texel(k - 1), 0).xyz, to = end.xyz;
  vec3 way = to - from; float len = length(way);
  if (((u_roles >> paint.b) & 1u) == 0u || len < 1e-6) { gl_Position = vec4(0.0, 0.0, 2.0, 1.0); return; }
  v_colour = texture(u_colours, vec2((float(paint.r + 256u * paint.g)) / 65535.0, 0.5)).rgb;
  way /= len;
  vec3 look = normalize(u_eye - 0.5 * (from + to));
  float wide = max(mod(end.a, 4096.0) * 0.005, u_thin), tall = max(floor(end.a / 4096.0) * 0.005, u_thin);
  from.z -= 0.5 * tall; to.z -= 0.5 * tall;
  if (u_ribbon) {
    vec3 side = normalize(cross(way, look)), level = cross(way, vec3(0.0, 0.0, 1.0));
    vec3 at = i < 2 ? from : to;
    float least = 0.6 * u_pixel * dot(u_eye - at, look), flatter = abs(look.z);
    float half_wide = max(0.5 * mix(tall, wide, flatter), least);
    at += side * (i % 2 == 0 ? half_wide : -half_wide) + way * (i < 2 ? -0.5 : 0.5) * min(wide, 2.0 * half_wide);
    level = length(level) > 1e-6 ? normalize(level) * sign(dot(level, look) + 1e-9) : look;
    v_normal = normalize(level * sqrt(max(1.0 - look.z * look.z, 0.0)) + vec3(0.0, 0.0, abs(look.z)));
    gl_Position = u_view * vec4(at, 1.0);
    return;
  }
  vec3 side = cross(way, vec3(0.0, 0.0, 1.0));
  side = length(side) > 1e-6 ? normalize(side) : vec3(1.0, 0.0, 0.0);
  vec3 up = cross(side, way);
  vec3 at;
  if (i >= 8) { at = i == 8 ? from - way * 0.5 * wide : to + way * 0.5 * wide; v_normal = i == 8 ? -way : way; }
  else {
    int k = i % 4;
    v_normal = k == 0 ? -side : k == 1 ? up : k == 2 ? side : -up;
    at = (i < 4 ? from : to) + v_normal * 0.5 * (k % 2 == 0 ? wide : tall);
  }
  gl_Position = u_view * vec4(at, 1.0);
}`;

const SHADED = `#version 300 es
precision highp float;
in vec3 v_colour; in vec3 v_normal; out vec4 colour; ${LIGHT}
void main() { colour = vec4(v_colour * bright(normalize(v_normal)), 1.0); }`;

// Rods of the machine: six sides around a line, never thinner than a pixel. Three texels each: from and radius, to, colour.
const ROD_VERTEX = `${HEAD}
uniform highp sampler2D u_places; uniform int u_base;
out vec3 v_colour; out vec3 v_normal; ${TABLE}
void main() {
  int k = 3 * (u_base + gl_VertexID / 12), i = gl_VertexID % 12;
  vec4 from = texelFetch(u_places, texel(k), 0), to = texelFetch(u_places, texel(k + 1), 0);
  vec3 way = normalize(to.xyz - from.xyz), any = abs(way.z) > 0.9 ? vec3(1.0, 0.0, 0.0) : vec3(0.0, 0.0, 1.0);
  vec3 side = normalize(cross(way, any)), up = cross(side, way), at = i < 6 ? from.xyz : to.xyz;
  float angle = float(i % 6) * 1.0471976;
  v_normal = cos(angle) * side + sin(angle) * up;
  float least = 0.75 * u_pixel * length(u_eye - at);
  v_colour = texelFetch(u_places, texel(k + 2), 0).rgb;
  gl_Position = u_view * vec4(at + v_normal * max(from.a, least), 1.0);
}`;

// Triangles, each of one colour: part, platform, nozzle, plate.
const MESH_VERTEX = `${HEAD}
layout(location = 0) in vec3 a_place; layout(location = 1) in vec3 a_normal; layout(location = 2) in float a_value;
uniform vec3 u_shift; uniform vec4 u_colour; uniform sampler2D u_colours;
out vec3 v_colour; out vec3 v_normal; out float v_height;
void main() {
  vec3 at = a_place + u_shift;
  v_normal = a_normal; v_height = at.z;
  v_colour = u_colour.a > 0.0 ? u_colour.rgb : texture(u_colours, vec2(a_value, 0.5)).rgb;
  gl_Position = u_view * vec4(at, 1.0);
}`;

const CUT = `#version 300 es
precision highp float;
in vec3 v_colour; in vec3 v_normal; in float v_height; out vec4 colour; uniform float u_cut; ${LIGHT}
void main() {
  if (v_height > u_cut) discard;
  vec3 n = normalize(v_normal);
  colour = gl_FrontFacing ? vec4(v_colour * bright(n), 1.0) : vec4(v_colour * 0.45 * bright(-n), 1.0);
}`;

// Cells of a map: one cube each, twelve triangles. Texel: middle, place on the scale of colours.
const CELL_VERTEX = `${HEAD}
uniform highp sampler2D u_places; uniform int u_base; uniform vec3 u_side; uniform sampler2D u_colours;
out vec3 v_colour; out vec3 v_normal; out float v_height; ${TABLE}
void main() {
  int i = gl_VertexID % 36, axis = i / 12, corner = i % 6;
  float way = (i / 6) % 2 == 0 ? -1.0 : 1.0;
  vec4 cell = texelFetch(u_places, texel(u_base + gl_VertexID / 36), 0);
  float u = corner == 1 || corner == 2 || corner == 4 ? 0.5 : -0.5, v = corner == 2 || corner > 3 ? 0.5 : -0.5;
  vec3 at = axis == 0 ? vec3(0.5 * way, way * u, v) : axis == 1 ? vec3(v, 0.5 * way, way * u) : vec3(way * u, v, 0.5 * way);
  v_normal = axis == 0 ? vec3(way, 0.0, 0.0) : axis == 1 ? vec3(0.0, way, 0.0) : vec3(0.0, 0.0, way);
  v_height = cell.z;
  v_colour = texture(u_colours, vec2(cell.a, 0.5)).rgb;
  gl_Position = u_view * vec4(cell.xyz + at * u_side, 1.0);
}`;

function program(gl, vertex, fragment) {
  const made = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    gl.attachShader(made, shader);
  }
  gl.linkProgram(made);
  if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(made));
  const places = {};
  for (let i = 0; i < gl.getProgramParameter(made, gl.ACTIVE_UNIFORMS); i++) {
    const { name } = gl.getActiveUniform(made, i);
    places[name] = gl.getUniformLocation(made, name);
  }
  return { made, at: places };
}
