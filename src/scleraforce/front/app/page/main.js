// The page: its steps, the command that runs, and what the folder holds.

import { erase, get } from "./api.js";
import { element, made, tell, told, write } from "./dom.js";
import * as frames from "./frames.js";
import * as importing from "./importing.js";
import * as results from "./results.js";

const EVERY_MS = 1000;
const SECTIONS = { import: "import", look: "frames", correct: "frames", calibrate: "calibrate", read: "read" };
export const state = { recordings: [], calibrations: [], models: [], sources: [], job: null, writes: false };
let known = "";
let awaited = null;

// Shows a step, of frames with a recording and a frame's name.
export function go(step, ...place) {
  for (const id of new Set(Object.values(SECTIONS))) element(id).hidden = SECTIONS[step] !== id;
  for (const button of document.querySelectorAll("[data-step]")) {
    if (button.dataset.step === step) button.setAttribute("aria-current", "step");
    else button.removeAttribute("aria-current");
  }
  document.body.dataset.step = step;
  tell(null);
  frames.pause();
  if (SECTIONS[step] === "frames") frames.show(step === "correct", ...place);
  if (step === "import") importing.show();
  if (step === "calibrate" || step === "read") results.show(step);
}

// Calls back when the command that was just started has ended without a fault.
export function await_({ job }, then) {
  awaited = { job, then: told(then) };
  void poll();
}

export async function poll() {
  const wrote = state.writes;
  try {
    Object.assign(state, await get("state"));
  } catch (fault) {
    tell(fault);
    return;
  }
  element("read-only").hidden = state.writes;
  for (const button of document.querySelectorAll(".main, #undo, #redo, #unseen, #restore")) button.disabled = !state.writes;
  write("folder", state.folder);
  const now = JSON.stringify([state.recordings, state.calibrations, state.models, state.sources]);
  if (now !== known) {
    known = now;
    fill();
  }
  if (wrote !== state.writes && document.body.dataset.step === "correct") go("correct");
  showJob();
}

function fill() {
  frames.fill(state.recordings);
  importing.fill(state.sources);
  results.fill(state);
}

function showJob() {
  const { job } = state;
  element("job").hidden = !job || job.done;
  if (!job) return;
  write("job-title", job.title || job.command.split(" ")[1]);
  element("job-share").value = job.share;
  write("job-percent", `${Math.round(100 * job.share)} %`);
  if (!job.done || awaited?.job !== job.number) return;
  const { then } = awaited;
  awaited = null;
  if (job.fault) tell(job.fault);
  else void then();
}

for (const button of document.querySelectorAll("[data-step]")) button.onclick = () => go(button.dataset.step);
for (const button of document.querySelectorAll(".copy")) {
  button.onclick = () => navigator.clipboard.writeText(element(button.dataset.of).textContent);
}
element("job-stop").onclick = told(() => erase("run"));

export const choice = (entry, text) => made("option", { value: entry }, text ?? entry);

for (const kind of ["dragover", "drop"]) addEventListener(kind, (event) => event.preventDefault()); // a file beside the field

await poll();
if (!document.body.dataset.step) go(state.recordings.length ? "look" : "import"); // a step may be clicked already
const later = () => setTimeout(() => void poll().then(later), EVERY_MS); // one at a time, in folders of many files
later();
