// What this page has seen in the last ten minutes, in bounded memory: 30 frames a second and their cells.

const SPAN_MS = 600_000;
// A little less than every other of 60 frames a second.
const LEAST_S = 1 / 31;
const MOST_BYTES = 48e6;
// Frames that build on one whole picture, which costs 2 bytes a cell; a changed cell costs 8 in each.
const BLOCK = 64;
// About what a frame and a touch take beside their cells.
const FRAME_BYTES = 600;
const TOUCH_BYTES = 120;

/** Frames are counted from 0; those from `first` to `last` are there. */
export class History {
  constructor(mostBytes = MOST_BYTES) {
    this.mostBytes = mostBytes;
    this.blocks = [];
    this.bytes = 0;
    this.next = 0;
  }

  get first() {
    return this.blocks[0]?.start ?? 0;
  }

  get last() {
    return this.next - 1;
  }

  /** Takes a frame that arrived at `now` in ms, the steps of all cells, and its scene; unless one was taken just before. */
  add(now, frame, steps, scene) {
    let block = this.blocks.at(-1);
    const since = block ? frame.time - block.entries.at(-1).frame.time : NaN;
    const follows = block?.scene === scene && since >= 0;
    if (follows && since < LEAST_S) return;
    const kept = { ...frame, news: null };
    const cost = FRAME_BYTES + TOUCH_BYTES * frame.touches.length;
    if (!follows || block.entries.length >= BLOCK) {
      block = { scene, start: this.next, whole: steps.slice(), entries: [], bytes: 0 };
      this.blocks.push(block);
      this.grow(block, steps.byteLength);
      block.entries.push({ now, frame: kept, changes: null });
    } else {
      const changes = [];
      steps.forEach((step, k) => step !== this.steps[k] && changes.push(k, step));
      block.entries.push({ now, frame: kept, changes: Uint32Array.from(changes) });
      this.grow(block, 4 * changes.length);
    }
    this.grow(block, cost);
    this.steps = steps.slice();
    this.next++;
    while (this.blocks.length > 1 && (this.bytes > this.mostBytes || now - this.blocks[0].entries.at(-1).now > SPAN_MS)) {
      this.bytes -= this.blocks.shift().bytes;
    }
  }

  grow(block, bytes) {
    block.bytes += bytes;
    this.bytes += bytes;
  }

  /** Frame number `k`, or the one nearest to it that is still there: { k, frame, scene, now }; null where there is none. */
  entry(k) {
    if (!this.blocks.length) return null;
    k = Math.max(this.first, Math.min(this.last, k));
    const block = this.blocks.findLast((b) => b.start <= k);
    return { k, scene: block.scene, ...block.entries[k - block.start] };
  }

  /** The steps of the cells of frame number `k`, which is there. */
  cells(k) {
    const block = this.blocks.findLast((b) => b.start <= k);
    const steps = block.whole.slice();
    for (const { changes } of block.entries.slice(1, k - block.start + 1)) {
      for (let c = 0; c < changes.length; c += 2) steps[changes[c]] = changes[c + 1];
    }
    return steps;
  }

  /** The frame so many seconds of the page's clock after number `k`, or before it. */
  step(k, seconds) {
    const from = this.entry(k);
    if (!from) return k;
    const wanted = from.now + 1000 * seconds;
    let to = from.k;
    const way = Math.sign(seconds);
    while (to + way >= this.first && to + way <= this.last && way * (this.entry(to + way).now - wanted) <= 0) to += way;
    return to === from.k ? from.k + way : to;
  }
}
