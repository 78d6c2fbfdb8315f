"use strict";
// Draws the deformed wall that stands in the page as JSON, with WebGL; nothing is fetched.
(() => {
  const scene = JSON.parse(document.getElementById("eye-scene").textContent);
  const canvas = document.getElementById("eye");
  const gl = canvas.getContext("webgl2", { antialias: true, preserveDrawingBuffer: true });
  if (!gl) {
    const fault = document.getElementById("eye-fault");
    fault.hidden = false;
    canvas.hidden = true;
    fault.textContent = "This browser offers no WebGL 2: the picture of the mesh shows the same eye.";
    return;
  }
  const VERTEX = `#version 300 es
    in vec3 position; in vec3 normal; in vec3 colour; uniform mat4 view; uniform mat3 turn; out vec3 shade;
    void main() {
      gl_Position = view * vec4(position, 1.0);
      vec3 n = normalize(turn * normal);
      float light = 0.55 + 0.5 * abs(dot(n, normalize(vec3(0.35, 0.45, 0.82))));
      shade = colour * light;
    }`;
  const FRAGMENT = `#version 300 es
    precision mediump float; in vec3 shade; out vec4 pixel;
    void main() { pixel = vec4(shade, 1.0); }`;
  const RED = [0.835, 0.369, 0], NEEDLE_MM = 8, NEEDLE_RADIUS_MM = 0.35, SIDES = 16;

  const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer;
  const scaled = (text, step) => Float32Array.from(new Int16Array(bytes(text)), (value) => value * step);

  function colourOf(share) {
    const place = Math.min(share, 1) * (scene.colours.length - 1), low = Math.floor(place);
    const high = Math.min(low + 1, scene.colours.length - 1);
    return [0, 1, 2].map((c) => (scene.colours[low][c] * (high - place || low === high)
      + scene.colours[high][c] * (low === high ? 0 : place - low)) / 255);
  }

  function wall(half) {
    const points = scaled(half.points, half.steps_mm[0]), moved = scaled(half.moved, half.steps_mm[1]);
    const colours = new Float32Array(points.length);
    for (let v = 0; v < points.length; v += 3) {
      const amount = Math.hypot(moved[v], moved[v + 1], moved[v + 2]);
      colours.set(colourOf(scene.highest_mm ? amount / scene.highest_mm : 0), v);
    }
    return { points, moved, colours, triangles: new Uint32Array(bytes(half.triangles)) };
  }

  function needle() {
    const { normal, contact_mm: contact, moved_mm: moved } = scene.needle;
    const other = Math.abs(normal[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0];
    const across = unit(cross(normal, other)), beside = cross(normal, across);
    const points = [], triangles = [];
    for (let side = 0; side < SIDES; side += 1) {
      const angle = 2 * Math.PI * side / SIDES, next = (side + 1) % SIDES;
      for (const length of [0, NEEDLE_MM]) {
        for (let c = 0; c < 3; c += 1) {
          points.push(contact[c] + length * normal[c]
            + NEEDLE_RADIUS_MM * (Math.cos(angle) * across[c] + Math.sin(angle) * beside[c]));
        }
      }
      triangles.push(2 * side, 2 * next, 2 * side + 1, 2 * side + 1, 2 * next, 2 * next + 1);
    }
    const count = points.length / 3, repeated = (value) => Float32Array.from({ length: 3 * count }, (_, n) => value[n % 3]);
    return { points: Float32Array.from(points), moved: repeated(moved), colours: repeated(RED),
      triangles: Uint32Array.from(triangles) };
  }

  function cross(a, b) {
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  }
  function unit(a) {
    const length = Math.hypot(...a) || 1;
    return a.map((value) => value / length);
  }

  // Normals of the deformed surface: the mean of the triangles at a vertex, by their area.
  function normals(places, triangles) {
    const sum = new Float32Array(places.length);
    for (let t = 0; t < triangles.length; t += 3) {
      const [a, b, c] = [3 * triangles[t], 3 * triangles[t + 1], 3 * triangles[t + 2]];
      const ab = [0, 1, 2].map((k) => places[b + k] - places[a + k]);
      const ac = [0, 1, 2].map((k) => places[c + k] - places[a + k]);
      const area = cross(ab, ac);
      for (const vertex of [a, b, c]) for (let k = 0; k < 3; k += 1) sum[vertex + k] += area[k];
    }
    return sum;
  }

  function loaded(shape) {
    const buffer = { count: shape.triangles.length, shape, vao: gl.createVertexArray(), of: {} };
    gl.bindVertexArray(buffer.vao);
    for (const name of ["position", "normal", "colour"]) {
      const place = gl.getAttribLocation(program, name);
      buffer.of[name] = gl.createBuffer();
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer.of[name]);
      gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(place, 3, gl.FLOAT, false, 0, 0);
    }
    gl.bufferData(gl.ARRAY_BUFFER, shape.colours, gl.STATIC_DRAW);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, shape.triangles, gl.STATIC_DRAW);
    return buffer;
  }

  const shapes = [...scene.halves.map(wall), needle()];
  let program, far, near, pin;
  function prepare() {
    program = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    gl.useProgram(program);
    gl.enable(gl.DEPTH_TEST);
    [far, near, pin] = shapes.map(loaded);
    deform();
  }

  const scale = document.getElementById("eye-scale"), whole = document.getElementById("eye-whole");
  let turned = (scene.needle.azimuth_deg - 78) * Math.PI / 180, raised = 22 * Math.PI / 180, zoom = 1;

  function deform() {
    const times = Number(scale.value);
    document.getElementById("eye-times").textContent = String(times);
    for (const { shape, of } of [far, near, pin]) {
      const places = shape.points.map((value, n) => value + times * shape.moved[n]);
      gl.bindBuffer(gl.ARRAY_BUFFER, of.position);
      gl.bufferData(gl.ARRAY_BUFFER, places, gl.DYNAMIC_DRAW);
      gl.bindBuffer(gl.ARRAY_BUFFER, of.normal);
      gl.bufferData(gl.ARRAY_BUFFER, normals(places, shape.triangles), gl.DYNAMIC_DRAW);
    }
    draw();
  }

  function draw() {
    const sharp = window.devicePixelRatio || 1;
    canvas.width = Math.max(1, Math.round(canvas.clientWidth * sharp));
    canvas.height = Math.max(1, Math.round(canvas.clientHeight * sharp));
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clearColor(1, 1, 1, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const [ct, st, cr, sr] = [Math.cos(turned), Math.sin(turned), Math.cos(raised), Math.sin(raised)];
    const right = [-st, ct, 0], towards = [cr * ct, cr * st, sr], up = [-sr * ct, -sr * st, cr];
    const radius = scene.radius_mm, wide = canvas.width / canvas.height;
    const height = 0.78 * radius / zoom * Math.max(1, 1.35 / wide), middle = [0, 0, 0.5 * radius];
    const axes = [[right, 1 / (height * wide)], [up, 1 / height], [towards, -1 / (4 * radius)]];
    const view = new Float32Array(16);
    axes.forEach(([axis, size], row) => {
      for (let c = 0; c < 3; c += 1) view[4 * c + row] = axis[c] * size;
      view[12 + row] = -size * axis.reduce((sum, value, c) => sum + value * middle[c], 0);
    });
    view[15] = 1;
    const turn = [right, up, towards];
    gl.uniformMatrix4fv(gl.getUniformLocation(program, "view"), false, view);
    gl.uniformMatrix3fv(gl.getUniformLocation(program, "turn"), false,
      Float32Array.from({ length: 9 }, (_, n) => turn[n % 3][Math.floor(n / 3)]));
    for (const part of whole.checked ? [far, near, pin] : [far, pin]) {
      gl.bindVertexArray(part.vao);
      gl.drawElements(gl.TRIANGLES, part.count, gl.UNSIGNED_INT, 0);
    }
  }

  function turnBy(sideways, upwards) {
    turned -= sideways;
    raised = Math.min(Math.max(raised + upwards, -Math.PI / 2), Math.PI / 2);
    draw();
  }
  function zoomBy(factor) {
    zoom = Math.min(Math.max(zoom * factor, 0.5), 12);
    draw();
  }

  canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
  canvas.addEventListener("pointermove", (event) => {
    if (event.buttons) turnBy(event.movementX / 150, event.movementY / 150);
  });
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    zoomBy(Math.exp(-event.deltaY / 600));
  }, { passive: false });
  const keys = { ArrowLeft: () => turnBy(-0.1, 0), ArrowRight: () => turnBy(0.1, 0), ArrowUp: () => turnBy(0, -0.1),
    ArrowDown: () => turnBy(0, 0.1), "+": () => zoomBy(1.2), "-": () => zoomBy(1 / 1.2) };
  canvas.addEventListener("keydown", (event) => {
    if (!(event.key in keys)) return;
    event.preventDefault();
    keys[event.key]();
  });
  scale.addEventListener("input", deform);
  whole.addEventListener("input", draw);
  window.addEventListener("resize", draw);
  // A graphics driver may take the context away, and give it back empty.
  canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
  canvas.addEventListener("webglcontextrestored", prepare);

  const stops = scene.colours.map((colour) => `rgb(${colour.join(",")})`).join(",");
  document.getElementById("eye-colours").style.background = `linear-gradient(to right, ${stops})`;
  document.getElementById("eye-highest").textContent = `${scene.highest_mm.toFixed(2)} mm`;
  prepare();
})();
