"use strict";
// Shows one frame of the recording whose frames stand in the page as JSON; nothing is fetched.
(() => {
  const { frames, classes, bounds_mn: bounds } = JSON.parse(document.getElementById("frames").textContent);
  const LEFT = 50, RIGHT = 990, TOP = 12, BOTTOM = 220, STEP_MS = 250, MOST_RINGS = 60;
  const at = (id) => document.getElementById(id);
  const known = (value) => value !== null && value !== undefined;
  const mn = (value) => `${value.toFixed(1)} mN`;
  let place = 0, playing = null;

  const top = Math.max(...bounds, 1, ...frames.flatMap((f) =>
    [f.measured_mn, ...(f.interval_mn || [])].filter(known))) * 1.08;
  const first = frames[0].time_s, seconds = frames[frames.length - 1].time_s - first || 1;
  const x = (frame) => LEFT + 15 + (RIGHT - LEFT - 30) * (frame.time_s - first) / seconds;
  const y = (force) => BOTTOM - (BOTTOM - TOP) * Math.max(force, 0) / top;

  function drawn(name, attributes, words) {
    const element = document.createElementNS("http://www.w3.org/2000/svg", name);
    for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
    if (words) element.textContent = words;
    at("curve").append(element);
    return element;
  }

  function drawCurve() {
    drawn("path", { class: "axis", d: `M${LEFT} ${TOP}V${BOTTOM}H${RIGHT}` });
    const step = [1, 2, 5, 10, 20, 50, 100].find((size) => top / size <= 6) || 200;
    for (let force = 0; force <= top; force += step) {
      drawn("text", { x: LEFT - 6, y: y(force) + 4, "text-anchor": "end" }, String(force));
    }
    drawn("text", { x: LEFT + 6, y: TOP + 6 }, "force [mN]");
    drawn("text", { x: LEFT + 15, y: BOTTOM + 18, "text-anchor": "middle" }, `${first.toFixed(1)} s`);
    drawn("text", { x: RIGHT - 15, y: BOTTOM + 18, "text-anchor": "end" }, `${(first + seconds).toFixed(1)} s`);
    for (const bound of bounds) drawn("path", { class: "bound", d: `M${LEFT} ${y(bound)}H${RIGHT}` });
    const measured = frames.filter((frame) => known(frame.measured_mn));
    if (measured.length > MOST_RINGS) {
      drawn("path", { class: "measured", d: `M${measured.map((f) => `${x(f)} ${y(f.measured_mn)}`).join("L")}` });
    }
    for (const frame of frames) {
      const kind = { class: `class-${frame.predicted}` };
      if (known(frame.measured_mn) && measured.length <= MOST_RINGS) {
        drawn("circle", { class: "measured", cx: x(frame), cy: y(frame.measured_mn), r: 6 });
      }
      if (frame.interval_mn) {
        const [low, high] = frame.interval_mn;
        drawn("path", { ...kind, d: `M${x(frame)} ${y(low)}V${y(high)}`, "stroke-width": 2 });
      }
      if (!frame.usable) drawn("text", { ...kind, x: x(frame), y: TOP + 10, "text-anchor": "middle" }, "×");
      else drawn("circle", { ...kind, cx: x(frame), cy: known(frame.read_mn) ? y(frame.read_mn) : BOTTOM - 6, r: 3 });
    }
  }

  function said(frame) {
    const rows = [["frame", `${frame.file}, ${place + 1} of ${frames.length}, ${frame.time_s.toFixed(3)} s`]];
    if (known(frame.read_mn) && frame.interval_mn) {
      const [low, high] = frame.interval_mn;
      rows.push(["read", `${mn(frame.read_mn)} (90 %: ${low.toFixed(1)} to ${mn(high)})`]);
    }
    rows.push(["measured", known(frame.measured_mn) ? `${mn(frame.measured_mn)}, ${classes[frame.target]}` : "not measured"]);
    if (!frame.usable) rows.push(["not usable", frame.reason || "no reason given"]);
    if (!frame.picture) rows.push(["picture", "left out: the recording is long"]);
    for (const remark of frame.remarks) rows.push(["remark", remark]);
    return rows;
  }

  function show(wanted) {
    place = Math.min(Math.max(wanted, 0), frames.length - 1);
    const frame = frames[place];
    if (frame.picture) at("picture").src = frame.picture;
    at("picture").hidden = !frame.picture;
    at("picture").alt = `frame ${frame.file} with the wall that was found`;
    at("place").value = place;
    at("verdict").className = `class-${frame.predicted}`;
    const highest = frame.predicted === classes.length - 1;
    const wrong = known(frame.target) && frame.target !== frame.predicted ? " (misread)" : "";
    at("verdict").textContent = `${classes[frame.predicted]}${highest ? ", withdraw" : ""}${wrong}`;
    at("said").replaceChildren(...said(frame).flatMap(([name, words]) => {
      const [term, definition] = [document.createElement("dt"), document.createElement("dd")];
      [term.textContent, definition.textContent] = [name, words];
      return [term, definition];
    }));
    cursor.setAttribute("d", `M${x(frame)} ${TOP}V${BOTTOM}`);
    try { history.replaceState(null, "", `#${place + 1}`); } catch { /* some browsers refuse it to files */ }
  }

  function play(on) {
    if (playing) clearInterval(playing);
    playing = on ? setInterval(() => place + 1 < frames.length ? show(place + 1) : play(false), STEP_MS) : null;
    at("play").textContent = on ? "stop" : "play";
  }

  const keys = {
    ArrowLeft: () => show(place - 1), ArrowRight: () => show(place + 1), PageUp: () => show(place - 10),
    PageDown: () => show(place + 10), Home: () => show(0), End: () => show(frames.length - 1), " ": () => play(!playing),
  };
  document.addEventListener("keydown", (event) => {
    if (!(event.key in keys) || event.ctrlKey || event.altKey || event.metaKey) return;
    if (event.key === " " && event.target.tagName === "BUTTON") return;
    event.preventDefault();
    keys[event.key]();
  });
  at("before").addEventListener("click", () => show(place - 1));
  at("next").addEventListener("click", () => show(place + 1));
  at("play").addEventListener("click", () => play(!playing));
  at("place").max = frames.length - 1;
  at("place").addEventListener("input", () => show(Number(at("place").value)));
  at("curve").addEventListener("click", (event) => {
    const box = at("curve").getBoundingClientRect();
    const wanted = (event.clientX - box.left) / box.width * 1000;
    const distances = frames.map((frame) => Math.abs(x(frame) - wanted));
    show(distances.indexOf(Math.min(...distances)));
  });

  drawCurve();
  const cursor = drawn("path", { class: "cursor" });
  show((Number(location.hash.slice(1)) || 1) - 1);
})();
