// The pane beside the picture: its tabs, and how wide it is.
const tabs = { open: "paths", shown: {} };

function addTab(name, label, mark = "") {
  const tab = make("button", label, mark);
  tab.setAttribute("role", "tab");
  tab.dataset.tab = name;
  tab.addEventListener("click", () => openTab(name));
  document.querySelector("nav").append(tab);
}

// What a tab does when it is opened: it has a size only then.
function whenShown(name, fill) {
  tabs.shown[name] = fill;
}

function openTab(name) {
  tabs.open = name;
  for (const tab of document.querySelectorAll("nav button")) {
    tab.setAttribute("aria-selected", String(tab.dataset.tab === name));
    $(`tab-${tab.dataset.tab}`).hidden = tab.dataset.tab !== name;
  }
  tabs.shown[name]?.();
}

function setWidth(pixels) {
  const most = Math.max(innerWidth - 320, 260);
  document.body.style.setProperty("--side", `${Math.min(Math.max(pixels, 260), most)}px`);
}

const divider = $("divider");
divider.addEventListener("pointerdown", (event) => divider.setPointerCapture(event.pointerId));
divider.addEventListener("pointermove", (event) => {
  if (divider.hasPointerCapture(event.pointerId)) setWidth(event.clientX);
});
divider.addEventListener("dblclick", () => document.body.style.removeProperty("--side"));
divider.addEventListener("keydown", (event) => {
  const by = { ArrowLeft: -20, ArrowRight: 20 }[event.key];
  if (!by) return;
  event.preventDefault();
  event.stopPropagation();
  setWidth(document.querySelector("aside").clientWidth + by);
});
