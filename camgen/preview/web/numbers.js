// The edges of a 3-D part with their numbers in the order, and those that are left out with their ids.
const numbers = data.numbers.map(([text, x, y, z, path]) => {
  const label = make("span", text, path < 0 ? "bad" : "");
  $("numbers").append(label);
  return { label, point: [x, y, z], path };
});

function showNumbers() {
  $("numbers").hidden = Boolean(layers.numbers.off);
  if (!numbers.length || layers.numbers.off) return;
  setScreen();
  const free = [];
  for (const { label, point, path } of numbers) {
    const [x, y] = toScreen(point, 0);
    // One that would lie on another is left out: from afar there is no room for all of them.
    label.hidden = free.some(([u, v]) => Math.abs(x - u) < 19 && Math.abs(y - v) < 16);
    if (label.hidden) continue;
    free.push([x, y]);
    label.style.transform = `translate(${x}px, ${y}px) translate(-50%, -50%)`;
    label.style.background = path < 0 ? "" : rgb(rampColour(path / Math.max(data.paths.length - 1, 1)));
  }
}
