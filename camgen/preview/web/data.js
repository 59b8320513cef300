// What the page was given, and colours. Nothing here or later reads a text of the data as markup.
const data = JSON.parse($("data").textContent);

// Numbers as base64, or how often each of some rows comes: see page.py.
function unpack(packed, Kind = Float32Array) {
  if (typeof packed !== "string") return unpackRuns(packed, Kind);
  if (Uint8Array.fromBase64) return new Kind(Uint8Array.fromBase64(packed).buffer);
  const raw = atob(packed);
  const bytes = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
  return new Kind(bytes.buffer);
}

function unpackRuns({ counts, values, steps }, Kind) {
  const [often, rows] = [unpack(counts, Uint32Array), unpack(values, steps ? Int32Array : Kind)];
  const wide = often.length ? rows.length / often.length : 1;
  const found = new Kind(wide * often.reduce((sum, count) => sum + count, 0));
  let at = 0;
  let last = 0;
  for (let k = 0; k < often.length; k++) {
    for (let left = often[k]; left > 0; left--) {
      if (steps) found[at++] = last += rows[k];
      else for (let j = 0; j < wide; j++) found[at++] = rows[wide * k + j];
    }
  }
  return found;
}

const track = {
  position: unpack(data.track.position),
  axis: unpack(data.track.axis),
  time: unpack(data.track.time),
  event: unpack(data.track.event, Uint32Array),
  instruction: unpack(data.track.instruction, Uint32Array),
  kind: unpack(data.track.kind, Uint8Array),
  path: unpack(data.track.path, Int32Array),
  feed: unpack(data.track.feed),
  force: unpack(data.track.force),
};
// The tool of each event, where there are several of them or a stock that they cut.
const toolOf = data.tools ? unpack(data.tool_of, Uint8Array) : null;
const stations = track.time.length;
const total = track.time[stations - 1];
const linePoints = unpack(data.lines.points);
const lineFirst = [];
data.lines.counts.reduce((sum, count) => (lineFirst.push(sum), sum + count), 0);
const origin = data.origin;

// A small element with text; names of files, layers and paths come to the page through here only.
function make(tag, text = "", name = "") {
  const element = document.createElement(tag);
  if (text !== "") element.textContent = text;
  if (name) element.className = name;
  return element;
}

// Of a colour as the style sheet has it, #rrggbb, or as "rgb(r, g, b)": three numbers from 0 to 1.
const colourOf = (text) => (text.startsWith("#") ? text.match(/[0-9a-f]{2}/gi).map((v) => parseInt(v, 16)) : text.match(/[\d.]+/g).map(Number)).map((v) => v / 255);

const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

function number(value, digits = 1) {
  const text = value.toFixed(digits);
  return /^-0\.?0*$/.test(text) ? text.slice(1) : text;
}

function clock(seconds) {
  if (seconds < 60) return `${number(seconds)} s`;
  const whole = Math.floor(seconds);
  const two = (n) => String(n).padStart(2, "0");
  const hours = Math.floor(whole / 3600);
  const rest = `${hours ? two(Math.floor(whole / 60) % 60) : Math.floor(whole / 60)}:${two(whole % 60)}`;
  return hours ? `${hours}:${rest}` : rest;
}

// The last index whose value is not above `value`.
function indexAt(values, value) {
  let low = 0;
  let high = values.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (values[middle] <= value) low = middle;
    else high = middle - 1;
  }
  return low;
}

// From the first to the last, from the least to the greatest: blue, violet, orange; legible on light and on dark.
const RAMPS = {
  light: [[31, 98, 220], [150, 50, 190], [226, 88, 30]],
  dark: [[96, 165, 255], [205, 120, 245], [255, 150, 80]],
};
const ramp = () => RAMPS[isDark() ? "dark" : "light"];

function rampColour(place) {
  const stops = ramp();
  const at = Math.min(Math.max(place, 0), 1) * 2;
  const low = Math.min(Math.floor(at), 1);
  return stops[low].map((v, k) => Math.round(v + (stops[low + 1][k] - v) * (at - low)));
}
const rgb = (colour) => `rgb(${colour.join(", ")})`;
