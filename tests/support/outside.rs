//! Programs of others: Python with libraries that share nothing with lexsplat.

use crate::root;
use std::process::Command;

/// How long a program may take, seconds: one that hangs fails its test instead of holding up all of them.
const LIMIT_SECONDS: &str = "900";

/// A script, with the packages in these folders of `.deps/`.
pub fn python(script: &str, packages: &[&str]) -> Command {
    let packages = packages.iter().map(|folder| root().join(".deps").join(folder));
    let path = std::env::join_paths(packages).expect("paths without colons");
    let mut command = Command::new("timeout");
    command.args(["--kill-after", "10", LIMIT_SECONDS, "python3"]);
    command.env("PYTHONPATH", path).arg(root().join(script));
    command
}

/// Runs a program to its end; what it says.
///
/// # Panics
/// If it fails, with what it said.
pub fn said(command: &mut Command) -> String {
    let output = command.output().expect("it runs");
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    let complained = String::from_utf8_lossy(&output.stderr);
    assert!(
        output.status.success(),
        "{said}{complained} (deploy/setup.sh --tests installs what is needed)"
    );
    said
}
