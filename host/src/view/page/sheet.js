// Draws the sheet: the field within its outline, the electrodes, the touches, the colour bar and the scale.

import { css, Field, table } from "./field.js";
import { idColour, Labels, number, placeText, ringRadius, strengthText } from "./labels.js";

const FONT = 'system-ui, "Segoe UI", "Helvetica Neue", Arial, sans-serif';
const FAINT = "#98a1b3";
const METAL = "#d6a068";

/** Round values from 0 to `high`, about `count` of them. */
export function ticks(high, count) {
  const power = 10 ** Math.floor(Math.log10(high / count));
  const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= (0.999 * high) / count);
  return Array.from({ length: Math.floor(high / step + 1e-6) + 1 }, (_, k) => k * step);
}

/** The greatest of 1, 2 and 5 times a power of ten that is not above `limit`. */
function roundBelow(limit) {
  const power = 10 ** Math.floor(Math.log10(limit));
  return [5 * power, 2 * power].find((v) => v <= limit) ?? power;
}

/** Makes the canvas as fine as the screen; returns its context in CSS pixels and its size. */
export function fit(canvas) {
  const [w, h, dpr] = [canvas.clientWidth, canvas.clientHeight, window.devicePixelRatio || 1];
  const [pw, ph] = [Math.max(1, Math.round(w * dpr)), Math.max(1, Math.round(h * dpr))];
  if (canvas.width !== pw || canvas.height !== ph) [canvas.width, canvas.height] = [pw, ph];
  const context = canvas.getContext("2d");
  context.setTransform(dpr, 0, 0, dpr, 0, 0);
  context.clearRect(0, 0, w, h);
  return { context, w, h };
}

export class Sheet {
  constructor(canvas) {
    this.canvas = canvas;
    this.labels = new Labels();
  }

  setScene(scene) {
    this.scene = scene;
    this.field = new Field(scene);
    const [xs, ys] = [0, 1].map((k) => scene.outline_mm.map((p) => p[k]));
    this.box = { left: Math.min(...xs), right: Math.max(...xs), bottom: Math.min(...ys), top: Math.max(...ys) };
    this.electrodes = scene.electrodes_mm.map((p) => ({ p, n: outward(scene.outline_mm, p) }));
    const apart = scene.electrodes_mm.map((a, k, all) => {
      const b = all[(k + 1) % all.length];
      return Math.hypot(a[0] - b[0], a[1] - b[1]) || 1e3;
    });
    this.apart = Math.min(1e3, ...apart);
  }

  /** Takes the values of a frame; returns the greatest of the smooth field. */
  take(values) {
    return this.field.take(values);
  }

  /** Draws a frame. `full`: the rise of the last colour; `live`: whether the frame is fresh. */
  draw(frame, palette, full, live) {
    const { context: c, w, h } = fit(this.canvas);
    this.layout(w, h);
    c.globalAlpha = live ? 1 : 0.45;
    this.drawField(c, palette, full);
    this.drawElectrodes(c);
    if (frame.touches.length) this.drawTouches(c, frame.touches);
    else if (live && !frame.status) this.drawQuiet(c);
    c.globalAlpha = 1;
    this.drawBar(c, palette, full, w, h);
    this.drawScale(c, w, h);
  }

  layout(w, h) {
    const { left, right, bottom, top } = this.box;
    this.wide = w >= 620;
    const text = (this.text = Math.max(11, Math.min(15, Math.min(w, h) / 48)));
    // Room for the electrodes' numbers all round, the banner above, the colour bar beside or below.
    const edge = 2.5 * text;
    const [side, head, foot] = [this.wide ? 84 : 0, 46 + 1.3 * text, this.wide ? 8 : 58];
    const room = { x: edge, y: head, w: w - side - 2 * edge, h: h - head - foot - edge };
    if (!this.wide) Object.assign(room, { x: 2 * text, w: w - 4 * text });
    const scale = (this.scale = Math.max(0.1, Math.min(room.w / (right - left), room.h / (top - bottom))));
    const [cx, cy] = [room.x + room.w / 2, room.y + room.h / 2];
    this.px = ([x, y]) => [cx + (x - (left + right) / 2) * scale, cy - (y - (bottom + top) / 2) * scale];
    this.bounds = { x: 4, y: 4, w: w - side - 8, h: h - foot - 8 };
    this.outline = new Path2D();
    for (const p of this.scene.outline_mm) this.outline.lineTo(...this.px(p));
    this.outline.closePath();
    this.middle = [cx, cy];
    this.numbers = this.electrodes.map(({ p, n }) => {
      const [x, y] = this.px(p);
      return [x + 1.3 * text * n[0], y - 1.3 * text * n[1]];
    });
    // Each electrode with its number, for the labels to keep off.
    this.marks = this.numbers.map(([x, y], k) => {
      const [ex, ey] = this.px(this.electrodes[k].p);
      const [half, cx, cy] = [1.2 * text, (x + ex) / 2, (y + ey) / 2];
      return { x: cx - half, y: cy - half, w: 2 * half, h: 2 * half };
    });
  }

  drawField(c, palette, full) {
    const { field } = this;
    this.colours = this.palette === palette ? this.colours : table(palette);
    this.palette = palette;
    c.save();
    c.fillStyle = css(palette, 0);
    c.fill(this.outline);
    c.clip(this.outline);
    c.imageSmoothingEnabled = true;
    const [x, y] = this.px([field.left, field.bottom + field.heightMm]);
    c.drawImage(field.paint(this.colours, full), x, y, field.widthMm * this.scale, field.heightMm * this.scale);
    c.restore();
    c.lineWidth = 1.6;
    c.lineJoin = "round";
    c.strokeStyle = "#5c6373";
    c.stroke(this.outline);
  }

  drawElectrodes(c) {
    const spacing = this.apart * this.scale;
    const size = Math.max(7, Math.min(this.text, 0.55 * spacing));
    const half = Math.max(2, Math.min(0.28 * spacing, 0.8 * this.text));
    c.font = `500 ${size}px ${FONT}`;
    c.textAlign = "center";
    c.textBaseline = "middle";
    c.lineCap = "round";
    this.electrodes.forEach(({ p, n }, k) => {
      const [x, y] = this.px(p);
      const [nx, ny] = [n[0], -n[1]];
      c.beginPath();
      c.moveTo(x - ny * half, y + nx * half);
      c.lineTo(x + ny * half, y - nx * half);
      c.lineWidth = 4.5;
      c.strokeStyle = METAL;
      c.stroke();
      c.fillStyle = FAINT;
      const [tx, ty] = this.numbers[k];
      c.fillText(k + 1, tx, ty + 0.5);
    });
  }

  drawTouches(c, touches) {
    const t = this.text + (this.wide ? 0.5 : 0);
    const [strong, plain] = [`650 ${t + 1}px ${FONT}`, `400 ${t - 1}px ${FONT}`];
    const rings = touches.map((touch, k) => {
      const [x, y] = this.px([touch.x, touch.y]);
      c.font = strong;
      const chip = touch.id === null ? 0 : (0.9 + 0.6 * String(touch.id).length) * t;
      const first = c.measureText(strengthText(touch)).width + (chip && chip + 0.4 * t);
      c.font = plain;
      const second = c.measureText(placeText(touch)).width;
      // Rounded up, so that a digit more or less does not make it jump.
      const w = Math.ceil((Math.max(first, second) + 1.2 * t) / 8) * 8;
      return { key: touch.id ?? `#${k}`, x, y, r: ringRadius(touch) * this.scale, w, h: 3.1 * t, touch, chip };
    });
    const places = this.labels.place(rings, this.bounds, this.marks);
    c.lineCap = "round";
    rings.forEach((ring, k) => {
      const lead = leader(ring, places[k]);
      if (lead) twice(c, lead, 4, 1.4);
      const circle = new Path2D();
      circle.arc(ring.x, ring.y, ring.r, 0, 2 * Math.PI);
      twice(c, circle, 5, 2);
    });
    c.textBaseline = "alphabetic";
    c.textAlign = "left";
    rings.forEach(({ touch, chip }, k) => {
      const { x, y, w, h } = places[k];
      c.beginPath();
      c.roundRect(x, y, w, h, 0.55 * t);
      c.fillStyle = "#0a0c10d9";
      c.fill();
      c.lineWidth = 1;
      c.strokeStyle = "#ffffff2e";
      c.stroke();
      let at = x + 0.6 * t;
      if (chip) {
        c.beginPath();
        c.roundRect(at, y + 0.38 * t, chip, 1.18 * t, 0.59 * t);
        c.fillStyle = idColour(touch.id);
        c.fill();
        c.font = `700 ${0.85 * t}px ${FONT}`;
        c.fillStyle = "#0b0d12";
        c.textAlign = "center";
        c.fillText(touch.id, at + chip / 2, y + 1.28 * t);
        c.textAlign = "left";
        at += chip + 0.4 * t;
      }
      c.font = strong;
      c.fillStyle = "#fff";
      c.fillText(strengthText(touch), at, y + 1.36 * t);
      c.font = plain;
      c.fillStyle = "#dfe3ec";
      c.fillText(placeText(touch), x + 0.6 * t, y + 2.65 * t);
    });
  }

  drawQuiet(c) {
    c.font = `500 ${1.6 * this.text}px ${FONT}`;
    c.textAlign = "center";
    c.textBaseline = "middle";
    c.fillStyle = "#ffffff66";
    c.fillText("no touch", ...this.middle);
  }

  drawBar(c, palette, full, w, h) {
    const length = this.wide ? Math.min(380, h - 140) : w - 84;
    const bar = this.wide ? { x: w - 72, y: (h - length) / 2, w: 13, h: length } : { x: 22, y: h - 48, w: length, h: 11 };
    const gradient = this.wide
      ? c.createLinearGradient(0, bar.y + bar.h, 0, bar.y)
      : c.createLinearGradient(bar.x, 0, bar.x + bar.w, 0);
    for (let k = 0; k <= 32; k++) gradient.addColorStop(k / 32, css(palette, k / 32));
    c.beginPath();
    c.roundRect(bar.x, bar.y, bar.w, bar.h, 4);
    c.fillStyle = gradient;
    c.fill();
    c.lineWidth = 1;
    c.strokeStyle = "#3a4254";
    c.stroke();
    c.font = `400 ${this.text - 1}px ${FONT}`;
    c.fillStyle = "#c3cad8";
    c.textAlign = this.wide ? "left" : "center";
    c.textBaseline = this.wide ? "middle" : "top";
    c.beginPath();
    const percent = (v) => number(100 * v, full < 0.02 ? 1 : 0);
    for (const tick of ticks(full, 4)) {
      const t = tick / full;
      const [x, y] = this.wide ? [bar.x + bar.w, bar.y + bar.h * (1 - t)] : [bar.x + bar.w * t, bar.y + bar.h];
      c.moveTo(x, y);
      c.lineTo(x + (this.wide ? 5 : 0), y + (this.wide ? 0 : 5));
      c.fillText(`${percent(tick)}\u202f%`, x + (this.wide ? 10 : 0), y + (this.wide ? 0 : 9));
    }
    c.strokeStyle = FAINT;
    c.stroke();
    c.fillStyle = FAINT;
    c.textAlign = this.wide ? "center" : "right";
    c.textBaseline = "alphabetic";
    if (this.wide) c.fillText("rise", bar.x + bar.w / 2, bar.y - 12);
    else c.fillText("rise", w - 14, bar.y + 10);
  }

  drawScale(c, w, h) {
    const mm = roundBelow((0.14 * Math.min(w, h)) / this.scale);
    const length = mm * this.scale;
    const [x, y] = this.wide ? [22, h - 24] : [22, h - 76];
    c.beginPath();
    c.moveTo(x, y - 4);
    c.lineTo(x, y + 4);
    c.moveTo(x, y);
    c.lineTo(x + length, y);
    c.moveTo(x + length, y - 4);
    c.lineTo(x + length, y + 4);
    c.lineWidth = 1.2;
    c.strokeStyle = FAINT;
    c.stroke();
    c.font = `400 ${this.text - 1}px ${FONT}`;
    c.textAlign = "left";
    c.textBaseline = "middle";
    c.fillStyle = "#c3cad8";
    c.fillText(`${mm} mm`, x + length + 9, y);
  }
}

/** A white line with a dark edge, to be seen on every colour. */
function twice(c, path, wide, narrow) {
  c.strokeStyle = "#0000008c";
  c.lineWidth = wide;
  c.stroke(path);
  c.strokeStyle = "#fff";
  c.lineWidth = narrow;
  c.stroke(path);
}

/** A line from a ring to its label; null where they touch. */
function leader(ring, place) {
  const to = [Math.min(place.x + place.w, Math.max(place.x, ring.x)), Math.min(place.y + place.h, Math.max(place.y, ring.y))];
  const [dx, dy] = [to[0] - ring.x, to[1] - ring.y];
  const length = Math.hypot(dx, dy);
  if (length <= ring.r + 1) return null;
  const path = new Path2D();
  path.moveTo(ring.x + (dx * ring.r) / length, ring.y + (dy * ring.r) / length);
  path.lineTo(...to);
  return path;
}

/** Unit vector out of the polygon, square to the side that is nearest to `p`. */
function outward(polygon, p) {
  let [best, nearest, area] = [[0, 1], Infinity, 0];
  polygon.forEach((a, k) => {
    const b = polygon[(k + 1) % polygon.length];
    const [dx, dy] = [b[0] - a[0], b[1] - a[1]];
    area += a[0] * b[1] - a[1] * b[0];
    const square = dx * dx + dy * dy || 1e-12;
    const t = Math.min(1, Math.max(0, ((p[0] - a[0]) * dx + (p[1] - a[1]) * dy) / square));
    const distance = Math.hypot(a[0] + t * dx - p[0], a[1] + t * dy - p[1]);
    if (distance < nearest) [nearest, best] = [distance, [dy / Math.sqrt(square), -dx / Math.sqrt(square)]];
  });
  return area < 0 ? best.map((v) => -v) : best;
}
