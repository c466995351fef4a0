// The texts beside the sheet.

import { forceText, idColour, number, riseText } from "./labels.js";

const ROWS = 6;

export const $ = (id) => document.getElementById(id);

/** Changes the text of an element, or of the one with this id. */
export function set(id, text) {
  const element = typeof id === "string" ? $(id) : id;
  if (element.textContent !== text) element.textContent = text;
}

/** The list of touches of a scene. */
export function showTouches(touches, scene) {
  const n = touches.length;
  set("count", scene.away ? "touches not known" : scene.preparing ? "preparing" : n === 0 ? "no touch" : n === 1 ? "1 touch" : `${n} touches`);
  $("count").classList.toggle("none", n === 0);
  $("list").hidden = n === 0;
  const body = $("touches");
  const rows = Math.min(n, ROWS);
  const forces = touches.some((touch) => touch.force !== null);
  $("force-head").hidden = !forces;
  $("uncalibrated").hidden = !forces || !scene.uncalibrated;
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
    set(cells[3], riseText(touch));
    // Presses that teach a sheet do not teach an area.
    set(cells[4], touch.area > 0 ? number(touch.area, 0) : "–");
    set(cells[5], touch.force === null ? "" : forceText(touch.force, scene.uncalibrated));
    cells[5].hidden = !forces;
  }
  $("more").hidden = n <= ROWS;
  set("more", `and ${n - ROWS} weaker`);
}

/** The numbers of a frame; `drawn` pictures a second, of an age in ms, `skipped` on the way here. */
export function showReadings(frame, { drawn, age, skipped }) {
  const known = (value, text) => (Number.isFinite(value) ? text(value) : "–");
  set("rate", known(frame.rate, (v) => `${number(v, 0)} /s`));
  set("drawn", `${number(drawn, 0)} /s`);
  set("solve", known(frame.solve, (v) => (v < 1000 ? `${number(v, 0)} µs` : `${number(v / 1000, 1)} ms`)));
  set("age", known(age, (v) => `${number(v, v < 10 ? 1 : 0)} ms`));
  set("residual", known(frame.residual, (v) => `${number(100 * v, 1)} %`));
  set("lost", String(frame.lost));
  $("lost").classList.toggle("bad", frame.lost > 0);
  set("skipped", String(frame.skipped + skipped));
  set("sequence", String(frame.sequence));
}

/** A time in its largest unit: 50 s, 3 min, 3 h, 2 days. */
export function duration(seconds) {
  for (const [least, unit, text] of [[172800, 86400, "days"], [7200, 3600, "h"], [120, 60, "min"]]) {
    if (seconds >= least) return `${Math.floor(seconds / unit)} ${text}`;
  }
  return `${Math.max(0, Math.floor(seconds))} s`;
}

/** A length of time as a clock shows it: 0:07, 12:34, 1:02:03. */
export function clock(seconds) {
  const two = (value) => String(Math.floor(value) % 60).padStart(2, "0");
  const [minutes, hours] = [Math.floor(seconds / 60), Math.floor(seconds / 3600)];
  return hours ? `${hours}:${two(minutes)}:${two(seconds)}` : `${minutes}:${two(seconds)}`;
}
