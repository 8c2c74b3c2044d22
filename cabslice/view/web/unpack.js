// Columns of numbers out of the text that view/packing.py makes: base64, deflate, byte planes, zigzag differences.

async function inflated(text) {
  const raw = atob(text), bytes = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

// The values as `Kind` (a typed array); `out` and `stride` put them into every stride-th place of an array from `first` on.
async function unpacked(column, Kind, out = null, stride = 1, first = 0) {
  const { n, bytes: count, low, step } = column, planes = await inflated(column.data);
  const values = out || new Kind(n);
  let whole = 0;
  for (let i = 0, at = first; i < n; i++, at += stride) {
    let coded = planes[i];
    for (let plane = 1, scale = 256; plane < count; plane++, scale *= 256) coded += planes[plane * n + i] * scale;
    whole += coded % 2 ? -(coded + 1) / 2 : coded / 2;
    values[at] = low + step * whole;
  }
  return values;
}

async function vectors(columns) {
  const out = new Float32Array(3 * columns[0].n);
  await Promise.all(columns.map((column, axis) => unpacked(column, null, out, 3, axis)));
  return out;
}

// Fields are unpacked when they are first asked for.
class Field {
  constructor(row) { Object.assign(this, row); this.packed = row.values; this.values = null; }

  async load() {
    this.loading ||= unpacked(this.packed, Float32Array).then((values) => { this.values = values; this.packed = null; });
    await this.loading;
    return this;
  }

  // Digits after the point that the steps of this field are worth.
  text(value) {
    const size = Math.max(Math.abs(value), 1e-9), digits = size >= 1000 ? 0 : size >= 100 ? 1 : size >= 10 ? 2 : 3;
    return value.toFixed(digits);
  }
}
