// Links into the player: #scene=NAME&run=0&frame=12&x=3.5&y=-2, from a list on the page or from outside.
function startLinks(player, scenes) {
  const follow = async () => {
    const asked = new URLSearchParams(location.hash.slice(1));
    const scene = scenes.findIndex(({ key }) => key === asked.get("scene"));
    if (scene < 0) return;
    const number = (name) => Number(asked.get(name) ?? NaN);
    const error = { frame: number("frame"), x: number("x"), y: number("y") };
    await player.go(scene, asked.get("run"), error);
    document.getElementById("player").scrollIntoView({ block: "start" });
  };
  addEventListener("hashchange", follow);
  follow();
}
