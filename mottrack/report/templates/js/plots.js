// Recall curves, distributions of velocity error, error types.
const PANELS = [
  { key: "mota", title: "MOTA" },
  { key: "precision", title: "precision" },
  { key: "motp", title: "mean distance of matches", unit: "m" },
  { key: "ids", title: "identity switches" },
];
const FAMILIES = [
  { name: "misses", colour: "miss", kinds: ["late start", "gap", "early end", "never found"] },
  { name: "false positives", colour: "fp", kinds: ["duplicate", "wrong class", "near miss", "background"] },
  { name: "identity switches", colour: "switch", kinds: ["swap", "take-over", "re-identification"] },
];
const MAX_DISTRIBUTIONS = 6; // the velocity categories without those by class

class Plots {
  constructor(runs) {
    this.runs = runs.map((run, index) => ({ ...run, index }));
    this.hidden = new Set();
    this.curveClass = chooser("curve-class", this.classes("curves"), () => this.drawCurves());
    this.errorClass = chooser("error-class", ["all classes", ...this.classes("error_classes")], () => this.drawErrors());
    for (const holder of document.querySelectorAll("[data-run-switches]")) this.fillSwitches(holder);
    theme.listeners.push(() => this.draw());
    this.draw();
  }

  get shown() { return this.runs.filter((run) => !this.hidden.has(run.index)); }

  classes(part) {
    const names = new Set(this.runs.flatMap((run) => Object.keys(run[part])));
    const boxes = (name) => Math.max(...this.runs.map((run) => run.truth[name] ?? 0));
    return [...names].sort((a, b) => boxes(b) - boxes(a)); // the class with most true boxes first
  }

  fillSwitches(holder) {
    for (const run of this.runs) {
      const dot = html("span", { className: "dot" });
      dot.style.setProperty("--c", `var(--run-${run.colour})`);
      const button = html("button", { type: "button", className: "chip" }, dot, run.title);
      button.dataset.run = run.index;
      button.addEventListener("click", () => {
        this.hidden.has(run.index) ? this.hidden.delete(run.index) : this.hidden.add(run.index);
        this.draw();
      });
      holder.append(button);
    }
  }

  draw() {
    for (const button of document.querySelectorAll("[data-run-switches] button")) {
      button.setAttribute("aria-pressed", String(!this.hidden.has(Number(button.dataset.run))));
    }
    this.drawCurves();
    this.drawDistributions();
    this.drawErrors();
  }

  line(run, points) {
    return { name: run.title, colour: runColour(run.colour), dashed: run.oracle, points };
  }

  drawCurves() {
    const holder = document.getElementById("curves");
    if (!holder) return;
    holder.replaceChildren(...PANELS.map(({ key, title, unit }) => {
      const series = this.shown.filter((run) => run.curves[this.curveClass.value]).map((run) => {
        const curve = run.curves[this.curveClass.value];
        const points = curve.requested.map((x, k) => [x, curve[key][k]]).filter(([, y]) => y !== null);
        return this.line(run, points);
      });
      const least = key === "ids" ? 1 : 1e-3;  // a count of none needs no axis of fractions
      const top = Math.max(...series.flatMap((s) => s.points.map(([, y]) => y)), least);
      const yEnd = key === "mota" || key === "precision" ? 1 : top * 1.08;
      return lineChart({ title, unit, xLabel: "requested recall", xEnd: 1, yEnd, series, read: number });
    }));
  }

  drawDistributions() {
    const holder = document.getElementById("distributions");
    if (!holder) return;
    const names = [...new Set(this.runs.flatMap((run) => Object.keys(run.velocity)))];
    holder.replaceChildren(...names.slice(0, MAX_DISTRIBUTIONS).map((name) => {
      const have = this.shown.filter((run) => run.velocity[name]);
      const xEnd = Math.max(...have.map((run) => run.velocity[name][90]), 0.5); // up to the 90th percentile
      const series = have.map((run) => this.line(run, run.velocity[name].map((error, k) => [error, k / 100])));
      return lineChart({ title: name, xLabel: "velocity error, m/s", xEnd, yEnd: 1, series, read: share });
    }));
  }

  drawErrors() {
    const holder = document.getElementById("error-plots");
    if (!holder) return;
    holder.replaceChildren(...FAMILIES.map((family) => this.family(family)));
  }

  family({ name, colour, kinds }) {
    const rows = this.runs.map((run) => ({ run, counts: kinds.map((kind) => this.count(run, kind)) }));
    const longest = Math.max(...rows.map(({ counts }) => counts.reduce((a, b) => a + b, 0)), 1);
    const part = (count, k) => {
      const bar = html("i", { title: `${kinds[k]}: ${count}` });
      bar.style.width = `${100 * count / longest}%`;
      bar.style.background = `var(--${colour}-${k})`;
      return bar;
    };
    const lines = rows.map(({ run, counts }) => {
      const words = kinds.map((kind, k) => `${kind} ${counts[k]}`).join(", ");
      const stack = html("span", { className: "stack" }, ...counts.map(part));
      stack.setAttribute("role", "img");
      stack.setAttribute("aria-label", `${run.title}: ${words}`);
      const sum = String(counts.reduce((a, b) => a + b, 0));
      const who = html("span", { className: "who", title: run.title }, run.title);
      return html("div", { className: "stack-row" }, who, stack, html("span", { className: "sum" }, sum));
    });
    const keys = kinds.map((kind, k) => {
      const swatch = html("i");
      swatch.style.background = `var(--${colour}-${k})`;
      return html("span", {}, swatch, kind);
    });
    return html("div", {}, html("h3", {}, name), ...lines, html("div", { className: "keys" }, ...keys));
  }

  count(run, kind) {
    const wanted = this.errorClass.value;
    const parts = wanted === "all classes" ? Object.values(run.error_classes) : [run.error_classes[wanted] ?? {}];
    return parts.reduce((sum, part) => sum + (part[kind] ?? 0), 0);
  }
}

const number = (value) => (value === null ? "–" : short(value));
const share = (value) => (value === null ? "–" : `${(100 * value).toFixed(0)} %`);

function chooser(id, names, onChange) {
  const select = document.getElementById(id);
  if (!select) return { value: "" };
  select.append(...names.map((name) => new Option(name, name)));
  select.addEventListener("change", onChange);
  return select;
}
