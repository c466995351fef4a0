// The page: takes frames, draws the newest one when the screen is ready, and keeps the readings.

import { forceText, idColour, number, riseText } from "./labels.js";
import { Sheet } from "./sheet.js";
import { Trace } from "./trace.js";
import { Connection } from "./wire.js";

const ROWS = 6;
const STALE_MS = 1000;
// How long the question stands whether to take a baseline under touches.
const SURE_MS = 4000;
const PALETTES = ["inferno", "viridis", "grey"];

const NOT_RECORDED = { file: null, bytes: 0, seconds: 0, note: null };

const $ = (id) => document.getElementById(id);
const sheet = new Sheet($("field"), $("frame"), $("marks"));
const trace = new Trace($("trace"));

const page = {
  frame: null,
  fresh: false,
  arrived: 0,
  shown: 0,
  state: { name: "wait", until: 0 },
  palette: "inferno",
  held: false,
  draws: [],
  age: NaN,
  number: 0,
  skipped: 0,
  baseline: null,
  away: null,
  preparing: false,
  recording: NOT_RECORDED,
  commands: false,
  readAt: 0,
};

// --- frames -------------------------------------------------------------------------------------------------------

const connection = new Connection({
  state(name, seconds) {
    page.state = { name, until: performance.now() + 1000 * seconds };
    // A program that has just begun records nothing until it says so.
    if (name === "live") page.recording = NOT_RECORDED;
    showRecording();
    showState();
    request();
  },
  scene(scene) {
    page.frame = null;
    page.number = 0;
    page.baseline = scene.baseline ?? null;
    page.away = scene.away ?? null;
    page.preparing = scene.preparing;
    sheet.setScene(scene);
    $("source").textContent = scene.source;
    document.title = `skin – ${scene.source}`;
  },
  rights(commands) {
    page.commands = commands;
    $("rights").hidden = commands;
    showState();
  },
  recording(recording) {
    page.recording = recording;
    showRecording();
    showState();
  },
  frame(frame) {
    const now = performance.now();
    page.arrived = now;
    if (page.held) return void (page.number = 0);
    // Pictures that were not sent here.
    if (page.number) page.skipped += Math.max(0, frame.number - page.number - 1);
    page.number = frame.number;
    page.frame = frame;
    page.fresh = true;
    page.shown = now;
    trace.add(1000 * frame.time, frame.touches);
    request();
  },
});

// --- drawing ------------------------------------------------------------------------------------------------------

let requested = false;
function request() {
  if (requested) return;
  requested = true;
  requestAnimationFrame(draw);
}

function draw(now) {
  requested = false;
  const { frame } = page;
  if (!frame) return;
  if (page.fresh) {
    page.fresh = false;
    sheet.take(connection.cells);
    const age = connection.age(frame);
    page.age = Number.isNaN(page.age) ? age : page.age + 0.1 * (age - page.age);
    page.draws.push(now);
  }
  sheet.draw(frame, page.palette, isLive());
  // Held, it stands still; without new frames it moves on.
  trace.draw(1000 * frame.time + (page.held ? 0 : performance.now() - page.shown));
  if (now - page.readAt > 120) {
    page.readAt = now;
    showTouches(frame.touches);
    showReadings(frame, now);
  }
}

// --- readings -----------------------------------------------------------------------------------------------------

function set(id, text) {
  const element = typeof id === "string" ? $(id) : id;
  if (element.textContent !== text) element.textContent = text;
}

function showTouches(touches) {
  const n = touches.length;
  set("count", page.away ? "touches not known" : page.preparing ? "preparing" : n === 0 ? "no touch" : n === 1 ? "1 touch" : `${n} touches`);
  $("count").classList.toggle("none", n === 0);
  $("list").hidden = n === 0;
  const body = $("touches");
  const rows = Math.min(n, ROWS);
  const forces = touches.some((touch) => touch.force !== null);
  $("force-head").hidden = !forces;
  $("uncalibrated").hidden = !forces || !sheet.scene.uncalibrated;
  while (body.rows.length > rows) body.deleteRow(-1);
  while (body.rows.length < rows) {
    const row = body.insertRow();
    for (let k = 0; k < 6; k++) row.insertCell();
    row.cells[0].innerHTML = '<span class="id"></span>';
  }
  for (let k = 0; k < rows; k++) {
    const touch = touches[k];
    const cells = body.rows[k].cells;
    const chip = cells[0].firstChild;
    set(chip, touch.id === null ? "–" : String(touch.id));
    chip.style.background = idColour(touch.id);
    set(cells[1], number(touch.x, 1));
    set(cells[2], number(touch.y, 1));
    set(cells[3], riseText(touch.rise));
    set(cells[4], number(touch.area, 0));
    set(cells[5], touch.force === null ? "" : forceText(touch.force, sheet.scene.uncalibrated));
    cells[5].hidden = !forces;
  }
  $("more").hidden = n <= ROWS;
  set("more", `and ${n - ROWS} weaker`);
}

function showReadings(frame, now) {
  page.draws = page.draws.filter((time) => time > now - 2000);
  const span = Math.min(2000, Math.max(500, now - page.draws[0] || 0));
  const drawn = page.held ? 0 : (1000 * page.draws.length) / span;
  const known = (value, text) => (Number.isFinite(value) ? text(value) : "–");
  set("rate", known(frame.rate, (v) => `${number(v, 0)} /s`));
  set("drawn", `${number(drawn, 0)} /s`);
  set("solve", known(frame.solve, (v) => (v < 1000 ? `${number(v, 0)} µs` : `${number(v / 1000, 1)} ms`)));
  set("age", known(page.age, (v) => `${number(v, v < 10 ? 1 : 0)} ms`));
  set("residual", known(frame.residual, (v) => `${number(100 * v, 1)} %`));
  set("lost", String(frame.lost));
  $("lost").classList.toggle("bad", frame.lost > 0);
  set("skipped", String(frame.skipped + page.skipped));
  set("sequence", String(frame.sequence));
}

// --- state --------------------------------------------------------------------------------------------------------

function isLive() {
  return page.state.name === "live" && !page.away && performance.now() - page.arrived < STALE_MS;
}

function showState() {
  const { name, until } = page.state;
  const now = performance.now();
  const quiet = now - page.arrived;
  let [state, text, banner] = [name, "live", page.frame?.status || page.baseline?.warning || ""];
  if (name === "lost") {
    const seconds = Math.max(1, Math.ceil((until - now) / 1000));
    [text, banner] = [`trying again in ${seconds} s`, "No connection to the program. Is it still running?"];
  } else if (name === "wait") {
    [text, banner] = ["connecting", page.arrived ? "No connection to the program. Is it still running?" : ""];
  } else if (page.away) {
    [state, text, banner] = ["away", "board away", page.away];
  } else if (!page.arrived) {
    [state, text] = ["wait", "preparing"];
    banner = "No picture yet: the program looks for the board, models the sheet and takes a baseline. Do not touch.";
  } else if (quiet > STALE_MS) {
    [state, text] = ["wait", `no new picture for ${Math.floor(quiet / 1000)} s`];
  } else if (page.preparing) {
    [state, text] = ["wait", "preparing"];
  } else if (page.held) {
    [state, text] = ["wait", "held"];
  }
  $("connection").dataset.state = state;
  set("connection-text", text);
  $("banner").hidden = !banner;
  $("banner").dataset.state = name === "live" && !page.away ? "note" : "lost";
  set("banner", banner);
  const commands = name === "live" && page.commands && page.away === null;
  $("tare").disabled = !commands;
  $("record").disabled = !commands && !(name === "live" && page.commands && page.recording.file);
  $("undo").disabled = !commands || !page.baseline?.earlier;
  showBaseline();
}

/** A time in its largest unit: 50 s, 3 min, 3 h, 2 days. */
function duration(seconds) {
  for (const [least, unit, text] of [[172800, 86400, "days"], [7200, 3600, "h"], [120, 60, "min"]]) {
    if (seconds >= least) return `${Math.floor(seconds / unit)} ${text}`;
  }
  return `${Math.max(0, Math.floor(seconds))} s`;
}

/** A length of time as a clock shows it: 0:07, 12:34, 1:02:03. */
function clock(seconds) {
  const two = (value) => String(Math.floor(value) % 60).padStart(2, "0");
  const [minutes, hours] = [Math.floor(seconds / 60), Math.floor(seconds / 3600)];
  return hours ? `${hours}:${two(minutes)}:${two(seconds)}` : `${minutes}:${two(seconds)}`;
}

function showRecording() {
  const { file, bytes, seconds, note } = page.recording;
  $("record").setAttribute("aria-pressed", file !== null);
  set("record-text", file ? "Stop" : "Record");
  $("recording").hidden = !file && !note;
  $("recording").classList.toggle("on", file !== null);
  set("recording", file ? (note ?? `${file}: ${number(bytes / 1e6, 1)} MB, ${clock(seconds)}`) : (note ?? ""));
}

function showBaseline() {
  const { baseline } = page;
  $("baseline").hidden = !baseline;
  if (!baseline) return;
  const age = duration(Date.now() / 1000 - baseline.taken_unix_s);
  set("baseline", `baseline of ${age} ago${baseline.stored ? ", stored" : ""}`);
}

setInterval(() => {
  showState();
  // So that what is old looks old.
  if (!isLive()) request();
}, 200);

// --- controls -----------------------------------------------------------------------------------------------------

function ask(id, kind) {
  const button = $(id);
  if (button.disabled || button.classList.contains("asked") || !connection.send({ kind })) return;
  if (id === "record") return;
  const text = button.firstChild.textContent;
  button.classList.add("asked");
  button.firstChild.textContent = "Asked for";
  setTimeout(() => {
    button.classList.remove("asked");
    button.firstChild.textContent = text;
  }, 900);
}

/** Pressed once while something touches the sheet it asks; what rests there would count as untouched. Pressed again it does. */
function takeBaseline() {
  const button = $("tare");
  const sure = button.dataset.sure !== undefined || !page.frame?.touches.length;
  if (sure) {
    clearTimeout(page.sure);
    settle();
    return ask("tare", "tare");
  }
  if (button.disabled || button.classList.contains("asked")) return;
  button.dataset.sure = "";
  button.firstChild.textContent = "Touched now: press again to take it as untouched";
  page.sure = setTimeout(settle, SURE_MS);
}

function settle() {
  const button = $("tare");
  if (button.dataset.sure === undefined) return;
  delete button.dataset.sure;
  button.firstChild.textContent = "Take baseline";
}

const undoBaseline = () => ask("undo", "undo_baseline");

const record = () => ask("record", page.recording.file ? "stop_recording" : "start_recording");

function hold() {
  page.held = !page.held;
  $("hold").setAttribute("aria-pressed", page.held);
  set("hold-text", page.held ? "Held" : "Hold");
  showState();
}

/** Some browsers, those of telephones above all, have none. */
function fullScreen() {
  const done = document.fullscreenElement ? document.exitFullscreen() : document.documentElement.requestFullscreen?.();
  done?.catch(() => {});
}

function help() {
  if (!$("help").open) $("help").showModal();
}

function choose(palette) {
  if (!PALETTES.includes(palette)) return;
  page.palette = palette;
  document.querySelector(`input[value="${palette}"]`).checked = true;
  try {
    localStorage.setItem("palette", palette);
  } catch {
    // Storage may be forbidden; then the choice lasts as long as the page.
  }
  request();
}

$("tare").addEventListener("click", takeBaseline);
$("undo").addEventListener("click", undoBaseline);
$("record").addEventListener("click", record);
$("hold").addEventListener("click", hold);
$("theme").addEventListener("click", theme.toggle);
$("help-open").addEventListener("click", help);
$("full").addEventListener("click", fullScreen);
// A click beside the dialog closes it, too.
$("help").addEventListener("click", (event) => event.target === $("help") && $("help").close());
addEventListener("theme", () => {
  page.readAt = 0;
  request();
});
for (const input of document.querySelectorAll('input[name="palette"]')) {
  input.addEventListener("change", () => choose(input.value));
}
document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || event.repeat || $("help").open) return;
  const actions = {
    b: takeBaseline,
    u: undoBaseline,
    r: record,
    h: hold,
    s: () => $("save").click(),
    t: theme.toggle,
    f: fullScreen,
    "?": help,
    c: () => choose(PALETTES[(PALETTES.indexOf(page.palette) + 1) % PALETTES.length]),
  };
  actions[event.key.toLowerCase()]?.();
});
new ResizeObserver(request).observe($("stage"));
document.addEventListener("visibilitychange", request);
try {
  choose(localStorage.getItem("palette") ?? "inferno");
} catch {
  choose("inferno");
}
connection.start();
