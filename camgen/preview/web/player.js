// The time of the program: play, scrub, step.
const KINDS = [arm ? "Joint motion" : "Joint or rapid motion", "Line", "Arc", "Wait"];
const SPEEDS = [0.25, 0.5, 1, 2, 5, 10, 20, 50, 100, 500, 2000];

const player = {
  time: 0,
  on: false,
  speed: SPEEDS.find((speed) => speed >= 1 && total / speed <= 45) ?? 2000,
  last: 0,
  to(time) {
    this.time = Math.min(Math.max(time, 0), total);
    if (this.time >= total) this.play(false);
    showTime();
  },
  play(on) {
    if (on && this.time >= total) this.time = 0;
    this.on = on;
    this.last = 0;
    $("play").textContent = on ? "\u275a\u275a" : "\u25b6";
    $("play").setAttribute("aria-label", on ? "Pause" : "Play");
    redraw();
  },
  tick(moment) {
    if (!this.on) return;
    const passed = this.last ? (moment - this.last) / 1000 : 0;
    this.last = moment;
    this.to(this.time + passed * this.speed);
  },
};

// The end of the motion after (1) or before (-1) this one; motions that take no time are passed over.
function step(direction) {
  const ends = (s) => s === stations - 1 || track.event[s + 1] !== track.event[s];
  const slack = 1e-6 * Math.max(1, player.time);
  let s = indexAt(track.time, player.time);
  if (direction > 0) {
    while (s < stations - 1 && !(ends(s) && track.time[s] > player.time + slack)) s++;
  } else {
    while (s > 0 && !(ends(s) && track.time[s] < player.time - slack)) s--;
  }
  player.play(false);
  player.to(track.time[s]);
}

// What is on from each switch on, as text.
const switchTimes = data.switches.map(([time]) => time);
const onAfter = [];
{
  const on = new Map();
  for (const [, signal, value] of data.switches) {
    if (value) on.set(signal, value);
    else on.delete(signal);
    onAfter.push(on.size ? `, on: ${[...on].map(([name, v]) => (v === 1 ? name : `${name} ${number(v, 3).replace(/\.?0+$/, "")}`)).join(", ")}` : "");
  }
}
const onAt = (time) => (switchTimes.length && switchTimes[0] <= time ? onAfter[indexAt(switchTimes, time)] : "");

function showTime() {
  const { station, at } = poseAt(player.time);
  const event = track.event[station];
  const path = track.path[event];
  $("slider").value = player.time;
  $("clock").textContent = `${clock(player.time)} / ${clock(total)}`;
  shared.now.value = player.time > 0 && player.time < total ? player.time : -1;
  const named = path >= 0 ? data.paths[path] : null;
  const where = named ? [`Path ${path + 1} of ${data.paths.length}: ${named.id}`, named.operation, named.layer] : ["Travel"];
  $("where").textContent = $("where").title = where.filter(Boolean).join(", ");
  const place = at.map((v, k) => number(v + origin[k], 2)).join("  ");
  const force = track.force[event] > 0 ? `, ${number(track.force[event])} N` : "";
  const speed = track.kind[event] === 3 ? "" : `, ${number(track.feed[event])} mm/s${force}`;
  $("what").textContent = `${KINDS[track.kind[event]]}, instruction ${track.instruction[event]}${lineOfEvent[event] ? `, line ${lineOfEvent[event]}` : ""}${speed}, at ${place} mm${onAt(player.time)}${cutting.stock?.met.has(event) ? "; a rapid through material" : ""}`;
  cutting.stock?.to(player.time);
  cutting.tool?.(toolOf[event]);
  running(path);
  markLine(lineOfEvent[event]);
  redraw();
}

function setPlayer() {
  $("slider").max = total;
  for (const speed of SPEEDS) {
    const option = make("option", `${speed}x`);
    option.value = speed;
    option.selected = speed === player.speed;
    $("speed").append(option);
  }
  $("speed").addEventListener("change", (event) => { player.speed = Number(event.target.value); });
  $("slider").addEventListener("input", (event) => player.to(Number(event.target.value)));
  $("play").addEventListener("click", () => player.play(!player.on));
}
