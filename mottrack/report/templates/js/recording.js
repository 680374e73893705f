// Decodes the scenes that player_data.py packed, and gives access to their key frames.
const ARRAYS = { i1: Int8Array, u1: Uint8Array, i2: Int16Array, u2: Uint16Array, i4: Int32Array, u4: Uint32Array, f8: Float64Array };
const UNMEASURED = -32768;
const LIVELY_SHARE = 0.7; // of the most moving cells: earlier frames leave more to play
const MOVING_MPS = 0.5; // walking pace and above: noise of resting cells stays below

async function unpack(text) {
  const packed = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  const buffer = await new Response(stream).arrayBuffer();
  const length = new DataView(buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  const body = Math.ceil((4 + length) / 8) * 8;
  const columns = {};
  for (const [name, [type, first, count]] of Object.entries(header.arrays)) {
    columns[name] = new ARRAYS[type](buffer, body + first, count);
  }
  return { ...header, columns };
}

const unpacked = new Map();
function packedPart(id) {
  if (!unpacked.has(id)) unpacked.set(id, unpack(document.getElementById(id).textContent));
  return unpacked.get(id);
}

// First row of each key frame, and the end: one entry more than there are frames.
function edges(counts) {
  const starts = new Uint32Array(counts.length + 1);
  counts.forEach((count, k) => { starts[k + 1] = starts[k] + count; });
  return starts;
}

// The key frames of one run on one scene.
class Recording {
  constructor(shared, run) {
    this.shared = shared;
    this.run = run;
    const rows = { points: shared, truth: shared, cells: run, objects: run, tracks: run };
    this.edges = Object.fromEntries(Object.entries(rows).map(([name, part]) => [name, edges(part.columns[`${name}_n`])]));
    this.corners = edges(run.columns.hulls_n);
    this.errors = run.errors.map(([frame, kind, detail, label, truth, track, x, y]) => ({ frame, kind, detail, label, truth, track, x, y }));
  }

  static async load(scene, run) {
    const [shared, part] = await Promise.all([packedPart(`scene-${scene}-shared`), packedPart(`scene-${scene}-run-${run}`)]);
    return new Recording(shared, part);
  }

  get frames() { return this.shared.frames; }

  pose(frame) {
    const { pose_x, pose_y, pose_yaw } = this.shared.columns;
    return { x: pose_x[frame] / 100, y: pose_y[frame] / 100, yaw: pose_yaw[frame] / 1e4 };
  }

  // The pose some seconds after a key frame, on the way to the next one.
  poseAhead(frame, ahead) {
    const here = this.pose(frame), { seconds } = this.shared;
    if (!ahead || frame + 1 >= this.frames) return here;
    const next = this.pose(frame + 1), part = Math.min(ahead / (seconds[frame + 1] - seconds[frame]), 1);
    const turn = Math.atan2(Math.sin(next.yaw - here.yaw), Math.cos(next.yaw - here.yaw));
    return { x: here.x + part * (next.x - here.x), y: here.y + part * (next.y - here.y), yaw: here.yaw + part * turn };
  }

  // The first key frame in which nearly as many cells move as ever: what a viewer wants to see first.
  liveliest() {
    const { cells_vx, cells_vy } = this.run.columns;
    const moving = Array.from({ length: this.frames }, (_, frame) => {
      const [first, end] = this.rows("cells", frame);
      let count = 0;
      for (let k = first; k < end; k++) count += cells_vx[k] !== UNMEASURED && Math.hypot(cells_vx[k], cells_vy[k]) > 100 * MOVING_MPS;
      return count;
    });
    return moving.findIndex((count) => count >= LIVELY_SHARE * Math.max(...moving));
  }

  rows(name, frame) { return [this.edges[name][frame], this.edges[name][frame + 1]]; }

  // The boxes of a key frame; `name` is "truth", "objects" or "tracks".
  boxes(name, frame) {
    const part = name === "truth" ? this.shared : this.run;
    const column = (key) => part.columns[`${name}_${key}`];
    const [first, end] = this.rows(name, frame);
    const labels = part[`${name}_labels`];
    const boxes = [];
    for (let row = first; row < end; row++) {
      const moves = column("vx")[row] !== UNMEASURED;
      boxes.push({
        row,
        x: column("x")[row] / 100, y: column("y")[row] / 100,
        length: column("length")[row] / 100, width: column("width")[row] / 100,
        yaw: column("yaw")[row] / 1e4,
        vx: moves ? column("vx")[row] / 100 : null, vy: moves ? column("vy")[row] / 100 : null,
        label: labels[column("label")[row]],
        id: column("id")?.[row],
        score: column("score") && column("score")[row] / 100,
        coasting: column("observed") && !column("observed")[row],
        unseen: name === "truth" && column("points")[row] === 0,
      });
    }
    return boxes;
  }

  hull(track) {
    const { hulls_x, hulls_y } = this.run.columns;
    const corners = [];
    for (let k = this.corners[track.row]; k < this.corners[track.row + 1]; k++) corners.push([hulls_x[k] / 100, hulls_y[k] / 100]);
    return corners;
  }

  // Identity to its world positions over the key frames up to this one.
  trails(frame, seconds) {
    const trails = new Map();
    const { tracks_id, tracks_x, tracks_y } = this.run.columns;
    for (let k = frame; k >= 0 && this.shared.seconds[frame] - this.shared.seconds[k] <= seconds; k--) {
      const [first, end] = this.rows("tracks", k);
      for (let row = first; row < end; row++) {
        const id = tracks_id[row];
        if (k === frame) trails.set(id, []);
        trails.get(id)?.push([tracks_x[row] / 100, tracks_y[row] / 100]);
      }
    }
    return trails;
  }
}
