// Middlebury colour code of flow: hue is direction, saturation is speed (as viz/colour_wheel.py).
const FULL_COLOUR_MPS = 15; // as viz/bev.py
const ARCS = [
  [[255, 0, 0], [255, 255, 0], 15], [[255, 255, 0], [0, 255, 0], 6], [[0, 255, 0], [0, 255, 255], 4],
  [[0, 255, 255], [0, 0, 255], 11], [[0, 0, 255], [255, 0, 255], 13], [[255, 0, 255], [255, 0, 0], 6],
];
const WHEEL = ARCS.flatMap(([from, to, steps]) => Array.from({ length: steps }, (_, k) => from.map((c, i) => (c + (to[i] - c) * k / steps) / 255)));

function flowColour(vx, vy, dark) {
  const radius = Math.hypot(vx, vy) / FULL_COLOUR_MPS;
  const position = (Math.atan2(vy, -vx) / Math.PI + 1) / 2 * (WHEEL.length - 1);
  const low = Math.floor(position), part = position - low;
  const [a, b] = [WHEEL[low % WHEEL.length], WHEEL[(low + 1) % WHEEL.length]];
  const rgb = a.map((c, i) => {
    const hue = (1 - part) * c + part * b[i];
    if (radius > 1) return 0.75 * hue;
    return dark ? radius * hue : 1 - radius * (1 - hue);
  });
  return `rgb(${rgb.map((c) => Math.round(255 * c)).join(" ")})`;
}

function drawWheel(canvas) {
  const draw = canvas.getContext("2d"), r = canvas.width / 2;
  draw.clearRect(0, 0, canvas.width, canvas.height);
  for (let y = -r; y < r; y += 2) {
    for (let x = -r; x < r; x += 2) {
      if (Math.hypot(x, y) > r) continue;
      draw.fillStyle = flowColour(x / r * FULL_COLOUR_MPS, -y / r * FULL_COLOUR_MPS, theme.dark);
      draw.fillRect(x + r, y + r, 2, 2);
    }
  }
}
