// The values of the cells as a smooth image: a cubic B-spline, as in the program's own images (view/field.rs).

import { palettes } from "./palettes.js";

const MARGIN = 2;

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

/** A field over one scene's grid. `image` covers the cells' centres from half a cell outside the grid to the other side. */
export class Field {
  constructor(scene) {
    this.width = scene.columns + 2 * MARGIN;
    this.height = scene.rows + 2 * MARGIN;
    this.factor = Math.max(2, Math.min(10, Math.floor(400 / Math.max(this.width, this.height))));
    this.weights = weights(this.factor);
    const at = (cell) =>
      (Math.floor(cell / scene.columns) + MARGIN) * this.width + (cell % scene.columns) + MARGIN;
    this.places = Int32Array.from(scene.cells, at);
    this.fills = this.extension();
    this.cells = new Float32Array(this.width * this.height);
    // Between the centres of the outermost coefficients that have two neighbours on either side.
    this.columns = (this.width - 3) * this.factor;
    this.rows = (this.height - 3) * this.factor;
    this.across = new Float32Array(this.columns * this.height);
    this.fine = new Float32Array(this.columns * this.rows);
    this.canvas = document.createElement("canvas");
    this.canvas.width = this.columns;
    this.canvas.height = this.rows;
    this.context = this.canvas.getContext("2d");
    this.image = this.context.createImageData(this.columns, this.rows);
    this.pixels = new Uint32Array(this.image.data.buffer);
    // Where the image lies, mm.
    const start = (MARGIN - 1.5) * scene.cell_mm;
    this.left = scene.left_mm - start;
    this.bottom = scene.bottom_mm - start;
    this.widthMm = (this.width - 3) * scene.cell_mm;
    this.heightMm = (this.height - 3) * scene.cell_mm;
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

  /** Takes the values of a frame and interpolates them; returns the greatest. */
  take(values) {
    const { cells, places, width, height, factor, weights: w, columns, rows, across, fine } = this;
    for (let k = 0; k < places.length; k++) cells[places[k]] = values[k] || 0;
    for (const [target, ...sources] of this.fills) {
      let sum = 0;
      for (const source of sources) sum += cells[source];
      cells[target] = sum / sources.length;
    }
    for (let row = 0; row < height; row++) {
      for (let c = 0; c < columns; c++) {
        const from = row * width + Math.floor(c / factor);
        const v = 4 * (c % factor);
        across[row * columns + c] =
          w[v] * cells[from] + w[v + 1] * cells[from + 1] + w[v + 2] * cells[from + 2] + w[v + 3] * cells[from + 3];
      }
    }
    let greatest = 0;
    for (let r = 0; r < rows; r++) {
      const from = Math.floor(r / factor) * columns;
      const v = 4 * (r % factor);
      const [w0, w1, w2, w3] = [w[v], w[v + 1], w[v + 2], w[v + 3]];
      for (let c = 0; c < columns; c++) {
        const at = from + c;
        const value =
          w0 * across[at] + w1 * across[at + columns] + w2 * across[at + 2 * columns] + w3 * across[at + 3 * columns];
        // Row 0 of the grid is at the bottom, row 0 of the image at the top.
        fine[(rows - 1 - r) * columns + c] = value;
        if (value > greatest) greatest = value;
      }
    }
    return greatest;
  }

  /** Colours the field so that `full` has the last colour; returns the canvas with it. */
  paint(colours, full) {
    const { fine, pixels } = this;
    const scale = 255 / full;
    for (let k = 0; k < fine.length; k++) {
      const step = (fine[k] * scale + 0.5) | 0;
      pixels[k] = colours[step > 255 ? 255 : step < 0 ? 0 : step];
    }
    this.context.putImageData(this.image, 0, 0);
    return this.canvas;
  }
}
