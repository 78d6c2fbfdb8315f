// Look and correct: the frames of a recording, the wall that is read, and its boundaries moved by hand.

import { erase, frame, get, send, thumbnail } from "./api.js";
import { Chart } from "./chart.js";
import { element, fixed, made, told, write } from "./dom.js";
import { remarkItems } from "./remarks.js";
import { state } from "./state.js";

const WIDE = 116; // of a thumbnail with its gap
const HANDLES = 13; // of each boundary
const REACH = 14; // pixels from a handle
const KEPT = 400; // walls and answers of frames, in memory
const PLAY_MS = 200;
const DRAFT_MS = 600;

let recordings = [];
let chosen = null; // { name, summary }
let number = 0;
let corrects = false;
let zoom = 1;
let now = { image: null, look: null };
let draft = null; // { place, outer, inner, unseen, undo, redo }
let unsent = null; // the timer after which a draft is sent
let hold = null; // of the mouse
let playing = null;
let plot = null;
let asked = 0; // a number for each frame that is asked for: late answers are dropped
const looks = new Map();

const canvas = element("frame");
const file = () => chosen.summary.files[number];
const here = (name = file()) => ({ name: chosen.name, file: name });

// What a recording's frames are read with: as *Read* last read them, and by the bundled reader if it has not.
function readBy({ name }) {
  const last = state.read;
  if (!last?.recordings.includes(name)) return {};
  const there = state.calibrations.some((each) => each.name === last.calibration);
  return { model: last.model, ...(there ? { calibration: last.calibration } : {}) };
}

const asks = (place) => ({ ...place, ...readBy(place) });
const key = (place) => JSON.stringify(asks(place));

export function fill(entries) {
  recordings = entries;
  const select = element("recording");
  const before = select.value;
  select.replaceChildren(...entries.map(({ name, eye }) => made("option", { value: name }, eye === name ? name : `${name} (${eye})`)));
  if (entries.some(({ name }) => name === before)) select.value = before;
  if (!entries.some(({ name }) => name === chosen?.name)) chosen = null;
}

export const show = told(async (withHandles, name = element("recording").value, at = undefined) => {
  corrects = withHandles;
  element("tools").hidden = !corrects;
  if (!recordings.length) {
    write("verdict", "No recordings in this folder yet. Import one first.");
    return;
  }
  canvas.focus({ preventScroll: true }); // else a field of a hidden step would take the keys
  if (chosen?.name !== name || at) await open(name, at);
  else await turn(number);
});

// Leaves the frame that is shown: a draft that was not sent yet is sent now. Returns the number of the next one.
function leave() {
  if (unsent) void keep();
  [draft, hold] = [null, null];
  return (asked += 1);
}

async function open(name, at) {
  const mine = leave();
  element("recording").value = name;
  chosen = null;
  const summary = await get("recording", { name });
  if (mine !== asked) return;
  chosen = { name, summary };
  looks.clear();
  plot = null;
  const inside = element("strip-inside");
  inside.style.width = `${WIDE * chosen.summary.files.length}px`;
  inside.style.height = "78px";
  inside.replaceChildren();
  const items = remarkItems({ remarks: summary.imported });
  element("imported").hidden = !items.length;
  element("import-remarks").replaceChildren(...items);
  await turn(Math.max(0, at ? chosen.summary.files.indexOf(at) : 0));
}

async function turn(to) {
  if (!chosen) return;
  const mine = leave();
  number = Math.min(Math.max(to, 0), chosen.summary.files.length - 1);
  const place = here();
  const { time_s: times, planes } = chosen.summary;
  write("place", `${place.file}, ${fixed(times[number], 3)} s, ${number + 1} of ${times.length}${planes ? `, plane ${planes[number]}` : ""}`);
  for (const id of ["look-command", "draft"]) write(id, "");
  now.image?.close();
  now = { image: null, look: null };
  strip();
  forces();
  let image;
  try {
    image = await frame(place);
  } catch (fault) {
    if (mine === asked) blank();
    throw fault;
  }
  if (mine !== asked) return image.close();
  now = { image, look: looks.get(key(place)) };
  draw();
  if (!now.look) write("verdict", "reading …");
  const look = await looked(place);
  if (mine !== asked) return;
  [now, draft] = [{ image, look }, corrects && state.writes ? begun(look, place) : null];
  strip();
  words();
  draw();
}

// A frame that cannot be read: the banner says why.
function blank() {
  canvas.getContext("2d").clearRect(0, 0, canvas.width, canvas.height);
  for (const id of ["verdict", "read-by"]) write(id, "");
  element("frame-notes").replaceChildren();
}

async function looked(place) {
  if (!looks.has(key(place))) {
    const mine = key(place);
    const found = await get("look", asks(place));
    if (looks.size > KEPT) looks.delete(looks.keys().next().value);
    looks.set(mine, found);
    return found;
  }
  return looks.get(key(place));
}

function words() {
  const { answer, wall, command } = now.look;
  write("look-command", command);
  const force = answer.predicted_force_mn;
  const known = force === null ? `class ${answer.predicted}` : `${fixed(force, 1)} mN (90 %: ${answer.interval_mn.map((end) => fixed(end, 1)).join(" to ")}), class ${answer.predicted}`;
  const source = wall?.source === "corrected" ? "wall: corrected; " : "";
  const dent = answer.dent_mm === null ? "" : `, dent ${fixed(answer.dent_mm, 2)} mm`;
  const thick = wall?.thickness_um ? `, wall ${fixed(wall.thickness_um, 0)} µm` : "";
  write("verdict", answer.usable ? `${source}${known}${dent}${thick}` : `${source}Not usable: ${answer.reason}`);
  element("verdict").classList.toggle("refused", !answer.usable);
  write("read-by", byWords());
  element("frame-notes").replaceChildren(...remarkItems({ remarks: answer.remarks, notes: chosen.summary.notes }));
  element("key-needle").hidden = !answer.needle;
  element("key-unseen").hidden = !draft?.unseen.size;
}

// With which model and calibration the frame was read.
function byWords() {
  const { model, calibration } = now.look;
  const by = model === "default" ? "" : ` by ${model}`;
  if (calibration) return `Read${by} with calibration ${calibration}, as in Read.`;
  const last = state.read;
  const gone = last?.recordings.includes(chosen.name) && last.calibration ? `: ${last.calibration}, with which Read read it, is gone` : "";
  return `Read${by} without a calibration${gone}.`;
}

function strip() {
  const [box, inside] = [element("strip"), element("strip-inside")];
  const at = number * WIDE;
  if (at < box.scrollLeft || at + WIDE > box.scrollLeft + box.clientWidth) box.scrollLeft = Math.max(0, at - box.clientWidth / 2);
  const first = Math.max(0, Math.floor(box.scrollLeft / WIDE) - 2);
  const last = Math.min(chosen.summary.files.length, first + Math.ceil(box.clientWidth / WIDE) + 5);
  const there = new Map([...inside.children].map((child) => [Number(child.dataset.n), child]));
  for (const [n, child] of there) if (n < first || n >= last) child.remove();
  for (let n = first; n < last; n += 1) {
    const name = chosen.summary.files[n];
    const child = there.get(n) ?? inside.appendChild(thumb(n, name));
    const look = looks.get(key(here(name)));
    child.setAttribute("aria-selected", String(n === number));
    child.classList.toggle("refused", look?.answer.usable === false);
    child.classList.toggle("corrected", look ? look.wall?.source === "corrected" : chosen.summary.corrected.includes(name));
  }
}

function thumb(n, name) {
  const child = made("button", { type: "button", role: "option", tabindex: "-1", "data-n": n, title: name, onclick: () => turnTo(n) }, made("span", {}, name));
  child.style.left = `${n * WIDE}px`;
  child.style.backgroundImage = `url("${thumbnail(chosen.name, name)}")`;
  return child;
}

const turnTo = told((to) => turn(to));

// ---- drawing

function draw() {
  const { image, look } = now;
  if (!image) return;
  const { rows, columns, width_mm: width, depth_mm: depth } = chosen.summary;
  canvas.width = Math.round(canvas.closest(".view").clientWidth * zoom);
  canvas.height = Math.round((canvas.width * depth) / width);
  const pen = canvas.getContext("2d");
  pen.drawImage(image, 0, 0, canvas.width, canvas.height);
  const [across, down] = [canvas.width / columns, canvas.height / rows];
  const wall = draft ?? look?.wall;
  pen.lineWidth = 2;
  if (draft) hatch(pen, across);
  if (wall) {
    line(pen, wall.outer, across, down, "--surface", []);
    line(pen, wall.inner, across, down, "--inner", [7, 5]);
  }
  if (look?.answer.needle?.tip_mm) needle(pen, look.answer.needle, width, depth);
  if (draft) handles(pen, across, down);
  sliders();
}

const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name);

function line(pen, boundary, across, down, name, dashes) {
  pen.strokeStyle = colour(name);
  pen.setLineDash(dashes);
  pen.beginPath();
  let up = true;
  boundary.forEach((row, column) => {
    if (row === null) up = true;
    else {
      pen[up ? "moveTo" : "lineTo"]((column + 0.5) * across, (row + 0.5) * down);
      up = false;
    }
  });
  pen.stroke();
  pen.setLineDash([]);
}

function needle(pen, { angle_deg: angle, leans, tip_mm: [lateral, deep] }, width, depth) {
  const top = lateral + (leans === "left" ? -1 : 1) * Math.tan((angle * Math.PI) / 180) * deep;
  const across = (place) => (place / width + 0.5) * canvas.width;
  pen.strokeStyle = colour("--needle");
  pen.beginPath();
  pen.moveTo(across(lateral), (deep / depth) * canvas.height);
  pen.lineTo(across(top), 0);
  pen.stroke();
}

function hatch(pen, across) {
  pen.fillStyle = "#8a96a266";
  for (const column of draft.unseen) pen.fillRect(column * across, 0, across + 0.5, canvas.height);
}

function handles(pen, across, down) {
  for (const [name, boundary] of [["--surface", draft.outer], ["--inner", draft.inner]]) {
    for (const column of places(boundary.length)) {
      if (boundary[column] === null) continue;
      pen.beginPath();
      pen.arc((column + 0.5) * across, (boundary[column] + 0.5) * down, 6, 0, 2 * Math.PI);
      pen.fillStyle = colour(name);
      pen.fill();
      pen.strokeStyle = "#000";
      pen.stroke();
    }
  }
}

const places = (columns) => Array.from({ length: HANDLES }, (_, n) => Math.round(((n + 0.5) * columns) / HANDLES));

// ---- corrections

// The wall to start from: a draft, else the detected one, its gaps bridged and marked as unseen.
function begun(look, place) {
  const { rows, columns } = chosen.summary;
  const start = look.draft ?? look.wall ?? { outer: Array(columns).fill(null), inner: Array(columns).fill(null) };
  const unseen = new Set(look.draft?.unseen ?? []);
  if (!look.draft) start.outer.forEach((row, column) => row === null && unseen.add(column));
  const known = start.outer.some((row) => row !== null);
  const outer = known ? bridged(start.outer) : Array(columns).fill(rows * 0.3);
  const thick = known ? null : rows * 0.15;
  const inner = thick === null ? (start.inner.some((row) => row !== null) ? bridged(start.inner) : [...start.inner]) : outer.map((row) => row + thick);
  return { place, outer, inner, unseen: known ? unseen : new Set(), undo: [], redo: [] };
}

function bridged(boundary) {
  const known = boundary.map((row, column) => [column, row]).filter(([, row]) => row !== null);
  let n = 0;
  return boundary.map((_, column) => {
    while (n + 1 < known.length && known[n + 1][0] <= column) n += 1;
    const [[left, row], [right, next]] = [known[n], known[Math.min(n + 1, known.length - 1)]];
    if (column <= left || left === right) return row;
    return row + ((next - row) * (column - left)) / (right - left);
  });
}

const copied = ({ outer, inner, unseen }) => ({ outer: [...outer], inner: [...inner], unseen: new Set(unseen) });

function step(from, to) {
  if (!draft?.[from].length) return;
  draft[to].push(copied(draft));
  Object.assign(draft, draft[from].pop());
  changed();
}

function changed() {
  draw();
  words();
  write("draft", "saving the draft …");
  clearTimeout(unsent);
  unsent = setTimeout(keep, DRAFT_MS);
}

const keep = told(async () => {
  sends();
  const [{ place }, walls] = [draft, drawn()];
  const look = looks.get(key(place));
  if (look) look.draft = walls;
  await send("draft", walls, place, "PUT");
  if (draft?.place === place && !unsent) write("draft", "draft saved");
});

function sends() {
  clearTimeout(unsent);
  unsent = null;
}

const drawn = () => ({ outer: draft.outer, inner: draft.inner, unseen: [...draft.unseen].sort((a, b) => a - b) });

function at(event) {
  const box = canvas.getBoundingClientRect();
  const [x, y] = [((event.clientX - box.left) / box.width) * canvas.width, ((event.clientY - box.top) / box.height) * canvas.height];
  const { rows, columns } = chosen.summary;
  return { x, y, column: Math.min(columns - 1, Math.max(0, Math.floor((x / canvas.width) * columns))), row: (y / canvas.height) * rows - 0.5 };
}

canvas.onpointerdown = (event) => {
  if (!draft) return;
  const place = at(event);
  const { rows, columns } = chosen.summary;
  if (element("unseen").getAttribute("aria-pressed") === "true") {
    hold = { kind: "columns", from: place.column, removes: draft.unseen.has(place.column), before: copied(draft) };
  } else {
    let best = REACH;
    for (const name of ["outer", "inner"]) {
      for (const column of places(columns)) {
        if (draft[name][column] === null) continue;
        const away = Math.hypot(((column + 0.5) / columns) * canvas.width - place.x, ((draft[name][column] + 0.5) / rows) * canvas.height - place.y);
        if (away < best) [best, hold] = [away, { kind: "handle", name, column, row: place.row, before: copied(draft) }];
      }
    }
  }
  if (hold) canvas.setPointerCapture(event.pointerId);
};

canvas.onpointermove = (event) => {
  if (!hold) return;
  const place = at(event);
  if (hold.kind === "handle") bend(hold, place.row - hold.row);
  else {
    draft.unseen = new Set(hold.before.unseen);
    for (let n = Math.min(hold.from, place.column); n <= Math.max(hold.from, place.column); n += 1) {
      if (hold.removes) draft.unseen.delete(n);
      else draft.unseen.add(n);
    }
  }
  draw();
};

canvas.onpointerup = () => {
  if (!hold) return;
  draft.undo.push(hold.before);
  draft.redo = [];
  hold = null;
  changed();
};

// A handle takes the boundary along as far as its neighbours: a smooth bump (half a cosine).
function bend({ name, column, before }, rows) {
  const reach = chosen.summary.columns / HANDLES;
  draft[name] = before[name].map((row, n) => {
    const away = Math.abs(n - column) / reach;
    return row === null || away >= 1 ? row : row + 0.5 * rows * (1 + Math.cos(Math.PI * away));
  });
}

// The handles for the keyboard: each boundary's are one stop of Tab, arrows choose one of them and move it by rows.
const BOUNDARIES = { outer: "surface", inner: "inner boundary" };
const stops = { outer: (HANDLES - 1) / 2, inner: (HANDLES - 1) / 2 };

function sliders() {
  const board = element("handles");
  board.hidden = !draft;
  if (!draft) return;
  const { rows, columns } = chosen.summary;
  if (!board.children.length) {
    for (const name of Object.keys(BOUNDARIES)) for (let n = 0; n < HANDLES; n += 1) board.append(slider(name, n));
  }
  for (const handle of board.children) {
    const { name, n } = handle.dataset;
    const column = places(columns)[n];
    const row = draft[name][column];
    handle.hidden = row === null;
    handle.tabIndex = stops[name] === Number(n) ? 0 : -1;
    handle.style.left = `${(100 * (column + 0.5)) / columns}%`;
    handle.style.top = `${(100 * (row + 0.5)) / rows}%`;
    const words = { label: `${BOUNDARIES[name]}, column ${column}`, valuemin: 0, valuemax: rows, valuenow: fixed(row, 1), valuetext: `row ${fixed(row, 1)}` };
    for (const [key, value] of Object.entries(words)) handle.setAttribute(`aria-${key}`, value);
  }
}

const slider = (name, n) => made("span", { class: "handle", role: "slider", "aria-orientation": "vertical", "data-name": name, "data-n": n, onkeydown: pressed });

function pressed(event) {
  const { name, n } = event.currentTarget.dataset;
  const aside = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
  const down = { ArrowUp: -1, ArrowDown: 1 }[event.key];
  if (!draft || event.ctrlKey || !(aside || down)) return;
  event.preventDefault();
  event.stopPropagation(); // arrows turn to other frames elsewhere
  if (down) {
    draft.undo.push(copied(draft));
    draft.redo = [];
    bend({ name, column: places(chosen.summary.columns)[n], before: draft }, down * (event.shiftKey ? 10 : 1));
    changed();
  } else {
    stops[name] = Math.min(HANDLES - 1, Math.max(0, Number(n) + aside));
    sliders();
    element("handles").querySelector(`[data-name=${name}][data-n="${stops[name]}"]`).focus();
  }
}

element("undo").onclick = () => step("undo", "redo");
element("redo").onclick = () => step("redo", "undo");
element("unseen").onclick = (event) => {
  event.currentTarget.setAttribute("aria-pressed", String(event.currentTarget.getAttribute("aria-pressed") !== "true"));
};
element("accept").onclick = told(async () => {
  if (!draft) return;
  sends();
  await settle(draft.place, await send("wall", drawn(), asks(draft.place), "PUT"));
});
element("restore").onclick = told(async () => {
  if (!draft) return;
  sends();
  await settle(draft.place, await erase("wall", asks(draft.place)));
});

async function settle(place, look) {
  looks.set(key(place), look);
  if (chosen?.name !== place.name) return;
  const corrected = look.wall?.source === "corrected";
  chosen.summary.corrected = [...chosen.summary.corrected.filter((name) => name !== place.file), ...(corrected ? [place.file] : [])];
  if (file() !== place.file) return;
  await turn(number);
  write("draft", corrected ? `saved as walls/${place.file.replace(/\.[^.]*$/, "")}.png` : "");
}

// ---- moving about

function forces() {
  const { log, force_mn: labels, time_s: times } = chosen.summary;
  const svg = element("force-plot");
  svg.toggleAttribute("hidden", !log);
  if (!log) return;
  if (!plot || plot.width !== Math.max(svg.getBoundingClientRect().width, 200)) {
    plot = new Chart(svg, { x: [...log.time_s, ...times], y: [...log.low, ...log.high], labels: ["time / s", "contact force / mN"], zero: true });
    plot.band(log);
    labels?.forEach((force, n) => force !== null && times.length <= 500 && plot.mark(times[n], force, "right", chosen.summary.files[n]));
    plot.mark = plot.upright(times[number]);
  }
  for (const end of ["x1", "x2"]) plot.mark.setAttribute(end, plot.left(times[number]));
}

const nearest = (time) => chosen.summary.time_s.reduce((best, each, n, all) => (Math.abs(each - time) < Math.abs(all[best] - time) ? n : best), 0);

element("force-plot").dataset.clicks = "";
element("force-plot").onclick = (event) => plot && turnTo(nearest(plot.under(event)));
element("recording").onchange = told((event) => open(event.target.value));
element("back").onclick = () => turnTo(number - 1);
element("next").onclick = () => turnTo(number + 1);
element("strip").onscroll = () => chosen && strip();

// Turns to the next frame when the last one was read, but not faster than every PLAY_MS.
const play = told(async () => {
  const mine = (playing = playing ? null : {});
  while (mine && playing === mine && number + 1 < chosen?.summary.files.length) {
    await Promise.all([turn(number + 1), new Promise((done) => setTimeout(done, PLAY_MS))]).catch((fault) => {
      pause();
      throw fault;
    });
  }
  if (playing === mine) pause();
});

export function pause() {
  playing = null;
}

function scaled(by) {
  zoom = by === 0 ? 1 : Math.min(8, Math.max(1, zoom * by));
  draw();
}

element("play").onclick = play;
element("zoom-in").onclick = () => scaled(1.5);
element("zoom-out").onclick = () => scaled(1 / 1.5);
window.addEventListener("resize", () => {
  if (!element("frames").hidden && chosen) {
    draw();
    strip();
    forces();
  }
});

const KEYS = {
  ArrowLeft: () => turnTo(number - 1), ArrowRight: () => turnTo(number + 1), " ": play,
  "+": () => scaled(1.5), "-": () => scaled(1 / 1.5), 0: () => scaled(0),
};

document.addEventListener("keydown", (event) => {
  if (element("frames").hidden || !chosen || event.target.matches("input, select, textarea")) return;
  const [control, letter] = [event.ctrlKey || event.metaKey, event.key.toLowerCase()];
  if (control && "zy".includes(letter)) step(...(letter === "z" && !event.shiftKey ? ["undo", "redo"] : ["redo", "undo"]));
  else if (!control && !event.altKey && KEYS[event.key] && !(event.key === " " && event.target.matches("button"))) KEYS[event.key]();
  else return;
  event.preventDefault();
});
