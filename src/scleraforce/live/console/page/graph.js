// Force over the last 30 s: line, interval, bounds, withdrawals, and gaps where there was no reading.

const SPAN_S = 30;
const STEP_S = 0.04;
const SPAN = SPAN_S / STEP_S; // all times in here count steps
const [NUMBER, FORCE, LOW, HIGH, STATE] = [0, 1, 2, 3, 4];
const EVERY_MS = 60;

export function makeGraph(canvas, stamp) {
  const context = canvas.getContext("2d");
  let settings = null;
  let steps = [];
  let now = 0;
  let heard = 0;
  let drawn = 0;
  let asked = false; // whether the browser will call `tick`
  let frozen = true;
  let colours = {};

  function readColours() {
    const style = getComputedStyle(document.documentElement);
    const names = ["ink", "soft", "line", "blue", "red", "amber", "band", "over", "hatch", "card"];
    colours = Object.fromEntries(names.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
    const tile = document.createElement("canvas");
    tile.width = tile.height = 8;
    const pen = tile.getContext("2d");
    pen.strokeStyle = colours.hatch;
    pen.lineWidth = 1.2;
    pen.globalAlpha = 0.75;
    for (const shift of [-8, 0, 8]) {
      pen.moveTo(shift, 8);
      pen.lineTo(shift + 8, 0);
    }
    pen.stroke();
    colours.hatched = context.createPattern(tile, "repeat");
  }

  function begin(told) {
    settings = told;
    steps = [];
    frozen = true;
  }

  function take(message) {
    now = message.now;
    heard = performance.now();
    frozen = false;
    for (const step of message.steps) {
      while (steps.length && steps[steps.length - 1][NUMBER] >= step[NUMBER]) steps.pop();
      steps.push(step);
    }
    ask();
    const first = steps.findIndex((step) => step[NUMBER] >= now - SPAN - 50);
    if (first > 0) steps.splice(0, first);
  }

  function look(why) {
    frozen = Boolean(why);
    if (stamp.textContent !== (why ?? "")) stamp.textContent = why ?? "";
    canvas.parentElement.toggleAttribute("data-stale", frozen);
  }

  // The graph moves with each message, and only then; a hidden page paints nothing.
  function ask() {
    if (!asked) requestAnimationFrame(tick);
    asked = true;
  }

  function tick(at) {
    asked = false;
    if (frozen || at - drawn < EVERY_MS) return;
    drawn = at;
    draw();
  }

  function draw() {
    const ratio = devicePixelRatio;
    const width = canvas.clientWidth;
    const height = canvas.clientHeight;
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
    }
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    if (!settings || width < 120 || height < 80) return;
    const end = frozen ? now : now + (performance.now() - heard) / 1000 / STEP_S;
    const bound = settings.bound_mn;
    const shown = steps.filter((step) => step[FORCE] !== null && step[NUMBER] > end - SPAN);
    const highest = shown.reduce((most, step) => Math.max(most, step[HIGH] ?? step[FORCE]), bound * 1.3);
    const tick_mn = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000].find((value) => highest / value <= 6) ?? 5000;
    const frame = { left: 46, right: width - 8, top: 24, bottom: height - 24 };
    const x = (number) => frame.right - ((end - number) / SPAN) * (frame.right - frame.left);
    const y = (force_mn) => frame.bottom - (Math.max(force_mn, 0) / highest) * (frame.bottom - frame.top);
    const runs = unbroken(shown, settings.silence_s / STEP_S + 2);

    context.save();
    context.beginPath();
    context.rect(frame.left, frame.top, frame.right - frame.left, frame.bottom - frame.top);
    context.clip();
    gaps(runs, x, frame, end);
    context.fillStyle = colours.over;
    context.fillRect(frame.left, frame.top, frame.right - frame.left, y(bound) - frame.top);
    for (const run of runs) band(run, x, y);
    for (const run of runs) line(run, x, y);
    context.restore();

    axes(frame, x, y, end, highest, tick_mn);
    for (const bound_mn of settings.class_bounds_mn) if (bound_mn !== bound) rule(frame, y(bound_mn), colours.amber, [7, 5], 1.5);
    rule(frame, y(bound), colours.red, [], 2.5);
    label(`withdraw at ${bound} mN`, frame.left + 6, y(bound) - 6, colours.red, "left", 700);
    for (const bound_mn of settings.class_bounds_mn) {
      if (bound_mn !== bound) label(`${bound_mn} mN`, frame.left + 6, y(bound_mn) - 5, colours.amber, "left", 600);
    }
    withdrawals(x, frame, end);
  }

  // Runs of steps without a gap between them.
  function unbroken(shown, widest) {
    const runs = [];
    let last = -Infinity;
    for (const step of shown) {
      if (step[NUMBER] - last > widest) runs.push([]);
      runs[runs.length - 1].push(step);
      last = step[NUMBER];
    }
    return runs;
  }

  function gaps(runs, x, frame, end) {
    context.fillStyle = colours.hatched;
    let from = end - SPAN;
    const tolerated = settings.silence_s / STEP_S + 2;
    const fill = (until) => {
      if (until - from > tolerated) context.fillRect(x(from), frame.top, x(until) - x(from), frame.bottom - frame.top);
    };
    for (const run of runs) {
      fill(run[0][NUMBER]);
      from = run[run.length - 1][NUMBER];
    }
    fill(end);
  }

  function band(run, x, y) {
    const known = run.filter((step) => step[LOW] !== null);
    if (!known.length) return;
    context.beginPath();
    for (const step of known) context.lineTo(x(step[NUMBER] + 1), y(step[HIGH]));
    for (const step of known.reverse()) context.lineTo(x(step[NUMBER] + 1), y(step[LOW]));
    context.closePath();
    context.fillStyle = colours.band;
    context.fill();
  }

  function line(run, x, y) {
    context.beginPath();
    for (const step of run) context.lineTo(x(step[NUMBER] + 1), y(step[FORCE]));
    context.lineWidth = 2.5;
    context.lineJoin = "round";
    context.strokeStyle = colours.blue;
    context.stroke();
  }

  function axes(frame, x, y, end, highest, tick_mn) {
    for (let force_mn = 0; force_mn <= highest; force_mn += tick_mn) {
      rule(frame, y(force_mn), colours.line, [], 1);
      label(String(force_mn), frame.left - 7, y(force_mn) + 5, colours.soft, "right", 400);
    }
    const every = frame.right - frame.left < 480 ? 10 : 5;
    for (let second = 0; second <= SPAN_S; second += every) {
      const at = x(end - second / STEP_S);
      const side = second === 0 ? "right" : second === SPAN_S ? "left" : "center";
      label(second ? `−${second} s` : "now", at, frame.bottom + 18, colours.soft, side, 400);
    }
    label("mN", frame.left - 7, frame.top - 9, colours.soft, "right", 400);
  }

  function rule(frame, at, colour, dash, thickness) {
    context.beginPath();
    context.moveTo(frame.left, at);
    context.lineTo(frame.right, at);
    context.setLineDash(dash);
    context.lineWidth = thickness;
    context.strokeStyle = colour;
    context.stroke();
    context.setLineDash([]);
  }

  function label(text, x, y, colour, align, weight) {
    context.font = `${weight} 14px system-ui, "DejaVu Sans", sans-serif`;
    context.textAlign = align;
    context.textBaseline = "alphabetic";
    context.lineWidth = 4;
    context.strokeStyle = colours.card;
    context.lineJoin = "round";
    context.strokeText(text, x, y);
    context.fillStyle = colour;
    context.fillText(text, x, y);
  }

  // A mark where a withdrawal began, and a bar above the graph for as long as it lasted.
  function withdrawals(x, frame, end) {
    context.fillStyle = context.strokeStyle = colours.red;
    steps.forEach((step, index) => {
      if (step[STATE] !== "WITHDRAW") return;
      const next = steps[index + 1];
      const from = Math.max(x(step[NUMBER]), frame.left);
      const until = Math.min(x(next ? next[NUMBER] : end), frame.right);
      if (until > from) context.fillRect(from, frame.top - 5, until - from + 0.5, 5);
      if (steps[index - 1]?.[STATE] === "WITHDRAW" || x(step[NUMBER]) < frame.left) return;
      context.lineWidth = 2;
      context.beginPath();
      context.moveTo(from, frame.top);
      context.lineTo(from, frame.bottom);
      context.stroke();
      context.beginPath();
      context.moveTo(from - 9, frame.top - 18);
      context.lineTo(from + 9, frame.top - 18);
      context.lineTo(from, frame.top - 3);
      context.fill();
    });
  }

  readColours();
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
    readColours();
    draw();
  });
  new ResizeObserver(draw).observe(canvas.parentElement);
  return { begin, take, look };
}
