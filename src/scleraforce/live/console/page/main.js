// The console's page. What is not known to be live is never shown as if it were.

import { makeGraph } from "./graph.js";
import { connect } from "./link.js";
import { clearNumbers, isHeld, showSettings, showState, showVerdict } from "./numbers.js";
import { makeReset } from "./reset.js";
import { makeScan } from "./scan.js";

const element = (id) => document.getElementById(id);
const scan = makeScan(element("scan"), element("scan-stamp"), element("frame"));
const graph = makeGraph(element("graph"), element("graph-stamp"));
const allowReset = makeReset();
const MONITORS = { ended: "The monitor has ended or died.", silent: "The monitor does not answer.", starting: "The monitor has said nothing yet." };
const THRIFT = ["", "fewer pictures: the machine is busy", "two pictures a second: the machine is busy"];
let settings = null;
let failed = false;
let live = false;

function loud(word, why) {
  live = false;
  showVerdict("LOST", word, `${why} Treat this as a withdrawal.`, "Nothing on this page is live.");
  clearNumbers();
  element("thrift").textContent = "";
  scan.look("NOT LIVE");
  graph.look("NOT LIVE");
  allowReset(false, false);
}

function state(message) {
  if (failed) return;
  if (message.monitor !== "answers") {
    loud("NO ANSWER", MONITORS[message.monitor]);
    return;
  }
  live = true;
  showState(message, settings);
  if (element("thrift").textContent !== THRIFT[message.thrift]) element("thrift").textContent = THRIFT[message.thrift];
  graph.look();
  graph.take(message);
  scan.look();
  allowReset(isHeld(message.state), true);
}

function hello(message) {
  settings = message;
  showSettings(message);
  scan.begin(message);
  graph.begin(message);
}

function fail() {
  failed = true;
  loud("NO ANSWER", "This page has failed: load it again.");
}

addEventListener("error", fail);
addEventListener("unhandledrejection", fail);
setInterval(() => live && scan.look(), 100);
loud("NO ANSWER", "The page has not reached the console's server yet.");
connect({ hello, state, picture: scan.take, lost: (why) => failed || loud("NO ANSWER", why) });
