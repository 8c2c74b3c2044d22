// What stands beside the picture: facts, legend, features, values under the pointer, findings, notes.

const $ = (id) => document.getElementById(id);
const VIRIDIS = ["440154", "482878", "3e4989", "31688e", "26828e", "1f9e89", "35b779", "6ece58", "b5de2b", "fde725"];
const FEATURE = { key: "feature", label: "feature", unit: "" };

function rgb(hex) { return [0, 2, 4].map((i) => parseInt(hex.replace("#", "").slice(i, i + 2), 16)); }

// Even lightness from dark to bright, told apart by the colour-blind.
function scaleColours() {
  const out = new Uint8Array(768), stops = VIRIDIS.map(rgb);
  for (let i = 0; i < 256; i++) {
    const at = i / 255 * (stops.length - 1), k = Math.min(stops.length - 2, Math.floor(at));
    for (let c = 0; c < 3; c++) out[3 * i + c] = Math.round(stops[k][c] + (at - k) * (stops[k + 1][c] - stops[k][c]));
  }
  return out;
}

function roleColours(roles) {
  const out = new Uint8Array(768);
  roles.forEach(({ colour }, i) => out.set(rgb(colour), 3 * i));
  return out;
}

// Round numbers within [low, high], at most `most` of them.
function ticks(low, high, most = 5) {
  const span = high - low;
  if (!(span > 0)) return [low];
  const ten = 10 ** Math.floor(Math.log10(span / most)), step = [1, 2, 5, 10].map((k) => k * ten).find((s) => span / s <= most);
  const out = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * span; k++) out.push(k * step);
  return out.length ? out : [low];
}

const short = (value) => (Math.abs(value) >= 1e5 ? value.toExponential(1) : `${+value.toPrecision(4)}`);

function clock(seconds) {
  const whole = Math.round(seconds), [h, m, s] = [Math.floor(whole / 3600), Math.floor(whole / 60) % 60, whole % 60];
  const two = (n) => String(n).padStart(2, "0");
  return h ? `${h}:${two(m)}:${two(s)}` : `${m}:${two(s)}`;
}

function element(tag, text = "", more = {}) { return Object.assign(document.createElement(tag), { textContent: text }, more); }

function rows(parent, pairs) { parent.replaceChildren(...pairs.flatMap(([word, value]) => [element("span", word), element("span", value)])); }

function showLegend(field, low, high, ends, fly) {
  const legend = $("legend");
  if (field === FEATURE) { legend.replaceChildren(); return; }
  const stops = Array.from({ length: 11 }, (_, i) => { const at = 3 * Math.round(i * 25.5), c = SCALE; return `rgb(${c[at]} ${c[at + 1]} ${c[at + 2]}) ${10 * i}%`; });
  const bar = element("div", "", { className: "bar" }), scale = element("div", "", { className: "ticks" });
  bar.style.background = `linear-gradient(to right, ${stops.join(", ")})`;
  const places = ticks(low, high), digits = Math.max(0, places.length > 1 ? -Math.floor(Math.log10(places[1] - places[0]) + 1e-9) : 2);
  for (const value of places) {
    const at = high > low ? 100 * (value - low) / (high - low) : 50;
    const mark = element("i"), word = element("span", value.toFixed(Math.min(6, digits)));
    mark.style.left = word.style.left = `${at}%`;
    if (at < 4) word.style.transform = "none";
    if (at > 96) { word.style.left = "auto"; word.style.right = "0"; word.style.transform = "none"; }
    scale.append(mark, word);
  }
  const buttons = element("div", "", { className: "ends" });
  for (const [word, row] of [["lowest", ends[0]], ["highest", ends[1]]]) {
    if (row < 0) continue;
    const button = element("button", `${word} ${field.text(field.values[row])}`, { title: "fly there" });
    button.onclick = () => fly(row);
    buttons.append(button);
  }
  legend.replaceChildren(bar, scale, element("div", field.unit, { className: "unit" }), buttons);
}

function showRoles(roles, lengths, mask, changed) {
  const list = roles.map((role, i) => ({ ...role, i, length: lengths[i] })).filter((role) => role.length > 0);
  $("features").hidden = !list.length;
  $("roles").replaceChildren(...list.map(({ name, colour, i, length }) => {
    const label = element("label"), tick = element("input", "", { type: "checkbox", checked: Boolean(mask >>> i & 1) }), chip = element("i");
    chip.style.background = colour;
    tick.onchange = () => changed(i, tick.checked);
    label.append(tick, chip, element("span", name), element("em", length >= 1e3 ? `${(length / 1e3).toFixed(2)} m` : `${length.toFixed(0)} mm`));
    label.dataset.role = name;
    return label;
  }));
}

function showFindings(findings, chosen, fly) {
  $("found").hidden = !findings.length;
  $("findings").replaceChildren(...findings.map((finding, i) => {
    const item = element("li"), button = element("button", "", { className: i === chosen ? "chosen" : "" });
    button.append(element("b", `${i + 1}`), element("span", `${finding.sentence} ${finding.help}`.trim()));
    button.onclick = () => fly(i);
    item.append(button);
    return item;
  }));
}

function showNotes(notes) {
  $("told").hidden = !notes.length;
  $("notes").replaceChildren(...notes.map((note) => element("li", note)));
}

const KEYS = [["space", "play, pause"], ["↑ ↓", "layer up, down (shift: 10)"], ["← →", "move back, on (shift: 100)"], ["home end", "first, last move"],
  ["C", "next colouring"], ["F", "all of the part, all of the machine"], ["T R", "from the top, from the front"], ["M", "robot on, off"], ["O", "only this layer"],
  ["+ −", "nearer, farther"], ["N", "next finding"], ["?", "this list"]];

function showHelp() {
  const table = element("table");
  for (const [key, word] of KEYS) {
    const row = element("tr"), cell = element("td");
    key.split(" ").forEach((one, i) => cell.append(i ? " " : "", element("kbd", one)));
    row.append(cell, element("td", word));
    table.append(row);
  }
  $("help").replaceChildren(table);
  $("help").hidden = !$("help").hidden;
  $("help").onclick = () => { $("help").hidden = true; };
}

// Where x, y and z point, bottom left.
function showCompass({ right, up, near }) {
  const parts = [["x", "#c23b22"], ["y", "#1e8449"], ["z", "#1f5fa8"]].map(([name, colour], i) => ({ name, colour, x: 26 * right[i], y: -26 * up[i], depth: near[i] }));
  parts.sort((a, b) => a.depth - b.depth);
  $("compass").innerHTML = parts.map(({ name, colour, x, y }) => `<line x2="${x}" y2="${y}" stroke="${colour}" stroke-width="2"/>`
    + `<text x="${1.32 * x}" y="${1.32 * y}" fill="${colour}">${name}</text>`).join("");
}
