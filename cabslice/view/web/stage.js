// The picture: drawn into a frame of its own and shown when it is whole. While things move, a level of detail that the
// card can draw in time; as soon as they rest, everything, a stretch per frame so that the page never stands still.

const STRETCH = 65536;                    // moves drawn per frame while refining
const NEAR_PIXELS = 2.2;                  // width from which a bead is drawn round
const RIBBON = [0, 1, 2, 2, 1, 3];
const ROUND = [0, 1, 2, 3].flatMap((i) => { const j = (i + 1) % 4; return [i, j, 4 + i, 4 + i, j, 4 + j, 8, j, i, 9, 4 + i, 4 + j]; });
const RODS = [0, 1, 2, 3, 4, 5].flatMap((i) => { const j = (i + 1) % 6; return [i, j, 6 + i, 6 + i, j, 6 + j]; });
const SOLIDS = { ribbon: [RIBBON, 4, 16384], round: [ROUND, 10, 4096], rods: [RODS, 12, 1024] };    // list, vertices, how many at once

// The same list of vertices for the first, second, ... of `many` things.
function repeated([list, vertices, many]) {
  const out = new Uint32Array(list.length * many);
  for (let k = 0; k < many; k++) for (let i = 0; i < list.length; i++) out[k * list.length + i] = k * vertices + list[i];
  return out;
}

class Stage {
  constructor(canvas) {
    this.canvas = canvas;
    const gl = canvas.getContext("webgl2", { antialias: false, preserveDrawingBuffer: true });
    if (!gl) throw new Error("This browser offers no WebGL 2, which the view is drawn with.");
    this.gl = gl;
    const info = gl.getExtension("WEBGL_debug_renderer_info");
    this.software = /swiftshader|llvmpipe|software|basic render/i.test(info ? gl.getParameter(info.UNMASKED_RENDERER_WEBGL) : "");
    this.bead = program(gl, BEAD_VERTEX, SHADED);
    this.rod = program(gl, ROD_VERTEX, SHADED);
    this.mesh = program(gl, MESH_VERTEX, CUT);
    this.cell = program(gl, CELL_VERTEX, CUT);
    this.indices = Object.fromEntries(Object.entries(SOLIDS).map(([name, solid]) => [name, this.buffer(repeated(solid), gl.ELEMENT_ARRAY_BUFFER)]));
    this.rodTable = gl.createTexture();
    this.colours = gl.createTexture();
    Object.assign(this, { budget: 120000, levels: [], meshes: [], cells: null, rods: new Float32Array(0), frame: null, refining: null, fence: null });
    gl.enable(gl.DEPTH_TEST);
  }

  buffer(data, target = this.gl.ARRAY_BUFFER) {
    const made = this.gl.createBuffer();
    this.gl.bindBuffer(target, made);
    this.gl.bufferData(target, data, this.gl.STATIC_DRAW);
    return made;
  }

  // 256 colours, bytes red green blue.
  setColours(bytes, blend) {
    const { gl } = this, kind = blend ? gl.LINEAR : gl.NEAREST;
    gl.bindTexture(gl.TEXTURE_2D, this.colours);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB8, 256, 1, 0, gl.RGB, gl.UNSIGNED_BYTE, bytes);
    for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, name, kind);
    for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, name, gl.CLAMP_TO_EDGE);
  }

  addMesh(place, normal, value, options = {}) {
    const mesh = { place: this.buffer(place), normal: this.buffer(normal), value: value && this.buffer(value), count: place.length / 3,
      shift: [0, 0, 0], colour: null, shown: true, cut: false, ...options };
    this.meshes.push(mesh);
    return mesh;
  }

  resize() {
    const ratio = Math.min(devicePixelRatio || 1, 2), box = this.canvas.getBoundingClientRect();
    const [width, height] = [Math.max(1, Math.round(box.width * ratio)), Math.max(1, Math.round(box.height * ratio))];
    if (this.frame && this.canvas.width === width && this.canvas.height === height) return;
    Object.assign(this.canvas, { width, height });
    const { gl } = this, samples = this.software ? 1 : Math.min(4, gl.getParameter(gl.MAX_SAMPLES));
    if (this.frame) { gl.deleteFramebuffer(this.frame.target); this.frame.parts.forEach((part) => gl.deleteRenderbuffer(part)); }
    const target = gl.createFramebuffer(), parts = [gl.createRenderbuffer(), gl.createRenderbuffer()];
    gl.bindFramebuffer(gl.FRAMEBUFFER, target);
    [[gl.RGBA8, gl.COLOR_ATTACHMENT0], [gl.DEPTH_COMPONENT24, gl.DEPTH_ATTACHMENT]].forEach(([format, place], i) => {
      gl.bindRenderbuffer(gl.RENDERBUFFER, parts[i]);
      gl.renderbufferStorageMultisample(gl.RENDERBUFFER, samples, format, width, height);
      gl.framebufferRenderbuffer(gl.FRAMEBUFFER, place, gl.RENDERBUFFER, parts[i]);
    });
    this.frame = { target, parts };
  }

  // Begin a frame: what is not moves is drawn at once.
  begin(view) {
    const { gl } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.frame.target);
    gl.viewport(0, 0, this.canvas.width, this.canvas.height);
    gl.clearColor(...view.ground, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    this.drawMeshes(view);
    this.drawCells(view);
    this.drawRods(view);
  }

  use({ made, at }, view) {
    const { gl } = this;
    gl.useProgram(made);
    gl.uniformMatrix4fv(at.u_view, false, view.matrix);
    if (at.u_eye) gl.uniform3fv(at.u_eye, view.eye);
    if (at.u_pixel) gl.uniform1f(at.u_pixel, view.pixel);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.colours);
    if (at.u_colours) gl.uniform1i(at.u_colours, 0);
    for (let i = 0; i < 3; i++) gl.disableVertexAttribArray(i);
    return at;
  }

  attribute(index, buffer, width, type = this.gl.FLOAT) {
    const { gl } = this;
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.enableVertexAttribArray(index);
    gl.vertexAttribPointer(index, width, type, type !== gl.FLOAT, 0, 0);
  }

  texture(place, unit, made) {
    const { gl } = this;
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(gl.TEXTURE_2D, made);
    gl.uniform1i(place, unit);
    gl.activeTexture(gl.TEXTURE0);
  }

  // Things first..last - 1 of a table, as many at once as there are indices for; backwards: the last one first.
  drawTable(name, at, first, last, backwards = false) {
    const { gl } = this, [list, , many] = SOLIDS[name];
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.indices[name]);
    if (at.u_step) gl.uniform1i(at.u_step, backwards ? -1 : 1);
    for (let done = 0; done < last - first; done += many) {
      gl.uniform1i(at.u_base, backwards ? last - 1 - done : first + done);
      gl.drawElements(gl.TRIANGLES, list.length * Math.min(many, last - first - done), gl.UNSIGNED_INT, 0);
    }
  }

  drawMeshes(view) {
    const { gl } = this, at = this.use(this.mesh, view);
    for (const mesh of this.meshes.filter((one) => one.shown)) {
      gl.uniform3fv(at.u_shift, mesh.shift);
      gl.uniform4fv(at.u_colour, mesh.colour ? [...mesh.colour, 1] : [0, 0, 0, 0]);
      gl.uniform1f(at.u_cut, mesh.cut ? view.cut : 1e9);
      this.attribute(0, mesh.place, 3);
      this.attribute(1, mesh.normal, 3);
      if (mesh.value) this.attribute(2, mesh.value, 1, gl.UNSIGNED_SHORT);
      else gl.disableVertexAttribArray(2);
      gl.drawArrays(gl.TRIANGLES, 0, mesh.count);
    }
  }

  drawCells(view) {
    if (!this.cells) return;
    const { gl } = this, at = this.use(this.cell, view), { table: cells, side, count } = this.cells;
    gl.uniform3fv(at.u_side, side);
    gl.uniform1f(at.u_cut, view.cut);
    this.texture(at.u_places, 1, cells);
    for (let base = 0; base < count; base += 50000) {
      gl.uniform1i(at.u_base, base);
      gl.drawArrays(gl.TRIANGLES, 0, 36 * Math.min(50000, count - base));
    }
  }

  // Rows of `rods`: from, radius, to, nothing, colour, nothing; twelve numbers.
  drawRods(view) {
    const { gl, rods } = this, at = this.use(this.rod, view), tall = Math.ceil(rods.length / 4 / WIDE);
    if (!rods.length) return;
    const data = new Float32Array(4 * WIDE * tall);
    data.set(rods);
    table(gl, gl.RGBA32F, tall, gl.RGBA, gl.FLOAT, data, this.rodTable);
    this.texture(at.u_places, 1, this.rodTable);
    this.drawTable("rods", at, 0, rods.length / 12);
  }

  // Rows first..last - 1 of a level, round or as ribbons that face the eye.
  drawMoves(view, level, first, last, ribbon) {
    first = Math.max(first, 1);
    if (last <= first) return;
    const { gl } = this, { paint } = view;
    if (level.painted !== paint.stamp) {
      level.paint(gl, paint.values, paint.low, paint.high, paint.worst);
      level.painted = paint.stamp;
    }
    const at = this.use(this.bead, view);
    gl.uniform1ui(at.u_roles, view.roles);
    gl.uniform1i(at.u_ribbon, ribbon ? 1 : 0);
    gl.uniform1f(at.u_thin, view.thin);
    this.texture(at.u_places, 1, level.places);
    this.texture(at.u_paint, 2, level.paints);
    this.drawTable(ribbon ? "ribbon" : "round", at, first, last, view.above);
  }

  show() {
    const { gl } = this, { width, height } = this.canvas;
    gl.bindFramebuffer(gl.READ_FRAMEBUFFER, this.frame.target);
    gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, null);
    gl.blitFramebuffer(0, 0, width, height, 0, 0, width, height, gl.COLOR_BUFFER_BIT, gl.NEAREST);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.frame.target);
  }

  // Whether the card is done with what it was given last; learns how much it can do in the time of a frame.
  idle(now) {
    if (!this.fence) return true;
    const { gl } = this, state = gl.clientWaitSync(this.fence.sync, 0, 0);
    if (state === gl.TIMEOUT_EXPIRED) return false;
    gl.deleteSync(this.fence.sync);
    const spent = now - this.fence.begun;
    if (this.fence.quick) this.budget = Math.max(15000, Math.min(2e6, this.budget * (spent > 50 ? 0.7 : spent < 22 ? 1.3 : 1)));
    this.fence = null;
    return true;
  }

  fenced(now, quick) {
    const { gl } = this;
    this.fence = { sync: gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0), begun: now, quick };
    gl.flush();
  }

  // While things move: one frame with as much detail as there is time for; whether that was everything.
  quick(view, now) {
    this.refining = null;
    this.begin(view);
    let whole = true;
    if (this.levels.length && view.last > view.first) {
      const fits = (level) => this.span(level, view);
      let chosen = this.levels[this.levels.length - 1];
      for (const level of this.levels) if (fits(level) <= this.budget) { chosen = level; break; }
      const round = view.beadPixels > NEAR_PIXELS && fits(chosen) * 4 <= this.budget;
      this.drawRange(view, chosen, !round);
      whole = chosen.tolerance <= view.tolerance && round === view.beadPixels > NEAR_PIXELS;
    }
    this.show();
    this.fenced(now, true);
    return whole;
  }

  span(level, view) { return level.after(view.last) - level.after(view.first); }

  // A level up to its last whole move, and what is left of the move that is under way.
  drawRange(view, level, ribbon) {
    this.drawMoves(view, level, level.after(view.first), level.after(view.last), ribbon);
    this.drawRest(view, level, ribbon);
  }

  // The moves after the last one that a coarser level has whole.
  drawRest(view, level, ribbon) {
    const until = level.after(view.last);
    if (level.rows && until > 0 && level.rows[until - 1] < view.last - 1) this.drawMoves(view, this.levels[0], level.rows[until - 1] + 1, view.last, ribbon);
  }

  // At rest: all that can be told apart. `step` draws the next stretch, what is nearer to the eye first; whether more
  // is to come.
  refine(view) {
    this.begin(view);
    const fine = this.levels.filter((level) => level.tolerance <= view.tolerance).pop();
    this.refining = { view, fine, first: fine ? fine.after(view.first) : 0, last: fine ? fine.after(view.last) : 0 };
    if (fine) this.drawRest(view, fine, view.beadPixels <= NEAR_PIXELS);
  }

  step(now) {
    const { view, fine, first, last } = this.refining, ribbon = view.beadPixels <= NEAR_PIXELS, much = last - first > STRETCH;
    this.gl.bindFramebuffer(this.gl.FRAMEBUFFER, this.frame.target);
    if (fine && view.above) this.drawMoves(view, fine, this.refining.last = much ? last - STRETCH : first, last, ribbon);
    else if (fine) this.drawMoves(view, fine, first, this.refining.first = much ? first + STRETCH : last, ribbon);
    if (this.refining.last <= this.refining.first) { this.refining = null; this.show(); }
    this.fenced(now, false);
    return this.refining !== null;
  }
}
