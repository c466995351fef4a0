//! All frames of a table: those that stand alone on all cores.

use super::{Batch, reconstructor};
use crate::pipeline::FrameResult;
use crate::reference::imager::ImagerError;
use std::collections::BTreeMap;
use std::num::NonZero;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc;
use std::thread;
use std::time::{Duration, Instant};

/// Most values of frames that are solved at once: what a core makes for itself takes up to 0.8 MB for each.
const MOST_VALUES: usize = 2000;
/// A table that is done in this time is done by one: others would take as long to be ready.
const WORTH_MORE: Duration = Duration::from_millis(200);

impl Batch {
    /// Reconstructs frames, each with its place in the table, and hands over their results in the same order, each with its number in the
    /// list.
    ///
    /// Where frames do not follow one another ([`BatchOptions::interval_s`](super::BatchOptions::interval_s) is none), several cores take part
    /// in a table that takes long: nine at most of frames with 208 values, two of 928, and one of more. What is said of a frame depends on its
    /// own values alone, to the last bit. Results that are done before an earlier one wait for it, some 10 kB each.
    ///
    /// Where frames do follow one another, nothing pressed at the places between them ([`Batch::pass_over`]).
    ///
    /// # Errors
    /// [`ImagerError::Baseline`] at the first frame that does not have the pattern's length: `each` has had all before it.
    pub fn frames(
        &mut self,
        frames: &[(usize, &[f64])],
        mut each: impl FnMut(usize, FrameResult),
    ) -> Result<(), ImagerError> {
        let workers = match self.interval_s {
            Some(_) => 1,
            None => self.workers(),
        };
        let (begin, mut next) = (Instant::now(), 0);
        for (number, (place, values)) in frames.iter().enumerate() {
            let left = &frames[number..];
            let workers = workers.min(left.len());
            if workers > 1 && begin.elapsed() > WORTH_MORE {
                let mut each = |of, result| each(number + of, result);
                if self.frames_alone(workers, left, &mut each)? {
                    return Ok(());
                }
            }
            for between in next..*place {
                self.pass_over(between);
            }
            next = place + 1;
            each(number, self.frame(*place, values)?);
        }
        Ok(())
    }

    /// How many cores may take part.
    fn workers(&self) -> usize {
        let most = MOST_VALUES / self.imager().pattern.len().max(1);
        thread::available_parallelism().map_or(1, NonZero::get).min(most)
    }

    /// The same by so many threads; false, and nothing done, where there is none to be had.
    fn frames_alone(
        &mut self,
        workers: usize,
        frames: &[(usize, &[f64])],
        each: &mut impl FnMut(usize, FrameResult),
    ) -> Result<bool, ImagerError> {
        let (inspection, how, tells_noise) = (&self.inspection, self.how, self.tells_noise);
        let (next, mut own) = (AtomicUsize::new(0), Some(&mut self.reconstructor));
        let (sender, receiver) = mpsc::channel();
        thread::scope(|scope| {
            for worker in 0..workers {
                let (own, sender, next) = (own.take(), sender.clone(), &next);
                let work = move || {
                    let mut made = None;
                    let solver = match own {
                        Some(own) => own,
                        // Where none can be made, the others do its part.
                        None => match reconstructor(inspection, how, tells_noise) {
                            Ok(new) => made.insert(new),
                            Err(_) => return,
                        },
                    };
                    while let number = next.fetch_add(1, Ordering::Relaxed)
                        && let Some((_, values)) = frames.get(number)
                    {
                        let result = solver.frame(values).map(|result| inspection.doubted(result.clone()));
                        if sender.send((number, result)).is_err() {
                            return;
                        }
                    }
                };
                match thread::Builder::new().spawn_scoped(scope, work) {
                    Ok(_) => {}
                    Err(_) if worker == 0 => return Ok(false),
                    // Those that there are do the others' part.
                    Err(_) => break,
                }
            }
            drop(sender);
            let (mut waiting, mut number) = (BTreeMap::new(), 0);
            for (done, result) in receiver {
                waiting.insert(done, result);
                while let Some(result) = waiting.remove(&number) {
                    each(number, result?);
                    number += 1;
                }
            }
            Ok(true)
        })
    }
}

#[cfg(test)]
mod tests {
    use crate::batch::{Batch, BatchOptions};
    use crate::force::meter::Calibration;
    use crate::force::solid::Solid;
    use crate::pipeline::FrameResult;
    use crate::reference::imager::Imager;
    use crate::solvers::Method;
    use crate::touches::polarity::Polarity;
    use forward::{DiscTouch, Drive, Pattern, Sheet, Solver};
    use rand::{Rng, SeedableRng, rngs::StdRng};
    use rand_distr::StandardNormal;
    use std::sync::Arc;

    fn touch(x: f64, y: f64, rise: f64) -> DiscTouch {
        DiscTouch {
            centre_mm: [x, y],
            radius_mm: 8.0,
            rise,
        }
    }

    fn imager(electrodes: usize, drive: Drive) -> Arc<Imager> {
        let sheet = Sheet::disc(195.0, electrodes, 4.0, 1.0, 1000.0);
        Arc::new(Imager::new(&sheet, drive, Pattern::adjacent(electrodes).unwrap(), 15.0).unwrap())
    }

    /// The unpressed sheet, and frames of all that leaves something behind where frames follow one another.
    fn table(imager: &Imager) -> (Vec<Vec<f64>>, Vec<Vec<f64>>) {
        let hand = [(-40.0, 20.0), (-20.0, 45.0), (8.0, 50.0), (35.0, 35.0), (10.0, -30.0)];
        let scenes = [
            vec![],
            hand.map(|(x, y)| touch(x, y, 0.6)).to_vec(),
            vec![touch(30.0, -20.0, 0.3)],
            vec![touch(30.0, -20.0, -0.4)],
            vec![touch(-30.0, 5.0, 0.4), touch(32.0, 5.0, -0.3)],
            // One at the rim, and two that overlap: multipoles do not tell them.
            vec![touch(0.0, 88.0, 1.5), touch(0.0, -60.0, 1.0), touch(4.0, -50.0, 1.0)],
            vec![touch(5.0, 5.0, 0.1)],
        ];
        let mut solver = Solver::new(Arc::clone(&imager.model)).unwrap();
        let solved = scenes.iter().map(|scene| {
            let potentials = solver.solve_touches_here(scene).unwrap();
            imager.drive.frame_v(potentials, &imager.pattern)
        });
        let solved: Vec<Vec<f64>> = solved.collect();
        let mut rng = StdRng::seed_from_u64(11);
        let noisy = |v: &[f64], rng: &mut StdRng| -> Vec<f64> {
            v.iter()
                .map(|v| v + 2e-5 * rng.sample::<f64, _>(StandardNormal))
                .collect()
        };
        let unpressed = (0..10).map(|_| noisy(&solved[0], &mut rng)).collect();
        let mut frames: Vec<Vec<f64>> = solved.iter().map(|v| noisy(v, &mut rng)).collect();
        let broken: [fn(usize, f64) -> f64; 5] = [
            |k, v| if k % 16 == 3 { 0.4 * v } else { v },
            |k, v| if k < 26 { 0.0 } else { v },
            |k, v| if k == 60 { 20.0 * v } else { v },
            |k, v| if k == 61 { f64::NAN } else { v },
            |_, v| 0.6 * v,
        ];
        for (of, broken) in [0, 2, 2, 5, 1].into_iter().zip(broken) {
            let values = frames[of].iter().enumerate();
            let frame = values.map(|(k, v)| broken(k, *v)).collect();
            frames.push(frame);
        }
        (unpressed, frames)
    }

    fn batch(imager: &Arc<Imager>, unpressed: &[Vec<f64>], options: BatchOptions) -> Batch {
        let unpressed: Vec<&[f64]> = unpressed.iter().map(Vec::as_slice).collect();
        Batch::new(Arc::clone(imager), &unpressed, options).unwrap()
    }

    /// All that is said of a frame, to the last bit, but for the time that it took.
    fn said(result: FrameResult) -> String {
        let result = FrameResult {
            solve_us: 0.0,
            ..result
        };
        format!("{result:?}")
    }

    /// A frame of a table has one result, to the last bit: as the first of its table, after any other, and beside others. Whatever is known
    /// of the noise and of the sign of touches, by every method, and where values are so many that responses are made as they are needed.
    #[test]
    fn a_frame_of_a_table_stands_alone() {
        let current = Drive::Current { amplitude_a: 1e-3 };
        let rise = Some(Polarity::Up);
        for (method, polarity, baseline, drive, electrodes) in [
            (Method::Nnls, None, 10, Drive::PAPER, 16),
            (Method::Nnls, rise, 10, current, 16),
            (Method::Nnls, None, 1, Drive::PAPER, 16),
            (Method::Nnls, rise, 10, Drive::PAPER, 32),
            (Method::LawsonHanson, None, 10, Drive::PAPER, 16),
            (Method::Tikhonov, None, 10, Drive::PAPER, 16),
        ] {
            let imager = imager(electrodes, drive);
            let (unpressed, mut frames) = table(&imager);
            if electrodes > 16 {
                // They take seconds each.
                frames = [2, 6, 9, 0].map(|k| frames[k].clone()).to_vec();
            }
            let options = BatchOptions {
                polarity,
                ..BatchOptions::of(method)
            };
            let new = || batch(&imager, &unpressed[..baseline], options);
            let case = format!("{method:?} {polarity:?} {baseline} {electrodes}");
            let first = |frame: &Vec<f64>| said(new().frame(0, frame).unwrap());
            let alone: Vec<String> = frames.iter().map(first).collect();
            let count = frames.len();
            let mut orders: Vec<Vec<usize>> = vec![(0..count).rev().collect()];
            if electrodes == 16 {
                orders.push((0..count).map(|k| 5 * k % count).collect());
            }
            for order in orders {
                let mut one = new();
                for (place, k) in order.iter().enumerate() {
                    let result = said(one.frame(place, &frames[*k]).unwrap());
                    assert!(result == alone[*k], "{case}: {:?}", &order[..=place]);
                }
            }
            let list: Vec<(usize, &[f64])> = frames.iter().map(Vec::as_slice).enumerate().collect();
            let mut number = 0;
            let mut each = |of: usize, result| {
                assert_eq!(of, number);
                assert!(said(result) == alone[of], "{case}: {of} beside others");
                number += 1;
            };
            assert!(new().frames_alone(3, &list, &mut each).unwrap());
            assert_eq!(number, count);
        }
    }

    /// Frames that follow one another are solved in turn, and nothing pressed between them.
    #[test]
    fn a_sequence_keeps_its_order_and_its_pauses() {
        let imager = imager(16, Drive::PAPER);
        let (unpressed, frames) = table(&imager);
        let calibration = Calibration {
            solid: Solid {
                delayed_ratio: 0.4,
                tau_s: 6.0,
                exponent: 1.0,
                unit_rise_mpa: 0.25,
            },
            force_sd_n: 0.05,
        };
        let options = BatchOptions {
            interval_s: Some(0.5),
            calibration: Some(calibration),
            ..BatchOptions::of(Method::Nnls)
        };
        let list = [(0, 2), (1, 2), (2, 1), (9, 2), (10, 0)].map(|(place, k)| (place, frames[k].as_slice()));
        let mut one = batch(&imager, &unpressed, options);
        let mut in_turn = Vec::new();
        for place in 0..=10 {
            match list.iter().find(|(at, _)| *at == place) {
                Some((_, frame)) => in_turn.push(said(one.frame(place, frame).unwrap())),
                None => one.pass_over(place),
            }
        }
        let (mut all, mut without) = (Vec::new(), Vec::new());
        let mut at_once = batch(&imager, &unpressed, options);
        at_once.frames(&list, |_, result| all.push(said(result))).unwrap();
        assert_eq!(all, in_turn);
        let mut close = batch(&imager, &unpressed, options);
        let of_close: Vec<(usize, &[f64])> = list.iter().enumerate().map(|(k, (_, f))| (k, *f)).collect();
        close.frames(&of_close, |_, result| without.push(said(result))).unwrap();
        assert!(without != in_turn, "a pause changes forces");
    }

    /// A frame of another length is told, and costs none before or after it.
    #[test]
    fn the_first_bad_frame_is_told() {
        let imager = imager(16, Drive::PAPER);
        let (unpressed, frames) = table(&imager);
        let mut batch = batch(&imager, &unpressed, BatchOptions::of(Method::Nnls));
        let good = [&frames[2][..], &frames[0]];
        let list = [good[0], good[1], &frames[1][..100], &frames[1], &frames[0][..7]];
        let list: Vec<(usize, &[f64])> = list.into_iter().enumerate().collect();
        let mut had = Vec::new();
        let mut each = |number, result| had.push((number, said(result)));
        let error = batch.frames_alone(3, &list, &mut each).unwrap_err();
        assert!(error.to_string().contains("100"), "{error}");
        batch.frames(&list[..2], &mut each).unwrap();
        assert_eq!(had[..2], had[2..]);
        assert_eq!(had.len(), 4);
    }
}
