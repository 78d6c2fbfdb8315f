// The live B-scan in its true proportions, with the outline of the wall and a scale bar.

const SURFACE = "#e69f00";
const INNER = "#56b4e9";
const STALE_MS = 700;

export function makeScan(canvas, stamp, frameLabel) {
  const context = canvas.getContext("2d");
  const pixels = document.createElement("canvas");
  let settings = null;
  let header = null;
  let shownAt = -Infinity;
  let waiting = null; // the newest picture, until the browser paints; a hidden page paints nothing and asks for no other

  function begin(told) {
    settings = told;
    header = null;
    const [lateral, depth] = told.pixel_mm;
    canvas.parentElement.style.setProperty("--aspect", (told.rows * depth) / (told.columns * lateral));
    draw();
  }

  function take(data, drawn) {
    if (!waiting) requestAnimationFrame(paint);
    waiting = { data, drawn, came: performance.now() };
  }

  function paint() {
    const { data, drawn, came } = waiting;
    waiting = null;
    const length = new DataView(data).getUint32(0, true);
    header = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
    const { rows, columns } = header;
    const grey = new Uint8Array(data, 4 + length);
    const image = new ImageData(columns, rows);
    const words = new Uint32Array(image.data.buffer);
    for (let at = 0; at < words.length; at++) words[at] = 0xff000000 | (grey[at] * 0x010101);
    if (pixels.width !== columns) pixels.width = columns;
    if (pixels.height !== rows) pixels.height = rows;
    pixels.getContext("2d").putImageData(image, 0, 0);
    shownAt = came;
    draw();
    drawn(header.frame);
  }

  function draw() {
    const ratio = devicePixelRatio;
    const [width, height] = [Math.round(canvas.clientWidth * ratio), Math.round(canvas.clientHeight * ratio)];
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    else context.clearRect(0, 0, width, height);
    if (!settings || !header) return;
    const [lateral, depth] = settings.pixel_mm;
    const width_mm = settings.columns * lateral;
    const height_mm = settings.rows * depth;
    const scale = Math.min(canvas.width / width_mm, canvas.height / height_mm);
    const left = (canvas.width - width_mm * scale) / 2;
    const top = (canvas.height - height_mm * scale) / 2;
    context.imageSmoothingQuality = "medium";
    context.drawImage(pixels, left, top, width_mm * scale, height_mm * scale);
    const place = (column, row) => [left + (column + 0.5) * lateral * scale, top + (row + 0.5) * depth * scale];
    if (header.outline) {
      context.save();
      context.beginPath();
      context.rect(left, top, width_mm * scale, height_mm * scale);
      context.clip();
      boundary(header.outline.outer, header.outline.step, place, SURFACE, []);
      boundary(header.outline.inner, header.outline.step, place, INNER, [7 * ratio, 5 * ratio]);
      context.restore();
    }
    bar(left, top + height_mm * scale, scale, width_mm, ratio);
  }

  function boundary(rows, step, place, colour, dash) {
    context.beginPath();
    let drawing = false;
    rows.forEach((row, index) => {
      if (row === null) {
        drawing = false;
        return;
      }
      const [x, y] = place(index * step, row);
      if (drawing) context.lineTo(x, y);
      else context.moveTo(x, y);
      drawing = true;
    });
    context.lineWidth = 2 * devicePixelRatio;
    context.setLineDash(dash);
    context.strokeStyle = colour;
    context.stroke();
    context.setLineDash([]);
  }

  function bar(left, bottom, scale, width_mm, ratio) {
    const length = [5, 2, 1, 0.5, 0.2, 0.1].find((value) => value <= width_mm / 6) ?? 0.1;
    const x = left + 14 * ratio;
    const y = bottom - 12 * ratio;
    context.fillStyle = "#fff";
    context.shadowColor = "#000";
    context.shadowBlur = 4 * ratio;
    context.fillRect(x, y, length * scale, 4 * ratio);
    context.font = `600 ${15 * ratio}px system-ui, "DejaVu Sans", sans-serif`;
    context.textAlign = "left";
    context.textBaseline = "alphabetic";
    context.fillText(`${length} mm`, x, y - 6 * ratio);
    context.shadowBlur = 0;
  }

  // Says how live the picture is; `why` where nothing can be.
  function look(why) {
    const stale = why ?? (performance.now() - shownAt > STALE_MS ? (header ? "NO NEW PICTURE" : "NO PICTURE YET") : "");
    if (stamp.textContent !== stale) stamp.textContent = stale;
    canvas.parentElement.toggleAttribute("data-stale", stale !== "");
    frameLabel.textContent = header && !stale ? `frame ${header.frame}${header.plane ? `, plane ${header.plane}` : ""}` : "";
  }

  new ResizeObserver(draw).observe(canvas.parentElement);
  return { begin, take, look };
}
