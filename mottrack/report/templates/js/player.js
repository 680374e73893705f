// Plays the key frames of a scene for one run, or for two side by side.
const NONE = "none";
const SMOOTH_S = 0.15; // key frames further apart than those of a 10 Hz sensor are joined by a moving picture
const ACTION_M = 40, MARGIN_M = 8; // what is further away is not fitted; free space around what is
const TRACK_LAYERS = new Set(["tracks", "trails", "velocities", "ids"]);
const colourOf = (run) => data.runs[run]?.colour ?? 0; // no second run: its dot is not shown

class Player {
  constructor(scenes) {
    this.scenes = scenes;
    this.by = Object.fromEntries(["scene", "run-0", "run-1", "slider", "play", "frame-label", "speed", "views"].map((id) => [id, document.getElementById(id)]));
    this.canvases = [0, 1].map((k) => document.getElementById(`view-${k}`));
    this.panes = [null, null];
    this.view = { x: 0, y: 0, zoom: 1 };
    this.frame = 0;
    this.timer = null;
    this.ahead = 0;
    this.opened = null;
    this.swatches = [];
    this.layers = Object.fromEntries(LAYERS.map(({ key, on }) => [key, on]));
    this.errors = new ErrorPanel({ onChoose: (error) => this.visit(error), onFilter: () => this.show(this.frame) });
    this.by.scene.append(...scenes.map(({ name }, k) => new Option(name, k)));
    this.fillLayers();
    this.fillRuns();
    this.listen();
    this.load();
  }

  get recording() { return this.panes[0]; }

  fillLayers() {
    const holder = document.getElementById("layers");
    for (const { key, name, style } of LAYERS) {
      const box = html("input", { type: "checkbox", checked: this.layers[key] });
      const swatch = html("i", { className: style });
      const paintSwatch = () => swatch.style.setProperty("--k", TRACK_LAYERS.has(key) ? runColour(colourOf(this.by["run-0"].value || 0)) : palette()[key]);
      this.swatches.push(paintSwatch);
      box.addEventListener("change", () => { this.layers[key] = box.checked; this.draw(); });
      theme.listeners.push(paintSwatch);
      paintSwatch();
      holder.append(html("label", {}, box, swatch, name));
    }
  }

  fillRuns() {
    const runs = this.scenes[this.by.scene.value].runs;
    const before = [this.by["run-0"].value, this.by["run-1"].value];
    const options = () => runs.map(({ index, title }) => new Option(title, index));
    this.by["run-0"].replaceChildren(...options());
    this.by["run-1"].replaceChildren(new Option("none", NONE), ...options());
    this.by["run-0"].value = (runs.find(({ flows }) => flows) ?? runs[0]).index;
    this.by["run-1"].value = NONE;
    before.forEach((value, k) => {
      const select = this.by[`run-${k}`];
      if ([...select.options].some((option) => option.value === value)) select.value = value;
    });
  }

  async load() {
    this.pause();
    const scene = this.by.scene.value;
    const wanted = [0, 1].map((k) => this.by[`run-${k}`].value);
    const [first, second] = await Promise.all(wanted.map((run) => (run === NONE ? null : Recording.load(scene, run))));
    if (scene !== this.by.scene.value || wanted.some((run, k) => run !== this.by[`run-${k}`].value)) return;
    this.panes = [first, second];
    document.getElementById("pane-1").hidden = second === null;
    this.by.views.classList.toggle("two", second !== null);
    wanted.forEach((run, k) => this.nameRun(run, k));
    this.by.slider.max = first.frames - 1;
    this.swatches.forEach((paint) => paint());
    if (this.opened === null && this.scenes[scene].runs.some(({ index, clusters }) => index === Number(wanted[0]) && clusters)) this.errors.preset();
    if (this.opened !== scene) this.open(first);
    this.opened = scene;
    this.show(Math.min(this.frame, first.frames - 1));
  }

  // Shows a scene first where most moves, with what moves in the picture.
  open(recording) {
    this.frame = recording.liveliest();
    const truth = recording.boxes("truth", this.frame);
    const boxes = truth.length ? truth : recording.boxes("tracks", this.frame);
    const bev = new BevView(this.canvases[0], recording, this.frame, this.view);
    const places = boxes.filter(({ vx, vy }) => vx !== null && Math.hypot(vx, vy) > MOVING_MPS).map(({ x, y }) => bev.ego(x, y)).filter(([x, y]) => Math.hypot(x, y) < ACTION_M);
    if (!places.length) return;
    const [left, right] = extent([0, ...places.map(([x]) => x)]), [low, high] = extent([0, ...places.map(([, y]) => y)]);
    const half = Math.min(bev.width, bev.height) / 2;
    const reach = Math.max((right - left + 2 * MARGIN_M) * half / bev.width, (high - low + 2 * MARGIN_M) * half / bev.height);
    this.view = { x: (left + right) / 2, y: (low + high) / 2, zoom: Math.max(0.5, Math.min(2.5, FIRST_REACH_M / reach)) };
  }

  nameRun(run, k) {
    const label = document.getElementById(`name-${k}`);
    const title = this.by[`run-${k}`].selectedOptions[0].textContent;
    const dot = html("span", { className: "dot" });
    dot.style.setProperty("--c", `var(--run-${colourOf(run)})`);
    label.replaceChildren(...(run === NONE ? [] : [dot, title]));
    this.canvases[k].setAttribute("aria-label", `Bird's-eye view of scene ${this.by.scene.selectedOptions[0].textContent}, run ${title}`);
  }

  show(frame) {
    this.frame = frame;
    this.ahead = 0;
    const { seconds, frames, all_frames } = this.recording.shared;
    const left = all_frames > frames ? ` (of ${all_frames})` : "";
    const text = `frame ${frame + 1} / ${frames}${left} · ${seconds[frame].toFixed(1)} s`;
    this.by["frame-label"].textContent = text;
    this.by.slider.value = frame;
    this.by.slider.setAttribute("aria-valuetext", text);
    this.errors.show(this.recording, frame, this.by["run-0"].selectedOptions[0].textContent);
    for (const k of [0, 1]) document.getElementById(`facts-${k}`).textContent = "";
    this.draw();
  }

  draw() {
    this.panes.forEach((recording, k) => {
      if (!recording) return;
      const frame = Math.min(this.frame, recording.frames - 1);
      new BevView(this.canvases[k], recording, frame, this.view, { colour: this.colour(k), ahead: this.ahead }).paint(this.layers, this.errors);
    });
  }

  colour(k) { return runColour(colourOf(this.by[`run-${k}`].value)); }

  move(frames) {
    this.pause();
    this.show(Math.max(0, Math.min(this.recording.frames - 1, this.frame + frames)));
  }

  toggle() { this.timer === null ? this.play() : this.pause(); }

  play() {
    if (this.frame >= this.recording.frames - 1) this.show(0);
    this.by.play.textContent = "❚❚";
    this.by.play.setAttribute("aria-label", "Pause");
    this.last = null;
    this.timer = requestAnimationFrame((now) => this.tick(now));
  }

  // Plays at the rate of the data; between key frames that are far apart the picture moves on.
  tick(now) {
    const { seconds } = this.recording.shared;
    this.ahead += this.last === null ? 0 : Number(this.by.speed.value) * (now - this.last) / 1000;
    this.last = now;
    let frame = this.frame, since = this.ahead;
    const period = () => seconds[frame + 1] - seconds[frame];
    while (frame + 1 < this.recording.frames && since >= period()) { since -= period(); frame++; }
    if (frame + 1 >= this.recording.frames) { this.pause(); this.show(frame); return; }
    if (frame !== this.frame) this.show(frame);
    this.ahead = since;
    if (period() > SMOOTH_S && !matchMedia("(prefers-reduced-motion: reduce)").matches) this.draw();
    this.timer = requestAnimationFrame((later) => this.tick(later));
  }

  pause() {
    cancelAnimationFrame(this.timer);
    this.timer = null;
    if (this.ahead) { this.ahead = 0; this.draw(); }
    this.by.play.textContent = "▶";
    this.by.play.setAttribute("aria-label", "Play");
  }

  // Shows an error: its frame, and its place if that is outside the view.
  visit(error) {
    this.pause();
    const bev = new BevView(this.canvases[0], this.recording, error.frame, this.view);
    const [x, y] = bev.world(error.x, error.y);
    const margin = 30;
    const hidden = x < margin || y < margin || x > bev.width - margin || y > bev.height - margin;
    if (hidden) [this.view.x, this.view.y] = bev.ego(error.x, error.y);
    this.show(error.frame);
  }

  // Shows a place of a run on a scene; without a run that of the player.
  async go(scene, run, error) {
    this.by.scene.value = scene;
    this.fillRuns();
    if (run !== null && [...this.by["run-0"].options].some(({ value }) => value === run)) this.by["run-0"].value = run;
    await this.load();
    if (!Number.isInteger(error.frame)) return;
    const frame = Math.max(0, Math.min(this.recording.frames - 1, error.frame));
    const apart = (other) => Math.hypot(other.x - error.x, other.y - error.y);
    const here = this.recording.errors.filter((other) => other.frame === frame && apart(other) < 2).sort((a, b) => apart(a) - apart(b));
    this.errors.chosen = here[0] ?? null; // what stands there is marked, as an error chosen from the list
    this.visit({ ...error, frame });
  }

  zoom(factor) {
    this.view.zoom = Math.max(0.4, Math.min(12, this.view.zoom * factor));
    this.draw();
  }

  fit() {
    this.view = { x: 0, y: 0, zoom: 1 };
    this.draw();
  }

  listen() {
    this.by.scene.addEventListener("change", () => { this.frame = 0; this.fit(); this.fillRuns(); this.load(); });
    for (const k of [0, 1]) this.by[`run-${k}`].addEventListener("change", () => this.load());
    this.by.slider.addEventListener("input", () => { this.pause(); this.show(Number(this.by.slider.value)); });
    this.by.play.addEventListener("click", () => this.toggle());
    document.getElementById("back").addEventListener("click", () => this.move(-1));
    document.getElementById("forth").addEventListener("click", () => this.move(1));
    document.getElementById("zoom-in").addEventListener("click", () => this.zoom(1.4));
    document.getElementById("zoom-out").addEventListener("click", () => this.zoom(1 / 1.4));
    document.getElementById("zoom-fit").addEventListener("click", () => this.fit());
    document.getElementById("player").addEventListener("keydown", (event) => this.onKey(event));
    this.canvases.forEach((canvas, k) => this.listenTo(canvas, k));
    new ResizeObserver(() => this.draw()).observe(this.by.views);
    theme.listeners.push(() => this.draw());
  }

  onKey(event) {
    const tag = event.target.tagName;
    if (event.ctrlKey || event.altKey || event.metaKey || tag === "SELECT") return;
    const actions = { e: () => this.errors.step(1), E: () => this.errors.step(-1), "+": () => this.zoom(1.4), "-": () => this.zoom(1 / 1.4), 0: () => this.fit() };
    if (tag === "CANVAS") Object.assign(actions, { ArrowLeft: () => this.move(-1), ArrowRight: () => this.move(1), Home: () => this.move(-1e9), End: () => this.move(1e9) });
    if (tag !== "BUTTON" && event.target.type !== "checkbox") actions[" "] = () => this.toggle();
    if (!actions[event.key]) return;
    event.preventDefault();
    actions[event.key]();
  }

  listenTo(canvas, k) {
    const pointers = new Map();
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      pointers.set(event.pointerId, event);
    });
    for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, (event) => pointers.delete(event.pointerId));
    canvas.addEventListener("pointermove", (event) => {
      const before = pointers.get(event.pointerId);
      if (!before) { this.describe(canvas, k, event); return; }
      this.drag(canvas, pointers, event, before);
      pointers.set(event.pointerId, event);
    });
    canvas.addEventListener("wheel", (event) => {
      if (!event.ctrlKey && document.activeElement !== canvas && !event.shiftKey) return; // the page scrolls
      event.preventDefault();
      this.zoom(Math.exp(-event.deltaY / 400));
    }, { passive: false });
  }

  // One finger moves the view, two zoom it.
  drag(canvas, pointers, event, before) {
    const scale = scaleOf(this.view, canvas.clientWidth, canvas.clientHeight);
    if (pointers.size === 1) {
      this.view.x -= (event.clientX - before.clientX) / scale;
      this.view.y += (event.clientY - before.clientY) / scale;
      this.draw();
      return;
    }
    const other = [...pointers.values()].find((p) => p.pointerId !== event.pointerId);
    const apart = (p) => Math.hypot(p.clientX - other.clientX, p.clientY - other.clientY);
    this.zoom(apart(event) / Math.max(apart(before), 1));
  }

  // Shows label, score and speed of the boxes under the pointer.
  describe(canvas, k, event) {
    const recording = this.panes[k], box = canvas.getBoundingClientRect();
    const bev = new BevView(canvas, recording, Math.min(this.frame, recording.frames - 1), this.view, { colour: this.colour(k) });
    const at = [event.clientX - box.left, event.clientY - box.top];
    const near = (name) => nearest(recording.boxes(name, bev.frame), (b) => bev.world(b.x, b.y), at);
    const lines = [
      this.layers.tracks && words("track", near("tracks")),
      this.layers.truth && words("truth", near("truth")),
      this.layers.objects && words("detection", near("objects")),
    ];
    bev.paint(this.layers, this.errors);
    document.getElementById(`facts-${k}`).textContent = lines.filter(Boolean).join("\n");
  }
}

const extent = (values) => [Math.min(...values), Math.max(...values)];

function nearest(boxes, place, [x, y], reach = 22) {
  let best = null, least = reach;
  for (const box of boxes) {
    const [a, b] = place(box);
    const apart = Math.hypot(a - x, b - y);
    if (apart < least) [best, least] = [box, apart];
  }
  return best;
}

function words(name, box) {
  if (!box) return "";
  const id = box.id === undefined ? "" : ` ${box.id}`;
  const score = box.score === undefined ? "" : `, score ${box.score.toFixed(2)}`;
  const speed = box.vx === null ? "" : `, ${Math.hypot(box.vx, box.vy).toFixed(1)} m/s`;
  return `${name}${id} ${box.label}${score}${speed}${box.coasting ? ", not observed" : ""}`;
}
