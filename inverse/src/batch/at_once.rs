//! All frames of a table: those that stand alone on all cores.

use super::{Batch, reconstructor};
use crate::pipeline::FrameResult;
use crate::reference::imager::ImagerError;
use std::collections::BTreeMap;
use std::num::NonZero;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc;
use std::thread;

/// Most cores for one table: what each makes for itself takes some 100 MB.
const MOST_WORKERS: usize = 8;
/// The same of frames with many values, where it takes 400 MB.
const MOST_WORKERS_OF_MANY: usize = 2;

impl Batch {
    /// Reconstructs frames, each with its place in the table, and hands over their results in the same order, each with its number in the
    /// list. Where frames do not follow one another ([`BatchOptions::interval_s`](super::BatchOptions::interval_s)), all cores take part,
    /// and the result of a frame is the same to the last bit, whatever comes before it. Else nothing pressed at the places between them.
    ///
    /// # Errors
    /// [`ImagerError::Baseline`] at the first frame that does not have the pattern's length: `each` has had all before it.
    pub fn frames(
        &mut self,
        frames: &[(usize, &[f64])],
        mut each: impl FnMut(usize, FrameResult),
    ) -> Result<(), ImagerError> {
        let workers = if self.interval_s.is_none() {
            self.workers().min(frames.len())
        } else {
            1
        };
        if workers > 1 {
            return self.frames_alone(workers, frames, each);
        }
        let mut next = 0;
        for (number, (place, values)) in frames.iter().enumerate() {
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
        let most = if self.imager().is_searched() {
            MOST_WORKERS
        } else {
            MOST_WORKERS_OF_MANY
        };
        thread::available_parallelism().map_or(1, NonZero::get).min(most)
    }

    fn frames_alone(
        &mut self,
        workers: usize,
        frames: &[(usize, &[f64])],
        mut each: impl FnMut(usize, FrameResult),
    ) -> Result<(), ImagerError> {
        let (inspection, how, tells_noise) = (&self.inspection, self.how, self.tells_noise);
        let (next, mut own) = (AtomicUsize::new(0), Some(&mut self.reconstructor));
        let (sender, receiver) = mpsc::channel();
        thread::scope(|scope| {
            for _ in 0..workers {
                let (own, sender, next) = (own.take(), sender.clone(), &next);
                scope.spawn(move || {
                    let mut made = None;
                    let reconstructor = match own {
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
                        let result = reconstructor
                            .frame(values)
                            .map(|result| inspection.doubted(result.clone()));
                        if sender.send((number, result)).is_err() {
                            return;
                        }
                    }
                });
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
            Ok(())
        })
    }
}

#[cfg(test)]
mod tests {
    use crate::batch::{Batch, BatchOptions};
    use crate::pipeline::FrameResult;
    use crate::reference::imager::{Imager, ImagerError};
    use crate::solvers::Method;
    use forward::{DiscTouch, Drive, Model, ModelOptions, Pattern, Sheet, Solver};
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

    fn imager() -> Arc<Imager> {
        Arc::new(Imager::new(&Sheet::paper(), Drive::PAPER, Pattern::adjacent(16).unwrap(), 10.0).unwrap())
    }

    /// The unpressed sheet, and frames of all that leaves something behind where frames follow one another.
    fn table() -> (Vec<Vec<f64>>, Vec<Vec<f64>>) {
        let pattern = Pattern::adjacent(16).unwrap();
        let hand =
            [(-40.0, 20.0), (-20.0, 45.0), (8.0, 50.0), (35.0, 35.0), (10.0, -30.0)].map(|(x, y)| touch(x, y, 0.6));
        let scenes = [
            vec![],
            hand.to_vec(),
            vec![touch(30.0, -20.0, 0.3)],
            vec![touch(30.0, -20.0, -0.4)],
            vec![touch(-30.0, 5.0, 0.4), touch(32.0, 5.0, -0.3)],
            vec![touch(0.0, 70.0, 1.5), touch(0.0, -60.0, 1.0), touch(20.0, 0.0, 1.0)],
        ];
        let all: Vec<DiscTouch> = scenes.iter().flatten().copied().collect();
        let model = Model::new(&Sheet::paper(), &ModelOptions::for_touches(&all[..1])).unwrap();
        let mut solver = Solver::new(model.into()).unwrap();
        let solved = scenes.iter().map(|scene| {
            let potentials = solver.solve_touches_here(scene).unwrap();
            Drive::PAPER.frame_v(potentials, &pattern)
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

    fn batch(imager: &Arc<Imager>, unpressed: &[Vec<f64>], method: Method, interval_s: Option<f64>) -> Batch {
        let unpressed: Vec<&[f64]> = unpressed.iter().map(Vec::as_slice).collect();
        let options = BatchOptions {
            interval_s,
            ..BatchOptions::of(method)
        };
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

    fn all(batch: &mut Batch, frames: &[&[f64]]) -> Vec<String> {
        let frames: Vec<(usize, &[f64])> = frames.iter().copied().enumerate().collect();
        let mut results = Vec::new();
        let each = |number, result| {
            assert_eq!(number, results.len());
            results.push(said(result));
        };
        batch.frames(&frames, each).unwrap();
        results
    }

    /// A frame of a table has one result, to the last bit: as the first of its table, after any other, and beside others.
    #[test]
    fn a_frame_of_a_table_stands_alone() {
        let (imager, (unpressed, frames)) = (imager(), table());
        for method in [Method::Nnls, Method::LawsonHanson, Method::Tikhonov] {
            let first = |frame: &Vec<f64>| said(batch(&imager, &unpressed, method, None).frame(0, frame).unwrap());
            let alone: Vec<String> = frames.iter().map(first).collect();
            let orders: [Vec<usize>; 3] = [
                (0..frames.len()).collect(),
                (0..frames.len()).rev().collect(),
                (0..3 * frames.len())
                    .map(|k| (5 * k + k / frames.len()) % frames.len())
                    .collect(),
            ];
            for order in orders {
                let list: Vec<&[f64]> = order.iter().map(|k| frames[*k].as_slice()).collect();
                let mut one = batch(&imager, &unpressed, method, None);
                let in_turn = list.iter().map(|frame| said(one.frame(0, frame).unwrap()));
                for (place, result) in in_turn.enumerate() {
                    assert!(
                        result == alone[order[place]],
                        "{method:?}: {:?}, {place}",
                        &order[..=place]
                    );
                }
                let at_once = all(&mut batch(&imager, &unpressed, method, None), &list);
                assert_eq!(at_once.len(), list.len());
                for (result, of) in at_once.iter().zip(&order) {
                    assert!(*result == alone[*of], "{method:?}: {of}");
                }
            }
        }
    }

    /// Frames that follow one another are solved in turn.
    #[test]
    fn a_sequence_keeps_its_order() {
        let (imager, (unpressed, frames)) = (imager(), table());
        let list: Vec<&[f64]> = [0, 2, 2, 2, 0, 1, 1].iter().map(|k| frames[*k].as_slice()).collect();
        let mut one = batch(&imager, &unpressed, Method::Nnls, Some(0.02));
        let in_turn = list.iter().enumerate();
        let in_turn: Vec<String> = in_turn.map(|(k, f)| said(one.frame(k, f).unwrap())).collect();
        assert_eq!(
            all(&mut batch(&imager, &unpressed, Method::Nnls, Some(0.02)), &list),
            in_turn
        );
    }

    /// A frame of another length is told, and costs none before it.
    #[test]
    fn the_first_bad_frame_is_told() {
        let (imager, (unpressed, frames)) = (imager(), table());
        let mut batch = batch(&imager, &unpressed, Method::Nnls, None);
        let list = [
            &frames[2][..],
            &frames[0],
            &frames[1][..100],
            &frames[1],
            &frames[0][..7],
        ];
        let list: Vec<(usize, &[f64])> = list.into_iter().enumerate().collect();
        let mut had = Vec::new();
        let error = batch.frames(&list, |number, _| had.push(number)).unwrap_err();
        assert!(matches!(error, ImagerError::Baseline { .. }), "{error}");
        assert!(error.to_string().contains("100"), "{error}");
        assert_eq!(had, [0, 1]);
        assert_eq!(all(&mut batch, &[]), [String::new(); 0]);
    }
}
