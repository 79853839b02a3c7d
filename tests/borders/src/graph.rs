//! Circles among imports.

use crate::imports::Import;
use std::collections::{BTreeMap, BTreeSet, VecDeque};

/// Files that import each other, directly or through others.
#[derive(Debug, PartialEq, Eq)]
pub struct Circle {
    /// All files from which every other can be reached.
    pub files: BTreeSet<usize>,
    /// One shortest way round through the lowest file: first and last are the same.
    pub way: Vec<usize>,
}

/// The circles among imports: the strongly connected components of more than one file.
pub fn circles(imports: &[Import]) -> Vec<Circle> {
    let mut edges: BTreeMap<usize, BTreeSet<usize>> = BTreeMap::new();
    for import in imports {
        edges.entry(import.from).or_default().insert(import.to);
    }
    let reached: BTreeMap<usize, BTreeSet<usize>> =
        edges.keys().map(|&from| (from, reach(&edges, from).into_keys().collect())).collect();
    let is_mutual = |a: usize, b: usize| {
        let reaches = |a, b| reached.get(a).is_some_and(|found| found.contains(b));
        reaches(&a, &b) && reaches(&b, &a)
    };
    let mut seen: BTreeSet<usize> = BTreeSet::new();
    let mut found = Vec::new();
    for &file in edges.keys() {
        if !seen.contains(&file) && is_mutual(file, file) {
            let files: BTreeSet<usize> =
                edges.keys().copied().filter(|&other| is_mutual(file, other)).collect();
            seen.extend(&files);
            found.push(Circle { way: way_round(&edges, file), files });
        }
    }
    found
}

/// Every file that can be reached from one, with the file before it on a shortest way. The start is
/// among them only if a circle leads back to it.
fn reach(edges: &BTreeMap<usize, BTreeSet<usize>>, from: usize) -> BTreeMap<usize, usize> {
    let mut before = BTreeMap::new();
    let mut queue = VecDeque::from([from]);
    while let Some(at) = queue.pop_front() {
        for &to in edges.get(&at).into_iter().flatten() {
            if let std::collections::btree_map::Entry::Vacant(entry) = before.entry(to) {
                entry.insert(at);
                queue.push_back(to);
            }
        }
    }
    before
}

fn way_round(edges: &BTreeMap<usize, BTreeSet<usize>>, file: usize) -> Vec<usize> {
    let before = reach(edges, file);
    let mut way = vec![file];
    let mut at = file;
    while let Some(&previous) = before.get(&at) {
        way.push(previous);
        at = previous;
        if at == file {
            break;
        }
    }
    way.reverse();
    way
}
