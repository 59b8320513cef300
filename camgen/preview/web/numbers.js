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
  for (const { label, point, path } of numbers) {
    const [x, y] = toScreen(point, 0);
    label.style.transform = `translate(${x}px, ${y}px) translate(-50%, -50%)`;
    label.style.background = path < 0 ? "" : rgb(rampColour(path / Math.max(data.paths.length - 1, 1)));
  }
}
