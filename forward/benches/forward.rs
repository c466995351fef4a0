//! What the forward model costs on one core: set-up by stage, re-solve, low-rank update, unchanged scene, sensitivity.
//!
//!     cargo bench -p skin-forward
#![allow(clippy::unwrap_used, missing_docs)]

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use forward::field::conductivity_of_discs;
use forward::{
    CellGrid, DiscTouch, Drive, Geometry, Mesh, Model, ModelOptions, Pattern, Sensitivity, Sheet, Solver, Work,
};
use std::hint::black_box;
use std::sync::Arc;

const TOUCH: DiscTouch = DiscTouch {
    centre_mm: [35.0, 20.0],
    radius_mm: 12.5,
    rise: 3.0,
};

fn model() -> Arc<Model> {
    Arc::new(Model::new(&Sheet::paper(), &ModelOptions::default()).unwrap())
}

/// A state in which every element differs from any other such state.
fn everywhere(model: &Model, k: &mut f64) -> Vec<[f64; 3]> {
    *k += 1e-6;
    vec![[1.0 + *k, 0.0, 1.0]; model.mesh().triangles.len()]
}

fn set_up(c: &mut Criterion) {
    let mut group = c.benchmark_group("set-up");
    let sheet = Sheet::paper();
    let options = ModelOptions::default();
    let model = model();
    let geometry = Geometry::new(&sheet).unwrap();
    let sizes = Model::sizes(&sheet, &options).unwrap();
    let pattern = Pattern::adjacent(16).unwrap();
    let grid = CellGrid::new(&geometry, 5.0).unwrap();
    let solver = Solver::new(model.clone()).unwrap();
    let sensitivity = Sensitivity::by_cell(&solver, &grid);
    group.bench_function("geometry", |b| b.iter(|| Geometry::new(black_box(&sheet)).unwrap()));
    group.bench_function("mesh", |b| {
        b.iter(|| Mesh::new(&geometry, &sizes, options.order).unwrap());
    });
    group.bench_function("model (geometry, mesh, integrals, elimination order)", |b| {
        b.iter(|| Model::new(black_box(&sheet), &options).unwrap());
    });
    group.bench_function("solver (assembly, factorisation, electrodes)", |b| {
        b.iter(|| Solver::new(model.clone()).unwrap());
    });
    group.bench_function("potentials of 16 electrodes", |b| b.iter(|| solver.potentials_v()));
    group.bench_function("cells of 5 mm", |b| b.iter(|| CellGrid::new(&geometry, 5.0).unwrap()));
    group.bench_function("sensitivity by 1184 cells", |b| {
        b.iter(|| Sensitivity::by_cell(&solver, &grid));
    });
    group.bench_function("sensitivity matrix 208 x 1184", |b| {
        b.iter(|| sensitivity.matrix_v(Drive::PAPER, solver.electrode_matrix(), &pattern));
    });
    let all = |options: &ModelOptions| {
        let model = Arc::new(Model::new(&sheet, options).unwrap());
        let mut solver = Solver::new(model.clone()).unwrap();
        if !options.touches.is_empty() {
            solver
                .solve(&conductivity_of_discs(model.mesh(), &options.touches))
                .unwrap();
        }
        let grid = CellGrid::new(model.geometry(), 5.0).unwrap();
        let sensitivity = Sensitivity::by_cell(&solver, &grid);
        sensitivity.matrix_v(Drive::PAPER, solver.electrode_matrix(), &pattern)
    };
    group.bench_function("all of it", |b| b.iter(|| all(&options)));
    let own = ModelOptions::for_touches(&[TOUCH]);
    group.bench_function("all of it, mesh made for a touch", |b| b.iter(|| all(&own)));
    group.finish();
}

fn re_solve(c: &mut Criterion) {
    let mut group = c.benchmark_group("re-solve");
    let model = model();
    let mut solver = Solver::new(model.clone()).unwrap();
    let mut k = 0.0;
    group.bench_function("new factorisation", |b| {
        b.iter(|| {
            let conductivity = everywhere(&model, &mut k);
            solver.solve(&conductivity).unwrap();
            assert_eq!(solver.work(), Work::Factorisation);
        });
    });
    // Around a circle, so that every state is new.
    let mut angle: f64 = 0.0;
    group.bench_function("mesh fitted to a touch", |b| {
        b.iter(|| {
            angle += 0.01;
            let centre_mm = [60.0 * angle.cos(), 60.0 * angle.sin()];
            solver.solve_touches(&[DiscTouch { centre_mm, ..TOUCH }]).unwrap();
        });
    });
    solver.solve_touches(&[TOUCH]).unwrap();
    group.bench_function("unchanged touches", |b| {
        b.iter(|| {
            solver.solve_touches(&[TOUCH]).unwrap();
            assert_eq!(solver.work(), Work::Nothing);
        });
    });
    let same = everywhere(&model, &mut k);
    solver.solve(&same).unwrap();
    group.bench_function("unchanged conductivities", |b| {
        b.iter(|| {
            solver.solve(&same).unwrap();
            assert_eq!(solver.work(), Work::Nothing);
        });
    });
    group.finish();
}

fn low_rank(c: &mut Criterion) {
    let mut group = c.benchmark_group("few elements changed");
    let model = model();
    let elements = model.mesh().triangles.len();
    // The elements nearest to a place on the sheet.
    let far = |e: &usize| {
        let [x, y] = model.mesh().corners(*e)[0];
        (x - 35.0).hypot(y - 20.0)
    };
    let mut near: Vec<usize> = (0..elements).collect();
    near.sort_by(|a, b| far(a).total_cmp(&far(b)));
    for count in [1, 4, 16, 32, 64] {
        let mut solver = Solver::new(model.clone()).unwrap();
        let mut k = 0.0;
        group.bench_function(BenchmarkId::from_parameter(count), |b| {
            b.iter(|| {
                k += 1e-6;
                let mut conductivity = vec![[1.0, 0.0, 1.0]; elements];
                for e in &near[..count] {
                    conductivity[*e] = [1.2 + k, 0.0, 1.2 + k];
                }
                solver.solve(&conductivity).unwrap();
            });
        });
        println!("{count} elements: {:?}", solver.work());
    }
    group.finish();
}

fn settings() -> Criterion {
    Criterion::default().sample_size(50)
}

criterion_group! {
    name = benches;
    config = settings();
    targets = set_up, re_solve, low_rank
}
criterion_main!(benches);
