//! Orthonormal vectors, and what lies along them.

/// A direction of which less than this part (of its square) is new lies in those before it.
const DEPENDENT: f64 = 1e-12;

/// Orthonormal vectors of one length. Nothing is allocated once it is as large as it gets.
#[derive(Clone, Debug, Default)]
pub(crate) struct Basis {
    /// One after the other.
    columns: Vec<f64>,
}

impl Basis {
    pub(crate) fn clear(&mut self) {
        self.columns.clear();
    }

    /// Adds what is new of a vector.
    pub(crate) fn add(&mut self, v: &[f64]) {
        let start = self.columns.len();
        self.columns.extend_from_slice(v);
        let (before, new) = self.columns.split_at_mut(start);
        let whole = square(new);
        // Twice: then it is orthogonal to rounding.
        take_away(before, new);
        let rest = take_away(before, new);
        if rest > DEPENDENT * whole {
            new.iter_mut().for_each(|v| *v /= rest.sqrt());
        } else {
            self.columns.truncate(start);
        }
    }

    /// Takes away what of a vector lies along these; the square of the rest.
    pub(crate) fn outside(&self, v: &mut [f64]) -> f64 {
        take_away(&self.columns, v)
    }
}

fn take_away(columns: &[f64], v: &mut [f64]) -> f64 {
    for q in columns.chunks_exact(v.len().max(1)) {
        let part: f64 = q.iter().zip(&*v).map(|(a, b)| a * b).sum();
        v.iter_mut().zip(q).for_each(|(v, q)| *v -= part * q);
    }
    square(v)
}

fn square(v: &[f64]) -> f64 {
    v.iter().map(|v| v * v).sum()
}
