//! The downloader of `make bundle`: its tests (`training/tests/test_download.py`, pytest) talk to a hub on
//! loopback that breaks connections off, is busy and sends wrong bytes. They need no network of weights.

use lexsplat_tests::root;
use std::process::Command;

/// Where `deploy/setup.sh --tests` installs pytest.
const DEPENDENCIES: &str = ".deps/client";

#[test]
fn the_downloader_passes_its_tests() {
    let python = |arguments: &[&str]| {
        Command::new("python3")
            .current_dir(root().join("training"))
            .env("PYTHONPATH", root().join(DEPENDENCIES))
            .env("PYTHONDONTWRITEBYTECODE", "1")
            .args(arguments)
            .output()
            .expect("python3 runs")
    };
    if !python(&["-c", "import tomllib"]).status.success() {
        println!("SKIPPED: the training package needs Python 3.11 or newer");
        return;
    }
    let output =
        python(&["-m", "pytest", "-q", "-p", "no:cacheprovider", "tests/test_download.py"]);
    let said = String::from_utf8_lossy(&output.stdout);
    let complained = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}{complained}");
    assert!(said.contains(" passed") && !said.contains("skipped"), "{said}");
}
