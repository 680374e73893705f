// Tooltip with the definition of a term, on hover and on focus.
function startTips() {
  const tip = document.getElementById("tip");
  const show = (event) => {
    const term = event.target.closest?.("[data-tip]");
    if (!term) return;
    tip.textContent = term.dataset.tip;
    tip.hidden = false;
    const box = term.getBoundingClientRect();
    const left = Math.min(box.left, innerWidth - tip.offsetWidth - 8);
    tip.style.left = `${Math.max(8, left) + scrollX}px`;
    const above = box.bottom + tip.offsetHeight + 10 > innerHeight;
    tip.style.top = `${(above ? box.top - tip.offsetHeight - 6 : box.bottom + 6) + scrollY}px`;
  };
  const hide = (event) => { if (event.type === "keydown" || event.target.closest?.("[data-tip]")) tip.hidden = true; };
  for (const name of ["mouseover", "focusin"]) document.addEventListener(name, show);
  for (const name of ["mouseout", "focusout"]) document.addEventListener(name, hide);
  document.addEventListener("keydown", (event) => { if (event.key === "Escape") hide(event); });
}

// Marks the section that is on screen in the navigation bar.
function startNavigation() {
  const links = [...document.querySelectorAll(".top nav a")];
  const sections = links.map((link) => document.querySelector(link.hash));
  const mark = () => {
    const passed = sections.filter((s) => s.getBoundingClientRect().top < innerHeight * 0.35);
    const atEnd = innerHeight + scrollY >= document.body.scrollHeight - 4;
    const now = atEnd ? sections.at(-1) : passed.at(-1) ?? sections[0];
    links.forEach((link, k) => link.setAttribute("aria-current", String(sections[k] === now)));
  };
  addEventListener("scroll", mark, { passive: true });
  mark();
}
