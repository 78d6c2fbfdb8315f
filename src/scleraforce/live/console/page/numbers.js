// State, class, force and rates as words and numbers.

const WORDS = { NOT_READY: "NOT READY", WATCHING: "WATCHING", PIERCED: "PIERCED", WITHDRAW: "WITHDRAW" };
const MARKS = ["M12 1a11 11 0 1 0 0 22a11 11 0 1 0 0-22z", "M2 2h20v20h-20z", "M12 1l11.5 21.5h-23z"];
const RESTS = { NOT_READY: "No frame can be judged yet. The robot must not push.", WATCHING: "Frames are read, in time, and harmless." };

const element = (id) => document.getElementById(id);

// Writes only what has changed: a screen reader says again what is written again.
function write(id, text) {
  const found = element(id);
  if (found.textContent !== text) found.textContent = text;
}

const fixed = (value, digits) => (typeof value === "number" ? value.toFixed(digits).replace("-", "−") : "–");

export function classBounds(predicted, bounds) {
  if (predicted === 0) return `below ${bounds[0]} mN`;
  if (predicted === bounds.length) return `above ${bounds[bounds.length - 1]} mN`;
  return `${bounds[predicted - 1]} to ${bounds[predicted]} mN`;
}

export function showSettings(settings) {
  write("model", settings.model);
  write("eye", settings.eye || "not said");
  write("version", settings.version);
  ofStart = settings.remarks;
  showRemarks(ofStart);
}

// What limits the readings of this eye, from the start on and by the second opinion: the most serious first, in one line until it is opened.
const SEVERITIES = ["doubt", "caution", "info"];
let ofStart = [];
let shownRemarks = "";

function showRemarks(remarks) {
  const text = JSON.stringify(remarks);
  if (text === shownRemarks) return;
  shownRemarks = text;
  const sorted = [...remarks].sort((one, other) => SEVERITIES.indexOf(one.severity) - SEVERITIES.indexOf(other.severity));
  element("remarks").hidden = sorted.length === 0;
  write("remark-count", sorted.length === 1 ? "1 remark" : `${sorted.length} remarks`);
  write("remark-first", sorted.length ? remarkText(sorted[0]) : "");
  element("remark-list").replaceChildren(...sorted.map(remarkRow));
}

const remarkText = ({ severity, about, words }) => `${severity}: ${about ? `${about}: ` : ""}${words}`;

function remarkRow(remark) {
  const row = document.createElement("li");
  row.textContent = remarkText(remark);
  return row;
}

export function showVerdict(view, word, sentence, detail, held = "") {
  if (document.body.dataset.view !== view) document.body.dataset.view = view;
  write("word", word);
  write("sentence", sentence);
  write("detail", detail);
  write("held", held);
  const title = `${word} – scleraforce monitor`;
  if (document.title !== title) document.title = title;
}

// Until the operator's reset.
export const isHeld = (state) => state === "WITHDRAW" || state === "PIERCED";

export function showState(message, settings) {
  const { state } = message;
  const held = isHeld(state);
  const now = held ? presentText(message) : RESTS[state];
  showVerdict(state, WORDS[state], now, message.detail, held ? heldText(message) : "");
  const pierced = { usable: false, reason: "the dent no longer tells the force" };
  showReading(message.pierced && message.reading ? { ...message.reading, ...pierced } : message.reading, settings);
  showRates(message);
}

// What is true now comes first; the cause of the withdrawal may be long over.
function presentText(message) {
  if (message.present) return `Now: ${message.present}`;
  if (message.detail) return "Now: the frames are not all harmless.";
  return "Now: the frames are harmless. The withdrawal is held until a reset.";
}

function heldText(message) {
  const since = message.withdrawn_s === null ? "" : ` since ${new Date(1e3 * message.withdrawn_s).toLocaleTimeString("en-GB")}`;
  return message.sentence === message.present ? `Held${since}.` : `Held${since}: ${message.sentence}`;
}

function showReading(reading, settings) {
  const usable = reading?.usable === true;
  const predicted = usable ? reading.class : null;
  write("class", predicted === null ? "–" : String(predicted));
  element("mark").setAttribute("d", predicted === null ? "" : MARKS[Math.min(predicted, MARKS.length - 1)]);
  write("class-bounds", predicted === null ? "" : classBounds(predicted, settings.class_bounds_mn));
  showShares(usable ? (reading.probabilities ?? []) : []);
  write("force", usable ? fixed(reading.force_mn, 1) : "–");
  write("interval", (reading?.plane ? `plane ${reading.plane}: ` : "") + intervalText(reading, usable, settings));
  showUntil(usable && reading.force_mn !== null ? reading : null);
  write("learned", learnedText(reading));
}

// The time until the bound: a bar that shrinks to nothing, full at 2 s, and its words. Without a rise both say so.
const HORIZON_MS = 2000;

function showUntil(reading) {
  const [early, late] = reading?.time_to_bound_ms_interval ?? [null, null];
  const median = reading?.time_to_bound_ms ?? null;
  const bar = element("until");
  bar.style.setProperty("--until", (median ?? HORIZON_MS) / HORIZON_MS);
  bar.style.setProperty("--early", (early ?? HORIZON_MS) / HORIZON_MS);
  bar.toggleAttribute("data-near", median !== null);
  write("until-text", reading ? untilText(early, median, late) : "–");
}

function untilText(early, median, late) {
  if (early === null) return "bound: not within 2 s";
  if (late === 0) return "the bound is reached";
  const ends = `90 % ${fixed(early / 1e3, 2)} to ${late === null ? "more than 2" : fixed(late / 1e3, 2)} s`;
  return median === null ? `bound: more than 2 s (${ends})` : `bound in ${fixed(median / 1e3, 2)} s (${ends})`;
}

function intervalText(reading, usable, settings) {
  if (!reading) return "no reading";
  if (!usable) return reading.reason ? `not judged: ${reading.reason}` : "the frame cannot be judged";
  if (!settings.reads_force) return "this model reads classes, not forces";
  const interval = reading.interval_mn;
  return interval ? `90 % interval ${fixed(interval[0], 1)} to ${fixed(interval[1], 1)} mN` : "no interval";
}

function learnedText(reading) {
  if (typeof reading?.modulus_mpa !== "number") return "";
  return `E ${fixed(reading.modulus_mpa, 3)} ± ${fixed(reading.modulus_sd_mpa, 3)} MPa, learned from ${reading.modulus_frames} frames`;
}

function showShares(shares) {
  const list = element("shares");
  while (list.children.length > shares.length) list.lastChild.remove();
  shares.forEach((share, index) => {
    const row = list.children[index] ?? list.appendChild(shareRow(index));
    row.children[1].style.setProperty("--share", share);
    row.children[2].textContent = `${Math.round(share * 100)} %`;
  });
}

function shareRow(index) {
  const row = document.createElement("li");
  for (const name of ["b", "i", "span"]) row.append(document.createElement(name));
  row.children[0].textContent = String(index);
  return row;
}

function showRates(message) {
  showRemarks([...ofStart, ...message.remarks]);
  write("rate", fixed(message.frames_per_second, 0));
  write("latency", fixed(message.latency_ms?.[0], 1));
  write("worst", fixed(message.latency_ms?.[1], 1));
  write("lost", fixed(message.lost, 0));
  write("clients", String(message.clients.length));
  write("who", message.clients.map((client) => `${client.role} ${client.address}`).join(", "));
}

// Nothing that could be taken for a live value.
export function clearNumbers() {
  showReading(null, null);
  for (const id of ["rate", "latency", "worst", "lost", "clients"]) write(id, "–");
  for (const id of ["interval", "who", "answer"]) write(id, "");
}
