// Calibrate and read: what is run, and its results as plots and tables.

import { get, send } from "./api.js";
import { Chart, svgText } from "./chart.js";
import { download, element, fixed, made, told, write } from "./dom.js";
import { await_, choice, go, state } from "./state.js";

const CURVE = 121; // points of a density
const WORST = 200; // rows of the table
const NINETY = 1.645; // standard deviations of a 90 % interval

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
const SHOWN = { calibrate: calibrated, read: answers };

// Shows the last result of this folder, also after a reload.
const last = told(async (step) => {
  const found = await get("result", { command: step === "read" ? "evaluate" : step });
  if (!found) return;
  const box = element(`${step}-result`);
  box.replaceChildren(made("p", { class: "soft" }, `${found.time_utc.slice(0, 16).replace("T", " ")} UTC: ${found.command}`));
  await SHOWN[step](box, found.result);
});

export const show = (step) => element(`${step}-result`).childElementCount || last(step);

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

function table(box, heads, rows) {
  const head = made("tr", {}, ...heads.map(([text, kind]) => made("th", { class: kind }, text)));
  const body = rows.map(({ cells, kind, to }) => {
    const [first, ...others] = cells;
    const start = to ? made("button", { type: "button", class: "go" }, first) : first;
    return made("tr", { class: kind, "data-go": Boolean(to), onclick: to ? () => go("look", ...to) : null },
      ...[start, ...others].map((inside, n) => made("td", { class: heads[n][1] }, inside)));
  });
  box.append(made("div", { class: "table" }, made("table", {}, made("thead", {}, head), made("tbody", {}, ...body))));
}

// ---- calibrate

function calibrated(box, result) {
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
  box.append(made("ul", { class: "notes" }, ...(result.notes ?? []).map((text) => made("li", {}, text))));
}

// ---- read

const halfOf = ({ interval_mn: [low, high] }) => Math.max((high - low) / 2, 1e-6);
const offOf = (frame) => frame.predicted_force_mn - frame.measured_force_mn;
const spread = ({ measured_force_sd_mn: sd }) => NINETY * (sd ?? 0);
// The frames, one for each moment: those of several planes have one answer.
const moments = (frames) => [...new Map(frames.map((frame) => [frame.plane ? `${frame.recording}@${frame.time_s}` : frame, frame])).values()];
const compared = (frame) => frame.usable && frame.predicted_force_mn !== null && frame.measured_force_mn !== null && !frame.calibration;
// The label has an error of its own, which adds to the interval's half width in squares.
const outside = (frame) => {
  if (!compared(frame)) return false;
  const off = offOf(frame);
  const half = off > 0 ? frame.predicted_force_mn - frame.interval_mn[0] : frame.interval_mn[1] - frame.predicted_force_mn;
  return Math.abs(off) > Math.hypot(half, spread(frame));
};

async function answers(box, result) {
  const csv = made("button", { type: "button", onclick: told(async () => download("answers.csv", "text/csv", (await get("csv")).text)) }, "CSV");
  const judged = moments(result.frames).filter(compared);
  const off = result.mae_mn === null ? "" : `, ${fixed(result.mae_mn, 2)} mN off in the mean (${judged.length} labels)`;
  const held = result.coverage === null ? "" : `; 90 % interval and label agree in ${fixed(100 * result.coverage, 0)} %`;
  box.append(made("p", {}, `${result.frames.length} frames${off}${held} `, csv));
  for (const name of new Set(result.frames.map((frame) => frame.recording))) {
    if (!state.recordings.some((recording) => recording.name === name)) continue; // it is gone
    const { log, files, time_s: times } = await get("recording", { name });
    const at = new Map(files.map((file, n) => [file, times[n]]));
    const mine = moments(result.frames).filter((frame) => frame.recording === name && frame.predicted_force_mn !== null);
    figure(box, `Force over time, ${name}`, `force-${name}`, (svg) => over(svg, mine, at, log));
  }
  if (judged.length > 2) figure(box, "Read minus measured", "residuals", (svg) => residuals(svg, judged));
  const rank = (frame) => (!frame.usable ? Infinity : compared(frame) ? Math.abs(offOf(frame)) / halfOf(frame) : 0);
  const sorted = [...result.frames].sort((a, b) => rank(b) - rank(a)).slice(0, WORST);
  table(box, [["frame", ""], ["measured / mN", ""], ["read / mN", ""], ["90 %", ""], ["class", ""], ["remark", "words"]], sorted.map((frame) => ({
    cells: [
      `${frame.recording}/${frame.file}`, fixed(frame.measured_force_mn, 1), fixed(frame.predicted_force_mn, 1),
      frame.interval_mn ? frame.interval_mn.map((end) => fixed(end, 1)).join(" to ") : "–", String(frame.predicted),
      [frame.usable ? "" : frame.reason, frame.wall === "corrected" ? "wall: corrected" : "", frame.calibration ? "calibrated on" : ""].filter(Boolean).join("; "),
    ],
    kind: !frame.usable || outside(frame) ? "bad" : "",
    to: [frame.recording, frame.file],
  })));
  box.append(made("ul", { class: "notes" }, ...(result.notes ?? []).map((text) => made("li", {}, text))));
}

function over(svg, mine, at, log) {
  const x = [...mine.map((frame) => at.get(frame.file)), ...(log?.time_s ?? [])];
  const y = [...mine.flatMap((frame) => frame.interval_mn), ...(log ? [...log.low, ...log.high] : [])];
  const plot = new Chart(svg, { x, y, labels: ["time / s", "force / mN"], zero: true });
  if (log) plot.band(log, "log");
  for (const frame of mine) {
    const kind = outside(frame) ? "bad" : "";
    plot.bar(at.get(frame.file), ...frame.interval_mn, kind);
    plot.dot(at.get(frame.file), frame.predicted_force_mn, kind, `${frame.file}: ${fixed(frame.predicted_force_mn, 1)} mN`);
  }
}

// Bland and Altman: differences over means, with the mean difference and 1.96 standard deviations about it.
function residuals(svg, judged) {
  const off = judged.map(offOf);
  const mean = off.reduce((sum, value) => sum + value, 0) / off.length;
  const sd = Math.sqrt(off.reduce((sum, value) => sum + (value - mean) ** 2, 0) / (off.length - 1));
  const middle = judged.map((frame) => (frame.predicted_force_mn + frame.measured_force_mn) / 2);
  const plot = new Chart(svg, { x: middle, y: [...off, mean - 2.2 * sd, mean + 2.2 * sd], labels: ["mean of both / mN", "read − measured / mN"], zero: true });
  plot.level(mean, `mean ${fixed(mean, 2)}`);
  plot.level(mean + 1.96 * sd, `+1.96 sd ${fixed(mean + 1.96 * sd, 2)}`);
  plot.level(mean - 1.96 * sd, `−1.96 sd ${fixed(mean - 1.96 * sd, 2)}`);
  judged.forEach((frame, n) => plot.dot(middle[n], off[n], outside(frame) ? "bad" : "", `${frame.recording}/${frame.file}`));
}
