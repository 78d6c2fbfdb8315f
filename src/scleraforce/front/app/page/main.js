// The page: its sections and steps.

import { erase } from "./api.js";
import { element, told } from "./dom.js";
import * as frames from "./frames.js";
import * as importing from "./importing.js";
import * as results from "./results.js";
import { go, poll, register, state } from "./state.js";

const EVERY_MS = 1000;

register({
  fill: () => frames.fill(state.recordings),
  show(step, ...place) {
    frames.pause();
    if (step === "look" || step === "correct") frames.show(step === "correct", ...place);
  },
});
register({ fill: () => importing.fill(state.sources), show: (step) => step === "import" && importing.show() });
register({
  fill: () => results.fill(state),
  show: (step) => (step === "calibrate" || step === "read") && results.show(step),
});

for (const button of document.querySelectorAll("[data-step]")) button.onclick = () => go(button.dataset.step);
for (const button of document.querySelectorAll(".copy")) {
  button.onclick = () => navigator.clipboard.writeText(element(button.dataset.of).textContent);
}
element("job-stop").onclick = told(() => erase("run"));

for (const kind of ["dragover", "drop"]) addEventListener(kind, (event) => event.preventDefault()); // a file beside the field

await poll();
if (!document.body.dataset.step) go(state.recordings.length ? "look" : "import"); // a step may be clicked already
const later = () => setTimeout(() => void poll().then(later), EVERY_MS); // one at a time, in folders of many files
later();
