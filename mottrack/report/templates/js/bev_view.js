// Draws one key frame on a canvas in the ego frame: x (forward) to the right, y (left) up.
const LAYERS = [
  { key: "points", name: "points", style: "solid", on: true },
  { key: "flow", name: "flow", style: "solid", on: true },
  { key: "truth", name: "truth", style: "", on: true },
  { key: "unseen", name: "truth without returns", style: "dashed", on: false },
  { key: "objects", name: "detections", style: "dashed", on: false },
  { key: "tracks", name: "tracks", style: "", on: true },
  { key: "trails", name: "trails", style: "solid", on: true },
  { key: "velocities", name: "velocities", style: "solid", on: true },
  { key: "ids", name: "ids", style: "solid", on: true },
  { key: "errors", name: "errors", style: "", on: true },
];
const LIGHT = { ground: "#f6f7f8", rings: "#dde2e6", points: "#7b858e", still: "#59626b", truth: "#17924c", unseen: "#17924c", objects: "#64748b", tracks: "#d1570b", trails: "#e9a06f", velocities: "#d1570b", ids: "#a03f05", flow: "#6a5acd", miss: "#2a78bd", "false positive": "#c8402c", switch: "#8f5bbd", errors: "#2a78bd", ego: "#1c2329" };
const DARK = { ground: "#0c0f12", rings: "#232a30", points: "#6a747d", still: "#6c7681", truth: "#43d17f", unseen: "#43d17f", objects: "#9fb0c3", tracks: "#ff9c56", trails: "#a3602f", velocities: "#ff9c56", ids: "#ffc298", flow: "#b3a6ff", miss: "#67a8e2", "false positive": "#ff7b66", switch: "#c99bf5", errors: "#67a8e2", ego: "#e6e9ec" };
const palette = () => (theme.dark ? DARK : LIGHT);
// Seconds of a trail; speed that is drawn as static (as viz/bev.py); distance of the rings; half height of the initial view.
const TRAIL_S = 3, STILL_MPS = 0.3, RING_M = 20, FIRST_REACH_M = 42;

class BevView {
  // `colour`: of the run's tracks; `ahead`: seconds since the key frame, by which the picture is moved on.
  constructor(canvas, recording, frame, view, { colour, ahead = 0 } = {}) {
    this.draw = canvas.getContext("2d");
    this.recording = recording;
    this.frame = frame;
    this.view = view;
    this.colours = { ...palette(), ...(colour && { tracks: colour, velocities: colour, trails: colour, ids: colour }) };
    this.ahead = ahead;
    const ratio = devicePixelRatio || 1;
    this.width = canvas.clientWidth;
    this.height = canvas.clientHeight;
    const [w, h] = [Math.round(this.width * ratio), Math.round(this.height * ratio)];
    if (canvas.width !== w || canvas.height !== h) Object.assign(canvas, { width: w, height: h });
    this.draw.setTransform(ratio, 0, 0, ratio, 0, 0);
    this.scale = scaleOf(view, this.width, this.height);
    this.still = recording.pose(frame);
    const { x, y, yaw } = recording.poseAhead(frame, ahead);
    Object.assign(this, { egoX: x, egoY: y, egoYaw: yaw, cos: Math.cos(yaw), sin: Math.sin(yaw) });
  }

  screen(x, y) { return [this.width / 2 + (x - this.view.x) * this.scale, this.height / 2 - (y - this.view.y) * this.scale]; }

  ego(x, y) {
    const [dx, dy] = [x - this.egoX, y - this.egoY];
    return [this.cos * dx + this.sin * dy, this.cos * dy - this.sin * dx];
  }

  world(x, y) { return this.screen(...this.ego(x, y)); }

  // Points and cells are in the ego frame of their key frame, from which the vehicle has moved on.
  own(x, y) {
    if (!this.ahead) return this.screen(x, y);
    const { x: ex, y: ey, yaw } = this.still, [c, s] = [Math.cos(yaw), Math.sin(yaw)];
    return this.world(ex + c * x - s * y, ey + s * x + c * y);
  }

  moved(box) {
    if (!this.ahead || box.vx === null) return box;
    return { ...box, x: box.x + this.ahead * box.vx, y: box.y + this.ahead * box.vy };
  }

  // `errors`: the types that are shown and the selected error.
  paint(layers, errors) {
    this.draw.fillStyle = this.colours.ground;
    this.draw.fillRect(0, 0, this.width, this.height);
    this.rings();
    if (layers.points) this.points();
    if (layers.flow) this.flow();
    this.vehicle();
    if (layers.trails) this.trails();
    const missed = new Set(layers.errors ? this.recording.errors.filter(({ frame }) => frame === this.frame).map(({ truth }) => truth) : []);
    if (layers.truth) this.outlines("truth", 2.2, [], (box) => !box.unseen || missed.has(box.id));
    if (layers.unseen) this.outlines("truth", 1.6, [], (box) => box.unseen);
    if (layers.objects) this.outlines("objects", 1.1, [3, 3]);
    if (layers.tracks) this.outlines("tracks", 1.6);
    if (layers.velocities) this.velocities();
    if (layers.ids) this.identities();
    if (layers.errors) this.errors(errors);
  }

  rings() {
    this.draw.strokeStyle = this.colours.rings;
    this.draw.fillStyle = this.colours.still;
    this.draw.lineWidth = 1;
    this.draw.font = "10px system-ui, sans-serif";
    const [cx, cy] = this.screen(0, 0);
    for (let r = RING_M; r <= 100; r += RING_M) {
      this.draw.beginPath();
      this.draw.arc(cx, cy, r * this.scale, 0, 2 * Math.PI);
      this.draw.stroke();
      this.draw.fillText(`${r} m`, cx + 3, cy - r * this.scale - 3);
    }
  }

  points() {
    const { points_x, points_y } = this.recording.shared.columns;
    const [first, end] = this.recording.rows("points", this.frame);
    const size = Math.max(1, Math.min(2.2, this.scale / 7));
    this.draw.fillStyle = this.colours.points;
    this.draw.globalAlpha = 0.55;
    for (let k = first; k < end; k++) {
      const [x, y] = this.own(points_x[k] / 100, points_y[k] / 100);
      this.draw.fillRect(x - size / 2, y - size / 2, size, size);
    }
    this.draw.globalAlpha = 1;
  }

  flow() {
    if (!this.recording.run.grid) return;
    const [left, bottom, cell] = this.recording.run.grid;
    const { cells_row, cells_column, cells_vx, cells_vy } = this.recording.run.columns;
    const [first, end] = this.recording.rows("cells", this.frame);
    const side = Math.max(cell * this.scale, 1.6);
    for (let k = first; k < end; k++) {
      const [x, y] = this.own(left + cells_column[k] * cell, bottom + (cells_row[k] + 1) * cell);
      const [vx, vy] = [cells_vx[k] / 100, cells_vy[k] / 100];
      const still = cells_vx[k] === UNMEASURED || Math.hypot(vx, vy) <= STILL_MPS;
      this.draw.fillStyle = still ? this.colours.still : vivid(vx, vy);
      this.draw.globalAlpha = still ? 0.5 : 1;
      this.draw.fillRect(x, y, side, side);
    }
    this.draw.globalAlpha = 1;
  }

  vehicle() {
    this.draw.fillStyle = this.colours.ego;
    this.path([[2.4, 0], [1.7, 0.9], [-2.4, 0.9], [-2.4, -0.9], [1.7, -0.9]].map((c) => this.screen(...c)));
    this.draw.fill();
  }

  trails() {
    this.draw.strokeStyle = this.colours.trails;
    this.draw.lineWidth = 1.5;
    this.draw.globalAlpha = 0.55;
    for (const places of this.recording.trails(this.frame, TRAIL_S).values()) {
      this.draw.beginPath();
      places.forEach(([x, y], k) => this.draw[k ? "lineTo" : "moveTo"](...this.world(x, y)));
      this.draw.stroke();
    }
    this.draw.globalAlpha = 1;
  }

  outlines(name, width, dash = [], wanted = () => true) {
    this.draw.strokeStyle = this.colours[name];
    this.draw.lineWidth = width;
    for (const found of this.recording.boxes(name, this.frame).filter(wanted)) {
      const box = this.moved(found), [dx, dy] = [box.x - found.x, box.y - found.y];
      const hull = (name === "tracks" ? this.recording.hull(found) : []).map(([x, y]) => [x + dx, y + dy]);
      this.draw.setLineDash(box.coasting || box.unseen ? [4, 3] : dash);
      this.draw.globalAlpha = box.unseen ? 0.4 : 1;
      this.path((hull.length >= 3 ? hull : corners(box)).map(([x, y]) => this.world(x, y)));
      this.draw.stroke();
      if (hull.length < 3) this.nose(box);
    }
    this.draw.setLineDash([]);
    this.draw.globalAlpha = 1;
  }

  // A line from the centre to the front shows the heading of a box.
  nose(box) {
    const [c, s] = [Math.cos(box.yaw), Math.sin(box.yaw)];
    this.draw.beginPath();
    this.draw.moveTo(...this.world(box.x, box.y));
    this.draw.lineTo(...this.world(box.x + c * box.length / 2, box.y + s * box.length / 2));
    this.draw.stroke();
  }

  velocities() {
    this.draw.strokeStyle = this.draw.fillStyle = this.colours.velocities;
    this.draw.lineWidth = 1.6;
    for (const { x, y, vx, vy } of this.recording.boxes("tracks", this.frame).map((b) => this.moved(b))) {
      if (vx === null || Math.hypot(vx, vy) < STILL_MPS) continue;
      this.arrow(this.world(x, y), this.world(x + vx, y + vy));
    }
  }

  arrow([ax, ay], [bx, by]) {
    const angle = Math.atan2(by - ay, bx - ax), head = 6;
    this.draw.beginPath();
    this.draw.moveTo(ax, ay);
    this.draw.lineTo(bx, by);
    this.draw.stroke();
    this.path([-0.45, 0, 0.45].map((turn) => (turn ? [bx - head * Math.cos(angle + turn), by - head * Math.sin(angle + turn)] : [bx, by])));
    this.draw.fill();
  }

  identities() {
    this.draw.font = "600 11px system-ui, sans-serif";
    this.draw.lineWidth = 3;
    this.draw.strokeStyle = this.colours.ground;
    this.draw.fillStyle = this.colours.ids;
    for (const { x, y, id } of this.recording.boxes("tracks", this.frame).map((b) => this.moved(b))) {
      const [a, b] = this.world(x, y);
      this.draw.strokeText(String(id), a + 5, b - 5);
      this.draw.fillText(String(id), a + 5, b - 5);
    }
  }

  errors({ wanted, chosen }) {
    this.draw.lineWidth = 2;
    for (const error of this.recording.errors) {
      if (error.frame !== this.frame || !wanted.has(error.kind)) continue;
      const [x, y] = this.world(error.x, error.y);
      this.draw.strokeStyle = this.colours[error.kind];
      ERROR_MARKS[error.kind](this.draw, x, y, Math.max(8, 1.6 * this.scale));
      if (error === chosen) this.halo(x, y);
    }
    this.draw.setLineDash([]);
  }

  halo(x, y) {
    this.draw.setLineDash([]);
    this.draw.lineWidth = 3;
    this.draw.beginPath();
    this.draw.arc(x, y, Math.max(16, 3.2 * this.scale), 0, 2 * Math.PI);
    this.draw.stroke();
    this.draw.lineWidth = 2;
  }

  path(points) {
    this.draw.beginPath();
    points.forEach((p, k) => this.draw[k ? "lineTo" : "moveTo"](...p));
    this.draw.closePath();
  }
}

// A miss is a dashed circle, a false positive a cross, a switch a diamond.
const ERROR_MARKS = {
  miss(draw, x, y, r) {
    draw.setLineDash([4, 3]);
    draw.beginPath();
    draw.arc(x, y, r, 0, 2 * Math.PI);
    draw.stroke();
  },
  "false positive"(draw, x, y, r) {
    const d = 0.75 * r;
    draw.setLineDash([]);
    draw.beginPath();
    draw.moveTo(x - d, y - d);
    draw.lineTo(x + d, y + d);
    draw.moveTo(x - d, y + d);
    draw.lineTo(x + d, y - d);
    draw.stroke();
  },
  switch(draw, x, y, r) {
    const d = 1.2 * r;
    draw.setLineDash([]);
    draw.beginPath();
    draw.moveTo(x - d, y);
    draw.lineTo(x, y - d);
    draw.lineTo(x + d, y);
    draw.lineTo(x, y + d);
    draw.closePath();
    draw.stroke();
  },
};

const scaleOf = (view, width, height) => view.zoom * Math.min(width, height) / 2 / FIRST_REACH_M;

function corners({ x, y, length, width, yaw }) {
  const [c, s] = [Math.cos(yaw), Math.sin(yaw)];
  return [[1, 1], [-1, 1], [-1, -1], [1, -1]].map(([a, b]) => [x + (a * length * c - b * width * s) / 2, y + (a * length * s + b * width * c) / 2]);
}

// Slow flow is hard to see: its saturation is at least that of 6 m/s.
function vivid(vx, vy) {
  const speed = Math.hypot(vx, vy), least = 0.4 * FULL_COLOUR_MPS;
  const gain = speed < least ? least / speed : 1;
  return flowColour(gain * vx, gain * vy, theme.dark);
}
