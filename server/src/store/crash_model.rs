//! What is on a disk that fails: the durable state of each file and folder, the changes since, and what of
//! them a crash may leave.

use rand::Rng as _;
use rand_chacha::ChaCha8Rng;
use std::collections::BTreeMap;
use std::io::{Error, ErrorKind, Result};
use std::path::Path;

/// Bytes that a disk writes as a whole.
const BLOCK: usize = 512;

/// What goes wrong, and when.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Fault {
    /// Nothing is done any more.
    Crash,
    /// So many operations find no room; a write is cut short first.
    Full { operations: usize },
    /// One operation fails. Data whose sync fails is not written by a later one either.
    Broken,
}

/// What a disk promises and does not keep, for negative controls.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Lies {
    pub files_are_not_synced: bool,
    pub folders_are_not_synced: bool,
}

/// A file or a folder, by its number in the list of all.
pub(super) type Id = usize;

/// A change of a file that was not synced.
pub(super) enum Change {
    Write { at: usize, bytes: Vec<u8> },
    Length(usize),
}

/// New and removed entries of one operation.
pub(super) type Entries = Vec<(String, Option<Id>)>;

pub(super) enum Node {
    File { durable: Vec<u8>, pending: Vec<Change> },
    Folder { durable: BTreeMap<String, Id>, now: BTreeMap<String, Id>, pending: Vec<Entries> },
}

impl Node {
    pub fn folder() -> Self {
        Self::Folder { durable: BTreeMap::new(), now: BTreeMap::new(), pending: Vec::new() }
    }
}

pub(super) struct State {
    pub random: ChaCha8Rng,
    pub nodes: Vec<Node>,
    pub lies: Lies,
    /// A fault, and the operations before it.
    pub fault: Option<(usize, Fault)>,
    pub has_crashed: bool,
}

/// The root's number.
pub(super) const ROOT: Id = 0;

impl State {
    pub fn find(&self, parts: &[String]) -> Id {
        parts.iter().fold(ROOT, |folder, part| self.entries(folder)[part])
    }

    pub fn entries(&self, folder: Id) -> &BTreeMap<String, Id> {
        match &self.nodes[folder] {
            Node::Folder { now, .. } => now,
            Node::File { .. } => panic!("a file is no folder"),
        }
    }

    pub fn change(&mut self, folder: Id, entries: Entries) {
        let Node::Folder { now, pending, .. } = &mut self.nodes[folder] else {
            panic!("a file is no folder")
        };
        apply(now, &entries);
        pending.push(entries);
    }

    pub fn add(&mut self, node: Node) -> Id {
        self.nodes.push(node);
        self.nodes.len() - 1
    }

    /// Counts an operation.
    pub fn operate(&mut self) -> Result<()> {
        if self.has_crashed {
            return Err(Error::other("the machine is off"));
        }
        let Some((left, fault)) = &mut self.fault else { return Ok(()) };
        if *left > 0 {
            *left -= 1;
            return Ok(());
        }
        match fault {
            Fault::Crash => {
                self.has_crashed = true;
                Err(Error::other("the machine is off"))
            }
            Fault::Broken => {
                self.fault = None;
                Err(Error::from_raw_os_error(5))
            }
            Fault::Full { operations } => {
                *operations -= 1;
                if *operations == 0 {
                    self.fault = None;
                }
                Err(ErrorKind::StorageFull.into())
            }
        }
    }

    /// Bytes of a write that are done. Before the disk is full or the machine goes off, a part is.
    pub fn write(&mut self, bytes: usize) -> Result<usize> {
        let is_last = matches!(self.fault, Some((0, Fault::Full { .. } | Fault::Crash)));
        if is_last && !self.has_crashed && bytes > 1 && self.random.random_range(0..2) == 0 {
            return Ok(self.random.random_range(1..bytes));
        }
        self.operate().map(|()| bytes)
    }

    /// Puts what may be left of a folder into another one.
    pub fn survive(&mut self, from: Id, path: &Path, to: Id, nodes: &mut Vec<Node>) {
        let Node::Folder { durable, pending, .. } = &self.nodes[from] else {
            panic!("a file is no folder")
        };
        let (mut left, pending) = (durable.clone(), pending.clone());
        // In their order, as a journal does, or any of them.
        let is_ordered = self.random.random_range(0..2) == 0;
        let end = self.random.random_range(0..=pending.len());
        for (at, entries) in pending.iter().enumerate() {
            if if is_ordered { at < end } else { self.random.random_range(0..2) == 0 } {
                apply(&mut left, entries);
            }
        }
        let mut there = BTreeMap::new();
        for (name, id) in left {
            let path = path.join(&name);
            let node = if matches!(self.nodes[id], Node::File { .. }) {
                let bytes = self.surviving_bytes(id);
                std::fs::write(&path, &bytes).unwrap();
                Node::File { durable: bytes, pending: Vec::new() }
            } else {
                std::fs::create_dir(&path).unwrap();
                Node::folder()
            };
            nodes.push(node);
            let new = nodes.len() - 1;
            there.insert(name, new);
            if matches!(self.nodes[id], Node::Folder { .. }) {
                self.survive(id, &path, new, nodes);
            }
        }
        nodes[to] = Node::Folder { durable: there.clone(), now: there, pending: Vec::new() };
    }

    /// A file with all changes.
    pub fn written_bytes(&self, file: Id) -> Vec<u8> {
        let Node::File { durable, pending } = &self.nodes[file] else {
            panic!("a folder is no file")
        };
        let mut bytes = durable.clone();
        for change in pending {
            match change {
                Change::Length(length) => bytes.resize(*length, 0),
                Change::Write { at, bytes: written } => put(&mut bytes, *at, written),
            }
        }
        bytes
    }

    /// A file as it may be after a crash.
    pub fn surviving_bytes(&mut self, file: Id) -> Vec<u8> {
        let Self { random, nodes, .. } = self;
        let Node::File { durable, pending } = &nodes[file] else { panic!("a folder is no file") };
        let mut bytes = durable.clone();
        let is_ordered = random.random_range(0..2) == 0;
        let end = random.random_range(0..=pending.len());
        for (at, change) in pending.iter().enumerate() {
            let is_torn = is_ordered && at == end;
            if is_ordered && at > end {
                break;
            }
            match change {
                Change::Length(length) if !is_torn => bytes.resize(*length, 0),
                Change::Length(_) => {}
                Change::Write { at, bytes: written } => {
                    let place = |part: usize| (part * BLOCK).min(written.len());
                    for part in 0..written.len().div_ceil(BLOCK) {
                        let (from, to) = (place(part), place(part + 1));
                        // Torn in the middle, or with blocks that are there and others that are not.
                        if (is_torn || !is_ordered) && random.random_range(0..2) == 0 {
                            continue;
                        }
                        put(&mut bytes, at + from, &written[from..to]);
                    }
                }
            }
        }
        bytes
    }
}

/// Writes at a place, behind zeros if the file is shorter.
fn put(file: &mut Vec<u8>, at: usize, bytes: &[u8]) {
    file.resize(file.len().max(at + bytes.len()), 0);
    file[at..at + bytes.len()].copy_from_slice(bytes);
}

fn apply(folder: &mut BTreeMap<String, Id>, entries: &Entries) {
    for (name, id) in entries {
        match id {
            Some(id) => folder.insert(name.clone(), *id),
            None => folder.remove(name),
        };
    }
}
