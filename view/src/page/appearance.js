// How the page looks, whatever the sheet shows: light or dark, full screen, the help.

const $ = (id) => document.getElementById(id);
const root = document.documentElement;
const system = matchMedia("(prefers-color-scheme: light)");

/** Colours of what canvases draw outside the field, from the style sheet; `theme` is "light" or "dark". */
export const ink = { theme: "", faint: "", text: "", line: "", rim: "" };

/** A colour of a touch's number, dark enough for lines on the panel. */
export const onPanel = (colour) => (ink.theme === "light" ? `color-mix(in srgb, ${colour} 60%, black)` : colour);

/** What was chosen before, null where nothing was or storage is forbidden. */
export function stored(key) {
  try {
    return localStorage.getItem(key);
  } catch {
    return null;
  }
}

/** Keeps a choice for the next visit; where storage is forbidden it lasts as long as the page. */
export function store(key, value) {
  try {
    localStorage.setItem(key, value);
  } catch {
    // Said above.
  }
}

function apply() {
  const chosen = stored("theme");
  show(["light", "dark"].includes(chosen) ? chosen : system.matches ? "light" : "dark");
}

function show(theme) {
  root.dataset.theme = theme;
  const style = getComputedStyle(root);
  for (const name of ["faint", "text", "line", "rim"]) ink[name] = style.getPropertyValue(`--${name}`).trim();
  ink.theme = theme;
  $("theme").setAttribute("aria-pressed", theme === "light");
}

export const help = () => ($("help").open ? $("help").close() : $("help").showModal());

export const fullScreen = () => (document.fullscreenElement ? document.exitFullscreen() : root.requestFullscreen()).catch(() => {});

let changed = () => {};

export function switchTheme() {
  show(ink.theme === "light" ? "dark" : "light");
  store("theme", ink.theme);
  changed();
}

/** Connects the controls; `redraw` is called whenever the colours changed. */
export function start(redraw) {
  changed = redraw;
  apply();
  system.addEventListener("change", () => {
    apply();
    changed();
  });
  $("theme").addEventListener("click", switchTheme);
  $("ask-help").addEventListener("click", help);
  $("full").hidden = !document.fullscreenEnabled;
  $("full").addEventListener("click", fullScreen);
  document.addEventListener("fullscreenchange", () => $("full").setAttribute("aria-pressed", document.fullscreenElement !== null));
}
