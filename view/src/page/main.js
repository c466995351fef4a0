// The page: takes frames, draws the newest one when the screen is ready, and keeps the readings.

import { History } from "./history.js";
import { number } from "./labels.js";
import { $, clock, duration, set, showReadings, showTouches } from "./readings.js";
import { Sheet } from "./sheet.js";
import { Trace } from "./trace.js";
import { Connection } from "./wire.js";

const STALE_MS = 1000;
// How long the question stands whether to take a baseline under touches.
const SURE_MS = 4000;
// So often at most a replay is asked to be elsewhere.
const SEEK_MS = 120;
const PALETTES = ["inferno", "viridis", "grey"];

const NOT_RECORDED = { file: null, bytes: 0, seconds: 0, note: null };

const sheet = new Sheet($("field"), $("frame"), $("marks"));
const trace = new Trace($("trace"));
const history = new History();

const page = {
  // What is shown, and what came last.
  frame: null,
  newest: null,
  scene: null,
  // Number of the frame that is shown; null for the newest.
  at: null,
  fresh: false,
  arrived: 0,
  shown: 0,
  state: { name: "wait", until: 0 },
  palette: "inferno",
  draws: [],
  age: NaN,
  number: 0,
  skipped: 0,
  baseline: null,
  away: null,
  preparing: false,
  recording: NOT_RECORDED,
  guide: null,
  // Where a recording is that is played; null for a board.
  replay: null,
  seek: { to: null, timer: null },
  commands: false,
  readAt: 0,
};

// --- frames -------------------------------------------------------------------------------------------------------

const connection = new Connection({
  state(name, seconds) {
    page.state = { name, until: performance.now() + 1000 * seconds };
    // A program that has just begun records nothing until it says so, and guides nobody.
    if (name === "live") [page.recording, page.replay, page.guide, sheet.guide] = [NOT_RECORDED, null, null, null];
    showRecording();
    showGuide();
    showState();
    request();
  },
  scene(scene) {
    page.newest = null;
    page.number = 0;
    // The first picture of another scene has its texts at once: the next may take a while.
    page.readAt = 0;
    page.scene = scene;
    page.baseline = scene.baseline ?? null;
    page.away = scene.away ?? null;
    page.preparing = scene.preparing;
    if (page.at === null) {
      page.frame = null;
      sheet.setScene(scene);
    }
    $("source").textContent = scene.source;
    document.title = `skin – ${scene.source}`;
  },
  rights(commands) {
    page.commands = commands;
    $("rights").hidden = commands;
    showHeld();
  },
  recording(recording) {
    page.recording = recording;
    showRecording();
    showState();
  },
  guide(guide) {
    page.guide = guide;
    sheet.guide = guide;
    showGuide();
    showState();
    request();
  },
  replay(replay) {
    const began = !page.replay;
    page.replay = replay;
    // The whole recording takes the place of the last ten minutes.
    if (began) showNewest();
    showHeld();
  },
  frame(frame) {
    const now = performance.now();
    page.arrived = now;
    page.newest = frame;
    history.add(now, frame, connection.cells.steps, page.scene);
    // What is shown may be too old to be kept.
    if (page.at !== null && page.at < history.first) showFrame(history.first);
    if (page.at !== null) return void (page.number = 0);
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
    if (page.at === null) sheet.take(connection.cells);
    const age = connection.age(frame);
    page.age = Number.isNaN(page.age) ? age : page.age + 0.1 * (age - page.age);
    page.draws.push(now);
  }
  if (now - page.readAt > 120) {
    page.readAt = now;
    showTouches(frame.touches, sheet.scene);
    page.draws = page.draws.filter((time) => time > now - 2000);
    const span = Math.min(2000, Math.max(500, now - page.draws[0] || 0));
    const drawn = page.at !== null ? 0 : (1000 * page.draws.length) / span;
    showReadings(frame, { drawn, age: page.age, skipped: page.skipped });
    showTime();
  }
  paint();
}

/** The canvases, as large as they are now: texts beside them may have changed that. */
function paint() {
  const { frame } = page;
  if (!frame) return;
  sheet.draw(frame, page.palette, isLive());
  // Held, it stands still; without new frames it moves on.
  if (page.at === null) trace.draw(1000 * frame.time + performance.now() - page.shown);
  else trace.draw(1000 * frame.time, "0 s");
}

// --- state --------------------------------------------------------------------------------------------------------

function isLive() {
  const fresh = performance.now() - page.arrived < STALE_MS || page.replay?.paused;
  return page.state.name === "live" && !page.away && fresh;
}

function showState() {
  const { name, until } = page.state;
  const now = performance.now();
  const quiet = now - page.arrived;
  let [state, text, banner] = [name, "live", page.newest?.status || page.baseline?.warning || ""];
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
  } else if (page.replay?.paused) {
    [state, text] = ["wait", "paused"];
  } else if (page.preparing || !page.newest) {
    // Of another baseline, say, of which no picture has come yet.
    [state, text] = ["wait", "preparing"];
  } else if (quiet > STALE_MS) {
    [state, text] = ["wait", `no new picture for ${Math.floor(quiet / 1000)} s`];
  } else if (page.at !== null) {
    [state, text] = ["wait", "held"];
  } else if (page.replay) {
    text = "replay";
  }
  $("connection").dataset.state = state;
  set("connection-text", text);
  $("banner").hidden = !banner;
  $("banner").dataset.state = name === "live" && !page.away ? "note" : "lost";
  set("banner", banner);
  const below = banner ? $("banner").offsetTop + $("banner").offsetHeight : 0;
  if (below !== sheet.below) {
    sheet.below = below;
    request();
  }
  const commands = name === "live" && page.commands && page.away === null && !page.replay;
  const guided = Boolean(page.guide?.count);
  // The presses of a calibration are compared with the frame before each; there is nothing to take or to record.
  $("tare").disabled = !commands || guided;
  $("record").disabled = guided || !commands && !(name === "live" && page.commands && page.recording.file);
  $("undo").disabled = !commands || guided || !page.baseline?.earlier;
  $("again").disabled = !commands || !page.guide?.mark_mm || !page.guide.taken_mm.length;
  $("skip").disabled = !commands || !page.guide?.mark_mm;
  showBaseline();
}

function showRecording() {
  const { file, bytes, seconds, note } = page.recording;
  $("record").setAttribute("aria-pressed", file !== null);
  set("record-text", file ? "Stop" : "Record");
  $("recording").hidden = !file && !note;
  $("recording").classList.toggle("on", file !== null);
  set("recording", file ? (note ?? `${file}: ${number(bytes / 1e6, 1)}\u00a0MB, ${clock(seconds)}`) : (note ?? ""));
}

function showGuide() {
  const { guide } = page;
  $("guide").hidden = !guide?.count;
  if (!guide?.count) return;
  const taken = guide.taken_mm.length;
  set("guide-count", taken < guide.count ? `press ${taken + 1} of ${guide.count}` : `all ${guide.count} presses taken`);
  set("guide-text", guide.text);
  set("guide-note", guide.note);
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
  if (page.at !== null) showTime();
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
  const sure = button.dataset.sure !== undefined || !page.newest?.touches.length;
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

const pressAgain = () => ask("again", "repeat_press");

const skipMark = () => ask("skip", "skip_press");

const undoBaseline = () => ask("undo", "undo_baseline");

const record = () => ask("record", page.recording.file ? "stop_recording" : "start_recording");

// --- time ---------------------------------------------------------------------------------------------------------

/** Shows a frame that was kept, by its number; the one nearest to it where it is not there. */
function showFrame(k) {
  const entry = history.entry(k);
  if (!entry) return;
  page.at = entry.k;
  page.frame = entry.frame;
  if (sheet.scene !== entry.scene) sheet.setScene(entry.scene);
  sheet.show(history.cells(entry.k));
  trace.clear();
  // Its curves are those of the ten seconds before it.
  let from = entry.k;
  while (from > history.first && entry.now - history.entry(from - 1).now < 10_000) from--;
  for (let n = from; n <= entry.k; n++) {
    const { frame } = history.entry(n);
    trace.add(1000 * frame.time, frame.touches);
  }
  showHeld();
}

/** Shows the newest frame again, and those that come. */
function showNewest() {
  if (page.at === null) return;
  page.at = null;
  page.number = 0;
  page.frame = page.newest;
  page.shown = page.arrived;
  if (sheet.scene !== page.scene) sheet.setScene(page.scene);
  sheet.show(connection.cells.steps);
  showHeld();
}

function showHeld() {
  const held = page.replay ? page.replay.paused : page.at !== null;
  $("hold").setAttribute("aria-pressed", held);
  set("hold-text", page.replay ? (held ? "Play" : "Pause") : held ? "Held" : "Hold");
  $("hold").disabled = page.replay !== null && !page.commands;
  page.readAt = 0;
  showTime();
  showState();
  request();
}

function showTime() {
  const slider = $("time");
  slider.disabled = page.replay !== null && !page.commands;
  if (page.replay) {
    const { length_ms: length } = page.replay;
    const at = page.seek.to ?? page.replay.at_ms;
    [slider.min, slider.max, slider.value] = [0, length, at];
    const text = `${clock(at / 1000)} of ${clock(length / 1000)}`;
    set("when", text);
    slider.setAttribute("aria-valuetext", text);
    return;
  }
  [slider.min, slider.max] = [history.first, Math.max(history.first, history.last)];
  slider.value = page.at ?? history.last;
  const entry = page.at === null ? null : history.entry(page.at);
  const ago = entry && (performance.now() - entry.now) / 1000;
  const text = ago === null ? "newest" : ago < 60 ? `\u2212${number(ago, 1)}\u202fs` : `\u2212${clock(ago)}`;
  set("when", text);
  slider.setAttribute("aria-valuetext", text);
}

/** Asks a replay to be elsewhere, the last of what is asked for at once. */
function seek(to) {
  if (!page.commands) return;
  page.seek.to = Math.round(Math.max(0, Math.min(page.replay.length_ms, to)));
  showTime();
  if (page.seek.timer) return;
  connection.send({ kind: "seek", at_ms: page.seek.to });
  page.seek.timer = setTimeout(() => {
    const [asked, latest] = [page.seek.asked, page.seek.to];
    page.seek.timer = null;
    if (asked !== latest && page.replay) seek(latest);
    else page.seek.to = null;
  }, SEEK_MS);
  page.seek.asked = page.seek.to;
}

function hold() {
  if (page.replay) return void connection.send({ kind: page.replay.paused ? "play" : "pause" });
  if (page.at === null) showFrame(history.last);
  else showNewest();
}

/** So many frames, or seconds, on; past the last one what comes is shown again. */
function step(frames, seconds) {
  if (page.replay) {
    const frame = 1000 / (page.newest?.rate || 30);
    return seek((page.seek.to ?? page.replay.at_ms) + (seconds ? 1000 * seconds : frames * Math.ceil(frame)));
  }
  const from = page.at ?? history.last;
  const to = seconds ? history.step(from, seconds) : from + frames;
  if (to > history.last) showNewest();
  else showFrame(to);
}

// --- what is seen -------------------------------------------------------------------------------------------------

function save() {
  const { frame } = page;
  if (!frame) return;
  sheet.image().toBlob((blob) => {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(blob);
    link.download = `skin-${frame.sequence}.png`;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
  });
}

function cells() {
  sheet.plain = !sheet.plain;
  $("cells").setAttribute("aria-pressed", sheet.plain);
  $("probe").hidden = true;
  request();
}

/** The value of the cell under the pointer. */
function probe({ clientX, clientY }) {
  const stage = $("stage").getBoundingClientRect();
  const [x, y] = [clientX - stage.left, clientY - stage.top];
  const cell = sheet.plain && page.frame ? sheet.cellAt(x, y) : null;
  $("probe").hidden = !cell;
  if (!cell) return;
  set("probe", `${number(cell.x, 0)}, ${number(cell.y, 0)} mm: ${number((100 * cell.step * page.frame.full) / 510, 1)}\u202f%`);
  const { offsetWidth: w, offsetHeight: h } = $("probe");
  $("probe").style.left = `${Math.max(0, Math.min(x + 14, stage.width - w - 2))}px`;
  $("probe").style.top = `${Math.max(0, y - h - 10)}px`;
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
$("again").addEventListener("click", pressAgain);
$("skip").addEventListener("click", skipMark);
$("record").addEventListener("click", record);
$("hold").addEventListener("click", hold);
$("save").addEventListener("click", save);
$("cells").addEventListener("click", cells);
$("time").addEventListener("input", () => {
  const k = Number($("time").value);
  if (page.replay) return seek(k);
  if (k >= history.last) showNewest();
  else showFrame(k);
});
$("stage").addEventListener("pointermove", probe);
$("stage").addEventListener("pointerleave", () => { $("probe").hidden = true; });
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
  if (event.ctrlKey || event.metaKey || event.altKey || $("help").open) return;
  const { target } = event;
  const times = {
    ArrowLeft: () => step(-1, event.shiftKey ? -1 : 0),
    ArrowRight: () => step(1, event.shiftKey ? 1 : 0),
    Home: () => (page.replay ? seek(0) : showFrame(history.first)),
    End: () => (page.replay ? seek(page.replay.length_ms) : showNewest()),
    " ": () => event.repeat || hold(),
  };
  // Buttons are pressed by the space bar, and colours chosen by the arrows.
  const own = event.key === " " ? target.matches("button, a") : target.matches("input[type=radio]");
  if (times[event.key] && !own) {
    event.preventDefault();
    times[event.key]();
    return;
  }
  if (event.repeat) return;
  const actions = {
    b: takeBaseline,
    u: undoBaseline,
    a: pressAgain,
    n: skipMark,
    r: record,
    h: hold,
    l: () => page.replay || showNewest(),
    s: save,
    g: cells,
    t: theme.toggle,
    f: fullScreen,
    "?": help,
    c: () => choose(PALETTES[(PALETTES.indexOf(page.palette) + 1) % PALETTES.length]),
  };
  actions[event.key.toLowerCase()]?.();
});
// Before what has another size is seen.
const resized = new ResizeObserver(paint);
for (const part of ["stage", "trace"]) resized.observe($(part));
document.addEventListener("visibilitychange", request);
try {
  choose(localStorage.getItem("palette") ?? "inferno");
} catch {
  choose("inferno");
}
connection.start();
