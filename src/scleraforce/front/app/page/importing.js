// Import: dropped files are read, and what they do not state is asked beside their picture.

import { picture, send, upload } from "./api.js";
import { Chart } from "./chart.js";
import { element, fixed, list, made, tell, told, write } from "./dom.js";
import { await_, go, poll, state } from "./state.js";

// Options of `import` with their labels and kinds of field: a number, a text or a choice.
const FIELDS = {
  width_mm: ["Width of the frames, mm", "number"],
  depth_mm: ["Depth of the frames as stored, mm", "number"],
  refractive_index: ["Refractive index of the depth (1: corrected)", "number"],
  bits: ["Used bits per pixel", "number"],
  rate_hz: ["Frames per second", "number"],
  times: ["Table of the frames' times, instead of a rate", [""]],
  frames_by: ["Frames in files of their own go by", ["", "numbers", "times", "times:s", "times:ms", "times:us", "times:ns", "order"]],
  axis: ["Axis of the force along the needle", ["", "fx", "fy", "fz"]],
  range_n: ["Largest force that the sensor measures, N", "number"],
  contact_sign: ["Sign of that axis in contact", ["", "1", "-1"]],
  clock_offset_s: ["Force log's clock minus the frames', s", "number"],
  first_frame: ["First frame", "number"],
  last_frame: ["Last frame", "number"],
  eye: ["Name of the eye", "text"],
  gauge: ["Gauge of the needle", "number"],
  gap_mm: ["Distance of the B-scan plane from the needle axis, mm", "number"],
  thickness_um: ["Thickness of the wall, µm", "number"],
  iop_mmhg: ["Intraocular pressure, mmHg", "number"],
  globe: ["Globe", ["", "open", "sealed"]],
  relaxation: ["Relaxation of the tissue: share:seconds,…, or none", "text"],
  axes: ["Axes of an array, like frame,depth,lateral", "text"],
  flip: ["Pictures that are upside down (rows) or mirrored (columns)", ["", "rows", "columns"]],
};
const TIMES = "times"; // a table that states when the frames were taken: no source of its own
const KINDS = { [TIMES]: "times of the frames", log: "force log" };
const NO_FRAMES = new Set([TIMES, "log"]);
const COLUMNS = { time: "Time", fx: "Force x", fy: "Force y", fz: "Force z", tx: "Torque x", ty: "Torque y", tz: "Torque z", status: "Status of the sensor" };
const FIRST_COLUMNS = 4; // that most logs have
const OTHER = "other"; // a unit that is typed
const NUMBERS = new Set(Object.keys(FIELDS).filter((name) => FIELDS[name][1] === "number"));
const WAIT_MS = 500;
const SENT_AT_ONCE = 4; // files

const chosen = new Set();
const given = {}; // answers by the names of options
const columns = new Map(); // of a force log: short name -> { name, unit }
let table = null; // the columns of the chosen log, how its header is read, and units
const planes = new Map(); // of sources: name -> "NAME:OFFSET_MM:DIRECTION_DEG"
let seen = null; // what the chosen files state and leave open
let image = null;
let bar = null;
let clocks = null;
let clockPlot = null;
let pull = null;
let looking = 0; // a number for each request: late answers are dropped

const asked = () => ({
  operands: [...chosen], options: { ...given },
  planes: Object.fromEntries([...planes].filter(([name, text]) => text && chosen.has(name) && element("several").checked)),
  columns: [...columns].filter(([short, { name, unit }]) => unit && (has(name) || (name && table?.read[short]?.name === name))).map(([short, { name, unit }]) => `${short}=${name}:${unit}`),
});
const has = (name) => Boolean(table?.columns.some((column) => column.name === name));
const number = () => Math.max(0, Number(element("source-number").value) - 1);

export function fill(sources) {
  for (const name of [...chosen]) if (!sources.some((source) => source.name === name)) chosen.delete(name);
  const items = sources.map(({ name, kind, fault }) => {
    const box = made("input", { type: "checkbox", disabled: Boolean(fault), onchange: () => (kind === TIMES ? time : choose)(name, box.checked) });
    box.checked = kind === TIMES ? given.times === name : chosen.has(name);
    return made("li", {}, made("label", {}, box, ` ${name} `), made("span", { class: "soft" }, fault ?? KINDS[kind] ?? kind), ...(fault || NO_FRAMES.has(kind) ? [] : plane(name)));
  });
  tables(sources);
  element("sources").replaceChildren(...(items.length ? items : [made("li", { class: "soft" }, "none yet")]));
}

// The field for the plane of a source.
function plane(name) {
  if (!element("several").checked) return [];
  const change = (event) => {
    planes.set(name, event.target.value.trim());
    later();
  };
  return [made("input", { class: "plane", value: planes.get(name), placeholder: "across:0:90", "aria-label": `Plane of ${name}, NAME:OFFSET_MM:DIRECTION_DEG`, oninput: change })];
}

function tables(sources) {
  form();
  const select = element("answers").querySelector("[data-name=times] select");
  select.replaceChildren(...["", ...sources.filter(({ kind }) => NO_FRAMES.has(kind)).map(({ name }) => name)].map((value) => made("option", { value }, value || "–")));
  select.value = given.times ?? "";
}

export const show = () => look();

function choose(name, on) {
  if (on) chosen.add(name);
  else chosen.delete(name);
  [seen, table, clocks] = [null, null, null];
  look();
}

// Takes a table as that of the frames' times, or no more.
function time(name, on) {
  if (on) given.times = name;
  else delete given.times;
  clocks = null;
  fill(state.sources);
  look();
}

const look = told(async () => {
  form();
  for (const id of ["answers", "import-end"]) element(id).hidden = !chosen.size;
  if (!chosen.size) {
    for (const id of ["source", "log", "columns"]) element(id).hidden = true;
    return;
  }
  const mine = (looking += 1);
  if (!seen) list("import-notes", ["reading the files …"]);
  const found = await send("sources", asked());
  if (mine !== looking) return;
  const known = table;
  [seen, table] = [found, found.table];
  form();
  if (!known && asked().columns.length) { // of an earlier look at the same log
    await look();
    return;
  }
  if (found.question) {
    list("import-notes", [found.question], "against");
    return;
  }
  list("import-notes", found.notes);
  element("source").hidden = false;
  write("source-size", `${found.frames} frames of ${found.rows} x ${found.columns} pixels (depth x lateral)`);
  element("source-number").max = found.frames;
  const shown = await picture("picture", asked(), { number: number() });
  if (mine !== looking) return;
  image = shown;
  draw();
  logs();
  await words();
});

function later() {
  clearTimeout(later.timer);
  later.timer = setTimeout(look, WAIT_MS);
}

// ---- what is asked

function form() {
  const box = element("answers");
  const needed = new Set(Object.keys(seen?.missing ?? {}));
  if (!box.children.length) box.append(...Object.entries(FIELDS).map(([name, [label, kind]]) => field(name, label, kind)));
  for (const entry of box.querySelectorAll("[data-name]")) {
    const name = entry.dataset.name;
    entry.classList.toggle("missing", needed.has(name));
    const stated = seen?.stated?.[name];
    const input = entry.querySelector("input, select");
    input.placeholder = stated ? String(stated.value) : "";
    entry.querySelector(".from").textContent = given[name] === undefined && stated ? `${stated.value} (${stated.source})` : "";
    if (document.activeElement !== input) input.value = given[name] ?? "";
  }
  columnFields();
}

function field(name, label, kind) {
  const change = (event) => {
    const text = event.target.value.trim();
    if (text === "") delete given[name];
    else given[name] = NUMBERS.has(name) ? Number(text) : text;
    later();
  };
  const input = Array.isArray(kind)
    ? made("select", { oninput: change }, ...kind.map((value) => made("option", { value }, value || "–")))
    : made("input", { type: kind, step: "any", oninput: change });
  return made("label", { "data-name": name }, made("span", { class: "label" }, label), input, made("span", { class: "from" }));
}

// The columns of a force log, chosen among those of its header; what the header says by itself is chosen already.
function columnFields() {
  const box = element("columns");
  box.hidden = !table;
  if (!table) return;
  const asks = new Set((seen?.forms ?? []).map((form) => form.split("=")[0]));
  const key = JSON.stringify(table);
  if (box.dataset.table !== key) {
    box.dataset.table = key;
    const pairs = Object.keys(COLUMNS).map(column);
    const more = made("details", {}, made("summary", {}, "Torques and status"), made("div", { class: "more" }, ...pairs.slice(FIRST_COLUMNS)));
    box.replaceChildren(box.querySelector("legend"), ...pairs.slice(0, FIRST_COLUMNS), more);
  }
  for (const pair of box.querySelectorAll("[data-column]")) pair.classList.toggle("missing", asks.has(pair.dataset.column));
}

function column(short) {
  const [units, read] = [table.units[short], table.read[short] ?? { name: "", unit: "" }];
  const listed = new Map(table.columns.map(({ name, first }) => [name, first ? `${name} (${first}, …)` : name]));
  if (read.name && !listed.has(read.name)) listed.set(read.name, read.name); // a time in two columns
  const names = made("select", { class: "name", "aria-label": `Column of ${COLUMNS[short]}` },
    made("option", { value: "" }, "–"), ...[...listed].map(([value, text]) => made("option", { value }, text)));
  const typed = made("input", { class: "typed", placeholder: "1000/N", "aria-label": `Unit of ${COLUMNS[short]}, like 1000/N` });
  const choices = made("select", { class: "unit", "aria-label": `Unit of ${COLUMNS[short]}` },
    ...["", ...units, OTHER].map((value) => made("option", { value }, value || "unit")));
  const put = ({ name, unit }) => {
    const known = units.find((each) => each === unit) ?? units.find((each) => each.toLowerCase() === unit.toLowerCase());
    names.value = name;
    choices.value = unit ? (known ?? OTHER) : "";
    typed.value = known ? "" : unit;
    typed.hidden = choices.value !== OTHER;
  };
  const change = () => {
    typed.hidden = choices.value !== OTHER;
    columns.set(short, { name: names.value, unit: choices.value === OTHER ? typed.value.trim() : choices.value });
    later();
  };
  put(has(columns.get(short)?.name) ? columns.get(short) : read);
  names.oninput = () => {
    if (names.value && names.value !== read.name) {
      put({ name: names.value, unit: table.columns.find((each) => each.name === names.value).unit });
      change();
    } else { // as the header says
      columns.delete(short);
      put(read);
      later();
    }
  };
  for (const input of [choices, typed]) input.oninput = change;
  return made("div", { class: "pair", "data-column": short }, made("span", { class: "label" }, COLUMNS[short]), names, choices, typed);
}

const run = () => ({ command: "import", out: element("import-out").value.trim(), ...asked() });

const words = async () => {
  const taken = new Set(state.recordings.map(({ name }) => name));
  for (let n = 1; !element("import-out").value; n += 1) if (!taken.has(`recording-${n}`)) element("import-out").value = `recording-${n}`;
  const { command, fault } = await send("words", run());
  write("import-command", command ?? fault);
};

element("import-out").oninput = later;
element("several").onchange = () => {
  fill(state.sources);
  later();
};
element("import-run").onclick = told(async () => {
  const asks = run();
  await_(await send("run", asks), () => {
    element("import-out").value = "";
    go("look", asks.out);
  });
});

// ---- the picture, and a bar over a known length

const canvas = element("source-picture");

function draw() {
  if (!image) return;
  const [width, depth] = ["width_mm", "depth_mm"].map((name) => given[name] ?? seen?.stated?.[name]?.value);
  canvas.width = canvas.clientWidth || 600;
  canvas.height = Math.round(width && depth ? (canvas.width * depth) / width : Math.min((canvas.width * image.height) / image.width, 0.45 * canvas.width));
  const pen = canvas.getContext("2d");
  pen.drawImage(image, 0, 0, canvas.width, canvas.height);
  if (!bar) return;
  pen.strokeStyle = "#e69f00";
  pen.lineWidth = 3;
  pen.beginPath();
  pen.moveTo(bar.from[0] * canvas.width, bar.from[1] * canvas.height);
  pen.lineTo(bar.to[0] * canvas.width, bar.to[1] * canvas.height);
  pen.stroke();
}

const share = (event) => {
  const box = canvas.getBoundingClientRect();
  return [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height].map((value) => Math.min(1, Math.max(0, value)));
};

canvas.onpointerdown = (event) => {
  canvas.setPointerCapture(event.pointerId);
  bar = { from: share(event), to: share(event), held: true };
};
canvas.onpointermove = (event) => {
  if (!bar?.held) return;
  const to = share(event);
  const flat = Math.abs(to[0] - bar.from[0]) * canvas.width >= Math.abs(to[1] - bar.from[1]) * canvas.height;
  bar = { ...bar, flat, to: flat ? [to[0], bar.from[1]] : [bar.from[0], to[1]] };
  element("bar").hidden = false;
  write("bar-text", flat ? "along the surface: gives the width" : "along the depth: gives the depth");
  draw();
};
canvas.onpointerup = () => {
  if (bar) bar.held = false;
};

element("bar-take").onclick = () => {
  const length = bar && Math.hypot(bar.to[0] - bar.from[0], bar.to[1] - bar.from[1]);
  const known = Number(element("bar-mm").value);
  if (!length || !(known > 0)) {
    tell("scale: drag a bar, and give its length in mm");
    return;
  }
  given[bar.flat ? "width_mm" : "depth_mm"] = Number((known / length).toPrecision(4));
  form();
  later();
};
element("source-number").oninput = later;

// ---- the log and the clocks

function logs() {
  const axes = Object.keys(seen.log);
  element("log").hidden = !axes.length;
  const axis = given.axis ?? seen.stated.axis?.value;
  element("log-plots").replaceChildren(...axes.map((name) => {
    const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
    svg.setAttribute("class", `plot${name === axis ? " chosen" : ""}`);
    svg.dataset.clicks = "";
    svg.onclick = () => {
      if (given.axis === name) given.contact_sign = given.contact_sign === "-1" ? "1" : "-1";
      else Object.assign(given, { axis: name, contact_sign: larger(seen.log[name]) });
      look();
    };
    return svg;
  }));
  axes.forEach((name, n) => {
    const curve = seen.log[name];
    const plot = new Chart(element("log-plots").children[n], { x: curve.time_s, y: [...curve.low, ...curve.high], labels: ["time / s", `${name} / mN`], zero: true });
    plot.band(curve);
  });
  clock();
}

// The sign that makes the largest force of a curve positive.
function larger({ low, high }) {
  const known = (values) => values.filter((value) => value !== null);
  return Math.max(...known(high)) >= -Math.min(...known(low)) ? "1" : "-1";
}

function clock() {
  const axis = given.axis ?? seen?.stated?.axis?.value;
  const [svg, curve] = [element("clock-plot"), seen?.log?.[axis]];
  svg.toggleAttribute("hidden", !clocks || !curve);
  if (!clocks || !curve) {
    write("clock-text", "Propose finds the surface in the frames; it needs their size and rate, and the force axis.");
    return;
  }
  const offset = given.clock_offset_s ?? 0;
  const times = clocks.time_s.map((time) => time + offset);
  clockPlot = new Chart(svg, { x: [...curve.time_s, ...times], y: [...curve.low, ...curve.high], labels: ["force log's clock / s", `${axis} / mN`], zero: true });
  clockPlot.band(curve);
  const dents = clocks.dent_mm.filter((dent) => dent !== null);
  const [low, high] = [Math.min(...dents), Math.max(...dents)];
  const down = given.contact_sign === "-1";
  const [bottom, top] = clockPlot.y;
  const scaledTo = (dent) => (dent === null ? null : down ? top - ((dent - low) / (high - low || 1)) * 0.9 * (top - bottom) : bottom + ((dent - low) / (high - low || 1)) * 0.9 * (top - bottom));
  clockPlot.line(times, clocks.dent_mm.map(scaledTo), "other");
  const fit = clocks.offset_s === null ? "no offset fits" : `${clocks.sure ? "proposed" : "not sure, look at the curve"}: ${clocks.words}`;
  write("clock-text", `offset ${fixed(offset, 3)} s; ${fit}`);
}

element("propose").onclick = told(async () => {
  write("clock-text", "finding the surface …");
  clocks = await send("clocks", asked());
  if (clocks.offset_s !== null) {
    given.clock_offset_s = Number(clocks.offset_s.toFixed(3));
    given.contact_sign ||= clocks.contact_sign;
  }
  await look();
});
element("clock-plot").onpointerdown = (event) => {
  if (!clockPlot) return;
  element("clock-plot").setPointerCapture(event.pointerId);
  pull = { from: clockPlot.under(event), offset: given.clock_offset_s ?? 0, plot: clockPlot };
};
element("clock-plot").onpointermove = (event) => {
  if (!pull) return;
  given.clock_offset_s = Number((pull.offset + pull.plot.under(event) - pull.from).toFixed(3));
  clock();
};
element("clock-plot").onpointerup = () => {
  if (pull) later();
  pull = null;
  form();
};

// ---- files that are dropped

async function take(files) {
  const [bar_, left, arrived] = [element("upload"), [...files], new Map()];
  const sends = async () => {
    for (let file; (file = left.shift()); ) {
      const share = (part) => (bar_.value = (arrived.size + part) / files.length);
      arrived.set(file, (await upload(file, share)).name);
    }
  };
  bar_.hidden = false;
  const ended = await Promise.allSettled(Array.from({ length: SENT_AT_ONCE }, sends));
  bar_.hidden = true;
  await poll();
  for (const file of files) if (arrived.has(file)) takeArrived(arrived.get(file));
  fill(state.sources);
  for (const { reason } of ended) if (reason) throw reason;
  await look();
}

// A file that has arrived is chosen: as times, if it is a table of them and none is chosen.
function takeArrived(name) {
  const entry = state.sources.find((source) => source.name === name);
  if (entry?.kind === TIMES) given.times ??= name;
  else chosen.add(name);
  [seen, table, clocks] = [null, null, null];
}

const drop = element("drop");
drop.ondragover = (event) => {
  event.preventDefault();
  drop.classList.add("over");
};
drop.ondragleave = () => drop.classList.remove("over");
drop.ondrop = told(async (event) => {
  event.preventDefault();
  drop.classList.remove("over");
  await take([...event.dataTransfer.files]);
});
element("files").onchange = told(async ({ target }) => {
  const files = [...target.files];
  target.value = ""; // so that the same file can be chosen again
  await take(files);
});
