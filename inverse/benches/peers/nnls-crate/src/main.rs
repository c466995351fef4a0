//! Times the crate `nnls` on the problems in a folder, and writes its solutions and times there for `peers.py`.
//!
//! `cargo run --release --manifest-path host/benches/peers/nnls-crate/Cargo.toml -- FOLDER`

use ndarray::{Array1, Array2, Axis, concatenate, s};
use ndarray_npy::{read_npy, write_npy};
use std::error::Error;
use std::path::Path;
use std::time::{Duration, Instant};

/// Best of as many runs, or of those that fit the time.
const RUNS: usize = 12;
const MOST: Duration = Duration::from_secs(1);
/// Frames of a problem with a ridge, which takes seconds each.
const FEW: usize = 2;

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args().nth(1).ok_or("give the folder with the problems")?;
    let mut names: Vec<String> = std::fs::read_dir(&folder)?
        .filter_map(|e| e.ok()?.file_name().into_string().ok())
        .filter_map(|f| f.strip_suffix("_a.npy").map(str::to_owned))
        .collect();
    names.sort();
    for name in names {
        solve(Path::new(&folder), &name)?;
    }
    Ok(())
}

fn solve(folder: &Path, name: &str) -> Result<(), Box<dyn Error>> {
    let file = |part: &str| folder.join(format!("{name}_{part}.npy"));
    let a: Array2<f64> = read_npy(file("a"))?;
    let b: Array2<f64> = read_npy(file("b"))?;
    let ridge: Array2<f64> = read_npy(file("ridge"))?;
    let (ridge, cells) = (ridge[[0, 0]], a.ncols());
    let whole = if ridge > 0.0 {
        concatenate(Axis(0), &[a.view(), (Array2::eye(cells) * ridge).view()])?
    } else {
        a.as_standard_layout().to_owned()
    };
    let frames = if ridge > 0.0 { FEW } else { b.ncols() };
    let mut x = Array2::zeros((cells, frames));
    let mut times = Vec::new();
    for k in 0..frames {
        let mut right = Array1::zeros(whole.nrows());
        right.slice_mut(s![..b.nrows()]).assign(&b.column(k));
        let (mut best, begin) = (f64::INFINITY, Instant::now());
        for _ in 0..RUNS {
            let start = Instant::now();
            let (solution, _) = nnls::nnls(whole.view(), right.view());
            best = best.min(start.elapsed().as_secs_f64() * 1e6);
            x.column_mut(k).assign(&solution);
            if begin.elapsed() > MOST {
                break;
            }
        }
        times.push(best);
    }
    times.sort_by(f64::total_cmp);
    let median = times[times.len() / 2];
    println!("{name}: {median:.0} us");
    write_npy(file("x.crate-nnls"), &x)?;
    write_npy(file("us.crate-nnls"), &Array2::from_elem((1, 1), median))?;
    Ok(())
}
