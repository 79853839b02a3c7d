//! NATS servers for a fleet on this machine, each a process of its own.

use crate::link::{Link, Passing};
use crate::process::{ServerProcess, Signal, processor_time, send_signal};
use crate::root;
use serde_json::Value;
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicU16, Ordering};
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// How long a NATS server may take to start.
const START: Duration = Duration::from_secs(20);
/// Where nobody listens: NATS servers are not to find each other but through links.
const NOBODY: &str = "127.0.0.1:9";

fn nats_server() -> Command {
    let program = root().join(".deps/nats/bin/nats-server");
    assert!(program.exists(), "{} is missing: deploy/setup.sh --tests", program.display());
    let mut command = Command::new(program);
    command.stdout(Stdio::null()).stderr(Stdio::null());
    command
}

/// A NATS server with JetStream on a free port; dropping it kills it.
pub struct Nats {
    child: Child,
    url: String,
    folder: TempDir,
}

impl Nats {
    /// Starts one.
    pub fn start() -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder can be made");
        let child = nats_server()
            .args(["-js", "-a", "127.0.0.1", "-p", "-1", "--ports_file_dir"])
            .arg(folder.path())
            .arg("-sd")
            .arg(folder.path().join("data"))
            .spawn()
            .expect("it runs");
        let mut nats = Self { child, url: String::new(), folder };
        let began = Instant::now();
        while nats.url.is_empty() {
            assert!(began.elapsed() < START, "NATS does not start");
            std::thread::sleep(Duration::from_millis(20));
            nats.url = nats.told().unwrap_or_default();
        }
        nats
    }

    /// The address that the server wrote into its file.
    fn told(&self) -> Option<String> {
        let file = self.folder.path().join(format!("nats-server_{}.ports", self.child.id()));
        let told: Value = serde_json::from_slice(&std::fs::read(file).ok()?).ok()?;
        told["nats"][0].as_str().map(str::to_owned)
    }

    /// Processor time that it has used.
    pub fn processor_time(&self) -> Duration {
        processor_time(&self.child)
    }

    /// Its address.
    pub fn url(&self) -> &str {
        &self.url
    }

    /// A worker or a gateway with these settings (`LEXSPLAT__SECTION__KEY`). Its log goes into this file.
    pub fn server(&self, role: &str, settings: &[(&str, &str)], log: &Path) -> ServerProcess {
        let nats = format!("[{:?}]", self.url);
        let of_fleet = [
            ("LEXSPLAT__FLEET__ROLE", role),
            ("LEXSPLAT__FLEET__NATS", nats.as_str()),
            ("LEXSPLAT__TELEMETRY__FILTER", "info"),
        ];
        ServerProcess::logging(&[&of_fleet, settings].concat(), log)
    }

    /// A file beside its data, for a log.
    pub fn log(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }
}

impl Drop for Nats {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Three NATS servers that replicate. All that passes between them, and to them, passes through links.
pub struct Cluster {
    nodes: Vec<Option<Child>>,
    /// Clients' ports.
    ports: Vec<u16>,
    /// From the first node to the second.
    routes: Vec<(usize, usize, Link)>,
    folder: TempDir,
}

impl Cluster {
    /// Starts them.
    pub async fn start() -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder can be made");
        // There may be none.
        let _ = std::fs::remove_dir_all(logs());
        std::fs::create_dir_all(logs()).expect("a folder can be made");
        let (ports, route_ports) = (free_ports(), free_ports());
        let mut routes = Vec::new();
        for from in 0..3 {
            for to in (0..3).filter(|to| *to != from) {
                routes.push((from, to, Link::to(&format!("127.0.0.1:{}", route_ports[to])).await));
            }
        }
        for node in 0..3 {
            let of_node = routes.iter().filter(|(from, ..)| *from == node);
            let urls: Vec<String> =
                of_node.map(|(.., link)| format!("nats-route://{}", link.address)).collect();
            let text = format!(
                "server_name: n{node}\nlisten: 127.0.0.1:{}\njetstream {{ store_dir: {:?}, sync_interval: always }}\n\
                 cluster {{ name: fleet, listen: 127.0.0.1:{}, advertise: {NOBODY:?}, no_advertise: true, \
                 pool_size: -1, routes: {urls:?} }}\n",
                ports[node],
                folder.path().join(format!("data-{node}")),
                route_ports[node],
            );
            std::fs::write(folder.path().join(format!("{node}.conf")), text)
                .expect("there is room");
        }
        let nodes = vec![None, None, None];
        let mut cluster = Self { nodes, ports, routes, folder };
        (0..3).for_each(|node| cluster.restart(node));
        cluster
    }

    /// Address of a node, without a link.
    pub fn address(&self, node: usize) -> String {
        format!("127.0.0.1:{}", self.ports[node])
    }

    /// Starts a node, if it does not run.
    pub fn restart(&mut self, node: usize) {
        if self.nodes[node].is_none() {
            let config = self.folder.path().join(format!("{node}.conf"));
            let log = logs().join(format!("nats-{node}"));
            let child = nats_server().arg("-c").arg(config).arg("-l").arg(log).spawn();
            let child = child.expect("it runs");
            self.nodes[node] = Some(child);
        }
    }

    /// Kills a node (SIGKILL).
    pub fn kill(&mut self, node: usize) {
        if let Some(mut child) = self.nodes[node].take() {
            child.kill().expect("it runs");
            child.wait().expect("it can be waited for");
        }
    }

    /// Sends a node a signal, if it runs.
    pub fn signal(&self, node: usize, signal: Signal) {
        if let Some(child) = &self.nodes[node] {
            send_signal(child, signal);
        }
    }

    /// Cuts two nodes from each other, or joins them.
    pub fn set(&self, a: usize, b: usize, passing: Passing) {
        let between = |from: usize, to: usize| (from, to) == (a, b) || (from, to) == (b, a);
        let routes = self.routes.iter().filter(|(from, to, _)| between(*from, *to));
        routes.for_each(|(.., link)| link.set(passing));
    }

    /// A file for a log, which stays when all has ended: `target/fleet-logs/NAME`.
    pub fn log(&self, name: &str) -> PathBuf {
        logs().join(name)
    }
}

fn logs() -> PathBuf {
    root().join("target/fleet-logs")
}

impl Drop for Cluster {
    fn drop(&mut self) {
        (0..3).for_each(|node| self.kill(node));
    }
}

/// A port that is free now and that no outgoing connection takes meanwhile: systems give those higher ones.
pub fn free_port() -> u16 {
    static NEXT: AtomicU16 = AtomicU16::new(0);
    let first = u16::try_from(std::process::id() % 10_000).expect("it is small");
    loop {
        let port = 20_000 + (first + NEXT.fetch_add(1, Ordering::Relaxed)) % 10_000;
        if TcpListener::bind(("127.0.0.1", port)).is_ok() {
            return port;
        }
    }
}

fn free_ports() -> Vec<u16> {
    (0..3).map(|_| free_port()).collect()
}
