// What the folder holds, the step that is shown, and the command that runs. Each section of the page registers itself, and is called
// back to be filled and shown.

import { get } from "./api.js";
import { element, made, tell, told, write } from "./dom.js";
import { remarkItems } from "./remarks.js";

const SECTIONS = { import: "import", look: "frames", correct: "frames", calibrate: "calibrate", read: "read" };
// `read`: model, calibration and recordings of the last reading, null without one.
export const state = { recordings: [], calibrations: [], models: [], sources: [], read: null, job: null, writes: false };
const sections = [];
let known = "";
let awaited = null;

// Adds a section: `fill()` when the folder holds something else, `show(step, ...place)` at each step.
export const register = (section) => sections.push(section);

// Shows a step, of frames with a recording and a frame's name.
export function go(step, ...place) {
  for (const id of new Set(Object.values(SECTIONS))) element(id).hidden = SECTIONS[step] !== id;
  for (const button of document.querySelectorAll("[data-step]")) {
    if (button.dataset.step === step) button.setAttribute("aria-current", "step");
    else button.removeAttribute("aria-current");
  }
  document.body.dataset.step = step;
  tell(null);
  for (const section of sections) section.show(step, ...place);
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
    for (const section of sections) section.fill();
  }
  if (wrote !== state.writes && document.body.dataset.step === "correct") go("correct");
  showJob();
}

function showJob() {
  const { job } = state;
  element("job").hidden = !job || job.done;
  if (!job) return;
  write("job-title", job.title || job.command.split(" ")[1]);
  element("job-share").value = job.share;
  write("job-percent", `${Math.round(100 * job.share)} %`);
  if (element("job-notes").childElementCount !== job.notes.length) element("job-notes").replaceChildren(...remarkItems({ notes: job.notes }));
  if (!job.done || awaited?.job !== job.number) return;
  const { then } = awaited;
  awaited = null;
  if (job.fault) tell(job.fault);
  else void then();
}

export const choice = (entry, text) => made("option", { value: entry }, text ?? entry);
