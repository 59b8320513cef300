// The program's text beside the picture: only the lines that are seen are in the page, however long it is.
const LINE_HIGH = 18;
const listing = { rows: null, line: -1, longest: 0 };
// What is told of a line; of several notes the first, which is the gravest.
const noteOfText = new Map();
for (const note of notes) if (note.text && !noteOfText.has(note.text)) noteOfText.set(note.text, note);
const lineOfEvent = unpack(data.listing.lines, Uint32Array);

// Rows of the pane: the lines of all files, under the name of each where there are several. `line` counts through all
// files from 1, and is 0 for a name; `number` is that of the file.
function readListing() {
  if (listing.rows) return;
  listing.rows = [];
  listing.rowOf = [];
  const { files } = data.listing;
  let line = 0;
  for (const [name, text] of files) {
    if (files.length > 1) listing.rows.push({ text: name, number: "", line: 0 });
    const lines_ = text.split("\n");
    if (lines_.at(-1) === "") lines_.pop();
    lines_.forEach((words, k) => {
      line++;
      listing.rowOf[line] = listing.rows.length;
      listing.rows.push({ text: words.replace(/\r$/, ""), number: k + 1, line });
      listing.longest = Math.max(listing.longest, words.length);
    });
  }
  const digits = String(line).length + 2;
  $("code").style.setProperty("--digits", `${digits}ch`);
  $("code-rows").style.minWidth = `${Math.min(listing.longest, 2000) + digits + 3}ch`;
  $("code-rows").style.height = `${listing.rows.length * LINE_HIGH}px`;
}

const codeRows = new Map();
function fillListing() {
  if (tabs.open !== "text" || !data.listing.files.length) return;
  readListing();
  const area = $("code");
  const first = Math.max(Math.floor(area.scrollTop / LINE_HIGH) - 10, 0);
  const last = Math.min(first + Math.ceil(area.clientHeight / LINE_HIGH) + 20, listing.rows.length);
  for (const [k, row] of codeRows) {
    if (k >= first && k < last) continue;
    row.remove();
    codeRows.delete(k);
  }
  for (let k = first; k < last; k++) {
    if (!codeRows.has(k)) {
      const { text, number: count, line } = listing.rows[k];
      const row = make("div", "", line ? "code" : "code file");
      row.append(make("i", String(count)), make("span", text));
      const told = noteOfText.get(line);
      if (told) {
        row.classList.add("told", told.kind);
        row.title = `${told.kind}: ${told.what}`;
      }
      row.style.top = `${k * LINE_HIGH}px`;
      row.dataset.line = line;
      codeRows.set(k, row);
      $("code-rows").append(row);
    }
    codeRows.get(k).classList.toggle("now", listing.rows[k].line === listing.line && listing.line > 0);
  }
}

// The line that is run now; it stays in sight.
function markLine(line, follow = true) {
  if (line === listing.line) return;
  listing.line = line;
  if (tabs.open !== "text" || !data.listing.files.length) return;
  if (follow) scrollToLine();
  fillListing();
}

function scrollToLine() {
  if (!data.listing.files.length) return;
  readListing();
  const area = $("code");
  const top = (listing.rowOf[listing.line] ?? 0) * LINE_HIGH;
  if (top < area.scrollTop || top + 2 * LINE_HIGH > area.scrollTop + area.clientHeight) {
    area.scrollTop = Math.max(top - area.clientHeight / 3, 0);
  }
}

// The slider to the end of what a line says; of one that moves nothing to that of the next that does.
function toLine(line) {
  let found = -1;
  lineOfEvent.forEach((at, e) => {
    if (at >= line && (found < 0 || at < lineOfEvent[found])) found = e;
  });
  player.play(false);
  if (found >= 0) player.to(track.time[track.event.lastIndexOf(found)]);
  markLine(line, false);
}

// A line that a note is about.
function showLine(line) {
  openTab("text");
  toLine(line);
  scrollToLine();
  fillListing();
}

function setListing() {
  addTab("text", "Program");
  if (!data.listing.files.length) {
    $("code").replaceChildren(make("p", data.listing.why, "empty"));
    return;
  }
  $("code").addEventListener("scroll", fillListing);
  $("code-rows").addEventListener("click", (event) => {
    const line = Number(event.target.closest(".code")?.dataset.line);
    // A selection of text is none of a line.
    if (line && getSelection().isCollapsed) toLine(line);
  });
  whenShown("text", () => {
    scrollToLine();
    fillListing();
  });
}
