const data = JSON.parse(document.getElementById("report-data").textContent);
theme.start();
startTips();
startNavigation();
new Plots(data.runs);
if (document.getElementById("player")) {
  const wheel = document.getElementById("wheel");
  theme.listeners.push(() => drawWheel(wheel));
  drawWheel(wheel);
  if (typeof DecompressionStream === "undefined") document.getElementById("player").replaceChildren("This browser does not support DecompressionStream, which the scenes need.");
  else startLinks(new Player(data.scenes), data.scenes);
}
