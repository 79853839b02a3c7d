//! The `lexsplat-server` binary: reads the settings and runs [`lexsplat_server`].

use anyhow::Context as _;
use clap::{Parser, Subcommand};
use lexsplat_gpu::{AdapterReport, Gpu, Tier};
use lexsplat_server::access::{self, Scope};
use lexsplat_server::pipeline::engine::Engine;
use lexsplat_server::{Config, Listeners, Ready, Role, inspect, serve, serve_gateway, telemetry};
use std::io::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use tokio::net::TcpListener;
use tokio::signal::unix::{SignalKind, signal};

/// Builds maps from the RGB-D frames of robots and answers questions about them.
///
/// Example: lexsplat-server --data-dir maps --tokens tokens --http 0.0.0.0:8080
#[derive(Parser)]
#[command(name = "lexsplat-server", version, args_conflicts_with_subcommands = true)]
struct Arguments {
    /// Settings file (TOML); environment variables LEXSPLAT__SECTION__KEY override it
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Directory for the recordings of accepted frames (MCAP), so that maps survive a restart
    #[arg(long, value_name = "DIR")]
    data_dir: Option<PathBuf>,
    /// Address for gRPC (robots); port 0 picks a free port
    #[arg(long, value_name = "ADDR")]
    grpc: Option<String>,
    /// Address for HTTP (questions, dashboard); port 0 picks a free port
    #[arg(long, value_name = "ADDR")]
    http: Option<String>,
    /// Directory of the model bundle
    #[arg(long, value_name = "DIR")]
    models: Option<PathBuf>,
    /// Use the GPU adapter with this in its name
    #[arg(long, value_name = "NAME")]
    adapter: Option<String>,
    /// File of the callers and the hashes of their tokens, written by `lexsplat-server token`
    #[arg(long, value_name = "FILE")]
    tokens: Option<PathBuf>,
    /// What this server does in a fleet: everything on one machine, or one part
    #[arg(long, value_enum, value_name = "ROLE")]
    role: Option<Role>,
    /// Addresses of the fleet's NATS servers, separated by commas
    #[arg(long, value_name = "URLS", value_delimiter = ',')]
    nats: Vec<String>,
    /// Listen on addresses that other machines can reach although nobody is asked who they are
    #[arg(long)]
    insecure_no_auth: bool,
    /// Print the settings as TOML and exit
    #[arg(long)]
    print_config: bool,
    /// Print the GPU adapters of this machine and how the server would use them, and exit
    #[arg(long)]
    adapters: bool,
    #[command(subcommand)]
    task: Option<Task>,
}

/// What to do instead of serving.
#[derive(Subcommand)]
enum Task {
    /// Read all recordings and checkpoints of a data directory, print what is damaged, and exit with
    /// status 1 if something is, or if there is no map
    Check {
        /// The data directory; a server may be using it
        dir: PathBuf,
    },
    Token(NewToken),
}

/// Make a token for a caller and print it. Only its hash is kept
#[derive(clap::Args)]
struct NewToken {
    /// Name of the caller, as it appears in logs
    #[arg(long)]
    name: String,
    /// What they may do, separated by commas: read (list, ask, render, export, watch), write (create maps,
    /// send frames), admin (delete maps, back them up and restore them)
    #[arg(long, value_name = "SCOPES", value_delimiter = ',', required = true)]
    scope: Vec<Scope>,
    /// The maps that they may use: names with one * at most, separated by commas
    #[arg(long, value_name = "PATTERNS", default_value = "*")]
    maps: String,
    /// Add the caller's line to this file, and make it if it is missing
    #[arg(long, value_name = "FILE")]
    tokens: Option<PathBuf>,
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    match start(arguments) {
        Ok(status) => status,
        Err(error) => {
            // The error with all its causes on one line.
            let line = format!("{error:#}").replace('\n', " ");
            eprintln!("lexsplat-server: {line}");
            ExitCode::FAILURE
        }
    }
}

fn start(arguments: Arguments) -> anyhow::Result<ExitCode> {
    match &arguments.task {
        Some(Task::Token(new)) => {
            make_token(new)?;
            return Ok(ExitCode::SUCCESS);
        }
        Some(Task::Check { dir }) => {
            let is_good = inspect(dir, &mut std::io::stdout().lock())?;
            return Ok(if is_good { ExitCode::SUCCESS } else { ExitCode::FAILURE });
        }
        None => {}
    }
    if arguments.adapters {
        print_adapters()?;
        return Ok(ExitCode::SUCCESS);
    }
    let print = arguments.print_config;
    let config = settings(arguments)?;
    if print {
        print!("{}", toml::to_string(&config).context("cannot write the settings as TOML")?);
        return Ok(ExitCode::SUCCESS);
    }
    telemetry::start_logs(&config.telemetry)?;
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .enable_all()
        .build()
        .context("cannot start the runtime")?;
    runtime.block_on(run(config))?;
    Ok(ExitCode::SUCCESS)
}

/// Prints the token on standard output and everything else on standard error.
fn make_token(new: &NewToken) -> anyhow::Result<()> {
    let NewToken { name, scope, maps, tokens } = new;
    let (token, line) = access::issue(name, scope, maps, tokens.as_deref())?;
    match tokens {
        Some(file) => {
            eprintln!("its hash was added to {}; the token, shown this once:", file.display())
        }
        None => eprintln!("the line for the tokens file:\n{line}\nthe token, shown this once:"),
    }
    writeln!(std::io::stdout(), "{token}")?;
    Ok(())
}

/// Prints a table of the adapters, best first.
fn print_adapters() -> anyhow::Result<()> {
    let survey = Gpu::survey();
    anyhow::ensure!(
        !survey.is_empty(),
        "there is no Vulkan adapter; install a driver, for example one that runs on the CPU: \
         apt-get install mesa-vulkan-drivers"
    );
    let heads =
        ["ADAPTER", "KIND", "BACKEND", "DRIVER", "BINDING", "WORKGROUP", "SUBGROUP", "TIER"];
    let mut rows = vec![heads.map(str::to_owned)];
    rows.extend(survey.iter().map(adapter_row));
    let width = |column: usize| {
        rows.iter().map(|row| row[column].chars().count()).max().unwrap_or_default()
    };
    let mut out = std::io::stdout().lock();
    for row in &rows {
        let cells: Vec<String> =
            (0..).zip(row).map(|(column, cell)| format!("{cell:<w$}", w = width(column))).collect();
        writeln!(out, "{}", cells.join("  ").trim_end())?;
    }
    for AdapterReport { name, why_not_better, .. } in &survey {
        if let Some(why) = why_not_better {
            writeln!(out, "{name}: {why}")?;
        }
    }
    Ok(())
}

fn adapter_row(report: &AdapterReport) -> [String; 8] {
    let subgroup = match report.subgroup {
        Some((min, max)) if min == max => min.to_string(),
        Some((min, max)) => format!("{min}-{max}"),
        None => "none".to_owned(),
    };
    [
        report.name.clone(),
        report.kind.to_owned(),
        report.backend.clone(),
        report.driver.clone(),
        format!("{} MiB", report.largest_binding >> 20),
        format!("{} KiB", report.workgroup_memory >> 10),
        subgroup,
        report.tier.map_or("unusable", Tier::name).to_owned(),
    ]
}

/// Settings from the file, the environment and the command line; later ones override.
fn settings(arguments: Arguments) -> anyhow::Result<Config> {
    let mut config = Config::load(arguments.config.as_deref())?;
    let Arguments { data_dir, grpc, http, models, adapter, tokens, .. } = arguments;
    config.access.tokens = tokens.or(config.access.tokens);
    config.access.insecure_no_auth |= arguments.insecure_no_auth;
    config.server.data_dir = data_dir.or(config.server.data_dir);
    config.server.grpc = grpc.unwrap_or(config.server.grpc);
    config.server.http = http.unwrap_or(config.server.http);
    config.language.models = models.unwrap_or(config.language.models);
    config.gpu.adapter = adapter.or(config.gpu.adapter);
    config.fleet.role = arguments.role.unwrap_or(config.fleet.role);
    if !arguments.nats.is_empty() {
        config.fleet.nats = arguments.nats;
    }
    config.check()?;
    Ok(config)
}

async fn run(config: Config) -> anyhow::Result<()> {
    // First, so that a signal during the start is not missed.
    let mut terminate = signal(SignalKind::terminate()).context("cannot wait for SIGTERM")?;
    let mut interrupt = signal(SignalKind::interrupt()).context("cannot wait for SIGINT")?;
    let stop = async move {
        tokio::select! {
            _ = terminate.recv() => {}
            _ = interrupt.recv() => {}
        }
    };
    // Before anything listens.
    let mut addresses = Vec::new();
    for (key, address) in
        [("server.grpc", &config.server.grpc), ("server.http", &config.server.http)]
    {
        let found = tokio::net::lookup_host(address).await;
        addresses.extend(found.with_context(|| format!("{key} is {address:?}: not an address"))?);
    }
    access::exposed(&config.access, &addresses)?;
    let listeners = Listeners {
        grpc: bind("server.grpc", &config.server.grpc).await?,
        http: bind("server.http", &config.server.http).await?,
    };
    if config.fleet.role == Role::Gateway {
        serve_gateway(listeners, config, print_ready, stop).await?;
        return Ok(());
    }
    let pipeline = config.pipeline();
    let engine = tokio::task::spawn_blocking(move || Engine::start(pipeline))
        .await
        .context("starting the pipeline panicked")??;
    serve(Arc::new(engine), listeners, config, print_ready, stop).await?;
    Ok(())
}

async fn bind(key: &str, address: &str) -> anyhow::Result<TcpListener> {
    TcpListener::bind(address).await.with_context(|| {
        format!(
            "cannot listen on {address} ({key}): choose another address, or port 0 for a free one"
        )
    })
}

/// Prints one line of JSON on standard output.
fn print_ready(ready: &Ready) {
    let line = serde_json::to_string(ready).expect("addresses and names are JSON");
    let mut out = std::io::stdout().lock();
    if writeln!(out, "{line}").and_then(|()| out.flush()).is_err() {
        tracing::warn!("cannot write to standard output");
    }
}
