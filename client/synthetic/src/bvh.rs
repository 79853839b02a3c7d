//! A bounding volume hierarchy over the scene's triangles (binned surface-area heuristic): the
//! nearest hit of a ray, or whether anything blocks it. Building it reorders the triangles of the
//! [`Mesh`].

use crate::mesh::{Mesh, Triangle};
use glam::Vec3;

/// A ray; `direction` need not be of unit length, distances are in its units.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ray {
    pub origin: Vec3,
    pub direction: Vec3,
}

/// Where a ray meets a triangle: distance and barycentric weights of its second and third corner.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Hit {
    pub distance: f32,
    pub triangle: u32,
    pub b1: f32,
    pub b2: f32,
}

#[derive(Clone, Copy, Debug)]
struct Node {
    bounds: Bounds,
    /// First triangle of a leaf, or the left child (the right one follows it).
    first: u32,
    /// Triangles of a leaf, 0 for an inner node.
    count: u32,
}

/// The hierarchy. Its leaves index the triangles of the mesh it was built over.
#[derive(Clone, Debug)]
pub(crate) struct Bvh {
    nodes: Vec<Node>,
}

const BINS: usize = 12;
const LEAF: usize = 4;
/// Deeper than any hierarchy over fewer than 2^32 triangles split by this builder in practice.
const STACK: usize = 64;

impl Bvh {
    /// Builds the hierarchy and sorts the mesh's triangles into leaf order.
    pub fn build(mesh: &mut Mesh) -> Self {
        let boxes: Vec<Bounds> = mesh.triangles.iter().map(triangle_bounds).collect();
        let mut order: Vec<u32> = (0..boxes.len() as u32).collect();
        let mut nodes = vec![leaf(&boxes, &order, 0)];
        // Depth is bounded so that the traversal's stack cannot overflow.
        let mut pending = vec![(0_usize, 0_usize)];
        while let Some((index, depth)) = pending.pop() {
            let (first, count) = (nodes[index].first as usize, nodes[index].count as usize);
            if count <= LEAF || depth + 1 >= STACK {
                continue;
            }
            let Some(left) = split(&boxes, &mut order[first..first + count]) else { continue };
            let child = nodes.len();
            nodes.push(leaf(&boxes, &order[first..first + left], first));
            nodes.push(leaf(&boxes, &order[first + left..first + count], first + left));
            nodes[index].first = child as u32;
            nodes[index].count = 0;
            pending.extend([(child, depth + 1), (child + 1, depth + 1)]);
        }
        mesh.triangles = order.iter().map(|&i| mesh.triangles[i as usize]).collect();
        mesh.facets = order.iter().map(|&i| mesh.facets[i as usize]).collect();
        Self { nodes }
    }

    /// The nearest hit, if any.
    pub fn nearest(&self, triangles: &[Triangle], ray: &Ray) -> Option<Hit> {
        let mut best: Option<Hit> = None;
        let mut limit = f32::INFINITY;
        self.visit(ray, &mut |index| {
            if let Some(hit) = meet(triangles, index, ray)
                && hit.distance < limit
            {
                limit = hit.distance;
                best = Some(hit);
            }
            limit
        });
        best
    }

    /// Whether a triangle for which `blocks` holds lies between the origin and `limit`.
    pub fn blocked(
        &self,
        triangles: &[Triangle],
        ray: &Ray,
        limit: f32,
        blocks: impl Fn(u32) -> bool,
    ) -> bool {
        let mut found = false;
        self.visit_within(ray, limit, &mut |index| {
            let hit = meet(triangles, index, ray);
            if hit.is_some_and(|h| h.distance < limit) && blocks(index) {
                found = true;
            }
            // A negative limit ends the traversal.
            if found { -1.0 } else { limit }
        });
        found
    }

    fn visit(&self, ray: &Ray, leaf: &mut impl FnMut(u32) -> f32) {
        self.visit_within(ray, f32::INFINITY, leaf);
    }

    /// Calls `leaf` for every triangle in boxes the ray enters before the limit `leaf` last gave.
    fn visit_within(&self, ray: &Ray, mut limit: f32, leaf: &mut impl FnMut(u32) -> f32) {
        let d = ray.direction;
        let inverse = Vec3 { x: 1.0 / d.x, y: 1.0 / d.y, z: 1.0 / d.z };
        let mut stack = [(0_u32, 0.0_f32); STACK];
        let mut top = 1;
        stack[0] = (0, enter(&self.nodes[0], ray.origin, inverse));
        while top > 0 {
            top -= 1;
            let (index, near) = stack[top];
            if near >= limit {
                continue;
            }
            let node = &self.nodes[index as usize];
            if node.count > 0 {
                for i in node.first..node.first + node.count {
                    limit = leaf(i);
                    if limit < 0.0 {
                        return;
                    }
                }
                continue;
            }
            let left = enter(&self.nodes[node.first as usize], ray.origin, inverse);
            let right = enter(&self.nodes[node.first as usize + 1], ray.origin, inverse);
            let mut pair = [(node.first, left), (node.first + 1, right)];
            if left < right {
                pair.swap(0, 1);
            }
            for entry in pair {
                if entry.1 < limit {
                    stack[top] = entry;
                    top += 1;
                }
            }
        }
    }
}

/// An axis-aligned box.
#[derive(Clone, Copy, Debug)]
struct Bounds {
    low: Vec3,
    high: Vec3,
}

/// Distance at which the ray enters a node's box, infinite when it misses.
#[inline(always)]
fn enter(node: &Node, o: Vec3, inverse: Vec3) -> f32 {
    let Bounds { low, high } = node.bounds;
    let (ax, bx) = ((low.x - o.x) * inverse.x, (high.x - o.x) * inverse.x);
    let (ay, by) = ((low.y - o.y) * inverse.y, (high.y - o.y) * inverse.y);
    let (az, bz) = ((low.z - o.z) * inverse.z, (high.z - o.z) * inverse.z);
    let near = ax.min(bx).max(ay.min(by)).max(az.min(bz)).max(0.0);
    let far = ax.max(bx).min(ay.max(by)).min(az.max(bz));
    if near <= far { near } else { f32::INFINITY }
}

/// Möller–Trumbore, both sides.
#[inline(always)]
fn meet(triangles: &[Triangle], index: u32, ray: &Ray) -> Option<Hit> {
    let hit = plane_hit(&triangles[index as usize], index, ray)?;
    let inside = hit.b1 >= 0.0 && hit.b2 >= 0.0 && hit.b1 + hit.b2 <= 1.0;
    (inside && hit.distance > 1e-4).then_some(hit)
}

/// Where the ray meets the triangle's plane, inside the triangle or not.
#[inline(always)]
pub(crate) fn plane_hit(triangle: &Triangle, index: u32, ray: &Ray) -> Option<Hit> {
    let p = ray.direction.cross(triangle.edge2);
    let determinant = triangle.edge1.dot(p);
    if determinant.abs() < 1e-12 {
        return None;
    }
    let inverse = 1.0 / determinant;
    let s = ray.origin - triangle.corner;
    let q = s.cross(triangle.edge1);
    Some(Hit {
        distance: triangle.edge2.dot(q) * inverse,
        triangle: index,
        b1: s.dot(p) * inverse,
        b2: ray.direction.dot(q) * inverse,
    })
}

fn triangle_bounds(t: &Triangle) -> Bounds {
    let (a, b, c) = (t.corner, t.corner + t.edge1, t.corner + t.edge2);
    Bounds { low: a.min(b).min(c), high: a.max(b).max(c) }
}

fn union(boxes: impl Iterator<Item = Bounds>) -> Bounds {
    let none = Bounds { low: Vec3::MAX, high: -Vec3::MAX };
    boxes.fold(none, |a, b| Bounds { low: a.low.min(b.low), high: a.high.max(b.high) })
}

fn leaf(boxes: &[Bounds], order: &[u32], first: usize) -> Node {
    let bounds = union(order.iter().map(|&i| boxes[i as usize]));
    Node { bounds, first: first as u32, count: order.len() as u32 }
}

fn area(Bounds { low, high }: Bounds) -> f32 {
    let d = (high - low).max(Vec3::ZERO);
    d.x * d.y + d.y * d.z + d.z * d.x
}

/// Partitions `order` at the cheapest bin border; returns the size of the left part, or nothing
/// when the centres coincide.
fn split(boxes: &[Bounds], order: &mut [u32]) -> Option<usize> {
    let centre = |i: u32| (boxes[i as usize].low + boxes[i as usize].high) * 0.5;
    let Bounds { low, high } =
        union(order.iter().map(|&i| Bounds { low: centre(i), high: centre(i) }));
    let extent = high - low;
    let mut best: Option<(f32, usize, usize)> = None;
    for axis in 0..3 {
        if extent[axis] < 1e-6 {
            continue;
        }
        let bin = |i: u32| bin_of(centre(i)[axis], low[axis], extent[axis]);
        let mut counts = [0_usize; BINS];
        let mut bounds = [union(std::iter::empty()); BINS];
        for &i in order.iter() {
            let b = bin(i);
            counts[b] += 1;
            bounds[b] = union([bounds[b], boxes[i as usize]].into_iter());
        }
        for border in 1..BINS {
            let side = |r: std::ops::Range<usize>| {
                let n: usize = counts[r.clone()].iter().sum();
                (n, area(union(bounds[r].iter().copied())) * n as f32)
            };
            let ((left, left_cost), (right, right_cost)) = (side(0..border), side(border..BINS));
            let cost = left_cost + right_cost;
            if left > 0 && right > 0 && best.is_none_or(|b| cost < b.0) {
                best = Some((cost, axis, border));
            }
        }
    }
    let (_, axis, border) = best?;
    let is_left = |i: &u32| bin_of(centre(*i)[axis], low[axis], extent[axis]) < border;
    order.sort_by_key(|i| !is_left(i));
    Some(order.iter().filter(|i| is_left(i)).count())
}

fn bin_of(x: f32, low: f32, extent: f32) -> usize {
    (((x - low) / extent * BINS as f32) as usize).min(BINS - 1)
}
