//! The poses that fit all edges best: Levenberg-Marquardt over the poses of all nodes that are not fixed.
//!
//! An edge's residual is r = log(a_from_world world_from_b b_from_a) for the measured `b_from_a`, in the
//! coordinates of a. With right perturbations of both poses, dr = Ad(a_from_b) tau_b - tau_a (up to terms
//! of the order of r). First all edges count in full. Then, from there, an edge that closes a loop counts
//! with the robust cost S log(1 + x / S) of its squared residual x (Cauchy): one that the others contradict
//! still has a large residual, and lets go.

use super::edge::Edge;
use lexsplat_gpu::align::se3::{self, adjoint};
use nalgebra::{DVector, Isometry3, Matrix6};
use nalgebra_sparse::factorization::CscCholesky;
use nalgebra_sparse::{CooMatrix, CscMatrix};

/// Most steps.
const STEPS: usize = 50;
/// Damping of the first step, as a share of the diagonal.
const FIRST_DAMPING: f64 = 1e-6;
/// Damping goes up or down by this factor.
const DAMPING_FACTOR: f64 = 10.0;
/// With this damping a step hardly moves: there is nothing better.
const MOST_DAMPING: f64 = 1e6;
/// It ends when the cost falls by less than this share of it.
const FLAT: f64 = 1e-6;
/// S: the squared residual from which a closure counts less. A right one has more in 1 of 1000 cases.
const CLOSURE_SCALE: f64 = 22.5;

/// Edges with what is needed to weigh them.
pub(super) struct Problem<'a> {
    edges: &'a [Edge],
    information: Vec<Matrix6<f64>>,
    /// First unknown of each node; `None` for fixed ones.
    columns: Vec<Option<usize>>,
}

/// The normal system over all nodes that are not fixed.
struct System {
    h: CooMatrix<f64>,
    g: DVector<f64>,
}

impl<'a> Problem<'a> {
    /// `are_fixed`: for each node whether its pose stays.
    pub fn new(edges: &'a [Edge], are_fixed: impl Iterator<Item = bool>) -> Self {
        let mut next = 0;
        let column = |is_fixed: bool| {
            (!is_fixed).then(|| {
                next += 6;
                next - 6
            })
        };
        let columns = are_fixed.map(column).collect();
        Self { edges, information: edges.iter().map(Edge::information).collect(), columns }
    }

    /// The poses `world_from_node` that fit best, from those that the nodes have now.
    pub fn solve(&self, poses: &[Isometry3<f64>]) -> Vec<Isometry3<f64>> {
        self.descend(&self.descend(poses, false), true)
    }

    fn descend(&self, poses: &[Isometry3<f64>], is_robust: bool) -> Vec<Isometry3<f64>> {
        let mut poses = poses.to_vec();
        let mut cost = self.cost(&poses, is_robust);
        let mut damping = FIRST_DAMPING;
        for _ in 0..STEPS {
            let Some(step) = self.system(&poses, is_robust).solve(damping) else { break };
            let trial = self.moved(&poses, &step);
            let next = self.cost(&trial, is_robust);
            let is_flat = (cost - next).abs() <= FLAT * cost;
            if next <= cost {
                (poses, cost) = (trial, next);
                damping /= DAMPING_FACTOR;
            } else {
                damping *= DAMPING_FACTOR;
            }
            if is_flat || damping > MOST_DAMPING {
                break;
            }
        }
        poses
    }

    fn cost(&self, poses: &[Isometry3<f64>], is_robust: bool) -> f64 {
        let cost = |(edge, information): (&Edge, &Matrix6<f64>)| {
            let off = edge.residual(poses);
            let squared = off.dot(&(information * off));
            if edge.is_closure && is_robust {
                CLOSURE_SCALE * (squared / CLOSURE_SCALE).ln_1p()
            } else {
                squared
            }
        };
        self.edges.iter().zip(&self.information).map(cost).sum()
    }

    fn system(&self, poses: &[Isometry3<f64>], is_robust: bool) -> System {
        let size = 6 * self.columns.iter().flatten().count();
        let mut system = System { h: CooMatrix::new(size, size), g: DVector::zeros(size) };
        for (edge, information) in self.edges.iter().zip(&self.information) {
            let off = edge.residual(poses);
            let squared = off.dot(&(information * off));
            let lets_go = edge.is_closure && is_robust;
            let weight = if lets_go { 1.0 / (1.0 + squared / CLOSURE_SCALE) } else { 1.0 };
            let weighted = information * weight;
            let first_from_second = poses[edge.first].inverse() * poses[edge.second];
            let slopes = [
                (self.columns[edge.first], -Matrix6::identity()),
                (self.columns[edge.second], adjoint(&first_from_second)),
            ];
            for (row, left) in &slopes {
                let Some(row) = row else { continue };
                let mut part = system.g.fixed_rows_mut::<6>(*row);
                part += left.transpose() * weighted * off;
                for (column, right) in &slopes {
                    let Some(column) = column else { continue };
                    system.add(*row, *column, &(left.transpose() * weighted * right));
                }
            }
        }
        system
    }

    fn moved(&self, poses: &[Isometry3<f64>], step: &DVector<f64>) -> Vec<Isometry3<f64>> {
        let moved = |(pose, column): (&Isometry3<f64>, &Option<usize>)| {
            let Some(column) = column else { return *pose };
            let mut pose = pose * se3::exp(&step.fixed_rows::<6>(*column).into_owned());
            pose.rotation.renormalize();
            pose
        };
        poses.iter().zip(&self.columns).map(moved).collect()
    }
}

impl System {
    fn add(&mut self, row: usize, column: usize, block: &Matrix6<f64>) {
        for i in 0..6 {
            for j in 0..6 {
                self.h.push(row + i, column + j, block[(i, j)]);
            }
        }
    }

    /// The step (H + damping diag H)^-1 (-g); `None` if some pose is not determined.
    fn solve(mut self, damping: f64) -> Option<DVector<f64>> {
        let diagonal: Vec<(usize, f64)> = self
            .h
            .triplet_iter()
            .filter(|(row, column, _)| row == column)
            .map(|(row, _, value)| (row, damping * value))
            .collect();
        for (row, value) in diagonal {
            self.h.push(row, row, value);
        }
        let cholesky = CscCholesky::factor(&CscMatrix::from(&self.h)).ok()?;
        let step = cholesky.solve(&-self.g);
        let step = DVector::from_column_slice(step.as_slice());
        step.iter().all(|value| value.is_finite()).then_some(step)
    }
}
