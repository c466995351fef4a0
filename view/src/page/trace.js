// The change by each touch, without its sign, over the last ten seconds.

import { idColour, isDashed, number } from "./labels.js";
import { fit, spread, ticks } from "./shapes.js";

const SPAN_MS = 10_000;
const GAP_MS = 400;
const LEAST = 0.1;
// Height of a number at the end of a line, px.
const LETTER = 11;

export class Trace {
  constructor(canvas) {
    this.canvas = canvas;
    // Number of the touch -> [[time in ms, rise], ...]
    this.lines = new Map();
    this.latest = -Infinity;
    this.top = LEAST;
    this.pixelMs = 0;
    this.drawn = "";
    addEventListener("theme", () => { this.drawn = ""; });
  }

  /** Forgets all lines. */
  clear() {
    this.lines.clear();
    [this.latest, this.drawn] = [-Infinity, ""];
  }

  /** Adds the touches of a frame at the board's time in ms; those without a number become one line of the strongest. */
  add(now, touches) {
    // Another board, or a recording that begins anew.
    if (now < this.latest) this.lines.clear();
    this.latest = now;
    const seen = new Set();
    for (const touch of touches) {
      if (seen.has(touch.id)) continue;
      seen.add(touch.id);
      if (!this.lines.has(touch.id)) this.lines.set(touch.id, []);
      const line = this.lines.get(touch.id);
      // More than a point a pixel cannot be seen.
      if (line.length > 1 && now - line.at(-2)[0] < this.pixelMs) line.pop();
      line.push([now, Math.abs(touch.rise)]);
    }
    for (const [key, line] of this.lines) {
      let old = 0;
      while (old < line.length && line[old][0] < now - SPAN_MS - 200) old++;
      if (old) line.splice(0, old);
      if (!line.length) this.lines.delete(key);
    }
  }

  /** Draws the ten seconds up to `now`, ms of the board's time, if that looks otherwise than what is drawn. */
  draw(now, end = "now") {
    const { context: c, w, h, anew } = fit(this.canvas);
    // Room for "1000 %" on the left and a number on the right.
    const plot = { x: 44, y: 6, w: w - 44 - 27, h: h - 6 - 18 };
    // It moves by whole pixels; where there is no line nothing does.
    this.pixelMs = SPAN_MS / Math.max(1, plot.w * (window.devicePixelRatio || 1));
    const key = end + (this.lines.size || this.top > LEAST ? Math.floor(now / this.pixelMs) : "still");
    if (!anew && key === this.drawn) return;
    this.drawn = key;
    c.clearRect(0, 0, w, h);
    let greatest = LEAST;
    for (const line of this.lines.values()) for (const [, rise] of line) greatest = Math.max(greatest, 1.08 * rise);
    // Up at once, down slowly.
    this.top = greatest > this.top ? greatest : this.top + 0.03 * (greatest - this.top);
    if (this.top < 1.01 * greatest) this.top = greatest;
    const x = (time) => plot.x + plot.w * (1 - (now - time) / SPAN_MS);
    const y = (rise) => plot.y + plot.h * (1 - Math.max(0, rise) / this.top);

    c.font = '11px system-ui, "Segoe UI", Arial, sans-serif';
    c.fillStyle = theme.colour("faint");
    c.strokeStyle = theme.colour("line");
    c.lineWidth = 1;
    c.textAlign = "right";
    c.textBaseline = "middle";
    for (const tick of ticks(this.top, 4)) {
      const level = Math.round(y(tick)) + 0.5;
      c.beginPath();
      c.moveTo(plot.x, level);
      c.lineTo(plot.x + plot.w, level);
      c.stroke();
      c.fillText(`${number(100 * tick, 0)}\u202f%`, plot.x - 6, level);
    }
    c.textBaseline = "bottom";
    c.textAlign = "left";
    c.fillText("\u221210 s", plot.x, h);
    c.textAlign = "right";
    c.fillText(end, plot.x + plot.w, h);

    c.save();
    c.beginPath();
    c.rect(plot.x, 0, w - plot.x, h - 16);
    c.clip();
    c.lineJoin = "round";
    c.lineWidth = 1.7;
    for (const [id, line] of this.lines) this.drawLine(c, id, line, x, y, now);
    this.drawNumbers(c, plot, x, y, now);
    c.restore();
  }

  /** The numbers of the lines that go on, strongest first where there is no room for all; apart, so that each can be read. */
  drawNumbers(c, plot, x, y, now) {
    const ends = [...this.lines].map(([id, line]) => ({ id, time: line.at(-1)[0], rise: line.at(-1)[1] }));
    const [low, high] = [plot.y + LETTER / 2, plot.y + plot.h - LETTER / 2];
    const shown = ends
      .filter(({ id, time }) => id !== null && now - time <= GAP_MS)
      .sort((a, b) => b.rise - a.rise)
      .slice(0, Math.floor((high - low) / LETTER) + 1);
    const heights = spread(shown.map(({ rise }) => y(rise)), LETTER, low, high);
    c.textAlign = "left";
    c.textBaseline = "middle";
    shown.forEach(({ id, time }, k) => {
      c.fillStyle = idColour(id);
      c.fillText(id, x(time) + 6, heights[k]);
    });
  }

  drawLine(c, id, line, x, y, now) {
    c.strokeStyle = c.fillStyle = idColour(id);
    // Not every eye tells eight colours apart.
    c.setLineDash(isDashed(id) ? [5, 3] : []);
    c.beginPath();
    line.forEach(([time, rise], k) => {
      const start = k === 0 || time - line[k - 1][0] > GAP_MS;
      if (start) c.moveTo(x(time), y(rise));
      else c.lineTo(x(time), y(rise));
    });
    c.stroke();
    const [time, rise] = line.at(-1);
    if (now - time > GAP_MS) return;
    c.beginPath();
    c.arc(x(time), y(rise), 2.6, 0, 2 * Math.PI);
    c.fill();
  }
}
