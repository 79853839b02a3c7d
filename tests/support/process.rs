//! The server as a process of its own, for what only a process has: memory, and a sudden end.

use crate::root;
use serde_json::Value;
use std::io::{BufRead as _, BufReader};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};

/// A running `lexsplat-server` on free ports; dropping it kills it (SIGKILL).
pub struct ServerProcess {
    child: Child,
    /// Address of gRPC.
    pub grpc: String,
    /// Address of HTTP.
    pub http: String,
}

/// A program that the same build made, beside the test's folder.
pub fn program(name: &str) -> PathBuf {
    let test = std::env::current_exe().expect("a test knows its program");
    let deps = test.parent().expect("it lies in deps/");
    let program = deps.parent().expect("deps/ lies in the build folder").join(name);
    assert!(program.exists(), "{} is missing: cargo build --workspace --bins", program.display());
    program
}

impl ServerProcess {
    /// Starts with `configs/tiny.toml` and these settings (`LEXSPLAT__SECTION__KEY`), waits until it is
    /// ready.
    pub fn start(settings: &[(&str, &str)]) -> Self {
        Self::run(Command::new(program("lexsplat-server")), settings)
    }

    /// The same with at most this many open files, as `ulimit -Sn` sets it.
    pub fn with_files(files: u32, settings: &[(&str, &str)]) -> Self {
        let mut command = Command::new("sh");
        command
            .args(["-c", &format!("ulimit -Sn {files} && exec \"$0\" \"$@\"")])
            .arg(program("lexsplat-server"));
        Self::run(command, settings)
    }

    fn run(mut command: Command, settings: &[(&str, &str)]) -> Self {
        let mut child = command
            .current_dir(root())
            .args(["--config", "configs/tiny.toml"])
            .args(["--grpc", "127.0.0.1:0", "--http", "127.0.0.1:0"])
            .envs(settings.iter().copied())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("it runs");
        let mut ready = String::new();
        let stdout = child.stdout.take().expect("it is piped");
        BufReader::new(stdout).read_line(&mut ready).expect("it can be read");
        let ready: Value = serde_json::from_str(&ready).expect("it says that it is ready, in JSON");
        let address = |key: &str| ready[key].as_str().expect("an address").to_owned();
        Self { child, grpc: address("grpc"), http: address("http") }
    }

    /// Memory of the process that is in the machine's memory, bytes.
    pub fn resident_bytes(&self) -> u64 {
        self.status_bytes("VmRSS:")
    }

    /// The most that it ever had there, bytes.
    pub fn peak_bytes(&self) -> u64 {
        self.status_bytes("VmHWM:")
    }

    /// A number in the process's status.
    fn status_bytes(&self, key: &str) -> u64 {
        let status = std::fs::read_to_string(format!("/proc/{}/status", self.child.id()))
            .expect("Linux says what a process takes");
        let line = status.lines().find_map(|line| line.strip_prefix(key)).expect("its memory");
        let kib = line.trim().strip_suffix("kB").expect("in kB").trim();
        kib.parse::<u64>().expect("a number") * 1024
    }
}

impl Drop for ServerProcess {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
