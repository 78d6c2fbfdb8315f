// Calibrate and read: what is run, and its results as plots and tables.

import { get, send } from "./api.js";
import { Chart, MARKS, markOf, svgText } from "./chart.js";
import { download, element, fixed, made, told, write } from "./dom.js";
import { remarkList } from "./remarks.js";
import { await_, choice, go, state } from "./state.js";

const CURVE = 121; // points of a density
const WORST = 200; // rows of the table

const chosen = { calibrate: new Set(), read: new Set() };

export function fill({ recordings, calibrations, models }) {
  for (const step of ["calibrate", "read"]) {
    const items = recordings.map(({ name, eye }) => {
      const box = made("input", { type: "checkbox", onchange: () => choose(step, name, box.checked) });
      box.checked = chosen[step].has(name);
      return made("li", {}, made("label", {}, box, eye === name ? ` ${name}` : ` ${name} (${eye})`));
    });
    element(step).querySelector(".recordings").replaceChildren(...items);
  }
  for (let n = 2; calibrations.some(({ name }) => name === element("calibrate-out").value); n += 1) element("calibrate-out").value = `calibration-${n}.json`;
  choices("read-model", ["default", ...models.map(({ name }) => `./${name}`)]);
  choices("read-calibration", ["", ...calibrations.map(({ name }) => name)]);
  words();
  for (const step of ["calibrate", "read"]) if (!element(step).hidden) show(step);
}

function choices(id, names) {
  const select = element(id);
  const before = select.value;
  select.replaceChildren(...names.map((name) => choice(name, name || "none")));
  if (names.includes(before)) select.value = before;
}

function choose(step, name, on) {
  if (on) chosen[step].add(name);
  else chosen[step].delete(name);
  words();
}

const RUNS = {
  calibrate: () => {
    const [count, without] = [element("calibrate-frames").value, element("without-force").checked];
    const options = { ...(count && !without ? { frames: Number(count) } : {}), ...(without ? { without_force: true } : {}) };
    return { command: "calibrate", operands: [...chosen.calibrate], out: element("calibrate-out").value.trim(), options };
  },
  read: () => {
    const [calibration, html] = [element("read-calibration").value, element("read-html").value.trim()];
    const options = { ...(calibration ? { calibration } : {}), ...(html ? { html } : {}) };
    return { command: "evaluate", operands: [element("read-model").value, ...chosen.read], options };
  },
};

async function words() {
  for (const step of ["calibrate", "read"]) {
    let text = "choose a recording";
    if (chosen[step].size) text = await send("words", RUNS[step]()).then(({ command, fault }) => command ?? fault, (fault) => fault.message);
    write(`${step}-command`, text);
  }
}

for (const id of ["calibrate-frames", "without-force", "calibrate-out", "read-model", "read-calibration", "read-html"]) element(id).oninput = words;
element("without-force").addEventListener("input", (event) => (element("calibrate-frames").disabled = event.target.checked));
const SHOWN = { calibrate: calibrated, read: answers };

const looks = { calibrate: 0, read: 0 }; // a number for each look at a result: late answers are dropped

// Shows the last result of this folder, also after a reload.
const last = told(async (step) => {
  const mine = (looks[step] += 1);
  const found = await get("result", { command: step === "read" ? "evaluate" : step });
  if (!found || mine !== looks[step]) return;
  const box = made("div", {}, made("p", { class: "soft" }, `${found.time_utc.slice(0, 16).replace("T", " ")} UTC: ${found.command}`));
  element(`${step}-result`).replaceChildren(box);
  await SHOWN[step](box, found.result, found.rows);
});

// A step may be clicked before the folder is known, which `fill` then shows.
export const show = (step) => state.folder === undefined || element(`${step}-result`).childElementCount || last(step);

for (const step of ["calibrate", "read"]) {
  const ended = () => {
    element(`${step}-result`).replaceChildren();
    if (!element(step).hidden) show(step);
  };
  element(`${step}-run`).onclick = told(async () => await_(await send("run", RUNS[step]()), ended));
}

// A figure with its buttons; it is drawn by `paint` once it is in the page.
function figure(box, title, name, paint) {
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  svg.setAttribute("class", "plot");
  svg.setAttribute("role", "img");
  svg.setAttribute("aria-label", title);
  const save = made("button", { type: "button", onclick: () => download(`${name}.svg`, "image/svg+xml", svgText(svg)) }, "SVG");
  box.append(made("figure", {}, made("figcaption", {}, made("h3", {}, title), save), svg));
  paint(svg);
}

// A table; a row has `cells`, the kinds of some of them by their places, a mark, and a place to go to.
function table(box, heads, rows) {
  const head = made("tr", {}, ...heads.map(([text, kind]) => made("th", { class: kind }, text)));
  const body = rows.map(({ cells, kinds = {}, mark, to }) => {
    const [first, ...others] = cells;
    const name = to ? made("button", { type: "button", class: "go" }, first) : first;
    const tds = [name, ...others].map((inside, n) => made("td", { class: [heads[n][1], kinds[n]].filter(Boolean).join(" ") }, inside));
    if (mark) tds[0].prepend(markOf(mark));
    return made("tr", { "data-mark": mark, "data-go": Boolean(to), onclick: to ? () => go("look", ...to) : null }, ...tds);
  });
  box.append(made("div", { class: "table" }, made("table", {}, made("thead", {}, head), made("tbody", {}, ...body))));
}

// ---- calibrate

function calibrated(box, result) {
  box.append(remarkList(result));
  const eyes = Object.entries(result.eyes).filter(([, eye]) => typeof eye.mean_mpa === "number");
  const used = eyes.filter(([, eye]) => eye.sd_mpa > 0);
  if (used.length) {
    const ends = used.flatMap(([, { mean_mpa: mean, sd_mpa: sd }]) => [Math.max(0, mean - 4 * sd), mean + 4 * sd]);
    const [low, high] = [Math.min(...ends), Math.max(...ends)];
    const xs = Array.from({ length: CURVE }, (_, n) => low + ((high - low) * n) / (CURVE - 1));
    const density = ({ mean_mpa: mean, sd_mpa: sd }) => xs.map((x) => Math.exp(-0.5 * ((x - mean) / sd) ** 2));
    figure(box, "Young's modulus of each eye", "posterior", (svg) => {
      const plot = new Chart(svg, { x: xs, y: [0, 1.15], labels: ["E / MPa", "density, scaled"] });
      for (const [name, eye] of used) {
        plot.line(xs, density(eye));
        plot.add("text", { x: plot.left(eye.mean_mpa), y: plot.top(1) - 4, "text-anchor": "middle" }, name);
      }
    });
  }
  table(box, [["eye", ""], ["E / MPa", ""], ["± sd", ""], ["frames", ""], ["remark", "words"]], eyes.map(([name, eye]) => ({
    cells: [name, fixed(eye.mean_mpa, 3), fixed(eye.sd_mpa, 4), String(eye.updates ?? "–"), eye.status === "ok" ? "" : (eye.status ?? "")],
  })));
}

// ---- read

const halfOf = ({ interval_mn: [low, high] }) => Math.max((high - low) / 2, 1e-6);
const offOf = (frame) => frame.predicted_force_mn - frame.measured_force_mn;
// Frames of several planes have one answer for each moment: the first of them counts.
const momentOf = (frame) => (frame.plane ? `${frame.recording}@${frame.time_s}` : frame);
const moments = (frames) => {
  const found = new Map();
  for (const frame of frames) if (!found.has(momentOf(frame))) found.set(momentOf(frame), frame);
  return [...found.values()];
};
const compared = (frame) => frame.covered !== null;

// The frames with what their rows say more: the time, whether they count (`scored`), and whether interval and label agree (`covered`).
function judgedFrames({ frames }, rows) {
  const found = frames.map((frame, n) => ({ ...frame, time_s: rows[n].time_s, scored: rows[n].scored, covered: rows[n].covered }));
  const marks = new Map(moments(found).map((frame) => [momentOf(frame), markOfAnswer(frame)]));
  return found.map((frame) => ({ ...frame, mark: marks.get(momentOf(frame)) }));
}

function markOfAnswer(frame) {
  if (!frame.scored) return "none";
  const wrong = frame.predicted !== frame.target;
  const missed = frame.covered === false;
  return wrong && missed ? "both" : wrong ? "wrong" : missed ? "missed" : "right";
}

function legend(frames) {
  const items = Object.entries(MARKS).map(([kind, words]) => {
    const count = frames.filter(({ mark }) => mark === kind).length;
    return made("span", { "data-mark": kind }, markOf(kind), `${words}: ${count}`);
  });
  return made("p", { class: "legend" }, ...items);
}

async function answers(box, result, rows) {
  const csv = made("button", { type: "button", onclick: told(async () => download("answers.csv", "text/csv", (await get("csv")).text)) }, "CSV");
  const all = judgedFrames(result, rows);
  const each = moments(all);
  const judged = each.filter(compared);
  const off = result.mae_mn === null ? "" : `, ${fixed(result.mae_mn, 2)} mN off in the mean (${judged.length} labels)`;
  const held = result.coverage === null ? "" : `; 90 % interval and label agree in ${fixed(100 * result.coverage, 0)} %`;
  box.append(made("p", {}, `${all.length} frames${off}${held} `, csv), remarkList(result), legend(each));
  for (const name of new Set(all.map((frame) => frame.recording))) {
    if (!state.recordings.some((recording) => recording.name === name)) continue; // it is gone
    const { log } = await get("recording", { name });
    const mine = each.filter((frame) => frame.recording === name && frame.predicted_force_mn !== null);
    figure(box, `Force over time, ${name}`, `force-${name}`, (svg) => over(svg, mine, log));
  }
  if (judged.length > 2) figure(box, "Read minus measured", "residuals", (svg) => residuals(svg, judged));
  const rank = (frame) => (!frame.usable ? Infinity : compared(frame) ? Math.abs(offOf(frame)) / halfOf(frame) : 0);
  const sorted = [...all].sort((a, b) => rank(b) - rank(a)).slice(0, WORST);
  table(box, [["frame", ""], ["measured / mN", ""], ["read / mN", ""], ["90 %", ""], ["class", ""], ["remark", "words"]], sorted.map((frame) => {
    const [wrong, missed] = [["wrong", "both"].includes(frame.mark), ["missed", "both"].includes(frame.mark)];
    return {
      cells: [
        `${frame.recording}/${frame.file}`, fixed(frame.measured_force_mn, 1), fixed(frame.predicted_force_mn, 1),
        frame.interval_mn ? frame.interval_mn.map((end) => fixed(end, 1)).join(" to ") : "–", String(frame.predicted),
        [
          frame.usable ? "" : frame.reason, wrong ? `wrong class: the label is ${frame.target}` : "", missed ? "the interval misses the label" : "",
          frame.wall === "corrected" ? "wall: corrected" : "", frame.calibration ? "calibrated on" : "", frame.excluded ? `left out: ${frame.excluded}` : "",
        ].filter(Boolean).join("; "),
      ],
      kinds: { ...(missed ? { 3: "missed" } : {}), ...(wrong ? { 4: "wrong" } : {}) },
      mark: frame.mark,
      to: [frame.recording, frame.file],
    };
  }));
}

function over(svg, mine, log) {
  const x = [...mine.map((frame) => frame.time_s), ...(log?.time_s ?? [])];
  const y = [...mine.flatMap((frame) => frame.interval_mn), ...(log ? [...log.low, ...log.high] : [])];
  const plot = new Chart(svg, { x, y, labels: ["time / s", "force / mN"], zero: true });
  if (log) plot.band(log, "log");
  for (const frame of mine) {
    plot.bar(frame.time_s, ...frame.interval_mn, frame.covered === false ? "missed" : "");
    plot.mark(frame.time_s, frame.predicted_force_mn, frame.mark, `${frame.file}: ${fixed(frame.predicted_force_mn, 1)} mN, ${MARKS[frame.mark]}`);
  }
}

// Bland and Altman: differences over means, with the mean difference and 1.96 standard deviations about it.
function residuals(svg, judged) {
  const off = judged.map(offOf);
  const mean = off.reduce((sum, value) => sum + value, 0) / off.length;
  const sd = Math.sqrt(off.reduce((sum, value) => sum + (value - mean) ** 2, 0) / (off.length - 1));
  const middle = judged.map((frame) => (frame.predicted_force_mn + frame.measured_force_mn) / 2);
  const room = 0.03 * (Math.max(...middle) - Math.min(...middle)); // for the marks at both ends
  const x = [...middle, Math.min(...middle) - room, Math.max(...middle) + room];
  const plot = new Chart(svg, { x, y: [...off, mean - 2.2 * sd, mean + 2.2 * sd], labels: ["mean of both / mN", "read − measured / mN"], zero: true });
  plot.level(mean, `mean ${fixed(mean, 2)}`);
  plot.level(mean + 1.96 * sd, `+1.96 sd ${fixed(mean + 1.96 * sd, 2)}`);
  plot.level(mean - 1.96 * sd, `−1.96 sd ${fixed(mean - 1.96 * sd, 2)}`);
  judged.forEach((frame, n) => plot.mark(middle[n], off[n], frame.mark, `${frame.recording}/${frame.file}: ${MARKS[frame.mark]}`));
}
