//! The command line `lexsplat`. Exit codes: 0 done, 1 failed, 2 wrong usage.

#![deny(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "they panic if nobody reads: `output` says it without"
)]

#[macro_use]
mod output;
mod access;
mod answer;
mod bench;
mod choices;
mod command;
mod dataset;
mod files;
mod progress;
mod runtime;
mod sensing;
mod server;
mod waiting;

use clap::{CommandFactory as _, Parser, Subcommand};
use std::process::ExitCode;

/// Stream RGB-D data to a lexsplat server and ask it where objects are.
#[derive(Parser)]
#[command(name = "lexsplat", version)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Ablate(command::ablate::Ablate),
    Bench(command::bench::Bench),
    Bridge(command::bridge::Bridge),
    Completions(command::shell::Completions),
    Demo(command::demo::Demo),
    Evaluate(Box<command::evaluate::Evaluate>),
    Export(command::export::Export),
    Inspect(command::inspect::Inspect),
    Man(command::shell::Man),
    Maps(command::maps::Maps),
    Query(command::query::Query),
    Stream(command::stream::Stream),
    Synth(command::synth::Synth),
}

fn main() -> ExitCode {
    let result = match Arguments::parse().command {
        Command::Ablate(arguments) => runtime::wait(command::ablate::run(&arguments)),
        Command::Bench(arguments) => runtime::wait(command::bench::run(&arguments)),
        Command::Bridge(arguments) => runtime::wait(command::bridge::run(&arguments)),
        Command::Completions(arguments) => {
            command::shell::completions(&arguments, Arguments::command())
        }
        Command::Demo(arguments) => runtime::wait(command::demo::run(&arguments)),
        Command::Evaluate(arguments) => runtime::wait(command::evaluate::run(&arguments)),
        Command::Export(arguments) => runtime::wait(command::export::run(&arguments)),
        Command::Inspect(arguments) => command::inspect::run(&arguments),
        Command::Man(arguments) => command::shell::man(&arguments, Arguments::command()),
        Command::Maps(arguments) => runtime::wait(command::maps::run(&arguments)),
        Command::Query(arguments) => runtime::wait(command::query::run(&arguments)),
        Command::Stream(arguments) => runtime::wait(command::stream::run(&arguments)),
        Command::Synth(arguments) => command::synth::run(&arguments),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) if output::was_enough(&error) => ExitCode::SUCCESS,
        Err(error) => {
            note!("lexsplat: {error:#}");
            ExitCode::FAILURE
        }
    }
}
