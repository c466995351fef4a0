//! Segments of the rims and circles in buckets.

use super::rim::{Lines, Rim};
use crate::curve::{Point, crossings, distance};

/// Boundary segments in square buckets, so that "is this point on the sheet, and not too near its rim" is cheap.
pub(super) struct Segments {
    low: Point,
    bucket_mm: f64,
    columns: usize,
    rows: usize,
    buckets: Vec<Vec<(Point, Point)>>,
    /// Segments that a row of buckets touches.
    across: Vec<Vec<(Point, Point)>>,
}

impl Segments {
    /// Sorts the segments into buckets of about this size.
    pub(super) fn new(lines: &Lines, bucket_mm: f64) -> Self {
        let points = |r: &Rim| -> Vec<Point> { r.nodes.iter().map(|n| n.position).collect() };
        let polygons: Vec<Vec<Point>> = lines.rims.iter().chain(&lines.circles).map(points).collect();
        let rims = lines.rims.len();
        let mut low = [f64::INFINITY; 2];
        let mut high = [f64::NEG_INFINITY; 2];
        for p in polygons.iter().flatten() {
            for k in 0..2 {
                low[k] = low[k].min(p[k]);
                high[k] = high[k].max(p[k]);
            }
        }
        // No more than a thousand buckets a side, however large the sheet.
        let bucket_mm = bucket_mm.max((high[0] - low[0]).max(high[1] - low[1]) / 1000.0);
        let columns = ((high[0] - low[0]) / bucket_mm) as usize + 1;
        let rows = ((high[1] - low[1]) / bucket_mm) as usize + 1;
        let mut this = Self {
            low,
            bucket_mm,
            columns,
            rows,
            buckets: vec![Vec::new(); columns * rows],
            across: vec![Vec::new(); rows],
        };
        for (which, polygon) in polygons.iter().enumerate() {
            for (k, a) in polygon.iter().enumerate() {
                let b = polygon[(k + 1) % polygon.len()];
                // The circle over the segment is what a new point must keep out of.
                let middle = [0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])];
                let r = 0.5 * distance(*a, b);
                let (c0, r0) = this.bucket([middle[0] - r, middle[1] - r]);
                let (c1, r1) = this.bucket([middle[0] + r, middle[1] + r]);
                for row in r0..=r1 {
                    if which < rims {
                        this.across[row].push((*a, b));
                    }
                    for column in c0..=c1 {
                        this.buckets[row * this.columns + column].push((*a, b));
                    }
                }
            }
        }
        this
    }

    fn bucket(&self, p: Point) -> (usize, usize) {
        let cell = |x: f64, low: f64, n: usize| (((x - low) / self.bucket_mm).max(0.0) as usize).min(n - 1);
        (
            cell(p[0], self.low[0], self.columns),
            cell(p[1], self.low[1], self.rows),
        )
    }

    /// Whether the point lies in the circle over a segment.
    pub(super) fn encroached(&self, p: Point) -> bool {
        let (column, row) = self.bucket(p);
        self.buckets[row * self.columns + column]
            .iter()
            .any(|(a, b)| (p[0] - a[0]) * (p[0] - b[0]) + (p[1] - a[1]) * (p[1] - b[1]) < 0.0)
    }

    /// Whether the point is inside the rims.
    pub(super) fn on_sheet(&self, p: Point) -> bool {
        let (_, row) = self.bucket(p);
        crossings(self.across[row].iter().copied(), p) % 2 == 1
    }
}
