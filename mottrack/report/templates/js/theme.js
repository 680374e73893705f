// Light or dark: the reader's last choice, else the system preference.
const theme = {
  listeners: [],
  get dark() { return document.documentElement.dataset.theme === "dark"; },
  set(name) {
    document.documentElement.dataset.theme = name;
    for (const listener of this.listeners) listener();
  },
  start() {
    const system = matchMedia("(prefers-color-scheme: dark)");
    const remembered = recall("mottrack-theme");
    this.set(remembered ?? (system.matches ? "dark" : "light"));
    system.addEventListener("change", () => {
      if (!recall("mottrack-theme")) this.set(system.matches ? "dark" : "light");
    });
    let onScreen = null; // paper is white
    addEventListener("beforeprint", () => { onScreen = document.documentElement.dataset.theme; this.set("light"); });
    addEventListener("afterprint", () => this.set(onScreen));
    document.getElementById("theme").addEventListener("click", () => {
      this.set(this.dark ? "light" : "dark");
      remember("mottrack-theme", this.dark ? "dark" : "light");
    });
  },
};

// A page opened from a file may have no storage; the choice then lasts as long as the page.
const memory = new Map();
function recall(key) {
  if (memory.has(key)) return memory.get(key);
  try { return localStorage.getItem(key); } catch { return null; }
}
function remember(key, value) {
  memory.set(key, value);
  try { localStorage.setItem(key, value); } catch { /* see above */ }
}

const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const runColour = (number) => css(`--run-${number}`);
