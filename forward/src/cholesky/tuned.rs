//! The factorisation in the widest vector unit that is found at run time. Left-looking by supernodes (Ng and Peyton 1993);
//! every product is summed from the first column to the last with fused multiply-adds where the processor has them, so
//! that the width of the vectors changes no bit.

use super::structure::Structure;
use super::{CholeskyError, Factor, Symbolic};
use pulp::{Arch, Simd, WithSimd};
use std::ops::Range;

/// Columns of a supernode that are factorised at once.
const PANEL: usize = 64;
/// Most columns whose update is made from one product.
const WIDEST: usize = 128;
/// Most columns that are solved for without a product.
const FEW: usize = 4;
/// Most terms of one sum: longer ones are subtracted in parts.
const LONGEST: usize = 512;
/// Columns of a product computed at once.
const COLUMNS: usize = 4;

impl Factor {
    /// Factorises; `values` are in the pattern's slots.
    pub(crate) fn factorize(&mut self, symbolic: &Symbolic, values: &[f64]) -> Result<(), CholeskyError> {
        Arch::new()
            .dispatch(Run {
                factor: &mut self.values,
                symbolic,
                values,
            })
            .map_err(|unknown| CholeskyError::NotPositiveDefinite { unknown })
    }
}

struct Run<'a> {
    factor: &'a mut [f64],
    symbolic: &'a Symbolic,
    values: &'a [f64],
}

impl WithSimd for Run<'_> {
    type Output = Result<(), usize>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        let Self {
            factor,
            symbolic,
            values,
        } = self;
        let structure = &symbolic.structure;
        let mut local = vec![0; symbolic.n];
        let (mut products, mut places) = (Vec::new(), Vec::new());
        let (mut steps, mut steps_of) = (Vec::new(), 0);
        for s in 0..structure.count() {
            let own = structure.columns(s);
            let below = structure.below(s);
            let (width, height) = (own.len(), own.len() + below.len());
            for (k, row) in own.clone().chain(below.iter().copied()).enumerate() {
                local[row] = k;
            }
            let (done, rest) = factor.split_at_mut(structure.block(s).start);
            let block = &mut rest[..width * height];
            block.fill(0.0);
            for (column, block) in own.clone().zip(block.chunks_exact_mut(height)) {
                for slot in symbolic.column_start[column]..symbolic.column_start[column + 1] {
                    block[local[symbolic.row_index[slot]]] = values[slot];
                }
            }
            for d in structure.descendants(s) {
                let source = Source::reaching(structure, done, *d, &own);
                places.clear();
                places.extend(source.rows.iter().map(|row| local[*row]));
                for first in (0..source.width).step_by(LONGEST) {
                    let terms = first..source.width.min(first + LONGEST);
                    let rows = source.first..source.height;
                    let columns = source.first..source.first + source.columns;
                    let terms = &source.values[terms.start * source.height..terms.end * source.height];
                    products.resize(source.columns * rows.len(), 0.0);
                    multiply::<S, false>(
                        simd,
                        terms,
                        source.height,
                        rows.clone(),
                        columns,
                        &mut products,
                        rows.len(),
                    );
                    for (j, product) in products.chunks_exact(places.len()).enumerate() {
                        let column = &mut block[places[j] * height..][..height];
                        for (place, value) in places[j..].iter().zip(&product[j..]) {
                            column[*place] -= value;
                        }
                    }
                }
            }
            if steps_of != width {
                steps.clear();
                plan(0..width, &mut steps);
                steps_of = width;
            }
            for step in &steps {
                dense(simd, block, height, step.upto(height)).map_err(|column| own.start + column)?;
            }
        }
        Ok(())
    }
}

/// An earlier supernode, from its first row in a later one on.
struct Source<'a> {
    values: &'a [f64],
    height: usize,
    width: usize,
    /// Its first row in the later one, within its block.
    first: usize,
    rows: &'a [usize],
    /// How many of the rows are columns of the later one.
    columns: usize,
}

impl<'a> Source<'a> {
    #[inline(always)]
    fn reaching(structure: &'a Structure, done: &'a [f64], d: usize, own: &Range<usize>) -> Self {
        let width = structure.columns(d).len();
        let below = structure.below(d);
        let skipped = below.partition_point(|row| *row < own.start);
        let rows = &below[skipped..];
        Self {
            values: &done[structure.block(d)],
            height: width + below.len(),
            width,
            first: width + skipped,
            rows,
            columns: rows.partition_point(|row| *row < own.end),
        }
    }
}

/// What is done with a block, in order. Rows that end at [`END`] go to the end of the block.
#[derive(Clone, Debug)]
enum Step {
    /// Factorises the diagonal block of these columns.
    Factorise(Range<usize>),
    /// Solves for the rows below the diagonal block of these few columns.
    Solve { columns: Range<usize>, rows: Range<usize> },
    /// Subtracts from the columns the products of the rows over the terms, from the diagonal on.
    Subtract {
        terms: Range<usize>,
        columns: Range<usize>,
        rows: Range<usize>,
    },
}

const END: usize = usize::MAX;

impl Step {
    #[inline(always)]
    fn upto(&self, height: usize) -> Self {
        let upto = |rows: &Range<usize>| rows.start..rows.end.min(height);
        match self {
            Self::Factorise(columns) => Self::Factorise(columns.clone()),
            Self::Solve { columns, rows } => Self::Solve {
                columns: columns.clone(),
                rows: upto(rows),
            },
            Self::Subtract { terms, columns, rows } => Self::Subtract {
                terms: terms.clone(),
                columns: columns.clone(),
                rows: upto(rows),
            },
        }
    }
}

/// The steps of a supernode of this many columns.
fn plan(columns: Range<usize>, steps: &mut Vec<Step>) {
    plan_factor(columns.clone(), steps);
    plan_solve(columns.clone(), columns.end..END, steps);
}

fn plan_factor(columns: Range<usize>, steps: &mut Vec<Step>) {
    if columns.len() <= PANEL {
        steps.push(Step::Factorise(columns));
        return;
    }
    let most = (columns.len().next_power_of_two() / 2).min(WIDEST);
    let mut first = columns.start;
    while first < columns.end {
        let last = columns.end.min(first + most);
        plan_factor(first..last, steps);
        if last < columns.end {
            plan_solve(first..last, last..columns.end, steps);
            steps.push(Step::Subtract {
                terms: first..last,
                columns: last..columns.end,
                rows: last..columns.end,
            });
        }
        first = last;
    }
}

fn plan_solve(columns: Range<usize>, rows: Range<usize>, steps: &mut Vec<Step>) {
    if columns.len() <= FEW {
        steps.push(Step::Solve { columns, rows });
        return;
    }
    let half = columns.len() / 2;
    let right = match columns.len() {
        32.. => half.next_multiple_of(16),
        16.. => half.next_multiple_of(8),
        8.. => half.next_multiple_of(4),
        _ => half,
    };
    let middle = columns.end - right;
    plan_solve(columns.start..middle, rows.clone(), steps);
    steps.push(Step::Subtract {
        terms: columns.start..middle,
        columns: middle..columns.end,
        rows: rows.clone(),
    });
    plan_solve(middle..columns.end, rows, steps);
}

/// One step; fails at a column whose pivot is not positive.
#[inline(always)]
fn dense<S: Simd>(simd: S, block: &mut [f64], height: usize, step: Step) -> Result<(), usize> {
    match step {
        Step::Factorise(columns) => return factorise(simd, block, height, columns),
        Step::Solve { columns, rows } => solve(simd, block, height, columns, rows),
        Step::Subtract { terms, columns, rows } if !rows.is_empty() => {
            let (before, rest) = block.split_at_mut(columns.start * height);
            let terms = &before[terms.start * height..terms.end * height];
            let out = &mut rest[..columns.len() * height];
            multiply::<S, true>(simd, terms, height, rows, columns, out, height);
        }
        Step::Subtract { .. } => {}
    }
    Ok(())
}

/// Factorises the diagonal block of some columns.
#[inline(always)]
fn factorise<S: Simd>(simd: S, block: &mut [f64], height: usize, columns: Range<usize>) -> Result<(), usize> {
    let mut factors = [0.0; PANEL];
    for j in columns.clone() {
        let (before, rest) = block.split_at_mut(j * height);
        let before = &before[columns.start * height..];
        let column = &mut rest[j..columns.end];
        for (factor, other) in factors.iter_mut().zip(before.chunks_exact(height)) {
            *factor = -other[j];
        }
        let factors = &factors[..j - columns.start];
        let mut row = j;
        for values in column.chunks_mut(FEW * S::F64_LANES) {
            let count = values.len();
            if count == FEW * S::F64_LANES {
                add_multiples::<S, FEW, true>(simd, factors, before, height, row, values);
            } else {
                for (c, values) in values.chunks_mut(S::F64_LANES).enumerate() {
                    add_multiples::<S, 1, false>(simd, factors, before, height, row + c * S::F64_LANES, values);
                }
            }
            row += count;
        }
        let pivot = column[0].sqrt();
        // False for not-a-number too.
        if !(pivot > 0.0 && pivot.is_finite()) {
            return Err(j);
        }
        let inverse = 1.0 / pivot;
        column.iter_mut().for_each(|v| *v *= inverse);
    }
    Ok(())
}

/// Adds to at most `V` vectors of a column, from a row on, the multiples of the columns before.
#[inline(always)]
fn add_multiples<S: Simd, const V: usize, const FULL: bool>(
    simd: S,
    factors: &[f64],
    before: &[f64],
    height: usize,
    row: usize,
    values: &mut [f64],
) {
    let count = values.len();
    let mut sums = load::<S, V, FULL>(simd, values);
    for (factor, other) in factors.iter().zip(before.chunks_exact(height)) {
        let factor = simd.splat_f64s(*factor);
        let other = load::<S, V, FULL>(simd, &other[row..row + count]);
        for (sum, other) in sums.iter_mut().zip(other) {
            *sum = simd.mul_add_e_f64s(factor, other, *sum);
        }
    }
    store::<S, V, FULL>(simd, values, sums);
}

/// At most `V` vectors, exactly so many if `FULL`; what is missing is zero.
#[inline(always)]
fn load<S: Simd, const V: usize, const FULL: bool>(simd: S, values: &[f64]) -> [S::f64s; V] {
    let mut vectors = [simd.splat_f64s(0.0); V];
    if FULL {
        vectors.copy_from_slice(&S::as_simd_f64s(values).0[..V]);
    } else {
        for (vector, values) in vectors.iter_mut().zip(values.chunks(S::F64_LANES)) {
            *vector = simd.partial_load_f64s(values);
        }
    }
    vectors
}

/// Writes what [`load`] reads.
#[inline(always)]
fn store<S: Simd, const V: usize, const FULL: bool>(simd: S, values: &mut [f64], vectors: [S::f64s; V]) {
    if FULL {
        S::as_mut_simd_f64s(values).0[..V].copy_from_slice(&vectors);
    } else {
        for (values, vector) in values.chunks_mut(S::F64_LANES).zip(vectors) {
            simd.partial_store_f64s(values, vector);
        }
    }
}

/// Solves for rows below the diagonal block of at most [`FEW`] columns.
#[inline(always)]
fn solve<S: Simd>(simd: S, block: &mut [f64], height: usize, columns: Range<usize>, rows: Range<usize>) {
    let (first, width) = (columns.start, columns.len());
    let mut factors = [[0.0; FEW]; FEW];
    for j in 0..width {
        let inverse = 1.0 / block[(first + j) * height + first + j];
        for k in 0..j {
            factors[j][k] = -block[(first + k) * height + first + j] * inverse;
        }
        factors[j][j] = inverse;
    }
    let mut row = rows.start;
    while row < rows.end {
        let count = S::F64_LANES.min(rows.end - row);
        let mut solved = [simd.splat_f64s(0.0); FEW];
        for j in 0..width {
            let values = &mut block[(first + j) * height + row..][..count];
            let mut value = simd.mul_f64s(simd.partial_load_f64s(values), simd.splat_f64s(factors[j][j]));
            for (factor, other) in factors[j].iter().zip(&solved[..j]) {
                value = simd.add_f64s(value, simd.mul_f64s(simd.splat_f64s(*factor), *other));
            }
            simd.partial_store_f64s(values, value);
            solved[j] = value;
        }
        row += count;
    }
}

/// Products of rows of a matrix kept by columns, summed over its columns: written to a matrix of these rows and columns,
/// or subtracted from one of all rows. What is above the diagonal is left undefined.
#[inline(always)]
fn multiply<S: Simd, const SUBTRACT: bool>(
    simd: S,
    values: &[f64],
    height: usize,
    rows: Range<usize>,
    columns: Range<usize>,
    out: &mut [f64],
    out_height: usize,
) {
    let tile = |column: usize| Tile {
        values,
        height,
        rows: rows.start.max(column)..rows.end,
        column,
        at: if SUBTRACT { rows.start } else { 0 } + column.saturating_sub(rows.start),
        out_height,
    };
    let together = columns.len() / COLUMNS * COLUMNS;
    let (blocks, rest) = out.split_at_mut(together * out_height);
    for (column, out) in columns
        .clone()
        .step_by(COLUMNS)
        .zip(blocks.chunks_exact_mut(COLUMNS * out_height))
    {
        tile(column).multiply::<S, COLUMNS, SUBTRACT>(simd, out);
    }
    for (column, out) in columns.skip(together).zip(rest.chunks_exact_mut(out_height)) {
        tile(column).multiply::<S, 1, SUBTRACT>(simd, out);
    }
}

struct Tile<'a> {
    values: &'a [f64],
    height: usize,
    rows: Range<usize>,
    column: usize,
    /// Where the first of the rows is in the columns of the result.
    at: usize,
    out_height: usize,
}

impl Tile<'_> {
    #[inline(always)]
    fn multiply<S: Simd, const N: usize, const SUBTRACT: bool>(&self, simd: S, out: &mut [f64]) {
        let length = self.rows.len();
        let mut row = 0;
        while length - row >= 2 * S::F64_LANES {
            self.rows::<S, N, 2, true, SUBTRACT>(simd, row, 2 * S::F64_LANES, out);
            row += 2 * S::F64_LANES;
        }
        while row < length {
            let count = (length - row).min(S::F64_LANES);
            self.rows::<S, N, 1, false, SUBTRACT>(simd, row, count, out);
            row += count;
        }
    }

    /// At most `V` vectors of rows, exactly so many if `FULL`.
    #[inline(always)]
    fn rows<S: Simd, const N: usize, const V: usize, const FULL: bool, const SUBTRACT: bool>(
        &self,
        simd: S,
        row: usize,
        count: usize,
        out: &mut [f64],
    ) {
        let mut sums = [[simd.splat_f64s(0.0); V]; N];
        let first = self.rows.start + row;
        for column in self.values.chunks_exact(self.height) {
            let vectors = load::<S, V, FULL>(simd, &column[first..first + count]);
            for (sums, factor) in sums.iter_mut().zip(&column[self.column..self.column + N]) {
                let factor = simd.splat_f64s(*factor);
                for (sum, vector) in sums.iter_mut().zip(vectors) {
                    *sum = simd.mul_add_e_f64s(vector, factor, *sum);
                }
            }
        }
        for (sums, out) in sums.into_iter().zip(out.chunks_exact_mut(self.out_height)) {
            let out = &mut out[self.at + row..][..count];
            if SUBTRACT {
                let old = load::<S, V, FULL>(simd, out);
                store::<S, V, FULL>(simd, out, std::array::from_fn(|v| simd.sub_f64s(old[v], sums[v])));
            } else {
                store::<S, V, FULL>(simd, out, sums);
            }
        }
    }
}
