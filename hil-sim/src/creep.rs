//! What the rubber has kept of the pressures on it so far.
//!
//! All delayed strain is `delayed_per_mpa q` with the delayed pressure q of `retardation_s dq/dt = p - q`, which is linear in
//! p. A flat tip that stands still leaves an imprint with its own sharp edge, kept as a disc; all else (what is smooth, and
//! the trail of a moving edge, which is continuous) is kept at the points of the mesh's elements.

use crate::material::Kernel;
use crate::pressure::Bump;
use crate::scene::Scene;
use forward::Mesh;
use forward::field::{POINTS, points};

/// Least strain of an imprint that keeps its sharp edge; a fainter one becomes part of the smooth field. Less keeps more
/// discs, whose edges the mesh has to follow; more blurs edges that can be measured.
const FAINT: f64 = 1e-7;

/// What a flat tip left where it stood.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Imprint {
    pub(crate) centre_mm: [f64; 2],
    pub(crate) radius_mm: f64,
    pub(crate) delayed_mpa: f64,
    /// Whether it was pressed in the last step.
    pressed: bool,
}

impl Imprint {
    fn of(bump: &Bump, delayed_mpa: f64) -> Self {
        Self {
            centre_mm: bump.centre_mm,
            radius_mm: bump.half_axes_mm[0],
            delayed_mpa,
            pressed: true,
        }
    }

    fn bump(&self) -> Bump {
        Bump {
            flat: true,
            centre_mm: self.centre_mm,
            half_axes_mm: [self.radius_mm; 2],
            direction: [1.0, 0.0],
            peak_mpa: self.delayed_mpa,
        }
    }
}

/// The delayed pressure all over a sheet.
#[derive(Debug)]
pub(crate) struct Creep {
    t_s: f64,
    imprints: Vec<Imprint>,
    /// At the points of every element, MPa.
    field: Vec<[f64; POINTS]>,
    /// Whether the field is 0 everywhere.
    empty: bool,
}

impl Creep {
    pub(crate) fn new(scene: &Scene, points: &Points) -> Self {
        let mut this = Self {
            t_s: 0.0,
            imprints: Vec::new(),
            field: vec![[0.0; POINTS]; points.elements.len()],
            empty: true,
        };
        if scene.preloaded && scene.material.creeps() {
            for bump in scene.truth(0.0).iter().flat_map(|t| t.bumps()) {
                if bump.flat {
                    this.imprint(&bump, bump.peak_mpa);
                } else {
                    this.add(points, &bump, |p| bump.pressure_mpa(p));
                }
            }
        }
        this
    }

    /// Lets time pass; a time before the present one changes nothing.
    pub(crate) fn advance(&mut self, scene: &Scene, points: &Points, t_s: f64) {
        if !scene.material.creeps() {
            return;
        }
        for step in scene.steps(self.t_s, t_s) {
            self.t_s = step.end_s;
            let kernel = Kernel::new(&scene.material, step.duration_s);
            self.decay(kernel.decay);
            for (from, to) in step.bumps() {
                if from.flat && from.centre_mm == to.centre_mm {
                    self.imprint(&from, kernel.added([from.peak_mpa, to.peak_mpa]));
                } else {
                    let way = (0..2)
                        .map(|k| (to.centre_mm[k] - from.centre_mm[k]).abs())
                        .fold(0.0, f64::max);
                    let mut around = from;
                    around.half_axes_mm = [from.reach_mm().max(to.reach_mm()) + 2.0 * way; 2];
                    self.add(points, &around, |p| from.delayed_mpa(&to, &kernel, p));
                }
            }
        }
        self.forget(points, FAINT / scene.material.delayed_per_mpa);
    }

    /// Faint imprints lose their edge, and a faint field becomes none.
    fn forget(&mut self, points: &Points, faint_mpa: f64) {
        let (kept, faded): (Vec<Imprint>, Vec<Imprint>) = std::mem::take(&mut self.imprints)
            .into_iter()
            .partition(|i| i.pressed || i.delayed_mpa > faint_mpa);
        self.imprints = kept;
        for old in &faded {
            let bump = old.bump();
            self.add(points, &bump, |p| bump.pressure_mpa(p));
        }
        if !self.empty && faded.is_empty() && self.field.as_flattened().iter().all(|q| *q < 1e-3 * faint_mpa) {
            self.field.fill([0.0; POINTS]);
            self.empty = true;
        }
    }

    /// What stands out with a sharp edge.
    pub(crate) fn imprints(&self) -> &[Imprint] {
        &self.imprints
    }

    /// The rest, at the points of every element; `None` while there is nothing.
    pub(crate) fn field(&self) -> Option<&[[f64; POINTS]]> {
        (!self.empty).then_some(&self.field)
    }

    fn decay(&mut self, factor: f64) {
        for imprint in &mut self.imprints {
            imprint.delayed_mpa *= factor;
            imprint.pressed = false;
        }
        if !self.empty {
            self.field.as_flattened_mut().iter_mut().for_each(|q| *q *= factor);
        }
    }

    fn imprint(&mut self, bump: &Bump, added_mpa: f64) {
        let new = Imprint::of(bump, added_mpa);
        let same = |i: &&mut Imprint| i.centre_mm == new.centre_mm && i.radius_mm == new.radius_mm;
        match self.imprints.iter_mut().find(same) {
            Some(old) => {
                old.delayed_mpa += added_mpa;
                old.pressed = true;
            }
            None => self.imprints.push(new),
        }
    }

    /// Adds to the field where `around` reaches.
    fn add(&mut self, points: &Points, around: &Bump, added: impl Fn([f64; 2]) -> f64) {
        self.empty = false;
        points.within(around, |element| {
            for (q, p) in self.field[element].iter_mut().zip(&points.elements[element].points) {
                *q += added(*p);
            }
        });
    }
}

/// Where the points of a mesh's elements are.
#[derive(Debug)]
pub(crate) struct Points {
    pub(crate) elements: Vec<Element>,
}

#[derive(Debug)]
pub(crate) struct Element {
    pub(crate) points: [[f64; 2]; POINTS],
    centre: [f64; 2],
    reach: f64,
}

impl Points {
    pub(crate) fn new(mesh: &Mesh) -> Self {
        let element = |element| {
            let corners = mesh.corners(element);
            let centre = [0, 1].map(|k| corners.iter().map(|c| c[k]).sum::<f64>() / 3.0);
            let reach = corners.iter().map(|c| libm::hypot(c[0] - centre[0], c[1] - centre[1]));
            Element {
                points: points(mesh, element),
                centre,
                reach: reach.fold(0.0, f64::max),
            }
        };
        Self {
            elements: (0..mesh.triangles.len()).map(element).collect(),
        }
    }

    /// The elements that a bump may touch.
    pub(crate) fn within(&self, bump: &Bump, mut f: impl FnMut(usize)) {
        let reach = bump.reach_mm();
        for (k, element) in self.elements.iter().enumerate() {
            let [dx, dy] = [0, 1].map(|i| element.centre[i] - bump.centre_mm[i]);
            let far = reach + element.reach;
            if dx * dx + dy * dy < far * far {
                f(k);
            }
        }
    }
}
