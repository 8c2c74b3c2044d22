// The robot: frame, winders, pulleys that swivel, cables, platform and nozzle, with the nozzle at a place.

const STEEL = [0.45, 0.50, 0.56], FRAME = [0.72, 0.76, 0.81], CABLE = [0.16, 0.20, 0.25], CHOSEN = [0.80, 0.10, 0.08], PLATE = [0.90, 0.92, 0.94];

// Exit point of the cable from its pulley towards `tip`: Gueners 2021, 3.1.2 (robot/pulley.py has the legend).
function exitPoint(anchor, axis, radius, tip) {
  const arm = sub(tip, anchor), z = dot(arm, axis), flat = add(arm, axis, -z), rho = size(flat);
  const d2 = (rho - radius) ** 2 + z * z;
  if (radius <= 0 || rho <= radius || d2 <= radius * radius) return { exit: anchor, centre: anchor, out: axis };
  const out = unit(flat), free = Math.sqrt(d2 - radius * radius), beta = Math.atan2(rho - radius, z) + Math.atan2(radius, free);
  const centre = add(anchor, out, radius);
  return { exit: add(add(centre, out, -radius * Math.cos(beta)), axis, radius * Math.sin(beta)), centre, out };
}

class Machine {
  constructor(data, stage) {
    Object.assign(this, data);
    this.shown = true;
    this.chosen = 0;
    this.still = this.fixed();
    this.plate = data.bed && stage.addMesh(...box([-data.bed[0] / 2, -data.bed[1] / 2, -4], [data.bed[0] / 2, data.bed[1] / 2, -0.05]), null, { colour: PLATE });
    this.body = stage.addMesh(...flat(data.hull.points, data.hull.faces), null, { colour: STEEL });
    this.tipMesh = data.tip ? stage.addMesh(...cone(3.2, 6), null, { colour: [0.72, 0.52, 0.16] }) : null;
  }

  fixed() {
    const rows = [], [low, high] = this.frame, corner = (i) => [0, 1, 2].map((k) => (i >> k & 1 ? high : low)[k]);
    const line = (a, b, r, colour) => rows.push(...rod(a, b, r, colour));
    for (let i = 0; i < 8; i++) for (const bit of [1, 2, 4]) if (!(i & bit)) line(corner(i), corner(i | bit), 3, FRAME);
    for (const { centre, radius, from, to } of this.winders) {
      const axis = unit(cross(sub(from, centre), sub(to, from)));
      line(from, to, 0.4, CABLE);
      rows.push(...ring(centre, radius, axis, 2.5, STEEL));
    }
    if (this.bed) {
      const [w, d] = this.bed, step = Math.max(w, d) > 1200 ? 100 : 50;
      for (let x = -Math.floor(w / 2 / step) * step; x <= w / 2; x += step) line([x, -d / 2, 0], [x, d / 2, 0], x ? 0.08 : 0.3, [0.78, 0.81, 0.84]);
      for (let y = -Math.floor(d / 2 / step) * step; y <= d / 2; y += step) line([-w / 2, y, 0], [w / 2, y, 0], y ? 0.08 : 0.3, [0.78, 0.81, 0.84]);
    }
    return rows;
  }

  // Rods of everything, with the nozzle at a place; platform and nozzle move along.
  pose(nozzle) {
    for (const mesh of [this.body, this.tipMesh, this.plate]) if (mesh) mesh.shown = this.shown || mesh === this.plate;
    if (!this.shown) return [];
    const rows = this.still.slice(), origin = sub(nozzle, this.nozzle);
    this.attachments.forEach((arm, i) => {
      const tip = add(origin, arm), radius = this.pulleys[i], { exit, centre, out } = exitPoint(this.anchors[i], this.axes[i], radius, tip);
      const chosen = this.chosen === i + 1;
      rows.push(...rod(exit, tip, Math.max(this.cables[i], 0.5) * (chosen ? 3 : 1), chosen ? CHOSEN : CABLE));
      rows.push(...rod(origin, tip, 3, STEEL));
      if (radius > 0) rows.push(...ring(centre, radius, unit(cross(out, this.axes[i])), 2, STEEL));
      else rows.push(...rod(add(exit, [0, 0, -3]), add(exit, [0, 0, 3]), 3, STEEL));
    });
    if (this.tip) rows.push(...rod(origin, add(nozzle, [0, 0, 6]), 2.2, STEEL));
    this.body.shift = origin;
    if (this.tipMesh) this.tipMesh.shift = nozzle;
    return rows;
  }
}

const rod = (from, to, radius, colour) => [...from, radius, ...to, 0, ...colour, 0];

function ring(centre, radius, axis, thick, colour, parts = 20) {
  const any = Math.abs(axis[2]) > 0.9 ? [1, 0, 0] : [0, 0, 1], u = unit(cross(axis, any)), v = cross(axis, u), rows = [];
  const at = (k) => { const a = 2 * Math.PI * k / parts; return add(add(centre, u, radius * Math.cos(a)), v, radius * Math.sin(a)); };
  for (let k = 0; k < parts; k++) rows.push(...rod(at(k), at(k + 1), thick, colour));
  return rows;
}

// Triangles with their own normals: [places, normals].
function flat(points, faces) {
  const place = [], normal = [];
  for (const face of faces) {
    const [a, b, c] = face.map((i) => points[i]), n = unit(cross(sub(b, a), sub(c, a)));
    place.push(...a, ...b, ...c);
    normal.push(...n, ...n, ...n);
  }
  return [new Float32Array(place), new Float32Array(normal)];
}

function box(low, high) {
  const points = [0, 1, 2, 3, 4, 5, 6, 7].map((i) => [0, 1, 2].map((k) => (i >> k & 1 ? high : low)[k]));
  const sides = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
  return flat(points, sides.flatMap(([a, b, c, d]) => [[a, b, c], [a, c, d]]));
}

// Point down, at the origin.
function cone(radius, height, parts = 18) {
  const points = [[0, 0, 0], [0, 0, height]], faces = [];
  for (let k = 0; k < parts; k++) {
    const a = 2 * Math.PI * k / parts;
    points.push([radius * Math.cos(a), radius * Math.sin(a), height]);
    faces.push([0, 2 + (k + 1) % parts, 2 + k], [1, 2 + k, 2 + (k + 1) % parts]);
  }
  return flat(points, faces);
}
