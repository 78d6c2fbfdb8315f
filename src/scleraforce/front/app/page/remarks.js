// Remarks of the program on an import, a calibration or an answer, the most serious ones first; notes have no severity.

import { made } from "./dom.js";

const SEVERITIES = ["doubt", "caution", "info"];
const sentence = ({ about, words }) => (about ? `${about}: ${words}` : words);

// The items of a list, each sentence once. `notes` are sentences, which remarks may repeat.
export function remarkItems({ remarks = [], notes = [] }) {
  const sorted = [...remarks].sort((a, b) => SEVERITIES.indexOf(a.severity) - SEVERITIES.indexOf(b.severity));
  const said = new Map(sorted.map((remark) => [sentence(remark), remark.severity]));
  for (const note of notes) if (!said.has(note)) said.set(note, "");
  return [...said].map(([words, severity]) => made("li", { class: severity }, ...(severity ? [made("span", { class: "severity" }, severity), " "] : []), words));
}

export const remarkList = (found) => made("ul", { class: "notes" }, ...remarkItems(found));
