//! A disk for tests: it fails when it is told to, and after a crash it has what a real disk may have then.
//!
//! Operations are done in a real folder, which readers see, and noted. At a crash, changes of a folder
//! since it was synced, and writes to a file since it was synced, are there or not, each by chance; of a
//! write some blocks may be there and others not. What was synced is there.

use super::crash_model::{Change, Fault, Id, Lies, Node, ROOT, State};
use super::disk::{Disk, DiskFile};
use rand::Rng as _;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng as _;
use std::io::{Result, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard};

/// The disk. Cheap to clone.
#[derive(Clone)]
pub(super) struct FaultyDisk {
    root: Arc<tempfile::TempDir>,
    state: Arc<Mutex<State>>,
}

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
