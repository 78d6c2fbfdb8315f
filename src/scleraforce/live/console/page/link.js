// The socket to the console's server: it says at once when it has gone, and comes back by itself.

const SILENT_MS = 500; // without a message, after which nothing that is shown is live
const GIVEN_UP_MS = 2000; // then another connection is tried
const AGAIN_MS = 250;

export function connect({ hello, state, picture, lost }) {
  let socket = null;
  let heard = 0;
  let opened = 0;
  let live = false;

  function open() {
    const mine = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/live`);
    mine.binaryType = "arraybuffer";
    opened = performance.now();
    socket = mine;
    mine.onmessage = (event) => mine === socket && take(event.data);
    mine.onclose = () => mine === socket && leave();
  }

  function take(data) {
    if (typeof data !== "string") {
      const from = socket;
      picture(data, (drawn) => from === socket && from.send(JSON.stringify({ drawn })));
      return;
    }
    heard = performance.now();
    const message = JSON.parse(data);
    if (message.kind === "hello") {
      hello(message);
      return;
    }
    socket.send(JSON.stringify({ seen: message.number }));
    live = true;
    state(message);
  }

  function leave() {
    socket = null;
    say("The page has lost the connection to the console's server.");
    setTimeout(open, AGAIN_MS);
  }

  function say(why) {
    live = false;
    lost(why);
  }

  function watch() {
    const now = performance.now();
    if (live && now - heard > SILENT_MS) say("The console's server does not answer.");
    if (socket && now - Math.max(heard, opened) > GIVEN_UP_MS) {
      const old = socket;
      leave();
      old.close();
    }
  }

  setInterval(watch, 50);
  document.addEventListener("visibilitychange", watch);
  open();
}
