//! A server process: started on free ports, awaited until it is ready, stopped by SIGTERM. Its log
//! goes to a file; errors show the last lines of it.

use anyhow::{Context as _, Result, bail};
use rustix::process::{Pid, Signal, kill_process};
use serde::Deserialize;
use std::fs::File;
use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};
use tokio::sync::oneshot;

const START_LIMIT: Duration = Duration::from_secs(180);
/// The server gives running calls 30 s to finish.
const STOP_LIMIT: Duration = Duration::from_secs(60);
const SHOWN_LINES: usize = 12;
const POLL: Duration = Duration::from_millis(20);

/// The program to start and its settings.
#[derive(Clone, Debug)]
pub struct Plan {
    /// The binary.
    pub program: PathBuf,
    /// Settings file; absent for the server's own default.
    pub config: Option<PathBuf>,
    /// Folder of a bundle of networks; absent for the one in the settings.
    pub models: Option<PathBuf>,
    /// Settings that override the file: (`SECTION__KEY`, value).
    pub settings: Vec<(&'static str, &'static str)>,
    /// File for the log.
    pub log: PathBuf,
}

impl Plan {
    /// The program with the plan's settings.
    pub fn command(&self) -> Command {
        let mut command = Command::new(&self.program);
        for (option, path) in [("--config", &self.config), ("--models", &self.models)] {
            if let Some(path) = path {
                command.arg(option).arg(path);
            }
        }
        let named = |(key, value): &(&str, &'static str)| (format!("LEXSPLAT__{key}"), *value);
        command.envs(self.settings.iter().map(named));
        command
    }
}

/// The line that the server prints when it is ready.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
pub struct Ready {
    /// gRPC address.
    pub grpc: String,
    /// HTTP address.
    pub http: String,
    /// Graphics adapter.
    pub adapter: String,
    /// Bundle of networks.
    pub bundle: String,
}

/// A running server; it is stopped when dropped.
#[derive(Debug)]
pub struct Server {
    child: Child,
    log: PathBuf,
    /// Its addresses, adapter and networks.
    pub ready: Ready,
}

/// The server's binary in the folder of this program.
///
/// # Errors
/// If it is not there.
pub fn beside_this() -> Result<PathBuf> {
    let own = std::env::current_exe().context("cannot tell where this program is")?;
    let program = own.with_file_name("lexsplat-server");
    if !program.is_file() {
        bail!("no {}: build the server, or name it with --server", program.display());
    }
    Ok(program)
}

impl Server {
    /// Starts it and waits until it is ready.
    ///
    /// # Errors
    /// If it cannot be started, ends, or is not ready in time; with the end of its log.
    pub async fn start(plan: &Plan) -> Result<Self> {
        let Plan { program, log, .. } = plan;
        let file = File::create(log).with_context(|| format!("cannot write {}", log.display()))?;
        let mut command = plan.command();
        command.args(["--grpc", "127.0.0.1:0", "--http", "127.0.0.1:0"]);
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(file);
        let mut child =
            command.spawn().with_context(|| format!("cannot start {}", program.display()))?;
        let line = first_line(&mut child)?;
        let ready = match tokio::time::timeout(START_LIMIT, line).await {
            Ok(Ok(line)) => serde_json::from_str(&line)
                .with_context(|| format!("the server said {line:?} instead of being ready")),
            Ok(Err(_)) => Err(anyhow::anyhow!("the server did not start{}", last_words(log))),
            Err(_) => Err(anyhow::anyhow!(
                "the server was not ready in {START_LIMIT:?}{}",
                last_words(log)
            )),
        };
        match ready {
            Ok(ready) => Ok(Self { child, log: log.clone(), ready }),
            Err(error) => {
                // The process may have ended already.
                let _ = child.kill();
                let _ = child.wait();
                Err(error)
            }
        }
    }

    /// The number of its process.
    pub fn process(&self) -> u32 {
        self.child.id()
    }

    /// Adds the state of the server and its log to an error.
    pub fn explain(&mut self, error: anyhow::Error) -> anyhow::Error {
        match self.child.try_wait() {
            Ok(Some(status)) => {
                let words = last_words(&self.log);
                error.context(format!("the server ended by itself ({status}){words}"))
            }
            _ => error.context(format!("the server's log is {}", self.log.display())),
        }
    }

    /// Asks it to stop and waits.
    ///
    /// # Errors
    /// If it does not stop in time, or exits with an error.
    pub fn stop(mut self) -> Result<()> {
        let status = self.end()?;
        if !status.success() {
            bail!("the server did not stop cleanly ({status}){}", last_words(&self.log));
        }
        Ok(())
    }

    fn end(&mut self) -> Result<ExitStatus> {
        if let Some(status) = self.child.try_wait()? {
            return Ok(status);
        }
        kill_process(Pid::from_child(&self.child), Signal::TERM).context("cannot send SIGTERM")?;
        let limit = Instant::now() + STOP_LIMIT;
        while Instant::now() < limit {
            if let Some(status) = self.child.try_wait()? {
                return Ok(status);
            }
            std::thread::sleep(POLL);
        }
        self.child.kill()?;
        self.child.wait()?;
        bail!("the server did not stop within {STOP_LIMIT:?}{}", last_words(&self.log))
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        if let Err(error) = self.end() {
            note!("lexsplat: {error:#}");
        }
    }
}

/// The first line of the child's output. The rest is read and dropped, so that the child never
/// blocks.
fn first_line(child: &mut Child) -> Result<oneshot::Receiver<String>> {
    let output = child.stdout.take().context("the server has no standard output")?;
    let (sender, receiver) = oneshot::channel();
    let read = move || {
        let mut lines = BufReader::new(output).lines().map_while(Result::ok);
        if let Some(line) = lines.next() {
            // The receiver is gone if the wait timed out.
            let _ = sender.send(line);
        }
        lines.for_each(drop);
    };
    let named = std::thread::Builder::new().name("server-output".into());
    named.spawn(read).context("cannot start a thread")?;
    Ok(receiver)
}

/// The end of a log, to be appended to a message.
fn last_words(log: &Path) -> String {
    let text = String::from_utf8_lossy(&std::fs::read(log).unwrap_or_default()).into_owned();
    let lines: Vec<&str> = text.lines().collect();
    let last = &lines[lines.len().saturating_sub(SHOWN_LINES)..];
    match last {
        [] => format!(" (nothing is in {})", log.display()),
        _ => format!("; the end of {}:\n  {}", log.display(), last.join("\n  ")),
    }
}

/// Held by tests that write a program and start it: one that is being written while another thread
/// forks cannot be started.
#[cfg(test)]
pub static ONE_AT_A_TIME: tokio::sync::Mutex<()> = tokio::sync::Mutex::const_new(());

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs::Permissions;
    use std::os::unix::fs::PermissionsExt as _;

    struct Folder(PathBuf);

    impl Folder {
        fn new(name: &str) -> Self {
            let path = std::env::temp_dir().join(format!("lexsplat-{name}-{}", std::process::id()));
            std::fs::create_dir_all(&path).unwrap();
            Self(path)
        }

        /// A stand-in for the server.
        fn plan(&self, script: &str) -> Plan {
            let program = self.0.join("server.sh");
            std::fs::write(&program, format!("#!/bin/sh\n{script}\n")).unwrap();
            std::fs::set_permissions(&program, Permissions::from_mode(0o755)).unwrap();
            Plan {
                program,
                config: None,
                models: None,
                settings: Vec::new(),
                log: self.0.join("server.log"),
            }
        }
    }

    impl Drop for Folder {
        fn drop(&mut self) {
            let _ = std::fs::remove_dir_all(&self.0);
        }
    }

    const READY: &str =
        r#"echo '{"event":"ready","grpc":"a:1","http":"b:2","adapter":"c","bundle":"d"}'"#;
    const WAIT: &str = "while :; do sleep 0.05; done";

    #[tokio::test]
    async fn a_server_is_started_awaited_and_stopped() {
        let _alone = ONE_AT_A_TIME.lock().await;
        let folder = Folder::new("server-good");
        let plan = folder.plan(&format!("trap 'exit 0' TERM; {READY}; {WAIT}"));
        let server = Server::start(&plan).await.unwrap();
        assert_eq!((server.ready.grpc.as_str(), server.ready.http.as_str()), ("a:1", "b:2"));
        server.stop().unwrap();
    }

    #[tokio::test]
    async fn a_failed_exit_is_an_error_with_the_end_of_the_log() {
        let _alone = ONE_AT_A_TIME.lock().await;
        let folder = Folder::new("server-bad-end");
        let plan = folder.plan(&format!("trap 'echo oh no >&2; exit 3' TERM; {READY}; {WAIT}"));
        let error = Server::start(&plan).await.unwrap().stop().unwrap_err().to_string();
        assert!(error.contains("cleanly") && error.contains("oh no"), "{error}");
    }

    #[tokio::test]
    async fn a_server_that_does_not_start_shows_the_end_of_its_log() {
        let _alone = ONE_AT_A_TIME.lock().await;
        let folder = Folder::new("server-no-start");
        let plan = folder.plan("for i in $(seq 30); do echo line $i >&2; done; exit 1");
        let error = Server::start(&plan).await.unwrap_err().to_string();
        assert!(error.contains("line 30") && !error.contains("line 5\n"), "{error}");
        let error = Server::start(&folder.plan("echo hello")).await.unwrap_err().to_string();
        assert!(error.contains("\"hello\""), "{error}");
    }
}
