//! The server as a process of its own, for what only a process has: memory, and a sudden end.

use crate::root;
pub use rustix::process::Signal;
use rustix::process::{Pid, kill_process};
use serde_json::Value;
use std::fs::File;
use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

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

/// Sends a signal to a process.
pub(crate) fn send_signal(child: &Child, signal: Signal) {
    let pid = i32::try_from(child.id()).ok().and_then(Pid::from_raw);
    kill_process(pid.expect("it has a number"), signal).expect("it runs");
}

/// Processor time that a process has used, in steps of 10 ms.
pub(crate) fn processor_time(child: &Child) -> Duration {
    let stat = std::fs::read_to_string(format!("/proc/{}/stat", child.id()));
    let stat = stat.expect("Linux says what a process takes");
    // The name of the program may have spaces; it is in brackets.
    let (_, fields) = stat.rsplit_once(") ").expect("a name");
    let ticks =
        fields.split(' ').skip(11).take(2).map(|field| field.parse::<u64>().expect("ticks"));
    Duration::from_millis(ticks.sum::<u64>() * 10)
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

    /// The same with its log in a file.
    pub fn logging(settings: &[(&str, &str)], log: &Path) -> Self {
        Self::logging_of(Command::new(program("lexsplat-server")), settings, log)
    }

    /// The same with another build of the server, or one that another program starts.
    pub fn logging_of(command: Command, settings: &[(&str, &str)], log: &Path) -> Self {
        let log = File::options().create(true).append(true).open(log).expect("a file can be made");
        Self::start_with(command, settings, log.into())
    }

    fn run(command: Command, settings: &[(&str, &str)]) -> Self {
        Self::start_with(command, settings, Stdio::null())
    }

    fn start_with(mut command: Command, settings: &[(&str, &str)], log: Stdio) -> Self {
        let mut child = command
            .current_dir(root())
            .args(["--config", "configs/tiny.toml"])
            .env("LEXSPLAT__SERVER__GRPC", "127.0.0.1:0")
            .env("LEXSPLAT__SERVER__HTTP", "127.0.0.1:0")
            .envs(settings.iter().copied())
            .stdout(Stdio::piped())
            .stderr(log)
            .spawn()
            .expect("it runs");
        let mut ready = String::new();
        let stdout = child.stdout.take().expect("it is piped");
        BufReader::new(stdout).read_line(&mut ready).expect("it can be read");
        let ready: Value = serde_json::from_str(&ready).expect("it says that it is ready, in JSON");
        let address = |key: &str| ready[key].as_str().expect("an address").to_owned();
        Self { child, grpc: address("grpc"), http: address("http") }
    }

    /// Sends it a signal.
    pub fn signal(&self, signal: Signal) {
        send_signal(&self.child, signal);
    }

    /// Waits until it has ended by itself.
    pub fn ended(&mut self) {
        self.child.wait().expect("it can be waited for");
    }

    /// Processor time that it has used.
    pub fn processor_time(&self) -> Duration {
        processor_time(&self.child)
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
