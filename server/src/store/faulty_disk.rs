//! A disk for tests: it fails when it is told to, and after a crash it has what a real disk may have then.
//!
//! Operations are done in a real folder, which readers see, and noted. At a crash, changes of a folder since it
//! was synced, and writes to a file since it was synced, are there or not, each by chance; of a write some
//! blocks may be there and others not. What was synced is there.

use super::disk::{Disk, DiskFile};
use rand::Rng as _;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng as _;
use std::collections::BTreeMap;
use std::io::{Error, ErrorKind, Result, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard};

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
type Id = usize;

/// A change of a file that was not synced.
enum Change {
    Write { at: usize, bytes: Vec<u8> },
    Length(usize),
}

/// New and removed entries of one operation.
type Entries = Vec<(String, Option<Id>)>;

enum Node {
    File { durable: Vec<u8>, pending: Vec<Change> },
    Folder { durable: BTreeMap<String, Id>, now: BTreeMap<String, Id>, pending: Vec<Entries> },
}

impl Node {
    fn folder() -> Self {
        Self::Folder { durable: BTreeMap::new(), now: BTreeMap::new(), pending: Vec::new() }
    }
}

struct State {
    random: ChaCha8Rng,
    nodes: Vec<Node>,
    lies: Lies,
    /// A fault, and the operations before it.
    fault: Option<(usize, Fault)>,
    has_crashed: bool,
}

/// The disk. Cheap to clone.
#[derive(Clone)]
pub(super) struct FaultyDisk {
    root: Arc<tempfile::TempDir>,
    state: Arc<Mutex<State>>,
}

/// The root's number.
const ROOT: Id = 0;

impl FaultyDisk {
    pub fn new(seed: u64, lies: Lies) -> Self {
        let root = Arc::new(tempfile::tempdir().unwrap());
        let random = ChaCha8Rng::seed_from_u64(seed);
        let nodes = vec![Node::folder()];
        let state = State { random, nodes, lies, fault: None, has_crashed: false };
        Self { root, state: Arc::new(Mutex::new(state)) }
    }

    pub fn root(&self) -> &Path {
        self.root.path()
    }

    /// After so many more operations this goes wrong.
    pub fn plan(&self, operations: usize, fault: Fault) {
        self.state().fault = Some((operations, fault));
    }

    /// Whether the planned crash has come.
    pub fn has_crashed(&self) -> bool {
        self.state().has_crashed
    }

    /// The disk as it may be after a crash now: in a folder of its own, all of it durable.
    pub fn crash(&self) -> Self {
        let mut state = self.state();
        let after = Self::new(state.random.random(), state.lies);
        let mut new = after.state();
        state.survive(ROOT, after.root(), ROOT, &mut new.nodes);
        drop(new);
        after
    }

    /// Replaces the bytes of a file, as a bad disk does it.
    pub fn replace(&self, path: &Path, bytes: Vec<u8>) {
        std::fs::write(path, &bytes).unwrap();
        let mut state = self.state();
        let id = state.find(&self.parts(path));
        state.nodes[id] = Node::File { durable: bytes, pending: Vec::new() };
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap()
    }

    /// Names from the root to a path.
    fn parts(&self, path: &Path) -> Vec<String> {
        let inside = path.strip_prefix(self.root()).expect("inside the disk");
        inside.iter().map(|part| part.to_str().unwrap().to_owned()).collect()
    }

    /// The folder that a path is in, and its name there.
    fn place(&self, state: &State, path: &Path) -> (Id, String) {
        let mut parts = self.parts(path);
        let name = parts.pop().expect("not the root");
        (state.find(&parts), name)
    }
}

impl State {
    fn find(&self, parts: &[String]) -> Id {
        parts.iter().fold(ROOT, |folder, part| self.entries(folder)[part])
    }

    fn entries(&self, folder: Id) -> &BTreeMap<String, Id> {
        match &self.nodes[folder] {
            Node::Folder { now, .. } => now,
            Node::File { .. } => panic!("a file is no folder"),
        }
    }

    fn change(&mut self, folder: Id, entries: Entries) {
        let Node::Folder { now, pending, .. } = &mut self.nodes[folder] else {
            panic!("a file is no folder")
        };
        apply(now, &entries);
        pending.push(entries);
    }

    fn add(&mut self, node: Node) -> Id {
        self.nodes.push(node);
        self.nodes.len() - 1
    }

    /// Counts an operation.
    fn operate(&mut self) -> Result<()> {
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
    fn write(&mut self, bytes: usize) -> Result<usize> {
        let is_last = matches!(self.fault, Some((0, Fault::Full { .. } | Fault::Crash)));
        if is_last && !self.has_crashed && bytes > 1 && self.random.random_range(0..2) == 0 {
            return Ok(self.random.random_range(1..bytes));
        }
        self.operate().map(|()| bytes)
    }

    /// Puts what may be left of a folder into another one.
    fn survive(&mut self, from: Id, path: &Path, to: Id, nodes: &mut Vec<Node>) {
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
    fn written_bytes(&self, file: Id) -> Vec<u8> {
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
    fn surviving_bytes(&mut self, file: Id) -> Vec<u8> {
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

impl Disk for FaultyDisk {
    fn create(&self, path: &Path) -> Result<Box<dyn DiskFile>> {
        let mut state = self.state();
        state.operate()?;
        let real = std::fs::File::create_new(path)?;
        let (folder, name) = self.place(&state, path);
        let id = state.add(Node::File { durable: Vec::new(), pending: Vec::new() });
        state.change(folder, vec![(name, Some(id))]);
        Ok(Box::new(FaultyFile { real, id, state: self.state.clone() }))
    }

    fn create_folder(&self, path: &Path) -> Result<()> {
        let mut state = self.state();
        state.operate()?;
        if path.exists() {
            return Ok(());
        }
        std::fs::create_dir(path)?;
        let (folder, name) = self.place(&state, path);
        let id = state.add(Node::folder());
        state.change(folder, vec![(name, Some(id))]);
        Ok(())
    }

    fn rename(&self, from: &Path, to: &Path) -> Result<()> {
        let mut state = self.state();
        state.operate()?;
        std::fs::rename(from, to)?;
        let ((folder, old), (same, new)) = (self.place(&state, from), self.place(&state, to));
        assert_eq!(folder, same, "only inside one folder");
        let id = state.entries(folder)[&old];
        state.change(folder, vec![(old, None), (new, Some(id))]);
        Ok(())
    }

    fn link(&self, path: &Path, second: &Path) -> Result<()> {
        let mut state = self.state();
        state.operate()?;
        std::fs::hard_link(path, second)?;
        let ((folder, first), (same, name)) =
            (self.place(&state, path), self.place(&state, second));
        assert_eq!(folder, same, "only inside one folder");
        let id = state.entries(folder)[&first];
        state.change(folder, vec![(name, Some(id))]);
        Ok(())
    }

    fn remove(&self, path: &Path) -> Result<()> {
        let mut state = self.state();
        state.operate()?;
        std::fs::remove_file(path)?;
        let (folder, name) = self.place(&state, path);
        state.change(folder, vec![(name, None)]);
        Ok(())
    }

    fn remove_folder(&self, path: &Path) -> Result<()> {
        let entries: Vec<PathBuf> =
            std::fs::read_dir(path)?.map(|entry| entry.unwrap().path()).collect();
        for entry in entries {
            if entry.is_dir() { self.remove_folder(&entry)? } else { self.remove(&entry)? }
        }
        let mut state = self.state();
        state.operate()?;
        std::fs::remove_dir(path)?;
        let (folder, name) = self.place(&state, path);
        state.change(folder, vec![(name, None)]);
        Ok(())
    }

    fn sync_folder(&self, path: &Path) -> Result<()> {
        let mut state = self.state();
        state.operate()?;
        let folder = state.find(&self.parts(path));
        let lies = state.lies.folders_are_not_synced;
        let Node::Folder { durable, now, pending } = &mut state.nodes[folder] else {
            panic!("a file is no folder")
        };
        if !lies {
            durable.clone_from(now);
            pending.clear();
        }
        Ok(())
    }
}

/// A file of the disk.
struct FaultyFile {
    real: std::fs::File,
    id: Id,
    state: Arc<Mutex<State>>,
}

impl FaultyFile {
    fn note(state: &mut State, id: Id, change: Change) {
        let Node::File { pending, .. } = &mut state.nodes[id] else {
            panic!("a folder is no file")
        };
        pending.push(change);
    }
}

impl Write for FaultyFile {
    fn write(&mut self, bytes: &[u8]) -> Result<usize> {
        let mut state = self.state.lock().unwrap();
        let done = state.write(bytes.len())?;
        let at = self.real.stream_position()? as usize;
        self.real.write_all(&bytes[..done])?;
        Self::note(&mut state, self.id, Change::Write { at, bytes: bytes[..done].to_vec() });
        Ok(done)
    }

    fn flush(&mut self) -> Result<()> {
        Ok(())
    }
}

impl Seek for FaultyFile {
    fn seek(&mut self, to: SeekFrom) -> Result<u64> {
        self.real.seek(to)
    }
}

impl DiskFile for FaultyFile {
    fn another(&self) -> Result<Box<dyn DiskFile>> {
        let real = self.real.try_clone()?;
        Ok(Box::new(Self { real, id: self.id, state: self.state.clone() }))
    }

    fn set_len(&self, bytes: u64) -> Result<()> {
        let mut state = self.state.lock().unwrap();
        state.operate()?;
        self.real.set_len(bytes)?;
        Self::note(&mut state, self.id, Change::Length(bytes as usize));
        Ok(())
    }

    fn sync(&self) -> Result<()> {
        let mut state = self.state.lock().unwrap();
        let synced = state.operate();
        if state.has_crashed || state.lies.files_are_not_synced {
            return synced;
        }
        // After an error the system takes the data for written, although it may not be.
        let durable = match synced {
            Ok(()) => state.written_bytes(self.id),
            Err(_) => state.surviving_bytes(self.id),
        };
        state.nodes[self.id] = Node::File { durable, pending: Vec::new() };
        synced
    }
}
