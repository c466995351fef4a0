// Small geometry of what is drawn.

/** Round values from 0 to `high`, about `count` of them. */
export function ticks(high, count) {
  const power = 10 ** Math.floor(Math.log10(high / count));
  const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= (0.999 * high) / count);
  return Array.from({ length: Math.floor(high / step + 1e-6) + 1 }, (_, k) => k * step);
}

/** The greatest of 1, 2 and 5 times a power of ten that is not above `limit`. */
export function roundBelow(limit) {
  const power = 10 ** Math.floor(Math.log10(limit));
  return [5 * power, 2 * power].find((v) => v <= limit) ?? power;
}

/** Heights near these, falling down the canvas in their order, `apart` from each other, from `low` to `high`, where there is room. */
export function spread(wanted, apart, low, high) {
  const heights = wanted.map((v) => Math.max(low, v));
  for (let k = 1; k < heights.length; k++) heights[k] = Math.max(heights[k], heights[k - 1] + apart);
  // What is too low goes up again, and takes those above with it.
  for (let [k, most] = [heights.length - 1, high]; k >= 0; most = heights[k] - apart, k--) heights[k] = Math.min(heights[k], most);
  return heights;
}

/** Makes the canvas as fine as the screen; returns its context in CSS pixels, its size, and whether that is another now. */
export function fit(canvas) {
  const [w, h, dpr] = [canvas.clientWidth, canvas.clientHeight, window.devicePixelRatio || 1];
  const [pw, ph] = [Math.max(1, Math.round(w * dpr)), Math.max(1, Math.round(h * dpr))];
  const anew = canvas.width !== pw || canvas.height !== ph;
  if (anew) [canvas.width, canvas.height] = [pw, ph];
  const context = canvas.getContext("2d");
  context.setTransform(dpr, 0, 0, dpr, 0, 0);
  return { context, w, h, anew };
}

/** The rectangle of whole pixels around others, so much larger. */
export function around(all, edge) {
  const [x, y] = ["x", "y"].map((k) => Math.floor(Math.min(...all.map((r) => r[k])) - edge));
  const [right, bottom] = [["x", "w"], ["y", "h"]].map(([k, n]) => Math.ceil(Math.max(...all.map((r) => r[k] + r[n])) + edge));
  return { x, y, w: right - x, h: bottom - y };
}

/** A white line with a dark edge, to be seen on every colour. */
export function twice(c, path, wide, narrow) {
  c.strokeStyle = "#0000008c";
  c.lineWidth = wide;
  c.stroke(path);
  c.strokeStyle = "#fff";
  c.lineWidth = narrow;
  c.stroke(path);
}

/** A line from a ring to its label; null where they touch. */
export function leader(ring, place) {
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
export function outward(polygon, p) {
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
