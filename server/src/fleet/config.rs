//! Settings of a fleet, section `fleet`.

use crate::pipeline::range::{OutOfRange, require, within};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// The most replicas that JetStream keeps.
const MOST_REPLICAS: usize = 5;
/// An hour, seconds.
const HOUR: f64 = 3600.0;

/// What a server does in a fleet.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Role {
    /// Everything on one machine, without a fleet.
    #[default]
    All,
    /// Takes frames and questions of a fleet, and has no map.
    Gateway,
    /// Has maps of a fleet.
    Worker,
}

/// When frames leave the log.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Trim {
    /// When their map is deleted.
    #[default]
    Never,
    /// When a checkpoint of their map has them.
    Checkpoint,
}

/// A fleet: gateways and workers on NATS JetStream.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FleetConfig {
    /// What this server does.
    pub role: Role,
    /// Addresses of the NATS servers, `nats://HOST:PORT` or `tls://HOST:PORT`.
    pub nats: Vec<String>,
    /// File with the NATS credentials (.creds); absent: none are needed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub credentials: Option<PathBuf>,
    /// Beginning of all names in NATS: fleets with different ones do not meet.
    pub prefix: String,
    /// Copies that JetStream keeps of everything; 3 on a cluster.
    pub replicas: usize,
    /// The most bytes of the frame log, all maps together; 0: as much as JetStream has room for. A full log
    /// takes no more frames.
    pub max_log_bytes: u64,
    /// When frames leave the log.
    pub trim: Trim,
    /// How long a worker that is not heard of keeps its maps, seconds. Longer than the election of a leader
    /// in NATS, which takes up to 7 seconds.
    pub lease_seconds: f64,
    /// Name of this worker; absent: that of the host with the number of the process.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Address of this worker's gRPC for gateways, HOST:PORT; absent: where it listens.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub grpc: Option<String>,
    /// Address of this worker's HTTP for gateways, HOST:PORT; absent: where it listens.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub http: Option<String>,
}

impl Default for FleetConfig {
    fn default() -> Self {
        Self {
            role: Role::All,
            nats: Vec::new(),
            credentials: None,
            prefix: "lexsplat".into(),
            replicas: 1,
            max_log_bytes: 0,
            trim: Trim::Never,
            lease_seconds: 10.0,
            name: None,
            grpc: None,
            http: None,
        }
    }
}

impl FleetConfig {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`OutOfRange`] names the first key that is out of range.
    pub(crate) fn check(&self) -> Result<(), OutOfRange> {
        let is_name = |text: &str| {
            !text.is_empty()
                && text.chars().all(|c| c.is_ascii_alphanumeric() || matches!(c, '-' | '_'))
        };
        let names = "letters, digits, - and _";
        require(is_name(&self.prefix), "fleet.prefix", format!("{:?}", self.prefix), names)?;
        if let Some(name) = &self.name {
            require(is_name(name), "fleet.name", format!("{name:?}"), names)?;
        }
        within("fleet.replicas", self.replicas, 1..=MOST_REPLICAS)?;
        within("fleet.max_log_bytes", self.max_log_bytes, 0..=i64::MAX as u64)?;
        within("fleet.lease_seconds", self.lease_seconds, 0.5..=HOUR)?;
        require(
            self.role == Role::All || !self.nats.is_empty(),
            "fleet.nats",
            "empty",
            "at least one address: a gateway and a worker need NATS (--nats nats://HOST:PORT)",
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::range::table::assert_checks;

    #[test]
    fn each_setting_is_checked() {
        assert_checks(
            "fleet",
            FleetConfig::check,
            &[
                ("fleet.prefix", |c| c.prefix = "a.b".into(), |c| c.prefix = "a-b".into()),
                ("fleet.name", |c| c.name = Some("a b".into()), |c| c.name = Some("a_b".into())),
                ("fleet.replicas", |c| c.replicas = 0, |c| c.replicas = 3),
                (
                    "fleet.max_log_bytes",
                    |c| c.max_log_bytes = u64::MAX,
                    |c| c.max_log_bytes = 1 << 40,
                ),
                ("fleet.lease_seconds", |c| c.lease_seconds = 0.4, |c| c.lease_seconds = 0.5),
                ("fleet.lease_seconds", |c| c.lease_seconds = f64::NAN, |c| c.lease_seconds = 1.0),
                (
                    "fleet.nats",
                    |c| c.role = Role::Worker,
                    |c| (c.role, c.nats) = (Role::Worker, vec!["nats://127.0.0.1:4222".into()]),
                ),
            ],
            &[],
        );
    }
}
