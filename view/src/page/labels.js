// Where the labels of the touches go, and what they say (as view/labels.rs does for images).

// Directions from a ring's centre to its label's nearest point, and which part of the label is that point: its end, or its middle.
const END = 0.5;
const SIDES = [
  [[1, 0], [-1, 0], [0.7, -0.7], [-0.7, -0.7], [0.7, 0.7], [-0.7, 0.7], [0, -1], [0, 1]],
  [[1, -0.4], [-1, -0.4], [1, 0.4], [-1, 0.4], [0.3, -1], [-0.3, -1], [0.3, 1], [-0.3, 1]],
]
  .flat()
  .map(([dx, dy]) => ({ dx, dy, along: [END * Math.sign(dx), END * Math.sign(dy)] }));
// The straight ones shifted along the ring by a quarter of the label: where an electrode's number is beside one end of it.
for (const [dx, dy] of [[1, 0], [-1, 0], [0, -1], [0, 1]]) {
  for (const by of [0.25, -0.25]) {
    SIDES.push({ dx, dy, along: dx ? [END * dx, by] : [by, END * dy] });
  }
}
// Colours of numbers in style.css.
const COLOURS = 8;

/** The colour of a touch's number; grey without a number. */
export const idColour = (id) => theme.colour(id === null ? "faint" : `id-${((id + COLOURS - 1) % COLOURS) + 1}`);

/** Whether its line is dashed: each four of the colours are told apart by every eye. */
export const isDashed = (id) => id !== null && (id + COLOURS - 1) % COLOURS >= COLOURS / 2;

const signed = (text) => text.replace("-", "\u2212");

/** A number with its sign as typesetters write it, and never "−0.0". */
export const number = (value, digits) => signed((Number(value.toFixed(digits)) || 0).toFixed(digits));

/** "+20 %"; "≥ +1133 %" where it is the largest that the model has, "≤ −92 %" where the smallest */
export const riseText = ({ rise, atLimit }) =>
  (atLimit ? (rise < 0 ? "\u2264\u202f" : "\u2265\u202f") : "") + (rise < 0 ? "" : "+") + number(100 * rise, 0) + "\u202f%";

/** "12.3 N"; of a typical rubber "≈ 12 N" */
export const forceText = (force, uncalibrated) =>
  (uncalibrated ? "\u2248\u202f" + number(force, 0) : number(force, 1)) + "\u202fN";

/** "+20 %", and where the force is known "+20 %  12.3 N" */
export const strengthText = (touch, uncalibrated) =>
  riseText(touch) + (touch.force === null ? "" : "  " + forceText(touch.force, uncalibrated));

/** "12.3, −40.1 mm" */
export const placeText = (touch) => `${number(touch.x, 1)}, ${number(touch.y, 1)} mm`;

/** Radius of the ring around a touch, mm: a disc of the pressed area and a little more. */
export const ringRadius = (touch) => Math.min(30, Math.max(7, Math.sqrt(Math.max(0, touch.area) / Math.PI) + 2)) || 7;

function overlap(a, b) {
  const shared = (p, pl, q, ql) => Math.max(0, Math.min(p + pl, q + ql) - Math.max(p, q));
  return shared(a.x, a.w, b.x, b.w) * shared(a.y, a.h, b.y, b.h);
}

/** How many other rings the way from a ring to the middle of its label crosses. */
function ringsBetween(ring, label, rings) {
  const [dx, dy] = [label.x + label.w / 2 - ring.x, label.y + label.h / 2 - ring.y];
  const crosses = (other) => {
    const [ox, oy] = [other.x - ring.x, other.y - ring.y];
    const t = Math.min(1, Math.max(0, (ox * dx + oy * dy) / Math.max(1, dx * dx + dy * dy)));
    // Rings that overlap are not between.
    return Math.hypot(ox, oy) > other.r && Math.hypot(ox - t * dx, oy - t * dy) < other.r;
  };
  return rings.filter((other) => other !== ring && crosses(other)).length;
}

/** How many of the marks the line from a ring to its label crosses. */
function marksCrossed(ring, label, marks) {
  const from = [ring.x, ring.y];
  const to = [
    Math.min(label.x + label.w, Math.max(label.x, ring.x)),
    Math.min(label.y + label.h, Math.max(label.y, ring.y)),
  ];
  const crosses = (mark) => {
    let [begin, end] = [0, 1];
    for (const [axis, low, high] of [[0, mark.x, mark.x + mark.w], [1, mark.y, mark.y + mark.h]]) {
      const way = to[axis] - from[axis];
      const [a, b] = [low, high].map((v) => (v - from[axis]) / (way || 1e-9)).sort((p, q) => p - q);
      [begin, end] = [Math.max(begin, a), Math.min(end, b)];
    }
    return begin < end;
  };
  return marks.filter(crosses).length;
}

/** Lays out labels; remembers where each was, so that it stays there while that is nearly as good. */
export class Labels {
  constructor() {
    this.before = new Map();
  }

  /** `rings`: [{key, x, y, r, w, h}], the strongest first; `bounds` and each of `marks`: {x, y, w, h}. A rectangle for each. */
  place(rings, bounds, marks) {
    const circles = rings.map((ring) => ({ x: ring.x - ring.r - 2, y: ring.y - ring.r - 2, w: 2 * ring.r + 4, h: 2 * ring.r + 4 }));
    const now = new Map();
    const placed = [];
    for (const ring of rings) {
      let best = null;
      for (const area of this.candidates(ring)) {
        let cost = area.liking - (this.before.get(ring.key) === area.index ? 60 : 0);
        cost += 40 * (area.w * area.h - overlap(area, bounds));
        for (const other of placed) cost += 25 * overlap(area, other);
        for (const mark of marks) cost += 15 * overlap(area, mark);
        cost += 150 * ringsBetween(ring, area, rings) + 1500 * marksCrossed(ring, area, marks);
        for (const circle of circles) cost += 20 * overlap(area, circle);
        if (!best || cost < best.cost) best = { ...area, cost };
      }
      now.set(ring.key, best.index);
      placed.push(best);
    }
    this.before = now;
    return placed;
  }

  candidates(ring) {
    const gaps = [0, 1, 2.2, 3.6].map((k) => 6 + k * ring.h);
    return gaps.flatMap((gap, g) =>
      SIDES.map(({ dx, dy, along }, k) => ({
        x: ring.x + dx * (ring.r + gap) + ring.w * (along[0] - 0.5),
        y: ring.y + dy * (ring.r + gap) + ring.h * (along[1] - 0.5),
        w: ring.w,
        h: ring.h,
        index: SIDES.length * g + k,
        liking: 4 * gap + k,
      })),
    );
  }
}
