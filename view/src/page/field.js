// The cells as a smooth image: a cubic B-spline, as in the program's own images (view/field.rs). Only what cells that
// changed reach is worked out and painted again.

import { palettes } from "./palettes.js";

const MARGIN = 2;
// Steps of a cell from one of the 256 colours to the next (view/shown.rs).
const STEPS_A_COLOUR = 2;

/** The colours of a palette, one 32-bit pixel per entry. */
export function table(name) {
  const digits = palettes[name];
  const bytes = new Uint8ClampedArray(4 * 256).fill(255);
  for (let k = 0; k < 256; k++) {
    for (let c = 0; c < 3; c++) bytes[4 * k + c] = parseInt(digits.slice(6 * k + 2 * c, 6 * k + 2 * c + 2), 16);
  }
  return new Uint32Array(bytes.buffer);
}

/** The colour of a palette at 0..1 as CSS. */
export function css(name, t) {
  const k = Math.round(255 * Math.min(1, Math.max(0, t)));
  return `#${palettes[name].slice(6 * k, 6 * k + 6)}`;
}

/** Weights of the four coefficients around each of `count` positions within a cell. */
function weights(count) {
  const all = new Float32Array(4 * count);
  for (let k = 0; k < count; k++) {
    // Position of the fine pixel's centre, from the centre of a cell.
    const t = (k + 0.5) / count;
    const s = 1 - t;
    const inner = (v) => (4 - 6 * v * v + 3 * v * v * v) / 6;
    all.set([(s * s * s) / 6, inner(t), inner(s), (t * t * t) / 6], 4 * k);
  }
  return all;
}

/** The same where each position has what the centre nearest to it has. */
function nearest(count) {
  const all = new Float32Array(4 * count);
  for (let k = 0; k < count; k++) all[4 * k + (2 * k + 1 < count ? 1 : 2)] = 1;
  return all;
}

/**
 * A field over one scene's grid, painted into a canvas of its own size. It covers the cells' centres from half a cell outside
 * the grid to the other side, in blocks: what lies between four neighbouring centres.
 */
export class Field {
  constructor(scene, canvas) {
    this.width = scene.columns + 2 * MARGIN;
    this.height = scene.rows + 2 * MARGIN;
    this.factor = Math.max(2, Math.min(10, Math.floor(400 / Math.max(this.width, this.height))));
    this.weights = weights(this.factor);
    const at = (cell) =>
      (Math.floor(cell / scene.columns) + MARGIN) * this.width + (cell % scene.columns) + MARGIN;
    this.places = Int32Array.from(scene.cells, at);
    this.fills = this.extension();
    this.feeds = Array.from({ length: this.width * this.height }, () => []);
    this.fills.forEach((fill, k) => fill.slice(1).forEach((source) => this.feeds[source].push(k)));
    this.stale = new Uint8Array(this.fills.length);
    this.coefficients = new Float32Array(this.width * this.height);
    // Between the centres of the outermost coefficients that have two neighbours on either side.
    [this.blockColumns, this.blockRows] = [this.width - 3, this.height - 3];
    this.dirty = new Uint8Array(this.blockColumns * this.blockRows).fill(1);
    this.columns = this.blockColumns * this.factor;
    this.rows = this.blockRows * this.factor;
    this.across = new Float32Array(this.columns * this.height);
    [canvas.width, canvas.height] = [this.columns, this.rows];
    this.context = canvas.getContext("2d");
    this.image = this.context.createImageData(this.columns, this.rows);
    this.pixels = new Uint32Array(this.image.data.buffer);
    // Where the image lies, mm.
    const start = (MARGIN - 1.5) * scene.cell_mm;
    this.left = scene.left_mm - start;
    this.bottom = scene.bottom_mm - start;
    this.widthMm = this.blockColumns * scene.cell_mm;
    this.heightMm = this.blockRows * scene.cell_mm;
    this.opacity = this.inside(scene.outline_mm);
  }

  /** How much of every pixel is inside the outline, 0 to 255. */
  inside(outline) {
    const c = this.context;
    c.beginPath();
    for (const [x, y] of outline) {
      c.lineTo(((x - this.left) / this.widthMm) * this.columns, (1 - (y - this.bottom) / this.heightMm) * this.rows);
    }
    c.fill();
    const { data } = c.getImageData(0, 0, this.columns, this.rows);
    return Uint8Array.from({ length: this.pixels.length }, (_, k) => data[4 * k + 3]);
  }

  /** Cells outside the sheet continue the mean of their neighbours: [target, sources...] in the order to be filled. */
  extension() {
    const known = new Uint8Array(this.width * this.height);
    for (const place of this.places) known[place] = 1;
    const fills = [];
    for (let pass = 0; pass <= MARGIN; pass++) {
      const found = [];
      for (let k = 0; k < known.length; k++) {
        if (known[k]) continue;
        const sources = this.neighbours(k).filter((n) => known[n]);
        if (sources.length) found.push([k, ...sources]);
      }
      for (const fill of found) known[fill[0]] = 1;
      fills.push(...found);
    }
    return fills;
  }

  neighbours(k) {
    const [column, row] = [k % this.width, Math.floor(k / this.width)];
    const near = [];
    for (let r = Math.max(0, row - 1); r <= Math.min(this.height - 1, row + 1); r++) {
      for (let c = Math.max(0, column - 1); c <= Math.min(this.width - 1, column + 1); c++) {
        if (r !== row || c !== column) near.push(r * this.width + c);
      }
    }
    return near;
  }

  /** Takes the steps of the cells in `changed`. */
  take(steps, changed) {
    for (const k of changed) this.set(this.places[k], steps[k]);
    const { fills, stale, coefficients } = this;
    // What is filled later may read what was filled before.
    for (let k = 0; k < fills.length; k++) {
      if (!stale[k]) continue;
      stale[k] = 0;
      const fill = fills[k];
      let sum = 0;
      for (let n = 1; n < fill.length; n++) sum += coefficients[fill[n]];
      this.set(fill[0], sum / (fill.length - 1));
    }
  }

  set(place, value) {
    if (this.coefficients[place] === value) return;
    this.coefficients[place] = value;
    for (const fill of this.feeds[place]) this.stale[fill] = 1;
    // The blocks that it reaches.
    const [column, row] = [place % this.width, Math.floor(place / this.width)];
    const right = Math.min(column, this.blockColumns - 1);
    for (let r = Math.max(0, row - 3); r <= Math.min(row, this.blockRows - 1); r++) {
      this.dirty.fill(1, r * this.blockColumns + Math.max(0, column - 3), r * this.blockColumns + right + 1);
    }
  }

  /** Step of the cell of this number; null where there is none. */
  step(cell) {
    return cell < 0 ? null : this.coefficients[this.places[cell]];
  }

  /** Paints what changed, or all of it in other colours. `plain`: each cell in one colour. */
  paint(colours, plain = false) {
    if (colours !== this.colours || plain !== this.plain) {
      [this.colours, this.plain] = [colours, plain];
      this.dirty.fill(1);
    }
    for (const [left, right, top, bottom] of this.areas()) this.paintArea(left, right, top, bottom);
  }

  /** Rectangles of blocks that hold the dirty ones, which are clean then: [first column, end, first row, end]. */
  areas() {
    const { dirty, blockColumns, blockRows } = this;
    const done = [];
    let open = [];
    for (let row = 0; row < blockRows; row++) {
      const line = dirty.subarray(row * blockColumns, (row + 1) * blockColumns);
      for (let from = line.indexOf(1); from >= 0; ) {
        let end = from + 1;
        while (end < blockColumns && line[end]) end++;
        let area = [from, end, row, row + 1];
        // It grows those above that it touches, into one.
        const meets = (a) => a[3] >= row && a[0] <= area[1] && a[1] >= area[0];
        for (const above of open.filter(meets)) {
          area = [Math.min(area[0], above[0]), Math.max(area[1], above[1]), Math.min(area[2], above[2]), row + 1];
        }
        open = open.filter((a) => !meets(a));
        open.push(area);
        from = line.indexOf(1, end);
      }
      line.fill(0);
      done.push(...open.filter((a) => a[3] <= row));
      open = open.filter((a) => a[3] > row);
    }
    return [...done, ...open];
  }

  paintArea(left, right, low, high) {
    const { coefficients, width, factor, columns, rows, across, pixels, colours, opacity } = this;
    const w = this.plain ? nearest(factor) : this.weights;
    for (let row = low; row < high + 3; row++) {
      for (let block = left; block < right; block++) {
        const from = row * width + block;
        const [a, b, c, d] = [coefficients[from], coefficients[from + 1], coefficients[from + 2], coefficients[from + 3]];
        const at = row * columns + block * factor;
        for (let k = 0, v = 0; k < factor; k++, v += 4) {
          across[at + k] = w[v] * a + w[v + 1] * b + w[v + 2] * c + w[v + 3] * d;
        }
      }
    }
    const { data } = this.image;
    const [start, end] = [left * factor, right * factor];
    for (let r = low * factor; r < high * factor; r++) {
      const from = Math.floor(r / factor) * columns;
      const v = 4 * (r % factor);
      const [w0, w1, w2, w3] = [w[v], w[v + 1], w[v + 2], w[v + 3]];
      // Row 0 of the grid is at the bottom, row 0 of the image at the top.
      const to = (rows - 1 - r) * columns;
      for (let c = start; c < end; c++) {
        const at = from + c;
        const value =
          w0 * across[at] + w1 * across[at + columns] + w2 * across[at + 2 * columns] + w3 * across[at + 3 * columns];
        const shade = (value / STEPS_A_COLOUR + 0.5) | 0;
        pixels[to + c] = colours[shade > 255 ? 255 : shade];
        if (opacity[to + c] < 255) data[4 * (to + c) + 3] = opacity[to + c];
      }
    }
    this.context.putImageData(this.image, 0, 0, start, rows - high * factor, end - start, (high - low) * factor);
  }
}
