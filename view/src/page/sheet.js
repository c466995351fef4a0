// Draws the sheet: the field within its outline, the electrodes, the touches, the colour bar and the scale.

import { css, Field, table } from "./field.js";
import { idColour, Labels, number, placeText, ringRadius, riseText, strengthText } from "./labels.js";
import { around, fit, leader, outward, roundBelow, ticks, twice } from "./shapes.js";

const FONT = 'system-ui, "Segoe UI", "Helvetica Neue", Arial, sans-serif';

const strongFont = (t) => `650 ${t + 1}px ${FONT}`;
const plainFont = (t) => `400 ${t - 1}px ${FONT}`;

/**
 * Canvases on top of each other, each drawn only where and when something changed: what stands around the field; the field, in
 * pixels of its own; and a small one for each touch.
 */
export class Sheet {
  constructor(field, frame, marks) {
    [this.fieldCanvas, this.frame, this.marks] = [field, frame, marks];
    this.labels = new Labels();
    // What is drawn around the field now, and on the canvas of every touch.
    this.drawn = "";
    this.pool = [];
    // The lower edge of the banner above the sheet, px.
    this.below = 0;
    // Whether the cells are drawn as they are, without what is between them.
    this.plain = false;
    // Where to press next, in a guided calibration.
    this.guide = null;
  }

  setScene(scene) {
    this.scene = scene;
    this.field = new Field(scene, this.fieldCanvas);
    this.drawn = "";
    const [xs, ys] = [0, 1].map((k) => scene.outline_mm.map((p) => p[k]));
    this.box = { left: Math.min(...xs), right: Math.max(...xs), bottom: Math.min(...ys), top: Math.max(...ys) };
    const faulty = new Set(scene.faulty);
    this.electrodes = scene.electrodes_mm.map((p, k) => ({ p, n: outward(scene.outline_mm, p), faulty: faulty.has(k) }));
    const apart = scene.electrodes_mm.map((a, k, all) => {
      const b = all[(k + 1) % all.length];
      return Math.hypot(a[0] - b[0], a[1] - b[1]) || 1e3;
    });
    this.apart = Math.min(1e3, ...apart);
  }

  /** Takes the cells of a frame. */
  take(cells) {
    this.field.take(cells.steps, cells.news());
  }

  /** Takes the steps of all cells. */
  show(steps) {
    this.field.take(steps, steps.keys());
  }

  /** The step of the cell at a point of the stage in CSS pixels, and the point in mm; null where no cell is. */
  cellAt(px, py) {
    if (!this.middle) return null;
    const { left, right, bottom, top } = this.box;
    const [x, y] = [(left + right) / 2 + (px - this.middle[0]) / this.scale, (bottom + top) / 2 - (py - this.middle[1]) / this.scale];
    const { columns, rows, left_mm, bottom_mm, cell_mm } = this.scene;
    const [column, row] = [Math.floor((x - left_mm) / cell_mm), Math.floor((y - bottom_mm) / cell_mm)];
    if (column < 0 || row < 0 || column >= columns || row >= rows) return null;
    const step = this.field.step(this.scene.cells.indexOf(column + columns * row));
    return step === null ? null : { x, y, step };
  }

  /** What is seen of the sheet, as a canvas. */
  image() {
    const dpr = window.devicePixelRatio || 1;
    const image = document.createElement("canvas");
    [image.width, image.height] = [this.frame.width, this.frame.height];
    const c = image.getContext("2d");
    c.fillStyle = theme.colour("back");
    c.fillRect(0, 0, image.width, image.height);
    c.drawImage(this.frame, 0, 0);
    c.scale(dpr, dpr);
    const { left, top, width, height, opacity } = this.fieldCanvas.style;
    c.globalAlpha = Number(opacity);
    c.drawImage(this.fieldCanvas, ...[left, top, width, height].map(parseFloat));
    for (const { canvas, area } of this.pool.filter((own) => !own.canvas.hidden)) {
      c.globalAlpha = Number(canvas.style.opacity);
      c.drawImage(canvas, area.x, area.y, canvas.width / dpr, canvas.height / dpr);
    }
    return image;
  }

  /** Draws what changed. `live`: whether the frame is fresh. */
  draw(frame, palette, live) {
    if (this.palette !== palette) [this.palette, this.colours] = [palette, table(palette)];
    this.field.paint(this.colours, this.plain);
    const around = fit(this.frame);
    const key = [around.w, around.h, this.below, palette, frame.full, frame.smoothed, live, theme.name].join();
    if (around.anew || key !== this.drawn) {
      this.drawn = key;
      this.layout(around.w, around.h);
      this.drawFrame(around, palette, frame, live);
    }
    this.drawMarks(around.context, frame, live);
  }

  drawFrame({ context: c, w, h }, palette, { full, smoothed }, live) {
    c.clearRect(0, 0, w, h);
    this.fieldCanvas.style.opacity = c.globalAlpha = live ? 1 : 0.45;
    // The field lies over the half of it that is inside.
    c.lineWidth = 3;
    c.lineJoin = "round";
    c.strokeStyle = theme.colour("edge");
    c.stroke(this.outline);
    this.drawElectrodes(c);
    c.globalAlpha = 1;
    this.drawBar(c, palette, full, smoothed, w, h);
    this.drawScale(c, w, h);
  }

  /** The touches, or that there are none, where they are not what they were. */
  drawMarks(c, frame, live) {
    const rings = this.rings(c, frame.touches);
    const places = rings.length ? this.labels.place(rings, this.bounds, this.keepOff) : [];
    const marks = rings.map((ring, k) => this.touchMark(ring, places[k]));
    const guided = Boolean(this.guide?.count);
    if (live && !frame.status && !rings.length && !guided) marks.push(this.quietMark());
    if (guided) marks.unshift(...this.guide.taken_mm.map((p) => this.pressedMark(p)));
    if (guided && this.guide.mark_mm) marks.push(this.nextMark(this.guide.mark_mm));
    while (this.pool.length < marks.length) {
      const canvas = document.createElement("canvas");
      this.pool.push({ canvas, drawn: "" });
      this.marks.append(canvas);
    }
    const dpr = window.devicePixelRatio || 1;
    this.pool.forEach((own, k) => {
      own.canvas.hidden = k >= marks.length;
      if (k >= marks.length) return;
      const { area, looks, draw } = marks[k];
      const key = [area.x, area.y, dpr, live, looks, theme.name].join();
      if (key === own.drawn) return;
      Object.assign(own, { drawn: key, area });
      // Rounded up, so that it seldom needs other memory.
      const [w, h] = [area.w, area.h].map((v) => Math.ceil(v / 64) * 64);
      const [pw, ph] = [w, h].map((v) => Math.round(v * dpr));
      if (own.canvas.width !== pw || own.canvas.height !== ph) [own.canvas.width, own.canvas.height] = [pw, ph];
      const at = `translate(${area.x}px, ${area.y}px)`;
      Object.assign(own.canvas.style, { transform: at, width: `${w}px`, height: `${h}px`, opacity: live ? 1 : 0.45 });
      const context = own.canvas.getContext("2d");
      context.setTransform(dpr, 0, 0, dpr, 0, 0);
      context.clearRect(0, 0, w, h);
      context.translate(-area.x, -area.y);
      draw(context);
    });
  }

  layout(w, h) {
    const { left, right, bottom, top } = this.box;
    this.wide = w >= 620 || w > 1.2 * h;
    // On a telephone a whole label would lie on others; the list beside has its place and force.
    this.compact = Math.min(w, h) < 400;
    this.widths = new Map();
    const text = (this.text = Math.max(11, Math.min(15, Math.min(w, h) / 48)));
    // Room for the electrodes' numbers all round, the banner above, the colour bar beside, or below it and the scale.
    const edge = 2.5 * text;
    const [side, head, foot] = [this.wide ? 84 : 0, Math.max(46, this.below + 6) + 1.3 * text, this.wide ? 8 : 78];
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
    const { field, fieldCanvas } = this;
    const [x, y] = this.px([field.left, field.bottom + field.heightMm]);
    const [fw, fh] = [field.widthMm * scale, field.heightMm * scale];
    Object.assign(fieldCanvas.style, { left: `${x}px`, top: `${y}px`, width: `${fw}px`, height: `${fh}px` });
    this.numbers = this.electrodes.map(({ p, n }) => {
      const [x, y] = this.px(p);
      return [x + 1.3 * text * n[0], y - 1.3 * text * n[1]];
    });
    // Each electrode with its number, for the labels to keep off.
    this.keepOff = this.numbers.map(([x, y], k) => {
      const [ex, ey] = this.px(this.electrodes[k].p);
      const [half, cx, cy] = [1.2 * text, (x + ex) / 2, (y + ey) / 2];
      return { x: cx - half, y: cy - half, w: 2 * half, h: 2 * half };
    });
    // And the scale at the bottom, as wide as the longest that is drawn and its text.
    this.keepOff.push({ x: 12, y: (this.wide ? h - 24 : h - 76) - 10, w: 0.14 * Math.min(w, h) + 5 * text + 20, h: 20 });
  }

  drawElectrodes(c) {
    const spacing = this.apart * this.scale;
    const size = Math.max(7, Math.min(this.text, 0.55 * spacing));
    const half = Math.max(2, Math.min(0.28 * spacing, 0.8 * this.text));
    c.font = `500 ${size}px ${FONT}`;
    c.textAlign = "center";
    c.textBaseline = "middle";
    c.lineCap = "round";
    this.electrodes.forEach(({ p, n, faulty }, k) => {
      const [nx, ny] = [n[0], -n[1]];
      // On the rim from outside.
      const [x, y] = this.px(p).map((v, axis) => v + 2.2 * [nx, ny][axis]);
      c.beginPath();
      c.moveTo(x - ny * half, y + nx * half);
      c.lineTo(x + ny * half, y - nx * half);
      if (faulty) {
        // A cross: not every eye tells the colours apart.
        c.beginPath();
        const arm = Math.max(3, 0.45 * this.text);
        for (const way of [1, -1]) {
          c.moveTo(x - arm, y - way * arm);
          c.lineTo(x + arm, y + way * arm);
        }
      }
      c.lineWidth = faulty ? 2.5 : 4.5;
      c.strokeStyle = theme.colour(faulty ? "broken" : "metal");
      c.stroke();
      c.fillStyle = theme.colour(faulty ? "broken" : "faint");
      const [tx, ty] = this.numbers[k];
      c.fillText(k + 1, tx, ty + 0.5);
    });
  }

  /** The touches as rings with what their labels say and the labels' sizes. */
  rings(c, touches) {
    const t = this.letters();
    return touches.map((touch, k) => {
      const [x, y] = this.px([touch.x, touch.y]);
      const whole = [strengthText(touch, this.scene.uncalibrated), placeText(touch)];
      const [first, second] = this.compact ? [riseText(touch), ""] : whole;
      const chip = touch.id === null ? 0 : (0.9 + 0.6 * String(touch.id).length) * t;
      const ring = { key: touch.id ?? `#${k}`, id: touch.id, x, y, r: ringRadius(touch) * this.scale, first, second, chip };
      return { ...ring, ...this.labelSize(c, ring, t), h: (this.compact ? 1.95 : 3.1) * t };
    });
  }

  /** Size of the labels' letters, px. */
  letters() {
    return this.text + (this.wide ? 0.5 : 0);
  }

  labelSize(c, { first, second, chip }, t) {
    // Digits are as wide as each other in the page's fonts, or nearly; the width is rounded up, so that it does not jump.
    const width = (font, text) => {
      const key = font + text.replace(/[0-9]/g, "0");
      if (!this.widths.has(key)) {
        c.font = font;
        this.widths.set(key, c.measureText(text.replace(/[0-9]/g, "0")).width);
      }
      return this.widths.get(key);
    };
    const wide = width(strongFont(t), first) + (chip && chip + 0.4 * t);
    return { w: Math.ceil((Math.max(wide, width(plainFont(t), second)) + 1.2 * t) / 8) * 8 };
  }

  /** A ring and its label: where, what can be seen of it, how to draw it. */
  touchMark(ring, place) {
    const circle = { x: ring.x - ring.r, y: ring.y - ring.r, w: 2 * ring.r, h: 2 * ring.r };
    const looks = [ring.x, ring.y, ring.r, place.x, place.y].map((v) => v.toFixed(1)).join() + ring.id + ring.first + ring.second;
    return { area: around([circle, place], 4), looks, draw: (c) => this.drawTouch(c, ring, place) };
  }

  drawTouch(c, ring, { x, y, w, h }) {
    const t = this.letters();
    c.lineCap = "round";
    const lead = leader(ring, { x, y, w, h });
    if (lead) twice(c, lead, 4, 1.4);
    const circle = new Path2D();
    circle.arc(ring.x, ring.y, ring.r, 0, 2 * Math.PI);
    twice(c, circle, 5, 2);
    c.textBaseline = "alphabetic";
    c.textAlign = "left";
    c.beginPath();
    c.roundRect(x, y, w, h, 0.55 * t);
    c.fillStyle = theme.colour("label");
    c.fill();
    c.lineWidth = 1;
    c.strokeStyle = theme.colour("label-edge");
    c.stroke();
    let at = x + 0.6 * t;
    if (ring.chip) {
      c.beginPath();
      c.roundRect(at, y + 0.38 * t, ring.chip, 1.18 * t, 0.59 * t);
      c.fillStyle = idColour(ring.id);
      c.fill();
      c.font = `700 ${0.85 * t}px ${FONT}`;
      c.fillStyle = theme.colour("on-id");
      c.textAlign = "center";
      c.fillText(ring.id, at + ring.chip / 2, y + 1.28 * t);
      c.textAlign = "left";
      at += ring.chip + 0.4 * t;
    }
    c.font = strongFont(t);
    c.fillStyle = theme.colour("text");
    c.fillText(ring.first, at, y + 1.36 * t);
    c.font = plainFont(t);
    c.fillStyle = theme.colour("text");
    c.fillText(ring.second, x + 0.6 * t, y + 2.65 * t);
  }

  /** A mark that was pressed. */
  pressedMark(p) {
    const [[x, y], r] = [this.px(p), 0.28 * this.text];
    const draw = (c) => {
      const dot = new Path2D();
      dot.arc(x, y, r, 0, 2 * Math.PI);
      twice(c, dot, 3.5, 1.2);
    };
    return { area: around([{ x: x - r, y: y - r, w: 2 * r, h: 2 * r }], 3), looks: "pressed", draw };
  }

  /** The mark that is to be pressed: a cross in a ring. */
  nextMark(p) {
    const [[x, y], r] = [this.px(p), Math.max(12, 1.1 * this.text)];
    const draw = (c) => {
      const cross = new Path2D();
      cross.arc(x, y, r, 0, 2 * Math.PI);
      for (const [dx, dy] of [[1, 0], [0, 1]]) {
        cross.moveTo(x - 1.5 * r * dx, y - 1.5 * r * dy);
        cross.lineTo(x + 1.5 * r * dx, y + 1.5 * r * dy);
      }
      c.lineCap = "round";
      twice(c, cross, 6, 2.5);
    };
    return { area: around([{ x: x - 1.5 * r, y: y - 1.5 * r, w: 3 * r, h: 3 * r }], 4), looks: "next", draw };
  }

  quietMark() {
    const size = 1.6 * this.text;
    const [x, y] = this.middle;
    const draw = (c) => {
      c.font = `500 ${size}px ${FONT}`;
      c.textAlign = "center";
      c.textBaseline = "middle";
      c.fillStyle = "#ffffff66";
      c.fillText("no touch", x, y);
    };
    return { area: around([{ x: x - 3 * size, y: y - size, w: 6 * size, h: 2 * size }], 0), looks: "no touch", draw };
  }

  drawBar(c, palette, full, smoothed, w, h) {
    const length = this.wide ? Math.min(380, h - 140) : w - 96;
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
    c.strokeStyle = theme.colour("edge");
    c.stroke();
    c.font = `400 ${this.text - 1}px ${FONT}`;
    c.fillStyle = theme.colour("faint");
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
    c.strokeStyle = theme.colour("faint");
    c.stroke();
    c.fillStyle = theme.colour("faint");
    c.textAlign = this.wide ? "center" : "right";
    c.textBaseline = "alphabetic";
    // What no touches explain is drawn as it was reconstructed: wider and flatter than it is.
    if (!this.wide) c.fillText(smoothed ? "smoothed" : "change", w - 14, bar.y + 10);
    else ["change", ...(smoothed ? ["smoothed"] : [])].forEach((line, k) => c.fillText(line, bar.x + bar.w / 2, bar.y - 12 - 1.2 * k * this.text));
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
    c.strokeStyle = theme.colour("faint");
    c.stroke();
    c.font = `400 ${this.text - 1}px ${FONT}`;
    c.textAlign = "left";
    c.textBaseline = "middle";
    c.fillStyle = theme.colour("faint");
    c.fillText(`${mm} mm`, x + length + 9, y);
  }
}
