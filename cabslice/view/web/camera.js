// Where the eye is: it looks at `target` from `distance` mm, turned about the vertical and lifted above the ground.

const FIELD = 32 * Math.PI / 180;         // of view, top to bottom
const add = (a, b, k = 1) => [a[0] + k * b[0], a[1] + k * b[1], a[2] + k * b[2]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const size = (a) => Math.hypot(a[0], a[1], a[2]);
const unit = (a) => { const l = size(a) || 1; return [a[0] / l, a[1] / l, a[2] / l]; };
const sub = (a, b) => add(a, b, -1);

class Camera {
  constructor() { Object.assign(this, { target: [0, 0, 0], distance: 500, turn: -0.6, lift: 0.5, reach: 1000, flight: null }); }

  // Unit vectors: to the right, up, and from the target to the eye.
  get axes() {
    const [c, s, cl, sl] = [Math.cos(this.turn), Math.sin(this.turn), Math.cos(this.lift), Math.sin(this.lift)];
    return { right: [c, s, 0], near: [s * cl, -c * cl, sl], up: [-s * sl, c * sl, cl] };
  }

  get eye() { return add(this.target, this.axes.near, this.distance); }

  // Rows of the matrix that takes a place to clip space, as WebGL wants it: by columns.
  matrix(aspect) {
    const { right, up, near } = this.axes, eye = this.eye, f = 1 / Math.tan(FIELD / 2);
    const far = this.distance + 2 * this.reach, close = Math.max(this.distance - 2 * this.reach, this.distance / 100, 0.05);
    const a = (far + close) / (close - far), b = 2 * far * close / (close - far);
    const row = (v, k) => [k * v[0], k * v[1], k * v[2], -k * dot(v, eye)];
    const x = row(right, f / aspect), y = row(up, f), z = row(near, a), w = row(near, -1);
    z[3] += b;
    const out = new Float32Array(16);
    [x, y, z, w].forEach((r, i) => r.forEach((value, j) => { out[4 * j + i] = value; }));
    return out;
  }

  rotate(dx, dy) {
    this.flight = null;
    this.turn -= dx * 0.006;
    this.lift = Math.min(Math.PI / 2, Math.max(-1.2, this.lift + dy * 0.006));
  }

  // mm that a pixel spans at the target.
  pixel(height) { return 2 * this.distance * Math.tan(FIELD / 2) / height; }

  pan(dx, dy, height) {
    const k = this.pixel(height), { right, up } = this.axes;
    this.flight = null;
    this.target = add(add(this.target, right, -dx * k), up, dy * k);
  }

  // Towards the place under the pointer, px and py counted from the middle of the canvas.
  zoom(factor, px, py, height) {
    const before = this.pixel(height);
    this.flight = null;
    this.distance = Math.min(20 * this.reach, Math.max(1, this.distance * factor));
    const k = before - this.pixel(height), { right, up } = this.axes;
    this.target = add(add(this.target, right, px * k), up, -py * k);
  }

  // Shortly after, the eye is there; at once where motion is not wanted.
  fly(to, now) {
    const from = { target: this.target, distance: this.distance, turn: this.turn, lift: this.lift };
    const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
    this.flight = { from, to: { ...from, ...to }, begun: now, lasts: still ? 1 : 450 };
  }

  // One step of a flight; whether there was one.
  step(now) {
    if (!this.flight) return false;
    const { from, to, begun, lasts } = this.flight, t = Math.min(1, (now - begun) / lasts), k = t * t * (3 - 2 * t);
    for (const key of ["turn", "lift"]) this[key] = from[key] + k * (to[key] - from[key]);
    this.distance = from.distance * (to.distance / from.distance) ** k;
    this.target = add(from.target, sub(to.target, from.target), k);
    if (t >= 1) this.flight = null;
    return true;
  }
}
