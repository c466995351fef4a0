//! Nodes on a lattice over a disc, and the posterior of a place over them.

use nalgebra::{Matrix2, Vector2};
use std::collections::BTreeMap;

/// Nodes along a side of a group, one of which is tried first.
const GROUP: i64 = 2;
/// Nodes from one to the next where pairs of presses are tried.
const SPREAD: i64 = 4;
/// Logarithm of the evidence by which a node is out of question.
pub(super) const FAR: f64 = 12.0;
/// Steps of the lattice of groups from which a standard deviation is wide.
const WIDE: f64 = 1.0;

/// The logarithm of the evidence for a press at a node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Scored {
    pub(super) node: usize,
    pub(super) score: f64,
    /// How many nodes it stands for.
    pub(super) nodes: usize,
}

/// Most of a normal posterior that one node has where steps are as long as the standard deviation: 1/(2 pi).
const MOST_OF_ONE: f64 = 0.16;

/// Where a press is: its most probable node and the posterior's part there, its mean and its covariance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Placed {
    pub(super) node: usize,
    pub(super) part: f64,
    pub(super) mean_mm: Vector2<f64>,
    pub(super) covariance: Matrix2<f64>,
}

/// Nodes of a square lattice over a disc.
pub(super) struct Lattice {
    pub(super) nodes_mm: Vec<[f64; 2]>,
    step_mm: f64,
    /// One node of every group of neighbours.
    pub(super) firsts: Vec<usize>,
    /// The others of each.
    pub(super) others: Vec<Vec<usize>>,
    /// Nodes far apart from one another, where pairs are tried.
    pub(super) spread: Vec<usize>,
}

impl Lattice {
    /// With so many steps from the middle to the reach.
    pub(super) fn new(centre_mm: [f64; 2], reach_mm: f64, steps: f64) -> Self {
        let step_mm = reach_mm / steps;
        let reach = steps as i64;
        let nodes: Vec<[i64; 2]> = (-reach..=reach)
            .flat_map(|j| (-reach..=reach).map(move |i| [i, j]))
            .filter(|[i, j]| ((i * i + j * j) as f64).sqrt() <= steps)
            .collect();
        let mut groups: BTreeMap<[i64; 2], Vec<usize>> = BTreeMap::new();
        for (k, p) in nodes.iter().enumerate() {
            groups.entry(p.map(|v| v.div_euclid(GROUP))).or_default().push(k);
        }
        let (firsts, others) = groups.into_values().map(|g| (g[0], g[1..].to_vec())).unzip();
        let place = |p: &[i64; 2]| [0, 1].map(|k| centre_mm[k] + p[k] as f64 * step_mm);
        Self {
            nodes_mm: nodes.iter().map(place).collect(),
            step_mm,
            firsts,
            others,
            spread: (0..nodes.len())
                .filter(|k| nodes[*k].iter().all(|v| v % SPREAD == 0))
                .collect(),
        }
    }

    /// The posterior over first nodes of groups, each of which stands for its group, where it is wide and has no narrow peak. Other nodes
    /// then say the same: over steps of a standard deviation a sum is as exact as the integral (Trefethen and Weideman 2014).
    pub(super) fn wide(&self, firsts: &[Scored]) -> Option<Placed> {
        let step_mm = GROUP as f64 * self.step_mm;
        let placed = posterior(&self.nodes_mm, step_mm, firsts)?;
        let narrow = placed.covariance.symmetric_eigenvalues().min();
        (narrow > (WIDE * step_mm).powi(2) && placed.part < MOST_OF_ONE / WIDE.powi(2)).then_some(placed)
    }

    /// Mean and covariance of the posterior, and the highest node. None where no node has a score that is a number.
    pub(super) fn posterior(&self, scored: &[Scored]) -> Option<Placed> {
        posterior(&self.nodes_mm, self.step_mm, scored)
    }
}

/// The same over nodes of a lattice with these steps.
fn posterior(nodes_mm: &[[f64; 2]], step_mm: f64, scored: &[Scored]) -> Option<Placed> {
    let numbers = scored.iter().filter(|s| s.score.is_finite());
    let best = numbers.max_by(|a, b| a.score.total_cmp(&b.score))?;
    let (mut sum, mut mean, mut square) = (0.0, Vector2::zeros(), Matrix2::zeros());
    for one in scored {
        if one.score - best.score > -FAR {
            let weight = one.nodes as f64 * (one.score - best.score).exp();
            let p = Vector2::from(nodes_mm[one.node]);
            sum += weight;
            mean += weight * p;
            square += weight * p * p.transpose();
        }
    }
    mean /= sum;
    // A node stands for its square, whose variance is a twelfth of its side's square.
    let covariance = square / sum - mean * mean.transpose() + Matrix2::identity() * (step_mm * step_mm / 12.0);
    Some(Placed {
        node: best.node,
        part: best.nodes as f64 / sum,
        mean_mm: mean,
        covariance,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP_MM: f64 = 2.0;

    /// A normal posterior at all nodes, and at one of every group.
    fn normal(lattice: &Lattice, mean_mm: [f64; 2], sd_mm: [f64; 2]) -> [Vec<Scored>; 2] {
        let score = |node: usize| {
            let off = [0, 1].map(|k| (lattice.nodes_mm[node][k] - mean_mm[k]) / sd_mm[k]);
            -0.5 * (off[0] * off[0] + off[1] * off[1])
        };
        let all = (0..lattice.nodes_mm.len()).map(|node| Scored {
            node,
            score: score(node),
            nodes: 1,
        });
        let firsts = lattice.firsts.iter().zip(&lattice.others).map(|(node, others)| Scored {
            node: *node,
            score: score(*node),
            nodes: 1 + others.len(),
        });
        [all.collect(), firsts.collect()]
    }

    #[test]
    fn one_node_of_every_group_tells_a_wide_posterior() {
        let lattice = Lattice::new([3.0, -1.0], 20.0 * STEP_MM, 20.0);
        let mut told = 0;
        for [x, y] in [[0.0, 0.0], [0.7, 1.3], [-9.1, 4.4], [20.3, -11.9], [31.0, 15.0]] {
            for sd_mm in [[4.2, 4.2], [5.0, 9.0], [12.0, 12.0], [30.0, 7.0]] {
                let [all, firsts] = normal(&lattice, [x, y], sd_mm);
                let Some(coarse) = lattice.wide(&firsts) else { continue };
                let fine = lattice.posterior(&all).unwrap();
                told += 1;
                for k in 0..2 {
                    let sd = fine.covariance[(k, k)].sqrt();
                    let off = (coarse.mean_mm[k] - fine.mean_mm[k]).abs() / sd;
                    let over = coarse.covariance[(k, k)].sqrt() / sd;
                    assert!(off < 0.1, "{x} {y} {sd_mm:?}: {off}");
                    assert!((0.97..1.1).contains(&over), "{x} {y} {sd_mm:?}: {over}");
                }
            }
        }
        assert!(told >= 15, "{told}");
    }

    #[test]
    fn a_narrow_posterior_is_left_to_all_nodes() {
        let lattice = Lattice::new([0.0; 2], 20.0 * STEP_MM, 20.0);
        for sd_mm in [[1.0, 1.0], [1.5, 9.0], [3.0, 3.0]] {
            let [all, firsts] = normal(&lattice, [0.9, 8.3], sd_mm);
            assert_eq!(lattice.wide(&firsts), None, "{sd_mm:?}");
            let fine = lattice.posterior(&all).unwrap();
            assert!((fine.mean_mm - Vector2::new(0.9, 8.3)).norm() < 0.5, "{fine:?}");
        }
    }

    /// Far from one another, so that the covariance is wide: each is narrow all the same.
    #[test]
    fn narrow_peaks_are_not_wide_together() {
        let lattice = Lattice::new([0.0; 2], 20.0 * STEP_MM, 20.0);
        let peaks = [[20.9, 0.3], [-11.1, 18.7], [-9.3, -17.9]];
        let [_, mut firsts] = normal(&lattice, peaks[0], [1.5; 2]);
        for peak in &peaks[1..] {
            for (all, one) in firsts.iter_mut().zip(&normal(&lattice, *peak, [1.5; 2])[1]) {
                all.score = (all.score.exp() + one.score.exp()).ln();
            }
        }
        assert_eq!(lattice.wide(&firsts), None);
    }

    #[test]
    fn scores_that_are_no_numbers_place_nothing() {
        let lattice = Lattice::new([0.0; 2], 20.0 * STEP_MM, 20.0);
        let [mut all, _] = normal(&lattice, [0.0; 2], [3.0; 2]);
        all.iter_mut().for_each(|s| s.score = f64::NAN);
        assert_eq!(lattice.posterior(&all), None);
        assert_eq!(lattice.posterior(&[]), None);
    }
}
