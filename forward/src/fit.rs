//! Moves vertices of a mesh onto the edges of touches, its topology unchanged: an element then lies on one side of a
//! jump, and quadratic elements follow it with a curved edge.

use crate::curve::{Point, cross, distance};
use crate::element::{DEGREE_4, gradients};
use crate::field::DiscTouch;
use crate::mesh::Mesh;

/// What an element may become by a move, by rounds: 4 sqrt(3) area over the sum of squared edges is 1 for an equilateral
/// triangle and 0 for a flat one; and whether all three vertices may end up on one circle (two curved edges then meet
/// without an angle).
const ROUNDS: [(f64, bool); 3] = [(0.5, false), (0.5, true), (0.1, true)];
/// Least determinant of a curved element's mapping at a quadrature point, over that of the straight one.
const LEAST_DETERMINANT: f64 = 0.05;
/// On no circle.
const FREE: u32 = u32::MAX;

/// Triangles around every vertex, and which vertices are on a rim.
#[derive(Debug)]
pub(crate) struct Neighbours {
    start: Vec<u32>,
    triangles: Vec<u32>,
    on_rim: Vec<bool>,
}

impl Neighbours {
    pub(crate) fn new(mesh: &Mesh) -> Self {
        let mut start = vec![0_u32; mesh.vertices + 1];
        for v in mesh.triangles.iter().flatten() {
            start[v + 1] += 1;
        }
        for k in 0..mesh.vertices {
            start[k + 1] += start[k];
        }
        let mut next = start.clone();
        let mut triangles = vec![0; 3 * mesh.triangles.len()];
        for (element, t) in mesh.triangles.iter().enumerate() {
            for v in t {
                triangles[next[*v] as usize] = element as u32;
                next[*v] += 1;
            }
        }
        // Around a vertex inside, every neighbour is met twice.
        let mut on_rim = vec![false; mesh.vertices];
        let mut seen: Vec<usize> = Vec::new();
        for (v, rim) in on_rim.iter_mut().enumerate() {
            seen.clear();
            for e in &triangles[start[v] as usize..start[v + 1] as usize] {
                seen.extend(mesh.triangles[*e as usize].iter().filter(|w| **w != v));
            }
            seen.sort_unstable();
            *rim = !seen.chunks(2).all(|pair| pair.len() == 2 && pair[0] == pair[1]);
        }
        Self {
            start,
            triangles,
            on_rim,
        }
    }

    fn around(&self, vertex: usize) -> impl Iterator<Item = usize> + Clone + '_ {
        let range = self.start[vertex] as usize..self.start[vertex + 1] as usize;
        self.triangles[range].iter().map(|e| *e as usize)
    }
}

/// What became of a fit.
pub(crate) struct Fit {
    /// Elements whose shape differs from the original's.
    pub(crate) changed: Vec<usize>,
    /// Whether the mesh follows every touch's edge all the way round.
    pub(crate) complete: bool,
}

/// Fits `mesh`, a copy of `original` (only its node positions and curved marks may differ), to the touches.
pub(crate) fn fit(mesh: &mut Mesh, original: &Mesh, neighbours: &Neighbours, touches: &[DiscTouch]) -> Fit {
    let mut fitting = Fitting {
        mesh,
        neighbours,
        touches,
        circle: vec![FREE; original.vertices],
    };
    for which in 0..touches.len() {
        fitting.snap(which);
    }
    let followed = (0..touches.len()).all(|which| fitting.crossed(which).is_empty());
    let (changed, folded) = fitting.finish(original);
    Fit {
        changed,
        complete: followed && !folded,
    }
}

struct Fitting<'a> {
    mesh: &'a mut Mesh,
    neighbours: &'a Neighbours,
    touches: &'a [DiscTouch],
    /// Which touch's edge a vertex is on.
    circle: Vec<u32>,
}

impl Fitting<'_> {
    /// Distance of a vertex beyond a touch's edge, mm; 0 for those moved there.
    fn beyond(&self, which: usize, vertex: usize) -> f64 {
        if self.circle[vertex] == which as u32 {
            0.0
        } else {
            let t = &self.touches[which];
            distance(self.mesh.nodes[vertex], t.centre_mm) - t.radius_mm
        }
    }

    fn worst_around(&self, vertex: usize) -> f64 {
        let quality = |e| {
            let p = self.mesh.corners(e);
            let squares: f64 = (0..3).map(|k| distance(p[k], p[(k + 1) % 3]).powi(2)).sum();
            2.0 * 3.0_f64.sqrt() * cross(p[0], p[1], p[2]) / squares
        };
        self.neighbours.around(vertex).map(quality).fold(1.0, f64::min)
    }

    /// Ends of edges that a touch's edge crosses, the nearest (against the edge's length) first.
    fn crossed(&self, which: usize) -> Vec<usize> {
        let mut ends: Vec<(f64, usize)> = Vec::new();
        let beyond: Vec<f64> = (0..self.mesh.vertices).map(|v| self.beyond(which, v)).collect();
        for t in &self.mesh.triangles {
            for k in 0..3 {
                let (a, b) = (t[k], t[(k + 1) % 3]);
                if beyond[a] * beyond[b] < 0.0 {
                    let h = distance(self.mesh.nodes[a], self.mesh.nodes[b]);
                    ends.extend([a, b].map(|v| (beyond[v].abs() / h, v)));
                }
            }
        }
        ends.sort_by(|a, b| a.1.cmp(&b.1).then(a.0.total_cmp(&b.0)));
        ends.dedup_by_key(|e| e.1);
        ends.sort_by(|a, b| a.0.total_cmp(&b.0));
        ends.into_iter().map(|e| e.1).collect()
    }

    fn snap(&mut self, which: usize) {
        let ends = self.crossed(which);
        for (least, three) in ROUNDS {
            for v in &ends {
                self.pull(which, *v, least, three);
            }
            self.give_way(which, &ends);
        }
    }

    /// Moves a vertex onto the touch's edge if one of its edges is crossed and its elements stay good.
    fn pull(&mut self, which: usize, v: usize, least: f64, three: bool) {
        if self.neighbours.on_rim[v] || self.circle[v] != FREE {
            return;
        }
        let d = self.beyond(which, v);
        let elements = self.neighbours.around(v);
        let vertices = |e: usize| self.mesh.triangles[e].into_iter();
        let crossed = elements
            .clone()
            .any(|e| vertices(e).any(|w| self.beyond(which, w) * d < 0.0));
        let whole = |e: usize| vertices(e).filter(|w| self.circle[*w] == which as u32).count() == 2;
        if !crossed || (!three && elements.clone().any(whole)) {
            return;
        }
        let here = self.mesh.nodes[v];
        self.mesh.nodes[v] = onto(&self.touches[which], here);
        if self.worst_around(v) < least {
            self.mesh.nodes[v] = here;
        } else {
            self.circle[v] = which as u32;
        }
    }

    /// Moves free vertices near by to the mean of their neighbours where that improves their elements.
    fn give_way(&mut self, which: usize, ends: &[usize]) {
        let mut free: Vec<usize> = ends
            .iter()
            .filter(|v| self.circle[**v] == which as u32)
            .flat_map(|v| self.neighbours.around(*v))
            .flat_map(|e| self.mesh.triangles[e])
            .filter(|v| self.circle[*v] == FREE && !self.neighbours.on_rim[*v])
            .collect();
        free.sort_unstable();
        free.dedup();
        for v in free {
            let here = self.mesh.nodes[v];
            let before = self.worst_around(v);
            let sides: Vec<f64> = (0..self.touches.len()).map(|t| self.beyond(t, v)).collect();
            let (mut sum, mut count) = ([0.0; 2], 0.0);
            for w in self.neighbours.around(v).flat_map(|e| self.mesh.triangles[e]) {
                if w != v {
                    sum[0] += self.mesh.nodes[w][0];
                    sum[1] += self.mesh.nodes[w][1];
                    count += 1.0;
                }
            }
            self.mesh.nodes[v] = [sum[0] / count, sum[1] / count];
            let crosses = sides.iter().enumerate().any(|(t, d)| self.beyond(t, v) * d <= 0.0);
            if crosses || self.worst_around(v) <= before {
                self.mesh.nodes[v] = here;
            }
        }
    }

    /// Places the mid-edge nodes; returns the elements whose shape changed, and whether some had to stay straight.
    fn finish(self, original: &Mesh) -> (Vec<usize>, bool) {
        let Self {
            mesh,
            neighbours,
            touches,
            circle,
        } = self;
        let on = |a: usize, b: usize| (circle[a] != FREE && circle[a] == circle[b]).then_some(circle[a]);
        let sides = |t: [usize; 3]| [0, 1, 2].map(|k| (t[k], t[(k + 1) % 3], t[(k + 2) % 3]));
        let changed: Vec<usize> = (0..original.triangles.len())
            .filter(|e| {
                let t = original.triangles[*e];
                t.iter().any(|v| mesh.nodes[*v] != original.nodes[*v])
                    || sides(t).iter().any(|(a, b, _)| on(*a, *b).is_some())
            })
            .collect();
        let Some(middles) = (!mesh.middles.is_empty()).then(|| mesh.middles.clone()) else {
            return (changed, false);
        };
        // An edge with both ends on a circle follows it when it parts the disc from the rest. (The third vertex of an
        // element with all three on the circle is inside.)
        let mut seen: Vec<(usize, bool)> = Vec::new();
        let mut arcs: Vec<(usize, Point)> = Vec::new();
        for element in &changed {
            for (k, (a, b, c)) in sides(original.triangles[*element]).into_iter().enumerate() {
                let middle = middles[*element][k];
                if neighbours.on_rim[a] && neighbours.on_rim[b] {
                    continue;
                }
                mesh.nodes[middle] = half_way(mesh.nodes[a], mesh.nodes[b]);
                let Some(which) = on(a, b) else { continue };
                let t = &touches[which as usize];
                let outside = circle[c] != which && distance(mesh.nodes[c], t.centre_mm) > t.radius_mm;
                if seen.contains(&(middle, !outside)) {
                    arcs.push((middle, onto(t, mesh.nodes[middle])));
                }
                seen.push((middle, outside));
            }
        }
        for (middle, p) in &arcs {
            mesh.nodes[*middle] = *p;
        }
        for element in &changed {
            mesh.curved[*element] |= middles[*element].iter().any(|m| arcs.iter().any(|(a, _)| a == m));
        }
        // What is folded all the same is straightened; its jump is averaged.
        let folded: Vec<usize> = changed
            .iter()
            .filter(|e| {
                let [a, b, c] = mesh.corners(**e);
                let least = LEAST_DETERMINANT * cross(a, b, c);
                mesh.curved[**e] && DEGREE_4.iter().any(|(l, _)| gradients(mesh, **e, *l).2 < least)
            })
            .copied()
            .collect();
        for element in &folded {
            for (k, (a, b, _)) in sides(original.triangles[*element]).into_iter().enumerate() {
                if on(a, b).is_some() {
                    mesh.nodes[middles[*element][k]] = half_way(mesh.nodes[a], mesh.nodes[b]);
                }
            }
        }
        (changed, !folded.is_empty())
    }
}

fn half_way(a: Point, b: Point) -> Point {
    [0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])]
}

/// The nearest point on a touch's edge.
fn onto(touch: &DiscTouch, p: Point) -> Point {
    let [x, y] = touch.centre_mm;
    let s = touch.radius_mm / distance(p, touch.centre_mm).max(f64::MIN_POSITIVE);
    [x + s * (p[0] - x), y + s * (p[1] - y)]
}
