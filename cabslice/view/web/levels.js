// The moves in several levels of detail. A coarser level joins moves of one layer and feature that run straight within
// its tolerance; the value of what is joined is the worst of them, so that no extreme is lost.

const TOLERANCES = [0, 0.04, 0.16, 0.64, 2.5];      // mm
const TRAVEL = 0;

class Level {
  // `rows`: points of the moves that are kept, rising; null: all.
  constructor(moves, rows, tolerance) {
    Object.assign(this, { moves, rows, tolerance, count: rows ? rows.length : moves.count });
  }

  // First row of this level at or after row `move` of the moves.
  after(move) {
    if (!this.rows) return move;
    let [low, high] = [0, this.count];
    while (low < high) { const middle = (low + high) >> 1; if (this.rows[middle] < move) low = middle + 1; else high = middle; }
    return low;
  }

  // A texel a row: place, and width and height packed (shaders.js).
  upload(gl) {
    const { xyz, width, height } = this.moves, { rows, count } = this, tall = Math.max(1, Math.ceil(count / WIDE));
    const places = new Float32Array(4 * WIDE * tall);
    for (let i = 0; i < count; i++) {
      const k = rows ? rows[i] : i, step = (mm) => Math.min(4095, Math.round(200 * mm));
      places[4 * i] = xyz[3 * k]; places[4 * i + 1] = xyz[3 * k + 1]; places[4 * i + 2] = xyz[3 * k + 2];
      places[4 * i + 3] = step(width[k]) + 4096 * step(height[k]);
    }
    this.tall = tall;
    this.places = table(gl, gl.RGBA32F, tall, gl.RGBA, gl.FLOAT, places);
    this.paints = table(gl, gl.RGBA8UI, tall, gl.RGBA_INTEGER, gl.UNSIGNED_BYTE, null);
    this.painted = null;
  }

  // A texel a row: place on the scale of colours, 0..1 as 16 bits, and the role.
  paint(gl, field, low, high, worst) {
    const { rows, count } = this, { role } = this.moves, k = 65535 / (high - low || 1), middle = (low + high) / 2;
    const out = new Uint8Array(4 * WIDE * this.tall);
    for (let i = 0; i < count; i++) {
      const row = rows ? rows[i] : i;
      let value = field[row];
      if (rows && i) for (let j = rows[i - 1] + 1; j < row; j++) {
        const one = field[j];
        if (worst === "high" ? one > value : worst === "low" ? one < value : Math.abs(one - middle) > Math.abs(value - middle)) value = one;
      }
      const level = Math.max(0, Math.min(65535, Math.round((value - low) * k)));
      out[4 * i] = level & 255; out[4 * i + 1] = level >> 8; out[4 * i + 2] = role[row];
    }
    gl.bindTexture(gl.TEXTURE_2D, this.paints);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, WIDE, this.tall, gl.RGBA_INTEGER, gl.UNSIGNED_BYTE, out);
  }
}

// A texture of numbers that shaders read by number.
function table(gl, inside, tall, format, type, data, known = null) {
  const made = known || gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, made);
  gl.texImage2D(gl.TEXTURE_2D, 0, inside, WIDE, tall, 0, format, type, data);
  for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, name, gl.NEAREST);
  return made;
}

// Rows that are left when moves within `tolerance` of a straight line are joined. From the first point of a run the
// directions of all points passed must lie in one sector, and their distance must not fall: what turns back is kept.
function thinned(moves, rows, tolerance) {
  const { xyz, role, layer } = moves, total = rows ? rows.length : moves.count, kept = [0];
  let start = 0, low = 0, high = 0, base = 0, far = 0, open = true;
  const begin = (i) => { start = 3 * (rows ? rows[i] : i); far = 0; open = true; };
  begin(0);
  for (let i = 1; i < total; i++) {
    const at = rows ? rows[i] : i, before = rows ? rows[i - 1] : i - 1;
    const fresh = kept[kept.length - 1] === before;
    const same = fresh || (role[at] === role[before] && layer[at] === layer[before]);
    const dx = xyz[3 * at] - xyz[start], dy = xyz[3 * at + 1] - xyz[start + 1], dz = xyz[3 * at + 2] - xyz[start + 2];
    const reach = Math.hypot(dx, dy);
    let joins = fresh || (same && Math.abs(dz) <= tolerance && reach >= far - 0.5 * tolerance);
    if (joins && reach > tolerance) {
      let angle = Math.atan2(dy, dx) - base;
      const slack = Math.asin(Math.min(1, tolerance / reach));
      if (open) { base += angle; low = -slack; high = slack; open = false; }
      else {
        if (angle > Math.PI) angle -= 2 * Math.PI; else if (angle < -Math.PI) angle += 2 * Math.PI;
        if (!fresh && (angle < low || angle > high)) joins = false;
        else { low = Math.max(low, angle - slack); high = Math.min(high, angle + slack); }
      }
    }
    if (!joins) { kept.push(before); begin(i - 1); base = 0; i--; continue; }
    far = Math.max(far, reach);
  }
  if (kept[kept.length - 1] !== (rows ? rows[total - 1] : total - 1)) kept.push(rows ? rows[total - 1] : total - 1);
  return Int32Array.from(kept);
}

function levelsOf(moves) {
  const made = [new Level(moves, null, 0)];
  let rows = null;
  for (const tolerance of TOLERANCES.slice(1)) {
    const next = thinned(moves, rows, tolerance);
    if (next.length < 0.8 * (rows ? rows.length : moves.count)) { made.push(new Level(moves, next, tolerance)); rows = next; }
  }
  return made;
}
