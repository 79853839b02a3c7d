//! The settings of the server, one section per module.
//!
//! Sources, each overrides the one before: defaults, a TOML file, environment variables
//! (`LEXSPLAT__SECTION__KEY`), the command line. An unknown key is an error that names its source
//! and the most similar known key.

mod server;

pub use crate::net::TlsConfig;
pub use server::ServerConfig;

use crate::access::AccessConfig;
use crate::fleet::{FleetConfig, MOST_UNREAD, Role};
use crate::http::HttpConfig;
use crate::import::ImportsConfig;
use crate::ingest::IngestConfig;
use crate::net::ConnectionsConfig;
use crate::pipeline::closure::ClosureConfig;
use crate::pipeline::compressor::CompressorConfig;
use crate::pipeline::encoder::LanguageConfig;
use crate::pipeline::engine::PipelineConfig;
use crate::pipeline::mapper::MapperConfig;
use crate::pipeline::query::QueryConfig;
use crate::pipeline::range::{OutOfRange, require, within};
use crate::pipeline::tracker::TrackerConfig;
use crate::store::RecordingConfig;
use crate::telemetry::TelemetryConfig;
use figment::Figment;
use figment::error::Kind;
use figment::providers::{Env, Format, Toml};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Name of the environment in error messages.
const ENVIRONMENT: &str = "environment";
/// Prefix of environment variables with settings.
const ENVIRONMENT_PREFIX: &str = "LEXSPLAT__";
/// Separator of section and key in the name of an environment variable.
const ENVIRONMENT_SEPARATOR: &str = "__";

/// All settings.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// Addresses and the data directory.
    pub server: ServerConfig,
    /// Who may call.
    pub access: AccessConfig,
    /// Limits on connections.
    pub connections: ConnectionsConfig,
    /// Limits on the data directory.
    pub recording: RecordingConfig,
    /// Limits of the gRPC interface.
    pub ingest: IngestConfig,
    /// Choice of the GPU adapter.
    pub gpu: GpuConfig,
    /// The networks that compute language.
    pub language: LanguageConfig,
    /// The online stage of the language compression.
    pub compressor: CompressorConfig,
    /// Pose estimation.
    pub tracker: TrackerConfig,
    /// Loop closure.
    pub closure: ClosureConfig,
    /// Mapping: keyframes, insertion, optimisation, budgets.
    pub mapper: MapperConfig,
    /// Answering questions.
    pub query: QueryConfig,
    /// Limits of the HTTP interface.
    pub http: HttpConfig,
    /// Limits on uploaded recordings.
    pub imports: ImportsConfig,
    /// The log of the server.
    pub telemetry: TelemetryConfig,
    /// Several machines that work together.
    pub fleet: FleetConfig,
}

/// The GPU adapter, section `gpu`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GpuConfig {
    /// Part of the adapter's name; absent: the best adapter.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub adapter: Option<String>,
}

/// Why settings are refused.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// The file cannot be read.
    #[error("cannot read the config file {path}: {reason}")]
    Unreadable {
        /// Path of the file.
        path: PathBuf,
        /// Error of the operating system.
        reason: std::io::Error,
    },
    /// An unknown key.
    #[error("{source_name}: unknown key {key:?}; the nearest known key is {nearest:?}")]
    UnknownKey {
        /// File or variable.
        source_name: String,
        /// Section and key.
        key: String,
        /// The most similar known key.
        nearest: String,
    },
    /// A value of the wrong type, or malformed TOML.
    #[error("{source_name}: {reason}")]
    Invalid {
        /// File or variables.
        source_name: String,
        /// What was expected and what was found.
        reason: String,
    },
    /// A number outside its permitted range.
    #[error(transparent)]
    OutOfRange(#[from] OutOfRange),
}

impl Config {
    /// Reads the settings from the defaults, `file` and the environment.
    ///
    /// # Errors
    /// [`ConfigError`] names the source and the key.
    pub fn load(file: Option<&Path>) -> Result<Self, ConfigError> {
        let mut all = Figment::new();
        if let Some(path) = file {
            let text = std::fs::read_to_string(path)
                .map_err(|reason| ConfigError::Unreadable { path: path.to_owned(), reason })?;
            let provider = Figment::from(Toml::string(&text));
            examine(&provider, &path.display().to_string())?;
            all = all.merge(provider);
        }
        let environment =
            Figment::from(Env::prefixed(ENVIRONMENT_PREFIX).split(ENVIRONMENT_SEPARATOR));
        examine(&environment, ENVIRONMENT).map_err(naming_the_variable)?;
        all.merge(environment).extract().map_err(|error| explain(&error, "settings"))
    }

    /// Refuses numbers outside their ranges; each section checks its own.
    ///
    /// # Errors
    /// [`ConfigError::OutOfRange`] names the key, the value and the range.
    pub fn check(&self) -> Result<(), ConfigError> {
        self.check_ranges().map_err(ConfigError::OutOfRange)
    }

    fn check_ranges(&self) -> Result<(), OutOfRange> {
        self.server.check()?;
        self.connections.check()?;
        self.recording.check()?;
        self.ingest.check()?;
        self.http.check()?;
        self.imports.check()?;
        self.language.check()?;
        self.compressor.check()?;
        self.query.check()?;
        self.tracker.check()?;
        self.closure.check()?;
        self.mapper.check()?;
        self.fleet.check()?;
        if self.fleet.role != Role::All {
            within("ingest.ack_backlog", self.ingest.ack_backlog, 1..=MOST_UNREAD)?;
        }
        require(
            self.fleet.role != Role::Worker || self.server.tls.is_none(),
            "server.tls",
            "set",
            "nothing for a worker: gateways speak with workers in plain text, on a network of their own",
        )
    }

    /// The settings of the pipeline.
    pub fn pipeline(&self) -> PipelineConfig {
        PipelineConfig {
            adapter: self.gpu.adapter.clone(),
            language: self.language.clone(),
            compressor: self.compressor.clone(),
            tracker: self.tracker.clone(),
            closure: self.closure.clone(),
            mapper: self.mapper.clone(),
            query: self.query.clone(),
        }
    }
}

/// Reads one source alone, so that the error can name it.
fn examine(provider: &Figment, source_name: &str) -> Result<(), ConfigError> {
    match provider.extract::<Config>() {
        Ok(_) => Ok(()),
        Err(error) => Err(explain(&error, source_name)),
    }
}

/// Names the environment variable of an unknown key.
fn naming_the_variable(error: ConfigError) -> ConfigError {
    match error {
        ConfigError::UnknownKey { key, nearest, .. } => {
            let variable = key.to_uppercase().replace('.', ENVIRONMENT_SEPARATOR);
            let source_name = format!("environment variable {ENVIRONMENT_PREFIX}{variable}");
            ConfigError::UnknownKey { source_name, key, nearest }
        }
        other => other,
    }
}

fn explain(error: &figment::Error, source_name: &str) -> ConfigError {
    let source_name = source_name.to_owned();
    let Kind::UnknownField(field, known) = &error.kind else {
        let key = error.path.join(".");
        let reason = match key.is_empty() {
            true => error.kind.to_string(),
            false => format!("{key}: {}", error.kind),
        };
        return ConfigError::Invalid { source_name, reason: one_line(&reason) };
    };
    let nearest = known
        .iter()
        .max_by(|a, b| strsim::jaro_winkler(a, field).total_cmp(&strsim::jaro_winkler(b, field)))
        .copied()
        .unwrap_or_default();
    // The path ends with the unknown key.
    let section = error.path.strip_suffix(std::slice::from_ref(field)).unwrap_or(&error.path);
    let in_section = |key: &str| [section, &[key.to_owned()]].concat().join(".");
    ConfigError::UnknownKey { source_name, key: in_section(field), nearest: in_section(nearest) }
}

/// Joins the lines of a message: TOML errors show the line with the error.
fn one_line(text: &str) -> String {
    text.split('\n').map(str::trim).filter(|line| !line.is_empty()).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    const DEFAULT_TOML: &str = include_str!("../../../configs/default.toml");
    const TINY_TOML: &str = include_str!("../../../configs/tiny.toml");
    const PAPER_TOML: &str = include_str!("../../../configs/paper.toml");

    fn parse(text: &str) -> Result<Config, ConfigError> {
        let provider = Figment::from(Toml::string(text));
        provider.extract().map_err(|error| explain(&error, "test.toml"))
    }

    /// All keys of `wanted` that are missing in `found`.
    fn missing(wanted: &toml::Table, found: &toml::Table) -> Vec<String> {
        let mut keys = Vec::new();
        for (key, value) in wanted {
            match (value, found.get(key)) {
                (toml::Value::Table(a), Some(toml::Value::Table(b))) => {
                    keys.extend(missing(a, b).into_iter().map(|inner| format!("{key}.{inner}")));
                }
                (_, Some(_)) => {}
                (_, None) => keys.push(key.clone()),
            }
        }
        keys
    }

    #[test]
    fn default_toml_has_the_defaults_of_the_code() {
        assert_eq!(parse(DEFAULT_TOML).unwrap(), Config::default());
        let code = toml::Table::try_from(Config::default()).unwrap();
        let shipped: toml::Table = toml::from_str(DEFAULT_TOML).unwrap();
        assert_eq!(missing(&code, &shipped), Vec::<String>::new(), "keys that the file lacks");
    }

    #[test]
    fn the_comparison_sees_a_missing_and_a_changed_key() {
        let code = toml::Table::try_from(Config::default()).unwrap();
        let mut other = code.clone();
        other["server"].as_table_mut().unwrap().remove("grpc");
        assert_eq!(missing(&code, &other), ["server.grpc"]);
        assert_ne!(parse("[server]\nshutdown_seconds = 31").unwrap(), Config::default());
    }

    #[test]
    fn printed_settings_are_read_back() {
        let printed = toml::to_string(&Config::default()).unwrap();
        assert!(printed.contains("min_depth_metres = 0.01\n"), "{printed}");
        assert_eq!(parse(&printed).unwrap(), Config::default());
    }

    #[test]
    fn shipped_files_are_accepted() {
        for text in [TINY_TOML, PAPER_TOML] {
            parse(text).unwrap().check().unwrap();
        }
    }

    #[test]
    fn an_unknown_key_is_refused_with_the_most_similar_one() {
        let error = parse("[ingest]\nmax_pixel = 3").unwrap_err().to_string();
        assert_eq!(
            error,
            "test.toml: unknown key \"ingest.max_pixel\"; the nearest known key is \
             \"ingest.max_pixels\""
        );
        let error = parse("[sever]\ngrpc = \"x\"").unwrap_err().to_string();
        assert!(error.contains("\"sever\"") && error.contains("\"server\""), "{error}");
        let error = parse("[mapper.loss]\ncolour = 1.0").unwrap_err().to_string();
        assert!(error.contains("\"mapper.loss.color\""), "{error}");
        parse("[ingest]\nmax_pixels = 3").unwrap();
    }

    #[test]
    fn a_wrong_type_is_refused_with_its_key() {
        let error = parse("[ingest]\nmax_pixels = \"many\"").unwrap_err().to_string();
        assert!(error.contains("ingest.max_pixels") && error.contains("many"), "{error}");
        let error = parse("[ingest\n").unwrap_err().to_string();
        assert!(!error.contains('\n') && error.contains("line 1"), "{error}");
    }

    #[test]
    fn every_section_is_checked() {
        type Change = fn(&mut Config);
        let refused: [(&str, Change); 10] = [
            ("fleet.replicas", |c| c.fleet.replicas = 0),
            ("connections.max", |c| c.connections.max = 0),
            ("ingest.ack_backlog", |c| c.ingest.ack_backlog = 0),
            ("http.event_backlog", |c| c.http.event_backlog = 0),
            ("language.queue", |c| c.language.queue = 0),
            ("compressor.code_size", |c| c.compressor.code_size = 33),
            ("query.object_score", |c| c.query.object_score = f32::NAN),
            ("tracker.width", |c| c.tracker.width = 0),
            ("closure.candidates", |c| c.closure.candidates = 0),
            ("mapper.window", |c| c.mapper.window = 0),
        ];
        for (key, change) in refused {
            let mut config = Config::default();
            change(&mut config);
            let error = config.check().unwrap_err().to_string();
            assert!(error.starts_with(&format!("{key} is ")), "{error}");
        }
    }

    #[test]
    fn values_out_of_range_are_refused() {
        let mut config = Config::default();
        config.check().unwrap();
        config.ingest.ack_backlog = 0;
        assert!(config.check().unwrap_err().to_string().contains("ingest.ack_backlog"));
        config = Config::default();
        config.ingest.max_depth_metres = f32::NAN;
        assert!(config.check().unwrap_err().to_string().contains("max_depth_metres"));
        config = Config::default();
        for before_what_was_measured in [0.8, 1.0, -1.0, f32::NAN] {
            config.mapper.insert_backdrop = before_what_was_measured;
            let error = config.check().unwrap_err().to_string();
            assert!(error.contains("mapper.insert_backdrop"), "{error}");
        }
        config.mapper.insert_backdrop = 0.0;
        config.check().unwrap();
    }
}
