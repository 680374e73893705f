// Errors of a scene: count per key frame, list of the current frame, navigation to the next.
const KINDS = [
  { kind: "miss", many: "misses", mark: "miss" },
  { kind: "false positive", many: "false positives", mark: "fp" },
  { kind: "switch", many: "switches", mark: "switch" },
];

class ErrorPanel {
  constructor({ onChoose, onFilter }) {
    Object.assign(this, { onChoose, onFilter });
    this.chosen = null;
    this.wanted = new Set(KINDS.map(({ kind }) => kind));
    this.title = document.getElementById("errors-title");
    this.list = document.getElementById("error-list");
    this.strip = document.getElementById("strip");
    this.boxes = new Map();
    for (const { kind, many } of KINDS) {
      const box = html("input", { type: "checkbox", checked: true });
      box.addEventListener("change", () => {
        box.checked ? this.wanted.add(kind) : this.wanted.delete(kind);
        this.onFilter();
      });
      this.boxes.set(kind, box);
      document.getElementById("error-kinds").append(html("label", {}, box, many));
    }
    document.getElementById("error-next").addEventListener("click", () => this.step(1));
    document.getElementById("error-before").addEventListener("click", () => this.step(-1));
  }

  // Clusters have no class: each wall and bush is a false positive, which tells nothing.
  preset() { this.boxes.get("false positive").click(); }

  get errors() { return this.recording.errors.filter((error) => this.wanted.has(error.kind)); }

  show(recording, frame, runTitle) {
    const changed = recording !== this.recording;
    Object.assign(this, { recording, frame, runTitle });
    if (changed || this.chosen?.frame !== frame) this.chosen = null;
    const here = this.errors.filter((error) => error.frame === frame);
    this.title.textContent = `Errors of ${runTitle}`;
    document.getElementById("errors-count").textContent = `${here.length} in this frame, ${this.errors.length} in the scene`;
    this.fillList(here);
    this.drawStrip();
  }

  fillList(here) {
    const items = here.map((error) => {
      const mark = KINDS.find(({ kind }) => kind === error.kind).mark;
      const whose = error.track >= 0 ? ` track ${error.track}` : ` object ${error.truth}`;
      const button = html("button", { type: "button" }, html("b", { className: mark }, error.kind), ` ${error.label}`, html("br"), html("small", {}, [error.detail, whose.trim()].filter(Boolean).join(", ")));
      button.setAttribute("aria-current", String(error === this.chosen));
      button.addEventListener("click", () => this.choose(error));
      return html("li", {}, button);
    });
    this.list.replaceChildren(...(items.length ? items : [html("li", { className: "none" }, "none in this frame")]));
    const current = this.list.querySelector('[aria-current="true"]');
    if (current) this.list.scrollTop = current.offsetTop - this.list.offsetTop - 40;
  }

  choose(error) {
    this.chosen = error;
    this.onChoose(error);
  }

  // Steps from the selected error, or from the current frame; wraps around at the end.
  step(direction) {
    const all = this.errors;
    if (!all.length) return;
    let next;
    if (this.chosen && all.includes(this.chosen)) next = all.indexOf(this.chosen) + direction;
    else if (direction > 0) next = all.findIndex((error) => error.frame >= this.frame);
    else next = all.findLastIndex((error) => error.frame <= this.frame);
    this.choose(all[(next < 0 && direction > 0 ? 0 : next + all.length) % all.length]);
  }

  // A bar per key frame above the slider: number of errors by type.
  drawStrip() {
    const frames = this.recording.frames, height = 22;
    const counts = Array.from({ length: frames }, () => KINDS.map(() => 0));
    for (const error of this.errors) counts[error.frame][KINDS.findIndex(({ kind }) => kind === error.kind)]++;
    const most = Math.max(...counts.map((c) => c.reduce((a, b) => a + b)), 1);
    this.strip.setAttribute("viewBox", `0 0 ${frames} ${height}`);
    const bars = [svg("rect", { class: "now", x: this.frame, y: 0, width: 1, height })];
    counts.forEach((count, frame) => {
      let y = height;
      count.forEach((n, k) => {
        const h = n / most * (height - 2);
        y -= h;
        if (n) bars.push(svg("rect", { class: KINDS[k].mark, x: frame + 0.12, y, width: 0.76, height: h }));
      });
    });
    this.strip.replaceChildren(...bars);
  }
}
