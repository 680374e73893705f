// Line chart: axes, grid, a line per run, values at the pointer.
const WIDTH = 440, HEIGHT = 250, LEFT = 44, RIGHT = 12, TOP = 10, BOTTOM = 34;

function svg(name, attributes = {}, text = null) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  if (text !== null) element.textContent = text;
  return element;
}

function html(name, properties = {}, ...children) {
  const element = Object.assign(document.createElement(name), properties);
  element.append(...children);
  return element;
}

function ticks(end, wanted = 5) {
  const raw = end / wanted;
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 2.5, 5, 10].map((m) => m * power).find((s) => s >= raw * 0.999);
  const count = Math.floor(end / step + 1e-6);
  return Array.from({ length: count + 1 }, (_, k) => k * step);
}

const short = (value) => String(Number(value.toPrecision(3)));

// `series`: [{name, colour, dashed, points: [[x, y], ...]}] with x ascending.
function lineChart({ title, unit, xLabel, xEnd, yEnd, series, read }) {
  const figure = html("figure", { className: "chart" });
  figure.append(html("figcaption", {}, title, html("span", {}, unit ? ` ${unit}` : "")));
  const x = (value) => LEFT + (WIDTH - LEFT - RIGHT) * value / xEnd;
  const y = (value) => HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * value / yEnd;
  const drawing = svg("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": `${title} over ${xLabel}: ${series.map((s) => s.name).join(", ")}` });
  for (const tick of ticks(yEnd)) {
    drawing.append(svg("line", { class: "grid", x1: LEFT, x2: WIDTH - RIGHT, y1: y(tick), y2: y(tick) }));
    drawing.append(svg("text", { x: LEFT - 6, y: y(tick) + 4, "text-anchor": "end" }, short(tick)));
  }
  for (const tick of ticks(xEnd)) {
    drawing.append(svg("text", { x: x(tick), y: HEIGHT - BOTTOM + 15, "text-anchor": "middle" }, short(tick)));
  }
  drawing.append(svg("line", { class: "axis", x1: LEFT, x2: WIDTH - RIGHT, y1: y(0), y2: y(0) }));
  drawing.append(svg("text", { x: (LEFT + WIDTH - RIGHT) / 2, y: HEIGHT - 4, "text-anchor": "middle" }, xLabel));
  for (const one of series) {
    const points = one.points.filter(([a]) => a <= xEnd);
    if (points.length < one.points.length) points.push([xEnd, valueAt(one.points, xEnd)]);
    const inside = points.map(([a, b]) => `${x(a).toFixed(1)},${y(Math.min(Math.max(b, 0), yEnd)).toFixed(1)}`);
    drawing.append(svg("polyline", { class: "curve", points: inside.join(" "), stroke: one.colour, "stroke-dasharray": one.dashed ? "5 4" : "none" }));
  }
  figure.append(drawing);
  followPointer(figure, drawing, { x, xEnd, series, xLabel, read });
  return figure;
}

function followPointer(figure, drawing, { x, xEnd, series, xLabel, read }) {
  const cross = svg("line", { class: "cross", y1: TOP, y2: HEIGHT - BOTTOM, visibility: "hidden" });
  const readout = html("div", { className: "readout", hidden: true });
  drawing.append(cross);
  figure.append(readout);
  drawing.addEventListener("pointermove", (event) => {
    const box = drawing.getBoundingClientRect();
    const at = ((event.clientX - box.left) / box.width * WIDTH - LEFT) / (WIDTH - LEFT - RIGHT) * xEnd;
    const outside = at < 0 || at > xEnd;
    readout.hidden = outside;
    cross.setAttribute("visibility", outside ? "hidden" : "visible");
    if (outside) return;
    cross.setAttribute("x1", x(at));
    cross.setAttribute("x2", x(at));
    const lines = series.map((one) => {
      const dot = html("span", { className: "dot" });
      dot.style.setProperty("--c", one.colour);
      return html("div", {}, dot, one.name, html("b", {}, read(valueAt(one.points, at))));
    });
    readout.replaceChildren(`${xLabel} ${at.toFixed(2)}`, ...lines);
  });
  drawing.addEventListener("pointerleave", () => {
    readout.hidden = true;
    cross.setAttribute("visibility", "hidden");
  });
}

// Linear interpolation; null outside the measured range.
function valueAt(points, at) {
  const next = points.findIndex(([a]) => a >= at);
  if (next < 0 || (next === 0 && points[0][0] > at + 1e-9)) return null;
  if (next === 0) return points[0][1];
  const [[a, b], [c, d]] = [points[next - 1], points[next]];
  return c === a ? d : b + (d - b) * (at - a) / (c - a);
}
