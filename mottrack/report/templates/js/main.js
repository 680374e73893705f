const data = JSON.parse(document.getElementById("report-data").textContent);
theme.start();
startTips();
startNavigation();
new Plots(data.runs);
if (document.getElementById("player")) {
  const wheel = document.getElementById("wheel");
  theme.listeners.push(() => drawWheel(wheel));
  drawWheel(wheel);
  if (typeof DecompressionStream === "undefined") document.getElementById("player").replaceChildren("This browser is too old to unpack the scenes.");
  else new Player(data.films);
}
