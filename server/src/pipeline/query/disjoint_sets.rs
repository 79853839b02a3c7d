//! Disjoint sets of indices (union-find).

/// A partition of `0..count`.
pub(super) struct DisjointSets(Vec<usize>);

impl DisjointSets {
    /// Each index is a set.
    pub(super) fn new(count: usize) -> Self {
        Self((0..count).collect())
    }

    /// The representative of the set of an index. Paths are halved on the way.
    pub(super) fn representative(&mut self, mut at: usize) -> usize {
        while self.0[at] != at {
            self.0[at] = self.0[self.0[at]];
            at = self.0[at];
        }
        at
    }

    /// Unites the sets of two indices. The lesser representative stays.
    pub(super) fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.representative(a), self.representative(b));
        self.0[a.max(b)] = a.min(b);
    }
}
