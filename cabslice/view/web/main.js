// The page: reads the data, answers to pointer, keys and sliders, and asks the stage for frames when something changed.

const SCALE = scaleColours(), GROUND = [0.953, 0.961, 0.973], PART = [0.80, 0.62, 0.42];
const camera = new Camera(), state = {
  ready: false, settled: false, failed: "", dirty: true, first: 1, at: 0, part: 1, only: false, roles: 0, field: null, low: 0, high: 1, stamp: 0,
  cut: 1e9, playing: false, pace: 1, hovered: -1, finding: -1, pose: null, whole: false,
};
let data, stage, moves = null, cells = null, mesh = null, robot = null, fields = [], bounds = [[0, 0, 0], [1, 1, 1]], restAt = 0, asked = false, before = 0;

// ---- reading

async function start() {
  data = JSON.parse($("data").textContent);
  $("title").textContent = data.title;
  $("kind").textContent = [data.kind, data.machine && data.machine.name].filter(Boolean).join(" · ");
  rows($("facts"), Object.entries(data.facts));
  showNotes(data.notes);
  stage = new Stage($("canvas"));
  if (data.machine) robot = new Machine(data.machine, stage);
  if (data.moves) await readMoves(data.moves);
  if (data.mesh) await readMesh(data.mesh);
  if (data.cells) await readCells(data.cells);
  $("robot").hidden = !robot;
  if (!moves && !mesh && !cells) bounds = machineBox();
  camera.reach = 1.2 * Math.max(radius(bounds), robot ? radius(machineBox()) : 0);
  const wished = new URLSearchParams(location.hash.slice(1));      // page.html#colour=speed_mm_s&layer=60&whole
  await colourBy(wished.get("colour") || (cells ? fields[0].key : FEATURE.key));
  marks();
  fit(false);
  if (wished.has("whole") && robot) Object.assign(camera, around(machineBox()), { turn: -0.5, lift: 0.35 });
  if (wished.has("layer")) setLayer(+wished.get("layer") - 1);
  Object.assign(state, { ready: true, opened: performance.now() });      // ms since the page was asked for
  $("wait").remove();
  redraw();
  for (const field of fields) await field.load();
}

async function readMoves(packed) {
  const [xyz, role, layer, width, height, time] = await Promise.all([vectors(packed.xyz), unpacked(packed.role, Uint8Array),
    unpacked(packed.layer, Int32Array), unpacked(packed.width, Float32Array), unpacked(packed.height, Float32Array), unpacked(packed.time, Float64Array)]);
  const count = role.length, lengths = new Float64Array(data.roles.length);
  moves = { xyz, role, layer, width, height, time, count, lengths, clock: packed.clock, ends: new Map(), begins: new Map() };
  bounds = [[1e9, 1e9, 1e9], [-1e9, -1e9, -1e9]];
  for (let i = 1; i < count; i++) {
    const length = Math.hypot(xyz[3 * i] - xyz[3 * i - 3], xyz[3 * i + 1] - xyz[3 * i - 2], xyz[3 * i + 2] - xyz[3 * i - 1]);
    lengths[role[i]] += length;
    if (!moves.begins.has(layer[i])) moves.begins.set(layer[i], i);
    moves.ends.set(layer[i], i);
    if (role[i] !== TRAVEL && length > 0) for (let k = 0; k < 3; k++) {
      bounds[0][k] = Math.min(bounds[0][k], xyz[3 * i + k]);
      bounds[1][k] = Math.max(bounds[1][k], xyz[3 * i + k]);
    }
  }
  if (bounds[0][0] > bounds[1][0]) bounds = [[-50, -50, 0], [50, 50, 50]];
  moves.layers = packed.heights;
  fields = packed.fields.map((row) => new Field(row));
  stage.levels = levelsOf(moves);
  for (const level of stage.levels) level.upload(stage.gl);
  state.roles = lengths.reduce((mask, length, i) => (length > 0 && i !== TRAVEL ? mask | 1 << i : mask), 0);
  state.at = count - 1;
  const slider = $("layer");
  Object.assign(slider, { max: Math.max(0, moves.layers.length - 1), value: moves.layers.length - 1 });
  $("layerbar").hidden = moves.layers.length < 2;
  $("timebar").hidden = false;
  $("layertop").textContent = `${moves.layers.length} layers`;
  paces(time[count - 1]);
}

async function readMesh(packed) {
  const [places, faces] = await Promise.all([vectors(packed.vertices), unpacked(packed.faces, Int32Array)]);
  const place = new Float32Array(3 * faces.length), normal = new Float32Array(3 * faces.length);
  bounds = [[1e9, 1e9, 1e9], [-1e9, -1e9, -1e9]];
  for (let i = 0; i < faces.length; i++) for (let k = 0; k < 3; k++) {
    place[3 * i + k] = places[3 * faces[i] + k];
    bounds[0][k] = Math.min(bounds[0][k], place[3 * i + k]);
    bounds[1][k] = Math.max(bounds[1][k], place[3 * i + k]);
  }
  for (let i = 0; i < faces.length; i += 3) {
    const at = (j) => [...place.subarray(3 * (i + j), 3 * (i + j) + 3)], n = unit(cross(sub(at(1), at(0)), sub(at(2), at(0))));
    for (let j = 0; j < 3; j++) normal.set(n, 3 * (i + j));
  }
  mesh = stage.addMesh(place, normal, new Uint16Array(faces.length), { cut: true });
  fields = packed.fields.map((row) => new Field(row));
  heights(200);
}

async function readCells(packed) {
  const centres = await vectors(packed.centres), count = centres.length / 3;
  bounds = [0, 1].map((end) => [0, 1, 2].map((k) => {
    let value = centres[k];
    for (let i = 0; i < count; i++) value = end ? Math.max(value, centres[3 * i + k]) : Math.min(value, centres[3 * i + k]);
    return value + (end - 0.5) * packed.size[k];
  }));
  cells = { count, middles: centres, table: stage.gl.createTexture(), side: packed.size.map((side) => 0.92 * side) };
  stage.cells = cells;
  fields = packed.fields.map((row) => new Field(row));
  heights(Math.max(1, Math.round((bounds[1][2] - bounds[0][2]) / packed.size[2])));
}

// The slider cuts at a height where there are no layers.
function heights(steps) {
  Object.assign($("layer"), { max: steps, value: steps });
  $("layerbar").hidden = false;
  $("only").parentElement.hidden = true;
  $("layertop").textContent = "cut at";
}

function paces(duration) {
  const list = [["real time", 1], ["× 10", 10], ["× 100", 100], ["× 1000", 1000], ["in 30 s", Math.max(1e-3, duration / 30)]];
  if (!moves.clock) list.splice(0, 4);
  $("pace").replaceChildren(...list.map(([word, value]) => element("option", word, { value, selected: word === "in 30 s" })));
  state.pace = list[list.length - 1][1];
}

const radius = ([low, high]) => Math.max(1, size(sub(high, low)) / 2);
const machineBox = () => (robot ? [robot.frame[0].slice(), robot.frame[1].slice()] : bounds);

// ---- what is shown

async function colourBy(key) {
  const field = fields.find((one) => one.key === key);
  if (field) await field.load();
  state.field = field || FEATURE;
  if (robot) robot.chosen = field ? field.cable : 0;
  choices();
  paint();
}

function choices() {
  const list = moves ? [FEATURE, ...fields] : mesh ? [...fields, { ...FEATURE, label: "one colour" }] : fields;
  $("colouring").hidden = !list.length;
  $("colour").replaceChildren(...list.map((one) => element("option", one.unit ? `${one.label}, ${one.unit}` : one.label, { value: one.key, selected: one.key === state.field.key })));
}

// Range of the legend: of what is shown; and the rows that have the extremes.
function paint() {
  const { field } = state, values = field.values;
  let low = Infinity, high = -Infinity, ends = [-1, -1];
  for (let i = moves ? 1 : 0; values && i < values.length; i++) {
    if (moves && (!(state.roles >>> moves.role[i] & 1) || still(i))) continue;
    if (values[i] < low) { low = values[i]; ends[0] = i; }
    if (values[i] > high) { high = values[i]; ends[1] = i; }
  }
  if (!(high >= low)) [low, high] = [0, 1];
  Object.assign(state, values ? { low, high } : { low: -0.5, high: 255.5 });
  state.stamp++;
  stage.setColours(values ? SCALE : roleColours(data.roles), Boolean(values));
  if (mesh) paintMesh(values, low, high);
  if (cells && values) paintCells(values, low, high);
  showLegend(field, low, high, ends, flyToRow);
  if (moves) showRoles(data.roles, moves.lengths, state.roles, (i, on) => { state.roles = on ? state.roles | 1 << i : state.roles & ~(1 << i); paint(); });
  redraw();
}

const still = (i) => moves.xyz[3 * i] === moves.xyz[3 * i - 3] && moves.xyz[3 * i + 1] === moves.xyz[3 * i - 2] && moves.xyz[3 * i + 2] === moves.xyz[3 * i - 1];

function paintMesh(values, low, high) {
  mesh.colour = values ? null : PART;
  if (!values) return;
  const out = new Uint16Array(mesh.count);
  for (let i = 0; i < mesh.count; i++) out[i] = 65535 * (values[Math.floor(i / 3)] - low) / (high - low || 1);
  stage.gl.bindBuffer(stage.gl.ARRAY_BUFFER, mesh.value);
  stage.gl.bufferData(stage.gl.ARRAY_BUFFER, out, stage.gl.STATIC_DRAW);
}

function paintCells(values, low, high) {
  const tall = Math.ceil(cells.count / WIDE), out = new Float32Array(4 * WIDE * tall), { gl } = stage;
  for (let i = 0; i < cells.count; i++) {
    out.set(cells.middles.subarray(3 * i, 3 * i + 3), 4 * i);
    out[4 * i + 3] = (values[i] - low) / (high - low || 1);
  }
  table(gl, gl.RGBA32F, tall, gl.RGBA, gl.FLOAT, out, cells.table);
}

// ---- where in the print

const layerIndex = (row) => {
  const wanted = moves.layer[row];
  let [low, high] = [0, moves.layers.length - 1];
  while (low < high) { const middle = (low + high + 1) >> 1; if (moves.layers[middle][0] <= wanted) low = middle; else high = middle - 1; }
  return low;
};

function setMove(row, part = 1) {
  Object.assign(state, { at: Math.max(1, Math.min(moves.count - 1, Math.round(row))), part, pose: null });
  sync();
}

function setLayer(index) {
  const k = Math.max(0, Math.min(+$("layer").max, Math.round(index)));
  $("layer").value = k;
  if (moves) setMove(moves.ends.get(moves.layers[k][0]));
  else {
    state.cut = bounds[0][2] + (bounds[1][2] - bounds[0][2]) * k / +$("layer").max + 1e-3;
    $("layername").textContent = `z ${state.cut.toFixed(1)} mm`;
    redraw();
  }
}

// The move under way at a time, by bisection.
function setTime(seconds) {
  let [low, high] = [1, moves.count - 1];
  while (low < high) { const middle = (low + high) >> 1; if (moves.time[middle] < seconds) low = middle + 1; else high = middle; }
  const begin = moves.time[low - 1], spent = moves.time[low] - begin;
  setMove(low, spent > 0 ? Math.max(0, Math.min(1, (seconds - begin) / spent)) : 1);
}

const now = () => { const begin = moves.time[state.at - 1]; return begin + state.part * (moves.time[state.at] - begin); };

function sync() {
  const index = layerIndex(state.at), layer = moves.layers[index], total = moves.time[moves.count - 1];
  state.first = state.only && layer ? moves.begins.get(layer[0]) : 1;
  $("layer").value = index;
  $("layername").textContent = layer ? `layer ${layer[0] + 1}\n${layer[1].toFixed(2)} mm` : "";
  $("time").value = total > 0 ? now() / total : 0;
  $("clock").textContent = moves.clock ? `${clock(now())} of ${clock(total)} ${moves.clock}` : `${(now() / 1e3).toFixed(1)} of ${(total / 1e3).toFixed(1)} m`;
  redraw();
}

const place = (i) => [moves.xyz[3 * i], moves.xyz[3 * i + 1], moves.xyz[3 * i + 2]];
function nozzle() {
  if (state.pose) return state.pose;
  if (!moves) return robot ? robot.home : [0, 0, 0];
  const [a, b] = [place(state.at - 1), place(state.at)];
  return add(a, sub(b, a), state.part);
}

// ---- flying

function fit(animated = true) {
  const all = animated && state.whole === false && robot && (moves || mesh || cells);
  state.whole = Boolean(all);
  const to = around(all ? machineBox() : bounds);
  if (!animated) Object.assign(camera, to); else camera.fly(to, performance.now());
  redraw();
}

// Target and distance from which a box is seen whole.
const around = (box) => ({ target: add(box[0], sub(box[1], box[0]), 0.5), distance: 1.05 * radius(box) / Math.sin(FIELD / 2) });

function look(turn, lift) { camera.fly({ turn, lift }, performance.now()); redraw(); }

function flyToRow(row) {
  if (moves) setMove(row);
  const target = moves ? add(place(row - 1), sub(place(row), place(row - 1)), 0.5) : cells ? [...cells.middles.subarray(3 * row, 3 * row + 3)] : null;
  if (target) camera.fly({ target, distance: Math.min(camera.distance, Math.max(30, 0.25 * camera.distance)) }, performance.now());
  if (moves) hover(row);
  redraw();
}

function flyToFinding(i) {
  const finding = data.findings[i];
  state.finding = i;
  if (moves) { const k = moves.layers.findIndex(([layer]) => layer === finding.layer); if (k >= 0) setLayer(k); }
  state.pose = finding.xyz;
  if (robot) robot.chosen = finding.cable;
  camera.fly({ target: finding.xyz, distance: 250 }, performance.now());
  marks();
  redraw();
}

function marks() {
  showFindings(data.findings, state.finding, flyToFinding);
  $("marks").replaceChildren(...data.findings.map((finding, i) => {
    const mark = element("button", `${i + 1}`, { title: finding.sentence, className: i === state.finding ? "chosen" : "" });
    mark.onclick = () => flyToFinding(i);
    return mark;
  }));
}

// ---- pointer

function project(at, matrix = frame().matrix) {
  const box = $("canvas").getBoundingClientRect(), c = [0, 1, 3].map((k) => matrix[k] * at[0] + matrix[4 + k] * at[1] + matrix[8 + k] * at[2] + matrix[12 + k]);
  return [(c[0] / c[2] + 1) / 2 * box.width, (1 - c[1] / c[2]) / 2 * box.height, c[2]];
}

// The move nearest to the eye among those drawn within a few pixels of a place; -1: none.
function pick(px, py) {
  if (!moves) return -1;
  const box = $("canvas").getBoundingClientRect(), m = frame().matrix, { xyz, role, width } = moves, perMm = box.height / (2 * Math.tan(FIELD / 2));
  const [hw, hh] = [box.width / 2, box.height / 2], last = Math.min(moves.count - 1, state.at);
  let best = -1, depth = Infinity, x0 = 0, y0 = 0, w0 = -1, near = false;
  for (let i = Math.max(0, state.first - 1); i <= last; i++) {
    const x = xyz[3 * i], y = xyz[3 * i + 1], z = xyz[3 * i + 2], w = m[3] * x + m[7] * y + m[11] * z + m[15];
    const px1 = ((m[0] * x + m[4] * y + m[8] * z + m[12]) / w + 1) * hw, py1 = (1 - (m[1] * x + m[5] * y + m[9] * z + m[13]) / w) * hh;
    if (near && w > 0 && w0 > 0 && state.roles >>> role[i] & 1) {
      const dx = px1 - x0, dy = py1 - y0, l2 = dx * dx + dy * dy;
      const t = l2 > 0 ? Math.max(0, Math.min(1, ((px - x0) * dx + (py - y0) * dy) / l2)) : 0;
      const off = Math.hypot(px - x0 - t * dx, py - y0 - t * dy), deep = w0 + t * (w - w0);
      if (off <= Math.max(2.5, 0.5 * width[i] * perMm / deep) && deep < depth && l2 > 0) { depth = deep; best = i; }
    }
    [x0, y0, w0, near] = [px1, py1, w, true];
  }
  return best;
}

function hover(row, px, py) {
  state.hovered = row;
  const tip = $("tip");
  if (row < 1) { tip.hidden = true; $("under").hidden = !moves; if (moves) $("values").replaceChildren(element("span", "point at a move"), element("span", "")); return; }
  const role = data.roles[moves.role[row]].name, { field } = state, from = place(row - 1), to = place(row);
  const text = (one) => `${one.text(one.values[row])} ${one.unit}`;
  $("under").hidden = false;
  rows($("values"), [["move", `${row}, ${role}`], ["layer", `${moves.layer[row] + 1}`], ["to", to.map((v) => v.toFixed(2)).join("  ")], ["length", `${size(sub(to, from)).toFixed(3)} mm`],
    ...(moves.clock ? [["time", `${moves.time[row].toFixed(2)} s`]] : []), ...fields.filter((one) => one.values && !one.cable).map((one) => [one.label, text(one)]),
    ...perCable(row)]);
  if (px === undefined) { tip.hidden = true; return; }
  tip.replaceChildren(element("b", field.values ? text(field) : role), element("span", field.values ? `  ${role}` : `  layer ${moves.layer[row] + 1}`));
  tip.hidden = false;
  const box = $("stage").getBoundingClientRect();
  tip.style.left = `${Math.min(px + 14, box.width - tip.offsetWidth - 6)}px`;
  tip.style.top = `${Math.max(6, py - tip.offsetHeight - 10)}px`;
}

function perCable(row) {
  const groups = new Map();
  for (const one of fields) if (one.cable && one.values) {
    const word = `${one.key.startsWith("motor") ? "motors" : "tensions"}, ${one.unit}`;
    groups.set(word, [...(groups.get(word) || []), +one.values[row].toPrecision(3)]);
  }
  return [...groups].map(([word, values]) => [word, values.join("  ")]);
}

function pointer() {
  const canvas = $("canvas"), held = new Map();
  let spread = 0;
  canvas.onpointerdown = (event) => { held.set(event.pointerId, [event.offsetX, event.offsetY]); canvas.setPointerCapture(event.pointerId); canvas.classList.add("held"); canvas.focus(); hover(-1); };
  canvas.onpointerup = canvas.onpointercancel = (event) => { held.delete(event.pointerId); spread = 0; if (!held.size) canvas.classList.remove("held"); };
  canvas.onpointerleave = () => { if (state.hovered > 0) hover(-1); };
  canvas.oncontextmenu = (event) => event.preventDefault();
  canvas.onpointermove = (event) => {
    const last = held.get(event.pointerId), [x, y] = [event.offsetX, event.offsetY];
    if (!last) { pointed = [x, y]; request(); return; }
    held.set(event.pointerId, [x, y]);
    const { height } = canvas.getBoundingClientRect();
    if (held.size === 2) {
      const [a, b] = [...held.values()], wide = Math.hypot(a[0] - b[0], a[1] - b[1]);
      if (spread) camera.zoom(spread / wide, (a[0] + b[0]) / 2 - canvas.clientWidth / 2, (a[1] + b[1]) / 2 - height / 2, height);
      spread = wide;
    } else if (event.buttons & 6 || event.shiftKey) camera.pan(x - last[0], y - last[1], height);
    else camera.rotate(x - last[0], y - last[1]);
    redraw();
  };
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    const { width, height } = canvas.getBoundingClientRect(), lines = event.deltaMode ? 30 : 1;
    camera.zoom(Math.exp(0.0012 * event.deltaY * lines), event.offsetX - width / 2, event.offsetY - height / 2, height);
    redraw();
  }, { passive: false });
  canvas.ondblclick = (event) => { const row = pick(event.offsetX, event.offsetY); if (row > 0) camera.fly({ target: place(row) }, performance.now()); redraw(); };
}
let pointed = null;

// ---- keys and controls

function play(on = !state.playing) {
  if (!moves) return;
  if (on && state.at >= moves.count - 1 && state.part >= 1) setMove(1, 0);
  Object.assign(state, { playing: on });
  before = performance.now();
  Object.assign($("play"), { textContent: on ? "❚❚" : "▶" });
  redraw();
}

function next() {
  const keys = [...$("colour").options].map((option) => option.value);
  colourBy(keys[(keys.indexOf(state.field.key) + 1) % keys.length]);
}

function toggleRobot() { if (robot) { robot.shown = !robot.shown; $("robot").setAttribute("aria-pressed", robot.shown); redraw(); } }
function only() { $("only").checked = state.only = !state.only; sync(); }

const steps = (event, many) => (event.shiftKey ? many : 1);
const ACTIONS = {
  " ": () => play(), ArrowUp: (e) => setLayer(+$("layer").value + steps(e, 10)), ArrowDown: (e) => setLayer(+$("layer").value - steps(e, 10)),
  ArrowRight: (e) => moves && setMove(state.at + steps(e, 100)), ArrowLeft: (e) => moves && setMove(state.at - steps(e, 100)),
  Home: () => moves && setMove(1), End: () => moves && setMove(moves.count - 1), c: next, f: () => fit(), t: () => look(0, Math.PI / 2), r: () => look(0, 0),
  m: toggleRobot, o: () => moves && only(), n: () => data.findings.length && flyToFinding((state.finding + 1) % data.findings.length), "?": showHelp,
  "+": () => { camera.zoom(0.8, 0, 0, 1); redraw(); }, "-": () => { camera.zoom(1.25, 0, 0, 1); redraw(); }, Escape: () => { $("help").hidden = true; },
};

function controls() {
  pointer();
  addEventListener("keydown", (event) => {
    const action = ACTIONS[event.key] || ACTIONS[event.key.toLowerCase()];
    if (!action || event.ctrlKey || event.metaKey || event.altKey || event.target.tagName === "SELECT") return;
    if (event.target.tagName === "BUTTON" && event.key === " ") return;
    event.preventDefault();
    action(event);
  });
  $("layer").oninput = () => setLayer(+$("layer").value);
  $("time").oninput = () => setTime(+$("time").value * moves.time[moves.count - 1]);
  $("only").onchange = () => { state.only = $("only").checked; sync(); };
  $("colour").onchange = () => colourBy($("colour").value);
  $("pace").onchange = () => { state.pace = +$("pace").value; };
  for (const [id, action] of [["play", () => play()], ["fit", () => fit()], ["top", () => look(0, Math.PI / 2)], ["front", () => look(0, 0)], ["robot", toggleRobot], ["helper", showHelp]]) $(id).onclick = action;
  addEventListener("resize", redraw);
}

// ---- frames

function frame() {
  const box = $("canvas").getBoundingClientRect(), pixel = 2 * Math.tan(FIELD / 2) / Math.max(1, box.height), { low, high, field, stamp } = state;
  const under = moves && (state.part < 1 || state.pose) ? 1 : 0, values = field && field.values ? field.values : moves && moves.role;
  return {
    matrix: camera.matrix(box.width / Math.max(1, box.height)), eye: camera.eye, pixel, ground: GROUND, cut: state.cut, roles: state.roles >>> 0,
    thin: 1.2 * pixel * camera.distance, above: camera.lift > 0, tolerance: 0.4 * pixel * camera.distance, first: state.first, last: moves ? state.at + 1 - (state.part < 1 ? under : 0) : 0,
    paint: { values, low, high, stamp, worst: (field && field.worst) || "high" }, beadPixels: 0.45 / (pixel * camera.distance) * Math.min(devicePixelRatio || 1, 2),
  };
}

// The robot where the nozzle is; the move under way as a rod, up to there; the move under the pointer, outlined.
function dress() {
  const at = nozzle(), rods = robot ? robot.pose(at) : [];
  if (moves && state.part < 1 && !state.pose && state.roles >>> moves.role[state.at] & 1) rods.push(...rod(place(state.at - 1), at, moves.width[state.at] / 2 || 0.05, CHOSEN));
  if (state.hovered > 0) rods.push(...rod(place(state.hovered - 1), place(state.hovered), 0.62 * moves.width[state.hovered] || 0.1, [0, 0, 0]));
  stage.rods = new Float32Array(rods);
}

function placeMarks(matrix) {
  [...$("marks").children].forEach((mark, i) => {
    const [x, y, w] = project(data.findings[i].xyz, matrix);
    Object.assign(mark.style, { left: `${x}px`, top: `${y}px`, display: w > 0 ? "" : "none" });
  });
}

function redraw() { state.dirty = true; state.settled = false; request(); }
function request() { if (!asked) { asked = true; requestAnimationFrame(tick); } }

function tick(time) {
  asked = false;
  if (!state.ready) return;
  const flying = camera.step(time);
  if (state.playing) {
    const total = moves.time[moves.count - 1], at = now() + state.pace * (time - before) / 1e3;
    setTime(Math.min(at, total));
    if (at >= total) play(false);
  }
  before = time;
  if (!stage.idle(performance.now())) { if (flying || state.playing) state.dirty = true; request(); return; }
  if (state.dirty || flying || state.playing) draw();
  else if (stage.refining) state.settled = !stage.step(performance.now());
  else if (!state.settled && performance.now() >= restAt) { stage.resize(); stage.refine(frame()); }
  if (pointed && state.settled) { const row = pick(...pointed); if (row !== state.hovered) { hover(row, ...pointed); redraw(); } else if (row > 0) hover(row, ...pointed); pointed = null; }
  if (!state.settled || flying || state.playing || pointed) request();
}

function draw() {
  state.dirty = false;
  stage.resize();
  dress();
  const view = frame(), whole = stage.quick(view, performance.now());
  showCompass(camera.axes);
  placeMarks(view.matrix);
  state.settled = whole;
  restAt = performance.now() + 140;
}

// What scripts (and tests) may ask of the page.
window.cabslice = {
  state, camera, get moves() { return moves; }, get fields() { return fields; }, get stage() { return stage; }, setLayer, setMove, setTime, colourBy, project, pick,
  flyToFinding, look, redraw,
  // The colour that the legend has for a value, bytes.
  legend(value) { const k = Math.max(0, Math.min(255, Math.round(255 * (value - state.low) / (state.high - state.low || 1)))); return [...SCALE.subarray(3 * k, 3 * k + 3)]; },
  // The colour of the picture at a place of the canvas, bytes.
  pixel(x, y) {
    const { gl, canvas } = stage, k = canvas.width / canvas.getBoundingClientRect().width, out = new Uint8Array(4);
    gl.bindFramebuffer(gl.READ_FRAMEBUFFER, null);
    gl.readPixels(Math.floor(x * k), canvas.height - 1 - Math.floor(y * k), 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, out);
    return [...out.subarray(0, 3)];
  },
};

controls();
start().then(() => { if (moves) { sync(); hover(-1); } else if (!$("layerbar").hidden) setLayer(+$("layer").max); redraw(); }, (error) => {
  state.failed = String(error && error.message || error);
  Object.assign($("wait") || $("stage").appendChild(element("div", "", { id: "wait" })), { textContent: state.failed, className: "failed" });
  console.error(error);
});
